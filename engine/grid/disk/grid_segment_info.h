/* What a manifest records about a segment file. */
#ifndef GRID_SEGMENT_INFO_H
#define GRID_SEGMENT_INFO_H

#include <stdint.h>

#include "digest.h"

enum { GRID_CELL_RECORDS = 1024 }; /* the most records in a cell, and in a block */

struct grid_segment_info {
	char file[64]; /* name in the folder */
	uint64_t points, cells, bytes;
	int32_t box[4];        /* min x, min y, max x, max y; meaningless if points == 0 */
	uint64_t classes[256]; /* points of each class */
	struct digest sum;     /* content sum of all records, without their sources (format.md) */
	/* No record has a key below or above these: the smallest and the largest key, or, from a manifest before version 8, the
	 * keys of the corners of the box. 0 if points == 0. */
	uint64_t lo, hi;
};

#endif
