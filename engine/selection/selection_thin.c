/*
 * The thin rule: keeps one point of each thin cell, of those that the other rules keep.
 *
 * Thin cells are squares of absolute lattice numbers, independent of the cells of the cache. The plane is divided into
 * rectangles of whole thin cells. A rectangle is halved along its longer side until the index shows that it fits the
 * table, or until it meets so few cells of the cache that reading them is cheaper than estimating. A rectangle that
 * overflows the table is halved further. A rectangle reads every cell of every segment whose box meets it, and judges
 * only the points inside it: each point is judged once, and cells at borders are read several times.
 *
 * Lowest and highest: a hash table of thin cells, with the best point so far. Median: all points are collected and
 * sorted by cell and rank. A single thin cell with more points than the table can hold is read several times instead:
 * first for the range of its ranks, then for histograms of the ranks that may be the median. Each histogram narrows the
 * range to a thousandth, until the remaining points fit, or one rank remains, which is the point itself.
 *
 * Vertices of lines are not thinned: selection_lines.c keeps them.
 *
 * The result depends on the set of points alone: only equal points have the same rank (view_thin_compare).
 */
#include "selection_priv.h"

#include <string.h>

#include "err.h"

enum { DIGITS = 1024, RANK_SLOT = 5 }; /* RANK_SLOT: bits */
enum { FULL = 1 };                     /* the rectangle does not fit the table */

/* The order of the points of a thin cell as one number: z, class, returns, flags, x, y, slot (descending). */
typedef unsigned __int128 rank_t;

/* Thin cells, both ends included. */
struct rect {
	int64_t x0, y0, x1, y1;
};

/* An entry of the table for lowest and highest. x: the column in the rectangle plus one; 0: free. */
struct slot {
	uint32_t x, y;
	struct point best;
};

struct item {
	uint64_t cell;
	struct point p;
};

struct thin {
	struct selection *s;
	const struct view *view;
	struct rect root, rect;
	int64_t box[4]; /* of rect: lattice numbers, both ends included */
	bool count;     /* this pass is the one that counts */
	int (*take)(struct thin *, const struct point *);
	uint64_t bound; /* upper bound of the table entries that the rectangle needs */
	uint64_t cells; /* of the cache that the rectangle meets */
	uint64_t kept;  /* points of the rectangle that the earlier rules keep */
	/* lowest, highest */
	struct slot *slot, *last;
	size_t slots, used;
	int64_t last_box[4]; /* of the thin cell of `last` */
	/* median */
	struct item *item;
	size_t items, cap;
	uint64_t *histogram; /* before the items */
	rank_t lo, hi;       /* ranks that may be the median */
	unsigned shift;      /* maps such a rank to its bin of the histogram */
};

/* ---- rectangles ---- */

static int64_t clip(__int128 v)
{
	return v < INT32_MIN ? (int64_t)INT32_MIN - 1 : v > INT32_MAX ? (int64_t)INT32_MAX + 1 : (int64_t)v;
}

static void lattice_box(const struct thin *t, const struct rect *r, int64_t ret[4])
{
	__int128 c = t->view->thin.cell;

	ret[0] = clip(r->x0 * c - t->view->k[0]);
	ret[1] = clip(r->y0 * c - t->view->k[1]);
	ret[2] = clip(r->x1 * c + c - 1 - t->view->k[0]);
	ret[3] = clip(r->y1 * c + c - 1 - t->view->k[1]);
}

static bool meets(const int64_t a[4], const int32_t b[4])
{
	return a[0] <= b[2] && b[0] <= a[2] && a[1] <= b[3] && b[1] <= a[3];
}

static bool inside(const int64_t box[4], const struct point *p)
{
	return p->x >= box[0] && p->x <= box[2] && p->y >= box[1] && p->y <= box[3];
}

static bool wanted(const struct thin *t, const struct grid_cell *c)
{
	return meets(t->box, c->box) && view_may_hold(t->view, c->box);
}

static bool enter(void *ctx, const struct grid_cell *subtree)
{
	return wanted(ctx, subtree);
}

/* Thin cells of the rectangle that the box of a cache cell touches, at most `limit`. */
static uint64_t touched(const struct thin *t, const int32_t box[4], uint64_t limit)
{
	struct point a = {.x = box[0], .y = box[1]}, b = {.x = box[2], .y = box[3]};
	int64_t from[2], to[2];
	__int128 n;

	view_thin_cell(t->view, &a, from);
	view_thin_cell(t->view, &b, to);
	from[0] = from[0] < t->rect.x0 ? t->rect.x0 : from[0];
	from[1] = from[1] < t->rect.y0 ? t->rect.y0 : from[1];
	to[0] = to[0] > t->rect.x1 ? t->rect.x1 : to[0];
	to[1] = to[1] > t->rect.y1 ? t->rect.y1 : to[1];
	n = (__int128)(to[0] - from[0] + 1) * (to[1] - from[1] + 1);
	return n < limit ? (uint64_t)n : limit;
}

static int bound_cell(void *ctx, const struct grid_cell *cell)
{
	struct thin *t = ctx;

	if (!wanted(t, cell))
		return 0;
	t->cells++;
	if (t->view->thin.pick == VIEW_PICK_MEDIAN)
		t->bound += cell->count;
	else
		t->bound += touched(t, cell->box, cell->distinct);
	return 0;
}

/* ---- one pass over a rectangle ---- */

static int take_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct thin *t = ctx;
	struct selection *s = t->s;
	int r = 0;

	(void)err;
	s->seen += n;
	for (size_t i = 0; !r && i < n; i++) {
		bool line = pts[i].tag & POINT_LINE;
		enum view_rule rule;

		if (!inside(t->box, &pts[i]))
			continue;
		rule = view_judge(s->p->view, &pts[i]);
		if (t->count) {
			s->judged++;
			t->kept += rule == VIEW_KEPT && !line;
			s->out.removed[rule] += rule != VIEW_KEPT;
		}
		if (rule == VIEW_KEPT && !line)
			r = t->take(t, &pts[i]);
	}
	return r ? r : selection_progress(s);
}

static int read_cell(void *ctx, const struct grid_cell *cell)
{
	struct thin *t = ctx;

	return wanted(t, cell) ? grid_cell_read(t->s->reader, cell, take_points, t, t->s->err) : 0;
}

static int read_rect(struct thin *t, bool count, int (*take)(struct thin *, const struct point *))
{
	const struct grid_visitor visitor = {t, enter, read_cell};

	t->count = count;
	t->take = take;
	return grid_walk(t->s->reader, 0, UINT64_MAX, &visitor, t->s->err);
}

/* ---- lowest and highest ---- */

static struct slot *slot_of(struct thin *t, uint32_t x, uint32_t y)
{
	uint64_t h = ((uint64_t)x << 32 | y) * UINT64_C(0x9e3779b97f4a7c15);
	size_t at = (size_t)((h >> 32) * t->slots >> 32);

	while (t->slot[at].x && (t->slot[at].x != x || t->slot[at].y != y))
		at = at + 1 == t->slots ? 0 : at + 1;
	return &t->slot[at];
}

static size_t best_cap(const struct thin *t)
{
	return (t->s->table_bytes / sizeof(struct slot) - 8) / 4 * 3;
}

static int take_best(struct thin *t, const struct point *p)
{
	struct slot *slot = t->last;
	int64_t cell[2];

	/* Neighbours in Morton order mostly share a thin cell. */
	if (!slot || !inside(t->last_box, p)) {
		struct rect one;
		uint32_t x, y;

		view_thin_cell(t->view, p, cell);
		one = (struct rect){cell[0], cell[1], cell[0], cell[1]};
		lattice_box(t, &one, t->last_box);
		x = (uint32_t)(cell[0] - t->rect.x0 + 1);
		y = (uint32_t)(cell[1] - t->rect.y0);
		slot = t->last = slot_of(t, x, y);
		if (!slot->x) {
			if (t->used++ == best_cap(t))
				return FULL;
			*slot = (struct slot){x, y, *p};
			return 0;
		}
	}
	if (view_thin_prefers(&t->view->thin, p, &slot->best))
		slot->best = *p;
	return 0;
}

static int run_best(struct thin *t)
{
	size_t most = t->bound < best_cap(t) ? (size_t)t->bound : best_cap(t);
	int r;

	t->slot = t->s->table;
	/* The load factor is at most three quarters. */
	t->slots = most + most / 3 + 4;
	t->used = 0;
	t->last = NULL;
	t->kept = 0;
	memset(t->slot, 0, t->slots * sizeof *t->slot);
	r = read_rect(t, true, take_best);
	for (size_t i = 0; !r && i < t->slots; i++)
		if (t->slot[i].x)
			r = selection_keep(t->s, &t->slot[i].best);
	if (!r)
		t->s->out.removed[VIEW_BY_THIN] += t->kept - t->used;
	return r;
}

/* ---- ranks ---- */

/* The order of view_thin_compare as a number. */
static rank_t rank_of(const struct point *p)
{
	rank_t rank = (uint32_t)p->z ^ 0x80000000u;

	rank = rank << 8 | p->cls;
	rank = rank << 8 | p->ret;
	rank = rank << 4 | point_flags(p);
	rank = rank << 32 | ((uint32_t)p->x ^ 0x80000000u);
	rank = rank << 32 | ((uint32_t)p->y ^ 0x80000000u);
	return rank << RANK_SLOT | (SLOTS_MOST - point_slot(p));
}

static struct point point_of(rank_t rank)
{
	unsigned slot = SLOTS_MOST - ((unsigned)rank & SLOTS_MOST);
	struct point p;

	rank >>= RANK_SLOT;
	p.y = (int32_t)((uint32_t)rank ^ 0x80000000u);
	p.x = (int32_t)((uint32_t)(rank >> 32) ^ 0x80000000u);
	p.tag = (uint16_t)(((unsigned)(rank >> 64) & POINT_FLAGS) | slot << POINT_SLOT_SHIFT);
	p.ret = (uint8_t)(rank >> 68);
	p.cls = (uint8_t)(rank >> 76);
	p.z = (int32_t)((uint32_t)(rank >> 84) ^ 0x80000000u);
	return p;
}

/* ---- sorting in place: introsort ---- */

static bool item_less(const struct thin *t, const struct item *a, const struct item *b)
{
	if (a->cell != b->cell)
		return a->cell < b->cell;
	if (a->p.z != b->p.z)
		return a->p.z < b->p.z;
	return view_thin_compare(&t->view->thin, &a->p, &b->p) < 0;
}

static void item_swap(struct item *a, struct item *b)
{
	struct item c = *a;

	*a = *b;
	*b = c;
}

static void sift(const struct thin *t, struct item *at, size_t i, size_t n)
{
	size_t child;

	for (; (child = 2 * i + 1) < n; i = child) {
		if (child + 1 < n && item_less(t, &at[child], &at[child + 1]))
			child++;
		if (!item_less(t, &at[i], &at[child]))
			return;
		item_swap(&at[i], &at[child]);
	}
}

static void heap_sort(const struct thin *t, struct item *at, size_t n)
{
	for (size_t i = n / 2; i-- > 0;)
		sift(t, at, i, n);
	while (n-- > 1) {
		item_swap(&at[0], &at[n]);
		sift(t, at, 0, n);
	}
}

static void insertion_sort(const struct thin *t, struct item *at, size_t n)
{
	for (size_t i = 1; i < n; i++) {
		struct item x = at[i];
		size_t k = i;

		for (; k && item_less(t, &x, &at[k - 1]); k--)
			at[k] = at[k - 1];
		at[k] = x;
	}
}

/* Hoare's partition around the middle of three; the smaller part is sorted by recursion. */
static void item_sort(const struct thin *t, struct item *at, size_t n, unsigned depth)
{
	while (n > 24) {
		size_t i = 0, j = n - 1;
		struct item pivot;

		if (!depth--) {
			heap_sort(t, at, n);
			return;
		}
		if (item_less(t, &at[n / 2], &at[0]))
			item_swap(&at[n / 2], &at[0]);
		if (item_less(t, &at[n - 1], &at[n / 2])) {
			item_swap(&at[n - 1], &at[n / 2]);
			if (item_less(t, &at[n / 2], &at[0]))
				item_swap(&at[n / 2], &at[0]);
		}
		pivot = at[n / 2];
		for (;; i++, j--) {
			while (item_less(t, &at[i], &pivot))
				i++;
			while (item_less(t, &pivot, &at[j]))
				j--;
			if (i >= j)
				break;
			item_swap(&at[i], &at[j]);
		}
		j++;
		if (j <= n - j) {
			item_sort(t, at, j, depth);
			at += j;
			n -= j;
		} else {
			item_sort(t, at + j, n - j, depth);
			n = j;
		}
	}
	insertion_sort(t, at, n);
}

static void sort_items(struct thin *t)
{
	unsigned depth = 2;

	for (size_t n = t->items; n; n >>= 1)
		depth += 2;
	item_sort(t, t->item, t->items, depth);
}

/* ---- median ---- */

static int take_item(struct thin *t, const struct point *p)
{
	int64_t cell[2];

	if (t->items == t->cap)
		return FULL;
	view_thin_cell(t->view, p, cell);
	t->item[t->items].cell = (uint64_t)(cell[0] - t->root.x0) << 32 | (uint32_t)(cell[1] - t->root.y0);
	t->item[t->items++].p = *p;
	return 0;
}

static int run_median(struct thin *t)
{
	size_t i, n;
	int r;

	t->items = 0;
	t->kept = 0;
	r = read_rect(t, true, take_item);
	if (r)
		return r;
	sort_items(t);
	for (i = 0; !r && i < t->items; i += n) {
		for (n = 1; i + n < t->items && t->item[i + n].cell == t->item[i].cell; n++)
			;
		r = selection_keep(t->s, &t->item[i + (n - 1) / 2].p);
		t->s->out.removed[VIEW_BY_THIN] += n - 1;
	}
	return r;
}

static int take_range(struct thin *t, const struct point *p)
{
	rank_t rank = rank_of(p);

	t->lo = rank < t->lo ? rank : t->lo;
	t->hi = rank > t->hi ? rank : t->hi;
	return 0;
}

static int take_digit(struct thin *t, const struct point *p)
{
	rank_t rank = rank_of(p);

	if (rank >= t->lo && rank <= t->hi)
		t->histogram[(size_t)((rank - t->lo) >> t->shift)]++;
	return 0;
}

static int take_match(struct thin *t, const struct point *p)
{
	rank_t rank = rank_of(p);

	return rank >= t->lo && rank <= t->hi ? take_item(t, p) : 0;
}

/* Narrows [lo, hi] to the bin that contains rank number *want, and makes *want and *left relative to that bin. */
static int narrow(struct thin *t, uint64_t *want, uint64_t *left)
{
	size_t digit = 0;
	int r;

	for (t->shift = 0; (t->hi - t->lo) >> t->shift >= DIGITS; t->shift++)
		;
	memset(t->histogram, 0, DIGITS * sizeof *t->histogram);
	r = read_rect(t, false, take_digit);
	if (r)
		return r;
	while (digit < DIGITS - 1 && t->histogram[digit] <= *want)
		*want -= t->histogram[digit++];
	*left = t->histogram[digit];
	t->lo += (rank_t)digit << t->shift;
	if ((t->hi - t->lo) >> t->shift)
		t->hi = t->lo + ((rank_t)1 << t->shift) - 1;
	return 0;
}

/* One thin cell with more points than fit the table. */
static int run_large_median(struct thin *t)
{
	uint64_t want, left;
	int r;

	t->lo = ~(rank_t)0;
	t->hi = 0;
	t->kept = 0;
	r = read_rect(t, true, take_range);
	if (r || !t->kept)
		return r;
	t->s->out.removed[VIEW_BY_THIN] += t->kept - 1;
	want = (t->kept - 1) / 2;
	for (left = t->kept; !r && left > t->cap && t->lo != t->hi;)
		r = narrow(t, &want, &left);
	if (r)
		return r;
	if (t->lo == t->hi) {
		struct point p = point_of(t->lo);

		return selection_keep(t->s, &p);
	}
	t->items = 0;
	r = read_rect(t, false, take_match);
	if (r)
		return r;
	sort_items(t);
	return selection_keep(t->s, &t->item[want].p);
}

/* ---- the plane ---- */

static int divide_rect(struct thin *t, const struct rect *r);

static int halve(struct thin *t, const struct rect *r)
{
	struct rect a = *r, b = *r;
	int status;

	if (r->x1 - r->x0 >= r->y1 - r->y0) {
		a.x1 = r->x0 + (r->x1 - r->x0) / 2;
		b.x0 = a.x1 + 1;
	} else {
		a.y1 = r->y0 + (r->y1 - r->y0) / 2;
		b.y0 = a.y1 + 1;
	}
	status = divide_rect(t, &a);
	return status ? status : divide_rect(t, &b);
}

/* Judges the whole rectangle. FULL: it does not fit, and nothing has changed. */
static int try_rect(struct thin *t, bool median)
{
	struct selection_counts before = t->s->out;
	uint64_t judged = t->s->judged;
	int r = median ? run_median(t) : run_best(t);

	if (r == FULL) {
		t->s->out = before;
		t->s->judged = judged;
	}
	return r;
}

/* A small rectangle meets at most so many cells of the cache, unless it has many points. */
static uint64_t few_cells(const struct thin *t)
{
	return 4 * (grid_manifest(t->s->p->grid)->nsegments + 1);
}

static int divide_rect(struct thin *t, const struct rect *r)
{
	const struct grid_visitor visitor = {t, enter, bound_cell};
	bool one = r->x0 == r->x1 && r->y0 == r->y1, median = t->view->thin.pick == VIEW_PICK_MEDIAN;
	uint64_t cap = median ? t->cap : best_cap(t);
	int status;

	t->rect = *r;
	lattice_box(t, r, t->box);
	t->bound = t->cells = 0;
	status = grid_walk(t->s->reader, 0, UINT64_MAX, &visitor, t->s->err);
	if (status || !t->bound)
		return status;
	if (!median && one)
		t->bound = 1;
	/* A column of the table has 32 bits. */
	if (r->x1 - r->x0 < UINT32_MAX && (t->bound <= cap || (t->cells <= few_cells(t) && !one))) {
		status = try_rect(t, median);
		if (status != FULL)
			return status;
	}
	return one ? run_large_median(t) : halve(t, r);
}

int selection_thin(struct selection *s)
{
	struct thin t = {.s = s, .view = s->p->view};
	struct point corner = {0};
	int64_t from[2], to[2];
	int32_t box[4];
	int r;

	if (!grid_box(s->p->grid, box))
		return 0;
	t.histogram = s->table;
	t.item = (struct item *)((uint8_t *)s->table + DIGITS * sizeof *t.histogram);
	t.cap = (s->table_bytes - DIGITS * sizeof *t.histogram) / sizeof *t.item;
	corner.x = box[0];
	corner.y = box[1];
	view_thin_cell(t.view, &corner, from);
	corner.x = box[2];
	corner.y = box[3];
	view_thin_cell(t.view, &corner, to);
	t.root = (struct rect){from[0], from[1], to[0], to[1]};
	r = divide_rect(&t, &t.root);
	return r ? r : selection_lines(s);
}
