/* Cells made from a sorted stream, as blocks that have no place in a file yet. Internal. */
#ifndef GRID_CELLS_H
#define GRID_CELLS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid_cell.h"

struct err;

struct grid_made {          /* a block */
	uint64_t lo, place; /* its cell's range begins at; where it lies, when that is known */
	size_t offset;      /* in the memory */
	struct grid_block_info info;
	uint32_t records;
	uint8_t bits;     /* the range has 2^bits keys */
	bool first, last; /* of its cell */
};

struct grid_cells {
	uint8_t *memory; /* blocks from the front, what is known of them from the end */
	size_t size, used, n;
	const uint64_t *prev; /* as of grid_cell_extent: &last once there is one */
	const uint64_t *next;
	uint64_t before, behind, last;
	bool open; /* a cell of one position that may go on */
};

/* The least `size` that does. */
size_t grid_cells_least(void);
/* `memory`: aligned to 16. For the records from key lo to key hi, where lo, and the key behind hi, are known to
 * be borders of cells; 0 and UINT64_MAX always are. */
void grid_cells_begin(struct grid_cells *, void *memory, size_t size, uint64_t lo, uint64_t hi);
/*
 * Sorted records that follow the ones taken so far; their sources as in grid_block_make. Takes as many as
 * make whole cells, all of them if it is the `end`; else it leaves at most GRID_CELL_RECORDS, to be
 * offered again with those that follow. False: there is no room for more blocks, they must be written first.
 */
bool grid_cells_add(struct grid_cells *, const struct point *pts, const uint32_t *ids, const uint32_t *table, size_t n, bool end,
		    size_t *ret_taken);
struct grid_made *grid_cells_block(const struct grid_cells *, size_t i);
/* The bytes of all blocks to their places. Then there are none. */
int grid_cells_write(struct grid_cells *, int fd, const char *name, struct err *err);

#endif
