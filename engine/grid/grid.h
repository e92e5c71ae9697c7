/*
 * The grid cache on disk: sorted runs, immutable segments of Morton cells with a paged index, and
 * manifests that name the segments and sources of a dataset's generations. FORMAT.md has the bytes.
 */
#ifndef GRID_H
#define GRID_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "digest.h"
#include "lattice.h"
#include "point.h"

struct err;
struct ledger;

enum { GRID_CELL_RECORDS = 1024, GRID_RUN_SOURCES = 4096 };

/* ---- writing: stage -> sorted runs -> one segment ---- */

/* How several threads that work on one stage keep out of each other's way; all members NULL: there is one. */
struct grid_guard {
	void (*lock)(void *ctx), (*unlock)(void *ctx);
	void (*wait)(void *ctx); /* unlocks until somebody wakes; may return for no reason */
	void (*wake)(void *ctx); /* all who wait; under the lock */
	void *ctx;
};

struct grid_stage;

struct grid_stage_params {
	int dirfd;         /* folder for runs and the segment (borrowed) */
	const char *name;  /* file name stem of the segment, unique in the folder */
	size_t memory;     /* bytes the stage may use for its buffers; the caller has charged them */
	bool durable;      /* runs are fsynced; if not, grid_stage_sync does nothing */
	bool passing;      /* nor need the segment outlive a crash: it is not fsynced */
	bool folder_later; /* the segment's name is durable when the caller has fsynced the folder, which it does anyway */
	/* Asked before what was added becomes a run: a file may be made now? It may wait. Not 0: the stage fails with that. NULL:
	 * yes. */
	int (*ready)(void *ctx, struct err *err);
	void *ready_ctx;
};

/* The least `memory` that does. */
enum { GRID_STAGE_MIN = 1 << 20 };

int grid_stage_new(const struct grid_stage_params *, struct grid_stage **ret, struct err *err);
/* All points added from now on belong to source `id` (numbers of the manifest, > 0). */
int grid_stage_source(struct grid_stage *, uint32_t id, struct err *err);
/* Points with lattice coordinates; the tag carries flags only. Sorts and spills when full. */
int grid_stage_add(struct grid_stage *, const struct point *pts, size_t n, struct err *err);

/*
 * Points of one source by several threads: after the split as many as there are lanes may add at once; who finds all
 * lanes full sorts one and writes it out. When all are back, whatever is called next joins what they left.
 * `guard` is copied.
 */
enum { GRID_LANES = 16 };
unsigned grid_stage_lanes(const struct grid_stage *); /* that its memory carries, at least 1 */
int grid_stage_split(struct grid_stage *, unsigned lanes, const struct grid_guard *guard, struct err *err);
int grid_stage_share(struct grid_stage *, const struct point *pts, size_t n, struct err *err);
/* Everything added so far lies in fsynced runs when this returns (durable stages). */
int grid_stage_sync(struct grid_stage *, struct err *err);

struct grid_segment_info {
	char file[64]; /* name in the folder */
	uint64_t points, cells, bytes;
	int32_t box[4];        /* min x, min y, max x, max y; meaningless if points == 0 */
	uint64_t classes[256]; /* points by class */
	struct digest sum;     /* content sum of all its records, without their sources */
};

/* Merge the runs (and what is still in memory) into a segment, published durably. Runs are removed, unless the
 * stage was left: then they stay until grid_stage_free or grid_stage_discard. */
int grid_stage_seal(struct grid_stage *, struct grid_segment_info *ret, struct err *err);

/*
 * The same in steps, by several threads: the segment does not depend on how many there are, nor on who does what.
 * Between begin and finish nothing else may be done with the stage.
 */
struct grid_seal;
enum { GRID_SEAL_OVER = 1 };
/* `workers`: as many as will be there, at most. */
int grid_seal_begin(struct grid_stage *, unsigned workers, const struct grid_guard *guard, struct grid_seal **ret,
		    struct err *err);
unsigned grid_seal_workers(const struct grid_seal *); /* that its memory keeps busy, at least 1 */
/* Any thread: a piece of the work. GRID_SEAL_OVER: nobody need begin another. Whatever fails fails for all. */
int grid_seal_step(struct grid_seal *, struct err *err);
/* Any thread: the records that are in the segment so far, and that will be. */
void grid_seal_progress(struct grid_seal *, uint64_t *ret_done, uint64_t *ret_all);
/* When all who took steps are back: what grid_stage_seal returns. Frees the seal. */
int grid_seal_finish(struct grid_seal *, struct grid_segment_info *ret, struct err *err);
struct grid_seal *grid_seal_free(struct grid_seal *); /* instead: the stage has failed */

/* After a failure nothing but grid_stage_free and grid_stage_part works. Frees; what was not sealed is removed
 * from disk, also what was left. */
struct grid_stage *grid_stage_free(struct grid_stage *);
/* What was added of source `id` goes: it will not be in the segment, nor the source in its table. The number is
 * used up: nothing can be added under it any more. */
int grid_stage_drop(struct grid_stage *, uint32_t id, struct err *err);

/* Leaves everything added so far in runs, and beside them a state file, NAME.stage, that says so (both fsynced
 * if durable): from then on another stage of that name can go on from here, whatever becomes of this one. */
int grid_stage_leave(struct grid_stage *, struct err *err);
/* Frees; what the last grid_stage_leave said stays on disk, the rest is removed. */
struct grid_stage *grid_stage_part(struct grid_stage *);
/* Goes on where a stage of params->name in that folder was left. -ERR_CORRUPT, -ERR_IO: it cannot. */
int grid_stage_resume(const struct grid_stage_params *, struct grid_stage **ret, struct err *err);
/* 0: what a stage of that name left looks as if it could be gone on with. *ret_last: the largest number of a source
 * that has points in it, 0: there are none. */
int grid_stage_check(int dirfd, const char *name, uint32_t *ret_last, struct err *err);
/* The sources that have points in it, ascending. */
const uint32_t *grid_stage_sources(const struct grid_stage *, size_t *ret_n);
/* Removes what a stage left; success if there is nothing. */
int grid_stage_discard(int dirfd, const char *name, struct err *err);

/* ---- rewriting: several segments become one ---- */

/*
 * All records of some segments of one folder, with their sources, in a new segment: byte for byte the one that a seal
 * of the same records gives. The old ones stay as they are. One thread at a time.
 */
struct grid_rewrite;
struct grid_rewrite_params {
	int dirfd; /* borrowed during grid_rewrite_new only, but for the new segment, where it is until the end */
	const struct grid_segment_info *segments; /* borrowed during grid_rewrite_new only */
	size_t nsegments;                         /* at most 512 */
	size_t nsources;                          /* that they can have, all together */
	const char *name;                         /* file name stem of the new one */
	const uint32_t *drop;                     /* sources whose records are left out, ascending; borrowed until the end */
	size_t ndrop;
	size_t memory; /* bytes it may use; the caller has charged them */
	bool passing;  /* it need not outlive a crash */
};
/* The least `memory` that does. */
size_t grid_rewrite_least(const struct grid_segment_info *segments, size_t n, size_t nsources);
int grid_rewrite_new(const struct grid_rewrite_params *, struct grid_rewrite **ret, struct err *err);
/* Some of it, about 100 KiB; GRID_REWRITE_OVER: only grid_rewrite_finish is left. */
enum { GRID_REWRITE_OVER = 1 };
int grid_rewrite_step(struct grid_rewrite *, struct err *err);
void grid_rewrite_progress(const struct grid_rewrite *, uint64_t *ret_done, uint64_t *ret_all); /* records */
/* Publishes the segment; frees in any case. */
int grid_rewrite_finish(struct grid_rewrite *, struct grid_segment_info *ret, struct err *err);
struct grid_rewrite *grid_rewrite_free(struct grid_rewrite *); /* nothing of it stays on the disk */
/* How many records of these sources (ascending) a segment has. Takes 32 bytes a source of it meanwhile. */
int grid_segment_holds(int dirfd, const struct grid_segment_info *, const uint32_t *ids, size_t n, uint64_t *ret_points,
		       struct err *err);

/* ---- manifests: a text or binary file that alone describes a dataset ---- */

/* From a generation to before another. */
struct grid_span {
	uint64_t added, removed;
};

struct grid_source {
	uint32_t id;             /* > 0, never used twice in a dataset */
	uint64_t added, removed; /* added it; removed it, 0 = none; the same: never counted */
	/* It was there before, removed, and is brought back by `added`: when, ascending, all over before that. */
	const struct grid_span *earlier;
	size_t nearlier;
	uint64_t points;
	const char *name;       /* file name as pushed, at most 255 bytes; NULL is "" */
	const char *path;       /* absolute, as the client saw it, at most 4095 bytes; "": none (a pipe) */
	uint64_t size;          /* of the input, in bytes, and when it was last changed (ns since 1970); */
	int64_t mtime_ns;       /* both 0 if unknown */
	struct digest hash;     /* XXH3-128 (seed 0) of the input's bytes, zero if unknown */
	const char *overridden; /* what its records said of its coordinates, where the push put something else in its place;
				 * NULL is "": nothing, or they held */
	uint64_t left_out;      /* of a text: lines without a value for a coordinate */
	const char *reading;    /* how it was read (FORMAT.md); NULL is "": not known */
};
/* With the zero at the end. */
enum { GRID_SOURCE_NAME = 256, GRID_SOURCE_PATH = 4096, GRID_SOURCE_OVERRIDDEN = 512, GRID_SOURCE_READING = 1024 };

/* Whether its points count in that generation. */
bool grid_source_live(const struct grid_source *, uint64_t generation);

enum grid_generation_kind {
	GRID_PUSH = 1,
	GRID_REVERT,  /* of generation `undoes` */
	GRID_REPLACE, /* a push that removes what it replaces */
	GRID_PRUNE,   /* of what came before generation `undoes` */
	GRID_IMPORT,
	GRID_KINDS
};
const char *grid_generation_kind_text(enum grid_generation_kind); /* "push" ... */

enum { GRID_USER = 64 };
struct grid_generation {
	uint64_t number;
	int64_t time_us; /* since 1970; 0 if unknown */
	uint32_t uid;
	const char *user; /* that had this number then, at most 63 bytes; NULL is "": unknown */
	enum grid_generation_kind kind;
	uint64_t undoes; /* 0: none */
	/* By the sources: those that it added (a source that is brought back is added, too), and that it removed. */
	uint32_t files, files_removed;
	uint64_t points_added, points_removed;
	struct digest content; /* of what it added: the hashes of the files, summed up */
};

enum { GRID_GEOID = 128 };

struct grid_manifest {
	struct lattice lattice;
	char crs[512], unit_xy[16], unit_z[16];
	/* What was done to the heights of its sources: "", or "orthometric HASH NAME" or "ellipsoidal HASH NAME" of
	 * the geoid grid that made them so. */
	char geoid[GRID_GEOID];
	char choices[256];   /* of a push that is not committed: how its files were read; else "" */
	uint64_t generation; /* the newest */
	uint64_t oldest;     /* that can still be read; 0 is 1 */
	struct grid_segment_info *segments;
	size_t nsegments;
	struct grid_source *sources;
	size_t nsources;
	/* Ascending by number. Some may be missing: what is derived from another dataset (a selection) has none. Of a
	 * manifest before version 4 they are made of its sources: pushes of unknown times and users. */
	struct grid_generation *generations;
	size_t ngenerations;
	char *texts; /* of sources and generations, of a manifest that was read; else NULL */
	size_t texts_bytes;
	struct grid_span *spans; /* likewise, of the sources */
	size_t nspans;
	struct ledger *ledger; /* of a manifest that was read: what it was charged to (LEDGER_MANIFEST), and how much */
	uint64_t charged;
};

int grid_manifest_write(int dirfd, const char *name, const struct grid_manifest *, struct err *err);
int grid_manifest_read(int dirfd, const char *name, struct grid_manifest **ret, struct err *err);
/* Likewise; what it takes is taken from `ledger` before it is read (LEDGER_MANIFEST; NULL: none), until it is freed.
 * -ERR_BUSY: there is no room now; -ERR_LIMIT: it takes more than half of all. */
int grid_manifest_load(int dirfd, const char *name, struct ledger *, struct grid_manifest **ret, struct err *err);
struct grid_manifest *grid_manifest_free(struct grid_manifest *);
uint64_t grid_manifest_oldest(const struct grid_manifest *); /* 1 where it does not say more; 0: nothing can be read */
/* What the sources say of these generations, ascending by number: files, points and content. They say it of all after
 * the oldest, and of that if it is 1; what was pruned is not among them any more. */
void grid_generations_tally(const struct grid_manifest *, struct grid_generation *, size_t n);

/* ---- reading one generation; thread-safe, all state in the caller's reader ---- */

struct grid; /* an open manifest: segments, shared index pages (charged to LEDGER_INDEX) */

#define GRID_NEWEST UINT64_MAX /* the newest generation of the manifest */
/* Takes index_memory and its own tables from the ledger (may be NULL) until grid_close: -ERR_BUSY if they
 * are not free now. Any index_memory works; pages beyond it are read again. dirfd is
 * needed during the call only. */
int grid_open(int dirfd, const char *manifest, uint64_t generation, struct ledger *, size_t index_memory, struct grid **ret,
	      struct err *err);
struct grid *grid_close(struct grid *);
struct ledger *grid_ledger(const struct grid *); /* that it was opened with */
uint64_t grid_charged(const struct grid *);      /* taken of LEDGER_INDEX */
const struct grid_manifest *grid_manifest(const struct grid *);
uint64_t grid_points(const struct grid *); /* live records */
bool grid_all_live(const struct grid *);   /* nothing that is read in this generation has to be left out */
uint64_t grid_segment_points(const struct grid *, size_t segment);       /* likewise, of one segment of the manifest */
struct digest grid_segment_content(const struct grid *, size_t segment); /* content sum of these */
/* Identifies the live records of a generation: the same in every dataset and every division into segments. */
struct digest grid_content(const struct grid *);
/* Box of all points of all sources (not only live ones); false if there are none. */
bool grid_box(const struct grid *, int32_t ret_box[4]);

/* A cell, or a subtree of cells, as the index knows it. Morton range lo..hi inclusive; aligned for a cell,
 * from the first to the last cell for a subtree. */
struct grid_cell {
	uint64_t lo, hi;
	int32_t box[4];    /* tight: min x, min y, max x, max y */
	uint64_t count;    /* records, live or not: an upper bound */
	uint64_t distinct; /* distinct positions, upper bound likewise */
	uint32_t segment;
	uint32_t blocks;
	uint64_t place, check; /* where the blocks are, and their checksum; opaque */
	uint32_t head_bytes;   /* of the first block; opaque */
	uint32_t source;       /* of all its records; 0: several, or a subtree */
};

struct grid_visitor {
	void *ctx;
	/* Subtree: true to go down. NULL: always. `cell->place` has no meaning there. */
	bool (*enter)(void *ctx, const struct grid_cell *subtree);
	/* A cell; non-zero ends the walk and is returned by it (negative: err is the callee's). */
	int (*cell)(void *ctx, const struct grid_cell *cell);
	/* A segment of the manifest: whether to look at it at all. NULL: at each. Of `whole` segment, count and box have a
	 * meaning, and lo and hi, which are keys of its box's corners here. */
	bool (*segment)(void *ctx, const struct grid_cell *whole);
};

/* Working memory of one thread that reads: block buffers. Size by grid_reader_bytes. A sink that returns
 * non-zero ends the call, which returns that number. */
struct grid_reader;
size_t grid_reader_bytes(const struct grid *);
int grid_reader_new(const struct grid *, void *memory, size_t size, struct grid_reader **ret, struct err *);
struct grid_reader *grid_reader_free(struct grid_reader *); /* `memory` stays the caller's */

struct grid_reader_stats {
	uint64_t cells, records, bytes; /* of data: cells and records read, live or not; bytes from disk */
	uint64_t pages, misses;         /* of the index: pages asked for; of these, read from disk */
};
struct grid_reader_stats grid_reader_stats(const struct grid_reader *);
const struct grid *grid_reader_grid(const struct grid_reader *);

/* A visitor may call grid_cell_read (not grid_scan, grid_walk, grid_count, grid_sum) with the same reader,
 * a sink nothing; points handed to a sink stay valid until it returns. The source index in the tags of
 * points that are handed out is zero: what is read does not depend on how the records lie in segments. */

/* All cells of all segments whose Morton range meets [lo, hi], in order within each segment. Cells whose
 * records are known to be dead without reading them are left out. */
int grid_walk(struct grid_reader *, uint64_t lo, uint64_t hi, const struct grid_visitor *, struct err *);
/* Live records of a cell, sorted; handed to `sink` in pieces of at most GRID_CELL_RECORDS. */
typedef int (*grid_points_fn)(void *ctx, const struct point *pts, size_t n, struct err *err);
int grid_cell_read(struct grid_reader *, const struct grid_cell *, grid_points_fn, void *ctx, struct err *);
/* Live records of Morton range [lo, hi] of all segments, merged in point order, in pieces. */
int grid_scan(struct grid_reader *, uint64_t lo, uint64_t hi, grid_points_fn, void *ctx, struct err *);
/* Upper bound of live records in the range; *ret_exact if it is the number itself. */
int grid_count(struct grid_reader *, uint64_t lo, uint64_t hi, uint64_t *ret_count, bool *ret_exact, struct err *);
/* Content sum (FORMAT.md) of the live records in the range, over all segments: exact always. */
int grid_sum(struct grid_reader *, uint64_t lo, uint64_t hi, struct digest *ret, struct err *);
/* The same of many ranges, ascending and disjoint, in one descent: *range[i].sum is set. */
struct grid_sum {
	uint64_t lo, hi;
	struct digest sum;
};
int grid_sums(struct grid_reader *, struct grid_sum *range, size_t n, struct err *);

/* ---- reading everything, to tell what is damaged ---- */

enum { GRID_VERIFY_BYTES = 256 << 10 };
struct grid_verify_params {
	int dirfd;
	void *memory; /* GRID_VERIFY_BYTES */
	/* Each damaged thing: its file, place and what is wrong; and each of a newer version (-ERR_VERSION). */
	void (*damaged)(void *ctx, const struct err *);
	/* Bytes that were read since the last call; non-zero ends it all (-ERR_CANCELLED). NULL is fine. */
	int (*progress)(void *ctx, uint64_t bytes);
	void *ctx;
};
/* Every page and block of a segment of that manifest, whichever records are live, and all that it says of them. Damage is no
 * error here. Takes some bytes a source from the manifest's ledger meanwhile: -ERR_BUSY if they are not free. */
int grid_verify_segment(const struct grid_verify_params *, const struct grid_manifest *, size_t segment, struct err *err);
/* Every block of the runs that a stage of that name left. */
int grid_verify_stage(const struct grid_verify_params *, const char *name, struct err *err);

#endif
