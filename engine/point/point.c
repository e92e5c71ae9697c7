/*
 * Morton key and order of the point record (point.h). Coordinates are biased to unsigned numbers, so that the order of
 * keys is that of the quadtree from its root down.
 */
#include "point.h"

static inline uint32_t gather(uint64_t s)
{
	s &= UINT64_C(0x5555555555555555);
	s = (s | s >> 1) & UINT64_C(0x3333333333333333);
	s = (s | s >> 2) & UINT64_C(0x0f0f0f0f0f0f0f0f);
	s = (s | s >> 4) & UINT64_C(0x00ff00ff00ff00ff);
	s = (s | s >> 8) & UINT64_C(0x0000ffff0000ffff);
	return (uint32_t)(s | s >> 16);
}

void point_from_morton(uint64_t key, int32_t *ret_x, int32_t *ret_y)
{
	*ret_x = (int32_t)(gather(key >> 1) ^ 0x80000000u);
	*ret_y = (int32_t)(gather(key) ^ 0x80000000u);
}

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
