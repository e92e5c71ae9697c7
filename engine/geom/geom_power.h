/*
 * Exact signs for positions with weights (docs/design/weights.md): position p is lifted to x^2 + y^2 - w + eps, with the eps of
 * geom.h. A weight is a square, from 0 to GEOM_WEIGHT_MOST. All results are those of geom.h if the weights are equal.
 */
#ifndef GEOM_POWER_H
#define GEOM_POWER_H

#include "geom.h"

#define GEOM_RADIUS_MOST (INT64_C(1) << 30)
#define GEOM_WEIGHT_MOST (GEOM_RADIUS_MOST * GEOM_RADIUS_MOST)

/* A position and its weight. */
struct geom_weighted {
	const int32_t *at;
	int64_t w;
};

/*
 * The sign of the in-circle determinant for heights relative to the tested position, within 2^66. Products reach 2^131. So
 * heights are divided at 32 bits: az = ah 2^32 + al, with al in [0, 2^32). The areas are below 2^65, so the sum of the high parts
 * is below 2^101, and that of the low parts below 2^99.
 */
static inline int geom_power_det(int64_t ax, int64_t ay, geom_i128 az, int64_t bx, int64_t by, geom_i128 bz, int64_t cx,
				 int64_t cy, geom_i128 cz)
{
	const geom_i128 mask = UINT32_MAX;
	geom_i128 bc = (geom_i128)bx * cy - (geom_i128)by * cx, ca = (geom_i128)cx * ay - (geom_i128)cy * ax;
	geom_i128 ab = (geom_i128)ax * by - (geom_i128)ay * bx;
	geom_i128 high = (az >> 32) * bc + (bz >> 32) * ca + (cz >> 32) * ab;
	geom_i128 low = (az & mask) * bc + (bz & mask) * ca + (cz & mask) * ab;

	high += low >> 32;
	return high ? geom_sign128(high) : geom_sign128(low & mask);
}

/* The height of a position at (x, y) from the origin, with this difference of weights. */
static inline geom_i128 geom_power_lift(int64_t x, int64_t y, int64_t less)
{
	return (geom_i128)geom_lift(x, y) - less;
}

/*
 * Whether d is below the plane through the lifted a, b, c (counter-clockwise): then the triangle is not in the regular
 * triangulation of the four. 1 below, -1 above, never 0. The four positions are distinct.
 */
int geom_power(struct geom_weighted a, struct geom_weighted b, struct geom_weighted c, struct geom_weighted d);
/* The same for three positions on one line: whether p is below the line through the lifted a and b. */
int geom_power_line(struct geom_weighted a, struct geom_weighted b, struct geom_weighted p);
/* As geom_cut_side, for the point of equal power to a, b and c: the centre of the circle that is orthogonal to theirs. */
int geom_power_side(struct geom_weighted a, struct geom_weighted b, struct geom_weighted c, int64_t c2, bool vertical);

#endif
