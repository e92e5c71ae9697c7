/*
 * Planning: before any region is cut, whether there is anything to triangulate at all; then the leaves; then
 * a look ahead at those whose halo may be far larger than they are, so that a job which cannot fit is refused
 * before its first triangle.
 *
 * Collinear points are found here, not in the domains: every region of a collinear survey needs all of its
 * points (ALGORITHM 4.6), so it would be refused, and its mesh is known to be empty. The scan ends at the first
 * three points that are not collinear: on ordinary data within the first cell.
 */
#include "pipe.h"

#include <string.h>

#include "err.h"
#include "geom.h"
#include "pipe_priv.h"
#include "tri.h"

struct flat {
	const struct view *view;
	struct mesh_counts counts;
	int32_t first[2], second[2], last[2];
};

enum { NOT_FLAT = 100 };

static int flat_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct flat *f = ctx;
	size_t i;

	(void)err;
	f->counts.points += n;
	f->counts.points_read += n;
	for (i = 0; i < n; i++) {
		enum view_rule rule = view_judge(f->view, &pts[i]);
		int32_t at[2] = {pts[i].x, pts[i].y};

		if (rule == VIEW_KEPT && f->counts.used && !memcmp(at, f->last, sizeof at))
			rule = VIEW_BY_DUPLICATE;
		if (rule != VIEW_KEPT) {
			f->counts.removed[rule]++;
			continue;
		}
		memcpy(f->last, at, sizeof at);
		if (f->counts.used < 2)
			memcpy(f->counts.used ? f->second : f->first, at, sizeof at);
		else if (geom_orient(f->first, f->second, at))
			return NOT_FLAT;
		f->counts.used++;
	}
	return 0;
}

int pipe_plan_make(const struct grid *grid, const struct view *view, const struct pipe_budget *budget, void *memory,
		   struct cut_plan *ret, struct mesh_counts *ret_flat, struct err *err)
{
	struct flat flat = {.view = view};
	struct grid_reader *reader = NULL;
	struct cut_plan plan = {0};
	int r;

	r = grid_reader_new(grid, memory, grid_reader_bytes(grid), &reader, err);
	if (r)
		return r;
	r = grid_scan(reader, 0, UINT64_MAX, flat_points, &flat, err);
	if (!r) {
		*ret_flat = flat.counts;
		*ret = plan;
		r = PIPE_E_FLAT;
	} else if (r == NOT_FLAT) {
		if (view->window) {
			r = pipe_area_plan(reader, view, budget->cap, &plan, err);
			plan.points_read = flat.counts.points_read;
		} else {
			r = cut_plan_make(reader, budget->load, &plan, err);
		}
		if (!r)
			*ret = plan;
		else
			cut_plan_done(&plan);
	}
	grid_reader_free(reader);
	return r;
}

int pipe_plan_probe(const struct grid *grid, const struct view *view, const struct pipe_budget *budget, void *memory,
		    struct cut_plan *plan, struct err *err)
{
	size_t reader_size = grid_reader_bytes(grid);
	uint8_t *scratch = (uint8_t *)memory + pipe_round(reader_size);
	struct grid_reader *reader = NULL;
	int r;

	if (view->window)
		return 0;
	r = grid_reader_new(grid, memory, reader_size, &reader, err);
	if (!r)
		r = cut_plan_probe_rim(plan, reader, view, budget->cap, scratch, tri_bytes(budget->cap), err);
	grid_reader_free(reader);
	if (r)
		cut_plan_done(plan);
	return r;
}

int pipe_plan(const struct grid *grid, const struct view *view, const struct pipe_budget *budget, void *memory,
	      struct cut_plan *ret, struct mesh_counts *ret_flat, struct err *err)
{
	struct cut_plan plan;
	int r = pipe_plan_make(grid, view, budget, memory, &plan, ret_flat, err);

	if (r == PIPE_E_FLAT)
		*ret = plan;
	if (!r)
		r = pipe_plan_probe(grid, view, budget, memory, &plan, err);
	if (!r)
		*ret = plan;
	return r;
}
