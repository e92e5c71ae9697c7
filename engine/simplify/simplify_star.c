/*
 * A task of a later round: tests the triangles around some positions, the stars, wherever they are and whoever owns them. A
 * window that has the positions gives their triangles, as they are in the whole mesh, with pieces of lines or without. The
 * farthest points are added in the next round, which tests the triangles around these.
 *
 * Stars that lie in one node of the tree of keys, of some hundred chosen points on average, share a window. A triangle with
 * corners in two windows is tested twice, which does no harm.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "order.h"
#include "simplify_near.h"
#include "simplify_region.h"

/* A point is compared with all triangles of its window, so these are not many. */
enum { STARS = 64, CAP = 1 << 15, NODE = 512, ROOM = 1 << 12, SQUARES = 16 };

struct star_triangle {
	struct simplify_plane plane;
	int32_t corner[3][2], box[4];
	geom_u128 most; /* of `worst` */
	struct point worst;
	bool any; /* a point is in it */
};

_Static_assert(ROOM * sizeof(struct star_triangle) <= (size_t)2 * CAP * sizeof(struct point), "they fit into `worst`");

struct stars {
	struct simplify_check *c;
	struct star_triangle *t; /* in the memory of `worst` */
	uint32_t n, room;
	uint64_t key[STARS];
	size_t nkey;
	unsigned bits; /* of keys within a node whose stars share a window */
};

/* ---- a point ---- */

static void test(struct star_triangle *t, const struct point *p)
{
	geom_u128 far = simplify_plane_far(&t->plane, p->x, p->y, p->z);

	if (t->any && (far < t->most || (far == t->most && digest_place(p->x, p->y) > digest_place(t->worst.x, t->worst.y))))
		return;
	t->most = far;
	t->worst = *p;
	t->any = true;
}

/* Whether it is in the closed triangle, and no corner. */
static bool is_in(const struct star_triangle *t, const int32_t at[2])
{
	for (unsigned k = 0; k < 3; k++)
		if (!memcmp(t->corner[k], at, sizeof t->corner[k]) || geom_orient(t->corner[k], t->corner[(k + 1) % 3], at) < 0)
			return false;
	return true;
}

static int add_point(void *ctx, const struct point *p, struct err *err)
{
	struct simplify_check *c = ctx;
	struct star_triangle *t = (struct star_triangle *)(void *)c->worst;
	const int32_t at[2] = {p->x, p->y};

	(void)err;
	for (uint32_t i = 0; i < c->nlist; i++) {
		const int32_t *box = t[i].box;

		if (at[0] < box[0] || at[1] < box[1] || at[0] > box[2] || at[1] > box[3] || !is_in(&t[i], at))
			continue;
		c->found.tests++;
		test(&t[i], p);
	}
	return 0;
}

/* ---- the triangles ---- */

static bool is_star(const struct stars *w, int32_t x, int32_t y)
{
	uint64_t key = point_morton(x, y);

	return bsearch(&key, w->key, w->nkey, sizeof key, order_u64) != NULL;
}

static void take(struct star_triangle *t, const struct point at[3])
{
	memset(t, 0, sizeof *t);
	for (unsigned k = 0; k < 3; k++) {
		const int32_t box[4] = {at[k].x, at[k].y, at[k].x, at[k].y};

		memcpy(t->corner[k], box, sizeof t->corner[k]);
		if (k)
			point_box_join(t->box, box);
		else
			memcpy(t->box, box, sizeof box);
	}
	simplify_plane_init(&t->plane, &at[0], &at[1], &at[2]);
}

/* Takes the triangles of stars that are certain. False: they do not fit. */
static bool take_certain(struct stars *w, const struct simplify_near *near)
{
	const struct tri_result *tri = &near->tri;
	const uint8_t *kind = near->kind;

	for (uint32_t i = 0; i < tri->ntriangle; i++) {
		const uint32_t *v = tri->triangle[i].corner;
		struct point at[3];

		if (v[0] == TRI_GHOST || v[1] == TRI_GHOST || v[2] == TRI_GHOST ||
		    (kind[v[0]] != SIMPLIFY_STAR && kind[v[1]] != SIMPLIFY_STAR && kind[v[2]] != SIMPLIFY_STAR))
			continue;
		if (w->n == w->room)
			return false;
		for (unsigned k = 0; k < 3; k++)
			at[k] = (struct point){.x = tri->xy[v[k]][0], .y = tri->xy[v[k]][1], .z = tri->z[v[k]]};
		take(&w->t[w->n++], at);
	}
	return true;
}

/* Leaves the stars that were not certain. A vertex is one of the stars only if its position is, so there are no more of them. */
static void drop_certain(struct stars *w, const struct simplify_near *near)
{
	size_t n = 0;

	for (uint32_t i = 0; i < near->tri.nvertex && n < w->nkey; i++)
		if (near->kind[i] == (SIMPLIFY_STAR | SIMPLIFY_DOUBTFUL))
			w->key[n++] = point_morton(near->tri.xy[i][0], near->tri.xy[i][1]);
	qsort(w->key, n, sizeof *w->key, order_u64);
	w->nkey = n;
}

/* Takes those that the chosen points nearby tell, and leaves the other stars. */
static int take_near(struct stars *w, bool *ret_fits, struct err *err)
{
	struct simplify_near near;
	bool done;
	int r;

	near.c = w->c;
	near.key = w->key;
	near.nkey = w->nkey;
	near.side = (double)(UINT64_C(1) << w->bits / 2);
	r = simplify_near(&near, &done, err);
	if (r || !done)
		return r;
	*ret_fits = take_certain(w, &near);
	drop_certain(w, &near);
	return 0;
}

/* ---- from a window ---- */

/* Those with a star as a corner. False: they do not fit. */
static bool take_domain(struct stars *w, const struct mesh_domain *d)
{
	for (uint32_t i = 0; i < d->ntriangle; i++) {
		struct point at[3];
		bool star = false;

		for (unsigned k = 0; k < 3; k++) {
			const struct mesh_vertex *v = &d->vertex[d->triangle[i][k]];

			at[k] = (struct point){.x = v->x, .y = v->y, .z = v->z};
			star = star || is_star(w, v->x, v->y);
		}
		if (!star)
			continue;
		if (w->n == w->room)
			return false;
		take(&w->t[w->n++], at);
	}
	return true;
}

static void window_of(const struct stars *w, struct view *ret)
{
	int32_t box[4];

	*ret = w->c->s->rest;
	simplify_keys_box(w->key, w->nkey, box);
	ret->window = VIEW_CROP_BOX;
	for (unsigned k = 0; k < 4; k++)
		ret->window_box[k] = box[k] + ret->k[k & 1];
}

/* *ret_fits: they all fit. */
static int take_window(struct stars *w, bool *ret_fits, struct err *err)
{
	static const struct cut_region plane = {.wx = 32, .wy = 32};
	struct simplify_check *c = w->c;
	struct pipe_budget budget = c->budget;
	struct mesh_domain domain;
	struct view view;
	uint64_t need;
	int r;

	window_of(w, &view);
	budget.cap = budget.cap < CAP ? budget.cap : CAP;
	r = pipe_domain(c->s->chosen, &view, &plane, NULL, &budget, c->domain, &domain, &need, err);
	if (r == PIPE_E_SPLIT)
		r = pipe_domain(c->s->chosen, &view, &plane, NULL, &c->budget, c->domain, &domain, &need, err);
	*ret_fits = !r && take_domain(w, &domain);
	return r == PIPE_E_SPLIT ? 0 : r;
}

static void count(atomic_uint *n)
{
	if (n)
		atomic_fetch_add(n, 1);
}

/* *ret_fits: they all fit. The stars stay. */
static int find_triangles(struct stars *w, bool *ret_fits, struct err *err)
{
	uint64_t key[STARS];
	const size_t n = w->nkey;
	int r = 0;

	memcpy(key, w->key, sizeof key);
	w->n = 0;
	*ret_fits = true;
	/* Triangles that are out of the mesh are not tested. */
	if (!pipe_has_out(w->c->s->chosen))
		r = take_near(w, ret_fits, err);
	if (!r && *ret_fits && !w->nkey)
		count(w->c->s->nearby);
	if (!r && *ret_fits && w->nkey) {
		count(w->c->s->windows);
		r = take_window(w, ret_fits, err);
	}
	memcpy(w->key, key, sizeof key);
	w->nkey = n;
	return r;
}

/* ---- their points ---- */

static int write_found(struct stars *w, struct err *err)
{
	struct simplify_check *c = w->c;
	int r = 0;

	for (uint32_t i = 0; !r && i < w->n; i++) {
		const struct star_triangle *t = &w->t[i];
		uint64_t at[3];

		for (unsigned k = 0; k < 3; k++)
			at[k] = digest_place(t->corner[k][0], t->corner[k][1]);
		if (!t->any)
			continue;
		if (simplify_plane_beyond(&t->plane, t->most, (int64_t)c->s->at.error))
			r = simplify_out_add(&c->out, &t->worst, 1, err);
		else
			simplify_found_far(&c->found, t->most, t->plane.area, at);
	}
	return r;
}

static int test_all(struct stars *w, struct err *err)
{
	struct simplify_check *c = w->c;
	int32_t box[4];
	int r;

	if (!w->n)
		return 0;
	memcpy(box, w->t[0].box, sizeof box);
	for (uint32_t i = 1; i < w->n; i++)
		point_box_join(box, w->t[i].box);
	simplify_raster_init(&c->raster, box, SQUARES);
	for (uint32_t i = 0; i < w->n; i++)
		simplify_raster_mark(&c->raster, w->t[i].corner[0], w->t[i].corner[1], w->t[i].corner[2]);
	c->nlist = w->n;
	r = simplify_check_read(c, err);
	return r ? r : write_found(w, err);
}

/* ---- the stars of a window ---- */

static int do_window(struct stars *w, struct err *err)
{
	const size_t all = w->nkey;
	bool fits;
	int r = find_triangles(w, &fits, err);

	if (r || fits)
		return r ? r : test_all(w, err);
	if (all == 1) {
		w->c->found.full = 1;
		return 0;
	}
	w->nkey = all / 2;
	r = do_window(w, err);
	memmove(w->key, w->key + all / 2, (all - all / 2) * sizeof *w->key);
	w->nkey = all - all / 2;
	return r ? r : do_window(w, err);
}

/* The bits of keys within a node that has about NODE of the chosen points. */
static unsigned node_bits(const struct grid *grid)
{
	double area, points = (double)grid_points(grid);
	unsigned bits = 0;
	int32_t box[4];

	if (!grid_box(grid, box))
		return 0;
	area = ((double)box[2] - box[0] + 1) * ((double)box[3] - box[1] + 1);
	while (bits < 62 && (double)(UINT64_C(1) << bits) * points < area * NODE)
		bits += 2;
	return bits;
}

int simplify_stars(struct simplify_check *c, uint32_t task, struct err *err)
{
	struct stars w = {.c = c, .t = (struct star_triangle *)(void *)c->worst};
	const struct simplify_where *at = &c->s->at;
	char name[GRID_NAME_MAX];
	uint64_t from, to, next = 0;
	int r = simplify_in_begin(&c->in, c->s->p.dirfd, simplify_name(name, "star", at->attempt, at->round, 0), sizeof *w.key,
				  err);

	if (r)
		return r;
	w.bits = node_bits(c->s->chosen);
	w.room = c->s->room ? c->s->room : ROOM;
	c->sink.point = add_point;
	from = c->in.n * task / at->tasks;
	to = c->in.n * (task + 1) / at->tasks;
	for (; !r && from < to; from += w.nkey) {
		w.nkey = to - from < STARS ? (size_t)(to - from) : STARS;
		r = simplify_in_some(&c->in, w.key, from, w.nkey, err);
		for (size_t i = 1; !r && i < w.nkey; i++)
			if ((w.key[i] ^ w.key[0]) >> w.bits)
				w.nkey = i;
		next = from + w.nkey;
		if (!r)
			r = do_window(&w, err);
		w.nkey = (size_t)(next - from);
	}
	return r;
}
