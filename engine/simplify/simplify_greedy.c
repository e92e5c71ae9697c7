/*
 * Greedy insertion. Each triangle has a list of the points in it, and its farthest one. An insertion removes the triangles whose
 * circle contains the new point, fills the hole with a fan, and deals their points out to it. Nothing is beyond the base, which
 * has the corners of the hull, so there are no ghosts: a side of the hull has no neighbour.
 *
 * Strictly greedy insertion takes the farthest point of all. That order jumps about, and most of the time goes into fetching
 * distant memory. Here sweeps over some neighbouring triangles of the base, and what they become, insert what is farther than a
 * limit, which falls from sweep to sweep. The points are nearly as few (docs/design/simplify.md), and the memory is near.
 *
 * Where the ground is rough most points stay, and dealing all points out again and again, until triangles are small, takes the
 * rest of the time. There the base has more points (simplify_base.c).
 *
 * A fan is usually dealt out relative to its new point, in 64 bits: the turns that find a triangle are the weights of its corners
 * in the height of its plane. Fans of many triangles, and wide blocks, go the long way.
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
#include "simplify_base.h"
#include "simplify_cell.h"
#include "simplify_error.h"

#define NONE SIMPLIFY_NONE

enum {
	STEP = 6,    /* the limit falls by a sixth */
	PART = 1024, /* triangles of the base that are refined one after the other */
};

/* The key of a point of the base: greater than all errors. */
#define ROUGH (((uint64_t)1 << 49) + 1)

size_t simplify_greedy_bytes(uint32_t n)
{
	size_t each = n + 3, later = 2 * each * (sizeof(struct side) + sizeof(uint64_t)), base = tri_bytes((uint32_t)each);

	return align_line(2 * each * sizeof(struct cell)) + align_line(later > base ? later : base) +
	       align_line(2 * each * sizeof(struct pit)) + align_line(each * sizeof(uint32_t)) * 2 +
	       align_line(each * sizeof(struct node)) + align_line(each * sizeof(struct simplify_pick)) +
	       align_line(each * sizeof(struct simplify_place));
}

static void carve(struct greedy *w, struct simplify_greedy *g, void *memory)
{
	size_t each = g->n + 3, later = 2 * each * (sizeof(struct side) + sizeof(uint64_t)), base = tri_bytes((uint32_t)each);
	uint8_t *at = memory;

	memset(w, 0, sizeof *w);
	w->g = g;
	w->pts = g->pts;
	w->cell = align_carve(&at, 2 * each * sizeof *w->cell);
	w->tri = align_carve(&at, later > base ? later : base);
	w->side = (struct side *)(void *)w->tri;
	w->key = (uint64_t *)(void *)(w->side + 2 * each);
	w->hole = align_carve(&at, 2 * each * sizeof *w->hole);
	w->from = align_carve(&at, each * sizeof *w->from);
	g->hull = align_carve(&at, each * sizeof *g->hull);
	w->node = align_carve(&at, each * sizeof *w->node);
	g->pick = align_carve(&at, each * sizeof *g->pick);
	w->order = align_carve(&at, each * sizeof *w->order);
}

/* Copies the points, and finds whether their differences fit. */
static void fill_nodes(struct greedy *w)
{
	int32_t low[3] = {INT32_MAX, INT32_MAX, INT32_MAX}, high[3] = {INT32_MIN, INT32_MIN, INT32_MIN};

	for (uint32_t i = 0; i < w->g->n; i++) {
		const int32_t at[3] = {w->pts[i].x, w->pts[i].y, w->pts[i].z};

		w->node[i] = (struct node){at[0], at[1], at[2], NONE};
		for (unsigned k = 0; k < 3; k++) {
			low[k] = at[k] < low[k] ? at[k] : low[k];
			high[k] = at[k] > high[k] ? at[k] : high[k];
		}
	}
	if (!(((int64_t)high[0] - low[0]) >> 30) && !(((int64_t)high[1] - low[1]) >> 30))
		w->high = (int64_t)high[2] - low[2] + 1;
	w->error = w->g->least >> SIMPLIFY_KEY_SHIFT < (uint64_t)w->high ? (int64_t)(w->g->least >> SIMPLIFY_KEY_SHIFT) : w->high;
}

static inline void xy_of(const struct greedy *w, uint32_t i, int32_t ret[2])
{
	ret[0] = w->node[i].x;
	ret[1] = w->node[i].y;
}

static inline uint64_t place_of(const struct greedy *w, uint32_t i)
{
	return digest_place(w->node[i].x, w->node[i].y);
}

static inline int turn(const struct greedy *w, uint32_t a, uint32_t b, uint32_t c)
{
	int32_t p[2], q[2], r[2];

	xy_of(w, a, p);
	xy_of(w, b, q);
	xy_of(w, c, r);
	return geom_orient(p, q, r);
}

/* ---- the farthest point of a triangle ---- */

static void set_worst(struct greedy *w, uint32_t t, uint32_t worst, uint64_t key)
{
	w->cell[t].worst = worst;
	w->key[t] = key;
}

static void judge(struct greedy *w, uint32_t t)
{
	const struct cell *c = &w->cell[t];
	struct simplify_plane plane;
	uint32_t worst = NONE;
	geom_u128 most = 0;

	if (c->first == NONE) {
		set_worst(w, t, NONE, 0);
		return;
	}
	simplify_plane_init(&plane, &w->pts[c->corner[0]], &w->pts[c->corner[1]], &w->pts[c->corner[2]]);
	for (uint32_t i = c->first; i != NONE; i = w->node[i].next) {
		const struct node *p = &w->node[i];
		geom_u128 far = simplify_plane_far(&plane, p->x, p->y, p->z);

		if (far < most || !far || (far == most && place_of(w, i) > place_of(w, worst)))
			continue;
		most = far;
		worst = i;
	}
	set_worst(w, t, worst, simplify_plane_key(&plane, most));
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

/* The triangles whose circle contains p, from t on, and the sides of the hole that they leave. They form a tree: a circle of them
 * would have a vertex inside, and a vertex is in no hole. A side on which p lies is none: it is a side of the hull, which p
 * divides. */
static void dig(struct greedy *w, uint32_t t, uint32_t p)
{
	w->nside = 0;
	w->nhole = 1;
	w->hole[0] = (struct pit){t, NONE};
	for (uint32_t i = 0; i < w->nhole; i++) {
		const struct cell *c = &w->cell[w->hole[i].cell];

		for (unsigned k = 0; k < 3; k++) {
			uint32_t other = c->beside[k], a = c->corner[(k + 1) % 3], b = c->corner[(k + 2) % 3];

			if (other == NONE) {
				if (turn(w, a, b, p))
					w->side[w->nside++] = (struct side){.a = a, .b = b, .beyond = NONE};
			} else if (other == w->hole[i].from) {
				continue;
			} else if (has_in_circle(w, &w->cell[other], p)) {
				w->hole[w->nhole++] = (struct pit){other, w->hole[i].cell};
			} else {
				w->side[w->nside++] = (struct side){.a = a, .b = b, .beyond = other};
			}
		}
	}
}

/* The lists of the points of the hole, before its triangles are used again; one list of all if they are too many. */
static void take_lists(struct greedy *w)
{
	uint32_t all = NONE;

	w->nlist = 0;
	for (uint32_t i = 0; i < w->nhole; i++) {
		uint32_t first = w->cell[w->hole[i].cell].first;

		if (w->nhole <= SIMPLIFY_FAN) {
			w->list[w->nlist] = first;
			w->nlist += first != NONE;
			continue;
		}
		for (uint32_t q = first, next; q != NONE; q = next) {
			next = w->node[q].next;
			w->node[q].next = all;
			all = q;
		}
	}
	if (all != NONE)
		w->list[w->nlist++] = all;
}

static void replace_beside(struct cell *c, uint32_t a, uint32_t b, uint32_t t)
{
	for (unsigned k = 0; k < 3; k++)
		if (c->corner[(k + 1) % 3] == b && c->corner[(k + 2) % 3] == a)
			c->beside[k] = t;
}

/* The side that begins where this one ends. NONE: it is the last of an open fan, and what `from` has is of an earlier hole. */
static uint32_t side_after(const struct greedy *w, const struct side *s)
{
	uint32_t after = w->from[s->b];

	return after < w->nside && w->side[after].a == s->b ? after : NONE;
}

/* A triangle on each side of the hole, with p. Those of the hole have their places in memory taken: there are fewer. */
static void fill(struct greedy *w, uint32_t p)
{
	for (uint32_t i = 0; i < w->nside; i++) {
		w->side[i].cell = i < w->nhole ? w->hole[i].cell : w->ncell++;
		w->from[w->side[i].a] = i;
	}
	for (uint32_t i = 0; i < w->nside; i++) {
		const struct side *s = &w->side[i];
		uint32_t after = side_after(w, s), t = s->cell;
		struct cell *c = &w->cell[t];

		c->corner[0] = p;
		c->corner[1] = s->a;
		c->corner[2] = s->b;
		c->first = NONE;
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

static void deal(struct greedy *w, uint32_t p)
{
	uint32_t t = w->side[0].cell;

	for (uint32_t i = 0; i < w->nlist; i++)
		for (uint32_t q = w->list[i], next; q != NONE; q = next) {
			next = w->node[q].next;
			if (q == p)
				continue;
			t = find_in_fan(w, p, q, t);
			w->node[q].next = w->cell[t].first;
			w->cell[t].first = q;
		}
	for (uint32_t i = 0; i < w->nside; i++)
		judge(w, w->side[i].cell);
}

/* ---- the same in 64 bits ---- */

/* The triangles of the fan. False: they are too many, or too large. */
static bool make_blades(struct greedy *w, uint32_t p)
{
	const struct node *o = &w->node[p];
	int64_t most;

	if (!w->high || w->nside > SIMPLIFY_FAN)
		return false;
	most = (INT64_C(1) << 61) / w->high;
	for (uint32_t i = 0; i < w->nside; i++) {
		const struct side *s = &w->side[i];
		const struct node *a = &w->node[s->a], *b = &w->node[s->b];
		struct blade *f = &w->blade[i];

		*f = (struct blade){.ax = (int64_t)a->x - o->x,
				    .ay = (int64_t)a->y - o->y,
				    .az = (int64_t)a->z - o->z,
				    .bx = (int64_t)b->x - o->x,
				    .by = (int64_t)b->y - o->y,
				    .bz = (int64_t)b->z - o->z,
				    .worst = NONE,
				    .first = NONE};
		f->area = f->ax * f->by - f->ay * f->bx;
		if (f->area > most)
			return false;
		f->after = side_after(w, s);
	}
	/* Beyond the ends of an open fan there is no point. */
	for (uint32_t i = 0; i < w->nside; i++)
		if (w->blade[i].after != NONE)
			w->blade[w->blade[i].after].before = i;
	return true;
}

/* Finds the triangle of q, and how far q is from it: as simplify_plane_far, with the weights of a and b. */
static inline uint32_t take(struct greedy *w, uint32_t i, const struct node *o, uint32_t q)
{
	struct node *n = &w->node[q];
	int64_t x = (int64_t)n->x - o->x, y = (int64_t)n->y - o->y, far;
	struct blade *f = &w->blade[i];
	int64_t left = f->ax * y - f->ay * x, right;

	if (left >= 0) {
		while ((right = f->bx * y - f->by * x) > 0) {
			left = right;
			f = &w->blade[f->after];
		}
	} else {
		do {
			right = left;
			f = &w->blade[f->before];
			left = f->ax * y - f->ay * x;
		} while (left < 0);
	}
	n->next = f->first;
	f->first = q;
	far = left * f->bz - right * f->az - f->area * ((int64_t)n->z - o->z);
	far = far < 0 ? -far : far;
	if ((uint64_t)far >= f->most && far && ((uint64_t)far > f->most || place_of(w, q) < place_of(w, f->worst))) {
		f->most = (uint64_t)far;
		f->worst = q;
	}
	return (uint32_t)(f - w->blade);
}

/* Most are near enough, and the division of integers takes long. */
static inline uint64_t near_key(const struct greedy *w, const struct blade *f)
{
	uint64_t key = (uint64_t)(int64_t)((double)(int64_t)f->most / (double)f->area * (1 << SIMPLIFY_KEY_SHIFT));

	return key < w->g->least ? key : w->g->least;
}

static bool deal_narrow(struct greedy *w, uint32_t p)
{
	const struct node o = w->node[p];
	uint32_t at = 0;

	if (!make_blades(w, p))
		return false;
	for (uint32_t i = 0; i < w->nlist; i++)
		for (uint32_t q = w->list[i], next; q != NONE; q = next) {
			next = w->node[q].next;
			if (q != p)
				at = take(w, at, &o, q);
		}
	for (uint32_t i = 0; i < w->nside; i++) {
		const struct blade *f = &w->blade[i];

		w->cell[w->side[i].cell].first = f->first;
		set_worst(w, w->side[i].cell, f->worst,
			  f->most > (uint64_t)(w->error * f->area) ? simplify_key_of(f->most, f->area) : near_key(w, f));
	}
	return true;
}

static void insert(struct greedy *w, uint32_t t, uint32_t p)
{
	dig(w, t, p);
	take_lists(w);
	fill(w, p);
	link_back(w);
	if (!deal_narrow(w, p))
		deal(w, p);
}

/* ---- the base ---- */

/* The triangulation of the base, without its ghosts. */
static bool make_base(struct greedy *w)
{
	struct simplify_greedy *g = w->g;
	struct mesh_vertex *in;
	struct tri_result tri;
	uint32_t n = simplify_base(g, w->from), *number = (uint32_t *)(void *)g->pick,
		 *index = (uint32_t *)(void *)w->hole; /* not used yet */

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
	w->ncell = simplify_base_number(g->n, &tri, index, (uint32_t *)(void *)w->order, number);
	for (uint32_t i = 0; i < tri.ntriangle; i++) {
		struct cell *c = &w->cell[number[i]];

		if (number[i] == NONE)
			continue;
		*c = (struct cell){.first = NONE};
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

static void pick(struct greedy *w, uint32_t at, uint64_t key)
{
	w->g->pick[w->g->npick++] = (struct simplify_pick){key, at};
}

static void deal_first(struct greedy *w)
{
	uint32_t t = 0;

	for (uint32_t i = 0; i < w->g->n; i++) {
		if (w->from[i] == SIMPLIFY_ROUGH)
			pick(w, i, ROUGH);
		if (w->from[i])
			continue;
		t = locate(w, i, t);
		w->node[i].next = w->cell[t].first;
		w->cell[t].first = i;
	}
	for (t = 0; t < w->ncell; t++)
		judge(w, t);
}

/* Inserts where a point is farther than the limit; a place in memory may have another triangle with such a point then. What
 * comes to a place that was passed is the next sweep's. `to`: NONE for all. `before`: the limit before, which no pick's key is
 * above: a triangle that an insertion makes can have a point that is farther. True: a point was inserted. */
static bool sweep(struct greedy *w, uint32_t from, uint32_t to, uint64_t limit, uint64_t before)
{
	uint32_t npick = w->g->npick;

	for (uint32_t t = from; t < to && t < w->ncell; t++)
		while (w->key[t] > limit) {
			uint32_t worst = w->cell[t].worst;

			pick(w, worst, w->key[t] < before ? w->key[t] : before);
			insert(w, t, worst);
		}
	return w->g->npick > npick;
}

/* A part of the base, and what is made of it. */
static void sweep_part(struct greedy *w, uint32_t from, uint32_t to)
{
	uint32_t made = w->ncell;
	uint64_t limit = 0, before, least = w->g->least;
	unsigned step = w->g->step ? w->g->step : STEP;

	for (uint32_t t = from; t < to; t++)
		limit = w->key[t] > limit ? w->key[t] : limit;
	while (limit > least) {
		before = limit;
		/* Below a sixteenth of a lattice number the order does not matter. */
		limit = limit >> (SIMPLIFY_KEY_SHIFT - 4) ? limit - limit / step : 0;
		limit = limit < least ? least : limit;
		sweep(w, from, to, limit, before);
		sweep(w, made, NONE, limit, before);
	}
}

static void sweep_all(struct greedy *w)
{
	uint32_t n = w->ncell;

	for (uint32_t t = 0; t < n; t += PART)
		sweep_part(w, t, n - t < PART ? n : t + PART);
	while (sweep(w, 0, NONE, w->g->least, w->g->least + 1))
		;
}

void simplify_greedy_run(struct simplify_greedy *g, void *memory)
{
	struct greedy w;

	carve(&w, g, memory);
	fill_nodes(&w);
	g->npick = 0;
	g->corner = w.from;
	g->found = (struct simplify_found){.tests = 0};
	g->nhull = g->n ? simplify_hull(g->pts, g->n, w.order, g->hull) : 0;
	if (g->nhull < 3 || !make_base(&w))
		return;
	deal_first(&w);
	memset(w.from, 0xff, (size_t)g->n * sizeof *w.from);
	sweep_all(&w);
	if (g->clear)
		simplify_settle(&w);
}
