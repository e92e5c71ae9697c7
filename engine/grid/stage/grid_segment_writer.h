/* Writing a segment: takes cells, adds index and header. */
#ifndef GRID_SEGMENT_WRITER_H
#define GRID_SEGMENT_WRITER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid_cells.h"
#include "grid_disk.h"
#include "grid_file.h"

struct err;

enum { GRID_SEGMENT_WRITER_LEVELS = 7 }; /* enough for 185^7 > 2^52 cells */

struct grid_segment_writer_level {
	uint16_t entries;
	struct disk_inner sum; /* of the entries of the page that is being filled */
	uint8_t *page;         /* DISK_PAGE bytes */
};

struct grid_segment_writer {
	struct grid_file file; /* without a buffer */
	uint64_t at;           /* end of the file */
	struct disk_segment head;
	struct grid_segment_writer_level level[GRID_SEGMENT_WRITER_LEVELS];
	struct disk_total *totals;    /* ascending by id */
	uint32_t ntotals, total;      /* total: the last one that was updated */
	struct disk_leaf cell;        /* the cell whose blocks are being put */
	uint64_t first_key, last_key; /* of all records so far */
};

/* Bytes of `memory`. */
size_t grid_segment_writer_bytes(void);
/* `ids`: all sources, ascending, n of them. `memory` is borrowed until finish or abort. */
int grid_segment_writer_begin(struct grid_segment_writer *, int dirfd, const char *name, const uint32_t *ids, uint32_t n,
			      void *memory, struct err *err);
/* Assigns places to the next blocks and adds them to the index. Their bytes are written by grid_cells_write, by any thread, at
 * any time before grid_segment_writer_finish. */
int grid_segment_writer_put(struct grid_segment_writer *, struct grid_cells *, struct err *err);
/* Writes index, table of sources and header, and publishes the file. */
int grid_segment_writer_finish(struct grid_segment_writer *, enum grid_durability, struct grid_segment_info *ret,
			       struct err *err);
void grid_segment_writer_abort(struct grid_segment_writer *); /* does nothing after finish */

#endif
