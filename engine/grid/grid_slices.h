/* Slices: stretches of the key space, of runs and memory, that begin and end where cells do. Internal. */
#ifndef GRID_SLICES_H
#define GRID_SLICES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid_run.h"
#include "point.h"

struct err;

struct grid_piece {               /* sorted records in memory */
	struct point *pts;
	size_t n;
};

struct grid_slices {
	struct grid_run *run;
	uint64_t *from;           /* of each run: the first block of the next slice */
	size_t nruns;
	struct grid_piece piece[64];
	unsigned npieces;
	uint64_t *border;         /* first keys of all slices but the first */
	size_t n, next;           /* slices; the next one */
	uint64_t records;
};

/* Decides where slices of about `target` records each begin. whole: there is only one. */
int grid_slices_plan(struct grid_slices *, size_t target, bool whole, struct err *err);

struct grid_slice {
	size_t number;
	uint64_t lo, hi;          /* its keys, both included */
	uint64_t *first, *end;    /* of each run: blocks that may hold some of it */
};

/* The next slice; first and end are the caller's, nruns entries each. */
int grid_slices_next(struct grid_slices *, struct grid_slice *, struct err *err);

#endif
