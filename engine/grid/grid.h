/*
 * Reading one generation of a dataset: its live records, by Morton range and by cell, merged over all segments.
 * Thread-safe: all mutable state is in the caller's reader. format.md describes the files.
 */
#ifndef GRID_H
#define GRID_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "digest.h"
#include "grid_manifest.h"
#include "point.h"
#include "slots.h"

struct err;
struct ledger;
struct lineset;
struct lineset_reader;

struct grid; /* an open manifest: segments, shared index pages (charged to LEDGER_INDEX) */

#define GRID_NEWEST UINT64_MAX /* the newest generation of the manifest */
/* Charges index_memory and its own tables to the ledger (may be NULL) until grid_close: -ERR_BUSY if they are not free
 * now. Any index_memory works; index pages that do not fit are read again. dirfd is used during the call only. At most 129
 * descriptors are open at a time, however many segments there are, and two more if lines are used. */
int grid_open(int dirfd, const char *manifest, uint64_t generation, struct ledger *, size_t index_memory, struct grid **ret,
	      struct err *err);
/*
 * The lines of a generation (lineset.h). If it has some, grid_open opens their file, too, of which the memory is a part of
 * index_memory, and readers mark records: POINT_LINE those of line vertices, and POINT_NEAR_LINE or POINT_IN_AREA those that
 * lines remove; a view knows these (view_judge). All of them are live, and counted as such.
 */
struct grid_use {
	bool no_lines; /* line vertices are not live, and nothing is marked */
	int64_t clear; /* lattice numbers within which of a line records are marked; 0: those on it */
	/* For a selection, whose records were chosen before: the line set file that it was made with, and its folder. Only the
	 * records of line vertices are marked. NULL: the file that the manifest names, in the folder of the manifest. */
	const char *lines;
	int linesfd;
	/* Records of points have the slots of their sources in their tags (POINT_SLOT). NULL: all have 0. Used during the call
	 * only. */
	const struct slots *slots;
	/* Segments are opened when somebody reads in the range of keys that the manifest says of them, so that one range of the
	 * dataset costs no look at the others. Damage of a segment is then found when it is read. It has no effect where the
	 * manifest does not tell which records are live: if a source is not, or slots are given. */
	bool late;
	/* Opens the file of a segment, in place of openat: for a file system that shows files late. Until grid_close, by any
	 * thread that reads. NULL: openat. */
	int (*open)(void *ctx, const char *file, uint64_t bytes, int *ret_fd, struct err *err);
	void *open_ctx;
};
/* grid_open with a use of the lines; NULL: all zero, as by grid_open. GRID_E_NO_LINE_SET, of both: the generation has lines, and
 * their line set has to be made again first. */
enum { GRID_E_NO_LINE_SET = 1 };
int grid_open_use(int dirfd, const char *manifest, uint64_t generation, const struct grid_use *, struct ledger *,
		  size_t index_memory, struct grid **ret, struct err *err);
struct lineset *grid_lines(const struct grid *);       /* NULL: there are none, or they are not used */
struct digest grid_lines_content(const struct grid *); /* zero: likewise */
/* The folder of the manifest, with the files of lines, while the grid is open; -1: no lines are used, or it is a selection. */
int grid_folder(const struct grid *);
uint64_t grid_generation(const struct grid *); /* the one that is read */
/* The source of the records of line vertices, which has the file (grid_source_files); NULL: likewise. */
const struct grid_source *grid_lines_source(const struct grid *);
struct grid *grid_close(struct grid *);
/* Whether segments are opened when they are read, so that no file of the generation may be removed before grid_close.
 * False: all are open, and stay readable when their names go. */
bool grid_reopens(const struct grid *);
struct ledger *grid_ledger(const struct grid *); /* the one that it was opened with */
uint64_t grid_charged(const struct grid *);      /* bytes charged to LEDGER_INDEX */
const struct grid_manifest *grid_manifest(const struct grid *);
uint64_t grid_points(const struct grid *);                               /* live records */
bool grid_all_live(const struct grid *);                                 /* no segment mixes live and dead records */
uint64_t grid_segment_points(const struct grid *, size_t segment);       /* live records of a segment of the manifest */
struct digest grid_segment_content(const struct grid *, size_t segment); /* content sum of these, as of grid_sum */
/* The slots that live records of a segment have, as bits: bit 0, none. */
uint32_t grid_segment_slots(const struct grid *, size_t segment);
uint8_t grid_source_slot(const struct grid *, uint32_t source);     /* 0: it has none */
uint64_t grid_segment_slotted(const struct grid *, size_t segment); /* those that have one */
/* Identifies the live records of a generation, its lines if they are used, and which records have which slot: the same in every
 * dataset and for every division into segments. */
struct digest grid_content(const struct grid *);
/* Box of all points of all sources (not only live ones); false if there are none. */
bool grid_box(const struct grid *, int32_t ret_box[4]);

/* A cell, or a subtree of the index (an index page below). Morton range lo..hi inclusive; aligned for a cell, from the
 * first to the last cell for a subtree. */
struct grid_cell {
	uint64_t lo, hi;
	int32_t box[4];    /* tight: min x, min y, max x, max y */
	uint64_t count;    /* records, live or not: an upper bound */
	uint64_t distinct; /* distinct positions: an upper bound, too */
	uint32_t segment;
	uint32_t blocks;
	uint64_t place, check; /* place and checksum of the blocks; opaque */
	uint32_t head_bytes;   /* of the first block; opaque */
	uint32_t source;       /* of all its records; 0: several sources, or a subtree */
};

struct grid_visitor {
	void *ctx;
	/* A subtree: true to descend into it. NULL: always. `cell->place` has no meaning here. */
	bool (*enter)(void *ctx, const struct grid_cell *subtree);
	/* A cell; non-zero ends the walk and is returned by it (negative: the callee sets err). */
	int (*cell)(void *ctx, const struct grid_cell *cell);
	/* A segment of the manifest: whether to visit it. NULL: always. Only segment, count and box of `whole` are set, and
	 * lo and hi, between which its keys are. */
	bool (*segment)(void *ctx, const struct grid_cell *whole);
};

/* Working memory of one thread that reads: block buffers. Its size is grid_reader_bytes. When a sink returns non-zero,
 * the call ends and returns that number. */
struct grid_reader;
size_t grid_reader_bytes(const struct grid *);
int grid_reader_new(const struct grid *, void *memory, size_t size, struct grid_reader **ret, struct err *);
/* Another thread sets *cancel: reading a cell is -ERR_CANCELLED from then on. */
void grid_reader_until(struct grid_reader *, const atomic_bool *cancel);
struct grid_reader *grid_reader_free(struct grid_reader *); /* `memory` stays the caller's */

struct grid_reader_stats {
	uint64_t cells, records, bytes; /* of data: cells and records read, live or not; bytes from disk */
	uint64_t pages, misses;         /* of the index: pages requested; of these, read from disk */
};
struct grid_reader_stats grid_reader_stats(const struct grid_reader *);
/* From now on grid_cell_read also puts the source of each record that it passes to the sink into `id`, which has room for
 * GRID_CELL_RECORDS and is the caller's. NULL: no longer. */
void grid_reader_ids(struct grid_reader *, uint32_t *id);
const struct grid *grid_reader_grid(const struct grid_reader *);
/* A reader of its lines, in its memory; NULL: there are none. Not for use within a sink. */
struct lineset_reader *grid_reader_lines(struct grid_reader *);

/* Within a visitor only grid_cell_read may be called with the same reader, within a sink nothing. Points that are passed
 * to a sink are valid until it returns. In place of a source index their tags have marks of lines and slots, so the result
 * does not depend on the segments that the records are in; only the order of a line vertex and of records that are equal but for
 * these may. */

/* Visits all cells whose Morton range meets [lo, hi], in order within each segment. Omits segments without a record in the range,
 * and cells whose records are known to be dead, without reading them. */
int grid_walk(struct grid_reader *, uint64_t lo, uint64_t hi, const struct grid_visitor *, struct err *);
/* Passes the live records of a cell, sorted, to `sink`, in pieces of at most GRID_CELL_RECORDS. */
typedef int (*grid_points_fn)(void *ctx, const struct point *pts, size_t n, struct err *err);
int grid_cell_read(struct grid_reader *, const struct grid_cell *, grid_points_fn, void *ctx, struct err *);
/* Passes the live records of Morton range [lo, hi] of all segments, merged in point order, in pieces. */
int grid_scan(struct grid_reader *, uint64_t lo, uint64_t hi, grid_points_fn, void *ctx, struct err *);
/* Upper bound of the number of live records in the range; *ret_exact if it is the number itself. */
int grid_count(struct grid_reader *, uint64_t lo, uint64_t hi, uint64_t *ret_count, bool *ret_exact, struct err *);
/* Content sum (format.md) of the live records in the range, over all segments; always exact. If records are marked, what marks in
 * the range depend on is added (lineset_sum_range), which is zero far from lines. If sources have slots, records of different
 * slots count differently; it does not depend on the numbers of sources. */
int grid_sum(struct grid_reader *, uint64_t lo, uint64_t hi, struct digest *ret, struct err *);
/* The same for many ranges, ascending and disjoint, in one descent of the index; sets the sum of each. */
struct grid_sum {
	uint64_t lo, hi;
	struct digest sum;
};
int grid_sums(struct grid_reader *, struct grid_sum *range, size_t n, struct err *);

/* The first of these ranges that ends at `key` or later; n if there is none. */
static inline size_t grid_sum_find(const struct grid_sum *range, size_t n, uint64_t key)
{
	size_t lo = 0, hi = n;

	while (lo < hi) {
		size_t mid = lo + (hi - lo) / 2;

		if (range[mid].hi < key)
			lo = mid + 1;
		else
			hi = mid;
	}
	return lo;
}

#endif
