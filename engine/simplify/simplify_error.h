/*
 * How far a point is above or below the plane of a triangle, exact. From corner a: the area D = bx cy - by cx > 0, and for a
 * point s in the triangle U = sx cy - sy cx, V = bx sy - by sx; the plane is at (U bz + V cz) / D, so N = U bz + V cz - D sz is D
 * times the distance. In the triangle 0 <= U, V and U + V <= D, so |N| < 3 D 2^32 <= 3 * 2^96. D, U, V and N are of the triangle,
 * not of the order of its corners: N is the determinant of the four points.
 */
#ifndef SIMPLIFY_ERROR_H
#define SIMPLIFY_ERROR_H

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "geom.h"
#include "point.h"
#include "simplify_greedy.h"

struct simplify_plane {
	int64_t x, y, z; /* of a */
	int64_t bx, by, bz, cx, cy, cz;
	geom_i128 area;
	int64_t most; /* 64 bits suffice for a point in the triangle whose height differs from a's by at most this; -1: never */
};

static inline int64_t simplify_abs(int64_t v)
{
	return v < 0 ? -v : v;
}

static inline void simplify_plane_init(struct simplify_plane *q, const struct point *a, const struct point *b,
				       const struct point *c)
{
	int64_t high;

	q->x = a->x;
	q->y = a->y;
	q->z = a->z;
	q->bx = (int64_t)b->x - a->x;
	q->by = (int64_t)b->y - a->y;
	q->bz = (int64_t)b->z - a->z;
	q->cx = (int64_t)c->x - a->x;
	q->cy = (int64_t)c->y - a->y;
	q->cz = (int64_t)c->z - a->z;
	q->area = (geom_i128)q->bx * q->cy - (geom_i128)q->by * q->cx;
	q->most = -1;
	/* Products of two differences are within 2^61, and each of the three of N within D * high <= 2^61. */
	if (simplify_abs(q->bx) >> 30 || simplify_abs(q->by) >> 30 || simplify_abs(q->cx) >> 30 || simplify_abs(q->cy) >> 30)
		return;
	high = (INT64_C(1) << 61) >> (64 - __builtin_clzll((uint64_t)q->area));
	if (simplify_abs(q->bz) <= high && simplify_abs(q->cz) <= high)
		q->most = high;
}

/* |N| of a point in the triangle. */
static inline geom_u128 simplify_plane_far(const struct simplify_plane *q, int32_t x, int32_t y, int32_t z)
{
	int64_t sx = x - q->x, sy = y - q->y, sz = z - q->z;
	geom_i128 wide;

	if (__builtin_expect(simplify_abs(sz) <= q->most, 1)) {
		int64_t u = sx * q->cy - sy * q->cx, v = q->bx * sy - q->by * sx;

		return (uint64_t)simplify_abs(u * q->bz + v * q->cz - (int64_t)q->area * sz);
	}
	wide = ((geom_i128)sx * q->cy - (geom_i128)sy * q->cx) * q->bz + ((geom_i128)q->bx * sy - (geom_i128)q->by * sx) * q->cz -
	       q->area * sz;
	return (geom_u128)(wide < 0 ? -wide : wide);
}

/* Whether the point is farther than `error` >= 0. */
static inline bool simplify_plane_beyond(const struct simplify_plane *q, geom_u128 far, int64_t error)
{
	return far > (geom_u128)error * (geom_u128)q->area;
}

/* floor(|N| 2^16 / D). */
static inline uint64_t simplify_key_of(geom_u128 far, geom_i128 area)
{
	if (!(far >> (64 - SIMPLIFY_KEY_SHIFT)) && !(area >> 62))
		return ((uint64_t)far << SIMPLIFY_KEY_SHIFT) / (uint64_t)area;
	return (uint64_t)((far << SIMPLIFY_KEY_SHIFT) / (geom_u128)area);
}

static inline uint64_t simplify_plane_key(const struct simplify_plane *q, geom_u128 far)
{
	return simplify_key_of(far, q->area);
}

/* Notes the error of a triangle that stays. */
static inline void simplify_found_far(struct simplify_found *found, geom_u128 most, geom_i128 area, const uint64_t corner[3])
{
	enum { THOUSAND = 1000 };

	if (most * THOUSAND <= found->far * (geom_u128)area)
		return;
	found->far = (uint64_t)((most * THOUSAND + (geom_u128)area - 1) / (geom_u128)area);
	memcpy(found->corner, corner, sizeof found->corner);
}

#endif
