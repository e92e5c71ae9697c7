/* Where some triangles are, as the ranges of keys of the squares that they touch. Internal. */
#ifndef SIMPLIFY_RASTER_H
#define SIMPLIFY_RASTER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { SIMPLIFY_RASTER = 64 }; /* squares on each axis: a row is the bits of a number */

struct simplify_range {
	uint64_t lo, hi;
};

struct simplify_raster {
	uint32_t low[2]; /* number of the first square on each axis */
	unsigned shift;  /* a square has 2^shift positions on each axis */
	uint64_t row[SIMPLIFY_RASTER];
	struct simplify_range range[SIMPLIFY_RASTER * SIMPLIFY_RASTER];
};

/* Empty; `box` contains all triangles to come (min x, min y, max x, max y). At most `most` squares on each axis, not more than
 * SIMPLIFY_RASTER. */
void simplify_raster_init(struct simplify_raster *, const int32_t box[4], uint32_t most);
/* Marks the squares that a box meets; it may leave that of the raster. */
void simplify_raster_square(struct simplify_raster *, const int32_t box[4]);
/* Marks at least the squares that the closed triangle meets. */
void simplify_raster_mark(struct simplify_raster *, const int32_t a[2], const int32_t b[2], const int32_t c[2]);
/* Marks at least the squares of the raster that the closed segment meets; it may leave the box. */
void simplify_raster_line(struct simplify_raster *, const int32_t a[2], const int32_t b[2]);
/* Whether a marked square meets this box, which is within the raster's. */
bool simplify_raster_meets(const struct simplify_raster *, const int32_t box[4]);
/* The keys of the marked squares: ranges, ascending, not adjacent; returns how many. */
size_t simplify_raster_ranges(struct simplify_raster *);

#endif
