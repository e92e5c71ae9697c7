/* Reading a grid: what the reading files of the room share. Internal. */
#ifndef GRID_READ_H
#define GRID_READ_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid.h"
#include "grid_cell.h"
#include "grid_disk.h"

struct err;
struct ledger;

/* ---- the cache of index pages ---- */

struct grid_cache;

/* Room for `frames` pages (0: nothing is kept), all of it allocated here. NULL: no memory. */
struct grid_cache *grid_cache_new(size_t frames);
size_t grid_cache_bytes(size_t frames);
struct grid_cache *grid_cache_free(struct grid_cache *);
/* A copy of the page into `page` if it is there. Thread-safe, as is grid_cache_put. */
bool grid_cache_get(struct grid_cache *, uint32_t segment, uint64_t place, void *page);
void grid_cache_put(struct grid_cache *, uint32_t segment, uint64_t place, const void *page);

/* ---- an open manifest ---- */

struct grid_part { /* a segment */
	int fd;
	const char *name;
	uint64_t bytes, cells, live_points;
	uint64_t root, root_check;
	uint32_t height;
	int32_t box[4]; /* of its points, and the keys of its corners: all others lie between */
	uint64_t lo, hi;
	struct digest live_sum; /* content of what is live */
	bool all_live, none_live;
};

struct grid_life { /* ascending by id */
	uint32_t id;
	bool live;
};

struct grid {
	struct grid_manifest *manifest;
	uint64_t generation;     /* that is read */
	struct grid_part *parts; /* as many as segments */
	struct grid_life *lives; /* as many as sources */
	uint32_t height, active; /* of the highest index; parts with anything live */
	struct grid_cache *cache;
	struct ledger *ledger;
	uint64_t charged;
};

/* Whether records of this source count in the generation. False too if there is no such source. */
bool grid_live(const struct grid *, uint32_t source);
/* -ERR_CORRUPT for segment `part`: place and what. */
int grid_damaged(const struct grid_part *, uint64_t place, const char *what, struct err *err);
/* All n bytes; the end of the file before that is -ERR_CORRUPT. */
int grid_part_read(const struct grid_part *, void *buf, size_t n, uint64_t place, struct err *err);

/* Of the index of so many cells. */
unsigned grid_levels(uint64_t cells);
/* Its header, checked against what the manifest says of it. On failure p->fd may be open. */
int grid_part_open(struct grid_part *p, int dirfd, const struct grid_segment_info *, struct disk_segment *ret, struct err *err);
/* Its table of sources, to be freed. */
int grid_part_sources(const struct grid_part *, const struct disk_segment *, struct disk_total **ret, struct err *err);

/* ---- a reader ---- */

enum { GRID_BATCH = 16, GRID_LEAVES = 8 };

struct grid_cursor { /* grid_scan: the place in one segment */
	uint32_t part;
	bool done;     /* no cells after the batch */
	uint64_t from; /* the next batch begins here */
	struct disk_leaf batch[GRID_BATCH];
	unsigned nbatch, at;
	/* the cell that is being read */
	struct grid_cell cell;
	uint32_t block; /* next of its blocks; cell.blocks: none left */
	uint64_t place, check;
	/* its records that have not been taken, when merging */
	struct point *pts;
	size_t n, pos;
	uint64_t key; /* of pts[pos] */
};

struct grid_reader {
	const struct grid *grid;
	struct grid_reader_stats stats;
	bool walking; /* pages are in use */
	/* DISK_PAGE for each level above the cells, and for some pages of cells; what lies there is not fetched again. */
	uint8_t *pages;
	struct grid_held {
		uint64_t place, used; /* used: by the clock, of pages of cells */
		uint32_t part;
		bool is;
	} held[DISK_LEVELS + GRID_LEAVES];
	uint64_t clock;
	unsigned leaves, leaf;       /* pages of cells, the first ones; the one that was asked for last */
	uint8_t *block;              /* DISK_BLOCK_MAX */
	struct point *piece;         /* GRID_CELL_RECORDS */
	struct grid_cursor *cursors; /* for the active parts */
	struct grid_cursor **heap;
	bool *flags; /* GRID_CELL_RECORDS: sources of a block that are live */
};

static inline uint8_t *grid_reader_page(const struct grid_reader *r, unsigned level)
{
	return r->pages + (level ? r->leaves + level - 1 : r->leaf) * (size_t)DISK_PAGE;
}

/* A page of the index, checked, into the reader's page of that level. */
int grid_page_read(struct grid_reader *, uint32_t part, unsigned level, uint64_t place, uint64_t check, struct err *err);
static inline unsigned grid_page_entries(const uint8_t *page)
{
	return ((const struct disk_page *)page)->entries;
}
static inline const struct disk_leaf *grid_page_leaf(const uint8_t *page, unsigned i)
{
	return (const struct disk_leaf *)(page + sizeof(struct disk_page)) + i;
}
static inline const struct disk_inner *grid_page_inner(const uint8_t *page, unsigned i)
{
	return (const struct disk_inner *)(page + sizeof(struct disk_page)) + i;
}

/* The first entry that ends at `from` or later; their number: none does. */
static inline unsigned grid_page_at(const uint8_t *page, bool inner, uint64_t from)
{
	unsigned a = 0, b = grid_page_entries(page);

	while (a < b) {
		unsigned mid = a + (b - a) / 2;
		const struct disk_leaf *leaf = grid_page_leaf(page, mid);

		if ((inner ? grid_page_inner(page, mid)->hi : disk_range_end(leaf->lo, leaf->bits)) < from)
			a = mid + 1;
		else
			b = mid;
	}
	return a;
}

/* Whether a record of the segment can have its key in [lo, hi]. */
static inline bool grid_part_meets(const struct grid_part *p, uint64_t lo, uint64_t hi)
{
	return p->height && !p->none_live && p->lo <= hi && p->hi >= lo;
}

/* The cell of a leaf entry. -ERR_CORRUPT if it cannot be one. */
int grid_cell_of(const struct grid_part *, uint32_t part, const struct disk_leaf *, struct grid_cell *ret, struct err *err);
/* Whether it is known without reading that no record of the cell is live. */
bool grid_cell_dead(const struct grid *, const struct grid_cell *);

/* Start reading a cell's blocks with this cursor, and the next block: its live records, in the reader's block
 * buffer; *ret_n may be 0. cursor->block == cell.blocks afterwards: it was the last. */
void grid_cursor_cell(struct grid_cursor *, const struct grid_cell *);
int grid_cursor_block(struct grid_reader *, struct grid_cursor *, struct point **ret_pts, size_t *ret_n, struct err *err);
/* Likewise, but only the head; not to be mixed in one cell. Pointers into the block buffer. */
int grid_cursor_head(struct grid_reader *, struct grid_cursor *, struct grid_block *ret, struct err *err);

/* The part of sorted records that lies in [lo, hi]. */
void grid_trim(struct point **pts, size_t *n, uint64_t lo, uint64_t hi);

#endif
