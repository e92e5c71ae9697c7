/*
 * Plans: the leaves of the dyadic tree over all points, split until each owns at most `load` positions.
 *
 * Counts are upper bounds of positions: the distinct positions that the index has for cells and subtrees inside the
 * region, the positions counted by reading where a cell of a sparse segment extends beyond it, and never more than the
 * lattice positions in the region. So a million records at one position are one position, and a region with no more
 * lattice positions than the load is never split; splitting ends at side 1 at the latest. Positions in several
 * segments, removed sources and the view's rules can only make the bound too large.
 *
 * Empty leaves stay, because they can own triangles.
 *
 * If there are several leaves, the first ones are small, whatever the load, so that the first triangles are emitted
 * early. Behind them the leaves grow by themselves, because they are the other halves of larger regions.
 */
#include "cut_source.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "ledger.h"

enum {
	STRADDLERS = 64,
	STUCK_LEVELS = 8,
	STACK = 80,      /* a split adds one region; at most 64 levels */
	FIRST = 1 << 17, /* the most positions of a leaf, until the leaves own half as many */
};

struct bound {
	struct cut_range range;
	uint64_t positions;
	bool several; /* counted cells of more than one segment */
	bool any, loose;
	uint32_t segment;
	uint32_t nstraddler;
	/* counts the positions of one cell */
	struct point last;
	bool has_last;
	struct grid_cell straddler[STRADDLERS];
};

static uint64_t positions_of(const struct grid_cell *cell)
{
	return cell->distinct < cell->count ? cell->distinct : cell->count;
}

static void bound_segment(struct bound *b, const struct grid_cell *cell)
{
	b->several = b->several || (b->any && b->segment != cell->segment);
	b->any = true;
	b->segment = cell->segment;
}

static bool bound_whole(void *ctx, const struct grid_cell *whole)
{
	const struct bound *b = ctx;

	return whole->count && whole->lo <= b->range.hi && whole->hi >= b->range.lo;
}

static bool bound_enter(void *ctx, const struct grid_cell *subtree)
{
	struct bound *b = ctx;

	if (subtree->count == 0 || subtree->hi < b->range.lo || subtree->lo > b->range.hi)
		return false;
	if (subtree->lo < b->range.lo || subtree->hi > b->range.hi)
		return true;
	bound_segment(b, subtree);
	b->positions += positions_of(subtree);
	return false;
}

static int bound_cell(void *ctx, const struct grid_cell *cell)
{
	struct bound *b = ctx;

	if (cell->count == 0 || cell->hi < b->range.lo || cell->lo > b->range.hi)
		return 0;
	bound_segment(b, cell);
	if (cell->lo >= b->range.lo && cell->hi <= b->range.hi) {
		b->positions += positions_of(cell);
	} else if (b->nstraddler < STRADDLERS) {
		b->straddler[b->nstraddler++] = *cell;
	} else {
		b->positions += positions_of(cell);
		b->loose = true;
	}
	return 0;
}

static int bound_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct bound *b = ctx;

	(void)err;
	for (size_t i = 0; i < n; i++) {
		uint64_t key = point_morton(pts[i].x, pts[i].y);

		if (key < b->range.lo || key > b->range.hi)
			continue;
		if (b->has_last && b->last.x == pts[i].x && b->last.y == pts[i].y)
			continue;
		b->positions++;
		b->last = pts[i];
		b->has_last = true;
	}
	return 0;
}

/* Upper bound of the region's positions before the view; *ret_exact: it is the exact number. */
static int region_bound(const struct cut_source *src, const struct cut_region *r, uint64_t *ret, bool *ret_exact, struct err *err)
{
	unsigned bits = (unsigned)r->wx + r->wy;
	struct cut_range range[4];
	unsigned n = cut_region_ranges(r, range);
	uint64_t total = 0;
	bool exact = true;
	struct bound b;

	for (unsigned i = 0; i < n; i++) {
		const struct grid_visitor v = {.ctx = &b, .segment = bound_whole, .enter = bound_enter, .cell = bound_cell};
		uint64_t records = UINT64_MAX;
		bool all_live = src->all_live && src->all_live(src->ctx);
		int rc;

		memset(&b, 0, offsetof(struct bound, straddler));
		b.range = range[i];
		rc = src->walk(src->ctx, range[i].lo, range[i].hi, &v, err);
		for (uint32_t k = 0; k < b.nstraddler && !rc; k++) {
			b.has_last = false;
			rc = src->read(src->ctx, &b.straddler[k], bound_points, &b, err);
		}
		/* If all records are live, there are at least as many records as counted positions. */
		if (!rc && (!all_live || b.loose))
			rc = src->count(src->ctx, range[i].lo, range[i].hi, &records, &all_live, err);
		if (rc)
			return rc;
		/* There may be fewer live records than positions of all records. */
		if (records < b.positions) {
			b.positions = records;
			b.loose = b.loose || !all_live;
		}
		total += b.positions;
		exact = exact && all_live && !b.several && !b.loose;
	}
	if (bits < 64 && total > (uint64_t)1 << bits) {
		total = (uint64_t)1 << bits;
		exact = false;
	}
	*ret = total;
	*ret_exact = exact;
	return 0;
}

int cut_plan_room(struct cut_plan *plan, size_t n, struct err *err)
{
	size_t cap = plan->cap ? plan->cap : 64;
	struct cut_leaf *more;
	uint64_t bytes;

	if (n <= plan->cap)
		return 0;
	while (cap < n)
		cap *= 2;
	bytes = (cap - plan->cap) * sizeof(*more);
	if (plan->ledger && !ledger_take(plan->ledger, LEDGER_PLAN, bytes)) {
		err_set(err, ERR_BUSY, "a plan of %zu domains takes %" PRIu64 " KiB, more than are left of the memory", n,
			(uint64_t)cap * sizeof(*more) >> 10);
		return err_add_hint(err, "try again when other jobs are done, or give acutd more memory");
	}
	more = realloc(plan->leaf, cap * sizeof(*more));
	if (!more) {
		if (plan->ledger)
			ledger_give(plan->ledger, LEDGER_PLAN, bytes);
		return err_set(err, ERR_NOMEM, "no memory for a plan of %zu domains", cap);
	}
	plan->leaf = more;
	plan->cap = cap;
	return 0;
}

/* Inserts a leaf at index i. */
static int plan_insert(struct cut_plan *plan, size_t i, const struct cut_leaf *leaf, struct err *err)
{
	int rc = cut_plan_room(plan, plan->n + 1, err);

	if (rc)
		return rc;
	memmove(plan->leaf + i + 1, plan->leaf + i, (plan->n - i) * sizeof(*leaf));
	plan->leaf[i] = *leaf;
	plan->n++;
	return 0;
}

void cut_plan_done(struct cut_plan *plan)
{
	free(plan->leaf);
	cut_sites_free(plan->sites);
	if (plan->ledger && plan->cap)
		ledger_give(plan->ledger, LEDGER_PLAN, plan->cap * sizeof(*plan->leaf));
	*plan = (struct cut_plan){.ledger = plan->ledger};
}

void cut_plan_make_flat(struct cut_plan *plan)
{
	for (size_t i = 0; i < plan->n; i++)
		plan->leaf[i].flat = true;
}

/* `before`: positions of the leaves before those of `root`. */
static int plan_root(const struct cut_source *src, const struct cut_region *root, uint64_t before, uint32_t load,
		     struct cut_plan *plan, struct err *err)
{
	struct cut_region stack[STACK], half[2];
	bool several = false;
	unsigned n = 0;

	stack[n++] = *root;
	while (n > 0) {
		struct cut_leaf leaf = {.region = stack[--n]};
		uint64_t most = several && before < FIRST / 2 && load > FIRST ? FIRST : load;
		int rc = region_bound(src, &leaf.region, &leaf.count, &leaf.exact, err);

		if (rc)
			return rc;
		several = several || leaf.count > load;
		if (leaf.count > most && cut_region_split(&leaf.region, half)) {
			stack[n++] = half[1];
			stack[n++] = half[0];
			continue;
		}
		rc = plan_insert(plan, plan->n, &leaf, err);
		if (rc)
			return rc;
		before += leaf.count;
	}
	return 0;
}

int cut_plan_make_from(const struct cut_source *src, uint32_t load, struct cut_plan *ret, struct err *err)
{
	struct cut_plan plan = {.ledger = src->ledger, .load = load ? load : 1};
	struct cut_region root;
	int32_t box[4];
	int rc = 0;

	if (src->box(src->ctx, box)) {
		cut_region_root(box, &root);
		rc = plan_root(src, &root, 0, plan.load, &plan, err);
	}
	if (rc)
		cut_plan_done(&plan);
	else
		*ret = plan;
	return rc;
}

/* What the larger load halves, the smaller one halves, too. If there are several regions, the small leaves at the start are the
 * same with both loads: those of `top` that are not halved here are the first ones, and behind them no leaf is kept small. */
int cut_plan_below_from(const struct cut_source *src, const struct cut_region *top, bool alone, uint32_t load,
			struct cut_plan *ret, struct err *err)
{
	struct cut_plan plan = {.ledger = src->ledger, .load = load ? load : 1};
	int rc = plan_root(src, top, alone ? 0 : FIRST, plan.load, &plan, err);

	if (rc)
		cut_plan_done(&plan);
	else
		*ret = plan;
	return rc;
}

static int set_limit_error(const struct cut_source *src, const struct cut_leaf *leaf, uint64_t need, uint32_t cap,
			   struct err *err)
{
	uint64_t points = 0;
	char text[CUT_REGION_TEXT_SIZE];
	bool exact;
	int rc = src->count(src->ctx, 0, UINT64_MAX, &points, &exact, err);

	if (rc)
		return rc;
	err_set(err, ERR_LIMIT,
		"of %" PRIu64 " points, %" PRIu64 " must be in memory at once for region %s; the "
		"budget carries %" PRIu32 ": they lie in convex position, as on a circle or a line",
		points, need, cut_region_text(&leaf->region, text), cap);
	err->need = need; /* how much memory that takes is known where the budget is computed */
	return -ERR_LIMIT;
}

/* Replaces leaf i by its halves. */
static int split_leaf(const struct cut_source *src, struct cut_plan *plan, size_t i, const struct cut_region half[2],
		      uint64_t above, uint8_t stuck, struct err *err)
{
	struct cut_leaf child[2];
	int rc;

	for (unsigned k = 0; k < 2; k++) {
		child[k] = (struct cut_leaf){.region = half[k], .above = above, .stuck = stuck, .flat = plan->leaf[i].flat};
		rc = region_bound(src, &half[k], &child[k].count, &child[k].exact, err);
		if (rc)
			return rc;
	}
	rc = plan_insert(plan, i + 1, &child[1], err);
	if (rc)
		return rc;
	plan->leaf[i] = child[0];
	return 0;
}

int cut_plan_split_from(const struct cut_source *src, struct cut_plan *plan, size_t i, uint64_t need, uint32_t cap,
			struct err *err)
{
	struct cut_leaf parent = plan->leaf[i];
	struct cut_region half[2];
	bool kept = parent.above && need >= parent.above - parent.above / 50;
	uint8_t stuck = kept ? (uint8_t)(parent.stuck + 1) : 0;

	if (stuck >= STUCK_LEVELS || !cut_region_split(&parent.region, half))
		return set_limit_error(src, &parent, need, cap, err);
	return split_leaf(src, plan, i, half, need, stuck, err);
}

/* Everything that meets a half meets the whole, so own + halo of a half are not more. */
int cut_plan_halve_from(const struct cut_source *src, struct cut_plan *plan, size_t i, bool *ret, struct err *err)
{
	struct cut_region half[2];

	*ret = cut_region_split(&plan->leaf[i].region, half);
	return *ret ? split_leaf(src, plan, i, half, 0, 0, err) : 0;
}
