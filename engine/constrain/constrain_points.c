/*
 * The positions of a domain with pieces: where each is, in a table by hash; and points that are loaded beyond P(B), which are
 * collected behind the tables and then triangulated with the others.
 */
#include "constrain_priv.h"

#include <string.h>

#include "point.h"
#include "view.h"

/* Two places a vertex. */
bool constrain_points_fill(struct constrain_work *w)
{
	w->nslot = 2 * w->r.nvertex;
	w->slot = constrain_take(w, w->nslot * sizeof(*w->slot));
	if (!w->slot)
		return false;
	memset(w->slot, 0xff, w->nslot * sizeof(*w->slot));
	for (uint32_t v = 0; v < w->r.nvertex; v++) {
		uint32_t i = constrain_points_slot(w, w->r.xy[v][0], w->r.xy[v][1]);

		while (w->slot[i] != NONE)
			i = i + 1 == w->nslot ? 0 : i + 1;
		w->slot[i] = v;
	}
	return true;
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

bool constrain_points_insert(struct constrain_work *w)
{
	uint32_t n = 0;

	constrain_points_reduce(w);
	/* The capacity of the kernel may depend on segments: for so few it suffices, or the arena does not. */
	if (w->npoint > w->r.nvertex / 4)
		return false;
	while (n < w->npoint) {
		const struct point *p = &w->point[n];

		if (tri_add(w->c->tri, &(struct mesh_vertex){p->x, p->y, p->z}, 1, false))
			break;
		n++;
	}
	tri_result(w->c->tri, &w->r);
	w->c->added += n;
	w->npoint -= n;
	w->point += n;
	return !w->npoint;
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
	cap = constrain_kernel_cap(all);
	end = (uint8_t *)w->piece - (size_t)m * sizeof(*points);
	points = (struct point *)(end - (uintptr_t)end % sizeof(uint32_t));
	c->used = tri_bytes(cap);
	if ((uint8_t *)points < (uint8_t *)c->arena || (size_t)((uint8_t *)points - (uint8_t *)c->arena) < c->used)
		return CONSTRAIN_E_SPLIT;
	memmove(points, w->point, (size_t)m * sizeof(*points));
	in = restore_input(w);
	c->tri = tri_init(c->arena, cap);
	memmove(tri_input(c->tri), in, (size_t)n * sizeof(*in));
	merge(tri_input(c->tri), n, points, m);
	/* What was not flat before is not flat with more. */
	tri_run(c->tri, all);
	tri_result(c->tri, &w->r);
	c->added += m;
	w->npoint = 0;
	return 0;
}
