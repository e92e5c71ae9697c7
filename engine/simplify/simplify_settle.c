/*
 * The triangles of a block that are settled: they are in the mesh of all points that are chosen at first, whatever is in other
 * blocks, and no point is too far from them. Such a triangle has its circle in a box in which the view has no other points, no
 * corner that is dropped, and no piece of a line in it. So it is not tested again (docs/design/simplify.md).
 *
 * The triangles whose circle has a position beyond the box are connected: all that have this position in their circle are, and
 * one of these has a side of the hull. So they are found from these sides, without all others.
 */
#include <string.h>

#include "digest.h"
#include "simplify_cell.h"
#include "simplify_circle.h"
#include "simplify_error.h"
#include "simplify_raster.h"

#define NONE SIMPLIFY_NONE

/* Of a triangle, in `first`; of a point. */
enum { SEEN = 1, OPEN = 2 };
enum { DROPPED = 4 };

static void corners_of(const struct greedy *w, uint32_t t, int32_t ret[3][2])
{
	for (unsigned k = 0; k < 3; k++) {
		const struct node *n = &w->node[w->cell[t].corner[k]];

		ret[k][0] = n->x;
		ret[k][1] = n->y;
	}
}

static bool is_near_piece(const struct greedy *w, uint32_t t)
{
	int32_t at[3][2], box[4];

	corners_of(w, t, at);
	for (unsigned k = 0; k < 2; k++) {
		box[k] = at[0][k] < at[1][k] ? at[0][k] : at[1][k];
		box[k] = at[2][k] < box[k] ? at[2][k] : box[k];
		box[2 + k] = at[0][k] > at[1][k] ? at[0][k] : at[1][k];
		box[2 + k] = at[2][k] > box[2 + k] ? at[2][k] : box[2 + k];
	}
	return simplify_raster_meets(w->g->pieces, box);
}

static bool leaves(const struct greedy *w, uint32_t t)
{
	struct simplify_circle circle;
	int32_t at[3][2];

	for (unsigned k = 0; k < 3; k++)
		if (w->from[w->cell[t].corner[k]] & DROPPED)
			return true;
	corners_of(w, t, at);
	circle = simplify_circle_of(at[0], at[1], at[2]);
	return !simplify_circle_within(&circle, w->g->clear);
}

/* Goes to a triangle: if it is open, `hole` has it next. */
static uint32_t go(struct greedy *w, uint32_t t, uint32_t n)
{
	struct cell *c = &w->cell[t];

	if (c->first & SEEN)
		return n;
	c->first |= SEEN;
	if (!leaves(w, t))
		return n;
	c->first |= OPEN;
	w->hole[n++] = (struct pit){t, NONE};
	return n;
}

static void find_open(struct greedy *w)
{
	uint32_t n = 0;

	for (uint32_t t = 0; t < w->ncell; t++) {
		struct cell *c = &w->cell[t];

		for (unsigned k = 0; k < 3; k++) {
			if (c->beside[k] != NONE)
				continue;
			w->from[c->corner[(k + 1) % 3]] |= SIMPLIFY_EDGE;
			w->from[c->corner[(k + 2) % 3]] |= SIMPLIFY_EDGE;
			n = go(w, t, n);
		}
	}
	while (n) {
		const struct cell *c = &w->cell[w->hole[--n].cell];

		for (unsigned k = 0; k < 3; k++)
			if (c->beside[k] != NONE)
				n = go(w, c->beside[k], n);
	}
}

/* How far the farthest point of a triangle is: |N|. */
static geom_u128 far_of(const struct greedy *w, uint32_t t, struct simplify_plane *ret)
{
	const struct cell *c = &w->cell[t];
	const struct node *worst = &w->node[c->worst];

	simplify_plane_init(ret, &w->pts[c->corner[0]], &w->pts[c->corner[1]], &w->pts[c->corner[2]]);
	return simplify_plane_far(ret, worst->x, worst->y, worst->z);
}

/* Keys are rounded, so a point may be too far by less than a step of them: then the triangle is not settled. */
static bool is_beyond(const struct greedy *w, uint32_t t)
{
	struct simplify_plane plane;
	geom_u128 far;

	if (w->cell[t].worst == NONE || w->key[t] + 2 < w->g->least)
		return false;
	far = far_of(w, t, &plane);
	return simplify_plane_beyond(&plane, far, (int64_t)(w->g->least >> SIMPLIFY_KEY_SHIFT));
}

static void note(struct greedy *w, uint32_t t)
{
	struct simplify_plane plane;
	geom_u128 far = far_of(w, t, &plane);
	uint64_t place[3];

	for (unsigned k = 0; k < 3; k++) {
		const struct node *n = &w->node[w->cell[t].corner[k]];

		place[k] = digest_place(n->x, n->y);
	}
	simplify_found_far(&w->g->found, far, plane.area, place);
}

/* The greatest error of those that are settled. */
static void measure(struct greedy *w)
{
	uint64_t most = 0;

	for (uint32_t t = 0; t < w->ncell; t++)
		if (!(w->cell[t].first & OPEN) && w->cell[t].worst != NONE && w->key[t] > most)
			most = w->key[t];
	for (uint32_t t = 0; t < w->ncell; t++)
		if (!(w->cell[t].first & OPEN) && w->cell[t].worst != NONE && w->key[t] + 2 >= most)
			note(w, t);
}

/* Marks the corners of open triangles, and what is around them. */
static void mark_corners(struct greedy *w)
{
	for (uint32_t t = 0; t < w->ncell; t++)
		for (unsigned k = 0; w->cell[t].first & OPEN && k < 3; k++)
			w->from[w->cell[t].corner[k]] |= SIMPLIFY_EDGE;
	for (uint32_t t = 0; t < w->ncell; t++) {
		const uint32_t *v = w->cell[t].corner;

		if ((w->from[v[0]] | w->from[v[1]] | w->from[v[2]]) & SIMPLIFY_EDGE)
			for (unsigned k = 0; k < 3; k++)
				w->from[v[k]] |= SIMPLIFY_RING;
	}
}

void simplify_settle(struct greedy *w)
{
	struct simplify_greedy *g = w->g;

	memset(w->from, 0, (size_t)g->n * sizeof *w->from);
	for (uint32_t i = 0; i < g->nhull; i++)
		if (!(w->pts[g->hull[i]].tag & POINT_LINE))
			w->from[g->hull[i]] = DROPPED;
	for (uint32_t t = 0; t < w->ncell; t++)
		w->cell[t].first = is_beyond(w, t) || (g->pieces && is_near_piece(w, t)) ? OPEN : 0;
	find_open(w);
	mark_corners(w);
	measure(w);
}
