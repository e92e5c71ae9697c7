/* Sorted runs: files of sorted records, in blocks with a table of sources each. Internal. */
#ifndef GRID_RUN_H
#define GRID_RUN_H

#include <stddef.h>
#include <stdint.h>

#include "grid_disk.h"
#include "grid_file.h"
#include "point.h"

struct err;

/* ---- writing ---- */

struct grid_run_writer {
	struct grid_file file;
	uint64_t records, blocks;
};

/* `buffer` of `cap` >= DISK_RUN_BLOCK_MAX bytes. */
int grid_run_begin(struct grid_run_writer *, int dirfd, const char *name, void *buffer, size_t cap,
		   struct err *err);
/* n sorted records, as one or more blocks; sources as in grid_block_make. */
int grid_run_add(struct grid_run_writer *, const struct point *pts, const uint32_t *ids,
		 const uint32_t *table, size_t n, struct err *err);
int grid_run_finish(struct grid_run_writer *, bool durable, uint64_t *ret_records, struct err *err);
void grid_run_abort(struct grid_run_writer *);

/* ---- reading ---- */

struct grid_run_reader {
	int fd;
	char name[GRID_NAME_MAX];
	uint64_t at, bytes;       /* of the next block, of the file */
	uint64_t records, seen;
	size_t hint;              /* size of the last block */
	uint8_t *buf;
};

#define GRID_RUN_READER_INIT ((struct grid_run_reader){ .fd = -1 })

/* `buffer`: DISK_RUN_BLOCK_MAX bytes, aligned to 16, borrowed. */
int grid_run_open(struct grid_run_reader *, int dirfd, const char *name, void *buffer, struct err *err);
/* The next block's records and table of sources, in the buffer; *ret_n = 0 at the end. */
int grid_run_next(struct grid_run_reader *, const struct point **ret_pts, size_t *ret_n,
		  const uint32_t **ret_ids, struct err *err);
void grid_run_close(struct grid_run_reader *);

#endif
