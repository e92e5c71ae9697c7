/*
 * Orders of points inside the room, and a sort without extra memory.
 */
#ifndef CUT_ORDER_H
#define CUT_ORDER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "point.h"

/* Whether position (ax, ay) is before (bx, by) by Morton key, without computing the keys. */
static inline bool cut_order_before(int32_t ax, int32_t ay, int32_t bx, int32_t by)
{
	uint32_t dx = (uint32_t)ax ^ (uint32_t)bx, dy = (uint32_t)ay ^ (uint32_t)by;

	/* The coordinate that differs in a higher bit decides; x if it is the same bit. */
	if (dx < dy && dx < (dx ^ dy))
		return ay < by;
	return ax < bx;
}

typedef bool (*cut_less_fn)(const void *ctx, const struct point *a, const struct point *b);

/* Sorts n points by `less`, in place, n log n in the worst case, not stable. */
void cut_order_sort(struct point *pts, size_t n, cut_less_fn less, const void *ctx);

#endif
