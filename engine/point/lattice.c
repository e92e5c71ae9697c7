/*
 * Choosing the lattice of a dataset (lattice.h), from the headers of all its inputs, whatever their order.
 * Scales and offsets are compared as exact decimals. Only the middle of the boxes is a double: it is
 * rounded once, the same way everywhere, and only decides where the lattice's zero lies.
 */
#include "lattice.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "parse.h"

enum { EXPONENT_LEAST = -40, EXPONENT_MOST = 8 };
static const int64_t mantissa_most = 100000000000000000; /* 10^17: a double has no more digits */
static const int64_t k_most = INT64_C(1) << 62;          /* X + K stays within int64 */
static const char axis_name[] = "xyz";

static bool scale_is_good(struct decimal s)
{
	return s.mantissa > 0 && s.mantissa <= mantissa_most && s.exponent >= EXPONENT_LEAST &&
	       s.exponent <= EXPONENT_MOST;
}

/* floor(v / scale); false if beyond +-2^62. The scale is good. */
static bool floor_ratio(struct decimal v, struct decimal scale, int64_t *ret)
{
	__int128 up = v.mantissa, down = scale.mantissa, q;
	int64_t e = (int64_t)v.exponent - scale.exponent;

	for (; e > 0 && up; e--)
		if (__builtin_mul_overflow(up, (__int128)10, &up))
			return false; /* up / down >= 10^38 / 10^17 */
	for (; e < 0; e++) {
		if (__builtin_mul_overflow(down, (__int128)10, &down)) {
			*ret = up < 0 ? -1 : 0; /* |up| < 2^63 < down */
			return true;
		}
	}
	q = up / down;
	if (up % down < 0)
		q--;
	if (q > k_most || q < -k_most)
		return false;
	*ret = (int64_t)q;
	return true;
}

static bool box_is_good(const struct lattice_input *in, unsigned axis)
{
	return isfinite(in->min[axis]) && isfinite(in->max[axis]) && in->min[axis] <= in->max[axis];
}

static int check_scales(const struct lattice_input *inputs, size_t n, struct err *err)
{
	char text[DECIMAL_TEXT_SIZE];

	for (size_t i = 0; i < n; i++) {
		for (unsigned a = 0; a < 3; a++) {
			if (scale_is_good(inputs[i].scale[a]))
				continue;
			err_set(err, ERR_INPUT, "the %c scale is %s, which is no scale", axis_name[a],
				decimal_text(inputs[i].scale[a], text));
			err_add_hint(err,
				     "mend the header of the file: scales are positive, from 1e-40 to 1e8");
			return err_add_file(err, inputs[i].name);
		}
	}
	return 0;
}

static int check_wanted(const struct decimal *scale, const char *what, struct err *err)
{
	char text[DECIMAL_TEXT_SIZE];

	if (!scale || scale_is_good(*scale))
		return 0;
	return err_set(err, ERR_USAGE,
		       "%s is no %s scale: it must be positive, from 1e-40 to 1e8, of at most 17 digits",
		       decimal_text(*scale, text), what);
}

static struct decimal finest(const struct lattice_input *inputs, size_t n, unsigned first, unsigned last)
{
	struct decimal least = inputs[0].scale[first];

	for (size_t i = 0; i < n; i++)
		for (unsigned a = first; a <= last; a++)
			if (decimal_compare(inputs[i].scale[a], least) < 0)
				least = inputs[i].scale[a];
	return least;
}

static bool same_decimal(struct decimal a, struct decimal b)
{
	return decimal_compare(a, b) == 0;
}

/* All inputs have one (offset, scale). */
static bool all_alike(const struct lattice_input *inputs, size_t n)
{
	for (size_t i = 0; i < n; i++) {
		if (!inputs[i].has_offset)
			return false;
		for (unsigned a = 0; a < 3; a++)
			if (!same_decimal(inputs[i].offset[a], inputs[0].offset[a]) ||
			    !same_decimal(inputs[i].scale[a], inputs[0].scale[a]))
				return false;
	}
	return true;
}

struct extent {
	double min, max;
	bool known;
};

static struct extent all_boxes(const struct lattice_input *inputs, size_t n, unsigned axis)
{
	struct extent e = {0};

	for (size_t i = 0; i < n; i++) {
		if (!box_is_good(&inputs[i], axis))
			continue;
		if (!e.known || inputs[i].min[axis] < e.min)
			e.min = inputs[i].min[axis];
		if (!e.known || inputs[i].max[axis] > e.max)
			e.max = inputs[i].max[axis];
		e.known = true;
	}
	return e;
}

static bool box_fits(double min, double max, double scale, int64_t k)
{
	return min / scale - (double)k > -0x1p31 && max / scale - (double)k < 0x1p31 - 1;
}

/* Two inputs that are as much to blame: the same one of them, whatever their order. */
static int tie(const struct lattice_input *a, const struct lattice_input *b)
{
	int order = 0;

	for (unsigned i = 0; !order && i < 3; i++) {
		order = decimal_compare(a->scale[i], b->scale[i]);
		if (!order)
			order = decimal_compare(a->offset[i], b->offset[i]);
	}
	if (!order)
		order = memcmp(a->min, b->min, sizeof a->min);
	if (!order)
		order = memcmp(a->max, b->max, sizeof a->max);
	return order ? order : strcmp(a->name, b->name);
}

static const struct lattice_input *blame(const struct lattice_input *a, double much_a, const struct lattice_input *b,
					 double much_b)
{
	return !a || much_b > much_a || (much_b == much_a && tie(b, a) < 0) ? b : a;
}

/* Who is to blame that the boxes do not fit: one whose own box is too wide for the scale, the widest; else the
 * one of the finest scale if they differ; else the one that lies farthest out. Whoever leaves that one out and
 * tries again comes to the same inputs from any order. */
static const struct lattice_input *who_does_not_fit(const struct lattice_input *inputs, size_t n,
						    unsigned axis, double scale, int64_t k)
{
	const struct lattice_input *wide = NULL, *fine = NULL, *far = NULL;
	double widest = 0, finest_scale = 0, farthest = 0;
	bool differ = false;

	for (size_t i = 0; i < n; i++) {
		const struct lattice_input *in = &inputs[i];
		double own = -decimal_double(in->scale[axis]), width, out;

		differ |= !same_decimal(in->scale[axis], inputs[0].scale[axis]);
		fine = blame(fine, finest_scale, in, own);
		finest_scale = -decimal_double(fine->scale[axis]);
		if (!box_is_good(in, axis))
			continue;
		width = (in->max[axis] - in->min[axis]) / scale;
		if (width > 0x1p32) {
			wide = blame(wide, widest, in, width);
			widest = wide == in ? width : widest;
		}
		out = fmax(fabs(in->min[axis] / scale - (double)k), fabs(in->max[axis] / scale - (double)k));
		far = blame(far, farthest, in, out);
		farthest = far == in ? out : farthest;
	}
	return wide ? wide : differ || !far ? fine : far;
}

static int too_wide(const struct lattice_input *inputs, size_t n, unsigned axis, struct decimal scale,
		    struct extent e, int64_t k, struct err *err)
{
	char text[DECIMAL_TEXT_SIZE];
	const struct lattice_input *in = who_does_not_fit(inputs, n, axis, decimal_double(scale), k);

	err_set(err, ERR_INPUT, "with the scale %s, %c from %.10g to %.10g does not fit into 32 bits",
		decimal_text(scale, text), axis_name[axis], e.min, e.max);
	err_add_hint(err, "give a coarser --scale, or leave the file out");
	return err_add_file(err, in->name);
}

/* K of one axis. The offset of alike inputs serves if their own scale is kept (raw numbers are 32 bits), or
 * if the boxes fit around it; else the middle of the boxes; without boxes the smallest offset. */
static int choose_k(const struct lattice_input *inputs, size_t n, unsigned axis, struct decimal scale,
		    bool alike, int64_t *ret, struct err *err)
{
	struct extent e = all_boxes(inputs, n, axis);
	struct decimal middle = {0, 0};
	double step = decimal_double(scale);
	bool some = false;

	if (alike && floor_ratio(inputs[0].offset[axis], scale, ret) &&
	    (!e.known || same_decimal(inputs[0].scale[axis], scale) || box_fits(e.min, e.max, step, *ret)))
		return 0;
	if (e.known) {
		decimal_from_double(e.min / 2 + e.max / 2, &middle);
	} else {
		for (size_t i = 0; i < n; i++) {
			if (!inputs[i].has_offset)
				continue;
			if (!some || decimal_compare(inputs[i].offset[axis], middle) < 0)
				middle = inputs[i].offset[axis];
			some = true;
		}
	}
	if (!floor_ratio(middle, scale, ret) || (e.known && !box_fits(e.min, e.max, step, *ret)))
		return too_wide(inputs, n, axis, scale, e, 0, err);
	return 0;
}

int lattice_choose(const struct lattice_input *inputs, size_t n, const struct decimal *scale_xy,
		   const struct decimal *scale_z, struct lattice *ret, struct err *err)
{
	struct lattice l;
	int rc;

	if (!n)
		return err_set(err, ERR_INPUT, "a lattice needs at least one input");
	if ((rc = check_scales(inputs, n, err)) || (rc = check_wanted(scale_xy, "xy", err)) ||
	    (rc = check_wanted(scale_z, "z", err)))
		return rc;
	l.scale_xy = scale_xy ? *scale_xy : finest(inputs, n, 0, 1);
	l.scale_z = scale_z ? *scale_z : finest(inputs, n, 2, 2);
	bool alike = all_alike(inputs, n);

	for (unsigned a = 0; a < 3; a++)
		if ((rc = choose_k(inputs, n, a, a < 2 ? l.scale_xy : l.scale_z, alike, &l.k[a], err)))
			return rc;
	*ret = l;
	return 0;
}

bool lattice_equal(const struct lattice *a, const struct lattice *b)
{
	return same_decimal(a->scale_xy, b->scale_xy) && same_decimal(a->scale_z, b->scale_z) &&
	       memcmp(a->k, b->k, sizeof a->k) == 0;
}

char *lattice_text(const struct lattice *l, char buf[LATTICE_TEXT_SIZE])
{
	char xy[DECIMAL_TEXT_SIZE], z[DECIMAL_TEXT_SIZE];

	snprintf(buf, LATTICE_TEXT_SIZE, "%s %s %lld %lld %lld", decimal_text(l->scale_xy, xy),
		 decimal_text(l->scale_z, z), (long long)l->k[0], (long long)l->k[1], (long long)l->k[2]);
	return buf;
}

bool lattice_parse(const char *text, struct lattice *ret)
{
	char words[5][DECIMAL_TEXT_SIZE], again[LATTICE_TEXT_SIZE];
	struct lattice l;

	if (strlen(text) >= LATTICE_TEXT_SIZE ||
	    sscanf(text, "%47s %47s %47s %47s %47s", words[0], words[1], words[2], words[3], words[4]) != 5)
		return false;
	if (!decimal_parse(words[0], &l.scale_xy) || !decimal_parse(words[1], &l.scale_z) ||
	    !scale_is_good(l.scale_xy) || !scale_is_good(l.scale_z))
		return false;
	for (unsigned a = 0; a < 3; a++)
		if (!parse_i64(words[2 + a], &l.k[a]) || l.k[a] > k_most || l.k[a] < -k_most)
			return false;
	if (strcmp(lattice_text(&l, again), text) != 0)
		return false;
	*ret = l;
	return true;
}
