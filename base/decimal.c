/*
 * Exact decimals (decimal.h): a 64-bit mantissa and a power of ten, always normalized, so that equal values are equal
 * structs. Products with lattice numbers are computed in 128 bits. A conversion to double is one rounding of exact
 * operands if both are exact doubles (powers of ten up to 10^22 are); otherwise the exact text goes through strtod,
 * which rounds correctly. acut never sets a locale.
 */
#include "decimal.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { EXPONENT_MAX = 9999, PLAIN_MAX = 12, POWER_EXACT = 22 };

static const double power_ten[POWER_EXACT + 1] = {
	1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
	1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
};

static struct decimal normalised(int64_t mantissa, int32_t exponent)
{
	if (!mantissa)
		return (struct decimal){0, 0};
	while (mantissa % 10 == 0) {
		mantissa /= 10;
		exponent++;
	}
	return (struct decimal){mantissa, exponent};
}

bool decimal_from_double(double v, struct decimal *ret)
{
	char text[40];

	if (!isfinite(v))
		return false;
	for (int digits = 0; digits <= 16; digits++) {
		snprintf(text, sizeof text, "%.*e", digits, v);
		if (strtod(text, NULL) == v)
			break;
	}
	return decimal_parse(text, ret);
}

/* Appends digits at *text to the mantissa. Zeros are held back until another digit follows, so that trailing zeros
 * never overflow. *held: number of zeros held back. False: no digit, or the mantissa overflows. */
static bool take_digits(const char **text, uint64_t *mantissa, int64_t *held, int64_t *count)
{
	const char *t = *text;

	for (; *t >= '0' && *t <= '9'; t++) {
		++*count;
		if (*t == '0') {
			if (*mantissa)
				++*held;
			continue;
		}
		for (; *held >= 0; --*held)
			if (__builtin_mul_overflow(*mantissa, (uint64_t)10, mantissa))
				return false;
		*held = 0;
		if (__builtin_add_overflow(*mantissa, (uint64_t)(*t - '0'), mantissa))
			return false;
	}
	bool some = t != *text;

	*text = t;
	return some;
}

static bool take_exponent(const char **text, int64_t *ret)
{
	const char *t = *text;
	bool minus = *t == '-';
	int64_t e = 0;

	if (*t == '-' || *t == '+')
		t++;
	if (*t < '0' || *t > '9')
		return false;
	for (; *t >= '0' && *t <= '9'; t++)
		if (e <= 2 * EXPONENT_MAX)
			e = e * 10 + (*t - '0');
	*ret = minus ? -e : e;
	*text = t;
	return true;
}

bool decimal_parse(const char *text, struct decimal *ret)
{
	bool minus = *text == '-';
	uint64_t mantissa = 0;
	int64_t held = 0, whole = 0, fraction = 0, exponent = 0;

	if (*text == '-' || *text == '+')
		text++;
	if (*text != '.' && !take_digits(&text, &mantissa, &held, &whole))
		return false;
	if (*text == '.') {
		text++;
		if (!take_digits(&text, &mantissa, &held, &fraction))
			return false;
	}
	if (*text == 'e' || *text == 'E') {
		text++;
		if (!take_exponent(&text, &exponent))
			return false;
	}
	if (*text || mantissa > INT64_MAX)
		return false;
	exponent += held - fraction;
	if (mantissa && (exponent < -EXPONENT_MAX || exponent > EXPONENT_MAX))
		return false;
	*ret = normalised(minus ? -(int64_t)mantissa : (int64_t)mantissa, (int32_t)(mantissa ? exponent : 0));
	return true;
}

/* Decimal digits of v, most significant first; returns their number (one for zero). */
static int digits_of(unsigned __int128 v, char digits[40])
{
	char back[40];
	int n = 0;

	do {
		back[n++] = (char)('0' + (int)(v % 10));
		v /= 10;
	} while (v);
	for (int i = 0; i < n; i++)
		digits[i] = back[n - 1 - i];
	return n;
}

/* v * 10^exponent in plain notation. NULL if it takes more than `size` bytes with the terminating zero. */
static char *plain_text(bool minus, unsigned __int128 v, int exponent, char *buf, int size)
{
	char digits[40];
	int n = digits_of(v, digits), at = 0;

	if (!v)
		exponent = 0;
	while (exponent < 0 && n > 1 && digits[n - 1] == '0') {
		n--;
		exponent++;
	}
	int whole = n + exponent; /* digits before the point */
	int need = minus + (exponent >= 0 ? whole : whole > 0 ? n + 1 : 2 - whole + n) + 1;

	if (need > size)
		return NULL;
	if (minus)
		buf[at++] = '-';
	if (whole <= 0) {
		buf[at++] = '0';
		buf[at++] = '.';
		for (int i = whole; i < 0; i++)
			buf[at++] = '0';
	}
	for (int i = 0; i < n; i++) {
		if (i == whole && whole > 0)
			buf[at++] = '.';
		buf[at++] = digits[i];
	}
	for (int i = 0; i < exponent; i++)
		buf[at++] = '0';
	buf[at] = '\0';
	return buf;
}

static uint64_t magnitude(int64_t v)
{
	return v < 0 ? -(uint64_t)v : (uint64_t)v;
}

char *decimal_text(struct decimal d, char buf[DECIMAL_TEXT_SIZE])
{
	if (d.exponent >= -PLAIN_MAX && d.exponent <= PLAIN_MAX &&
	    plain_text(d.mantissa < 0, magnitude(d.mantissa), d.exponent, buf, DECIMAL_TEXT_SIZE))
		return buf;
	snprintf(buf, DECIMAL_TEXT_SIZE, "%llde%d", (long long)d.mantissa, (int)d.exponent);
	return buf;
}

int decimal_compare(struct decimal a, struct decimal b)
{
	char digits[40];
	int sign_a = (a.mantissa > 0) - (a.mantissa < 0), sign_b = (b.mantissa > 0) - (b.mantissa < 0);

	if (sign_a != sign_b || !sign_a)
		return (sign_a > sign_b) - (sign_a < sign_b);
	unsigned __int128 ma = magnitude(a.mantissa), mb = magnitude(b.mantissa);
	int64_t top_a = (int64_t)digits_of(ma, digits) + a.exponent, top_b = (int64_t)digits_of(mb, digits) + b.exponent;

	if (top_a != top_b)
		return top_a > top_b ? sign_a : -sign_a;
	/* Equal magnitude, so the exponents differ by at most the 18 digits that a mantissa can have. */
	for (int64_t e = a.exponent; e > b.exponent; e--)
		ma *= 10;
	for (int64_t e = b.exponent; e > a.exponent; e--)
		mb *= 10;
	return ma == mb ? 0 : ma > mb ? sign_a : -sign_a;
}

static double by_text(bool minus, unsigned __int128 v, int exponent)
{
	char text[64];
	int n = minus;

	if (minus)
		text[0] = '-';
	n += digits_of(v, text + n);
	snprintf(text + n, sizeof text - (size_t)n, "e%d", exponent);
	return strtod(text, NULL);
}

double decimal_scaled_double(struct decimal scale, int64_t n)
{
	int64_t product;

	if (!__builtin_mul_overflow(scale.mantissa, n, &product) && product <= (INT64_C(1) << 53) &&
	    product >= -(INT64_C(1) << 53) && scale.exponent >= -POWER_EXACT && scale.exponent <= POWER_EXACT) {
		if (scale.exponent < 0)
			return (double)product / power_ten[-scale.exponent];
		return (double)product * power_ten[scale.exponent];
	}
	return by_text((scale.mantissa < 0) != (n < 0), (unsigned __int128)magnitude(scale.mantissa) * magnitude(n),
		       scale.exponent);
}

double decimal_double(struct decimal d)
{
	return decimal_scaled_double(d, 1);
}

char *decimal_scaled_text(struct decimal scale, int64_t n, char buf[DECIMAL_TEXT_SIZE])
{
	unsigned __int128 v = (unsigned __int128)magnitude(scale.mantissa) * magnitude(n);
	bool minus = v && (scale.mantissa < 0) != (n < 0);
	char digits[40];

	if (plain_text(minus, v, scale.exponent, buf, DECIMAL_TEXT_SIZE))
		return buf;
	/* Not possible for the scale of a lattice. Still exact: 39 digits and a short exponent fit. */
	int count = digits_of(v, digits);

	snprintf(buf, DECIMAL_TEXT_SIZE, "%s%.*se%d", minus ? "-" : "", count, digits, (int)scale.exponent);
	return buf;
}

static bool times_tens(__int128 *v, int64_t tens)
{
	for (; tens > 0 && *v; tens--)
		if (__builtin_mul_overflow(*v, (__int128)10, v))
			return false;
	return true;
}

static bool steps(__int128 v, int64_t exponent, int64_t up, int64_t down, struct decimal step, bool nearest, int64_t *ret)
{
	int64_t tens = exponent - step.exponent;
	__int128 num, den, q, rest;

	*ret = v < 0 ? -DECIMAL_STEPS_MOST : DECIMAL_STEPS_MOST;
	if (__builtin_mul_overflow(v, (__int128)up, &num) || !times_tens(&num, tens))
		return false; /* 10^38 over a mantissa of at most 10^17 and a small number */
	den = (__int128)step.mantissa * down;
	if (!times_tens(&den, -tens)) {
		*ret = -(!nearest && v < 0); /* 10^38 against a number below 10^36 */
		return true;
	}
	q = num / den;
	rest = num % den;
	if (rest < 0) {
		rest += den;
		q--;
	}
	q += nearest && rest >= den - rest;
	if (q > DECIMAL_STEPS_MOST || q < -DECIMAL_STEPS_MOST)
		return false;
	*ret = (int64_t)q;
	return true;
}

bool decimal_steps(__int128 v, int64_t exponent, int64_t up, int64_t down, struct decimal step, int64_t *ret)
{
	return steps(v, exponent, up, down, step, true, ret);
}

bool decimal_steps_down(__int128 v, int64_t exponent, int64_t up, int64_t down, struct decimal step, int64_t *ret)
{
	return steps(v, exponent, up, down, step, false, ret);
}
