/*
 * Meshes with weights: the weights of vertices, and whether the other points are hidden (check_file.h).
 *
 * verify_mesh finds the surface over the lifted vertices convex, so the mesh is the regular triangulation of its vertices. If all
 * other points are above that surface, it is that of all points. One triangle is asked for each of them; on an edge the others
 * have the same surface.
 */
#include <stdlib.h>
#include <string.h>

#include "check_file.h"
#include "err.h"
#include "verify.h"

/* NULL: there is none. */
static const struct point *point_at(const struct point *pts, size_t n, const int32_t at[2])
{
	uint64_t key = point_morton(at[0], at[1]);
	size_t low = 0, high = n;

	while (low < high) {
		size_t middle = low + (high - low) / 2;

		if (point_morton(pts[middle].x, pts[middle].y) < key)
			low = middle + 1;
		else
			high = middle;
	}
	return low < n && pts[low].x == at[0] && pts[low].y == at[1] ? &pts[low] : NULL;
}

int check_power_weights(const struct check_mesh *m, const struct view *view, const struct point *pts, size_t n, int64_t **ret,
			struct err *err)
{
	int64_t square[VIEW_WEIGHTS + 1], *weight = calloc(m->nvertex ? m->nvertex : 1, sizeof *weight);

	if (!weight)
		return err_set(err, ERR_NOMEM, "no memory for the weights of %zu vertices", m->nvertex);
	view_weights(view, square);
	for (size_t v = 0; v < m->nvertex; v++) {
		const struct point *p = point_at(pts, n, m->vertex[v]);

		weight[v] = p ? square[view_weight_of(view, p)] : 0;
	}
	*ret = weight;
	return 0;
}

int check_power(const struct check_mesh *m, const int64_t *weight, const struct view *view, const struct point *pts, size_t n,
		struct check_power *ret, struct err *err)
{
	int64_t square[VIEW_WEIGHTS + 1];
	struct check_tree tree;
	int r = check_tree_make(&tree, m, err);

	*ret = (struct check_power){0};
	view_weights(view, square);
	for (size_t i = 0; !r && i < n; i++) {
		const int32_t at[2] = {pts[i].x, pts[i].y}, *p[4] = {[3] = at};
		int64_t w[4] = {[3] = square[view_weight_of(view, &pts[i])]};
		__int128 area[3];
		uint32_t triangle;
		bool vertex = false, tie;

		if (!check_tree_find(&tree, &pts[i], &triangle, area)) {
			if (!ret->outside++)
				ret->stray = pts[i];
			continue;
		}
		for (unsigned k = 0; k < 3; k++) {
			uint32_t v = m->triangle[triangle][k];

			p[k] = m->vertex[v];
			w[k] = weight[v];
			vertex |= p[k][0] == at[0] && p[k][1] == at[1];
		}
		if (vertex)
			continue;
		ret->hidden++;
		if (ret->found || verify_power(p, w, &tie) < 0)
			continue;
		ret->found = true;
		ret->visible = pts[i];
	}
	check_tree_free(&tree);
	return r;
}
