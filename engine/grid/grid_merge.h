/* Merging sorted inputs, runs and memory, into one sorted stream. Internal. */
#ifndef GRID_MERGE_H
#define GRID_MERGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid_run.h"
#include "point.h"

struct err;

enum { GRID_MERGE_INPUTS = 256 };

struct grid_merge_input {
	const struct point *at, *end;
	const uint32_t *table;    /* source index of a record -> source */
	uint64_t key;             /* of *at */
	bool done;
	struct grid_run_reader run; /* fd -1: from memory */
};

struct grid_merge {
	unsigned n;
	int tree[GRID_MERGE_INPUTS + 1]; /* 0: the winner; else the loser of that match */
	struct grid_merge_input input[GRID_MERGE_INPUTS + 1];
};

void grid_merge_init(struct grid_merge *);
/* Inputs, at most GRID_MERGE_INPUTS runs and one from memory. `buffer`: DISK_RUN_BLOCK_MAX bytes. */
int grid_merge_run(struct grid_merge *, int dirfd, const char *name, void *buffer, struct err *err);
void grid_merge_memory(struct grid_merge *, const struct point *pts, size_t n, const uint32_t *table);
void grid_merge_start(struct grid_merge *);
/* The next records, up to max, and their sources (ids may be NULL); *ret_n < max only at the end. */
int grid_merge_take(struct grid_merge *, struct point *pts, uint32_t *ids, size_t max, size_t *ret_n,
		    struct err *err);
void grid_merge_close(struct grid_merge *);

#endif
