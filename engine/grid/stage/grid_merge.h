/* Merging sorted inputs (blocks of runs, arrays, other streams) into one sorted stream. */
#ifndef GRID_MERGE_H
#define GRID_MERGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid_run.h"
#include "point.h"

struct err;

enum { GRID_MERGE_INPUTS = 512 };

/* Records from key `lo` to key `hi`, both included. */
struct grid_merge_input {
	const struct point *at, *end;
	const uint32_t *table; /* source of a record by its source index */
	uint64_t lo, hi;
	uint64_t key; /* of the record behind `at`, if there is one before `end` */
	bool done;
	struct grid_run_reader run; /* a run; run.run is NULL for the other kinds of input */
	/* A stream: returns the next sorted records and their table, valid until the next call; *ret_n = 0 at the end. */
	int (*next)(void *ctx, const struct point **ret_pts, size_t *ret_n, const uint32_t **ret_table, struct err *err);
	void *ctx;
	uint64_t *seen; /* counts the records read from the run; may be NULL */
};

struct grid_merge_node {
	uint64_t key; /* of the input's next record; the largest key at its end */
	int input;
};

struct grid_merge {
	unsigned n, cap;
	unsigned leaves;              /* of the tree; those from n on have no input */
	unsigned wins;                /* how often the same input has won in a row */
	struct grid_merge_node *tree; /* 0: the winner; the others: the loser of that match */
	struct grid_merge_input *input;
};

/* Bytes of memory, aligned to 16, for that many inputs. */
size_t grid_merge_bytes(unsigned inputs);
void grid_merge_init(struct grid_merge *, unsigned inputs, void *memory);
/* Add an input: a run, an array, a stream. An input without records in lo..hi is omitted. */
int grid_merge_run(struct grid_merge *, const struct grid_run_reader *, uint64_t lo, uint64_t hi, uint64_t *seen,
		   struct err *err);
void grid_merge_memory(struct grid_merge *, const struct point *pts, size_t n, const uint32_t *table, uint64_t lo, uint64_t hi);
int grid_merge_stream(struct grid_merge *,
		      int (*next)(void *ctx, const struct point **ret_pts, size_t *ret_n, const uint32_t **ret_table,
				  struct err *err),
		      void *ctx, struct err *err);
void grid_merge_start(struct grid_merge *);
/* Takes the next records, up to max, and their sources (ids may be NULL); *ret_n < max only at the end. */
int grid_merge_take(struct grid_merge *, struct point *pts, uint32_t *ids, size_t max, size_t *ret_n, struct err *err);

#endif
