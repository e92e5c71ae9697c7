/* One pass over all records of a segment, in order, with their sources. Internal. */
#ifndef GRID_PASS_H
#define GRID_PASS_H

#include "grid_read.h"

/* Some sources whose records are left out; ascending. */
struct grid_dropped {
	const uint32_t *ids;
	size_t n;
};

bool grid_dropped_has(const struct grid_dropped *, uint32_t id);

struct grid_pass {
	struct grid_part part;
	const struct grid_dropped *dropped;
	uint8_t *pages;           /* DISK_PAGE a level */
	unsigned at[DISK_LEVELS]; /* of each level: the next entry */
	bool begun;
	struct disk_leaf leaf; /* the cell that is being read */
	uint32_t block;        /* its next */
	uint64_t place, check;
	uint8_t *window; /* bytes of the file from `from` on */
	size_t cap, have;
	uint64_t from;
	uint32_t *ids; /* GRID_CELL_RECORDS: of the block */
	uint64_t points, cells, left_out;
	uint64_t expected; /* records, as the header says */
};

/* Bytes of memory, aligned to 64, for a segment with that many cells and a window of so many bytes. */
size_t grid_pass_bytes(uint64_t cells, size_t window);
enum { GRID_PASS_WINDOW = 48 << 10 }; /* the least */
_Static_assert(GRID_PASS_WINDOW >= DISK_BLOCK_MAX, "a block must fit");

/* Opens the segment; `memory` is borrowed, as is `info`. *ret_sources: its table, to be freed. */
int grid_pass_open(struct grid_pass *, int dirfd, const struct grid_segment_info *info, const struct grid_dropped *, void *memory,
		   size_t window, struct disk_total **ret_sources, uint32_t *ret_n, struct err *err);
void grid_pass_close(struct grid_pass *);
/* As grid_merge_other wants it: a block's records that stay. At the end all that the header says was there. */
int grid_pass_next(void *pass, const struct point **ret_pts, size_t *ret_n, const uint32_t **ret_table, struct err *err);

#endif
