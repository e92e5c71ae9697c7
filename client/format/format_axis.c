/*
 * Lattice numbers to coordinates, doubles and text.
 *
 * A coordinate is (X + k) * scale - origin; with a common power of ten it becomes (X * a + b) * 10^e with
 * whole a and b. Where |X * a + b| stays below 2^53 for every int32 X and |e| <= 22, both that number and
 * 10^|e| are doubles without error, so that one multiplication or division gives the nearest double; and as
 * X, a and b are exact in doubles too, the whole of it runs in vector registers. Everything else takes the
 * slow and equally exact way through decimal_scaled_*.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "format_digits.h"
#include "format_axis.h"

static const double ten[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
			     1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

/* m * 10^n into *ret; false if it overflows. */
static bool times_ten(int64_t m, int32_t n, int64_t *ret)
{
	for (; n > 0 && m; n--)
		if (__builtin_mul_overflow(m, 10, &m))
			return false;
	*ret = m;
	return true;
}

/* a, b, e for one axis; false if they do not fit into 62 bits. */
static bool axis_whole(struct format_axis *ax, const struct decimal *origin)
{
	int64_t o = 0, b;
	__int128 reach;

	ax->e = ax->scale.exponent;
	if (origin && origin->mantissa && origin->exponent < ax->e)
		ax->e = origin->exponent;
	if (ax->scale.exponent - ax->e > 18 || !times_ten(ax->scale.mantissa, ax->scale.exponent - ax->e, &ax->a))
		return false;
	if (origin && origin->mantissa &&
	    (origin->exponent - ax->e > 18 || !times_ten(origin->mantissa, origin->exponent - ax->e, &o)))
		return false;
	if (__builtin_mul_overflow(ax->k, ax->a, &b) || __builtin_sub_overflow(b, o, &b))
		return false;
	ax->b = b;
	reach = ((__int128)1 << 31) * ax->a + (b < 0 ? -(__int128)b : b);
	if (ax->a <= 0 || reach >= (__int128)1 << 62)
		return false;
	ax->fast = reach < (__int128)1 << 53 && ax->e >= -22 && ax->e <= 22;
	if (ax->fast)
		ax->power = ten[abs(ax->e)];
	return true;
}

/* The origin of --origin auto: the middle of the box, as a lattice number. */
static int64_t auto_number(const struct acut_mesh_head *head, int axis)
{
	return head->k[axis] + (int64_t)(((int64_t)head->box[axis] + head->box[axis + 3]) >> 1);
}

/* Heights that are in z_unit already are not touched. */
static bool same_unit(const struct acut_mesh_head *head, const struct format_options *opt)
{
	int64_t num, den;

	return format_unit_ratio(head->unit_z, opt->z_unit, &num, &den) && num == den;
}

/* The origin that --origin auto takes off converted heights. */
static struct decimal auto_height(const struct acut_mesh_head *head, const struct format_options *opt)
{
	struct decimal scale, ret = {0, 0};
	int64_t num, den;
	char text[32];

	if (decimal_parse(head->scale_z, &scale) && format_unit_ratio(head->unit_z, opt->z_unit, &num, &den)) {
		snprintf(text, sizeof(text), "%.0f",
			 decimal_scaled_double(scale, auto_number(head, 2)) * (double)num / (double)den);
		decimal_parse(text, &ret);
	}
	return ret;
}

/* The heights of z_unit. With --origin auto, the middle is taken off in whole units, since a converted one need
 * not be a decimal. */
static int axis_convert(struct format_axis *ax, const struct acut_mesh_head *head, const struct format_options *opt,
			struct err *err)
{
	struct decimal origin = {0, 0};
	int64_t num, den;
	int r = format_unit_z(head->unit_z, opt->z_unit, &num, &den, err);

	if (r)
		return r;
	ax->k = head->k[2];
	ax->whole = axis_whole(ax, NULL);
	if (opt->origin_auto)
		origin = auto_height(head, opt);
	else if (opt->has_origin)
		origin = opt->origin[2];
	if (!format_unit_axis(ax, num, den, origin))
		return 0;
	err_set(err, ERR_USAGE, "--z-unit: heights at the scale %s have too many digits to be converted", head->scale_z);
	return err_add_hint(err, "stage with a --scale of fewer decimals, or leave --z-unit or --origin out");
}

int format_axis_init(struct format_axis axis[3], const struct acut_mesh_head *head, const struct format_options *opt,
		     struct err *err)
{
	static const char *const name[] = {"x", "y", "z"};

	for (int i = 0; i < 3; i++) {
		struct format_axis *ax = &axis[i];
		bool ok = true;

		memset(ax, 0, sizeof(*ax));
		if (!decimal_parse(i < 2 ? head->scale_xy : head->scale_z, &ax->scale))
			return err_set(err, ERR_PROTO, "the stream's %s scale is not a number", name[i]);
		ax->k = head->k[i];
		if (i == 2 && opt->z_unit && !same_unit(head, opt)) {
			int r = axis_convert(ax, head, opt, err);

			if (r)
				return r;
		} else if (opt->origin_auto) {
			int64_t o = auto_number(head, i);
			ax->k = head->k[i] - o;
			ok = ax->whole = axis_whole(ax, NULL);
		} else if (opt->has_origin) {
			ok = ax->whole = axis_whole(ax, &opt->origin[i]);
		} else {
			ax->whole = axis_whole(ax, NULL);
		}
		if (!ok) {
			err_set(err, ERR_USAGE, "the %s of --origin has too many digits beside the scale %s", name[i],
				i < 2 ? head->scale_xy : head->scale_z);
			return err_add_hint(err, opt->origin_auto ?
							 "stage with a --scale of fewer decimals" :
							 "give --origin with fewer decimals, or stage with a --scale of fewer");
		}
	}
	return 0;
}

double format_axis_value(const struct format_axis *ax, int32_t x)
{
	if (ax->converted)
		return format_unit_value(ax, x);
	if (ax->fast) {
		double n = (double)x * (double)ax->a + (double)ax->b;
		return ax->e < 0 ? n / ax->power : n * ax->power;
	}
	if (ax->whole)
		return decimal_scaled_double((struct decimal){1, ax->e}, x * ax->a + ax->b);
	return decimal_scaled_double(ax->scale, x + ax->k);
}

void format_axis_values(const struct format_axis axis[3], const int32_t (*v)[3], size_t n, double *ret)
{
	if (axis[0].fast && axis[1].fast && axis[2].fast && axis[0].e <= 0 && axis[1].e <= 0 && axis[2].e <= 0) {
		const double a[3] = {(double)axis[0].a, (double)axis[1].a, (double)axis[2].a};
		const double b[3] = {(double)axis[0].b, (double)axis[1].b, (double)axis[2].b};
		const double p[3] = {axis[0].power, axis[1].power, axis[2].power};

		for (size_t i = 0; i < n; i++)
			for (int j = 0; j < 3; j++)
				ret[3 * i + (size_t)j] = (v[i][j] * a[j] + b[j]) / p[j];
		return;
	}
	for (size_t i = 0; i < n; i++)
		for (int j = 0; j < 3; j++)
			ret[3 * i + (size_t)j] = format_axis_value(&axis[j], v[i][j]);
}

/* n / 10^decimals, decimals <= 8. Divisions by constants are multiplications. */
static char *put_decimal(uint64_t n, int decimals, char *at)
{
	uint64_t whole = n, rest = 0;

	switch (decimals) {
#define SPLIT(d, power)            \
	case d:                    \
		whole = n / power; \
		rest = n % power;  \
		break
		SPLIT(1, 10u);
		SPLIT(2, 100u);
		SPLIT(3, 1000u);
		SPLIT(4, 10000u);
		SPLIT(5, 100000u);
		SPLIT(6, 1000000u);
		SPLIT(7, 10000000u);
		SPLIT(8, 100000000u);
#undef SPLIT
	}
	at = format_digits_put(whole, at);
	if (!decimals)
		return at;
	*at++ = '.';
	return format_digits_last((uint32_t)rest, decimals, at);
}

char *format_axis_text(const struct format_axis *ax, int32_t x, char *at)
{
	uint64_t n;
	int64_t v;
	int decimals;

	if (ax->converted)
		return format_unit_text(ax, x, at);
	if (!ax->whole || ax->e < -20 || ax->e > 18) {
		char buf[DECIMAL_TEXT_SIZE];
		if (ax->whole)
			decimal_scaled_text((struct decimal){1, ax->e}, x * ax->a + ax->b, buf);
		else
			decimal_scaled_text(ax->scale, x + ax->k, buf);
		return stpcpy(at, buf);
	}
	v = x * ax->a + ax->b;
	n = v < 0 ? (uint64_t)-v : (uint64_t)v;
	if (v < 0)
		*at++ = '-';
	decimals = ax->e < 0 ? -ax->e : 0;
	if (ax->e <= 0 && decimals <= 8) {
		at = put_decimal(n, decimals, at);
		*at = 0;
		return at;
	}
	at = format_unit_digits(n, decimals, at);
	for (int i = 0; v && i < ax->e; i++)
		*at++ = '0';
	*at = 0;
	return at;
}

char *format_axis_origin(const struct acut_mesh_head *head, const struct format_options *opt, char *buf, size_t size)
{
	char text[3][DECIMAL_TEXT_SIZE];

	buf[0] = 0;
	if (!opt->origin_auto && !opt->has_origin)
		return buf;
	for (int i = 0; i < 3; i++) {
		struct decimal scale;

		if (opt->origin_auto && i == 2 && opt->z_unit && !same_unit(head, opt))
			decimal_text(auto_height(head, opt), text[i]);
		else if (!opt->origin_auto)
			decimal_text(opt->origin[i], text[i]);
		else if (decimal_parse(i < 2 ? head->scale_xy : head->scale_z, &scale))
			decimal_scaled_text(scale, auto_number(head, i), text[i]);
		else
			strcpy(text[i], "0");
	}
	snprintf(buf, size, "acut-origin %s %s %s", text[0], text[1], text[2]);
	return buf;
}
