/*
 * Ways through areas (area_way.h).
 *
 * Of each ring that comes near the segment it is known whether the beginning is in it, and each edge that is crossed inverts
 * that. Inside of the area is a union of polygons less their holes: so it is followed from one crossing to the next, and those
 * that change nothing are left out. The order of crossings is that of doubles: two that are as near as that may change their
 * places, which is a way of no length. What is inside at the end does not depend on it.
 */
#include "area_way.h"

#include <stdlib.h>

#include "area_priv.h"
#include "err.h"
#include "wide.h"

typedef __int128 i128;

/* A ring near the segment. */
struct near {
	size_t ring, shell; /* shell: of its polygon, among the near ones */
	uint32_t holes;     /* of a shell: in how many of its holes the place is */
	bool in;            /* the ring */
};

struct area_way {
	const struct area *area;
	struct near *near;    /* as many as there are rings */
	size_t nnear, inside; /* polygons that the place is in */
	struct area_crossing *crossing;
	size_t n, room;
	const struct area_segment *segment;
	int64_t box[4], at[2]; /* of the segment; its beginning, rounded down */
};

int area_way_new(const struct area *a, struct area_way **ret, struct err *err)
{
	struct area_way *w = calloc(1, sizeof(*w));

	if (w) {
		w->area = a;
		w->near = malloc((a->nring + 1) * sizeof(*w->near));
	}
	if (!w || !w->near) {
		area_way_free(w);
		return err_set(err, ERR_NOMEM, "no memory for an area");
	}
	*ret = w;
	return 0;
}

struct area_way *area_way_free(struct area_way *w)
{
	if (w) {
		free(w->near);
		free(w->crossing);
	}
	free(w);
	return NULL;
}

/* ---- places ---- */

static int64_t down(const struct area_place *p, int axis)
{
	i128 n = (i128)(p->to[axis] - p->from[axis]) * p->n, d = n / p->d;

	return p->from[axis] + (int64_t)(d * p->d > n ? d - 1 : d);
}

static i128 turn_of(const int64_t p[2], const int64_t q[2], const int64_t v[2])
{
	return (i128)(q[0] - p[0]) * (v[1] - p[1]) - (i128)(v[0] - p[0]) * (q[1] - p[1]);
}

/* d times twice the area of the triangle p, q, place: above zero where the place is left of the way from p to q. */
static struct wide turn(const int64_t p[2], const int64_t q[2], const struct area_place *place)
{
	return wide_sum(wide_product(turn_of(p, q, place->from), place->d - place->n),
			wide_product(turn_of(p, q, place->to), place->n));
}

/* Of the way from the lesser to the greater end; a place on it is moved. */
static int moved(struct wide turn, const int64_t low[2], const int64_t high[2])
{
	int sign = wide_sign(turn);

	return sign ? sign : low[1] != high[1] ? (low[1] < high[1] ? -1 : 1) : high[0] > low[0];
}

/* ---- rings ---- */

/* As chain_crosses in area.c: whether a ray from the beginning to greater x crosses the chain an odd number of times. */
static bool chain_crosses(const struct area_way *w, const struct area_ring *r, struct node n)
{
	const struct area *a = w->area;
	const int64_t *box = a->box[n.box], x = w->at[0], y = w->at[1];
	bool odd = false;

	if (y < box[1] || y >= box[3] || x >= box[2])
		return false;
	if (x < box[0])
		return (corner_of(a, r, first_edge(n))[1] <= y) != (corner_of(a, r, last_edge(r, n))[1] <= y);
	if (!is_leaf(n))
		return chain_crosses(w, r, left_of(n)) != chain_crosses(w, r, right_of(n));
	for (size_t i = first_edge(n); i < last_edge(r, n); i++) {
		const int64_t *p = corner_of(a, r, i), *q = corner_of(a, r, i + 1);
		bool rises = p[1] < q[1];

		if ((p[1] <= y) != (q[1] <= y))
			odd ^= wide_sign(turn(rises ? p : q, rises ? q : p, &w->segment->a)) > 0;
	}
	return odd;
}

static struct node chain_of(const struct area_ring *r)
{
	return (struct node){r->box, 0, leaves(r)};
}

static void find_near(struct area_way *w, const struct area_set *s, struct node n, size_t shell)
{
	const struct area *a = w->area;
	struct near *near;

	if (!boxes_meet(a->box[n.box], w->box))
		return;
	if (!is_leaf(n)) {
		find_near(w, s, left_of(n), shell);
		find_near(w, s, right_of(n), shell);
		return;
	}
	near = &w->near[w->nnear];
	*near = (struct near){.ring = a->item[s->item + n.low].ring, .shell = shell == SIZE_MAX ? w->nnear : shell};
	near->in = chain_crosses(w, &a->ring[near->ring], chain_of(&a->ring[near->ring]));
	w->nnear++;
	if (shell != SIZE_MAX) {
		w->near[shell].holes += near->in;
	} else {
		const struct area_set *holes = &a->ring[near->ring].holes;

		if (holes->n)
			find_near(w, holes, (struct node){holes->box, 0, holes->n}, w->nnear - 1);
		near = &w->near[near->shell];
		w->inside += near->in && !near->holes;
	}
}

/* ---- crossings ---- */

static int add_crossing(struct area_way *w, const struct area_crossing *crossing, struct err *err)
{
	if (w->n == w->room) {
		size_t room = w->room ? 2 * w->room : 16;
		void *more = realloc(w->crossing, room * sizeof(*w->crossing));

		if (!more)
			return err_set(err, ERR_NOMEM, "no memory for an area");
		w->crossing = more;
		w->room = room;
	}
	w->crossing[w->n++] = *crossing;
	return 0;
}

static int edge(struct area_way *w, size_t near, const int64_t *p, const int64_t *q, struct err *err)
{
	const struct area_segment *s = w->segment;
	bool less = p[0] != q[0] ? p[0] < q[0] : p[1] < q[1];
	const int64_t *low = less ? p : q, *high = less ? q : p;
	const struct wide a = turn(low, high, &s->a), b = turn(low, high, &s->b);
	double from = wide_double(a) / (double)s->a.d, to = wide_double(b) / (double)s->b.d;

	if (moved(a, low, high) == moved(b, low, high) || s->side(s->ctx, low) == s->side(s->ctx, high))
		return 0;
	return add_crossing(w, &(struct area_crossing){from / (from - to), low, high, near}, err);
}

static int chain_edges(struct area_way *w, size_t near, struct node n, struct err *err)
{
	const struct area *a = w->area;
	const struct area_ring *r = &a->ring[w->near[near].ring];
	int e = 0;

	if (!boxes_meet(a->box[n.box], w->box))
		return 0;
	if (!is_leaf(n)) {
		e = chain_edges(w, near, left_of(n), err);
		return e ? e : chain_edges(w, near, right_of(n), err);
	}
	for (size_t i = first_edge(n); i < last_edge(r, n) && !e; i++)
		e = edge(w, near, corner_of(a, r, i), corner_of(a, r, i + 1), err);
	return e;
}

static int by_part(const void *a, const void *b)
{
	const struct area_crossing *p = a, *q = b;

	if (p->part != q->part)
		return p->part < q->part ? -1 : 1;
	return (p->ring > q->ring) - (p->ring < q->ring);
}

/* Past an edge of a ring. Whether that changes what is inside of the area. */
static bool pass(struct area_way *w, size_t ring)
{
	struct near *near = &w->near[ring], *shell = &w->near[near->shell];
	bool was = w->inside, in = shell->in && !shell->holes;

	near->in = !near->in;
	if (near != shell)
		shell->holes += near->in ? 1u : -1u;
	w->inside += (size_t)(shell->in && !shell->holes) - (size_t)in;
	return (w->inside > 0) != was;
}

/* A square of the whole numbers around both ends. */
static void put_box(struct area_way *w)
{
	const struct area_segment *s = w->segment;

	for (int i = 0; i < 2; i++) {
		int64_t a = down(&s->a, i), b = down(&s->b, i);

		w->at[i] = a;
		w->box[i] = a < b ? a : b;
		w->box[2 + i] = (a > b ? a : b) + 1;
	}
}

int area_way(struct area_way *w, const struct area_segment *segment, bool *ret_in, const struct area_crossing **ret,
	     size_t *ret_n, struct err *err)
{
	const struct area_set *polygons = &w->area->polygons;
	size_t n = 0;
	int r = 0;

	w->segment = segment;
	w->nnear = w->inside = w->n = 0;
	put_box(w);
	if (polygons->n)
		find_near(w, polygons, (struct node){polygons->box, 0, polygons->n}, SIZE_MAX);
	*ret_in = w->inside > 0;
	for (size_t i = 0; i < w->nnear && !r; i++)
		r = chain_edges(w, i, chain_of(&w->area->ring[w->near[i].ring]), err);
	if (r)
		return r;
	if (w->n > 1)
		qsort(w->crossing, w->n, sizeof(*w->crossing), by_part);
	for (size_t i = 0; i < w->n; i++)
		if (pass(w, w->crossing[i].ring))
			w->crossing[n++] = w->crossing[i];
	*ret = w->crossing;
	*ret_n = n;
	return 0;
}
