/*
 * Chooses the unit of the raw numbers of a text, and converts numbers to multiples of it.
 *
 * Model: x and y share one unit, z has its own. It is the last decimal place of all numbers, zeros included ("77.890" means
 * millimetres). If the extent is not within 2^31 such units, it is the last place with a digit other than zero. So raw numbers
 * are exact, and the lattice decides whether they are rounded.
 *
 * Texts from programs may have more digits than a raw number holds. If the scale of the lattice is known, their unit is a
 * millionth of it (a hundredth, if a millionth is too fine for 63 bits), and a number between two raw numbers becomes the odd one
 * of them. Points of the lattice, and the middles between them, are even numbers of units. So rounding a raw number to the
 * lattice gives the same as rounding the number itself, and a point that is not on the lattice counts as moved. If no lattice is
 * known (info), the unit is the finest scale that holds the file in 32 bits, and numbers are rounded to it.
 */
#include "input_text_parts.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "lattice.h"

enum { FORWARD_PLACE = -9, PLACE_LEAST = -15 };

/* Axes that share a unit. */
struct group {
	const char *axes;
	unsigned from, to;
};
static const struct group groups[2] = {{"x and y", 0, 1}, {"z", 2, 2}};

/* The coarsest scale that may replace one that is too fine for 32 bits: half a millimetre if the unit is the metre; a tenth of
 * that in degrees. */
static struct decimal coarsest(const struct input *in, const struct group *g)
{
	return in->info.crs.plane == CRS_PLANE_GEOGRAPHIC && !g->from ? (struct decimal){1, -9} : (struct decimal){5, -4};
}

static double largest(const struct input_extent *e)
{
	return e->min <= e->max ? fmax(fabs(e->min), fabs(e->max)) : 0;
}

/* Raw numbers are int64: with a margin for numbers that lie within 32 bits of `lattice` units of these. */
static bool holds(const struct input_extent axis[3], const struct group *g, struct decimal unit, double lattice)
{
	double scale = decimal_double(unit);

	for (unsigned i = g->from; i <= g->to; i++)
		if ((largest(&axis[i]) + 0x1p32 * lattice) / scale >= 4e18)
			return false;
	return true;
}

static bool comfortable(const struct input_extent axis[3], const struct group *g, int place)
{
	if (place < PLACE_LEAST || !holds(axis, g, (struct decimal){1, place}, 0))
		return false;
	for (unsigned i = g->from; i <= g->to; i++)
		if (axis[i].min <= axis[i].max && (axis[i].max - axis[i].min) / pow(10, place) >= 0x1p31)
			return false;
	return true;
}

/* The finest scale from `start` on that the lattice of this file alone would have. */
static struct decimal own_scale(const struct input *in, const struct input_extent axis[3], const struct group *g,
				struct decimal start)
{
	const struct decimal most = coarsest(in, g);
	struct lattice_input alone = {.name = ""};
	struct err ignored = ERR_INIT;
	struct lattice l;

	for (unsigned i = 0; i < 3; i++) {
		bool of_group = i >= g->from && i <= g->to;

		alone.scale[i] = of_group ? start : (struct decimal){1, 0};
		alone.min[i] = of_group ? axis[i].min : NAN;
		alone.max[i] = of_group ? axis[i].max : NAN;
		alone.coarsest[i] = most;
	}
	if (decimal_compare(start, most) >= 0)
		return start;
	if (lattice_choose(&alone, 1, NULL, NULL, &l, &ignored))
		return most;
	return g->from ? l.scale_z : l.scale_xy;
}

static int too_large(struct input *in, const struct input_extent axis[3], const struct group *g, struct err *err)
{
	double most = fmax(largest(&axis[g->from]), largest(&axis[g->to]));

	input_fail(in, err, ERR_INPUT, ERR_NO_OFFSET, NULL, "%s up to %g are too large for their digits", g->axes, most);
	return err_add_hint(err, "give a coarser --scale, or mend the file: are there numbers in it that are no coordinates?");
}

/* A millionth of the lattice's scale, or a hundredth if that is too fine. */
static int unit_below(struct input *in, const struct input_extent axis[3], const struct group *g, struct decimal lattice,
		      struct input_place *ret, struct err *err)
{
	for (int k = 6; k >= 2; k -= 2) {
		*ret = (struct input_place){INPUT_ODD, {lattice.mantissa, lattice.exponent - k}};
		if (holds(axis, g, ret->scale, decimal_double(lattice)))
			return 0;
	}
	return too_large(in, axis, g, err);
}

static int choose(struct input *in, const struct input_extent axis[3], const struct group *g, struct input_place *ret,
		  struct err *err)
{
	struct decimal lattice = in->lattice[g->from / 2], start = {1, PLACE_LEAST};
	int written = 0, needed = 0;
	bool deep = false;

	for (unsigned i = g->from; i <= g->to; i++) {
		written = axis[i].written < written ? axis[i].written : written;
		needed = axis[i].needed < needed ? axis[i].needed : needed;
		deep |= axis[i].deep;
	}
	*ret = (struct input_place){INPUT_EXACT, {1, written}};
	if (!deep && comfortable(axis, g, written))
		return 0;
	ret->scale.exponent = needed;
	if (!deep && holds(axis, g, ret->scale, 0))
		return 0;
	if (lattice.mantissa)
		return unit_below(in, axis, g, lattice, ret, err);
	while (start.exponent < 0 && !holds(axis, g, start, 0))
		start.exponent++;
	*ret = (struct input_place){INPUT_NEAREST, own_scale(in, axis, g, start)};
	return holds(axis, g, ret->scale, 0) ? 0 : too_large(in, axis, g, err);
}

/* The scale that numbers of the group are rounded to where they have more digits than the file's own lattice. */
static bool rounds_to(const struct input *in, const struct input_extent axis[3], const struct group *g, struct decimal *ret)
{
	const struct input_place *unit = &input_xyz_of(in)->place[g->from / 2];

	*ret = unit->rounding == INPUT_EXACT ? own_scale(in, axis, g, unit->scale) : unit->scale;
	return unit->rounding == INPUT_NEAREST || (unit->rounding == INPUT_EXACT && decimal_compare(*ret, unit->scale) != 0);
}

/* Warns about rounding if the file is opened on its own; in a push, the daemon tells which scale it chose. */
static void warn(struct input *in, const struct input_extent axis[3])
{
	char text[2][DECIMAL_TEXT_SIZE];
	struct decimal scale[2];
	bool any[2];

	for (int i = 0; i < 2; i++) {
		any[i] = rounds_to(in, axis, &groups[i], &scale[i]);
		decimal_text(scale[i], text[i]);
	}
	if (any[0] && any[1])
		input_warn(in,
			   "the coordinates have more digits than fit into 32 bits: x and y are rounded to %s, z to %s; to use "
			   "another scale, give --scale XY,Z",
			   text[0], text[1]);
	else if (any[0] || any[1])
		input_warn(in,
			   "the coordinates have more digits than fit into 32 bits: %s rounded to %s; to use another scale, give "
			   "--scale XY,Z",
			   any[0] ? "x and y are" : "z is", text[any[1]]);
}

static void describe(struct input *in, const struct input_extent axis[3])
{
	struct lattice_input *coords = &in->info.coords;

	coords->has_offset = false;
	for (int i = 0; i < 3; i++) {
		const struct input_place *unit = &input_xyz_of(in)->place[i / 2];
		struct decimal most = coarsest(in, &groups[i / 2]);

		coords->scale[i] = unit->scale;
		coords->offset[i] = (struct decimal){0, 0};
		coords->coarsest[i] = decimal_compare(unit->scale, most) < 0 ? most : (struct decimal){0, 0};
		coords->rounds[i] = unit->rounding != INPUT_EXACT;
		coords->min[i] = axis[i].min;
		coords->max[i] = axis[i].max;
	}
}

int input_places_choose(struct input *in, const struct input_extent axis[3], struct err *err)
{
	for (unsigned i = 0; i < 2; i++) {
		int rc = choose(in, axis, &groups[i], &input_xyz_of(in)->place[i], err);

		if (rc)
			return rc;
	}
	describe(in, axis);
	if (!in->lattice_later)
		warn(in, axis);
	return 0;
}

/* The digits of a text that is only read forwards are not known beforehand: without a lattice, all axes get nine decimals. */
int input_places_forward(struct input *in, const struct input_extent axis[3], struct err *err)
{
	for (unsigned i = 0; i < 2; i++) {
		int rc = 0;

		input_xyz_of(in)->place[i] = (struct input_place){INPUT_EXACT, {1, FORWARD_PLACE}};
		if (in->lattice[i].mantissa)
			rc = unit_below(in, axis, &groups[i], in->lattice[i], &input_xyz_of(in)->place[i], err);
		if (rc)
			return rc;
	}
	describe(in, axis);
	return 0;
}

/* ---- numbers ---- */

/* v * 10^e; false: it does not fit. */
static bool up(unsigned __int128 *v, int e)
{
	for (; e > 0 && *v; e--)
		if (__builtin_mul_overflow(*v, (unsigned __int128)10, v))
			return false;
	return true;
}

/* |value| / unit: whole units, and how much of one is left: 0, 1 below a half, 2 a half, 3 above it. False: too large. */
static bool divide(const struct input_digits *d, struct decimal unit, uint64_t *ret_whole, unsigned *ret_part)
{
	unsigned __int128 value = d->mantissa, by = (uint64_t)unit.mantissa, rest;
	int e = d->exponent - unit.exponent;

	/* with more digits than were kept the value is at least 10^35: in units too many, or e is not above 0 */
	if (e > 0 && (d->more || !up(&value, e)))
		return false;
	if (e < 0 && !up(&by, -e)) { /* 10^38 and more, which no value is half of */
		*ret_whole = 0;
		*ret_part = value || d->more;
		return true;
	}
	rest = value % by;
	value /= by;
	if (value > INT64_MAX / 2)
		return false;
	*ret_whole = (uint64_t)value;
	*ret_part = rest < by - rest ? rest || d->more : rest > by - rest || d->more ? 3 : 2;
	return true;
}

bool input_place_round(const struct input_place *unit, const struct input_number *n, int64_t *ret)
{
	struct input_digits d = input_number_digits(n);
	uint64_t whole;
	unsigned part;

	if (!divide(&d, unit->scale, &whole, &part))
		return false;
	*ret = d.negative ? -(int64_t)whole : (int64_t)whole;
	if (unit->rounding == INPUT_ODD)
		*ret = part && !(whole & 1) ? d.negative ? *ret - 1 : *ret + 1 : *ret;
	else if (part >= (d.negative ? 3 : 2))
		*ret += d.negative ? -1 : 1;
	return true;
}
