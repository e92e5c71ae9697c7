/* One pass over the records of a segment, all or those of a range of keys, in order, with their sources. */
#ifndef GRID_PASS_H
#define GRID_PASS_H

#include "grid_block.h"
#include "grid_segment.h"

/* Sources whose records are omitted; ascending. */
struct grid_dropped {
	const uint32_t *ids;
	size_t n;
};

bool grid_dropped_has(const struct grid_dropped *, uint32_t id);

/* Keys, both included. */
struct grid_range {
	uint64_t lo, hi;
};

struct grid_pass {
	struct grid_segment segment;
	const struct grid_dropped *dropped;
	struct grid_range range;
	bool part;                /* the range is not that of all keys */
	uint8_t *pages;           /* one for each level */
	unsigned at[DISK_LEVELS]; /* next entry of each page */
	bool begun;
	struct disk_leaf leaf; /* the cell that is being read */
	uint32_t block;        /* its next block */
	uint64_t place, check;
	uint8_t *window; /* `have` bytes of the file from `from` on */
	size_t cap, have;
	uint64_t from;
	uint32_t *ids; /* GRID_CELL_RECORDS: sources of the block */
	uint64_t points, cells, omitted;
	uint64_t expected; /* records, according to the header */
};

/* Bytes of memory, aligned to 64, for a segment with that many cells and a window of that size. */
size_t grid_pass_bytes(uint64_t cells, size_t window);
enum { GRID_PASS_WINDOW = 48 << 10 }; /* the smallest window */
_Static_assert(GRID_PASS_WINDOW >= DISK_BLOCK_MAX, "a block must fit");

/* Opens the segment; `memory` and `info` are borrowed. `range`: NULL: all keys. *ret_sources: its table of sources, to be freed.
 */
int grid_pass_open(struct grid_pass *, int dirfd, const struct grid_segment_info *info, const struct grid_dropped *,
		   const struct grid_range *range, void *memory, size_t window, struct disk_total **ret_sources, uint32_t *ret_n,
		   struct err *err);
void grid_pass_close(struct grid_pass *);
/* The next cell, which is in pass->leaf; its records are read by grid_pass_next alone, not by those who call this. */
int grid_pass_cell(struct grid_pass *, bool *ret_end, struct err *err);
/* For grid_merge_stream: the records of the next block that are not omitted. At the end of a pass over all keys it checks the
 * number of records and cells against the header. */
int grid_pass_next(void *pass, const struct point **ret_pts, size_t *ret_n, const uint32_t **ret_table, struct err *err);

#endif
