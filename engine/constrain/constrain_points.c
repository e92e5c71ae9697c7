/*
 * The positions of a domain with pieces: where each is, in a table by hash; and points that are loaded beyond P(B), which are
 * collected behind the tables and then triangulated with the others.
 */
#include "constrain_priv.h"

#include <string.h>

#include "align.h"
#include "point.h"
#include "view.h"

/* Two places a vertex, and some for those that are added. */
bool constrain_points_reserve(struct constrain_work *w)
{
	w->at = (uint8_t *)w->c->arena + align_line(w->c->used);
	w->nslot = w->r.nvertex * 2 + w->r.nvertex / 4;
	w->filled = false;
	w->slot = w->at > (uint8_t *)w->piece ? NULL : constrain_take(w, w->nslot * sizeof(*w->slot));
	return w->slot;
}

static void fill_from(struct constrain_work *w, uint32_t first)
{
	for (uint32_t v = first; v < w->r.nvertex; v++) {
		uint32_t i = constrain_points_slot(w, w->r.xy[v][0], w->r.xy[v][1]);

		while (w->slot[i] != NONE)
			i = i + 1 == w->nslot ? 0 : i + 1;
		w->slot[i] = v;
	}
}

void constrain_points_fill(struct constrain_work *w)
{
	if (w->filled)
		return;
	memset(w->slot, 0xff, w->nslot * sizeof(*w->slot));
	fill_from(w, 0);
	w->filled = true;
}

uint32_t constrain_points_find(const struct constrain_work *w, int32_t x, int32_t y)
{
	uint32_t i = constrain_points_slot(w, x, y);

	for (; w->slot[i] != NONE; i = i + 1 == w->nslot ? 0 : i + 1)
		if (w->r.xy[w->slot[i]][0] == x && w->r.xy[w->slot[i]][1] == y)
			return w->slot[i];
	return NONE;
}

/* Of an area not all records at a vertex may have been read. */
bool constrain_points_known(struct constrain_work *w, const struct point *p)
{
	uint32_t v = constrain_points_find(w, p->x, p->y);
	int32_t *z = (int32_t *)(uintptr_t)w->r.z; /* in the arena */

	if (v == NONE)
		return false;
	if (view_prefers(w->c->view, &(struct point){.z = p->z}, &(struct point){.z = z[v]}))
		z[v] = p->z;
	return true;
}

static bool point_less(const void *a, const void *b)
{
	return point_compare(a, b) < 0;
}

void constrain_points_reduce(struct constrain_work *w)
{
	uint32_t n = 0;

	constrain_sort(w->point, w->npoint, sizeof(*w->point), point_less);
	for (uint32_t i = 0; i < w->npoint; i++) {
		const struct point *p = &w->point[i];
		struct point *last = &w->point[n - (n > 0)];

		if (n == 0 || last->x != p->x || last->y != p->y)
			w->point[n++] = *p;
		else if (view_prefers(w->c->view, p, last))
			*last = *p;
	}
	w->npoint = n;
}

int constrain_points_add(struct constrain_work *w, const struct point *p)
{
	const uint8_t *end = (const uint8_t *)w->piece;

	if ((const uint8_t *)(w->point + w->npoint + 1) > end) {
		uint32_t before = w->npoint;

		constrain_points_reduce(w);
		if (w->npoint > before - before / 4)
			return CONSTRAIN_E_SPLIT;
	}
	w->point[w->npoint++] = *p;
	return 0;
}

static bool vertex_less(const void *a, const void *b)
{
	const struct mesh_vertex *p = a, *q = b;

	return point_morton(p->x, p->y) < point_morton(q->x, q->y);
}

/* The vertices of the last turn in the order of its input, where the kernel had it. Vertices of tri_add are not in order. */
static struct mesh_vertex *restore_input(struct constrain_work *w)
{
	struct mesh_vertex *in = tri_input(w->c->tri);
	uint32_t n = w->r.nvertex, i = 1;

	for (uint32_t v = 0; v < n; v++)
		in[w->r.id[v]] = (struct mesh_vertex){w->r.xy[v][0], w->r.xy[v][1], w->r.z[v]};
	while (i < n && vertex_less(&in[i - 1], &in[i]))
		i++;
	if (i < n)
		constrain_sort(in, n, sizeof(*in), vertex_less);
	return in;
}

/* Merges points into n vertices, from the end; both are in Morton order. */
static void merge(struct mesh_vertex *in, uint32_t n, const struct point *p, uint32_t m)
{
	uint32_t at = n + m;

	while (m > 0) {
		bool last = n == 0 || point_morton(in[n - 1].x, in[n - 1].y) < point_morton(p[m - 1].x, p[m - 1].y);

		if (last) {
			m--;
			in[--at] = (struct mesh_vertex){p[m].x, p[m].y, p[m].z};
		} else {
			in[--at] = in[--n];
		}
	}
}

/* Back to the triangulation before the pieces. The crossed triangles were linked with each other and with their neighbours,
 * whose links are the only ones of others that pieces change. */
static void take_back(struct constrain_work *w)
{
	struct tri_triangle *triangle = w->r.triangle;

	for (uint32_t i = 0; i < w->nbefore; i++)
		triangle[w->before[i].place] = w->before[i].triangle;
	for (uint32_t i = 0; i < w->nbefore; i++)
		for (uint32_t k = 0; k < 3; k++) {
			uint32_t link = w->before[i].triangle.link[k];

			triangle[link >> 3].link[(link & 6) >> 1] = w->before[i].place << 3 | k << 1;
		}
	for (uint32_t i = 0; i < w->r.ntriangle; i++)
		for (unsigned k = 0; k < 3; k++)
			triangle[i].link[k] &= ~UINT32_C(1);
}

/* Whether a finished domain fits the memory of the kernel's triangles with n positions: 60 bytes each (pipe_domain.c). And
 * whether a third of the places in the table stays free. */
static bool has_room(const struct constrain_work *w, uint64_t n)
{
	return n + n / 4 + 64 <= w->cap && 3 * n <= 2 * (uint64_t)w->nslot;
}

/* Adds the points to the triangulation before the pieces. */
static int add_points(struct constrain_work *w)
{
	uint32_t first = w->r.nvertex;
	struct mesh_vertex *in = (struct mesh_vertex *)(void *)w->point;

	take_back(w);
	for (uint32_t i = 0; i < w->npoint; i++) {
		const struct mesh_vertex v = {w->point[i].x, w->point[i].y, w->point[i].z};

		memcpy((uint8_t *)in + i * sizeof(v), &v, sizeof(v));
	}
	tri_add(w->c->tri, in, w->npoint, false);
	tri_result(w->c->tri, &w->r);
	fill_from(w, first);
	w->c->added += w->npoint;
	w->npoint = 0;
	return 0;
}

int constrain_points_merge(struct constrain_work *w)
{
	struct constrain *c = w->c;
	uint32_t n = w->r.nvertex, m, all, cap;
	struct mesh_vertex *in;
	struct point *points;
	uint8_t *end;

	constrain_points_reduce(w);
	m = w->npoint;
	all = n + m;
	if (has_room(w, all))
		return add_points(w);
	cap = constrain_kernel_cap(all);
	end = (uint8_t *)w->piece - (size_t)m * sizeof(*points);
	points = (struct point *)(end - (uintptr_t)end % sizeof(uint32_t));
	c->used = tri_bytes(cap);
	if ((uint8_t *)points < (uint8_t *)c->arena || (size_t)((uint8_t *)points - (uint8_t *)c->arena) < c->used)
		return CONSTRAIN_E_SPLIT;
	memmove(points, w->point, (size_t)m * sizeof(*points));
	in = restore_input(w);
	c->tri = tri_init(c->arena, cap);
	w->cap = cap;
	constrain_verified_clear(w);
	memmove(tri_input(c->tri), in, (size_t)n * sizeof(*in));
	merge(tri_input(c->tri), n, points, m);
	/* What was not flat before is not flat with more. */
	tri_run(c->tri, all);
	tri_result(c->tri, &w->r);
	c->added += m;
	w->npoint = 0;
	if (!constrain_points_reserve(w))
		return CONSTRAIN_E_SPLIT;
	constrain_points_fill(w);
	return 0;
}
