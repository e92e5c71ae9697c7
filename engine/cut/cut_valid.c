/*
 * Whether a region would load the same points in another generation, without loading them.
 *
 * The model. A trace holds C, sites of the region's border chains (all, or every so many of them), and R, ranges of
 * Morton keys with the content sums of the live records in them. Let E' be the lower hull of C: as C is a part of the
 * sites, E' is nowhere below the hull E of all. When the trace is made R gets the region's own ranges, and those of
 * every cell whose box is a closed hit against E' (h <= E' somewhere in it).
 *
 * Valid: (1) the content sums of R are the same; (2) no kept point outside R lies in the region, widened to infinity on
 * its infinite sides, or has h <= E' on any border. Cells and subtrees are judged by their boxes; where a box does not
 * settle it the cell is read and judged by its live points, after the view.
 *
 * Then P_B is unchanged, and so is the record that stands for each position:
 * - Positions with a key in R have the same live records, of all segments together, so the same representative or
 *   none; the sum leaves sources out, and so do views. In particular the region's own positions and counts are the
 *   same. (That unequal records have equal sums is as likely as for any 128-bit hash.)
 * - All of C have keys in R: those of the region by its ranges, those outside because the cell they were in is a hit,
 *   having a point on E. So they are sites now, and the hull E2 of all sites now is nowhere above E'.
 * - Outside the region a site is of P_B if and only if h = E2 on a border. Then h <= E', so by (2) its key is in R. The
 *   same holds for the old sites, E and R by how R was made. Sites with keys outside R have h > E' >= E, E2: they are on
 *   neither hull. So E and E2 are the hulls of the same sites, those with keys in R, and the sites on them are the same.
 * A border without any site has no E', which counts as infinite: everything is a hit.
 *
 * Where all that was live then is live now, segment by segment, or merged, R's sums can differ and (2) be false only by what is
 * live in other segments. If none of that comes near, neither in the region nor with h <= E', no site on E is another, and
 * nothing more is asked: of a survey that grew at one end the index of what is old is not looked at. Cells of what came that are
 * in R count as near, their whole segment only where its box does for the other two reasons.
 *
 * That of whole segments needs no trace: only what was live in any generation G in which it was valid, and how far E' reaches
 * (cut_far). For E of G is that of the trace, all that was live in G is live now, so is what E stands on, and what came is not in
 * the region and has h > E' >= E.
 *
 * Merged segments, removed and restored sources, copies of a point in other files change no live content, so they
 * change nothing here. Coarser ranges or fewer sites make R larger, never wrong. All numbers are of one lattice with its
 * K; whoever compares generations of different ones is wrong before this is asked.
 */
#include "cut_valid.h"

#include <stdlib.h>
#include <string.h>

#include "cut_chain.h"
#include "cut_source.h"

enum { FOUND = 1 };

void cut_trace_init(struct cut_trace *t, void *memory)
{
	*t = (struct cut_trace){.range = memory, .most_ranges = CUT_TRACE_RANGES, .most_sites = CUT_TRACE_SITES};
	t->site = (struct point *)(t->range + CUT_TRACE_RANGES + CUT_TRACE_OWN);
}

void cut_trace_sites(struct cut_trace *t, const struct cut_chain *chain, unsigned n)
{
	struct point *at = t->site;

	memset(t->nsite, 0, sizeof t->nsite);
	for (unsigned i = 0; i < n; i++) {
		uint32_t all = chain[i].n, some = all < t->most_sites ? all : t->most_sites;

		/* The first and the last too: beyond them E is a ray, or infinite. */
		for (uint32_t k = 0; k < some; k++)
			*at++ = chain[i].pt[some < all ? (uint64_t)k * (all - 1) / (some - 1) : k];
		t->nsite[i] = some;
	}
}

/* The region's finite borders, without sites; returns how many. */
static unsigned borders_of(const struct cut_region *region, struct cut_chain ret[4])
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

/* Likewise, with their E'. */
static unsigned chains_of(const struct cut_trace *t, const struct cut_region *region, struct cut_chain ret[4])
{
	unsigned n = borders_of(region, ret);
	struct point *at = t->site;

	for (unsigned i = 0; i < n; at += t->nsite[i++])
		cut_chain_of(&ret[i], at, t->nsite[i]);
	return n;
}

static void survey(struct cut_chain *chain, unsigned n)
{
	for (unsigned i = 0; i < n; i++)
		cut_chain_survey(&chain[i]);
}

static bool hit(const struct cut_chain *chain, unsigned n, const int32_t box[4])
{
	for (unsigned i = 0; i < n; i++)
		if (cut_chain_hit(&chain[i], box))
			return true;
	return false;
}

/* ---- ranges ---- */

/* The keys of the box's corners: whatever lies in it has one between. */
static void keys_of(const int32_t box[4], uint64_t *ret_lo, uint64_t *ret_hi)
{
	*ret_lo = point_morton(box[0], box[1]);
	*ret_hi = point_morton(box[2], box[3]);
}

/* The first range that does not end before `from`; NULL: all do. */
static const struct grid_sum *range_at(const struct cut_trace *t, uint64_t from)
{
	uint32_t lo = 0, hi = t->nrange;

	while (lo < hi) {
		uint32_t mid = lo + (hi - lo) / 2;

		if (t->range[mid].hi < from)
			lo = mid + 1;
		else
			hi = mid;
	}
	return lo < t->nrange ? &t->range[lo] : NULL;
}

static bool in_ranges(const struct cut_trace *t, uint64_t from, uint64_t to)
{
	const struct grid_sum *r = range_at(t, from);

	return r && r->lo <= from && to <= r->hi;
}

static int range_order(const void *a, const void *b)
{
	const struct grid_sum *x = a, *y = b;

	return x->lo < y->lo ? -1 : x->lo > y->lo;
}

/* Ascending, disjoint, not adjacent. */
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
	struct cut_trace *trace;
	struct cut_range own[4];
	unsigned nown, nchain;
	struct cut_chain chain[4];
	uint64_t mask; /* low bits that are not told apart any more */
};

static void widen(struct grid_sum *r, uint64_t mask)
{
	r->lo &= ~mask;
	r->hi |= mask;
}

static void make_room(struct listing *l)
{
	struct cut_trace *t = l->trace;

	unite(t);
	/* A quarter, or it would be full again at once: four neighbours become one. */
	while (t->nrange > t->most_ranges / 4 * 3) {
		l->mask = l->mask << 2 | 3;
		for (uint32_t i = 0; i < t->nrange; i++)
			widen(&t->range[i], l->mask);
		unite(t);
	}
}

static void list(struct listing *l, uint64_t lo, uint64_t hi)
{
	struct cut_trace *t = l->trace;
	struct grid_sum r = {.lo = lo, .hi = hi};

	if (t->nrange == t->most_ranges)
		make_room(l);
	widen(&r, l->mask);
	t->range[t->nrange++] = r;
}

static bool is_own(const struct listing *l, uint64_t lo, uint64_t hi)
{
	for (unsigned i = 0; i < l->nown; i++)
		if (l->own[i].lo <= lo && hi <= l->own[i].hi)
			return true;
	return false;
}

static bool list_wants(const struct listing *l, const struct grid_cell *cell, uint64_t *ret_lo, uint64_t *ret_hi)
{
	keys_of(cell->box, ret_lo, ret_hi);
	return cell->count && !is_own(l, *ret_lo, *ret_hi) && hit(l->chain, l->nchain, cell->box);
}

static bool list_enter(void *ctx, const struct grid_cell *subtree)
{
	uint64_t lo, hi;

	return list_wants(ctx, subtree, &lo, &hi);
}

static int list_cell(void *ctx, const struct grid_cell *cell)
{
	uint64_t lo, hi, mask = 0;

	if (!list_wants(ctx, cell, &lo, &hi))
		return 0;
	/* The smallest aligned range around: those of neighbours are adjacent. */
	while ((lo ^ hi) & ~mask)
		mask = mask << 2 | 3;
	list(ctx, lo & ~mask, hi | mask);
	return 0;
}

static void trace_parts(struct cut_trace *t, const struct cut_source *src)
{
	struct cut_segment segment[CUT_TRACE_PARTS];
	size_t n = src->parts ? src->parts(src->ctx, t->live.part, segment, CUT_TRACE_PARTS) : 0;

	t->live.n = n <= CUT_TRACE_PARTS ? (uint32_t)n : 0;
}

int cut_trace_ranges(struct cut_trace *t, const struct cut_source *src, const struct cut_region *region, struct err *err)
{
	struct listing l = {.trace = t};
	const struct grid_visitor v = {.ctx = &l, .segment = list_enter, .enter = list_enter, .cell = list_cell};
	int rc;

	trace_parts(t, src);
	l.nown = cut_region_ranges(region, l.own);
	l.nchain = chains_of(t, region, l.chain);
	survey(l.chain, l.nchain);
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
		if (!in_ranges(t, own[i].lo, own[i].hi))
			return false;
	nchain = borders_of(region, chain);
	for (unsigned i = 0; i < 4; i++)
		if (t->nsite[i] > (i < nchain ? CUT_TRACE_SITES : 0))
			return false;
	for (unsigned i = 0; i < nchain; at += t->nsite[i++])
		for (uint32_t k = 1; k < t->nsite[i]; k++)
			if (cut_chain_u(&chain[i], &at[k]) < cut_chain_u(&chain[i], &at[k - 1]))
				return false;
	return true;
}

/* ---- judging ---- */

struct judge {
	const struct cut_source *src;
	const struct view *view;
	const struct cut_trace *trace;
	int64_t box[4];
	struct cut_chain chain[4];
	unsigned nchain;
	bool surveyed;
	struct err *err;
};

/* Before many boxes are looked at; for one it costs more than it saves. */
static void judge_survey(struct judge *j)
{
	if (!j->surveyed)
		survey(j->chain, j->nchain);
	j->surveyed = true;
}

static bool meets(const struct judge *j, const int32_t box[4])
{
	return 2 * (int64_t)box[0] <= j->box[2] && 2 * (int64_t)box[2] >= j->box[0] && 2 * (int64_t)box[1] <= j->box[3] &&
	       2 * (int64_t)box[3] >= j->box[1];
}

static bool judge_wants(const struct judge *j, const struct grid_cell *cell)
{
	uint64_t lo, hi;

	keys_of(cell->box, &lo, &hi);
	return cell->count && !in_ranges(j->trace, lo, hi) && (meets(j, cell->box) || hit(j->chain, j->nchain, cell->box));
}

static bool judge_enter(void *ctx, const struct grid_cell *subtree)
{
	return judge_wants(ctx, subtree);
}

static int judge_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	const struct judge *j = ctx;

	(void)err;
	for (size_t i = 0; i < n; i++) {
		const struct point *p = &pts[i];
		uint64_t key = point_morton(p->x, p->y);

		if (in_ranges(j->trace, key, key) || view_judge(j->view, p) != VIEW_KEPT)
			continue;
		if (meets(j, (const int32_t[4]){p->x, p->y, p->x, p->y}))
			return FOUND;
		for (unsigned k = 0; k < j->nchain; k++)
			if (!cut_chain_above(&j->chain[k], p))
				return FOUND;
	}
	return 0;
}

static int judge_cell(void *ctx, const struct grid_cell *cell)
{
	struct judge *j = ctx;

	return judge_wants(j, cell) ? j->src->read(j->src->ctx, cell, judge_points, j, j->err) : 0;
}

/* (1). A few at a time: where something has changed it is seldom the last. */
static int same_sums(const struct cut_source *src, const struct cut_trace *t, bool *ret, struct err *err)
{
	enum { PIECE = 64 };
	struct grid_sum now[PIECE];

	for (uint32_t at = 0; at < t->nrange;) {
		uint32_t n = t->nrange - at < PIECE ? t->nrange - at : PIECE;
		int rc;

		memcpy(now, t->range + at, n * sizeof *now);
		rc = src->sums(src->ctx, now, n, err);
		if (rc)
			return rc;
		for (uint32_t i = 0; i < n; i++, at++)
			if (!digest_equal(now[i].sum, t->range[at].sum)) {
				*ret = false;
				return 0;
			}
	}
	*ret = true;
	return 0;
}

/* ---- what came only ---- */

struct fresh {
	struct judge *judge;
	struct cut_part part[2 * CUT_TRACE_PARTS];
	struct cut_segment segment[2 * CUT_TRACE_PARTS];
	size_t n;
};

static bool meets_ranges(const struct cut_trace *t, uint64_t from, uint64_t to)
{
	const struct grid_sum *r = range_at(t, from);

	return r && r->lo <= to;
}

static bool fresh_segment(void *ctx, const struct grid_cell *whole)
{
	const struct fresh *f = ctx;
	size_t i = 0;

	while (i < f->n && f->segment[i].number != whole->segment)
		i++;
	if (i == f->n || !whole->count || !(meets(f->judge, whole->box) || hit(f->judge->chain, f->judge->nchain, whole->box)))
		return false;
	judge_survey(f->judge);
	return true;
}

static bool fresh_near(void *ctx, const struct grid_cell *cell)
{
	const struct judge *j = ((const struct fresh *)ctx)->judge;
	uint64_t lo, hi;

	keys_of(cell->box, &lo, &hi);
	return cell->count && (meets_ranges(j->trace, lo, hi) || meets(j, cell->box) || hit(j->chain, j->nchain, cell->box));
}

static int fresh_cell(void *ctx, const struct grid_cell *cell)
{
	return fresh_near(ctx, cell) ? FOUND : 0;
}

static bool part_same(const struct cut_part *a, const struct cut_part *b)
{
	return a->points == b->points && digest_equal(a->sum, b->sum);
}

/* All that is missing lies in one segment now, which then is none of what came. */
static bool fresh_merged(struct fresh *f, const struct cut_live *then, const bool *there)
{
	struct cut_part all = {0};
	size_t i = 0;

	for (uint32_t k = 0; k < then->n; k++)
		if (!there[k]) {
			all.points += then->part[k].points;
			digest_add(&all.sum, then->part[k].sum);
		}
	while (i < f->n && !part_same(&f->part[i], &all))
		i++;
	if (i == f->n)
		return false;
	f->n--;
	f->part[i] = f->part[f->n];
	f->segment[i] = f->segment[f->n];
	return true;
}

/* The segments that were not live then. False: not all that were are there as they were. */
static bool fresh_find(const struct cut_source *src, const struct cut_live *then, struct fresh *f)
{
	enum { MOST = sizeof f->segment / sizeof f->segment[0] };
	bool taken[CUT_TRACE_PARTS] = {false};
	struct cut_part now[MOST];
	struct cut_segment segment[MOST];
	size_t n = then->n && src->parts ? src->parts(src->ctx, now, segment, MOST) : 0, same = 0;

	if (!n || n > MOST)
		return false;
	for (size_t i = 0; i < n; i++) {
		uint32_t k = 0;

		while (k < then->n && (taken[k] || !part_same(&now[i], &then->part[k])))
			k++;
		if (k == then->n) {
			f->part[f->n] = now[i];
			f->segment[f->n++] = segment[i];
			continue;
		}
		taken[k] = true;
		same++;
	}
	return same == then->n || fresh_merged(f, then, taken);
}

bool cut_trace_stands_in(const struct cut_source *src, const struct cut_trace *t)
{
	struct fresh f = {.n = 0};

	return fresh_find(src, &t->live, &f);
}

/* Between which ends of a border a point of it can be that has a site, by the first and the last one. On an infinite end that is
 * from the last site on (or the other end, if that lies before it). */
static void border_ends(const struct cut_chain *c, int64_t first, int64_t last, int64_t *ret_t0, int64_t *ret_t1)
{
	int64_t t0 = c->t0 > INT64_MIN ? c->t0 : first < c->t1 ? first : c->t1;

	*ret_t0 = t0;
	*ret_t1 = c->t1 < INT64_MAX ? c->t1 : last > t0 ? last : t0;
}

/* How far a point of the border can be from the nearest of these sites at most. */
static struct cut_reach_border border_reach(const struct cut_chain *c, const struct point *site, uint32_t n)
{
	struct cut_reach_border b = {.any = n > 0};
	int64_t u, t0, t1;

	if (!n)
		return b;
	b.first = cut_chain_u(c, site);
	b.last = cut_chain_u(c, &site[n - 1]);
	border_ends(c, b.first, b.last, &t0, &t1);
	u = t0 < b.first ? t0 : b.first;
	for (uint32_t i = 0; i < n; i++) {
		int64_t next = cut_chain_u(c, &site[i]), least = cut_chain_x(c, &site[i]) + next - u;

		b.far = least > b.far ? least : b.far;
		u = next;
	}
	if (t1 > b.last && cut_chain_x(c, &site[n - 1]) + t1 - b.last > b.far)
		b.far = cut_chain_x(c, &site[n - 1]) + t1 - b.last;
	return b;
}

void cut_reach_of(const struct cut_trace *t, const struct cut_region *region, struct cut_reach *ret)
{
	const struct point *at = t->site;
	struct cut_chain border[4];
	unsigned n = borders_of(region, border);

	memset(ret, 0, sizeof *ret);
	for (unsigned i = 0; i < n; at += t->nsite[i++])
		ret->border[i] = border_reach(&border[i], at, t->nsite[i]);
}

/* False: no point in the box has h <= E'. Beyond the last site of an infinite end E' is infinite, and before it such a point is
 * no farther across than the site is. */
static bool border_near(const struct cut_chain *c, const struct cut_reach_border *b, const int32_t box[4])
{
	int64_t u0, u1, x, t0, t1;

	if (!b->any)
		return true;
	cut_chain_span(c, box, &u0, &u1, &x);
	if ((c->t0 == INT64_MIN && u0 <= b->first) || (c->t1 == INT64_MAX && u1 >= b->last))
		return true;
	border_ends(c, b->first, b->last, &t0, &t1);
	return x <= b->far && u0 - t1 <= b->far && t0 - u1 <= b->far;
}

/* Of whole segments, from their boxes: most are far from most regions. True says nothing. What is in R only, neither in the
 * region nor with h <= E', changes no site on E. */
static bool fresh_may(const struct fresh *f, const struct cut_region *region, const struct cut_reach *reach)
{
	struct cut_chain border[4];
	unsigned n = borders_of(region, border);

	for (size_t k = 0; k < f->n; k++) {
		if (meets(f->judge, f->segment[k].box))
			return true;
		for (unsigned i = 0; i < n; i++)
			if (border_near(&border[i], &reach->border[i], f->segment[k].box))
				return true;
	}
	return false;
}

bool cut_far_from(const struct cut_source *src, const struct cut_region *region, const struct cut_reach *reach,
		  const struct cut_live *then)
{
	struct judge j = {.src = src};
	struct fresh f = {.judge = &j};

	cut_region_box(region, j.box);
	return fresh_find(src, then, &f) && !fresh_may(&f, region, reach);
}

/* *ret: what is not of the trace's generation is not near. False in it says nothing. Chains are built where boxes do not do. */
static int nothing_near(const struct cut_source *src, struct judge *j, const struct cut_region *region, bool *ret,
			struct err *err)
{
	struct fresh f = {.judge = j};
	const struct grid_visitor v = {.ctx = &f, .segment = fresh_segment, .enter = fresh_near, .cell = fresh_cell};
	bool known = fresh_find(src, &j->trace->live, &f);
	struct cut_reach reach;
	int rc;

	if (known)
		cut_reach_of(j->trace, region, &reach);
	*ret = known && !fresh_may(&f, region, &reach);
	if (*ret)
		return 0;
	j->nchain = chains_of(j->trace, region, j->chain);
	if (!known)
		return 0;
	rc = src->walk(src->ctx, 0, UINT64_MAX, &v, err);
	*ret = !rc;
	return rc == FOUND ? 0 : rc;
}

int cut_valid_from(const struct cut_source *src, const struct view *view, const struct cut_region *region,
		   const struct cut_trace *trace, bool *ret, struct err *err)
{
	struct judge j = {.src = src, .view = view, .trace = trace, .err = err};
	const struct grid_visitor v = {.ctx = &j, .segment = judge_enter, .enter = judge_enter, .cell = judge_cell};
	bool same = false;
	int rc;

	cut_region_box(region, j.box);
	rc = nothing_near(src, &j, region, ret, err);
	if (rc || *ret)
		return rc;
	rc = same_sums(src, trace, &same, err);
	if (rc)
		return rc;
	if (same) {
		judge_survey(&j);
		rc = src->walk(src->ctx, 0, UINT64_MAX, &v, err);
		if (rc && rc != FOUND)
			return rc;
	}
	*ret = same && rc != FOUND;
	return 0;
}
