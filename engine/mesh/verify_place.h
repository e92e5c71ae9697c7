/* The verifier's own exact signs, and the report of faults. Internal. */
#ifndef VERIFY_PLACE_H
#define VERIFY_PLACE_H

#include "verify.h"

/* Twice the area of a, b, c, counter-clockwise positive. |value| <= 2^65. */
static inline __int128 verify_area(const int32_t *a, const int32_t *b, const int32_t *c)
{
	int64_t bx = (int64_t)b[0] - a[0], by = (int64_t)b[1] - a[1];
	int64_t cx = (int64_t)c[0] - a[0], cy = (int64_t)c[1] - a[1];

	return (__int128)bx * cy - (__int128)by * cx;
}

/* Records a fault, unless there already is one. */
void verify_fault_set(struct verify_report *, enum verify_fault, const int32_t *place, const char *fmt, ...)
	__attribute__((format(printf, 4, 5)));

#endif
