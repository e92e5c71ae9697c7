/* Writing a segment: cells in, with index and header out. Internal. */
#ifndef GRID_SEGMENT_H
#define GRID_SEGMENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid.h"
#include "grid_cells.h"
#include "grid_disk.h"
#include "grid_file.h"

struct err;

enum { GRID_SEGMENT_LEVELS = 7 }; /* 185^7 cells are 2^52: no disk holds more */

struct grid_segment_level {
	uint16_t entries;
	struct disk_inner sum; /* of the entries of the page that is being filled */
	uint8_t *page;         /* DISK_PAGE bytes */
};

struct grid_segment {
	struct grid_file file; /* without a buffer */
	uint64_t at;           /* its end */
	struct disk_segment head;
	struct grid_segment_level level[GRID_SEGMENT_LEVELS];
	struct disk_total *totals; /* ascending by id */
	uint32_t ntotals, total;   /* total: the last one that was added to */
	struct disk_leaf cell;     /* that is being put */
};

/* Bytes of `memory` that writing takes. */
size_t grid_segment_bytes(void);
/* `ids`: all sources, ascending, n of them. `memory` is borrowed until finish or abort. */
int grid_segment_begin(struct grid_segment *, int dirfd, const char *name, const uint32_t *ids, uint32_t n, void *memory,
		       struct err *err);
/* The next blocks get their places and go into the index; their bytes are written by grid_cells_write, by whoever
 * and whenever, before grid_segment_finish. */
int grid_segment_put(struct grid_segment *, struct grid_cells *, struct err *err);
/* durable: on disk when this returns, name and all. */
int grid_segment_finish(struct grid_segment *, enum grid_durable, struct grid_segment_info *ret, struct err *err);
void grid_segment_abort(struct grid_segment *); /* does nothing after finish */

#endif
