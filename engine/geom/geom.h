/*
 * Exact signs on the integer lattice: orientation, in-circle with the tie order that makes the triangulation unique,
 * the side of a cut on which a circumcentre lies (docs/design/algorithm.md 1 to 3).
 *
 * Positions are int32_t[2] of the full range. Every sign is exact: nothing is rounded, nothing overflows. Only the lift
 * is perturbed (position p is lifted by x^2 + y^2 + eps, where eps grows with the lexicographic rank of p), so
 * collinear positions stay collinear.
 *
 * The inner functions take lifted heights relative to the reference vertex.
 */
#ifndef GEOM_H
#define GEOM_H

#include <stdbool.h>
#include <stdint.h>

__extension__ typedef __int128 geom_i128;
__extension__ typedef unsigned __int128 geom_u128;

static inline int geom_sign64(int64_t v)
{
	return (v > 0) - (v < 0);
}

static inline int geom_sign128(geom_i128 v)
{
	return (v > 0) - (v < 0);
}

/* Lexicographic order, x before y: the ranks of the perturbation. */
static inline bool geom_less(const int32_t a[2], const int32_t b[2])
{
	return a[0] < b[0] || (a[0] == b[0] && a[1] < b[1]);
}

/* Whether all four are in [-2^31, 2^31). */
static inline bool geom_fits31(int64_t a, int64_t b, int64_t c, int64_t d)
{
	uint64_t bias = UINT64_C(1) << 31;

	return !((((uint64_t)a + bias) | ((uint64_t)b + bias) | ((uint64_t)c + bias) | ((uint64_t)d + bias)) >> 32);
}

/* Twice the signed area of a, b, c: > 0 counter-clockwise, 0 collinear. |value| <= 2^64. */
static inline geom_i128 geom_area(const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	int64_t bx = (int64_t)b[0] - a[0], by = (int64_t)b[1] - a[1];
	int64_t cx = (int64_t)c[0] - a[0], cy = (int64_t)c[1] - a[1];

	return (geom_i128)bx * cy - (geom_i128)by * cx;
}

/* The sign of geom_area: 1 counter-clockwise, 0 collinear, -1 clockwise. */
static inline int geom_orient(const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	int64_t bx = (int64_t)b[0] - a[0], by = (int64_t)b[1] - a[1];
	int64_t cx = (int64_t)c[0] - a[0], cy = (int64_t)c[1] - a[1];

	/* Each product is within 2^62. They are compared and not subtracted, because 2^62 + 2^62 would overflow. */
	if (geom_fits31(bx, by, cx, cy)) {
		int64_t l = bx * cy, r = by * cx;

		return (l > r) - (l < r);
	}
	return geom_sign128((geom_i128)bx * cy - (geom_i128)by * cx);
}

/*
 * The in-circle determinant, modulo 2^128, from differences to the tested position d and lifted heights relative to it:
 * > 0 if d is below the plane through the lifted a, b, c (inside, for counter-clockwise a, b, c). Intermediate values
 * reach 2^131.6, so only the result has a valid sign; unweighted heights of full-range positions keep it below 2^127
 * (algorithm.md 2).
 */
static inline geom_i128 geom_lift_det(int64_t ax, int64_t ay, geom_u128 az, int64_t bx, int64_t by, geom_u128 bz, int64_t cx,
				      int64_t cy, geom_u128 cz)
{
	geom_u128 bc = (geom_u128)((geom_i128)bx * cy) - (geom_u128)((geom_i128)by * cx);
	geom_u128 ca = (geom_u128)((geom_i128)cx * ay) - (geom_u128)((geom_i128)cy * ax);
	geom_u128 ab = (geom_u128)((geom_i128)ax * by) - (geom_u128)((geom_i128)ay * bx);

	return (geom_i128)(az * bc + bz * ca + cz * ab);
}

/* x^2 + y^2 for |x|, |y| < 2^32. */
static inline geom_u128 geom_lift(int64_t x, int64_t y)
{
	return (geom_u128)((geom_i128)x * x) + (geom_u128)((geom_i128)y * y);
}

/* The unperturbed in-circle sign: 1 inside, 0 on the circle, -1 outside. a, b, c counter-clockwise. */
static inline int geom_incircle_plain(const int32_t a[2], const int32_t b[2], const int32_t c[2], const int32_t d[2])
{
	int64_t ax = (int64_t)a[0] - d[0], ay = (int64_t)a[1] - d[1];
	int64_t bx = (int64_t)b[0] - d[0], by = (int64_t)b[1] - d[1];
	int64_t cx = (int64_t)c[0] - d[0], cy = (int64_t)c[1] - d[1];
	uint64_t bits = (uint64_t)(ax + 32767) | (uint64_t)(ay + 32767) | (uint64_t)(bx + 32767) | (uint64_t)(by + 32767) |
			(uint64_t)(cx + 32767) | (uint64_t)(cy + 32767);

	/* All differences are in [-32767, 32768] and span at most 2^16 - 1, so the value is below 2^63. */
	if (bits < 65536) {
		uint64_t az = (uint64_t)(ax * ax + ay * ay), bz = (uint64_t)(bx * bx + by * by);
		uint64_t cz = (uint64_t)(cx * cx + cy * cy);

		return geom_sign64((int64_t)(az * (uint64_t)(bx * cy - by * cx) + bz * (uint64_t)(cx * ay - cy * ax) +
					     cz * (uint64_t)(ax * by - ay * bx)));
	}
	return geom_sign128(geom_lift_det(ax, ay, geom_lift(ax, ay), bx, by, geom_lift(bx, by), cx, cy, geom_lift(cx, cy)));
}

/* The result of geom_incircle if the unperturbed sign is 0: 1 inside, -1 outside. */
int geom_incircle_tie(const int32_t a[2], const int32_t b[2], const int32_t c[2], const int32_t d[2]);

/*
 * Whether d is inside the circle through a, b, c (counter-clockwise), ties broken by the lexicographic order: 1 inside,
 * -1 outside, never 0. The four positions are distinct, and a, b, c are not collinear.
 */
static inline int geom_incircle(const int32_t a[2], const int32_t b[2], const int32_t c[2], const int32_t d[2])
{
	int sign = geom_incircle_plain(a, b, c, d);

	return sign ? sign : geom_incircle_tie(a, b, c, d);
}

/*
 * The side of a cut on which the perturbed circumcentre of a, b, c (counter-clockwise) lies: 1 right of a vertical cut
 * or above a horizontal one, -1 left or below, never 0. c2: the doubled coordinate of the cut, odd, within +-2^34.
 */
int geom_cut_side(const int32_t a[2], const int32_t b[2], const int32_t c[2], int64_t c2, bool vertical);
/* The result if the circumcentre is exactly on the cut. */
int geom_cut_tie(const int32_t a[2], const int32_t b[2], const int32_t c[2], bool vertical);

/*
 * The inner function: N of algorithm.md 3, which is the circumcentre minus the cut, times a positive number. From b and
 * c relative to a, and their heights relative to a's. `at`: a's coordinate across the cut; bv, cv: the differences
 * along it; area: geom_area(a, b, c). Exact for heights within 2^90.
 */
static inline geom_i128 geom_cut_value(int32_t at, int64_t bv, geom_i128 bz, int64_t cv, geom_i128 cz, geom_i128 area, int64_t c2,
				       bool vertical)
{
	geom_i128 tilt = bz * cv - cz * bv;

	return (vertical ? tilt : -tilt) + area * (2 * (int64_t)at - c2);
}

#endif
