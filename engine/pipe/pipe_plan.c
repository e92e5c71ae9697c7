/*
 * Planning: first, whether there is anything to triangulate; then the leaves; then an estimate of those halos that may
 * be far larger than their region, so that a job that cannot fit fails before its first triangle.
 *
 * Collinear points are found here and not in the domains (pipe_flat.c).
 */
#include "pipe.h"

#include "err.h"
#include "pipe_priv.h"
#include "tri.h"
#include "window.h"

static int make_leaves(struct grid_reader *reader, const struct view *view, const struct pipe_budget *budget, bool flat,
		       struct cut_plan *plan, struct err *err)
{
	/* With weights the parts of a piece may load nearly as much as all of it. */
	unsigned pieces = view->nweight ? 1 : budget->threads;
	int r = view->window ? window_plan(reader, view, budget->cap, pieces, plan, err) :
			       cut_plan_make(reader, budget->load, plan, err);

	if (!r && flat)
		cut_plan_make_flat(plan);
	return r;
}

int pipe_plan_make(const struct grid *grid, const struct view *view, const struct pipe_budget *budget, void *memory,
		   struct cut_plan *ret, struct mesh_counts *ret_empty, struct err *err)
{
	struct grid_reader *reader = NULL;
	struct cut_plan plan = {0};
	struct mesh_counts counts;
	bool flat;
	int r;

	r = pipe_weight_check(grid, view, err);
	if (!r)
		r = grid_reader_new(grid, memory, grid_reader_bytes(grid), &reader, err);
	if (r)
		return r;
	r = pipe_flat_scan(reader, view, &flat, &counts, err);
	if (!r && flat && (!counts.used || view->window)) {
		*ret_empty = counts;
		r = PIPE_E_EMPTY;
	} else if (!r) {
		r = make_leaves(reader, view, budget, flat, &plan, err);
		plan.points_read += view->window ? counts.points_read : 0;
	}
	if (!r || r == PIPE_E_EMPTY)
		*ret = plan;
	else
		cut_plan_done(&plan);
	grid_reader_free(reader);
	return r;
}

int pipe_plan_probe(const struct grid *grid, const struct view *view, const struct pipe_budget *budget, void *memory,
		    const atomic_bool *cancel, struct cut_plan *plan, struct err *err)
{
	size_t reader_size = grid_reader_bytes(grid);
	uint8_t *scratch = (uint8_t *)memory + align_line(reader_size);
	struct grid_reader *reader = NULL;
	int r;

	if (view->window || cut_plan_flat(plan))
		return 0;
	r = grid_reader_new(grid, memory, reader_size, &reader, err);
	if (!r)
		grid_reader_until(reader, cancel);
	if (!r)
		r = cut_plan_probe_rim(plan, reader, view, pipe_weight_cap(view, budget->cap), scratch, tri_bytes(budget->cap),
				       err);
	if (r == -ERR_LIMIT)
		err->need = pipe_weight_need(view, err->need);
	grid_reader_free(reader);
	if (r)
		cut_plan_done(plan);
	return r;
}

int pipe_plan(const struct grid *grid, const struct view *view, const struct pipe_budget *budget, void *memory,
	      struct cut_plan *ret, struct mesh_counts *ret_empty, struct err *err)
{
	struct cut_plan plan;
	int r = pipe_plan_make(grid, view, budget, memory, &plan, ret_empty, err);

	if (r == PIPE_E_EMPTY)
		*ret = plan;
	if (!r)
		r = pipe_plan_probe(grid, view, budget, memory, NULL, &plan, err);
	if (!r)
		*ret = plan;
	return r;
}

int pipe_plan_split(struct cut_plan *plan, size_t i, struct grid_reader *reader, const struct view *view, uint64_t need,
		    uint32_t cap, struct err *err)
{
	int r = cut_plan_split(plan, i, reader, need, view->window ? window_cap_of(grid_reader_grid(reader), cap) : cap, err);

	for (unsigned k = 0; k < 2 && !r && view->window; k++)
		window_tighten(grid_reader_grid(reader), view, &plan->leaf[i + k].region);
	return r;
}
