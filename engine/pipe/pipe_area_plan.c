/*
 * The plan of a window: the pieces of it that fit an arena each, in the order of the plane's halvings. Regions are as
 * small as their pieces let them be, so that each halving cuts a piece, and parts of the plane without one are no
 * leaves. What a piece needs is told by the index: the positions of all cells that meet it. Where halving does not
 * bring that down (many segments have large cells here), so that the halves together read many times what the whole does, it
 * stays whole, and is halved further when it is found not to fit.
 */
#include <math.h>
#include <string.h>

#include "err.h"
#include "pipe.h"
#include "pipe_area.h"
#include "pipe_priv.h"

enum { STACK = 72, WASTE = 4 };

struct part {
	struct cut_leaf leaf;
	double waste; /* by how much all halvings above it have added to what is read, as a power of two */
};

struct sum {
	struct pipe_window window;
	uint64_t positions;
	bool exact;
};

static bool sum_enter(void *ctx, const struct grid_cell *subtree)
{
	const struct sum *s = ctx;

	return subtree->count > 0 && pipe_window_has_box(&s->window, subtree->box);
}

static int sum_cell(void *ctx, const struct grid_cell *cell)
{
	struct sum *s = ctx;

	if (cell->count && pipe_window_has_box(&s->window, cell->box))
		s->positions += cell->distinct < cell->count ? cell->distinct : cell->count;
	return 0;
}

/* The leaf of a region; *ret_any false: it has no piece. */
static int leaf_of(const struct cut_source *src, const struct view *view, const int32_t data[4], const struct cut_region *region,
		   struct cut_leaf *ret, bool *ret_any, struct err *err)
{
	struct sum s = {0};
	const struct grid_visitor v = {.ctx = &s, .enter = sum_enter, .cell = sum_cell};
	int r = 0;

	*ret = (struct cut_leaf){.region = *region};
	*ret_any = pipe_window_init(&s.window, view, data, region);
	if (*ret_any) {
		pipe_window_tighten(&s.window, &ret->region);
		r = src->walk(src->ctx, 0, UINT64_MAX, &v, err);
		ret->count = s.positions;
	}
	return r;
}

/* The halves of a part that have a piece, onto the stack; the lower one on top. */
static int halve(const struct cut_source *src, const struct view *view, const int32_t data[4], const struct part *whole,
		 const struct cut_region half[2], struct part *stack, unsigned *n, struct err *err)
{
	uint64_t sum = 0;
	unsigned first = *n;

	for (unsigned k = 2; k-- > 0;) {
		struct part part = {.waste = whole->waste};
		bool any;
		int r = leaf_of(src, view, data, &half[k], &part.leaf, &any, err);

		if (r)
			return r;
		sum += part.leaf.count;
		if (any)
			stack[(*n)++] = part;
	}
	for (unsigned i = first; i < *n; i++)
		if (sum > whole->leaf.count)
			stack[i].waste += log2((double)sum / (double)whole->leaf.count);
	return 0;
}

int pipe_area_plan_from(const struct cut_source *src, const struct view *view, uint32_t cap, struct cut_plan *ret,
			struct err *err)
{
	const struct cut_region plane = pipe_window_plane();
	struct cut_plan plan = {.ledger = src->ledger};
	struct part stack[STACK];
	struct cut_region half[2];
	int32_t data[4];
	unsigned n = 0;
	bool any = false;
	int r = 0;

	stack[0] = (struct part){0};
	if (src->box(src->ctx, data))
		r = leaf_of(src, view, data, &plane, &stack[0].leaf, &any, err);
	n = any;
	while (n > 0 && !r) {
		struct part part = stack[--n];

		/* A quarter is left for what is read around it. */
		if (part.leaf.count > cap - cap / 4 && part.waste < WASTE && cut_region_split(&part.leaf.region, half)) {
			r = halve(src, view, data, &part, half, stack, &n, err);
			continue;
		}
		r = cut_plan_room(&plan, plan.n + 1, err);
		if (!r)
			plan.leaf[plan.n++] = part.leaf;
	}
	if (r)
		cut_plan_done(&plan);
	else
		*ret = plan;
	return r;
}

int pipe_area_plan(struct grid_reader *reader, const struct view *view, uint32_t cap, struct cut_plan *ret, struct err *err)
{
	struct cut_source src;

	cut_source_grid(reader, &src);
	return pipe_area_plan_from(&src, view, pipe_area_cap(cap), ret, err);
}

int pipe_plan_split(struct cut_plan *plan, size_t i, struct grid_reader *reader, const struct view *view, uint64_t need,
		    uint32_t cap, struct err *err)
{
	struct pipe_window window;
	int32_t data[4];
	int r = cut_plan_split(plan, i, reader, need, view->window ? pipe_area_cap(cap) : cap, err);

	if (r || !view->window || !grid_box(grid_reader_grid(reader), data))
		return r;
	for (unsigned k = 0; k < 2; k++)
		if (pipe_window_init(&window, view, data, &plan->leaf[i + k].region))
			pipe_window_tighten(&window, &plan->leaf[i + k].region);
	return 0;
}
