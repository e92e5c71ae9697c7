/*
 * Bounds of halos from boxes. Every side of a tight box has a point on it. So, seen along a border, at either end of a
 * box there is a point no farther from the border than the box's far side; the far corners stand for points that are at
 * least as near. A hull of such corners is nowhere below the hull of the points. So every cell that contains a site of
 * the halo is a hit against it.
 *
 * Subtrees of the index have tight boxes, too. Several walks, each to smaller subtrees than the previous one, lower the
 * hull before many cells are visited. Corners for which there is no memory are omitted; that only loosens the bound.
 */
#include "cut_bound.h"

#include <string.h>

#include "cut_chain.h"

enum { CHAIN = 4096, BATCH = 512, FINER = 64 };

struct bound {
	const struct view *view;
	struct cut_range range[4];
	unsigned nrange, nchain;
	struct cut_chain chain[4];
	uint64_t least; /* subtrees with no more records are not entered */
	uint64_t sum;   /* positions of hits that were not entered */
	uint64_t total; /* records of the largest subtree seen */
	struct point pt[4][CHAIN], batch[4][BATCH];
};

size_t cut_bound_bytes(void)
{
	return sizeof(struct bound);
}

static void add(struct bound *b, unsigned i, const struct point *p)
{
	if (cut_chain_add(&b->chain[i], b->view, p))
		b->chain[i].nbatch = 0;
}

static void flush(struct bound *b)
{
	for (unsigned i = 0; i < b->nchain; i++)
		if (cut_chain_flush(&b->chain[i], b->view))
			b->chain[i].nbatch = 0;
}

static void add_corners(struct bound *b, const int32_t box[4])
{
	for (unsigned i = 0; i < b->nchain; i++) {
		const struct cut_chain *c = &b->chain[i];
		struct point low = {.x = box[0], .y = box[1]}, high = {.x = box[2], .y = box[3]};
		bool low_far = cut_chain_x(c, &low) > cut_chain_x(c, &high);

		if (c->vertical)
			low.x = high.x = low_far ? low.x : high.x;
		else
			low.y = high.y = low_far ? low.y : high.y;
		add(b, i, &low);
		add(b, i, &high);
	}
}

static bool inside(const struct bound *b, const struct grid_cell *cell)
{
	for (unsigned i = 0; i < b->nrange; i++)
		if (cell->lo >= b->range[i].lo && cell->hi <= b->range[i].hi)
			return true;
	return false;
}

static bool matters(const struct bound *b, const struct grid_cell *cell)
{
	if (cell->count == 0 || inside(b, cell))
		return false;
	for (unsigned i = 0; i < b->nchain; i++)
		if (cut_chain_hit(&b->chain[i], cell->box))
			return true;
	return false;
}

static int take(struct bound *b, const struct grid_cell *cell)
{
	b->sum += cell->distinct < cell->count ? cell->distinct : cell->count;
	add_corners(b, cell->box);
	return 0;
}

static bool own_segment(void *ctx, const struct grid_cell *whole)
{
	const struct bound *b = ctx;
	bool any = false;

	for (unsigned i = 0; i < b->nrange; i++)
		any = any || (whole->lo <= b->range[i].hi && whole->hi >= b->range[i].lo);
	return any;
}

static int own_cell(void *ctx, const struct grid_cell *cell)
{
	if (cell->count && inside(ctx, cell))
		add_corners(ctx, cell->box);
	return 0;
}

static bool outer_enter(void *ctx, const struct grid_cell *subtree)
{
	struct bound *b = ctx;

	if (!matters(b, subtree))
		return false;
	b->total = subtree->count > b->total ? subtree->count : b->total;
	if (subtree->count > b->least)
		return true;
	take(b, subtree);
	return false;
}

static bool outer_segment(void *ctx, const struct grid_cell *whole)
{
	return matters(ctx, whole);
}

static int outer_cell(void *ctx, const struct grid_cell *cell)
{
	return matters(ctx, cell) ? take(ctx, cell) : 0;
}

static void add_chain(struct bound *b, bool vertical, int64_t c2, int64_t t0, int64_t t1)
{
	unsigned i = b->nchain;

	if (c2 == INT64_MIN || c2 == INT64_MAX)
		return;
	cut_chain_init(&b->chain[i], vertical, c2, t0, t1, b->pt[i], CHAIN, b->batch[i], BATCH);
	b->nchain++;
}

static int outer_walk(struct bound *b, const struct cut_source *src, uint64_t least, struct err *err)
{
	const struct grid_visitor v = {.ctx = b, .segment = outer_segment, .enter = outer_enter, .cell = outer_cell};
	int rc;

	b->least = least;
	b->sum = 0;
	rc = src->walk(src->ctx, 0, UINT64_MAX, &v, err);
	flush(b);
	return rc;
}

int cut_bound_halo(const struct cut_source *src, const struct view *view, const struct cut_region *region, uint64_t enough,
		   void *scratch, uint64_t *ret, struct err *err)
{
	const struct grid_visitor own = {.ctx = scratch, .segment = own_segment, .cell = own_cell};
	struct bound *b = scratch;
	uint64_t least = UINT64_MAX;
	int64_t box[4];
	int rc = 0;

	memset(b, 0, offsetof(struct bound, pt));
	b->view = view;
	b->nrange = cut_region_ranges(region, b->range);
	cut_region_box(region, box);
	add_chain(b, true, box[0], box[1], box[3]);
	add_chain(b, true, box[2], box[1], box[3]);
	add_chain(b, false, box[1], box[0], box[2]);
	add_chain(b, false, box[3], box[0], box[2]);
	for (unsigned i = 0; i < b->nrange && !rc; i++)
		rc = src->walk(src->ctx, b->range[i].lo, b->range[i].hi, &own, err);
	flush(b);
	while (!rc) {
		rc = outer_walk(b, src, least, err);
		if (rc || b->sum <= enough || least == 0)
			break;
		least = least == UINT64_MAX ? b->total / FINER : least / FINER;
	}
	/* Again, against the hull that the cells themselves have lowered. */
	if (!rc && b->sum > enough)
		rc = outer_walk(b, src, 0, err);
	if (!rc)
		*ret = b->nchain ? b->sum : 0;
	return rc;
}
