/* Lines, and the vertices of them that were kept: judged by exact arithmetic. */
#ifndef SIMPLIFIED_H
#define SIMPLIFIED_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* A line of n points; kept[k] is the index of point k of m that stayed. Coordinates are whole numbers below 2^52. */
struct simplified {
	int64_t (*at)[2];
	size_t *kept;
	size_t n, m;
	bool closed;
};
struct faults {
	size_t far;       /* points farther than the tolerance from the segment in their place */
	size_t met;       /* pairs of segments that meet, while what they replace does not */
	size_t collapsed; /* rings with fewer than three places that had more */
	size_t ends;      /* first or last points that did not stay */
};
struct faults simplified_faults(const struct simplified *, size_t lines, double tolerance);

#endif
