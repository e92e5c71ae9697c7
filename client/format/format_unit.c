/*
 * Units of length: their names, and what one is in another, exactly. The foot is 0.3048 m, the US survey foot
 * 1200/3937 m.
 *
 * A converted axis keeps two fractions of whole numbers, (X * a + b) / q: one that gives the nearest double, one
 * that gives the decimals of the text. Where the factor is a decimal the text is exact, with as many more
 * decimals as it needs; else (from or to US survey feet, from metres to feet) it is rounded to
 * FORMAT_MORE_DECIMALS more than the lattice has: far more than it takes to get the lattice number back.
 */
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "err.h"
#include "format_axis.h"
#include "wide.h"

#define FORMAT_MORE_DECIMALS 9

typedef __int128 i128;
typedef unsigned __int128 u128;

static const struct {
	const char *word, *name;
	int64_t num, den;
} units[] = {
	{"m", "metre", 1, 1},
	{"ft", "foot", 381, 1250},
	{"ftUS", "us-survey-foot", 1200, 3937},
};

#define UNITS (sizeof(units) / sizeof(*units))

const char *format_unit_of_word(const char *word, size_t n)
{
	for (size_t i = 0; i < UNITS; i++)
		if (strlen(units[i].word) == n && !strncasecmp(units[i].word, word, n))
			return units[i].name;
	return NULL;
}

bool format_unit_ratio(const char *from, const char *to, int64_t *num, int64_t *den)
{
	size_t f = UNITS, t = UNITS;
	int64_t n, d, g;

	for (size_t i = 0; i < UNITS; i++) {
		if (from && !strcmp(units[i].name, from))
			f = i;
		if (to && !strcmp(units[i].name, to))
			t = i;
	}
	if (f == UNITS || t == UNITS)
		return false;
	n = units[f].num * units[t].den;
	d = units[f].den * units[t].num;
	g = (int64_t)wide_gcd(n, d);
	*num = n / g;
	*den = d / g;
	return true;
}

const char *format_unit_known(const char *unit)
{
	return unit && *unit ? unit : "unknown";
}

int format_unit_xy(const char *option, const char *unit, const char *unit_xy, int64_t *num, int64_t *den, struct err *err)
{
	if (!unit || format_unit_ratio(unit, unit_xy, num, den))
		return 0;
	err_set(err, ERR_USAGE, "--%s is in %s, but the unit of x and y is %.30s", option, unit, format_unit_known(unit_xy));
	return err_add_hint(err, unit_xy && !strcmp(unit_xy, "degree") ?
					 "give a bare number of degrees" :
					 "give a bare number in the units of the files, or stage the inputs with --assume-units");
}

int format_unit_z(const char *unit_z, const char *to, int64_t *num, int64_t *den, struct err *err)
{
	if (format_unit_ratio(unit_z, to, num, den))
		return 0;
	err_set(err, ERR_USAGE, "--z-unit cannot convert heights: the unit of z is %.30s", format_unit_known(unit_z));
	return err_add_hint(err, "stage the inputs with --assume-units ,m or ,ft or ,ftUS, for inputs without units");
}

/* ---- a converted axis ---- */

static bool power_of_ten(int n, i128 *ret)
{
	i128 v = 1;

	if (n < 0 || n > 36)
		return false;
	while (n--)
		v *= 10;
	*ret = v;
	return true;
}

/* (X * a + b) * 10^e * num / den - origin, as (X * a' + b') / den / 10^decimals. */
static bool fraction(const struct format_axis *ax, int64_t num, int64_t den, struct decimal origin, int decimals,
		     struct format_fraction *ret)
{
	i128 up, o = 0, most, scaled;

	if (!power_of_ten(decimals + ax->e, &up) || (origin.mantissa && !power_of_ten(decimals + origin.exponent, &o)))
		return false;
	if (__builtin_mul_overflow((i128)ax->a * num, up, &ret->a) || __builtin_mul_overflow((i128)ax->b * num, up, &ret->b) ||
	    __builtin_mul_overflow((i128)origin.mantissa * den, o, &scaled) || __builtin_sub_overflow(ret->b, scaled, &ret->b))
		return false;
	ret->q = den;
	/* the largest number of all, with room for a doubling when it is rounded */
	return !__builtin_mul_overflow(ret->a, (i128)1 << 33, &most) &&
	       !__builtin_add_overflow(most, ret->b < 0 ? -ret->b : ret->b, &most) && most < (i128)1 << 124;
}

int format_unit_axis(struct format_axis *ax, int64_t num, int64_t den, struct decimal origin)
{
	int least = ax->e < 0 ? -ax->e : 0, more = 0;
	i128 ten = 1;

	if (origin.mantissa && -origin.exponent > least)
		least = -origin.exponent;
	while (more < FORMAT_MORE_DECIMALS && ten % den) {
		ten *= 10;
		more++;
	}
	if (!ax->whole || least > 12 || !fraction(ax, num, den, origin, least + more, &ax->text) ||
	    !fraction(ax, num, den, origin, least, &ax->value) || !power_of_ten(least, &ten))
		return -1;
	ax->value.q = den * ten;
	ax->decimals = least + more;
	ax->converted = true;
	ax->fast = false;
	return 0;
}

/* The double that is nearest to p / q, ties to even; q below 2^60. */
static double nearest(i128 p, i128 q)
{
	u128 n = p < 0 ? -(u128)p : (u128)p, quotient;
	int shift = 0;
	double v;

	if (!n)
		return 0;
	while (!(n >> 126)) {
		n <<= 1;
		shift++;
	}
	/* At least 66 bits, so that the last one can represent all lower ones. */
	quotient = n / (u128)q;
	quotient |= n % (u128)q != 0;
	v = __builtin_ldexp((double)quotient, -shift);
	return p < 0 ? -v : v;
}

double format_unit_value(const struct format_axis *ax, int32_t x)
{
	return nearest(x * ax->value.a + ax->value.b, ax->value.q);
}

char *format_unit_digits(unsigned __int128 n, int decimals, char *at)
{
	char digits[48];
	int len = 0;

	do {
		digits[len++] = (char)('0' + (int)(n % 10));
		n /= 10;
	} while (n);
	while (len <= decimals)
		digits[len++] = '0';
	while (len) {
		if (len == decimals)
			*at++ = '.';
		*at++ = digits[--len];
	}
	*at = 0;
	return at;
}

char *format_unit_text(const struct format_axis *ax, int32_t x, char *at)
{
	i128 p = x * ax->text.a + ax->text.b, q = ax->text.q;
	u128 n = p < 0 ? -(u128)p : (u128)p;

	n = (2 * n + (u128)q) / (2 * (u128)q);
	if (p < 0 && n)
		*at++ = '-';
	return format_unit_digits(n, ax->decimals, at);
}

char *format_unit_comment(const struct acut_mesh_head *head, const struct format_options *opt, char *buf, size_t size)
{
	int64_t num, den;

	buf[0] = 0;
	if (opt->z_unit && format_unit_ratio(head->unit_z, opt->z_unit, &num, &den) && num != den)
		snprintf(buf, size, "acut-z-unit %s: z is the lattice's z in %s times %lld/%lld", opt->z_unit, head->unit_z,
			 (long long)num, (long long)den);
	return buf;
}
