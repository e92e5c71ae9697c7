/* Slices: stretches of the key space, of runs and memory, that begin and end where cells do. Internal. */
#ifndef GRID_SLICES_H
#define GRID_SLICES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid.h"
#include "grid_run.h"
#include "point.h"

struct err;

struct grid_piece { /* sorted records in memory */
	struct point *pts;
	size_t n;
};

enum { GRID_SLICES = 1024 };

struct grid_slices {
	struct grid_run *run;
	uint64_t *from; /* of each run: the first block of the next slice */
	size_t nruns;
	struct grid_piece piece[GRID_LANES];
	unsigned npieces;
	uint64_t border[GRID_SLICES]; /* first keys of all slices but the first */
	size_t n, next;               /* slices; the next one */
	uint64_t records;
};

/* Decides where slices of about `target` records each begin; whole: there is only one. `memory` is used while it
 * does: the more, the more even are they. */
int grid_slices_plan(struct grid_slices *, size_t target, bool whole, void *memory, size_t bytes, struct err *err);

struct grid_slice {
	size_t number;
	uint64_t lo, hi;       /* its keys, both included */
	uint64_t *first, *end; /* of each run: blocks that may hold some of it */
};

/* The next slice; first and end are the caller's, nruns entries each. */
int grid_slices_next(struct grid_slices *, struct grid_slice *, struct err *err);

#endif
