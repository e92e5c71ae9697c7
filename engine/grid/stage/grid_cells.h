/* Making cells from a sorted stream, as blocks in memory that have no place in a file yet. */
#ifndef GRID_CELLS_H
#define GRID_CELLS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid_block.h"

struct err;

struct grid_new_block {
	uint64_t lo;    /* first key of its cell's range */
	uint64_t place; /* in the file, once it is known */
	size_t offset;  /* in the memory */
	struct grid_block_info info;
	uint32_t records;
	uint8_t bits;     /* the range has 2^bits keys */
	bool first, last; /* block of its cell */
};

struct grid_cells {
	uint8_t *memory; /* blocks from the front, their struct grid_new_block from the end */
	size_t size, used, n;
	const uint64_t *prev; /* a key before the next cell, or NULL: `before`, or `last` once there is a block */
	const uint64_t *next; /* a key after the last cell, or NULL */
	uint64_t before, behind, last;
	bool open; /* the last cell is a single position and may continue */
};

/* The smallest `size`. */
size_t grid_cells_min_bytes(void);
/* Begins the cells of the records with keys from lo to hi. `memory` is aligned to 16. lo and hi + 1 must be borders of
 * cells; 0 always is one, and so is the end of all keys. */
void grid_cells_begin(struct grid_cells *, void *memory, size_t size, uint64_t lo, uint64_t hi);
/*
 * Adds sorted records that follow those taken so far; sources as in grid_block_make. Takes only records whose cells are
 * complete, or all at the `end`. At most GRID_CELL_RECORDS remain; the caller passes them again with those that follow.
 * False: the memory is full, and the blocks must be written first.
 */
bool grid_cells_add(struct grid_cells *, const struct point *pts, const uint32_t *ids, const uint32_t *table, size_t n, bool end,
		    size_t *ret_taken);
struct grid_new_block *grid_cells_block(const struct grid_cells *, size_t i);
/* Writes all blocks to their places and empties the memory. */
int grid_cells_write(struct grid_cells *, int fd, const char *name, struct err *err);

#endif
