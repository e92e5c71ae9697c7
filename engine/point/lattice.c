/*
 * Choosing the lattice of a dataset (lattice.h) from the headers of all its inputs, independently of their order.
 * Scales and offsets are compared as exact decimals. Only the middle of the boxes is a double. It is rounded once, in
 * the same way on every machine, and decides only where the lattice's zero is.
 */
#include "lattice.h"
#include "lattice_facts.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "parse.h"

enum { EXPONENT_LEAST = -40, EXPONENT_MOST = 8 };
static const int64_t mantissa_most = 100000000000000000; /* 10^17: doubles have no more digits */
static const int64_t k_most = INT64_C(1) << 62;          /* X + K stays within int64 */
static const char axis_name[] = "xyz";

static bool scale_is_good(struct decimal s)
{
	return s.mantissa > 0 && s.mantissa <= mantissa_most && s.exponent >= EXPONENT_LEAST && s.exponent <= EXPONENT_MOST;
}

/* floor(v / scale); false if it is beyond +-2^62. The scale is valid. */
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

static int check_scales(const struct lattice_facts *f, struct err *err)
{
	char text[DECIMAL_TEXT_SIZE];

	if (!f->bad)
		return 0;
	for (unsigned a = 0; a < 3; a++) {
		if (scale_is_good(f->bad->scale[a]))
			continue;
		err_set(err, ERR_INPUT, "the %c scale is %s, which is no scale", axis_name[a],
			decimal_text(f->bad->scale[a], text));
		break;
	}
	err_add_hint(err, "mend the header of the file: scales are positive, from 1e-40 to 1e8");
	return err_add_file(err, f->bad->name);
}

static int check_wanted(const struct decimal *scale, const char *what, struct err *err)
{
	char text[DECIMAL_TEXT_SIZE];

	if (!scale || scale_is_good(*scale))
		return 0;
	return err_set(err, ERR_USAGE, "%s is no %s scale: it must be positive, from 1e-40 to 1e8, of at most 17 digits",
		       decimal_text(*scale, text), what);
}

static bool same_decimal(struct decimal a, struct decimal b)
{
	return decimal_compare(a, b) == 0;
}

static bool box_fits(double min, double max, double scale, int64_t k)
{
	return min / scale - (double)k > -0x1p31 && max / scale - (double)k < 0x1p31 - 1;
}

bool lattice_scales_good(const struct lattice_input *in)
{
	return scale_is_good(in->scale[0]) && scale_is_good(in->scale[1]) && scale_is_good(in->scale[2]);
}

/* Compares two inputs that are equally at fault, so that the choice does not depend on their order. */
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

static double far_of(const struct lattice_input *in, unsigned axis)
{
	return fmax(fabs(in->min[axis]), fabs(in->max[axis]));
}

bool lattice_in_order(const struct lattice_input *in, unsigned axis, enum lattice_order by)
{
	switch (by) {
	case LATTICE_BY_SCALE:
		return true;
	case LATTICE_BY_EXACT:
		return in->coarsest[axis].mantissa == 0;
	case LATTICE_BY_COARSEST:
		return in->coarsest[axis].mantissa != 0;
	case LATTICE_BY_OFFSET:
		return in->has_offset;
	default:
		return box_is_good(in, axis);
	}
}

int lattice_compare(const struct lattice_input *a, const struct lattice_input *b, unsigned axis, enum lattice_order by)
{
	double x = 0, y = 0;
	int order = 0;

	switch (by) {
	case LATTICE_BY_SCALE:
	case LATTICE_BY_EXACT:
		order = decimal_compare(a->scale[axis], b->scale[axis]);
		break;
	case LATTICE_BY_COARSEST:
		order = decimal_compare(a->coarsest[axis], b->coarsest[axis]);
		break;
	case LATTICE_BY_OFFSET:
		return decimal_compare(a->offset[axis], b->offset[axis]);
	case LATTICE_BY_MIN:
		return (a->min[axis] > b->min[axis]) - (a->min[axis] < b->min[axis]);
	case LATTICE_BY_MAX:
		return (a->max[axis] < b->max[axis]) - (a->max[axis] > b->max[axis]);
	case LATTICE_BY_WIDTH:
		x = a->max[axis] - a->min[axis];
		y = b->max[axis] - b->min[axis];
		break;
	case LATTICE_BY_FAR:
		x = far_of(a, axis);
		y = far_of(b, axis);
		break;
	}
	if (!order)
		order = (x < y) - (x > y);
	return order ? order : tie(a, b);
}

/* The input at fault if the boxes do not fit: the widest one, if its box alone is too wide for the scale; else the one
 * that requires so fine a scale (the finest scale if they differ, or the smallest limit of rounding); else the one that
 * is farthest out. Leaving that input out and trying again gives the same inputs in any order. */
static const struct lattice_input *input_at_fault(const struct lattice_facts *f, unsigned axis, double scale)
{
	const struct lattice_input *const *first = f->first[axis], *wide = first[LATTICE_BY_WIDTH];
	const struct lattice_input *rounded = first[LATTICE_BY_COARSEST], *exact = first[LATTICE_BY_EXACT];

	if (wide && (wide->max[axis] - wide->min[axis]) / scale > 0x1p32)
		return wide;
	if (rounded && exact && decimal_double(exact->scale[axis]) > scale)
		return rounded;
	if (rounded && first[LATTICE_BY_FAR])
		return first[LATTICE_BY_FAR];
	return f->scales_differ[axis] || !first[LATTICE_BY_FAR] ? first[LATTICE_BY_SCALE] : first[LATTICE_BY_FAR];
}

static int too_wide(const struct lattice_facts *f, unsigned axis, struct decimal scale, struct err *err)
{
	char text[DECIMAL_TEXT_SIZE];
	const struct lattice_input *in = input_at_fault(f, axis, decimal_double(scale));
	const struct lattice_input *min = f->first[axis][LATTICE_BY_MIN], *max = f->first[axis][LATTICE_BY_MAX];

	err_set(err, ERR_INPUT, "with the scale %s, %c from %.10g to %.10g does not fit into 32 bits", decimal_text(scale, text),
		axis_name[axis], min ? min->min[axis] : 0, max ? max->max[axis] : 0);
	err_add_hint(err,
		     "give a coarser --scale, or leave the file out; a few points far from the rest, as at 0 0 0, do this, too");
	return err_add_file(err, in->name);
}

/* K of one axis. The offset of alike inputs is used if their own scale is kept (raw numbers have 32 bits), or if the
 * boxes fit around it. Otherwise the middle of the boxes; without boxes the smallest offset. False: the boxes do not
 * fit. */
static bool find_k(const struct lattice_facts *f, unsigned axis, struct decimal scale, int64_t *ret)
{
	const struct lattice_input *const *first = f->first[axis];
	const struct lattice_input *any = first[LATTICE_BY_SCALE], *min = first[LATTICE_BY_MIN], *max = first[LATTICE_BY_MAX];
	struct decimal middle = {0, 0};
	double step = decimal_double(scale);

	if (f->alike && floor_ratio(any->offset[axis], scale, ret) &&
	    (!min || same_decimal(any->scale[axis], scale) || box_fits(min->min[axis], max->max[axis], step, *ret)))
		return true;
	if (min)
		decimal_from_double(min->min[axis] / 2 + max->max[axis] / 2, &middle);
	else if (first[LATTICE_BY_OFFSET])
		middle = first[LATTICE_BY_OFFSET]->offset[axis];
	return floor_ratio(middle, scale, ret) && (!min || box_fits(min->min[axis], max->max[axis], step, *ret));
}

/* ---- the scale ---- */

/* Whether v is a whole multiple of the scale. */
static bool is_multiple(struct decimal v, struct decimal scale)
{
	__int128 up = v.mantissa, down = scale.mantissa;
	int64_t e = (int64_t)v.exponent - scale.exponent;

	for (; e > 0 && up % down; e--)
		if (__builtin_mul_overflow(up, (__int128)10, &up))
			return false;
	for (; e < 0; e++)
		if (__builtin_mul_overflow(down, (__int128)10, &down))
			return false;
	return up % down == 0;
}

/* The first, of axes [from, to], in this order; false: there is none. */
static bool first_value(const struct lattice_facts *f, unsigned from, unsigned to, enum lattice_order by, struct decimal *ret)
{
	bool any = false;

	for (unsigned a = from; a <= to; a++) {
		const struct lattice_input *in = f->first[a][by];
		struct decimal d;

		if (!in)
			continue;
		d = by == LATTICE_BY_COARSEST ? in->coarsest[a] : in->scale[a];
		if (!any || decimal_compare(d, *ret) < 0)
			*ret = d;
		any = true;
	}
	return any;
}

static bool boxes_fit(const struct lattice_facts *f, unsigned from, unsigned to, struct decimal scale)
{
	int64_t k;

	for (unsigned a = from; a <= to; a++)
		if (!find_k(f, a, scale, &k))
			return false;
	return true;
}

/* Replaces *divisor by the largest number that divides both; false: its digits do not fit. */
static bool divide_both(struct decimal v, struct decimal *divisor)
{
	int64_t least = v.exponent < divisor->exponent ? v.exponent : divisor->exponent;
	__int128 a = v.mantissa < 0 ? -(__int128)v.mantissa : v.mantissa, b = divisor->mantissa, r;

	if (!a)
		return true;
	for (int64_t e = v.exponent; e > least; e--)
		if (__builtin_mul_overflow(a, (__int128)10, &a))
			return false;
	for (int64_t e = divisor->exponent; e > least; e--)
		if (__builtin_mul_overflow(b, (__int128)10, &b))
			return false;
	for (; b; b = r) {
		r = a % b;
		a = b;
	}
	for (; a % 10 == 0; a /= 10)
		least++;
	if (a > mantissa_most)
		return false;
	*divisor = (struct decimal){(int64_t)a, (int32_t)least};
	return true;
}

enum { TILE = 1000 }; /* usual width of a tile, in units of the files */

/* Whether a lattice of this scale covers much more than the inputs, wherever they are: 64 times their width on each
 * side. `least`: the smallest width that is assumed. */
static bool has_room(const struct lattice_facts *f, unsigned from, unsigned to, struct decimal scale, double least)
{
	for (unsigned a = from; a <= to; a++) {
		const struct lattice_input *min = f->first[a][LATTICE_BY_MIN], *max = f->first[a][LATTICE_BY_MAX];

		if (!min || fmax(max->max[a] - min->min[a], least) * 64 > 0x1p31 * decimal_double(scale))
			return false;
	}
	return boxes_fit(f, from, to, scale);
}

/* Whether the boxes of alike inputs are plausible: raw numbers of 32 bits can be in them, and they are more than one
 * position. Otherwise a header is wrong and says nothing about the room for a finer scale. */
static bool boxes_are_likely(const struct lattice_facts *f, unsigned from, unsigned to)
{
	bool wide = false;

	for (unsigned a = from; a <= to; a++) {
		const struct lattice_input *min = f->first[a][LATTICE_BY_MIN], *max = f->first[a][LATTICE_BY_MAX];
		const struct lattice_input *any = f->first[a][LATTICE_BY_SCALE];
		double reach = 0x1p31 * decimal_double(any->scale[a]), offset = decimal_double(any->offset[a]);

		if (!min || min->min[a] < offset - reach || max->max[a] > offset + reach)
			return false;
		wide |= max->max[a] > min->min[a];
	}
	return wide;
}

/* For alike inputs whose offset is between two steps of their scale, or whose scales are not multiples of each other:
 * the coarsest scale on which all of their numbers are exact. It is not used if it is more than 1,000 times as fine, or
 * leaves little room for later pushes; then the numbers are rounded, and counted. */
static struct decimal exact_scale(const struct lattice_facts *f, unsigned from, unsigned to, struct decimal finest)
{
	enum { FINER = 1000 };
	const struct lattice_input *any = f->first[from][LATTICE_BY_SCALE];
	struct decimal s = finest;

	for (unsigned a = from; a <= to; a++)
		if (!divide_both(any->scale[a], &s) || !divide_both(any->offset[a], &s))
			return finest;
	if (!scale_is_good(s) || decimal_double(s) * FINER < decimal_double(finest) * 0.999 || !boxes_are_likely(f, from, to) ||
	    !has_room(f, from, to, s, f->grows ? TILE : 0))
		return finest;
	return s;
}

/* Whether it covers the boxes, and also later inputs if the lattice grows. */
static bool is_enough(const struct lattice_facts *f, unsigned from, unsigned to, struct decimal scale)
{
	if (f->grows && f->first[from][LATTICE_BY_MIN])
		return has_room(f, from, to, scale, TILE);
	return boxes_fit(f, from, to, scale);
}

/* For axes [from, to], which share a scale. If even this scale does not fit, the search for K reports it. */
static struct decimal choose_scale(const struct lattice_facts *f, unsigned from, unsigned to)
{
	struct decimal finest = {1, 0}, exact, last, tenth, s;
	bool has_exact = first_value(f, from, to, LATTICE_BY_EXACT, &exact);

	first_value(f, from, to, LATTICE_BY_SCALE, &finest);
	if (!first_value(f, from, to, LATTICE_BY_COARSEST, &last))
		return f->alike ? exact_scale(f, from, to, finest) : finest;
	tenth = (struct decimal){last.mantissa, last.exponent - 1};
	/* A lattice that needs hardly more digits than it must keep is not rounded. */
	if (is_enough(f, from, to, finest) || (decimal_compare(tenth, finest) < 0 && boxes_fit(f, from, to, finest)))
		return finest;
	if (has_exact && decimal_compare(exact, last) < 0)
		last = exact;
	for (s = (struct decimal){1, finest.exponent}; decimal_compare(s, last) < 0; s.exponent++)
		if (decimal_compare(s, finest) > 0 && (!has_exact || is_multiple(exact, s)) && is_enough(f, from, to, s))
			return s;
	return last;
}

int lattice_decide(const struct lattice_facts *f, const struct decimal *scale_xy, const struct decimal *scale_z,
		   struct lattice *ret, struct err *err)
{
	struct lattice l;
	int rc;

	if ((rc = check_scales(f, err)) || (rc = check_wanted(scale_xy, "xy", err)) || (rc = check_wanted(scale_z, "z", err)))
		return rc;

	l.scale_xy = scale_xy ? *scale_xy : choose_scale(f, 0, 1);
	l.scale_z = scale_z ? *scale_z : choose_scale(f, 2, 2);
	for (unsigned a = 0; a < 3; a++)
		if (!find_k(f, a, a < 2 ? l.scale_xy : l.scale_z, &l.k[a]))
			return too_wide(f, a, a < 2 ? l.scale_xy : l.scale_z, err);
	*ret = l;
	return 0;
}

bool lattice_alike(const struct lattice_input *a, const struct lattice_input *b)
{
	if (!a->has_offset || !b->has_offset)
		return false;
	for (unsigned i = 0; i < 3; i++)
		if (!same_decimal(a->offset[i], b->offset[i]) || !same_decimal(a->scale[i], b->scale[i]))
			return false;
	return true;
}

int lattice_choose(const struct lattice_input *inputs, size_t n, const struct decimal *scale_xy, const struct decimal *scale_z,
		   struct lattice *ret, struct err *err)
{
	struct lattice_facts f = {.alike = true, .grows = n && inputs[0].grows};

	if (!n)
		return err_set(err, ERR_INPUT, "a lattice needs at least one input");
	for (size_t i = 0; i < n; i++) {
		const struct lattice_input *in = &inputs[i];

		if (!f.bad && !lattice_scales_good(in))
			f.bad = in;
		f.alike = f.alike && lattice_alike(&inputs[0], in);
		for (unsigned a = 0; a < 3; a++) {
			f.scales_differ[a] |= !same_decimal(inputs[0].scale[a], in->scale[a]);
			for (enum lattice_order by = 0; by < LATTICE_ORDERS; by++)
				if (lattice_in_order(in, a, by) &&
				    (!f.first[a][by] || lattice_compare(in, f.first[a][by], a, by) < 0))
					f.first[a][by] = in;
		}
	}
	return lattice_decide(&f, scale_xy, scale_z, ret, err);
}

bool lattice_equal(const struct lattice *a, const struct lattice *b)
{
	return same_decimal(a->scale_xy, b->scale_xy) && same_decimal(a->scale_z, b->scale_z) &&
	       memcmp(a->k, b->k, sizeof a->k) == 0;
}

char *lattice_text(const struct lattice *l, char buf[LATTICE_TEXT_SIZE])
{
	char xy[DECIMAL_TEXT_SIZE], z[DECIMAL_TEXT_SIZE];

	snprintf(buf, LATTICE_TEXT_SIZE, "%s %s %lld %lld %lld", decimal_text(l->scale_xy, xy), decimal_text(l->scale_z, z),
		 (long long)l->k[0], (long long)l->k[1], (long long)l->k[2]);
	return buf;
}

bool lattice_parse(const char *text, struct lattice *ret)
{
	char words[5][DECIMAL_TEXT_SIZE], again[LATTICE_TEXT_SIZE];
	struct lattice l;

	if (strlen(text) >= LATTICE_TEXT_SIZE ||
	    sscanf(text, "%47s %47s %47s %47s %47s", words[0], words[1], words[2], words[3], words[4]) != 5)
		return false;
	if (!decimal_parse(words[0], &l.scale_xy) || !decimal_parse(words[1], &l.scale_z) || !scale_is_good(l.scale_xy) ||
	    !scale_is_good(l.scale_z))
		return false;
	for (unsigned a = 0; a < 3; a++)
		if (!parse_i64(words[2 + a], &l.k[a]) || l.k[a] > k_most || l.k[a] < -k_most)
			return false;
	if (strcmp(lattice_text(&l, again), text) != 0)
		return false;
	*ret = l;
	return true;
}
