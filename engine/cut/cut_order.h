/*
 * Orders of points inside the room, and the one sort that needs no memory.
 */
#ifndef CUT_ORDER_H
#define CUT_ORDER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "point.h"

/* Whether position (ax, ay) comes before (bx, by) by Morton key, without making the keys. */
static inline bool cut_order_before(int32_t ax, int32_t ay, int32_t bx, int32_t by)
{
	uint32_t dx = (uint32_t)ax ^ (uint32_t)bx, dy = (uint32_t)ay ^ (uint32_t)by;

	/* The highest bit in which they differ decides; of equal bits x stands above y. */
	if (dx < dy && dx < (dx ^ dy))
		return ay < by;
	return ax < bx;
}

typedef bool (*cut_less_fn)(const void *ctx, const struct point *a, const struct point *b);

/* Sort n points by `less`, in place, n log n at worst, not stable. */
void cut_order_sort(struct point *pts, size_t n, cut_less_fn less, const void *ctx);

#endif
