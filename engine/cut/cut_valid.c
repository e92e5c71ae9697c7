/*
 * Decides whether a region would load the same points in another generation, without loading them.
 *
 * Model. A trace holds C, sites of the region's border chains (all, or every n-th of them), and R, ranges of Morton
 * keys with the content sums of the live records in them. Let E' be the lower hull of C: C is a part of the sites, so
 * E' is nowhere below the hull E of all sites. When the trace is made, R gets the region's own ranges, and those of
 * every cell whose box is a closed hit against E' (h <= E' somewhere in it).
 *
 * A trace is valid if (1) the content sums of R are the same, and (2) no kept point outside R is in the region (widened
 * to infinity on its infinite sides) or has h <= E' on a border. Cells and subtrees are tested by their boxes; if a box
 * is not sufficient, the cell is read and its live points are tested, after the view.
 *
 * Then P_B is unchanged, and so is the record that represents each position:
 * - Positions with a key in R have the same live records, of all segments together, so the same representative or none;
 *   neither the sum nor views depend on sources. In particular the region's own positions and counts are the same.
 *   (Different records with equal sums are as unlikely as for any 128-bit hash.)
 * - All of C have keys in R: those in the region by its ranges, those outside because their cell was a hit, as it had a
 *   point on E. So they are sites now, and the hull E2 of all sites now is nowhere above E'.
 * - Outside the region a site is in P_B if and only if h = E2 on a border. Then h <= E', so by (2) its key is in R. The
 *   same holds for the old sites and E, by the construction of R. Sites with keys outside R have h > E' >= E, E2, so
 *   they are on neither hull. So E and E2 are the hulls of the same sites, those with keys in R, and the sites on them
 *   are the same. A border without any site has no E', which counts as infinite: everything is a hit.
 *
 * If everything that was live then is live now, segment by segment or merged, then only the live records of other
 * segments can change R's sums or violate (2). If none of these is near (in the region, or with h <= E'), no site on E
 * changes, and nothing else need be tested: if a survey grew at one end, the index of the old data is not read. New
 * cells that are in R count as near; a whole new segment does only if its box is near for the other two reasons.
 *
 * For whole segments this needs no trace, but only what was live in a generation G in which it was valid, and how far
 * E' reaches (cut_additions_far): E of G is that of the trace; all that was live in G is live now, so are the sites of
 * E; and new points are not in the region and have h > E' >= E.
 *
 * Lines. A domain with pieces depends on more: on pieces that meet the box of its triangles, and on points in the discs of some
 * (docs/design/constraints.md). When it is made, ranges around these discs become a part of R. It is valid if also (3) the sum of
 * the pieces is the same. Points outside of R are in no such disc, so (2) is enough for them. Whether a record is live may depend
 * on lines, so a line set with another content than that of then counts as content that is not live any more.
 *
 * Weights. A domain with weights begins with P(B), and depends on more: on points in discs and half planes
 * (docs/design/weights.md, "The trace"). When it is made, ranges around these become a part of R, too. Where a border is
 * infinite, it also depends on points that are at least as far along it as the last site, whatever their distance from it. So (2)
 * has these for a view with weights: h <= E' says so only beyond the last site.
 *
 * Merged segments, removed and restored sources, and copies of a point in other files change no live content, so they
 * change nothing here. Coarser ranges or fewer sites make R larger, never wrong. All numbers must be of one lattice
 * with the same K; the caller must ensure that.
 */
#include "cut_trace_priv.h"

#include <stdlib.h>
#include <string.h>

#include "cut_chain.h"
#include "cut_source.h"

enum { FOUND = 1 };

/* ---- the test ---- */

struct check {
	const struct cut_source *src;
	const struct view *view;
	const struct cut_trace *trace;
	int64_t box[4];
	struct cut_chain chain[4];
	unsigned nchain;
	bool surveyed, discs;
	struct err *err;
};

/* Whether, with weights, a point in the box can matter at an infinite end. */
static bool at_end(const struct check *j, const int32_t box[4])
{
	for (unsigned i = 0; j->view->nweight && i < j->nchain; i++) {
		const struct cut_chain *c = &j->chain[i];
		int64_t u0, u1, x;

		cut_chain_span(c, box, &u0, &u1, &x);
		if (!c->n || (c->t0 == INT64_MIN && u0 <= cut_chain_u(c, &c->pt[0])) ||
		    (c->t1 == INT64_MAX && u1 >= cut_chain_u(c, &c->pt[c->n - 1])))
			return true;
	}
	return false;
}

static bool sees(const struct check *j, const int32_t box[4])
{
	return cut_chains_hit(j->chain, j->nchain, box) || at_end(j, box);
}

/* Before many boxes are tested; for a single one it costs more than it saves. */
static void check_survey(struct check *j)
{
	if (!j->surveyed)
		cut_chains_survey(j->chain, j->nchain);
	j->surveyed = true;
}

static bool meets_region(const struct check *j, const int32_t box[4])
{
	return 2 * (int64_t)box[0] <= j->box[2] && 2 * (int64_t)box[2] >= j->box[0] && 2 * (int64_t)box[1] <= j->box[3] &&
	       2 * (int64_t)box[3] >= j->box[1];
}

static bool boxes_meet(const int32_t a[4], const int32_t b[4])
{
	return a[0] <= b[2] && a[1] <= b[3] && a[2] >= b[0] && a[3] >= b[1];
}

static bool check_matters(const struct check *j, const struct grid_cell *cell)
{
	uint64_t lo, hi;

	cut_box_keys(cell->box, &lo, &hi);
	return cell->count && !cut_trace_contains(j->trace, lo, hi) && (meets_region(j, cell->box) || sees(j, cell->box));
}

static bool check_enter(void *ctx, const struct grid_cell *subtree)
{
	return check_matters(ctx, subtree);
}

static int check_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	const struct check *j = ctx;

	(void)err;
	for (size_t i = 0; i < n; i++) {
		const struct point *p = &pts[i];
		const int32_t box[4] = {p->x, p->y, p->x, p->y};
		uint64_t key = point_morton(p->x, p->y);

		if (cut_trace_contains(j->trace, key, key) || view_judge(j->view, p) != VIEW_KEPT)
			continue;
		if (meets_region(j, box) || at_end(j, box))
			return FOUND;
		for (unsigned k = 0; k < j->nchain; k++)
			if (!cut_chain_above(&j->chain[k], p))
				return FOUND;
	}
	return 0;
}

static int check_cell(void *ctx, const struct grid_cell *cell)
{
	struct check *j = ctx;

	return check_matters(j, cell) ? j->src->read(j->src->ctx, cell, check_points, j, j->err) : 0;
}

/* Condition (1). In small batches: a difference is seldom in the last range. */
static int sums_equal(const struct cut_source *src, const struct cut_trace *t, bool *ret, struct err *err)
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

/* ---- added segments ---- */

struct added {
	struct check *check;
	struct cut_live_part part[2 * CUT_TRACE_PARTS];
	struct cut_segment segment[2 * CUT_TRACE_PARTS];
	size_t n;
};

static bool meets_ranges(const struct cut_trace *t, uint64_t from, uint64_t to)
{
	const struct grid_sum *r = cut_trace_find(t, from);

	return r && r->lo <= to;
}

static bool added_segment(void *ctx, const struct grid_cell *whole)
{
	const struct added *f = ctx;
	size_t i = 0;

	while (i < f->n && f->segment[i].number != whole->segment)
		i++;
	if (i == f->n || !whole->count ||
	    !(meets_region(f->check, whole->box) || sees(f->check, whole->box) ||
	      (f->check->discs && boxes_meet(f->check->trace->lines.disc, whole->box))))
		return false;
	check_survey(f->check);
	return true;
}

static bool added_near(void *ctx, const struct grid_cell *cell)
{
	const struct check *j = ((const struct added *)ctx)->check;
	uint64_t lo, hi;

	cut_box_keys(cell->box, &lo, &hi);
	return cell->count && (meets_ranges(j->trace, lo, hi) || meets_region(j, cell->box) || sees(j, cell->box));
}

static int added_cell(void *ctx, const struct grid_cell *cell)
{
	return added_near(ctx, cell) ? FOUND : 0;
}

static bool same_part(const struct cut_live_part *a, const struct cut_live_part *b)
{
	return a->points == b->points && digest_equal(a->sum, b->sum);
}

/* If all missing content is in one segment now (they were merged), that segment is not an added one. */
static bool added_without_merged(struct added *f, const struct cut_live *then, const bool *there)
{
	struct cut_live_part all = {0};
	size_t i = 0;

	for (uint32_t k = 0; k < then->n; k++)
		if (!there[k]) {
			all.points += then->part[k].points;
			digest_add(&all.sum, then->part[k].sum);
		}
	while (i < f->n && !same_part(&f->part[i], &all))
		i++;
	if (i == f->n)
		return false;
	f->n--;
	f->part[i] = f->part[f->n];
	f->segment[i] = f->segment[f->n];
	return true;
}

/* Finds the segments that were not live then. False: not all that were live then are live now. */
static bool find_added(const struct cut_source *src, const struct cut_live *then, struct added *f)
{
	enum { MOST = sizeof f->segment / sizeof f->segment[0] };
	bool taken[CUT_TRACE_PARTS] = {false};
	struct cut_live_part now[MOST];
	struct cut_segment segment[MOST];
	size_t n = then->n && src->parts ? src->parts(src->ctx, now, segment, MOST) : 0, same = 0;

	if (!n || n > MOST || !digest_equal(then->lines, src->lines ? src->lines(src->ctx) : (struct digest){0, 0}))
		return false;
	for (size_t i = 0; i < n; i++) {
		uint32_t k = 0;

		while (k < then->n && (taken[k] || !same_part(&now[i], &then->part[k])))
			k++;
		if (k == then->n) {
			f->part[f->n] = now[i];
			f->segment[f->n++] = segment[i];
			continue;
		}
		taken[k] = true;
		same++;
	}
	return same == then->n || added_without_merged(f, then, taken);
}

bool cut_trace_still_live_in(const struct cut_source *src, const struct cut_trace *t)
{
	struct added f = {.n = 0};

	return find_added(src, &t->live, &f);
}

/* The interval of a border whose points can have a site, from its first and last site. An infinite end begins at the
 * last site (or at the other end of the border, if that is farther). */
static void border_ends(const struct cut_chain *c, int64_t first, int64_t last, int64_t *ret_t0, int64_t *ret_t1)
{
	int64_t t0 = c->t0 > INT64_MIN ? c->t0 : first < c->t1 ? first : c->t1;

	*ret_t0 = t0;
	*ret_t1 = c->t1 < INT64_MAX ? c->t1 : last > t0 ? last : t0;
}

/* Upper bound of the distance from a point of the border to the nearest of these sites. */
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
	unsigned n = cut_trace_borders(region, border);

	memset(ret, 0, sizeof *ret);
	ret->any_disc = t->lines.disc[0] <= t->lines.disc[2];
	memcpy(ret->disc, t->lines.disc, sizeof ret->disc);
	for (unsigned i = 0; i < n; at += t->nsite[i++])
		ret->border[i] = border_reach(&border[i], at, t->nsite[i]);
}

/* False: no point in the box has h <= E'. Beyond the last site of an infinite end E' is infinite; before it, such a
 * point is no farther across than the site. */
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

/* Tests added segments by their boxes: most are far from most regions. False: none is near; true: unknown. Points that
 * are only in R, neither in the region nor with h <= E', change no site on E. */
static bool added_may_be_near(const struct added *f, const struct cut_region *region, const struct cut_reach *reach)
{
	struct cut_chain border[4];
	unsigned n = cut_trace_borders(region, border);

	for (size_t k = 0; k < f->n; k++) {
		if (meets_region(f->check, f->segment[k].box) || (reach->any_disc && boxes_meet(reach->disc, f->segment[k].box)))
			return true;
		for (unsigned i = 0; i < n; i++)
			if (border_near(&border[i], &reach->border[i], f->segment[k].box))
				return true;
	}
	return false;
}

bool cut_additions_far_from(const struct cut_source *src, const struct cut_region *region, const struct cut_reach *reach,
			    const struct cut_live *then)
{
	struct check j = {.src = src};
	struct added f = {.check = &j};

	cut_region_box(region, j.box);
	return find_added(src, then, &f) && !added_may_be_near(&f, region, reach);
}

/* Sets *ret if no added content is near; otherwise nothing is known. Builds the chains only if boxes are not sufficient. */
static int nothing_added_near(const struct cut_source *src, struct check *j, const struct cut_region *region, bool *ret,
			      struct err *err)
{
	struct added f = {.check = j};
	const struct grid_visitor v = {.ctx = &f, .segment = added_segment, .enter = added_near, .cell = added_cell};
	bool known = find_added(src, &j->trace->live, &f);
	struct cut_reach reach;
	int rc;

	if (known)
		cut_reach_of(j->trace, region, &reach);
	*ret = known && !added_may_be_near(&f, region, &reach);
	if (*ret)
		return 0;
	j->nchain = cut_trace_chains(j->trace, region, j->chain);
	if (!known)
		return 0;
	rc = src->walk(src->ctx, 0, UINT64_MAX, &v, err);
	*ret = !rc;
	return rc == FOUND ? 0 : rc;
}

/* Condition (3). */
static int lines_equal(const struct cut_source *src, const struct cut_lines *lines, bool *ret, struct err *err)
{
	struct digest now = {0, 0};
	int rc = 0;

	if (src->line_sum && lines->box[0] <= lines->box[2])
		rc = src->line_sum(src->ctx, lines->box, &now, err);
	*ret = digest_equal(now, lines->sum);
	return rc;
}

int cut_valid_from(const struct cut_source *src, const struct view *view, const struct cut_region *region,
		   const struct cut_trace *trace, bool *ret, struct err *err)
{
	struct check j = {
		.src = src, .view = view, .trace = trace, .err = err, .discs = trace->lines.disc[0] <= trace->lines.disc[2]};
	const struct grid_visitor v = {.ctx = &j, .segment = check_enter, .enter = check_enter, .cell = check_cell};
	bool same = false;
	int rc;

	cut_region_box(region, j.box);
	rc = nothing_added_near(src, &j, region, ret, err);
	if (rc || *ret)
		return rc;
	rc = lines_equal(src, &trace->lines, &same, err);
	if (!rc && same)
		rc = sums_equal(src, trace, &same, err);
	if (rc)
		return rc;
	if (same) {
		check_survey(&j);
		rc = src->walk(src->ctx, 0, UINT64_MAX, &v, err);
		if (rc && rc != FOUND)
			return rc;
	}
	*ret = same && rc != FOUND;
	return 0;
}
