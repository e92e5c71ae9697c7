/*
 * Where cells and points come from: the few questions that this room asks of a grid. cut_grid.c is
 * the only place that calls engine/grid; tests cut with tilings in memory.
 */
#ifndef CUT_SOURCE_H
#define CUT_SOURCE_H

#include <stdbool.h>
#include <stdint.h>

#include "cut.h"
#include "grid.h"

struct cut_live;
struct cut_part;
struct cut_reach;

/* A segment, by the number that its cells have, and a box that holds what is live in it. */
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
	/* As grid_all_live. NULL: not known. */
	bool (*all_live)(void *ctx);
	/* As grid_sums. */
	int (*sums)(void *ctx, struct grid_sum *range, size_t n, struct err *);
	/* As grid_box: of all points of all sources. */
	bool (*box)(void *ctx, int32_t ret_box[4]);
	/* The segments with live records: how many there are, and of the first `most` what is live in them, and where. NULL: not
	 * known. */
	size_t (*parts)(void *ctx, struct cut_part *ret, struct cut_segment *ret_segment, size_t most);
	struct ledger *ledger; /* of plans; NULL: none */
};

/* The grid of a reader, as long as that lives. */
void cut_source_grid(struct grid_reader *, struct cut_source *ret);

/* The functions of cut.h over any source. */
int cut_load_from(const struct cut_source *, const struct view *, const struct cut_region *, struct cut_load *,
		  uint64_t *ret_need, struct err *err);
int cut_valid_from(const struct cut_source *, const struct view *, const struct cut_region *, const struct cut_trace *, bool *ret,
		   struct err *err);
bool cut_trace_stands_in(const struct cut_source *, const struct cut_trace *);
bool cut_far_from(const struct cut_source *, const struct cut_region *, const struct cut_reach *, const struct cut_live *);
int cut_plan_make_from(const struct cut_source *, uint32_t load, struct cut_plan *ret, struct err *err);
int cut_plan_split_from(const struct cut_source *, struct cut_plan *, size_t i, uint64_t need, uint32_t cap, struct err *err);
int cut_plan_halve_from(const struct cut_source *, struct cut_plan *, size_t i, bool *ret, struct err *err);
int cut_plan_probe_from(const struct cut_source *, const struct view *, struct cut_plan *, uint32_t cap, void *scratch,
			size_t scratch_size, struct err *err);

#endif
