/*
 * The layout of runs and segments as structs (format.md describes them). Only for the rooms of engine/grid and for
 * acut-grid-dump. All numbers are little-endian, as on the host; no struct has padding.
 */
#ifndef GRID_DISK_H
#define GRID_DISK_H

#include <stddef.h>
#include <stdint.h>

#include "grid_segment_info.h"
#include "point.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "structs are written as they are in memory");

#define DISK_SEGMENT_MAGIC "ACUTSEG1"
#define DISK_RUN_MAGIC "ACUTRUN1"
#define DISK_MANIFEST_MAGIC "ACUTMAN1"
#define DISK_SOURCES_MAGIC "ACUTSRC1"
#define DISK_STATE_MAGIC "ACUTSTG1"
#define DISK_PAGE_MAGIC 0x58444941u /* "AIDX" */

enum {
	DISK_VERSION = 1,
	DISK_MANIFEST_VERSION = 9, /* all versions are read. 1 had no paths, sizes and times of sources, 2 no geoid, 3 no
				    * generations, 4 no readings and overridden coordinate systems, 5 no WKT, 6 no lines, 7 no
				    * ranges of keys, 8 no files of sources */
	DISK_SOURCES_VERSION = 1,
	DISK_SOURCES_LAYOUT = 9, /* in version 1 of files of sources, a source is as in a manifest of this version */
	DISK_ALIGN = 16,
	DISK_HEADER = 4096,     /* of a segment */
	DISK_RUN_VERSION = 2,   /* version 1 has blocks of different sizes; it is read, too */
	DISK_RUN_BLOCK = 8192,  /* bytes, also of the header of a run */
	DISK_RUN_RECORDS = 510, /* the most in a block of a run */
	DISK_RUN_LEAST = 408,   /* the least in a block that is not the last: each record has its own source */
	DISK_PAGE = 16384,      /* bytes of an index page */
	DISK_LEVELS = 9,        /* of an index, at most: 185^9 > 2^64 */
};

static inline size_t disk_align(size_t n)
{
	return (n + DISK_ALIGN - 1) & ~(size_t)(DISK_ALIGN - 1);
}

/* ---- segment ---- */

struct disk_segment {
	uint64_t check; /* of the other bytes of the header */
	char magic[8];
	uint32_t version, header_bytes, page_bytes, cell_records;
	uint64_t points, cells, bytes;
	int32_t box[4];
	uint64_t sum_hi, sum_lo;
	uint64_t root, root_check; /* 0, 0 without cells */
	uint32_t height;           /* levels of the index; 0 without cells */
	uint32_t sources;
	uint64_t sources_place, sources_check;
	uint64_t classes[256];
	uint8_t zero[DISK_HEADER - 2048 - 128];
};
_Static_assert(sizeof(struct disk_segment) == DISK_HEADER && offsetof(struct disk_segment, box) == 56 &&
		       offsetof(struct disk_segment, root) == 88 && offsetof(struct disk_segment, sources_place) == 112 &&
		       offsetof(struct disk_segment, classes) == 128,
	       "format.md");

/* One source of a segment, in its table of sources; ascending by id. */
struct disk_total {
	uint32_t id, zero;
	uint64_t points, sum_hi, sum_lo;
};
_Static_assert(sizeof(struct disk_total) == 32, "format.md");

/* A block: this, disk_source[sources], disk_class[classes], zeros to a multiple of 16, records. */
struct disk_block {
	uint64_t check; /* of the head from here on; seed: place in the file */
	uint64_t records_check;
	uint32_t records;
	uint16_t classes, sources;
	uint64_t zero;
};
_Static_assert(sizeof(struct disk_block) == 32, "format.md");

struct disk_source { /* ascending by id */
	uint32_t id, records;
	uint64_t sum_hi, sum_lo;
};
_Static_assert(sizeof(struct disk_source) == 24, "format.md");

struct disk_class { /* ascending by cls */
	uint8_t cls, zero;
	uint16_t records;
};
_Static_assert(sizeof(struct disk_class) == 4, "format.md");

#define DISK_HEAD_MAX (sizeof(struct disk_block) + GRID_CELL_RECORDS * sizeof(struct disk_source) + 256 * 4)
#define DISK_BLOCK_MAX (DISK_HEAD_MAX + GRID_CELL_RECORDS * sizeof(struct point))
_Static_assert(DISK_HEAD_MAX % DISK_ALIGN == 0, "blocks start aligned");

static inline size_t disk_head_bytes(const struct disk_block *b)
{
	return disk_align(sizeof *b + b->sources * sizeof(struct disk_source) + b->classes * sizeof(struct disk_class));
}

/* ---- index ---- */

struct disk_page {
	uint64_t check; /* of the other bytes of the page; seed: place in the file */
	uint32_t magic;
	uint16_t level, entries; /* level 0: its entries are cells */
	uint64_t zero[2];
};
_Static_assert(sizeof(struct disk_page) == 32, "format.md");

struct disk_leaf { /* a cell */
	uint64_t lo, place, bytes, count;
	uint64_t check; /* sum modulo 2^64 of the checks of its blocks */
	uint64_t sum_hi, sum_lo;
	int32_t box[4];
	uint32_t blocks;
	uint32_t head_bytes; /* of the first block */
	uint32_t source;     /* 0: several */
	uint16_t distinct;
	uint8_t bits; /* the range has 2^bits keys, 0..64 */
	uint8_t zero;
};
_Static_assert(sizeof(struct disk_leaf) == 88 && offsetof(struct disk_leaf, box) == 56, "format.md");

struct disk_inner { /* a page of the level below */
	uint64_t lo, hi, place, check, count, distinct, cells, sum_hi, sum_lo;
	int32_t box[4];
};
_Static_assert(sizeof(struct disk_inner) == 88 && offsetof(struct disk_inner, box) == 72, "format.md");

enum { DISK_ENTRY = 88, DISK_ENTRIES = (DISK_PAGE - sizeof(struct disk_page)) / DISK_ENTRY };
_Static_assert(DISK_ENTRIES == 185, "format.md");

static inline uint64_t disk_range_end(uint64_t lo, unsigned bits)
{
	return bits >= 64 ? UINT64_MAX : lo + ((uint64_t)1 << bits) - 1;
}

/* ---- runs ---- */

struct disk_run {
	uint64_t check; /* of the other bytes of the header, DISK_RUN_BLOCK in all */
	char magic[8];
	uint32_t version, block_bytes;
	uint64_t records, blocks, bytes, zero[2];
};
_Static_assert(sizeof(struct disk_run) == 64, "format.md");

/* Block i is at (i + 1) * DISK_RUN_BLOCK: this, records, uint32 ids[sources] ascending, zeros. */
struct disk_run_block {
	uint64_t check; /* of the other bytes of the block; seed: place in the file */
	uint16_t records, sources;
	uint32_t zero;
};
_Static_assert(sizeof(struct disk_run_block) == 16, "format.md");

static inline size_t disk_run_used(unsigned records, unsigned sources)
{
	return sizeof(struct disk_run_block) + records * sizeof(struct point) + sources * (size_t)4;
}

#endif
