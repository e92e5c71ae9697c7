/*
 * Let D be the smallest distance (the larger of the two axes) from a cell's tight box to a border of any of the
 * regions. All borders are on or outside W, the box widened by D (and by more on sides without a border). Consider a
 * site whose Voronoi cell meets such a border at b. Among the points of its own cell alone, its Voronoi cell is convex
 * and contains the segment from the site to b, so it meets W where that segment leaves it. So the sites of the four
 * chains of W over the cell's points are all that any of the regions can need of it, including ties. If a border
 * crosses a cell, all of its points may be needed; it is read each time.
 *
 * When the memory is full, cells are read again: slower, but never wrong.
 */
#include "cut_cache.h"

#include <string.h>

#include "cut_chain.h"
#include "cut_judge.h"
#include "cut_order.h"

enum {
	CELL = 2 * GRID_CELL_RECORDS, /* the most positions of a cell that can be kept */
	COLUMNS = 16,
	SLOTS_LEAST = 128,
	POINTS_SLOT = 24, /* kept points for which a slot has memory on average */
};

struct slot {
	uint64_t lo, place;
	uint32_t segment, from, n, used;
};

struct cut_cache {
	struct cut_source below;
	const struct view *view;
	struct cut_judge judge;
	struct cut_region root;
	const struct cut_region *region;
	uint32_t nregion;
	struct slot *slot;
	uint32_t nslot, used; /* a power of two; how many are used */
	struct point *pool;
	uint32_t npool, cap;
	bool full; /* something was not kept */
	uint64_t cells, points;
	/* the cell that is being read */
	uint32_t n;
	bool overflow;
	struct point cell[CELL], chain[4][CELL], batch[CELL];
	/* passes a cell that cannot be kept straight to the caller's sink */
	grid_points_fn fn;
	void *sink;
};

struct cut_cache *cut_cache_init(void *memory, size_t size, const struct cut_source *below, const struct view *view,
				 const struct cut_region *root, const struct cut_region *regions, uint32_t n)
{
	size_t pad = -(uintptr_t)memory & 63, head = (sizeof(struct cut_cache) + 63) & ~(size_t)63, room;
	struct cut_cache *k = (struct cut_cache *)((char *)memory + pad);
	uint32_t slots = SLOTS_LEAST;

	if (size < pad + head + SLOTS_LEAST * (sizeof(struct slot) + POINTS_SLOT * sizeof(struct point)))
		return NULL;
	room = size - pad - head;
	while (slots < 1u << 30 && 2 * (size_t)slots * (sizeof(struct slot) + POINTS_SLOT * sizeof(struct point)) <= room)
		slots *= 2;
	memset(k, 0, offsetof(struct cut_cache, cell));
	k->below = *below;
	k->view = view;
	cut_judge_init(&k->judge, view);
	k->root = *root;
	k->region = regions;
	k->nregion = n;
	k->slot = (struct slot *)((char *)k + head);
	k->nslot = slots;
	memset(k->slot, 0, slots * sizeof(struct slot));
	k->pool = (struct point *)(k->slot + slots);
	room = (room - slots * sizeof(struct slot)) / sizeof(struct point);
	k->cap = room > UINT32_MAX ? UINT32_MAX : (uint32_t)room;
	return k;
}

void cut_cache_stats(const struct cut_cache *k, uint64_t *ret_cells, uint64_t *ret_points)
{
	*ret_cells = k->cells;
	*ret_points = k->points;
}

bool cut_cache_full(const struct cut_cache *k)
{
	return k->full;
}

void cut_cache_limit(struct cut_cache *k, uint32_t points)
{
	k->cap = points < k->cap ? points : k->cap;
}

static struct slot *slot_find(const struct cut_cache *k, const struct grid_cell *cell)
{
	uint64_t key = (cell->lo + cell->segment) * UINT64_C(0x9e3779b97f4a7c15) ^ cell->place;
	uint32_t i = (uint32_t)((key * UINT64_C(0xd6e8feb86659fd93)) >> 32) & (k->nslot - 1);

	while (k->slot[i].used &&
	       (k->slot[i].lo != cell->lo || k->slot[i].place != cell->place || k->slot[i].segment != cell->segment))
		i = (i + 1) & (k->nslot - 1);
	return &k->slot[i];
}

/* ---- distances to borders ---- */

static int64_t gap(int64_t lo, int64_t hi, int64_t from, int64_t to)
{
	return lo > to ? lo - to : from > hi ? from - hi : 0;
}

static int64_t larger(int64_t a, int64_t b)
{
	return a > b ? a : b;
}

/* Doubled distance from a doubled box to the region's borders; 0 if a border crosses the box. */
static int64_t border_gap(const struct cut_region *r, const int64_t box[4])
{
	int64_t b[4], least = INT64_MAX;

	cut_region_box(r, b);
	for (unsigned side = 0; side < 4; side++) {
		unsigned across = side & 1, along = 1 - across;
		int64_t d;

		if (b[side] == INT64_MIN || b[side] == INT64_MAX)
			continue;
		d = larger(gap(box[across], box[across + 2], b[side], b[side]),
			   gap(box[along], box[along + 2], b[along], b[along + 2]));
		least = d < least ? d : least;
	}
	return least;
}

/* Distance from the box to the node's finite square. No border of a region in the node is nearer; its infinite sides
 * are farther outside, because all cells are in the root. */
static int64_t node_gap(const struct cut_region *node, const int64_t box[4])
{
	int64_t x = 2 * ((int64_t)node->x - ((int64_t)1 << 31)) - 1, y = 2 * ((int64_t)node->y - ((int64_t)1 << 31)) - 1;

	return larger(gap(box[0], box[2], x, x + ((int64_t)2 << node->wx)), gap(box[1], box[3], y, y + ((int64_t)2 << node->wy)));
}

/* Whether a region of the node is in its upper half. */
static bool is_upper(const struct cut_region half[2], const struct cut_region *r)
{
	return half[0].x != half[1].x ? r->x >= half[1].x : r->y >= half[1].y;
}

/* The smallest border_gap of the n regions, all in `node`, if it is below `best`. */
static int64_t nearest_gap(const struct cut_region *node, const struct cut_region *region, uint32_t n, const int64_t box[4],
			   int64_t best)
{
	struct cut_region half[2];
	uint32_t lo = 0, hi = n;
	unsigned near;
	int64_t d;

	if (n == 0 || node_gap(node, box) >= best)
		return best;
	if (n == 1) {
		d = border_gap(region, box);
		return d < best ? d : best;
	}
	cut_region_split(node, half); /* it contains two regions, so it can be split */
	while (lo < hi) {
		uint32_t mid = lo + (hi - lo) / 2;

		if (is_upper(half, &region[mid]))
			hi = mid;
		else
			lo = mid + 1;
	}
	near = node_gap(&half[1], box) < node_gap(&half[0], box);
	best = nearest_gap(&half[near], region + (near ? lo : 0), near ? n - lo : lo, box, best);
	return nearest_gap(&half[!near], region + (near ? 0 : lo), near ? lo : n - lo, box, best);
}

/* W, doubled: the box widened by the gap. If the gap is small, each side is widened by the box's size if no border is
 * within it; for a cell beside one border that quarters what is kept. */
static void widen(const struct cut_cache *k, const int64_t box[4], int64_t wide, int64_t w[4])
{
	int64_t size = larger(box[2] - box[0], box[3] - box[1]);

	for (unsigned i = 0; i < 4; i++)
		w[i] = i < 2 ? box[i] - wide : box[i] + wide;
	for (unsigned i = 0; i < 4 && wide < size; i++) {
		int64_t was = w[i], inner[4];

		w[i] += i < 2 ? -size : size;
		for (unsigned j = 0; j < 4; j++)
			inner[j] = j < 2 ? w[j] + 1 : w[j] - 1;
		if (nearest_gap(&k->root, k->region, k->nregion, inner, 1) == 0)
			w[i] = was;
	}
}

/* ---- kept points ---- */

/* Members of a chain, in a struct without pointers to it, so that they stay in registers. */
struct side {
	int64_t c2, u0;
	unsigned shift;
	bool vertical;
};

static inline unsigned column(const struct side *s, const struct point *p)
{
	return (unsigned)((2 * (int64_t)(s->vertical ? p->y : p->x) - s->u0) >> s->shift);
}

static inline int64_t distance(const struct side *s, const struct point *p)
{
	int64_t x = 2 * (int64_t)(s->vertical ? p->x : p->y) - s->c2;

	return x < 0 ? -x : x;
}

/* The nearest point of each column. */
static void find_nearest(const struct point *pts, uint32_t n, const struct side s, int64_t *limit, uint32_t *first)
{
	for (uint32_t i = 0; i < n; i++) {
		unsigned at = column(&s, &pts[i]);
		int64_t d = distance(&s, &pts[i]);

		if (d < limit[at]) {
			limit[at] = d;
			first[at] = i;
		}
	}
}

/* Adds the cell's points to the chain of one side of W: first the nearest of each column, then those that these do not
 * exclude. */
static int add_side(struct cut_cache *k, struct cut_chain *c, const int32_t box[4])
{
	int64_t u0, u1, x, limit[COLUMNS], most = -1;
	uint32_t first[COLUMNS];
	unsigned shift = 0, n;

	cut_chain_span(c, box, &u0, &u1, &x);
	while ((u1 - u0) >> shift >= COLUMNS)
		shift++;
	n = (unsigned)((u1 - u0) >> shift) + 1;

	const struct side s = {.c2 = c->c2, .u0 = u0, .shift = shift, .vertical = c->vertical};

	for (unsigned i = 0; i < n; i++)
		limit[i] = INT64_MAX;
	find_nearest(k->cell, k->n, s, limit, first);
	for (unsigned i = 0; i < n; i++)
		if (limit[i] < INT64_MAX && cut_chain_add(c, k->view, &k->cell[first[i]]))
			return CUT_E_FULL;
	if (cut_chain_flush(c, k->view))
		return CUT_E_FULL;
	cut_chain_limits(c, u0, shift, n, limit);
	for (unsigned i = 0; i < n; i++)
		most = limit[i] > most ? limit[i] : most;
	for (uint32_t i = 0; i < k->n; i++) {
		int64_t d = distance(&s, &k->cell[i]);

		if (d <= most && d <= limit[column(&s, &k->cell[i])] && cut_chain_add(c, k->view, &k->cell[i]))
			return CUT_E_FULL;
	}
	return cut_chain_flush(c, k->view);
}

static bool morton_less(const void *ctx, const struct point *a, const struct point *b)
{
	(void)ctx;
	return cut_order_before(a->x, a->y, b->x, b->y);
}

/* Reduces the points in k->cell to those of the four chains. CUT_E_FULL: they are unchanged. */
static int reduce_cell(struct cut_cache *k, const int32_t box[4], const int64_t w[4])
{
	struct cut_chain c[4];
	uint32_t n = 0, m = 0;

	for (unsigned i = 0; i < 4; i++) {
		unsigned across = i & 1, beside = 1 - across;

		cut_chain_init(&c[i], !across, w[i], w[beside], w[beside + 2], k->chain[i], CELL, k->batch, CELL);
		if (add_side(k, &c[i], box))
			return CUT_E_FULL;
	}
	for (unsigned i = 0; i < 4; i++)
		n += c[i].n;
	if (n > CELL)
		return CUT_E_FULL;
	for (unsigned i = 0, at = 0; i < 4; at += c[i++].n)
		memcpy(k->cell + at, c[i].pt, c[i].n * sizeof(struct point));
	cut_order_sort(k->cell, n, morton_less, NULL);
	for (uint32_t i = 0; i < n; i++) {
		if (m > 0 && k->cell[m - 1].x == k->cell[i].x && k->cell[m - 1].y == k->cell[i].y) {
			if (view_prefers(k->view, &k->cell[i], &k->cell[m - 1]))
				k->cell[m - 1] = k->cell[i];
			continue;
		}
		k->cell[m++] = k->cell[i];
	}
	k->n = m;
	return 0;
}

/* Collects the points of a cell that the view keeps; consecutive points with the same position become one. */
static int collect_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct cut_cache *k = ctx;

	(void)err;
	k->points += n;
	for (size_t i = 0; i < n && !k->overflow; i++) {
		struct point *last = &k->cell[k->n - (k->n > 0)];

		if (cut_judge(&k->judge, &pts[i]) != VIEW_KEPT)
			continue;
		if (k->n > 0 && last->x == pts[i].x && last->y == pts[i].y) {
			if (view_prefers(k->view, &pts[i], last))
				*last = pts[i];
			continue;
		}
		if (k->n == CELL)
			k->overflow = true;
		else
			k->cell[k->n++] = pts[i];
	}
	return 0;
}

static int pass_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct cut_cache *k = ctx;

	k->points += n;
	return k->fn(k->sink, pts, n, err);
}

/* Passes a whole cell straight to the sink. */
static int read_through(struct cut_cache *k, const struct grid_cell *cell, grid_points_fn fn, void *sink, struct err *err)
{
	k->fn = fn;
	k->sink = sink;
	return k->below.read(k->below.ctx, cell, pass_points, k, err);
}

static int keep_read(void *ctx, const struct grid_cell *cell, grid_points_fn fn, void *sink, struct err *err)
{
	struct cut_cache *k = ctx;
	struct slot *slot = slot_find(k, cell);
	int64_t box[4], w[4], wide;
	int rc;

	if (slot->used)
		return slot->n ? fn(sink, k->pool + slot->from, slot->n, err) : 0;
	for (unsigned i = 0; i < 4; i++)
		box[i] = 2 * (int64_t)cell->box[i];
	k->cells++;
	wide = nearest_gap(&k->root, k->region, k->nregion, box, (int64_t)1 << 32 | 1);
	k->full = k->full || k->used >= k->nslot - k->nslot / 8;
	if (wide == 0 || k->used >= k->nslot - k->nslot / 8)
		return read_through(k, cell, fn, sink, err);
	k->n = 0;
	k->overflow = false;
	rc = k->below.read(k->below.ctx, cell, collect_points, k, err);
	if (rc)
		return rc;
	if (k->overflow)
		return read_through(k, cell, fn, sink, err);
	widen(k, box, wide, w);
	rc = k->n ? reduce_cell(k, cell->box, w) : 0;
	k->full = k->full || k->n > k->cap - k->npool;
	if (!rc && k->n <= k->cap - k->npool) {
		*slot = (struct slot){cell->lo, cell->place, cell->segment, k->npool, k->n, 1};
		memcpy(k->pool + k->npool, k->cell, k->n * sizeof(struct point));
		k->npool += k->n;
		k->used++;
	}
	return k->n ? fn(sink, k->cell, k->n, err) : 0;
}

static int keep_walk(void *ctx, uint64_t lo, uint64_t hi, const struct grid_visitor *v, struct err *err)
{
	struct cut_cache *k = ctx;

	return k->below.walk(k->below.ctx, lo, hi, v, err);
}

static int keep_scan(void *ctx, uint64_t lo, uint64_t hi, grid_points_fn fn, void *sink, struct err *err)
{
	struct cut_cache *k = ctx;

	return k->below.scan(k->below.ctx, lo, hi, fn, sink, err);
}

static int keep_count(void *ctx, uint64_t lo, uint64_t hi, uint64_t *ret_count, bool *ret_exact, struct err *err)
{
	struct cut_cache *k = ctx;

	return k->below.count(k->below.ctx, lo, hi, ret_count, ret_exact, err);
}

static bool keep_box(void *ctx, int32_t ret_box[4])
{
	struct cut_cache *k = ctx;

	return k->below.box(k->below.ctx, ret_box);
}

void cut_cache_source(struct cut_cache *k, struct cut_source *ret)
{
	*ret = (struct cut_source){
		.ctx = k, .walk = keep_walk, .read = keep_read, .scan = keep_scan, .count = keep_count, .box = keep_box};
}
