/*
 * A source of cells in memory: points in one or more segments, tiled at random by aligned Morton ranges. As a grid
 * could be, and worse.
 */
#ifndef TILING_H
#define TILING_H

#include "cut_source.h"
#include "random.h"

enum { TILING_SEGMENTS = 4 };

struct tiling {
	struct point *pts[TILING_SEGMENTS]; /* sorted by point_compare */
	const bool *dead[TILING_SEGMENTS];  /* for each point: not live; NULL: all are live */
	size_t n[TILING_SEGMENTS];
	unsigned segments;
	size_t cell_records; /* cells are split above this */
	uint64_t salt;       /* of the random tiling: where cells end early, subtrees appear */
	uint64_t reads, read_points;
};

void tiling_source(struct tiling *, struct cut_source *ret);

#endif
