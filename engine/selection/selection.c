/*
 * Selections: the points that a view with crop, every or thin keeps become a grid of their own.
 *
 * One walk over the index of the source grid. Subtrees and cells outside the crop are not read. The kept points go into
 * a stage, as one source; the stage seals a segment, and a manifest on the same lattice names it. With a thin rule the
 * walk is divided into rectangles of whole thin cells (selection_thin.c). The memory is [struct selection | buffers of
 * the reader | table of thin cells], and the stage's own part.
 *
 * The counts are exact although points outside the crop are not read. The crop is the first rule (view.h): a point
 * outside it counts as cropped, even if another rule would remove it, too. So the number of cropped points is the
 * number of live records of the generation, which the grid knows, minus the records read, plus those of the records
 * read that are outside. This depends on the points alone, not on the cells. Without a crop every live record is read,
 * and the sum is checked.
 *
 * Vertices of lines are records of a second source, of which only the crop removes some; what lines remove is marked in the
 * records that are read (grid.h), and is not selected. The pieces stay in the file of the generation, unless a metric maps them
 * (selection_map.c).
 *
 * Duplicates are not reduced here (the mesh does that), and sources are not kept apart, but for the slots of weights: each slot
 * becomes a source. After a failure the caller removes the folder.
 */
#include "selection_priv.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "align.h"
#include "err.h"
#include "grid_stage.h"

#define PROGRESS_POINTS (1u << 18)

/* For the text of the manifest and the stage's list of runs. */
enum { SMALL_BYTES = 16 << 10 };

static size_t fixed_bytes(const struct grid *grid)
{
	return align_line(sizeof(struct selection)) + align_line(grid_reader_bytes(grid));
}

/* Beside fixed_bytes, the stage and the table. */
static size_t other_bytes(const struct grid *grid, const struct view *view)
{
	return SMALL_BYTES + selection_map_bytes(grid, view);
}

size_t selection_memory_min(const struct grid *grid, const struct view *view)
{
	return fixed_bytes(grid) + SELECTION_TABLE_MIN + GRID_STAGE_MIN + other_bytes(grid, view);
}

/* ---- a point ---- */

/* SELECTION_LINES is the file of the second. SOURCE_SLOTS + k is that of slot k. */
enum { SOURCE_POINTS = 1, SOURCE_LINES = 2, SOURCE_SLOTS = 2 };

/* The sources with a slot, as ranges of one. */
#define SLOT(k)                                             \
	{                                                   \
		SOURCE_SLOTS + (k), SOURCE_SLOTS + (k), (k) \
	}
#define SLOTS_4(k) SLOT(k), SLOT((k) + 1), SLOT((k) + 2), SLOT((k) + 3)
static const struct slots_range slot_sources[] = {
	SLOTS_4(1), SLOTS_4(5), SLOTS_4(9), SLOTS_4(13), SLOTS_4(17), SLOTS_4(21), SLOTS_4(25), SLOT(29), SLOT(30), SLOT(31),
};
_Static_assert(sizeof slot_sources / sizeof *slot_sources == SLOTS_MOST, "each slot has a source");
const struct slots selection_slots = {slot_sources, SLOTS_MOST};

static int stage_points(struct selection *s, const struct point *pts, size_t n, unsigned slot)
{
	int r = slot ? grid_stage_source(s->stage, SOURCE_SLOTS + slot, s->err) : 0;

	s->of_slot[slot] += n;
	if (n && !r)
		r = grid_stage_add(s->stage, pts, n, s->err);
	return slot && !r ? grid_stage_source(s->stage, SOURCE_POINTS, s->err) : r;
}

static int flush_points(struct selection *s)
{
	uint32_t slots = 0;
	int r = 0;

	for (size_t i = 0; i < s->nbatch; i++)
		slots |= UINT32_C(1) << point_slot(&s->batch[i]);
	for (unsigned slot = 0; !r && slots >> slot; slot++) {
		size_t n = 0;

		for (size_t i = 0; (slots >> slot & 1) && i < s->nbatch; i++)
			if (point_slot(&s->batch[i]) == slot)
				s->part[n++] = s->batch[i];
		if (n)
			r = stage_points(s, s->part, n, slot);
		if (slot == SLOTS_MOST)
			break;
	}
	s->out.kept += s->nbatch;
	s->nbatch = 0;
	return r;
}

static int flush_lines(struct selection *s)
{
	size_t n = s->nline;
	int r = n ? grid_stage_source(s->stage, SOURCE_LINES, s->err) : 0;

	s->nline = 0;
	s->out.kept += n;
	s->lines += n;
	if (n && !r)
		r = grid_stage_add(s->stage, s->line, n, s->err);
	return n && !r ? grid_stage_source(s->stage, SOURCE_POINTS, s->err) : r;
}

int selection_keep(struct selection *s, const struct point *p)
{
	if (p->tag & POINT_LINE) {
		s->line[s->nline] = *p;
		s->line[s->nline].tag &= POINT_FLAGS;
		selection_map_point(s, &s->line[s->nline++]);
		return s->nline == SELECTION_BATCH ? flush_lines(s) : 0;
	}
	s->batch[s->nbatch] = *p;
	selection_map_point(s, &s->batch[s->nbatch++]);
	return s->nbatch == SELECTION_BATCH ? flush_points(s) : 0;
}

int selection_progress(struct selection *s)
{
	if (!s->p->progress || s->seen - s->reported < PROGRESS_POINTS)
		return 0;
	s->reported = s->seen;
	if (s->p->progress(s->p->ctx, s->judged))
		return err_set(s->err, ERR_CANCELLED, "the selection was cancelled");
	return 0;
}

/* ---- without a thin rule: one walk ---- */

static bool enter_subtree(void *ctx, const struct grid_cell *subtree)
{
	const struct selection *s = ctx;

	return view_may_hold(s->p->view, subtree->box);
}

static int judge_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct selection *s = ctx;
	int r = 0;

	(void)err;
	for (size_t i = 0; !r && i < n; i++) {
		enum view_rule rule = view_judge(s->p->view, &pts[i]);

		if (rule == VIEW_KEPT)
			r = selection_keep(s, &pts[i]);
		else
			s->out.removed[rule]++;
	}
	s->judged += n;
	s->seen += n;
	return r ? r : selection_progress(s);
}

static int visit_cell(void *ctx, const struct grid_cell *cell)
{
	struct selection *s = ctx;

	if (!view_may_hold(s->p->view, cell->box))
		return 0;
	return grid_cell_read(s->reader, cell, judge_points, s, s->err);
}

/* ---- the selection ---- */

static size_t sources_of(const struct selection *s, struct grid_source ret[SOURCE_SLOTS + SLOTS_MOST])
{
	const struct grid_source *lines = grid_lines_source(s->p->grid);
	size_t n = 0;

	ret[n++] = (struct grid_source){.id = SOURCE_POINTS, .added = 1, .points = s->of_slot[0], .name = "selection"};
	if (s->lines)
		ret[n++] = (struct grid_source){.id = SOURCE_LINES,
						.added = 1,
						.points = s->lines,
						.kind = GRID_LINE_VERTICES,
						.lines = lines ? lines->lines : NULL};
	for (unsigned k = 1; k <= SLOTS_MOST; k++)
		if (s->of_slot[k])
			ret[n++] = (struct grid_source){
				.id = SOURCE_SLOTS + k, .added = 1, .points = s->of_slot[k], .name = "selection"};
	return n;
}

static int publish(struct selection *s, const struct grid_segment_info *info)
{
	const struct grid_manifest *from = grid_manifest(s->p->grid);
	struct grid_segment_info segment = *info;
	struct grid_source source[SOURCE_SLOTS + SLOTS_MOST];
	struct grid_manifest m = {
		.lattice = from->lattice,
		.generation = 1,
		.segments = &segment,
		.nsegments = 1,
		.sources = source,
		.nsources = sources_of(s, source),
	};
	int r;

	memcpy(m.crs, from->crs, sizeof m.crs);
	memcpy(m.unit_xy, from->unit_xy, sizeof m.unit_xy);
	memcpy(m.unit_z, from->unit_z, sizeof m.unit_z);
	r = selection_counts_write(s->p->dirfd, &s->out, s->err);
	return r ? r : grid_manifest_write(s->p->dirfd, SELECTION_MANIFEST, &m, s->err);
}

/* Records that were not read are outside the crop. */
static int count_rest(struct selection *s)
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

static int run(struct selection *s)
{
	const struct grid_visitor visitor = {s, enter_subtree, visit_cell};
	struct grid_segment_info info;
	int r = selection_map(s);

	if (!r)
		r = grid_stage_source(s->stage, SOURCE_POINTS, s->err);
	if (r)
		return r;
	if (s->p->view->thin.cell)
		r = selection_thin(s);
	else
		r = grid_walk(s->reader, 0, UINT64_MAX, &visitor, s->err);
	if (!r)
		r = flush_points(s);
	if (!r)
		r = flush_lines(s);
	if (!r)
		r = count_rest(s);
	if (!r)
		r = grid_stage_seal(s->stage, &info, s->err);
	return r ? r : publish(s, &info);
}

int selection_make(const struct selection_params *params, struct selection_counts *ret, struct err *err)
{
	size_t fixed = fixed_bytes(params->grid), reader_bytes = grid_reader_bytes(params->grid), rest, table = 0;
	struct grid_stage_params stage = {.dirfd = params->dirfd, .name = "selection"};
	struct selection *s;
	uint8_t *memory;
	int r;

	if (params->memory < selection_memory_min(params->grid, params->view))
		return err_set(err, ERR_LIMIT, "a selection needs %zu bytes of memory, not %zu",
			       selection_memory_min(params->grid, params->view), params->memory);
	rest = params->memory - fixed - other_bytes(params->grid, params->view);
	/* A thin rule keeps few points, so its table, which sees all of them, gets the larger part. */
	if (params->view->thin.cell)
		table = (rest / 3 > GRID_STAGE_MIN ? rest - rest / 3 : rest - GRID_STAGE_MIN) & ~(size_t)(ALIGN_LINE - 1);
	stage.memory = rest - table;
	memory = aligned_alloc(ALIGN_LINE, fixed + table);
	if (!memory)
		return err_set(err, ERR_NOMEM, "no memory for a selection (%zu bytes)", fixed + table);
	s = (struct selection *)memory;
	memset(s, 0, sizeof *s);
	s->p = params;
	s->err = err;
	s->table = memory + fixed;
	s->table_bytes = table;
	r = grid_reader_new(params->grid, memory + align_line(sizeof *s), reader_bytes, &s->reader, err);
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
