/*
 * The plan of a window: pieces that fit an arena each, in the order of the plane's halvings. A region is as small as its
 * piece allows, so that each halving divides a piece, and parts of the plane without a piece are no leaves. The index
 * gives the need of a piece: the positions of all cells that meet it. Halving may not reduce the need, where many
 * segments have large cells: the halves together then read many times what the whole does. Such a piece is not halved
 * here, but when it is found not to fit.
 *
 * A window that would fit one arena is divided further, so that all threads have work. What is read around each piece is
 * read once more then, so pieces get no smaller than that pays.
 */
#include <math.h>
#include <string.h>

#include "window_area.h"

enum { STACK = 72, WASTE = 4 };
enum { EMPTY = 8 }; /* most halvings in a row that leave a half without positions, above a piece that would fit */
/* Positions of a piece that is worth a thread of its own; with so many, what is read around it no longer counts. */
enum { SHARE_LEAST = 1 << 14, SHARE_WIDE = 1 << 17 };

struct part {
	struct cut_leaf leaf;
	double waste; /* log2 of the factor by which the halvings above it increased the positions read */
};

struct sum {
	const struct window_piece *window;
	uint64_t positions;
};

static bool sum_enter(void *ctx, const struct grid_cell *subtree)
{
	const struct sum *s = ctx;

	return subtree->count > 0 && window_piece_meets_box(s->window, subtree->box);
}

static int sum_cell(void *ctx, const struct grid_cell *cell)
{
	struct sum *s = ctx;

	if (cell->count && window_piece_meets_box(s->window, cell->box))
		s->positions += cell->distinct < cell->count ? cell->distinct : cell->count;
	return 0;
}

int window_positions(const struct cut_source *src, const struct window_piece *window, uint64_t *ret, struct err *err)
{
	struct sum s = {.window = window};
	const struct grid_visitor v = {.ctx = &s, .enter = sum_enter, .cell = sum_cell};
	int r = src->walk(src->ctx, 0, UINT64_MAX, &v, err);

	*ret = s.positions;
	return r;
}

/* The leaf of a region. *ret_any false: it has no piece. */
static int leaf_of(const struct cut_source *src, const struct view *view, const int32_t data[4], const struct cut_region *region,
		   struct cut_leaf *ret, bool *ret_any, struct err *err)
{
	struct window_piece window;

	*ret = (struct cut_leaf){.region = *region};
	*ret_any = window_piece_init(&window, view, data, region);
	if (!*ret_any)
		return 0;
	window_piece_tighten(&window, &ret->region);
	return window_positions(src, &window, &ret->count, err);
}

/*
 * Pushes the halves of a piece, the lower one on top; of a half that has all of its positions, the halves of that. A half without
 * positions reads about as much as one with many, and two clusters far from each other would have dozens of them before one is
 * divided. *ret false: there would be more than `empty`, and nothing was pushed.
 */
static int halve(const struct cut_source *src, const struct view *view, const int32_t data[4], const struct part *whole,
		 unsigned empty, struct part *stack, unsigned *n, bool *ret, struct err *err)
{
	unsigned at = *n, top = at + 1;
	struct cut_region half[2];
	uint64_t sum;
	bool any;

	*ret = false;
	stack[at] = *whole;
	for (unsigned i = 0; i <= empty && !*ret && cut_region_split(&stack[at].leaf.region, half); i++) {
		memmove(stack + at + 2, stack + at + 1, (top++ - at - 1) * sizeof *stack);
		stack[at + 1].waste = whole->waste;
		for (unsigned k = 0; k < 2; k++) {
			int r = leaf_of(src, view, data, &half[k], &stack[at + !k].leaf, &any, err);

			if (r)
				return r;
		}
		*ret = stack[at].leaf.count && stack[at + 1].leaf.count;
		at += !stack[at].leaf.count;
	}
	if (!*ret)
		return 0;
	*n = top;
	sum = stack[at].leaf.count + stack[at + 1].leaf.count;
	for (unsigned k = 0; k < 2 && sum > whole->leaf.count; k++)
		stack[at + k].waste += log2((double)sum / (double)whole->leaf.count);
	return 0;
}

static uint64_t smaller(uint64_t a, uint64_t b)
{
	return a < b ? a : b;
}

static uint64_t larger(uint64_t a, uint64_t b)
{
	return a > b ? a : b;
}

/*
 * The most positions of a piece. Halves differ in size, and to halve the larger one costs more than it gains if the window is
 * small: what is read twice is a greater part. A large window has several pieces a thread.
 */
static uint64_t piece_most(uint64_t all, uint64_t fits, unsigned pieces)
{
	if (pieces < 2)
		return fits;
	all = smaller(2 * all / (pieces + 1), larger(all / (4 * pieces), SHARE_WIDE));
	return smaller(larger(all, SHARE_LEAST), fits);
}

int window_plan_from(const struct cut_source *src, const struct view *view, uint32_t cap, unsigned pieces, struct cut_plan *ret,
		     struct err *err)
{
	const uint64_t fits = cap - cap / 4; /* the rest is for the points read around a piece */
	const struct cut_region plane = window_piece_plane();
	struct cut_plan plan = {.ledger = src->ledger};
	struct part stack[STACK];
	int32_t data[4];
	unsigned n = 0;
	bool any = false;
	uint64_t most;
	int r = 0;

	stack[0] = (struct part){0};
	if (src->box(src->ctx, data))
		r = leaf_of(src, view, data, &plane, &stack[0].leaf, &any, err);
	n = any;
	most = piece_most(stack[0].leaf.count, fits, pieces);
	while (n > 0 && !r) {
		struct part part = stack[--n];
		bool halved = false;

		if (part.leaf.count > most && part.waste < WASTE)
			r = halve(src, view, data, &part, part.leaf.count > fits ? STACK : EMPTY, stack, &n, &halved, err);
		if (r || halved)
			continue;
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

int window_plan(struct grid_reader *reader, const struct view *view, uint32_t cap, unsigned pieces, struct cut_plan *ret,
		struct err *err)
{
	struct cut_source src;

	cut_source_grid(reader, &src);
	return window_plan_from(&src, view, window_cap_of(grid_reader_grid(reader), cap), pieces, ret, err);
}

void window_tighten(const struct grid *grid, const struct view *view, struct cut_region *region)
{
	struct window_piece piece;
	int32_t data[4];

	if (grid_box(grid, data) && window_piece_init(&piece, view, data, region))
		window_piece_tighten(&piece, region);
}
