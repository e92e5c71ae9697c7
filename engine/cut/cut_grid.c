/*
 * The grid as a source of cells, and the public functions of this room for grids. Only this file calls engine/grid.
 */
#include <string.h>

#include "cut_source.h"
#include "cut_valid.h"
#include "lineset.h"

static int grid_source_walk(void *ctx, uint64_t lo, uint64_t hi, const struct grid_visitor *v, struct err *err)
{
	return grid_walk(ctx, lo, hi, v, err);
}

static int grid_source_read(void *ctx, const struct grid_cell *cell, grid_points_fn fn, void *sink, struct err *err)
{
	return grid_cell_read(ctx, cell, fn, sink, err);
}

static int grid_source_scan(void *ctx, uint64_t lo, uint64_t hi, grid_points_fn fn, void *sink, struct err *err)
{
	return grid_scan(ctx, lo, hi, fn, sink, err);
}

static int grid_source_count(void *ctx, uint64_t lo, uint64_t hi, uint64_t *ret_count, bool *ret_exact, struct err *err)
{
	return grid_count(ctx, lo, hi, ret_count, ret_exact, err);
}

static bool grid_source_all_live(void *ctx)
{
	return grid_all_live(grid_reader_grid(ctx));
}

static int grid_source_sums(void *ctx, struct grid_sum *range, size_t n, struct err *err)
{
	return grid_sums(ctx, range, n, err);
}

static size_t grid_parts(void *ctx, struct cut_live_part *ret, struct cut_segment *ret_segment, size_t most)
{
	const struct grid *g = ctx;
	size_t all = grid_manifest(g)->nsegments, n = 0;

	for (size_t i = 0; i < all; i++) {
		uint64_t points = grid_segment_points(g, i);

		if (!points)
			continue;
		if (n < most) {
			ret[n] = (struct cut_live_part){.points = points, .sum = grid_segment_content(g, i)};
			ret_segment[n].number = (uint32_t)i;
			memcpy(ret_segment[n].box, grid_manifest(g)->segments[i].box, sizeof ret_segment[n].box);
		}
		n++;
	}
	return n;
}

static size_t grid_source_parts(void *ctx, struct cut_live_part *ret, struct cut_segment *ret_segment, size_t most)
{
	return grid_parts((void *)grid_reader_grid(ctx), ret, ret_segment, most);
}

static bool grid_source_box(void *ctx, int32_t ret_box[4])
{
	return grid_box(grid_reader_grid(ctx), ret_box);
}

static int grid_source_line_sum(void *ctx, const int32_t box[4], struct digest *ret, struct err *err)
{
	return lineset_sum(grid_reader_lines(ctx), box, ret, err);
}

static struct digest grid_lines_of(void *ctx)
{
	return grid_lines_content(ctx);
}

static struct digest grid_source_lines(void *ctx)
{
	return grid_lines_content(grid_reader_grid(ctx));
}

void cut_source_grid(struct grid_reader *reader, struct cut_source *ret)
{
	ret->ctx = reader;
	ret->walk = grid_source_walk;
	ret->read = grid_source_read;
	ret->scan = grid_source_scan;
	ret->count = grid_source_count;
	ret->all_live = grid_source_all_live;
	ret->sums = grid_source_sums;
	ret->box = grid_source_box;
	ret->parts = grid_source_parts;
	ret->line_sum = grid_reader_lines(reader) ? grid_source_line_sum : NULL;
	ret->lines = grid_source_lines;
	ret->ledger = grid_ledger(grid_reader_grid(reader));
}

int cut_load(struct grid_reader *reader, const struct view *view, const struct cut_region *region, struct cut_load *load,
	     uint64_t *ret_need, struct err *err)
{
	struct cut_source src;

	cut_source_grid(reader, &src);
	return cut_load_from(&src, view, region, load, ret_need, err);
}

int cut_count(struct grid_reader *reader, const struct cut_region *region, uint64_t *ret, struct err *err)
{
	struct cut_range range[4];
	unsigned n = cut_region_ranges(region, range);
	uint64_t all = 0;

	for (unsigned i = 0; i < n; i++) {
		uint64_t some;
		bool exact;
		int rc = grid_count(reader, range[i].lo, range[i].hi, &some, &exact, err);

		if (rc)
			return rc;
		all += some;
	}
	*ret = all;
	return 0;
}

int cut_valid(struct grid_reader *reader, const struct view *view, const struct cut_region *region, const struct cut_trace *trace,
	      bool *ret, struct err *err)
{
	struct cut_source src;

	cut_source_grid(reader, &src);
	return cut_valid_from(&src, view, region, trace, ret, err);
}

bool cut_trace_still_live(struct grid_reader *reader, const struct cut_trace *trace)
{
	struct cut_source src;

	cut_source_grid(reader, &src);
	return cut_trace_still_live_in(&src, trace);
}

bool cut_additions_far(const struct grid *grid, const struct cut_region *region, const struct cut_reach *reach,
		       const struct cut_live *then)
{
	const struct cut_source src = {.ctx = (void *)grid, .parts = grid_parts, .lines = grid_lines_of};

	return cut_additions_far_from(&src, region, reach, then);
}

int cut_plan_make(struct grid_reader *reader, uint32_t load, struct cut_plan *ret, struct err *err)
{
	struct cut_source src;

	cut_source_grid(reader, &src);
	return cut_plan_make_from(&src, load, ret, err);
}

int cut_plan_below(struct grid_reader *reader, const struct cut_region *top, bool alone, uint32_t load, struct cut_plan *ret,
		   struct err *err)
{
	struct cut_source src;

	cut_source_grid(reader, &src);
	return cut_plan_below_from(&src, top, alone, load, ret, err);
}

int cut_plan_split(struct cut_plan *plan, size_t i, struct grid_reader *reader, uint64_t need, uint32_t cap, struct err *err)
{
	struct cut_source src;

	cut_source_grid(reader, &src);
	return cut_plan_split_from(&src, plan, i, need, cap, err);
}

int cut_plan_halve(struct cut_plan *plan, size_t i, struct grid_reader *reader, bool *ret, struct err *err)
{
	struct cut_source src;

	cut_source_grid(reader, &src);
	return cut_plan_halve_from(&src, plan, i, ret, err);
}

int cut_plan_probe_rim(struct cut_plan *plan, struct grid_reader *reader, const struct view *view, uint32_t cap, void *scratch,
		       size_t scratch_size, struct err *err)
{
	struct cut_source src;

	cut_source_grid(reader, &src);
	return cut_plan_probe_from(&src, view, plan, cap, scratch, scratch_size, err);
}
