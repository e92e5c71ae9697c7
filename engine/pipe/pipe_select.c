/*
 * Selecting: the points that a view with crop, every or thin keeps, as a grid of their own, so that plan, halos
 * and domains work on real counts and know nothing of these rules.
 *
 * The model: one walk over the index of the source grid. Subtrees and cells outside the crop are not read. What
 * is kept goes into a stage, as one source; the stage seals a segment, and a manifest on the same lattice names
 * it. With a thin rule the walk is cut into pieces of whole thin cells (pipe_thin.c). Memory is one number:
 * [this struct | buffers of the reader | table of thin cells] and the stage, which takes its part itself.
 *
 * The counts are exact without reading what the crop leaves out: the crop is the first rule (view.h), whichever other
 * rule would have removed a point too. So "cropped" is the number of live records of the generation,
 * which the grid knows, less those that were read, plus those of them that lie outside; it depends on the points
 * alone, not on how cells lie. Without a crop every live record is read, and the sum is checked.
 *
 * It will not reduce duplicates (the mesh does), keep sources apart, or clean up after a failure: the folder is
 * the caller's.
 */
#include "pipe_select.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "pipe_priv.h"

#define TELL_POINTS (1u << 18)

/* The text of the manifest, and the stage's list of runs. */
enum { SMALL_BYTES = 16 << 10 };

static size_t fixed_bytes(const struct grid *grid)
{
	return pipe_round(sizeof(struct select)) + pipe_round(grid_reader_bytes(grid));
}

size_t pipe_select_min(const struct grid *grid)
{
	return fixed_bytes(grid) + SELECT_TABLE_MIN + GRID_STAGE_MIN + SMALL_BYTES;
}

/* ---- a point ---- */

static int flush(struct select *s)
{
	size_t n = s->nbatch;

	s->nbatch = 0;
	s->out.kept += n;
	return n ? grid_stage_add(s->stage, s->batch, n, s->err) : 0;
}

int select_keep(struct select *s, const struct point *p)
{
	s->batch[s->nbatch++] = *p;
	return s->nbatch == SELECT_BATCH ? flush(s) : 0;
}

int select_tell(struct select *s)
{
	if (!s->p->progress || s->seen - s->told < TELL_POINTS)
		return 0;
	s->told = s->seen;
	if (s->p->progress(s->p->ctx, s->judged))
		return err_set(s->err, ERR_CANCELLED, "the selection was cancelled");
	return 0;
}

/* ---- without thin cells: one walk ---- */

static bool enter(void *ctx, const struct grid_cell *subtree)
{
	const struct select *s = ctx;

	return view_may_hold(s->p->view, subtree->box);
}

static int take_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct select *s = ctx;
	int r = 0;

	(void)err;
	for (size_t i = 0; !r && i < n; i++) {
		enum view_rule rule = view_judge(s->p->view, &pts[i]);

		if (rule == VIEW_KEPT)
			r = select_keep(s, &pts[i]);
		else
			s->out.removed[rule]++;
	}
	s->judged += n;
	s->seen += n;
	return r ? r : select_tell(s);
}

static int take_cell(void *ctx, const struct grid_cell *cell)
{
	struct select *s = ctx;

	if (!view_may_hold(s->p->view, cell->box))
		return 0;
	return grid_cell_read(s->reader, cell, take_points, s, s->err);
}

/* ---- the whole ---- */

static int publish(struct select *s, const struct grid_segment_info *info)
{
	const struct grid_manifest *from = grid_manifest(s->p->grid);
	struct grid_segment_info segment = *info;
	struct grid_source source = {.id = 1, .added = 1, .points = s->out.kept, .name = "selection"};
	struct grid_manifest m = {
		.lattice = from->lattice,
		.generation = 1,
		.segments = &segment,
		.nsegments = 1,
		.sources = &source,
		.nsources = 1,
	};
	int r;

	memcpy(m.crs, from->crs, sizeof m.crs);
	memcpy(m.unit_xy, from->unit_xy, sizeof m.unit_xy);
	memcpy(m.unit_z, from->unit_z, sizeof m.unit_z);
	r = pipe_selected_write(s->p->dirfd, &s->out, s->err);
	return r ? r : grid_manifest_write(s->p->dirfd, PIPE_SELECT_MANIFEST, &m, s->err);
}

/* What was not read lies outside the crop. */
static int count_rest(struct select *s)
{
	uint64_t points = grid_points(s->p->grid), sum = s->out.kept;

	if (s->judged > points || (s->judged < points && !s->p->view->crop))
		return err_set(s->err, ERR_INTERNAL, "the generation has %llu points, %llu were read", (unsigned long long)points,
			       (unsigned long long)s->judged);
	s->out.points = points;
	s->out.removed[VIEW_BY_CROP] += points - s->judged;
	for (int i = 0; i < VIEW_RULES; i++)
		sum += s->out.removed[i];
	if (sum != points)
		return err_set(s->err, ERR_INTERNAL, "of %llu points the selection counts %llu", (unsigned long long)points,
			       (unsigned long long)sum);
	return 0;
}

static int run(struct select *s)
{
	const struct grid_visitor visitor = {s, enter, take_cell};
	struct grid_segment_info info;
	int r = grid_stage_source(s->stage, 1, s->err);

	if (r)
		return r;
	if (s->p->view->thin.cell)
		r = select_thin(s);
	else
		r = grid_walk(s->reader, 0, UINT64_MAX, &visitor, s->err);
	if (!r)
		r = flush(s);
	if (!r)
		r = count_rest(s);
	if (!r)
		r = grid_stage_seal(s->stage, &info, s->err);
	return r ? r : publish(s, &info);
}

int pipe_select(const struct pipe_select_params *params, struct pipe_selected *ret, struct err *err)
{
	size_t fixed = fixed_bytes(params->grid), reader_bytes = grid_reader_bytes(params->grid), rest, table = 0;
	struct grid_stage_params stage = {.dirfd = params->dirfd, .name = "selection"};
	struct select *s;
	uint8_t *memory;
	int r;

	if (params->memory < pipe_select_min(params->grid))
		return err_set(err, ERR_LIMIT, "a selection needs %zu bytes of memory, not %zu", pipe_select_min(params->grid),
			       params->memory);
	rest = params->memory - fixed - SMALL_BYTES;
	/* A thin rule keeps few of many: the table that sees all of them deserves the larger part. */
	if (params->view->thin.cell)
		table = (rest / 3 > GRID_STAGE_MIN ? rest - rest / 3 : rest - GRID_STAGE_MIN) & ~(size_t)(PIPE_ALIGN - 1);
	stage.memory = rest - table;
	memory = aligned_alloc(PIPE_ALIGN, fixed + table);
	if (!memory)
		return err_set(err, ERR_NOMEM, "no memory for a selection (%zu bytes)", fixed + table);
	s = (struct select *)memory;
	memset(s, 0, sizeof *s);
	s->p = params;
	s->err = err;
	s->table = memory + fixed;
	s->table_bytes = table;
	r = grid_reader_new(params->grid, memory + pipe_round(sizeof *s), reader_bytes, &s->reader, err);
	if (!r)
		r = grid_stage_new(&stage, &s->stage, err);
	if (!r)
		r = run(s);
	if (!r)
		*ret = s->out;
	grid_stage_free(s->stage);
	grid_reader_free(s->reader);
	free(memory);
	return r;
}
