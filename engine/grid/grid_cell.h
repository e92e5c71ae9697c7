/*
 * Cells: where they begin and end in a sorted stream of records, and their blocks as bytes. Internal.
 */
#ifndef GRID_CELL_H
#define GRID_CELL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "digest.h"
#include "grid_disk.h"
#include "point.h"

struct err;

/* ---- where cells end ---- */

/*
 * The cell that begins with pts[0]. `n` sorted records are in sight; either n > GRID_CELL_RECORDS, or they
 * are the last ones. `prev` is a key that is not in the cell: that of the record before, or any between it and
 * the cell; NULL: there is no record before. `next`, if not NULL: a key behind the last record that is
 * not in its cell. Returns how many records the cell has and the size of its range, 2^*ret_bits keys; 0: the
 * cell is one position with more than GRID_CELL_RECORDS records.
 */
size_t grid_cell_extent(const struct point *pts, size_t n, const uint64_t *prev, const uint64_t *next, unsigned *ret_bits);

/* ---- blocks ---- */

struct grid_block_info {
	size_t head_bytes, bytes;
	uint32_t distinct;
	uint32_t source; /* of all records, or 0 */
	int32_t box[4];
	struct digest sum;
};

/*
 * The bytes of a block with these n (1..GRID_CELL_RECORDS) sorted records into `out`
 * (DISK_BLOCK_MAX bytes, aligned to 16), all but its checksums. Their sources are ids[i], or if ids is NULL
 * table[source index of record i].
 */
void grid_block_make(const struct point *pts, size_t n, const uint32_t *ids, const uint32_t *table, void *out,
		     struct grid_block_info *ret);
/* The checksums, when its place is known; returns that of the head. */
uint64_t grid_block_place(void *block, uint64_t place);

/* What a block's bytes say, checked. All pointers into the block. */
struct grid_block {
	const struct disk_block *head;
	const struct disk_source *sources;
	const struct disk_class *classes;
	struct point *records; /* NULL if only the head was there */
	size_t head_bytes, bytes;
};

/* How many bytes the head at `bytes` has, 0 if it is not a head. Needs sizeof(struct disk_block) bytes. */
size_t grid_block_head_bytes(const void *bytes);
/* False if anything does not agree. `size` bytes are there; `whole`: the records as well. */
bool grid_block_open(void *bytes, size_t size, uint64_t place, bool whole, struct grid_block *ret);

/* Content hash of one record, without its source. */
struct digest grid_record_hash(const struct point *);
/* Checksum of runs, pages, heads. */
uint64_t grid_check(const void *bytes, size_t n, uint64_t seed);

#endif
