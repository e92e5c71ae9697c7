/* What the tests of the grid share: folders, point sets, and a second implementation of cells in memory. */
#ifndef GRID_FIXTURE_H
#define GRID_FIXTURE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "err.h"
#include "grid.h"
#include "grid_stage.h"
#include "no_sync.h"
#include "point.h"
#include "random.h"

/* ---- folders ---- */

struct folder {
	char path[64];
	int fd;
};

struct folder folder_new(void);
void folder_remove(struct folder *);                            /* with everything in it */
size_t folder_files(const struct folder *, const char *suffix); /* files whose names end with it; "": all */
size_t open_descriptors(void);

/* ---- point sets ---- */

/* Points with sources: id[i] belongs to pts[i], whose tag has flags only. */
struct set {
	struct point *pts;
	uint32_t *ids;
	size_t n;
};

enum shape { SHAPE_UNIFORM, SHAPE_CLUSTERED, SHAPE_DUPLICATES, SHAPE_EXTREME, SHAPE_ONE_POSITION, SHAPES };

struct set set_make(enum shape, size_t n, unsigned sources, uint64_t seed);
/* Corners of a strictly convex polygon: its sides are all primitive vectors with coordinates up to `reach`, by direction. */
struct set set_polygon(int32_t reach);
void set_free(struct set *);
/* In the order of the cache, with source last. */
void set_sort(struct set *);
void set_shuffle(struct set *, uint64_t seed);

/* ---- cells, by halving the key space ---- */

struct ref_cell {
	uint64_t lo, hi;
	size_t first, n; /* in the sorted set */
	int32_t box[4];
	uint64_t distinct;
	struct digest sum;
};

/* The cells of a sorted set. The caller frees them. */
struct ref_cell *ref_cells(const struct set *, size_t *ret_n);

/* ---- making and opening a dataset ---- */

#define CHECK(call) check_ok((call), &err, #call, __FILE__, __LINE__)
void check_ok(int rc, const struct err *err, const char *what, const char *file, int line);

/* Stages and seals, in pieces of odd sizes; memory 0: more than enough. */
int stage_set(const struct folder *, const char *name, const struct set *, size_t memory, struct grid_segment_info *ret,
	      struct err *err);
/* Segments s0, s1, ...: each source is in one of them, by its number. Made with little memory. */
void stage_sources(const struct folder *, const struct set *, unsigned segments, struct grid_segment_info *ret);
/* A manifest of segments with sources 1..sources, all added in generation 1. The caller frees m.sources. */
struct grid_manifest manifest_of(struct grid_segment_info *segments, size_t n, uint32_t sources);

/* Sets the number of points of each source. */
void manifest_count(struct grid_manifest *, const struct set *);

/* A reader with its memory. */
struct reader {
	struct grid *grid;
	struct grid_reader *r;
	void *memory;
};
struct reader reader_open(const struct folder *, const char *manifest, uint64_t generation, size_t index_memory);
struct reader reader_open_use(const struct folder *, const char *manifest, uint64_t generation, const struct grid_use *,
			      size_t index_memory);
void reader_close(struct reader *);

/* Collects everything that a scan returns. */
struct gather {
	struct point *pts;
	size_t n, cap;
	size_t largest; /* largest piece */
};
int gather_sink(void *ctx, const struct point *pts, size_t n, struct err *err);

/* A random range of keys, often with ends at records of the set. */
void random_range(const struct set *, uint64_t *rng, uint64_t *lo, uint64_t *hi);
/* Scan, count and sum of a range against filtering the sorted set of live records. */
void reader_check(struct reader *, const struct set *live, uint64_t lo, uint64_t hi, bool must_be_exact);

#endif
