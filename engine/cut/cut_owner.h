/*
 * The owner test of cut.h for many triangles of one region. A few products decide for triangles whose circumcentre is
 * certainly inside; the exact test decides for all others.
 */
#ifndef CUT_OWNER_H
#define CUT_OWNER_H

#include "cut.h"

struct cut_owner {
	const struct cut_region *region;
	double low[2], high[2]; /* doubled borders; infinite sides are so far that they are never the nearest */
};

void cut_owner_init(struct cut_owner *, const struct cut_region *);

/*
 * The circumradius is l1 l2 l3 / (2 area), where area is twice the triangle's. If that is less than the distance from a
 * to the nearest border, half of d, the circumcentre is inside. The test compares the squares of l1 l2 l3 and of area *
 * d. Differences are exact. The error of area is at most 4u l^2, where l is the longest side and u = 2^-53; d is at
 * most 2^37 and l^2 <= 2 l1 l2 l3 (sides have at least length 1), so the error of area * d is less than 2^-13 l1 l2 l3.
 * The rest has about a dozen roundings. The 1 % between the two sides of the comparison (half of it before squaring) is
 * far more.
 */
static inline bool cut_owner_has(const struct cut_owner *o, const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	double ax = a[0], ay = a[1];
	double bx = b[0] - ax, by = b[1] - ay, cx = c[0] - ax, cy = c[1] - ay, ex = cx - bx, ey = cy - by;
	double area = bx * cy - by * cx;
	double x0 = 2 * ax - o->low[0], x1 = o->high[0] - 2 * ax, y0 = 2 * ay - o->low[1], y1 = o->high[1] - 2 * ay;
	double dx = x0 < x1 ? x0 : x1, dy = y0 < y1 ? y0 : y1, d = dx < dy ? dx : dy;
	double sides = (bx * bx + by * by) * (cx * cx + cy * cy) * (ex * ex + ey * ey), reach = area * d;

	if (__builtin_expect(d > 0 && sides * 1.01 < reach * reach, 1))
		return true;
	return cut_region_owns(o->region, a, b, c);
}

#endif
