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
 * are the last ones (`end`). `prev` is the key of the record before, if there is one. Returns how many
 * records the cell has and the size of its range, 2^*ret_bits keys; 0: the cell is one position with more
 * than GRID_CELL_RECORDS records.
 */
size_t grid_cell_extent(const struct point *pts, size_t n, bool has_prev, uint64_t prev, unsigned *ret_bits);

/* ---- blocks ---- */

struct grid_block_info {
	size_t head_bytes, bytes;
	uint64_t check;
	uint32_t distinct;
	uint32_t source;          /* of all records, or 0 */
	int32_t box[4];
	struct digest sum;
};

/*
 * The bytes of the block at `place` with these n (1..GRID_CELL_RECORDS) sorted records into `out`
 * (DISK_BLOCK_MAX bytes, aligned to 16). Their sources are ids[i], or if ids is NULL table[source index of
 * record i].
 */
void grid_block_make(const struct point *pts, size_t n, const uint32_t *ids, const uint32_t *table,
		     uint64_t place, void *out, struct grid_block_info *ret);

/* What a block's bytes say, checked. All pointers into the block. */
struct grid_block {
	const struct disk_block *head;
	const struct disk_source *sources;
	const struct disk_class *classes;
	struct point *records;    /* NULL if only the head was there */
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
