/* What the files of this room share. Internal. */
#ifndef SIMPLIFY_PRIV_H
#define SIMPLIFY_PRIV_H

#include <stdatomic.h>

#include "cut.h"
#include "cut_judge.h"
#include "grid_segment_info.h"
#include "simplify.h"
#include "simplify_file.h"
#include "simplify_greedy.h"

struct grid_stage;

enum {
	SIMPLIFY_REGION = 1 << 17, /* the most positions of a region: one of pipe_load */
	SIMPLIFY_PARTS = 256,      /* the most tasks of the blocks */
	SIMPLIFY_SEGMENTS = 8,     /* of the points chosen; more are merged to one */
	SIMPLIFY_ATTEMPTS = 8,     /* the most errors tried for max_points; more only until one gives few enough points */
};
/* No point is farther than this from a surface. */
#define SIMPLIFY_ERROR_MOST (INT64_C(1) << 33)

/* Where it is; the file "state". All are numbers, so that the file is a text of them. */
struct simplify_where {
	uint64_t step, attempt, round;
	uint64_t error;                        /* that holds, or is tried */
	uint64_t tasks, parts;                 /* of the present step; of the blocks */
	uint64_t chosen, added, seeds, rounds; /* of this attempt; positions */
	uint64_t tested;
	uint64_t regions; /* of the first round of this attempt */
	uint64_t edges;   /* positions that may be corners of triangles that are not settled; 0: nothing is known of them */
	uint64_t stars;   /* points around which this round tests; 0: it tests all regions */
	uint64_t far, corner0, corner1,
		corner2;              /* the greatest error, in thousandths, of triangles that were tested; such a one */
	uint64_t lost;                /* that triangle is gone */
	uint64_t hull, lines, points; /* corners of the hull that are no vertices of lines */
	uint64_t flat;                /* the view makes no triangle: all its points are kept */
	uint64_t records;
	/* With max_points: how many the blocks should insert; the greatest error that gave too many points, plus one, or 0; and
	 * the least that did not, with its attempt plus one (0: none) and numbers. */
	uint64_t target, low, best, best_error, best_far, best_chosen, best_seeds, best_rounds;
};

struct simplify {
	struct simplify_params p;
	struct view view, rest; /* without a window; the rules for points that it kept */
	struct simplify_where at;
	struct grid *chosen; /* in SIMPLIFY_CHECK */
	struct grid *strip;  /* in its first round, if that tests no settled triangles: the chosen points near others
				(simplify_calm.c) */
	atomic_uchar *done;  /* of each task */
	/* For tests: the most positions of a region, 0: SIMPLIFY_REGION; of a block, 0: SIMPLIFY_BLOCK; segments,
	 * 0: SIMPLIFY_SEGMENTS; triangles around the stars of a window; positions of a region with those that it adds; points
	 * from which triangles nearby are found. 0: as many as fit. */
	uint32_t load, block, segments, room, grow, near;
	uint8_t fill; /* for tests: what the memory of the kinds of vertices has at first (simplify_near.c) */
	/* For tests: how many points regions added around which no later round tests; rounds that tested all regions again; all
	 * points that regions add count as such, which is wrong. */
	atomic_uint *settled, *again;
	/* Groups of stars whose triangles were found from points nearby, and those that needed a window, too; all triangles of
	 * blocks count as settled, which is wrong. */
	atomic_uint *nearby, *windows;
	bool inward, loose;
};

int simplify_report_write(int dirfd, const struct simplify_report *, struct err *err);

/* ---- points ---- */

/* The positions of a view from its records in order. */
struct simplify_sink {
	void *ctx;
	int (*point)(void *ctx, const struct point *, struct err *err);
	struct cut_judge judge;
	struct point last; /* the record chosen so far for its position */
	bool any;
	uint64_t records, removed[VIEW_RULES];
	const struct simplify *s;
};
/* At short intervals: -ERR_CANCELLED if it shall stop. */
int simplify_cancelled(const struct simplify *, struct err *err);
void simplify_sink_init(struct simplify_sink *, const struct simplify *, const struct view *);
/* The positions with keys from lo to hi. */
int simplify_scan(struct simplify_sink *, struct grid_reader *, uint64_t lo, uint64_t hi, struct err *err);

/* ---- the steps ---- */

/* The file "blocks": the blocks, in order; info: positions, whether they are flat, records. "removed": by rule. */
struct simplify_block {
	uint64_t lo, hi, count;
};
int simplify_divide(const struct simplify *, void *memory, struct err *err);
size_t simplify_divide_bytes(const struct grid *);

/* A file "part-N" for each task: what a few blocks in a row give, by position; info: struct simplify_found. */
struct simplify_seed {
	struct point p;
	uint64_t key; /* as of struct simplify_pick, or one of: */
};
#define SIMPLIFY_SEED_LINE UINT64_MAX            /* a vertex of a line */
#define SIMPLIFY_SEED_LINE_HULL (UINT64_MAX - 1) /* one that is a corner of the block's hull */
#define SIMPLIFY_SEED_HULL (UINT64_MAX - 2)      /* another corner of the block's hull */
#define SIMPLIFY_SEED_FLAT (UINT64_MAX - 3)      /* a point of a flat view; the least of these */
/* In a key of struct simplify_pick: the point is a SIMPLIFY_EDGE, or SIMPLIFY_RING. So are vertices of lines and corners. */
#define SIMPLIFY_SEED_EDGE (UINT64_C(1) << 62)
#define SIMPLIFY_SEED_RING (UINT64_C(1) << 61)
#define SIMPLIFY_SEED_MARKS (SIMPLIFY_SEED_EDGE | SIMPLIFY_SEED_RING)
/* Whether blocks tell which triangles are settled: not if the error is not known yet, or if triangles of the mesh are dropped. */
bool simplify_settles(const struct simplify *);
int simplify_part(const struct simplify *, uint32_t task, void *memory, struct err *err);
size_t simplify_part_bytes(const struct grid *);

/* The file "bad-ATTEMPT-ROUND-TASK": struct point; info: struct simplify_found. Before it, in a round that tests regions,
 * "edge-ATTEMPT-ROUND-TASK": points of it around which a later round is to test. */
int simplify_check(const struct simplify *, uint32_t task, void *memory, struct err *err);
size_t simplify_check_bytes(const struct simplify_params *);

/* ---- the grid of the points chosen ---- */

/* Names of files. */
char *simplify_name(char name[GRID_NAME_MAX], const char *what, uint64_t a, uint64_t b, uint64_t c);

/* A stage that becomes a segment of the chosen points. */
enum { SIMPLIFY_POINTS = 1, SIMPLIFY_LINES = 2, SIMPLIFY_BATCH = 512 };
struct simplify_stage {
	struct grid_stage *stage;
	struct point batch[2][SIMPLIFY_BATCH];
	size_t n[2];
	uint64_t count[2]; /* records: points, vertices of lines */
};
int simplify_stage_begin(struct simplify_stage *, const struct simplify *, const char *name, bool temporary, size_t memory,
			 struct err *err);
int simplify_stage_add(struct simplify_stage *, const struct point *, struct err *err);
int simplify_stage_end(struct simplify_stage *, struct grid_segment_info *ret, struct err *err); /* frees it, too */
void simplify_stage_abort(struct simplify_stage *);

/* Writes a manifest of these segments, which have `lines` vertices of lines. */
int simplify_manifest(const struct simplify *, const char *name, struct grid_segment_info *, size_t n, uint64_t lines,
		      struct err *err);
/* The grid whose regions a round tests. */
static inline const struct grid *simplify_tested(const struct simplify *s)
{
	return s->strip ? s->strip : s->chosen;
}
/* Opens one. */
int simplify_grid(const struct simplify *, const char *name, struct grid **ret, struct err *err);

#endif
