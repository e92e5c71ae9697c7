/* Writing a segment: sorted records in, cells, index, header out. Internal. */
#ifndef GRID_SEGMENT_H
#define GRID_SEGMENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid.h"
#include "grid_disk.h"
#include "grid_file.h"

struct err;

enum { GRID_SEGMENT_LEVELS = 7 }; /* 185^7 cells are 2^52: no disk holds more */

struct grid_segment_level {
	uint16_t entries;
	struct disk_inner sum;    /* of the entries of the page that is being filled */
	uint8_t *page;            /* DISK_PAGE bytes */
};

struct grid_segment {
	struct grid_file file;
	struct disk_segment head;
	struct grid_segment_level level[GRID_SEGMENT_LEVELS];
	struct disk_total *totals; /* ascending by id */
	uint32_t ntotals;
	struct disk_leaf cell;    /* of the cell that is being written */
	bool has_prev, cell_open;
	uint64_t prev;            /* key of the last record taken */
};

/* Bytes of `memory` that writing takes, with a file buffer of `buffer` bytes. */
size_t grid_segment_bytes(size_t buffer);
/* `ids`: all sources, ascending, n of them. `memory` is borrowed until finish or abort. */
int grid_segment_begin(struct grid_segment *, int dirfd, const char *name, const uint32_t *ids, uint32_t n,
		       void *memory, size_t buffer, struct err *err);
/*
 * Sorted records that follow the ones taken so far; their sources as in grid_block_make. Takes as many as
 * make whole cells, all of them if it is the `end`; else it leaves at most GRID_CELL_RECORDS, to be
 * offered again with those that follow.
 */
int grid_segment_add(struct grid_segment *, const struct point *pts, const uint32_t *ids,
		     const uint32_t *table, size_t n, bool end, size_t *ret_taken, struct err *err);
int grid_segment_finish(struct grid_segment *, struct grid_segment_info *ret, struct err *err);
void grid_segment_abort(struct grid_segment *); /* does nothing after finish */

#endif
