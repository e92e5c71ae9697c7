/*
 * Traces (cut_valid.h): the sites of a region's border chains, and the ranges of Morton keys that they can see.
 */
#include "cut_trace_priv.h"

#include <stdlib.h>
#include <string.h>

#include "cut_chain.h"
#include "cut_source.h"

void cut_trace_init(struct cut_trace *t, void *memory)
{
	*t = (struct cut_trace){.range = memory,
				.most_ranges = CUT_TRACE_RANGES,
				.most_sites = CUT_TRACE_SITES,
				.lines = {.box = CUT_BOX_EMPTY, .disc = CUT_BOX_EMPTY}};
	t->site = (struct point *)(t->range + CUT_TRACE_RANGES + CUT_TRACE_OWN);
}

void cut_trace_sites(struct cut_trace *t, const struct cut_chain *chain, unsigned n)
{
	struct point *at = t->site;

	memset(t->nsite, 0, sizeof t->nsite);
	for (unsigned i = 0; i < n; i++) {
		uint32_t all = chain[i].n, some = all < t->most_sites ? all : t->most_sites;

		/* Includes the first and the last site: beyond them E is a ray, or infinite. */
		for (uint32_t k = 0; k < some; k++)
			*at++ = chain[i].pt[some < all ? (uint64_t)k * (all - 1) / (some - 1) : k];
		t->nsite[i] = some;
	}
}

unsigned cut_trace_borders(const struct cut_region *region, struct cut_chain ret[4])
{
	static const unsigned order[4] = {0, 2, 1, 3};
	unsigned n = 0;
	int64_t box[4];

	cut_region_box(region, box);
	for (unsigned k = 0; k < 4; k++) {
		unsigned side = order[k], beside = 1 - (side & 1);

		if (box[side] == INT64_MIN || box[side] == INT64_MAX)
			continue;
		cut_chain_init(&ret[n++], !(side & 1), box[side], box[beside], box[beside + 2], NULL, 0, NULL, 0);
	}
	return n;
}

unsigned cut_trace_chains(const struct cut_trace *t, const struct cut_region *region, struct cut_chain ret[4])
{
	unsigned n = cut_trace_borders(region, ret);
	struct point *at = t->site;

	for (unsigned i = 0; i < n; at += t->nsite[i++])
		cut_chain_of(&ret[i], at, t->nsite[i]);
	return n;
}

void cut_chains_survey(struct cut_chain *chain, unsigned n)
{
	for (unsigned i = 0; i < n; i++)
		cut_chain_survey(&chain[i]);
}

bool cut_chains_hit(const struct cut_chain *chain, unsigned n, const int32_t box[4])
{
	for (unsigned i = 0; i < n; i++)
		if (cut_chain_hit(&chain[i], box))
			return true;
	return false;
}

/* ---- ranges ---- */

void cut_box_keys(const int32_t box[4], uint64_t *ret_lo, uint64_t *ret_hi)
{
	*ret_lo = point_morton(box[0], box[1]);
	*ret_hi = point_morton(box[2], box[3]);
}

const struct grid_sum *cut_trace_find(const struct cut_trace *t, uint64_t from)
{
	size_t i = grid_sum_find(t->range, t->nrange, from);

	return i < t->nrange ? &t->range[i] : NULL;
}

bool cut_trace_contains(const struct cut_trace *t, uint64_t from, uint64_t to)
{
	const struct grid_sum *r = cut_trace_find(t, from);

	return r && r->lo <= from && to <= r->hi;
}

static int range_order(const void *a, const void *b)
{
	const struct grid_sum *x = a, *y = b;

	return x->lo < y->lo ? -1 : x->lo > y->lo;
}

/* Makes the ranges ascending, disjoint and not adjacent. */
static void unite(struct cut_trace *t)
{
	uint32_t k = 0;

	qsort(t->range, t->nrange, sizeof *t->range, range_order);
	for (uint32_t i = 0; i < t->nrange; i++) {
		const struct grid_sum r = t->range[i];

		if (k > 0 && (t->range[k - 1].hi == UINT64_MAX || r.lo <= t->range[k - 1].hi + 1)) {
			if (r.hi > t->range[k - 1].hi)
				t->range[k - 1].hi = r.hi;
		} else {
			t->range[k++] = r;
		}
	}
	t->nrange = k;
}

struct listing {
	struct cut_cover cover;
	struct cut_range own[4];
	unsigned nown, nchain;
	struct cut_chain chain[4];
};

static void widen(struct grid_sum *r, uint64_t mask)
{
	r->lo &= ~mask;
	r->hi |= mask;
}

static void coarsen(struct cut_cover *l)
{
	struct cut_trace *t = l->trace;

	unite(t);
	/* To three quarters, or it would be full again at once: four neighbours become one. */
	while (t->nrange > t->most_ranges / 4 * 3) {
		l->mask = l->mask << 2 | 3;
		for (uint32_t i = 0; i < t->nrange; i++)
			widen(&t->range[i], l->mask);
		unite(t);
	}
}

static void add_range(struct cut_cover *l, uint64_t lo, uint64_t hi)
{
	struct cut_trace *t = l->trace;
	struct grid_sum r = {.lo = lo, .hi = hi};

	if (t->nrange >= t->most_ranges)
		coarsen(l);
	widen(&r, l->mask);
	t->range[t->nrange++] = r;
}

static bool in_region(const struct listing *l, uint64_t lo, uint64_t hi)
{
	for (unsigned i = 0; i < l->nown; i++)
		if (l->own[i].lo <= lo && hi <= l->own[i].hi)
			return true;
	return false;
}

static bool can_see(const struct listing *l, const struct grid_cell *cell, uint64_t *ret_lo, uint64_t *ret_hi)
{
	cut_box_keys(cell->box, ret_lo, ret_hi);
	return cell->count && !in_region(l, *ret_lo, *ret_hi) && cut_chains_hit(l->chain, l->nchain, cell->box);
}

static bool listing_enter(void *ctx, const struct grid_cell *subtree)
{
	uint64_t lo, hi;

	return can_see(ctx, subtree, &lo, &hi);
}

static int listing_cell(void *ctx, const struct grid_cell *cell)
{
	struct listing *l = ctx;
	uint64_t lo, hi, mask = 0;

	if (!can_see(ctx, cell, &lo, &hi))
		return 0;
	/* The smallest aligned range around it, so that ranges of neighbours are adjacent. */
	while ((lo ^ hi) & ~mask)
		mask = mask << 2 | 3;
	add_range(&l->cover, lo & ~mask, hi | mask);
	return 0;
}

static void record_live(struct cut_trace *t, const struct cut_source *src)
{
	struct cut_segment segment[CUT_TRACE_PARTS];
	size_t n = src->parts ? src->parts(src->ctx, t->live.part, segment, CUT_TRACE_PARTS) : 0;

	t->live.n = n <= CUT_TRACE_PARTS ? (uint32_t)n : 0;
	t->live.lines = src->lines ? src->lines(src->ctx) : (struct digest){0, 0};
}

int cut_trace_ranges(struct cut_trace *t, const struct cut_source *src, const struct cut_region *region, struct err *err)
{
	struct listing l = {.cover.trace = t};
	const struct grid_visitor v = {.ctx = &l, .segment = listing_enter, .enter = listing_enter, .cell = listing_cell};
	int rc;

	record_live(t, src);
	l.nown = cut_region_ranges(region, l.own);
	l.nchain = cut_trace_chains(t, region, l.chain);
	cut_chains_survey(l.chain, l.nchain);
	t->nrange = 0;
	rc = src->walk(src->ctx, 0, UINT64_MAX, &v, err);
	if (rc)
		return rc;
	unite(t);
	for (unsigned i = 0; i < l.nown; i++)
		t->range[t->nrange++] = (struct grid_sum){.lo = l.own[i].lo, .hi = l.own[i].hi};
	unite(t);
	return src->sums(src->ctx, t->range, t->nrange, err);
}

static bool is_recent(struct cut_cover *c, const uint32_t at[4])
{
	for (unsigned i = 0; i < c->nrecent; i++) {
		const uint32_t *r = c->recent[i];

		if (r[0] <= at[0] && r[1] <= at[1] && r[2] >= at[2] && r[3] >= at[3])
			return true;
	}
	return false;
}

static void remember(struct cut_cover *c, const uint32_t at[4], unsigned k)
{
	const uint32_t low = (UINT32_C(1) << k) - 1;
	uint32_t *r = c->recent[c->next++ % CUT_COVER_RECENT];

	for (unsigned i = 0; i < 4; i++)
		r[i] = i < 2 ? at[i] & ~low : at[i] | low;
	c->nrecent += c->nrecent < CUT_COVER_RECENT;
}

/* By at most nine aligned squares. */
void cut_cover_box(struct cut_cover *c, const int32_t box[4])
{
	const uint32_t bias = 0x80000000u;
	uint32_t at[4];
	unsigned k = 0;

	for (unsigned i = 0; i < 4; i++)
		at[i] = (uint32_t)box[i] ^ bias;
	if (is_recent(c, at))
		return;
	while ((at[2] >> k) - (at[0] >> k) > 2 || (at[3] >> k) - (at[1] >> k) > 2)
		k++;
	remember(c, at, k);
	/* The last one may be the last of the lattice. */
	for (uint64_t x = at[0] >> k; x <= at[2] >> k; x++)
		for (uint64_t y = at[1] >> k; y <= at[3] >> k; y++) {
			uint64_t lo = point_morton((int32_t)((uint32_t)(x << k) ^ bias), (int32_t)((uint32_t)(y << k) ^ bias));

			add_range(c, lo, lo | ((UINT64_C(1) << 2 * k) - 1));
		}
}

int cut_cover_end(struct cut_cover *c, const struct cut_source *src, struct err *err)
{
	struct cut_trace *t = c->trace;

	unite(t);
	while (t->nrange > t->most_ranges)
		coarsen(c);
	return src->sums(src->ctx, t->range, t->nrange, err);
}

bool cut_trace_fits(const struct cut_trace *t, const struct cut_region *region)
{
	struct cut_range own[4];
	unsigned nown = cut_region_ranges(region, own), nchain;
	const struct point *at = t->site;
	struct cut_chain chain[4];

	if (!t->nrange || t->nrange > CUT_TRACE_RANGES + CUT_TRACE_OWN || t->live.n > CUT_TRACE_PARTS)
		return false;
	for (uint32_t i = 0; i < t->nrange; i++)
		if (t->range[i].hi < t->range[i].lo || (i > 0 && t->range[i].lo <= t->range[i - 1].hi))
			return false;
	for (unsigned i = 0; i < nown; i++)
		if (!cut_trace_contains(t, own[i].lo, own[i].hi))
			return false;
	nchain = cut_trace_borders(region, chain);
	for (unsigned i = 0; i < 4; i++)
		if (t->nsite[i] > (i < nchain ? CUT_TRACE_SITES : 0))
			return false;
	for (unsigned i = 0; i < nchain; at += t->nsite[i++])
		for (uint32_t k = 1; k < t->nsite[i]; k++)
			if (cut_chain_u(&chain[i], &at[k]) < cut_chain_u(&chain[i], &at[k - 1]))
				return false;
	return true;
}
