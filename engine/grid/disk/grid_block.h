/* The blocks of cells: records to bytes, and bytes to records. */
#ifndef GRID_BLOCK_H
#define GRID_BLOCK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "digest.h"
#include "grid_disk.h"
#include "point.h"

struct err;

struct grid_block_info {
	size_t head_bytes, bytes;
	uint32_t distinct;
	uint32_t source; /* of all records; 0: several */
	int32_t box[4];
	struct digest sum;
};

/*
 * Makes a block of n (1..GRID_CELL_RECORDS) sorted records in `out` (DISK_BLOCK_MAX bytes, aligned to 16), without its
 * checksums. The source of record i is ids[i], or table[source index of record i] if ids is NULL.
 */
void grid_block_make(const struct point *pts, size_t n, const uint32_t *ids, const uint32_t *table, void *out,
		     struct grid_block_info *ret);
/* Sets the checksums for this place in the file; returns the one of the head. */
uint64_t grid_block_place(void *block, uint64_t place);

/* A block that was checked. All pointers are into its bytes. */
struct grid_block {
	const struct disk_block *head;
	const struct disk_source *sources;
	const struct disk_class *classes;
	struct point *records; /* NULL if only the head was read */
	size_t head_bytes, bytes;
};

/* Size of the head that begins at `bytes` (sizeof(struct disk_block) of them suffice); 0 if it is no head. */
size_t grid_block_head_bytes(const void *bytes);
/* Checks a block of which `size` bytes were read; `whole`: with its records. False if it is damaged. */
bool grid_block_open(void *bytes, size_t size, uint64_t place, bool whole, struct grid_block *ret);

/* Content hash of one record, without its source. */
struct digest grid_record_hash(const struct point *);
/* Checksum of runs, pages and heads. */
uint64_t grid_check(const void *bytes, size_t n, uint64_t seed);

#endif
