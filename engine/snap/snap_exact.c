/*
 * Crossings and pixels of segments, exact for all lattice positions: signs of integers, and one rounding of a fraction
 * (docs/design/constraints.md, "Snap rounding", has the widths).
 */
#include "geom.h"
#include "snap_priv.h"

bool snap_cross(const struct snap_segment *s, const struct snap_segment *t, int32_t ret[2])
{
	if (geom_orient(s->a, s->b, t->a) * geom_orient(s->a, s->b, t->b) >= 0 ||
	    geom_orient(t->a, t->b, s->a) * geom_orient(t->a, t->b, s->b) >= 0)
		return false;
	ret[0] = snap_cross_height(s, s->a[0], s->b[0], t);
	ret[1] = snap_cross_height(s, s->a[1], s->b[1], t);
	return true;
}

/* The greatest integer of at most n / d, d > 0. */
static geom_i128 floor_div(geom_i128 n, geom_i128 d)
{
	return n / d - (n % d < 0);
}

/* za + (zb - za) n / d, where n / d is the part of the line before the crossing; halves are rounded up. */
int32_t snap_cross_height(const struct snap_segment *s, int32_t za, int32_t zb, const struct snap_segment *other)
{
	int64_t dx = (int64_t)s->b[0] - s->a[0], dy = (int64_t)s->b[1] - s->a[1];
	int64_t ex = (int64_t)other->b[0] - other->a[0], ey = (int64_t)other->b[1] - other->a[1];
	int64_t fx = (int64_t)other->a[0] - s->a[0], fy = (int64_t)other->a[1] - s->a[1];
	geom_i128 d = (geom_i128)dx * ey - (geom_i128)dy * ex, n = (geom_i128)fx * ey - (geom_i128)fy * ex;

	if (d < 0) {
		d = -d;
		n = -n;
	}
	return (int32_t)(za + floor_div(2 * n * ((int64_t)zb - za) + d, 2 * d));
}

/* The part of a segment, from 0 to 1, as fractions with positive denominators; an open end does not belong to it. */
struct part {
	geom_i128 from, from_of, to, to_of;
	bool from_open, to_open;
};

/* Cuts the part to where low <= a + t d < high. False: nothing is left. */
static bool part_cut(struct part *p, int64_t a, int64_t d, int64_t low, int64_t high)
{
	geom_i128 enter = low - a, leave = high - a, more;
	bool enter_open = false, leave_open = true;

	if (d == 0)
		return low <= a && a < high;
	if (d < 0) {
		d = -d;
		enter = (geom_i128)a - high;
		leave = (geom_i128)a - low;
		enter_open = true;
		leave_open = false;
	}
	more = enter * p->from_of - p->from * d;
	if (more > 0 || (more == 0 && enter_open)) {
		p->from = enter;
		p->from_of = d;
		p->from_open = enter_open;
	}
	more = leave * p->to_of - p->to * d;
	if (more < 0 || (more == 0 && leave_open)) {
		p->to = leave;
		p->to_of = d;
		p->to_open = leave_open;
	}
	return true;
}

/* In doubled numbers, so that the sides of the pixel are integers. */
bool snap_meet_pixel(const struct snap_segment *s, const int32_t at[2])
{
	struct part p = {.from = 0, .from_of = 1, .to = 1, .to_of = 1};
	geom_i128 rest;

	for (unsigned k = 0; k < 2; k++)
		if (!part_cut(&p, 2 * (int64_t)s->a[k], 2 * ((int64_t)s->b[k] - s->a[k]), 2 * (int64_t)at[k] - 1,
			      2 * (int64_t)at[k] + 1))
			return false;
	rest = p.to * p.from_of - p.from * p.to_of;
	return rest > 0 || (rest == 0 && !p.from_open && !p.to_open);
}
