/*
 * Greedy insertion. Each triangle has a list of the points in it, and its farthest one; a heap has the triangles by that. An
 * insertion removes the triangles whose circle contains the new point, fills the hole with a fan, and deals their points out to
 * it. Nothing is beyond the base, which has the corners of the hull, so there are no ghosts: a side of the hull has no neighbour.
 *
 * The surface above a point is a fraction with twice the triangle's area D below, so the farthest point of a triangle has the
 * greatest |N|, N = D * (height of the surface - z). All numbers are exact, and equal ones are decided by x, then y.
 */
#include "simplify_greedy.h"

#include <limits.h>
#include <string.h>

#include "align.h"
#include "digest.h"
#include "geom.h"
#include "simplify_error.h"
#include "tri.h"

#define NONE UINT32_MAX

struct cell {
	uint64_t key;
	uint32_t corner[3], beside[3]; /* neighbours across from the corners */
	uint32_t first, worst;         /* of its points; the farthest one, or NONE */
	uint32_t heap;                 /* its place in the heap, or NONE */
	uint32_t hole;                 /* number of the last insertion that removed it */
};

/* A side of the hole, counter-clockwise, and what is behind it. */
struct side {
	uint32_t a, b, beyond, cell;
};

struct greedy {
	struct simplify_greedy *g;
	const struct point *pts;
	struct cell *cell;
	struct side *side;
	uint32_t *next, *heap, *hole, *from; /* from: of a vertex of the hole, the side that begins there */
	struct tri *tri;                     /* of the base */
	struct simplify_place *order;
	uint32_t ncell, nheap, nhole, nside, insertion;
};

size_t simplify_greedy_bytes(uint32_t n)
{
	size_t each = n + 3;

	return align_line(2 * each * sizeof(struct cell)) + align_line(2 * each * sizeof(struct side)) +
	       align_line(2 * each * sizeof(uint32_t)) * 2 + align_line(each * sizeof(uint32_t)) * 3 +
	       align_line(each * sizeof(struct simplify_pick)) + align_line(each * sizeof(struct simplify_place)) +
	       align_line(tri_bytes((uint32_t)each));
}

static void carve(struct greedy *w, struct simplify_greedy *g, void *memory)
{
	size_t each = g->n + 3;
	uint8_t *at = memory;

	memset(w, 0, sizeof *w);
	w->g = g;
	w->pts = g->pts;
	w->cell = align_carve(&at, 2 * each * sizeof *w->cell);
	w->side = align_carve(&at, 2 * each * sizeof *w->side);
	w->heap = align_carve(&at, 2 * each * sizeof *w->heap);
	w->hole = align_carve(&at, 2 * each * sizeof *w->hole);
	w->next = align_carve(&at, each * sizeof *w->next);
	w->from = align_carve(&at, each * sizeof *w->from);
	g->hull = align_carve(&at, each * sizeof *g->hull);
	g->pick = align_carve(&at, each * sizeof *g->pick);
	w->order = align_carve(&at, each * sizeof *w->order);
	w->tri = (struct tri *)at;
}

static inline void xy_of(const struct greedy *w, uint32_t i, int32_t ret[2])
{
	ret[0] = w->pts[i].x;
	ret[1] = w->pts[i].y;
}

static inline int turn(const struct greedy *w, uint32_t a, uint32_t b, uint32_t c)
{
	int32_t p[2], q[2], r[2];

	xy_of(w, a, p);
	xy_of(w, b, q);
	xy_of(w, c, r);
	return geom_orient(p, q, r);
}

/* ---- the heap: the greatest key first, then the first point by x and y ---- */

static bool is_before(const struct greedy *w, uint32_t t, uint32_t u)
{
	const struct cell *a = &w->cell[t], *b = &w->cell[u];
	const struct point *p = &w->pts[a->worst], *q = &w->pts[b->worst];

	if (a->key != b->key)
		return a->key > b->key;
	return digest_place(p->x, p->y) < digest_place(q->x, q->y);
}

static void heap_set(struct greedy *w, uint32_t at, uint32_t t)
{
	w->heap[at] = t;
	w->cell[t].heap = at;
}

static void heap_up(struct greedy *w, uint32_t at, uint32_t t)
{
	for (; at && is_before(w, t, w->heap[(at - 1) / 2]); at = (at - 1) / 2)
		heap_set(w, at, w->heap[(at - 1) / 2]);
	heap_set(w, at, t);
}

static void heap_down(struct greedy *w, uint32_t at, uint32_t t)
{
	for (;;) {
		uint32_t child = 2 * at + 1;

		if (child + 1 < w->nheap && is_before(w, w->heap[child + 1], w->heap[child]))
			child++;
		if (child >= w->nheap || !is_before(w, w->heap[child], t))
			break;
		heap_set(w, at, w->heap[child]);
		at = child;
	}
	heap_set(w, at, t);
}

static void heap_add(struct greedy *w, uint32_t t)
{
	heap_up(w, w->nheap++, t);
}

static void heap_remove(struct greedy *w, uint32_t t)
{
	uint32_t at = w->cell[t].heap, last;

	if (at == NONE)
		return;
	w->cell[t].heap = NONE;
	last = w->heap[--w->nheap];
	if (last == t)
		return;
	heap_down(w, at, last);
	heap_up(w, w->cell[last].heap, last);
}

/* ---- the farthest point of a triangle ---- */

static void judge(struct greedy *w, uint32_t t)
{
	struct cell *c = &w->cell[t];
	struct simplify_plane plane;
	geom_u128 most = 0;

	c->worst = NONE;
	c->key = 0;
	c->heap = NONE;
	if (c->first == NONE)
		return;
	simplify_plane_init(&plane, &w->pts[c->corner[0]], &w->pts[c->corner[1]], &w->pts[c->corner[2]]);
	for (uint32_t i = c->first; i != NONE; i = w->next[i]) {
		const struct point *p = &w->pts[i];
		geom_u128 far = simplify_plane_far(&plane, p->x, p->y, p->z);

		if (far < most || !far)
			continue;
		if (far == most && digest_place(p->x, p->y) > digest_place(w->pts[c->worst].x, w->pts[c->worst].y))
			continue;
		most = far;
		c->worst = i;
	}
	c->key = simplify_plane_key(&plane, most);
	if (c->key > w->g->least)
		heap_add(w, t);
}

/* ---- insertion ---- */

static bool has_in_circle(const struct greedy *w, const struct cell *c, uint32_t p)
{
	int32_t a[2], b[2], d[2], at[2];

	xy_of(w, c->corner[0], a);
	xy_of(w, c->corner[1], b);
	xy_of(w, c->corner[2], d);
	xy_of(w, p, at);
	return geom_incircle(a, b, d, at) > 0;
}

/* The triangles whose circle contains p, from t on, and the sides of the hole that they leave. A side on which p lies is none:
 * it is a side of the hull, which p divides. */
static void dig(struct greedy *w, uint32_t t, uint32_t p)
{
	w->insertion++;
	w->nside = 0;
	w->nhole = 1;
	w->hole[0] = t;
	w->cell[t].hole = w->insertion;
	for (uint32_t i = 0; i < w->nhole; i++) {
		const struct cell *c = &w->cell[w->hole[i]];

		for (unsigned k = 0; k < 3; k++) {
			uint32_t other = c->beside[k], a = c->corner[(k + 1) % 3], b = c->corner[(k + 2) % 3];

			if (other != NONE && w->cell[other].hole == w->insertion)
				continue;
			if (other != NONE && has_in_circle(w, &w->cell[other], p)) {
				w->cell[other].hole = w->insertion;
				w->hole[w->nhole++] = other;
				continue;
			}
			if (other == NONE && turn(w, a, b, p) == 0)
				continue;
			w->side[w->nside++] = (struct side){.a = a, .b = b, .beyond = other};
		}
	}
}

/* Of all points of the hole, except p, one list; its triangles leave the heap. */
static uint32_t collect(struct greedy *w, uint32_t p)
{
	uint32_t all = NONE;

	for (uint32_t i = 0; i < w->nhole; i++) {
		struct cell *c = &w->cell[w->hole[i]];

		heap_remove(w, w->hole[i]);
		for (uint32_t q = c->first, next; q != NONE; q = next) {
			next = w->next[q];
			if (q == p)
				continue;
			w->next[q] = all;
			all = q;
		}
	}
	return all;
}

static void replace_beside(struct cell *c, uint32_t a, uint32_t b, uint32_t t)
{
	for (unsigned k = 0; k < 3; k++)
		if (c->corner[(k + 1) % 3] == b && c->corner[(k + 2) % 3] == a)
			c->beside[k] = t;
}

/* A triangle on each side of the hole, with p. */
static void fill(struct greedy *w, uint32_t p)
{
	for (uint32_t i = 0; i < w->nside; i++) {
		w->side[i].cell = i < w->nhole ? w->hole[i] : w->ncell++;
		w->from[w->side[i].a] = i;
	}
	/* A vertex of the hole at which no side begins is the end of an open fan. */
	for (uint32_t i = 0; i < w->nside; i++) {
		const struct side *s = &w->side[i];
		uint32_t after = w->from[s->b], t = s->cell;
		struct cell *c = &w->cell[t];

		if (after >= w->nside || w->side[after].a != s->b)
			after = NONE;
		c->corner[0] = p;
		c->corner[1] = s->a;
		c->corner[2] = s->b;
		c->first = NONE;
		c->hole = 0;
		c->beside[0] = s->beyond;
		c->beside[1] = after == NONE ? NONE : w->side[after].cell;
		if (s->beyond != NONE)
			replace_beside(&w->cell[s->beyond], s->a, s->b, t);
	}
}

/* The neighbour across from corner 2 is that of the side before. */
static void link_back(struct greedy *w)
{
	for (uint32_t i = 0; i < w->nside; i++)
		w->cell[w->side[i].cell].beside[2] = NONE;
	for (uint32_t i = 0; i < w->nside; i++) {
		uint32_t t = w->side[i].cell, after = w->cell[t].beside[1];

		if (after != NONE)
			w->cell[after].beside[2] = t;
	}
}

/* The triangle of the fan around p that has q: goes around until q is between two spokes. */
static uint32_t find_in_fan(const struct greedy *w, uint32_t p, uint32_t q, uint32_t t)
{
	bool left = turn(w, p, w->cell[t].corner[1], q) >= 0;

	for (;;) {
		const struct cell *c = &w->cell[t];

		if (left) {
			if (turn(w, p, c->corner[2], q) <= 0)
				return t;
			t = c->beside[1];
		} else {
			t = c->beside[2];
			left = turn(w, p, w->cell[t].corner[1], q) >= 0;
		}
	}
}

static void deal(struct greedy *w, uint32_t p, uint32_t all)
{
	uint32_t t = w->side[0].cell;

	for (uint32_t q = all, next; q != NONE; q = next) {
		next = w->next[q];
		t = find_in_fan(w, p, q, t);
		w->next[q] = w->cell[t].first;
		w->cell[t].first = q;
	}
}

static void insert(struct greedy *w, uint32_t t)
{
	uint32_t p = w->cell[t].worst, all;

	dig(w, t, p);
	all = collect(w, p);
	fill(w, p);
	link_back(w);
	deal(w, p, all);
	for (uint32_t i = 0; i < w->nside; i++)
		judge(w, w->side[i].cell);
}

/* ---- the base ---- */

/* The triangulation of the hull's corners and the vertices of lines, without its ghosts. `from` marks the base. */
static bool make_base(struct greedy *w)
{
	struct simplify_greedy *g = w->g;
	struct mesh_vertex *in;
	struct tri_result tri;
	uint32_t n = 0, *number = w->heap, *index = w->hole; /* which are not used yet */

	memset(w->from, 0, g->n * sizeof *w->from);
	for (uint32_t i = 0; i < g->nhull; i++)
		w->from[g->hull[i]] = 1;
	for (uint32_t i = 0; i < g->n; i++)
		n += w->from[i] = w->from[i] || (w->pts[i].tag & POINT_LINE);
	w->tri = tri_init(w->tri, n < 4 ? 4 : n);
	in = tri_input(w->tri);
	n = 0;
	for (uint32_t i = 0; i < g->n; i++)
		if (w->from[i]) {
			index[n] = i;
			in[n++] = (struct mesh_vertex){w->pts[i].x, w->pts[i].y, w->pts[i].z};
		}
	if (tri_run(w->tri, n))
		return false;
	tri_result(w->tri, &tri);
	for (uint32_t i = 0; i < tri.ntriangle; i++) {
		const uint32_t *c = tri.triangle[i].corner;

		number[i] = c[0] == TRI_GHOST || c[1] == TRI_GHOST || c[2] == TRI_GHOST ? NONE : w->ncell++;
	}
	for (uint32_t i = 0; i < tri.ntriangle; i++) {
		struct cell *c = &w->cell[number[i]];

		if (number[i] == NONE)
			continue;
		*c = (struct cell){.first = NONE, .worst = NONE, .heap = NONE};
		for (unsigned k = 0; k < 3; k++) {
			c->corner[k] = index[tri.id[tri.triangle[i].corner[k]]];
			c->beside[k] = number[tri.triangle[i].link[k] >> 3];
		}
	}
	return true;
}

/* Walks to the triangle that contains the point. In a Delaunay triangulation a walk has an end. */
static uint32_t locate(const struct greedy *w, uint32_t p, uint32_t t)
{
	for (unsigned k = 0; k < 3; k++) {
		const struct cell *c = &w->cell[t];

		if (turn(w, c->corner[(k + 1) % 3], c->corner[(k + 2) % 3], p) >= 0)
			continue;
		t = c->beside[k];
		k = UINT_MAX;
	}
	return t;
}

static void deal_first(struct greedy *w)
{
	uint32_t t = 0;

	for (uint32_t i = 0; i < w->g->n; i++) {
		if (w->from[i])
			continue;
		t = locate(w, i, t);
		w->next[i] = w->cell[t].first;
		w->cell[t].first = i;
	}
	for (t = 0; t < w->ncell; t++)
		judge(w, t);
}

void simplify_greedy_run(struct simplify_greedy *g, void *memory)
{
	uint64_t key = UINT64_MAX;
	struct greedy w;

	carve(&w, g, memory);
	g->npick = 0;
	g->nhull = g->n ? simplify_hull(g->pts, g->n, w.order, g->hull) : 0;
	if (g->nhull < 3 || !make_base(&w))
		return;
	deal_first(&w);
	memset(w.from, 0xff, (size_t)g->n * sizeof *w.from);
	while (w.nheap) {
		uint32_t t = w.heap[0];

		key = w.cell[t].key < key ? w.cell[t].key : key;
		g->pick[g->npick++] = (struct simplify_pick){key, w.cell[t].worst};
		insert(&w, t);
	}
}
