/*
 * Reading a cell: which of its points are added to the chains.
 *
 * An existing chain bounds, column by column, what it can still need, so few points pass. If it has no sites yet, or
 * only far ones, whole cells pass. Beside the side of a survey that would be every cell along it, and each of their
 * points would be inserted into the chain and removed again. So if many points pass, the nearest of each column make a
 * chain of their own first. Its sites are some of all sites, so its E is nowhere below the chain's: points above it are
 * in no halo.
 */
#include "cut_halo_priv.h"

enum {
	STRIP = GRID_CELL_RECORDS, /* points that are processed together */
	NEAR_BITS = 2,             /* log2: how much narrower the columns are than those of `take` */
	NEAR = TAKE_COLUMNS << NEAR_BITS,
};

/* Indexes of the points of a cell that passed for one chain. */
struct passed {
	const struct point *pts;
	uint32_t n;
	uint16_t at[STRIP];
};

static int64_t along(const struct take *t, const struct point *p)
{
	return 2 * (int64_t)(t->across ? p->x : p->y);
}

static int64_t distance(const struct take *t, const struct point *p)
{
	int64_t x = 2 * (int64_t)(t->across ? p->y : p->x) - t->c2;

	return x < 0 ? -x : x;
}

/* One comparison each; few pass. */
static void find_passing(struct cut_halo *h, const struct take *t, const struct point *pts, size_t n, struct passed *ret)
{
	const uint32_t from = (uint32_t)t->from, wide = t->wide;
	const bool by_y = t->across;
	uint32_t m = 0;

	for (size_t i = 0; i < n; i++) {
		int32_t across = by_y ? pts[i].y : pts[i].x;

		if ((uint32_t)across - from > wide ||
		    distance(t, &pts[i]) > t->limit[(uint64_t)(along(t, &pts[i]) - t->u0) >> t->shift] ||
		    (h->own_known && cut_region_holds(&h->region, pts[i].x, pts[i].y)) ||
		    cut_judge(&h->judge, &pts[i]) != VIEW_KEPT)
			continue;
		ret->at[m++] = (uint16_t)i;
	}
	ret->pts = pts;
	ret->n = m;
}

/* The nearest point of each column, or NULL; returns the number of columns. */
static unsigned find_nearest(const struct take *t, const struct passed *p, unsigned shift, const struct point *ret[NEAR])
{
	int64_t least[NEAR];
	unsigned columns = 0;

	for (unsigned k = 0; k < NEAR; k++)
		ret[k] = NULL;
	for (uint32_t i = 0; i < p->n; i++) {
		const struct point *q = &p->pts[p->at[i]];
		unsigned k = (unsigned)((uint64_t)(along(t, q) - t->u0) >> shift);
		int64_t x = distance(t, q);

		columns = k < columns ? columns : k + 1;
		if (ret[k] && least[k] <= x)
			continue;
		ret[k] = q;
		least[k] = x;
	}
	return columns;
}

/* Removes the points above the hull of the nearest ones. */
static int remove_above(const struct cut_halo *h, const struct take *t, struct passed *p)
{
	const struct cut_chain *c = &h->chain[t->chain];
	const unsigned shift = t->shift > NEAR_BITS ? t->shift - NEAR_BITS : 0;
	struct point room[NEAR], batch[NEAR];
	const struct point *some[NEAR];
	unsigned columns = find_nearest(t, p, shift, some);
	struct cut_chain near;
	int64_t limit[NEAR];
	uint32_t m = 0;
	int rc = 0;

	cut_chain_init(&near, c->vertical, c->c2, c->t0, c->t1, room, NEAR, batch, NEAR);
	for (unsigned k = 0; k < columns && !rc; k++)
		rc = some[k] ? cut_chain_add(&near, h->view, some[k]) : 0;
	if (!rc)
		rc = cut_chain_flush(&near, h->view);
	if (rc)
		return rc;
	cut_chain_limits(&near, t->u0, shift, columns, limit);
	for (uint32_t i = 0; i < p->n; i++) {
		const struct point *q = &p->pts[p->at[i]];

		if (distance(t, q) <= limit[(uint64_t)(along(t, q) - t->u0) >> shift])
			p->at[m++] = p->at[i];
	}
	p->n = m;
	return 0;
}

/* Adds the points that a chain needs. */
static int take_needed(struct cut_halo *h, const struct take *t, const struct point *pts, size_t n)
{
	struct passed p;
	int rc = 0;

	for (size_t some; n && !rc; pts += some, n -= some) {
		some = n < STRIP ? n : STRIP;
		find_passing(h, t, pts, some, &p);
		rc = p.n > h->many ? remove_above(h, t, &p) : 0;
		for (uint32_t i = 0; i < p.n && !rc; i++)
			rc = cut_halo_add(h, t->chain, &pts[p.at[i]]);
	}
	return rc;
}

static int take_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct cut_halo *h = ctx;
	int rc = 0;

	(void)err;
	h->points += n;
	for (unsigned i = 0; i < h->ntake && !rc; i++)
		rc = take_needed(h, &h->take[i], pts, n);
	return rc;
}

/* Most points of a cell are farther from the line than any limit. */
static void limit_to_window(struct take *t, const int32_t box[4], unsigned columns)
{
	int64_t most = -1, lo = box[t->across], hi = box[t->across + 2];

	for (unsigned i = 0; i < columns; i++)
		most = t->limit[i] > most ? t->limit[i] : most;
	if (most < (int64_t)1 << 40) {
		int64_t from = (t->c2 - most) / 2 - 1, to = (t->c2 + most) / 2 + 1;

		lo = from > lo ? from : lo;
		hi = to < hi ? to : hi;
	}
	if (lo > hi)
		lo = hi = box[t->across];
	t->from = (int32_t)lo;
	t->wide = (uint32_t)(hi - lo);
}

/* Nor do points matter that are excluded by the sites known from before. */
static void limit_to_bound(const struct cut_chain *bound, struct take *t, unsigned columns)
{
	int64_t limit[TAKE_COLUMNS];

	cut_chain_limits(bound, t->u0, t->shift, columns, limit);
	for (unsigned k = 0; k < columns; k++)
		t->limit[k] = limit[k] < t->limit[k] ? limit[k] : t->limit[k];
}

/* Hulls only get lower, so what a chain does not need before the cell is read it will not need later. */
static void find_limits(struct cut_halo *h, const struct grid_cell *cell)
{
	h->ntake = 0;
	for (unsigned i = 0; i < h->nchain; i++) {
		const struct cut_chain *c = &h->chain[i];
		struct take *t = &h->take[h->ntake];
		unsigned columns;
		int64_t u1, x;

		if (!cut_halo_hit(h, i, cell->box))
			continue;
		*t = (struct take){.chain = i, .across = c->vertical ? 0 : 1, .c2 = c->c2};
		cut_chain_span(c, cell->box, &t->u0, &u1, &x);
		while ((u1 - t->u0) >> t->shift >= TAKE_COLUMNS)
			t->shift++;
		columns = (unsigned)((u1 - t->u0) >> t->shift) + 1;
		cut_chain_limits(c, t->u0, t->shift, columns, t->limit);
		if (h->bounded)
			limit_to_bound(&h->bound[i], t, columns);
		limit_to_window(t, cell->box, columns);
		h->ntake++;
	}
}

int cut_halo_read(struct cut_halo *h, const struct grid_cell *cell, struct err *err)
{
	h->cells++;
	find_limits(h, cell);
	return h->src.read(h->src.ctx, cell, take_points, h, err);
}
