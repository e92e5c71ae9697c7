/* The circle of a triangle. Internal. */
#ifndef SIMPLIFY_CIRCLE_H
#define SIMPLIFY_CIRCLE_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#include "geom.h"

struct simplify_circle {
	double x, y, r;
};

/* The circle through a, b, c (counter-clockwise), a position larger. From corner a the centre is (u, v) / 2 D. u, v and D are
 * exact, within 2^99 and 2^66, so below a radius of 2^34 rounding is far less than a position. */
static inline struct simplify_circle simplify_circle_of(const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	int64_t bx = (int64_t)b[0] - a[0], by = (int64_t)b[1] - a[1], cx = (int64_t)c[0] - a[0], cy = (int64_t)c[1] - a[1];
	geom_i128 bb = (geom_i128)geom_lift(bx, by), cc = (geom_i128)geom_lift(cx, cy);
	double d = 2 * (double)((geom_i128)bx * cy - (geom_i128)by * cx), u = (double)(bb * cy - cc * by) / d,
	       v = (double)(cc * bx - bb * cx) / d;

	return (struct simplify_circle){a[0] + u, a[1] + v, sqrt(u * u + v * v) + 1};
}

/* Whether it is within a box: min x, min y, max x, max y. */
static inline bool simplify_circle_within(const struct simplify_circle *c, const int32_t box[4])
{
	return c->x - c->r >= box[0] && c->y - c->r >= box[1] && c->x + c->r <= box[2] && c->y + c->r <= box[3];
}

#endif
