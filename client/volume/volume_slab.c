/*
 * Pairs of triangles in memory where cells do not help: slivers around a vertex are in each other's cells.
 *
 * Each triangle is two pieces, left and right of its middle corner, so a piece is between two lines. The corners divide the plane
 * into slabs, which are the leaves of a tree. A piece is *long* in the highest nodes that it spans, and *short* in the nodes
 * above these. At any place where pieces of both sides overlap, one of them is long in a node in which the other is long or
 * short. The long pieces of one side in a node do not overlap, so they have an order from below; those that overlap another piece
 * are next to each other in it, and are found by halving. All comparisons are exact.
 *
 * The time is n log^2 n for n triangles, and log n for each pair that overlaps. Which pairs come does not depend on the order of
 * the triangles. The triangles of a side must not overlap each other.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "volume_priv.h"

/* Corners by x. */
struct figure {
	int32_t at[3][2];
	bool up;                 /* the middle one is above the line of the others */
	uint32_t from[2], to[2]; /* slabs of its pieces; the same: there is no such piece */
};

/* A side: its figures, and for each node of the tree the pieces that are long there. */
struct half {
	struct figure *figure;
	uint32_t n;
	uint32_t *start, *piece; /* piece: 2 * figure, and one for the right one */
	uint32_t *mark;          /* of figures: the last one of the other side that met it, and one */
};

struct slabs {
	struct half half[2];
	int32_t *x;       /* borders of slabs */
	uint32_t n, size; /* slabs; leaves of the tree, a power of two */
	const struct volume_slab_call *call;
	struct err *err;
};

/* ---- exact heights of edges ---- */

struct line {
	const int32_t *p, *q; /* p.x < q.x */
};

static struct line edge(const struct half *h, uint32_t piece, bool upper)
{
	const struct figure *f = &h->figure[piece / 2];
	bool right = piece & 1;

	if (f->up == upper)
		return (struct line){f->at[right], f->at[right + 1]};
	return (struct line){f->at[0], f->at[2]};
}

static double height(struct line l, int32_t x, double *scale)
{
	double dy = (double)l.q[1] - l.p[1];

	*scale += fabs((double)l.p[1]) + fabs(dy);
	return l.p[1] + dy * (((double)x - l.p[0]) / ((double)l.q[0] - l.p[0]));
}

static volume_i128 scaled(struct line l, int32_t x)
{
	return (volume_i128)l.p[1] * ((int64_t)l.q[0] - l.p[0]) + (volume_i128)((int64_t)l.q[1] - l.p[1]) * ((int64_t)x - l.p[0]);
}

/* Of the heights at x: -1, 0, 1. A double is wrong by 3 roundings of the numbers in `scale`. */
static int compare_at(struct line k, struct line l, int32_t x)
{
	double scale = 0, d = height(k, x, &scale) - height(l, x, &scale);
	volume_i128 v;

	if (fabs(d) > 0x1p-50 * scale)
		return d > 0 ? 1 : -1;
	v = scaled(k, x) * ((int64_t)l.q[0] - l.p[0]) - scaled(l, x) * ((int64_t)k.q[0] - k.p[0]);
	return (v > 0) - (v < 0);
}

static bool not_above(struct line k, struct line l, int32_t left, int32_t right)
{
	return compare_at(k, l, left) <= 0 && compare_at(k, l, right) <= 0;
}

/* ---- nodes ---- */

static void node_slabs(const struct slabs *s, uint32_t node, uint32_t *from, uint32_t *to)
{
	uint32_t width = s->size >> (31 - __builtin_clz(node));

	*from = node * width - s->size;
	*to = *from + width < s->n ? *from + width : s->n;
}

/* Where two pieces may meet in a node in which the first one is long. */
struct meeting {
	int32_t left, right;
};

static struct meeting meeting(const struct slabs *s, uint32_t node, const struct figure *f, bool right)
{
	uint32_t from, to;

	node_slabs(s, node, &from, &to);
	from = f->from[right] > from ? f->from[right] : from;
	to = f->to[right] < to ? f->to[right] : to;
	return (struct meeting){s->x[from], s->x[to]};
}

/* The nodes in which it is long. */
static void each_long(const struct slabs *s, const struct figure *f, bool right, void (*each)(void *ctx, uint32_t node),
		      void *ctx)
{
	uint32_t l = f->from[right] + s->size, r = f->to[right] + s->size;

	for (; l < r; l >>= 1, r >>= 1) {
		if (l & 1)
			each(ctx, l++);
		if (r & 1)
			each(ctx, --r);
	}
}

static bool spans(const struct slabs *s, const struct figure *f, bool right, uint32_t node)
{
	uint32_t from, to;

	node_slabs(s, node, &from, &to);
	return f->from[right] <= from && f->to[right] >= from + (s->size >> (31 - __builtin_clz(node)));
}

/* ---- what is read ---- */

static void figure_init(struct figure *f, const struct volume_triangle *t)
{
	for (int i = 0; i < 3; i++)
		memcpy(f->at[i], t->at[i], sizeof(f->at[i]));
	for (int i = 0; i < 3; i++) { /* bubbles */
		int k = i & 1;
		int32_t hold[2];

		if (f->at[k][0] < f->at[k + 1][0] || (f->at[k][0] == f->at[k + 1][0] && f->at[k][1] <= f->at[k + 1][1]))
			continue;
		memcpy(hold, f->at[k], sizeof(hold));
		memcpy(f->at[k], f->at[k + 1], sizeof(hold));
		memcpy(f->at[k + 1], hold, sizeof(hold));
	}
	f->up = (volume_i128)((int64_t)f->at[2][0] - f->at[0][0]) * ((int64_t)f->at[1][1] - f->at[0][1]) >
		(volume_i128)((int64_t)f->at[2][1] - f->at[0][1]) * ((int64_t)f->at[1][0] - f->at[0][0]);
}

static int compare_x(const void *a, const void *b)
{
	int32_t x = *(const int32_t *)a, y = *(const int32_t *)b;

	return (x > y) - (x < y);
}

static uint32_t slab_of(const struct slabs *s, int32_t x)
{
	uint32_t low = 0, high = s->n;

	while (low < high) {
		uint32_t middle = (low + high) / 2;

		if (s->x[middle] < x)
			low = middle + 1;
		else
			high = middle;
	}
	return low;
}

static int32_t within(int64_t x, int64_t low, int64_t high)
{
	return (int32_t)(x < low ? low : x > high ? high : x);
}

static void make_slabs(struct slabs *s, int64_t low, int64_t high)
{
	size_t n = 0;

	for (int i = 0; i < 2; i++)
		for (uint32_t k = 0; k < s->half[i].n; k++)
			for (int c = 0; c < 3; c++)
				s->x[n++] = within(s->half[i].figure[k].at[c][0], low, high);
	qsort(s->x, n, sizeof(*s->x), compare_x);
	for (size_t i = 0; i < n; i++)
		if (!i || s->x[i] != s->x[s->n])
			s->x[i ? ++s->n : 0] = s->x[i];
	for (s->size = 1; s->size < s->n;)
		s->size *= 2;
	for (int i = 0; i < 2; i++)
		for (uint32_t k = 0; k < s->half[i].n; k++) {
			struct figure *f = &s->half[i].figure[k];

			for (int c = 0; c < 2; c++) {
				f->from[c] = slab_of(s, within(f->at[c][0], low, high));
				f->to[c] = slab_of(s, within(f->at[c + 1][0], low, high));
			}
		}
}

/* ---- long pieces, from below ---- */

struct fill {
	struct half *half;
	uint32_t piece;
	bool count;
};

static void fill_node(void *ctx, uint32_t node)
{
	struct fill *f = ctx;

	if (f->count)
		f->half->start[node]++;
	else
		f->half->piece[--f->half->start[node]] = f->piece;
}

struct order {
	const struct half *half;
	int32_t left, right;
};

/* Those that overlap come in any order. */
static int compare_pieces(const void *a, const void *b, void *ctx)
{
	const struct order *o = ctx;
	uint32_t k = *(const uint32_t *)a, l = *(const uint32_t *)b;
	struct line p = edge(o->half, k, false), q = edge(o->half, l, false);
	int c = compare_at(p, q, o->left);

	c = c ? c : compare_at(p, q, o->right);
	return c ? c : (k > l) - (k < l);
}

static int make_lists(struct slabs *s, struct half *h)
{
	struct fill f = {.half = h, .count = true};
	size_t sum = 0;

	h->start = calloc(2 * (size_t)s->size + 1, sizeof(*h->start));
	h->mark = calloc(h->n + 1, sizeof(*h->mark));
	if (!h->start || !h->mark)
		return -1;
	for (int pass = 0; pass < 2; pass++) {
		for (uint32_t i = 0; i < 2 * h->n; i++) {
			f.piece = i;
			each_long(s, &h->figure[i / 2], i & 1, fill_node, &f);
		}
		if (pass)
			break;
		for (size_t i = 0; i <= 2 * (size_t)s->size; i++)
			h->start[i] = (uint32_t)(sum += h->start[i]);
		h->piece = malloc((sum + 1) * sizeof(*h->piece));
		if (!h->piece)
			return -1;
		f.count = false;
	}
	for (uint32_t node = 1; node < 2 * s->size; node++) {
		struct order o = {.half = h};
		uint32_t from, to, n = h->start[node + 1] - h->start[node];

		if (n < 2)
			continue;
		node_slabs(s, node, &from, &to);
		o.left = s->x[from];
		o.right = s->x[to];
		qsort_r(h->piece + h->start[node], n, sizeof(*h->piece), compare_pieces, &o);
	}
	return 0;
}

/* ---- pairs ---- */

/* The piece `other` of half[!side] in a node, against the long ones of half[side]. */
struct query {
	struct slabs *s;
	int side;
	uint32_t other;
	int r;
};

/* Whether the piece that is long in the node overlaps the other one there. */
static bool overlap(const struct query *q, uint32_t piece, const struct meeting *m)
{
	const struct half *mine = &q->s->half[q->side], *theirs = &q->s->half[!q->side];

	return !not_above(edge(mine, piece, true), edge(theirs, q->other, false), m->left, m->right) &&
	       !not_above(edge(theirs, q->other, true), edge(mine, piece, false), m->left, m->right);
}

/* Whether the first pass, over the triangles of b, finds the pair of these two pieces: that of a is long where that of b is. */
struct found {
	const struct slabs *s;
	uint32_t a, b;
	bool yes;
};

static void found_in(void *ctx, uint32_t node)
{
	struct found *f = ctx;
	const struct query q = {.s = (struct slabs *)f->s, .side = 0, .other = f->b};
	const struct figure *b = &f->s->half[1].figure[f->b / 2];
	struct meeting m;

	if (f->yes || (node > 1 && spans(f->s, b, f->b & 1, node / 2)))
		return;
	m = meeting(f->s, node, b, f->b & 1);
	f->yes = m.left < m.right && overlap(&q, f->a, &m);
}

static bool was_found(const struct slabs *s, uint32_t a, uint32_t b)
{
	struct found f = {.s = s};

	for (uint32_t i = 0; i < 4 && !f.yes; i++) {
		f.a = 2 * a + (i & 1);
		f.b = 2 * b + (i >> 1);
		if (s->half[1].figure[b].from[f.b & 1] < s->half[1].figure[b].to[f.b & 1])
			each_long(s, &s->half[0].figure[a], f.a & 1, found_in, &f);
	}
	return f.yes;
}

static int take(struct query *q, uint32_t piece)
{
	struct slabs *s = q->s;
	struct half *mine = &s->half[q->side];
	uint32_t a = q->side ? q->other / 2 : piece / 2, b = q->side ? piece / 2 : q->other / 2;

	if (mine->mark[piece / 2] == q->other / 2 + 1)
		return 0;
	mine->mark[piece / 2] = q->other / 2 + 1;
	return q->side && was_found(s, a, b) ? 0 : s->call->each(s->call->ctx, a, b);
}

static void look(void *ctx, uint32_t node)
{
	struct query *q = ctx;
	const struct slabs *s = q->s;
	const struct half *mine = &s->half[q->side], *theirs = &s->half[!q->side];
	uint32_t low = mine->start[node], end = mine->start[node + 1], high = end;
	struct meeting m;

	if (q->r || low == end)
		return;
	m = meeting(s, node, &theirs->figure[q->other / 2], q->other & 1);
	if (m.left >= m.right)
		return;
	while (low < high) {
		uint32_t middle = low + (high - low) / 2;

		if (not_above(edge(mine, mine->piece[middle], true), edge(theirs, q->other, false), m.left, m.right))
			low = middle + 1;
		else
			high = middle;
	}
	for (; low < end && overlap(q, mine->piece[low], &m) && !q->r; low++)
		q->r = take(q, mine->piece[low]);
}

/* Above those in which it is long. */
static void look_above(struct query *q, const struct figure *f, bool right)
{
	uint32_t l = f->from[right] + q->s->size, r = f->to[right] - 1 + q->s->size;

	for (l >>= 1, r >>= 1; l; l >>= 1, r >>= 1) {
		if (!spans(q->s, f, right, l))
			look(q, l);
		if (r != l && !spans(q->s, f, right, r))
			look(q, r);
	}
}

static int pass(struct slabs *s, int side)
{
	const struct half *theirs = &s->half[!side];
	struct query q = {.s = s, .side = side};

	for (uint32_t i = 0; i < 2 * theirs->n && !q.r; i++) {
		const struct figure *f = &theirs->figure[i / 2];
		bool right = i & 1;

		q.other = i;
		if (f->from[right] >= f->to[right])
			continue;
		if (!side) /* where both are long the first pass finds them */
			each_long(s, f, right, look, &q);
		look_above(&q, f, right);
		if (!q.r && !(i & 63) && s->call->interrupted && s->call->interrupted(s->call->ctx_interrupted))
			q.r = err_set(s->err, ERR_CANCELLED, "interrupted");
	}
	return q.r;
}

static int half_init(struct half *h, const struct volume_triangle *t, const uint32_t *index, size_t n)
{
	h->n = (uint32_t)n;
	h->figure = malloc((n + 1) * sizeof(*h->figure));
	for (size_t i = 0; i < n && h->figure; i++)
		figure_init(&h->figure[i], &t[index[i]]);
	return h->figure ? 0 : -1;
}

int volume_slabs(const struct volume_triangle *a, const uint32_t *ia, size_t na, const struct volume_triangle *b,
		 const uint32_t *ib, size_t nb, const int64_t x[2], const struct volume_slab_call *call, struct err *err)
{
	struct slabs s = {.call = call, .err = err};
	int r = half_init(&s.half[0], a, ia, na) | half_init(&s.half[1], b, ib, nb);

	s.x = malloc((3 * (na + nb) + 1) * sizeof(*s.x));
	r = r || !s.x ? -1 : 0;
	if (!r && na && nb) {
		make_slabs(&s, x[0] > INT32_MIN ? x[0] : INT32_MIN, x[1] < INT32_MAX ? x[1] : INT32_MAX);
		r = make_lists(&s, &s.half[0]) || make_lists(&s, &s.half[1]) ? -1 : 0;
	}
	if (r)
		r = err_set(err, ERR_NOMEM, "no memory for pairs of triangles");
	for (int side = 0; side < 2 && !r && s.n; side++)
		r = pass(&s, side);
	for (int i = 0; i < 2; i++) {
		free(s.half[i].figure);
		free(s.half[i].start);
		free(s.half[i].piece);
		free(s.half[i].mark);
	}
	free(s.x);
	return r;
}
