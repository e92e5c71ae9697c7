/* Sorted runs: files of sorted records, in blocks of one size with a table of sources each. Internal. */
#ifndef GRID_RUN_H
#define GRID_RUN_H

#include <stdbool.h>
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

/* `buffer` of `cap` >= DISK_RUN_BLOCK bytes, aligned to 16. */
int grid_run_begin(struct grid_run_writer *, int dirfd, const char *name, void *buffer, size_t cap, struct err *err);
/* n sorted records; sources as in grid_block_make. Takes as many as make whole blocks, all of them if it is the
 * `end`. */
int grid_run_add(struct grid_run_writer *, const struct point *pts, const uint32_t *ids, const uint32_t *table, size_t n,
		 bool end, size_t *ret_taken, struct err *err);
int grid_run_finish(struct grid_run_writer *, bool durable, uint64_t *ret_records, struct err *err);
void grid_run_abort(struct grid_run_writer *);

/* ---- an open run, which any number of threads may read ---- */

struct grid_run {
	int fd;
	char name[GRID_NAME_MAX];
	uint64_t records, blocks;
};

#define GRID_RUN_INIT ((struct grid_run){.fd = -1})

/* consumed: its descriptor will do to give blocks back to the disk. */
int grid_run_open(struct grid_run *, int dirfd, const char *name, bool consumed, struct err *err);
void grid_run_close(struct grid_run *);
/* Key of the first record of a block, not checked: for looking where to read. */
int grid_run_key(const struct grid_run *, uint64_t block, uint64_t *ret_key, struct err *err);
/* The first block from `from` on whose first key is not less than `key`; all blocks: there is none. */
int grid_run_find(const struct grid_run *, uint64_t from, uint64_t key, uint64_t *ret_block, struct err *err);
/* -ERR_CORRUPT */
int grid_run_damaged(const struct grid_run *, uint64_t place, const char *what, struct err *err);

/* ---- reading some of its blocks, one after the other ---- */

struct grid_run_reader {
	const struct grid_run *run;
	uint64_t next, end;     /* blocks to read */
	uint8_t *buf;           /* room for `cap` blocks */
	unsigned cap, have, at; /* of those in the buffer, the next */
};

/* `buffer`: cap >= 1 times DISK_RUN_BLOCK bytes, aligned to 16, borrowed. */
void grid_run_read(struct grid_run_reader *, const struct grid_run *, uint64_t first, uint64_t end, void *buffer, unsigned cap);
/* The next block's records and table of sources, in the buffer; *ret_n = 0 at the end. */
int grid_run_next(struct grid_run_reader *, const struct point **ret_pts, size_t *ret_n, const uint32_t **ret_ids,
		  struct err *err);

#endif
