/*
 * Pieces that leave P(B). Such a piece is followed through the Delaunay triangulation of P(B) from one of its ends, from triangle
 * to triangle by exact orientations, to the triangle of its other end or over the hull. Where a vertex is on its line it counts
 * as if it crossed an owned triangle: what is loaded in vain does no harm.
 */
#include "constrain_priv.h"

/* Sides of the hull that are looked at. */
enum { HULL = 1024 };

/* The side by which a ray leaves a triangle in which it begins: its ends are on the right and on the left. 3: a corner is on the
 * line. */
static unsigned side_from_inside(const struct constrain_work *w, const uint32_t corner[3], const int32_t from[2],
				 const int32_t to[2])
{
	int turn[3];

	for (unsigned k = 0; k < 3; k++) {
		turn[k] = geom_orient(from, to, w->r.xy[corner[k]]);
		if (!turn[k])
			return 3;
	}
	for (unsigned k = 0; k < 3; k++)
		if (turn[(k + 1) % 3] < 0 && turn[(k + 2) % 3] > 0)
			return k;
	return 3;
}

/* The triangle at a vertex in which a ray begins, and the side by which it leaves it. *ret_side 3: a vertex is on its line.
 * False: it leads over the hull. */
static bool side_from_vertex(const struct constrain_work *w, uint32_t vertex, const int32_t to[2], uint32_t *at,
			     unsigned *ret_side)
{
	const int32_t(*xy)[2] = w->r.xy;
	uint32_t first = *at;

	do {
		const struct tri_triangle *t = &w->r.triangle[*at];
		unsigned k = t->corner[0] == vertex ? 0 : t->corner[1] == vertex ? 1 : 2;
		uint32_t right = t->corner[(k + 1) % 3], left = t->corner[(k + 2) % 3];
		int turn = right == TRI_GHOST ? 0 : geom_orient(xy[vertex], xy[right], to);

		*ret_side = k;
		if (right != TRI_GHOST && turn == 0 && geom_less(xy[vertex], xy[right]) == geom_less(xy[vertex], to)) {
			*ret_side = 3;
			return true;
		}
		if (turn > 0 && left != TRI_GHOST && geom_orient(xy[vertex], xy[left], to) < 0)
			return true;
		*at = t->link[(k + 1) % 3] >> 3;
	} while (*at != first);
	return false;
}

/* Over a link, as it is seen from the triangle behind it. */
static bool follow(const struct constrain_work *w, const int32_t from[2], const int32_t to[2], uint32_t link)
{
	const int32_t(*xy)[2] = w->r.xy;

	for (;;) {
		const struct tri_triangle *t = &w->r.triangle[link >> 3];
		unsigned side = (link & 6) >> 1;
		uint32_t apex = t->corner[side];
		int turn;

		if (apex == TRI_GHOST)
			return false;
		if (constrain_owns(w, link >> 3))
			return true;
		turn = geom_orient(from, to, xy[apex]);
		if (turn == 0)
			return true;
		side = (side + (turn > 0 ? 1 : 2)) % 3;
		if (geom_orient(xy[t->corner[(side + 1) % 3]], xy[t->corner[(side + 2) % 3]], to) >= 0)
			return false;
		link = t->link[side];
	}
}

/* From a triangle over one of its sides. */
static bool leave(const struct constrain_work *w, const int32_t from[2], const int32_t to[2], uint32_t at, unsigned side)
{
	const struct tri_triangle *t = &w->r.triangle[at];

	if (side == 3 || constrain_owns(w, at))
		return true;
	return geom_orient(w->r.xy[t->corner[(side + 1) % 3]], w->r.xy[t->corner[(side + 2) % 3]], to) < 0 &&
	       follow(w, from, to, t->link[side]);
}

/* Both ends are beyond the hull: looks for the side over which the piece comes in, along the hull. */
static bool from_outside(const struct constrain_work *w, const struct constrain_piece *p)
{
	const int32_t(*xy)[2] = w->r.xy;
	uint32_t ghost = p->at[0];

	for (unsigned steps = 0; steps < HULL; steps++) {
		const struct tri_triangle *t = &w->r.triangle[ghost];
		unsigned g = t->corner[0] == TRI_GHOST ? 0 : t->corner[1] == TRI_GHOST ? 1 : 2;
		const int32_t *u = xy[t->corner[(g + 1) % 3]], *v = xy[t->corner[(g + 2) % 3]];
		int a = geom_orient(u, v, p->a), b = geom_orient(u, v, p->b), left, right;

		if (a > 0 && b > 0)
			return false;
		left = geom_orient(p->a, p->b, v);
		right = geom_orient(p->a, p->b, u);
		if (a > 0 && b <= 0 && left >= 0 && right <= 0)
			return !left || !right || follow(w, p->a, p->b, t->link[g]);
		ghost = t->link[(g + 1) % 3] >> 3;
		if (ghost == p->at[0])
			return false;
	}
	return true;
}

bool constrain_far_crosses(struct constrain_work *w, const struct constrain_piece *p)
{
	unsigned end = p->end[0] != NONE ? 0 : p->end[1] != NONE ? 1 : constrain_real(&w->r.triangle[p->at[0]]) ? 0 : 1;
	const int32_t *from = end ? p->b : p->a, *to = end ? p->a : p->b;
	uint32_t at = p->at[end];
	unsigned side = 3;

	if (p->end[end] != NONE && !side_from_vertex(w, p->end[end], to, &at, &side))
		return false;
	if (p->end[end] == NONE && !constrain_real(&w->r.triangle[at]))
		return from_outside(w, p);
	if (p->end[end] == NONE)
		side = side_from_inside(w, w->r.triangle[at].corner, from, to);
	return leave(w, from, to, at, side);
}
