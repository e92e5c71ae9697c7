/*
 * Compares a mesh with its points (verify.h): both are sorted in the same order and read in parallel. Each position
 * must be a vertex with the height of the point that the view takes, and each vertex must be a position.
 */
#include <stdlib.h>

#include "err.h"
#include "verify.h"
#include "verify_place.h"

static bool same_place(const struct point *a, const struct point *b)
{
	return a->x == b->x && a->y == b->y;
}

static void place_of(const struct point *p, int32_t place[3])
{
	place[0] = p->x;
	place[1] = p->y;
	place[2] = p->z;
}

enum { END_OF_PIECE = 1 };

/* Keeps one point of each position, the one that the view takes. */
static size_t reduce_points(const struct view *view, struct point *pts, size_t n)
{
	size_t kept = 0;

	for (size_t i = 0; i < n; i++) {
		if (kept && same_place(&pts[kept - 1], &pts[i])) {
			if (view_prefers(view, &pts[i], &pts[kept - 1]))
				pts[kept - 1] = pts[i];
			continue;
		}
		pts[kept++] = pts[i];
	}
	return kept;
}

/* Ends of pieces have a class of their own: such a vertex may be one of a line, which is none of the points. Of a mesh with lines
 * points may be missing: those on lines, and those in lakes and outside of the boundary. */
static void compare_points(const struct point *pts, size_t n, const struct point *vertex, const struct verify_mesh *m,
			   struct verify_report *r)
{
	size_t nvertex = m->nvertex;

	size_t i = 0, v = 0;
	int32_t place[3];

	while (!r->fault && (i < n || v < nvertex)) {
		const struct point *p = i < n ? &pts[i] : NULL, *q = v < nvertex ? &vertex[v] : NULL;
		uint64_t kp = p ? point_morton(p->x, p->y) : UINT64_MAX, kq = q ? point_morton(q->x, q->y) : UINT64_MAX;

		if (q && v > 0 && same_place(q, q - 1)) {
			place_of(q, place);
			verify_fault_set(r, VERIFY_EXTRA, place, "two vertices have one position");
		} else if ((!q || (p && kp < kq)) && (m->trimmed || m->edges)) {
			r->absent++;
			i++;
			continue;
		} else if (q && (!p || kq < kp) && q->cls == END_OF_PIECE) {
			v++;
			continue;
		} else if (!q || (p && kp < kq)) {
			place_of(p, place);
			verify_fault_set(r, VERIFY_MISSING, place, "a point is no vertex of the mesh");
		} else if (!p || kq < kp) {
			place_of(q, place);
			verify_fault_set(r, VERIFY_EXTRA, place, "a vertex is none of the points");
		} else if (p->z != q->z && q->cls != END_OF_PIECE) {
			place_of(q, place);
			verify_fault_set(r, VERIFY_HEIGHT, place, "a vertex has the height %d, its point %d", (int)q->z,
					 (int)p->z);
		}
		i++;
		v++;
	}
}

int verify_points(const struct verify_mesh *m, const struct view *view, struct point *pts, size_t n, struct verify_report *r,
		  struct err *err)
{
	size_t most = n > m->nvertex ? n : m->nvertex;
	struct point *scratch = malloc((most ? most : 1) * sizeof *scratch);
	struct point *vertex = malloc((m->nvertex ? m->nvertex : 1) * sizeof *vertex);

	if (!scratch || !vertex) {
		err_set(err, ERR_NOMEM, "no memory to compare %zu vertices with %zu points", m->nvertex, n);
		goto out;
	}
	for (size_t v = 0; v < m->nvertex; v++)
		vertex[v] = (struct point){m->vertex[v][0], m->vertex[v][1], m->vertex[v][2], 0, 0, 0};
	for (size_t t = 0; m->edges && t < m->ntriangle; t++)
		for (unsigned k = 0; k < 3; k++)
			if (m->edges[t] >> k & 1)
				vertex[m->triangle[t][(k + 1) % 3]].cls = vertex[m->triangle[t][(k + 2) % 3]].cls = END_OF_PIECE;
	point_sort(vertex, scratch, m->nvertex);
	point_sort(pts, scratch, n);
	r->points = n;
	n = reduce_points(view, pts, n);
	r->positions = n;
	compare_points(pts, n, vertex, m, r);
out:
	free(scratch);
	free(vertex);
	return -(int)err->code;
}
