/*
 * Points that are loaded beyond P(B): they are collected behind the tables, and then added to the triangulation.
 */
#include "constrain_priv.h"

#include <string.h>

#include "err.h"
#include "point.h"
#include "view.h"

static bool point_less(const void *a, const void *b)
{
	return point_compare(a, b) < 0;
}

static void reduce(struct constrain_work *w)
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

		reduce(w);
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

/* Room for so many in the kernel: a finished domain has 60 bytes for each (pipe_domain.c). */
static bool has_room(const struct constrain_work *w, uint64_t n)
{
	return n + n / 4 + 64 <= w->cap;
}

/* All in a larger kernel, without pieces. */
static int again(struct constrain_work *w)
{
	struct constrain *c = w->c;
	uint32_t n = w->r.nvertex, m = w->npoint, all = n + m, cap = constrain_kernel_cap(all);
	uint8_t *end = (uint8_t *)w->piece - (size_t)m * sizeof(struct point);
	struct point *points = (struct point *)(end - (uintptr_t)end % sizeof(uint32_t));
	struct mesh_vertex *in;

	c->used = tri_bytes(cap);
	if ((uint8_t *)points < (uint8_t *)c->arena || (size_t)((uint8_t *)points - (uint8_t *)c->arena) < c->used)
		return CONSTRAIN_E_SPLIT;
	memmove(points, w->point, (size_t)m * sizeof(*points));
	in = restore_input(w);
	c->tri = tri_init(c->arena, cap);
	w->cap = cap;
	memmove(tri_input(c->tri), in, (size_t)n * sizeof(*in));
	merge(tri_input(c->tri), n, points, m);
	/* What was not flat before is not flat with more. */
	tri_run(c->tri, all);
	tri_result(c->tri, &w->r);
	for (uint32_t i = 0; i < w->npiece; i++) {
		w->piece[i].in = false;
		for (unsigned k = 0; k < 2; k++)
			w->piece[i].end[k] = w->piece[i].at[k] = NONE;
	}
	w->near = 0;
	constrain_hints(w);
	return 0;
}

int constrain_points_plain(struct constrain_work *w)
{
	uint32_t m;
	int rc = 0;

	reduce(w);
	m = w->npoint;
	if (has_room(w, (uint64_t)w->r.nvertex + m)) {
		for (uint32_t i = 0; i < m; i++)
			tri_add(w->c->tri, &(struct mesh_vertex){w->point[i].x, w->point[i].y, w->point[i].z}, 1, false);
		tri_result(w->c->tri, &w->r);
	} else {
		rc = again(w);
	}
	w->c->added += m;
	w->npoint = 0;
	return rc ? rc : constrain_lines_ends(w);
}

/* All triangles around it are new. */
static int insert(struct constrain_work *w, const struct point *p)
{
	const int32_t at[2] = {p->x, p->y};
	uint32_t n = 0;
	int wrong;

	w->near = tri_walk(w->c->tri, at, w->near);
	wrong = tri_piece_add(w->p, &(struct mesh_vertex){p->x, p->y, p->z}, w->near, &n);
	if (wrong == TRI_E_CROSSING)
		return err_set(w->err, ERR_INTERNAL, "the position (%d, %d) is on a piece", p->x, p->y);
	for (uint32_t i = 0; i < n; i++) {
		constrain_bit_set(w->special, tri_piece_found(w->p, i));
		constrain_bit_set(w->todo, tri_piece_found(w->p, i));
	}
	return wrong ? CONSTRAIN_E_SPLIT : 0;
}

int constrain_points_insert(struct constrain_work *w, bool *ret_again)
{
	uint32_t m;
	int rc = 0;

	reduce(w);
	m = w->npoint;
	*ret_again = (uint64_t)w->r.nvertex + m > w->most;
	if (*ret_again)
		rc = again(w);
	for (uint32_t i = 0; i < m && !*ret_again && !rc; i++)
		rc = insert(w, &w->point[i]);
	tri_result(w->c->tri, &w->r);
	w->c->added += m;
	w->npoint = 0;
	return rc;
}
