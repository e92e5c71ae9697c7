/* Sorted runs: files of sorted records, in blocks of equal size, each with its own table of sources. */
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
/* Adds n sorted records; sources as in grid_block_make. Takes only full blocks of them, or all at the `end`. */
int grid_run_add(struct grid_run_writer *, const struct point *pts, const uint32_t *ids, const uint32_t *table, size_t n,
		 bool end, size_t *ret_taken, struct err *err);
int grid_run_finish(struct grid_run_writer *, bool durable, uint64_t *ret_records, struct err *err);
void grid_run_abort(struct grid_run_writer *);

/* ---- an open run; any number of threads may read it ---- */

struct grid_run {
	int fd;
	char name[GRID_NAME_MAX];
	uint64_t records, blocks;
};

#define GRID_RUN_INIT ((struct grid_run){.fd = -1})

/* consumed: opens it for writing, too, so that the caller can punch holes into it. */
int grid_run_open(struct grid_run *, int dirfd, const char *name, bool consumed, struct err *err);
void grid_run_close(struct grid_run *);
/* Key of the first record of a block. Reads only that record, without its checksum: good enough for a search. */
int grid_run_key(const struct grid_run *, uint64_t block, uint64_t *ret_key, struct err *err);
/* The first block from `from` on whose first key is not less than `key`; r->blocks if there is none. */
int grid_run_find(const struct grid_run *, uint64_t from, uint64_t key, uint64_t *ret_block, struct err *err);
/* Sets the error: -ERR_CORRUPT, with place and fault. */
int grid_run_damaged(const struct grid_run *, uint64_t place, const char *what, struct err *err);

/* ---- reading a range of blocks ---- */

struct grid_run_reader {
	const struct grid_run *run;
	uint64_t next, end;     /* blocks to read */
	uint8_t *buf;           /* room for `cap` blocks */
	unsigned cap, have, at; /* blocks in the buffer; the next of them */
};

/* `buffer`: cap >= 1 blocks of DISK_RUN_BLOCK bytes, aligned to 16, borrowed. */
void grid_run_read(struct grid_run_reader *, const struct grid_run *, uint64_t first, uint64_t end, void *buffer, unsigned cap);
/* Records and table of sources of the next block, in the buffer; *ret_n = 0 at the end. */
int grid_run_next(struct grid_run_reader *, const struct point **ret_pts, size_t *ret_n, const uint32_t **ret_ids,
		  struct err *err);

#endif
