/*
 * Domains of a grid with lines, by engine/constrain, and what their traces have of lines.
 */
#include "pipe.h"

#include "constrain.h"
#include "finish.h"
#include "pipe_priv.h"

bool pipe_has_out(const struct grid *grid)
{
	return constrain_has_out(grid);
}

/* What the trace has of lines: the sum of the pieces, and the ranges of discs. */
static int trace_lines(const struct constrain *c, uint32_t cap, struct cut_trace *trace, struct err *err)
{
	int r = 0;

	trace->lines = c->depends;
	trace->lines.cap = c->chosen ? cap : 0;
	if (trace->lines.box[0] <= trace->lines.box[2])
		r = c->src->line_sum(c->src->ctx, trace->lines.box, &trace->lines.sum, err);
	return !r && trace->lines.disc[0] <= trace->lines.disc[2] ? cut_cover_end(c->cover, c->src, err) : r;
}

int pipe_constrain(const struct grid *grid, const struct view *view, const struct cut_region *region,
		   const struct pipe_budget *budget, void *memory, struct tri **tri, uint32_t tri_cap, struct mesh_counts *counts,
		   struct finish_choice *ret, struct tri_pieces **ret_pieces, uint64_t *ret_need, struct err *err)
{
	struct cut_trace *trace = &((struct pipe_trace *)memory)->trace;
	struct cut_cover cover = {.trace = trace};
	struct grid_reader *reader;
	struct constrain_lines lines;
	struct cut_source src;
	struct constrain c = {.src = &src,
			      .view = view,
			      .region = region,
			      .lines = &lines,
			      .lattice = &grid_manifest(grid)->lattice,
			      .arena = pipe_domain_arena(grid, memory),
			      .size = tri_bytes(budget->cap),
			      .used = tri_bytes(tri_cap),
			      .tri = *tri,
			      .cover = &cover};
	int r = grid_reader_new(grid, (uint8_t *)memory + PIPE_TRACE, grid_reader_bytes(grid), &reader, err);

	if (r)
		return r;
	cut_source_grid(reader, &src);
	constrain_lines_of(reader, &lines);
	r = constrain_run(&c, ret_need, err);
	if (!r)
		r = trace_lines(&c, budget->cap, trace, err);
	grid_reader_free(reader);
	*tri = c.tri;
	*ret = (struct finish_choice){c.chosen, c.special};
	*ret_pieces = c.inserted;
	counts->halo += c.added;
	counts->cells_read += c.cells_read;
	counts->points_read += c.points_read;
	return r == CONSTRAIN_E_SPLIT ? PIPE_E_SPLIT : r;
}
