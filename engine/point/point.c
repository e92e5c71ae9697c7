/*
 * Morton key and order of the point record (point.h). Coordinates are biased to unsigned numbers, so that the order of
 * keys is that of the quadtree from its root down.
 */
#include "point.h"

static int order(uint64_t a, uint64_t b)
{
	return (a > b) - (a < b);
}

int point_compare(const struct point *a, const struct point *b)
{
	uint64_t ka = point_morton(a->x, a->y), kb = point_morton(b->x, b->y);

	if (ka != kb)
		return order(ka, kb);
	if (a->z != b->z)
		return a->z < b->z ? -1 : 1;
	if (a->cls != b->cls)
		return order(a->cls, b->cls);
	if (a->ret != b->ret)
		return order(a->ret, b->ret);
	if (point_flags(a) != point_flags(b))
		return order(point_flags(a), point_flags(b));
	return order(point_source(a), point_source(b));
}
