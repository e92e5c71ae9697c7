/* Slices: intervals of keys that begin and end at borders of cells, so that threads can make cells independently. */
#ifndef GRID_SLICES_H
#define GRID_SLICES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid_run.h"
#include "grid_stage.h"
#include "point.h"

struct err;

struct grid_piece { /* sorted records in memory */
	struct point *pts;
	size_t n;
};

enum { GRID_SLICES = 1024 };

struct grid_slices {
	struct grid_run *run;
	uint64_t *from; /* for each run: the first block of the next slice */
	size_t nruns;
	struct grid_piece piece[GRID_LANES];
	unsigned npieces;
	uint64_t border[GRID_SLICES]; /* first keys of all slices but the first */
	size_t n, next;               /* number of slices; the next one */
	uint64_t records;
};

/* Chooses borders so that slices have about `target` records; whole: one slice only. `memory` is used during the call: more
 * memory makes the slices more equal. */
int grid_slices_plan(struct grid_slices *, size_t target, bool whole, void *memory, size_t bytes, struct err *err);

struct grid_slice {
	size_t number;
	uint64_t lo, hi;       /* its keys, both included */
	uint64_t *first, *end; /* for each run: the blocks that may contain records of it */
};

/* Returns the next slice; first and end are memory of the caller, nruns entries each. */
int grid_slices_next(struct grid_slices *, struct grid_slice *, struct err *err);

#endif
