/* What the files of this room share. Internal. */
#ifndef GRID_READ_H
#define GRID_READ_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid.h"
#include "grid_block.h"
#include "grid_segment.h"
#include "lineset.h"

struct err;
struct ledger;

/* ---- the cache of index pages ---- */

struct grid_cache;

/* Allocates room for `frames` pages (0: nothing is kept). NULL: no memory. */
struct grid_cache *grid_cache_new(size_t frames);
size_t grid_cache_bytes(size_t frames);
struct grid_cache *grid_cache_free(struct grid_cache *);
/* Copies the page to `page` if it is cached. Both functions are thread-safe. */
bool grid_cache_get(struct grid_cache *, uint32_t segment, uint64_t place, void *page);
void grid_cache_put(struct grid_cache *, uint32_t segment, uint64_t place, const void *page);

/* ---- the descriptors of segments ---- */

/*
 * A grid of many segments keeps only some of their files open, and opens the others again when they are read. The others
 * must not be removed while it is open (grid_reopens).
 */
enum { GRID_FILES_OPEN = 128 };
struct grid_files;

/* dirfd is duplicated. `all_open`: they are opened by the caller, if there are not too many. NULL: no memory, or no descriptor
 * (*err is set). */
struct grid_files *grid_files_new(int dirfd, const struct grid_use *, bool all_open, struct grid_segment *segments, size_t n,
				  struct err *err);
size_t grid_files_bytes(size_t segments);
struct grid_files *grid_files_free(struct grid_files *); /* closes them all */
int grid_files_open(const struct grid_files *, int dirfd, const struct grid_segment *, int *ret_fd, struct err *err);
/* The file of this segment was opened (its fd) and is read no more for now. */
void grid_files_add(struct grid_files *, uint32_t segment);
/* A copy of the segment with an open file, until grid_files_give. Thread-safe. */
int grid_files_take(struct grid_files *, uint32_t segment, struct grid_segment *ret, struct err *err);
void grid_files_give(struct grid_files *, uint32_t segment, const struct grid_segment *);

/* ---- the order of segments ---- */

/* Those that have live records, by the key where they begin. `end`: a binary tree, in an array, of the greatest key of each
 * subtree. */
struct grid_order {
	uint32_t n, leaves;
	uint32_t depth; /* so many meet at one key, at most */
	uint32_t *segment;
	uint64_t *end;
};

struct grid;
size_t grid_order_bytes(size_t segments);
/* Of g->segments and g->live. -ERR_NOMEM. */
int grid_order_make(struct grid *, struct err *err);
void grid_order_free(struct grid_order *);
/* The first place in the order, from `from` on, of a segment that ends at `lo` or later; n: there is none. */
uint32_t grid_order_next(const struct grid_order *, uint32_t from, uint64_t lo);

/* ---- an open manifest ---- */

struct grid_live { /* of a segment */
	uint64_t points;
	struct digest sum;     /* content sum of the live records */
	struct digest content; /* the same with slots: grid_segment_content */
	bool all, none;        /* of its records are live */
	uint32_t slots;        /* grid_segment_slots */
	uint64_t slotted;      /* grid_segment_slotted */
	uint8_t slot;          /* of all live records, if they have one slot */
};

/* Of a segment that is opened late. Threads that find it at the same time set the same. */
struct grid_root {
	_Atomic uint64_t place, check;
	_Atomic bool known;
};

struct grid_liveness { /* of sources with these numbers */
	uint32_t first, last;
	bool live;
	uint8_t slot;
};

struct grid {
	struct grid_manifest *manifest;
	uint64_t generation;           /* the one that is read */
	struct grid_segment *segments; /* as the manifest lists them */
	struct grid_files *files;      /* of the segments */
	struct grid_order order;
	struct grid_live *live;        /* of each segment */
	struct grid_root *roots;       /* of each segment, if they are opened late; else NULL */
	struct grid_liveness *sources; /* all of the manifest, ascending by number */
	size_t nsources;               /* ranges of numbers */
	struct lineset *lines;         /* NULL: none */
	int folder;                    /* grid_folder */
	bool slots;                    /* sources may have some */
	struct digest *slot_sum;       /* of each slot from 1: content sum of its live records; NULL: there are no slots */
	uint32_t line_source;          /* the one of the records of line vertices; 0: none is live */
	bool marks;                    /* records that lines remove are marked */
	int64_t clear;
	uint32_t height; /* levels of the highest index */
	struct grid_cache *cache;
	struct ledger *ledger;
	uint64_t charged;
};

/* The root page of a segment; opens it, if that is not done. */
int grid_root_of(const struct grid *, uint32_t segment, uint64_t *ret_place, uint64_t *ret_check, struct err *err);
/* Whether the records of this source count in the generation; false if the manifest has no such source. */
bool grid_live(const struct grid *, uint32_t source);
uint8_t grid_slot(const struct grid *, uint32_t source);
/* A content sum of records of one slot, as content sums have it. Linear, so sums of parts add up; slot 0: unchanged. */
struct digest grid_slot_sum(struct digest sum, uint8_t slot);

/* ---- a reader ---- */

enum { GRID_BATCH = 16, GRID_LEAF_PAGES = 8 };

struct grid_cursor { /* position of a grid_scan in one segment */
	uint32_t segment;
	bool done;     /* no cells after the batch */
	uint64_t from; /* first key of the next batch */
	struct disk_leaf batch[GRID_BATCH];
	unsigned nbatch, at;
	/* The cell that is being read. */
	struct grid_cell cell;
	uint32_t block; /* the next of its blocks; cell.blocks at the end */
	uint64_t place, check;
	/* When merging: a copy of records of a block, and how many were merged. */
	struct point *pts;
	size_t n, pos;
	uint64_t key; /* of pts[pos] */
	/* A block that is larger than the buffer is read several times: the records that were copied, and where it is. */
	size_t copied;
	struct {
		uint32_t block;
		uint64_t place, check;
	} again;
};

struct grid_reader {
	const struct grid *grid;
	struct grid_reader_stats stats;
	bool walking; /* pages are in use */
	/* Index pages: some of level 0, then one for each higher level. `held` says which pages they are, so that they are
	 * not fetched again. */
	uint8_t *pages;
	struct grid_held_page {
		uint64_t place, used; /* used: time of the last use, for pages of level 0 */
		uint32_t segment;
		bool valid;
	} held[DISK_LEVELS + GRID_LEAF_PAGES];
	uint64_t clock;
	unsigned nleaves, leaf;       /* pages of level 0; the one that was read last */
	uint8_t *block;               /* DISK_BLOCK_MAX */
	struct point *piece;          /* GRID_CELL_RECORDS */
	struct grid_cursor *cursors;  /* for the segments that meet at one key */
	struct grid_cursor **heap;    /* all of them; the first ones are in use */
	size_t room;                  /* of the buffer of a cursor, in records */
	uint8_t *flags;               /* GRID_CELL_RECORDS: which sources of a block are live */
	struct lineset_reader *lines; /* NULL: none */
	uint32_t *ids;                /* grid_reader_ids; NULL: not wanted */
	const atomic_bool *cancel;    /* grid_reader_until; NULL: never */
};

static inline uint8_t *grid_reader_page(const struct grid_reader *r, unsigned level)
{
	return r->pages + (level ? r->nleaves + level - 1 : r->leaf) * (size_t)DISK_PAGE;
}

/* Reads an index page, checked, into the reader's page of that level. */
int grid_page_read(struct grid_reader *, uint32_t segment, unsigned level, uint64_t place, uint64_t check, struct err *err);

/* The cell of an entry of a page of level 0. -ERR_CORRUPT if it cannot be one. */
int grid_cell_of(const struct grid_segment *, uint32_t segment, const struct disk_leaf *, struct grid_cell *ret, struct err *err);
/* Whether no record of the cell is live, as far as that is known without reading it. */
bool grid_cell_dead(const struct grid *, const struct grid_cell *);

/* Starts reading the blocks of a cell. */
void grid_cursor_cell(struct grid_cursor *, const struct grid_cell *);
/* Reads the next block: its live records, in the reader's block buffer; *ret_n may be 0. After the last block
 * cursor->block == cell.blocks. */
int grid_cursor_block(struct grid_reader *, struct grid_cursor *, struct point **ret_pts, size_t *ret_n, struct err *err);
/* Reads only the head of the next block; the pointers are into the block buffer. Within one cell, heads and blocks must
 * not be mixed. */
int grid_cursor_head(struct grid_reader *, struct grid_cursor *, struct grid_block *ret, struct err *err);

/* Marks the records that lines remove; `box` has all of them. */
int grid_mark(struct grid_reader *, const int32_t box[4], struct point *pts, size_t n, struct err *err);

/* Trims sorted records to the range [lo, hi]. */
void grid_trim(struct point **pts, size_t *n, uint64_t lo, uint64_t hi);

#endif
