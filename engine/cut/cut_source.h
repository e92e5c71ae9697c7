/*
 * The source of cells and points: the few functions of a grid that this room uses. Only cut_grid.c calls engine/grid;
 * tests use tilings in memory.
 */
#ifndef CUT_SOURCE_H
#define CUT_SOURCE_H

#include <stdbool.h>
#include <stdint.h>

#include "cut.h"
#include "grid.h"

struct cut_live;
struct cut_live_part;
struct cut_reach;

/* A segment, by the number that its cells have, and a box that contains its live records. */
struct cut_segment {
	uint32_t number;
	int32_t box[4];
};

struct cut_source {
	void *ctx;
	/* As grid_walk, grid_cell_read, grid_scan, grid_count. */
	int (*walk)(void *ctx, uint64_t lo, uint64_t hi, const struct grid_visitor *, struct err *);
	int (*read)(void *ctx, const struct grid_cell *, grid_points_fn, void *sink, struct err *);
	int (*scan)(void *ctx, uint64_t lo, uint64_t hi, grid_points_fn, void *sink, struct err *);
	int (*count)(void *ctx, uint64_t lo, uint64_t hi, uint64_t *ret_count, bool *ret_exact, struct err *);
	/* As grid_all_live. NULL: unknown. */
	bool (*all_live)(void *ctx);
	/* As grid_sums. */
	int (*sums)(void *ctx, struct grid_sum *range, size_t n, struct err *);
	/* As grid_box: of all points of all sources. */
	bool (*box)(void *ctx, int32_t ret_box[4]);
	/* Returns the number of segments with live records, and for the first `most` their live content and box. NULL:
	 * unknown. */
	size_t (*parts)(void *ctx, struct cut_live_part *ret, struct cut_segment *ret_segment, size_t most);
	/* As lineset_sum, and the content of the line set; NULL: there are no lines. */
	int (*line_sum)(void *ctx, const int32_t box[4], struct digest *ret, struct err *);
	struct digest (*lines)(void *ctx);
	struct ledger *ledger; /* of plans; may be NULL */
};

/* The grid of a reader; valid as long as the reader. */
void cut_source_grid(struct grid_reader *, struct cut_source *ret);

/* The functions of cut.h for any source. */
int cut_load_from(const struct cut_source *, const struct view *, const struct cut_region *, struct cut_load *,
		  uint64_t *ret_need, struct err *err);
int cut_valid_from(const struct cut_source *, const struct view *, const struct cut_region *, const struct cut_trace *, bool *ret,
		   struct err *err);
bool cut_trace_still_live_in(const struct cut_source *, const struct cut_trace *);
bool cut_additions_far_from(const struct cut_source *, const struct cut_region *, const struct cut_reach *,
			    const struct cut_live *);
int cut_plan_make_from(const struct cut_source *, uint32_t load, struct cut_plan *ret, struct err *err);
int cut_plan_below_from(const struct cut_source *, const struct cut_region *top, bool alone, uint32_t load, struct cut_plan *ret,
			struct err *err);
int cut_plan_split_from(const struct cut_source *, struct cut_plan *, size_t i, uint64_t need, uint32_t cap, struct err *err);
int cut_plan_halve_from(const struct cut_source *, struct cut_plan *, size_t i, bool *ret, struct err *err);
int cut_plan_probe_from(const struct cut_source *, const struct view *, struct cut_plan *, uint32_t cap, void *scratch,
			size_t scratch_size, struct err *err);

#endif
