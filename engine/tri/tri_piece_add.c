/*
 * Adds a position to a triangulation with pieces. The triangles that it removes are those of its circle test that are reached
 * from the one that it is in without crossing a piece: along a straight line away from it, over edges that are no pieces, the
 * power of the position with respect to the circles never gets less, so none of them is hidden behind one that stays. They are
 * listed first, for their flags, and then replaced by a fan (tri_insert.c).
 */
#include <string.h>

#include "geom.h"
#include "tri_piece_priv.h"

static bool take(struct tri_pieces *p, uint32_t link, bool *flagged)
{
	if (p->ncrossed == p->most)
		return false;
	p->crossed[p->ncrossed++].link = link;
	*flagged |= tri_piece_flagged(p, link >> 3);
	return true;
}

/* Lists the triangles that conflict, each with the side by which it was reached; the first has none. They form a tree. */
static bool list_conflicts(struct tri_pieces *p, const int32_t at[2], uint32_t root, bool *flagged)
{
	const struct tri *t = p->tri;

	p->ncrossed = 0;
	*flagged = false;
	if (!take(p, root << 3 | 6, flagged))
		return false;
	for (uint32_t i = 0; i < p->ncrossed; i++) {
		uint32_t from = p->crossed[i].link;

		for (uint32_t side2 = 0; side2 < 6; side2 += 2) {
			uint32_t link = tri_link_of(&t->triangle[from >> 3], side2);

			if (side2 == (from & 6) || link & 1 || !tri_conflict(t, link >> 3, at))
				continue;
			if (!take(p, link, flagged))
				return false;
		}
	}
	return true;
}

/* Whether the position is on a side of the triangle that is a piece; of a ghost it is beyond the side. */
static bool on_piece(const struct tri *t, const struct tri_triangle *in, const int32_t at[2])
{
	for (unsigned k = 0; k < 3; k++) {
		uint32_t a = in->corner[(k + 1) % 3], b = in->corner[(k + 2) % 3];

		if (in->link[k] & 1 && a != TRI_GHOST && b != TRI_GHOST && geom_orient(t->xy[a], t->xy[b], at) == 0)
			return true;
	}
	return false;
}

static void vertex_set(struct tri *t, const struct mesh_vertex *v, const int32_t at[2])
{
	uint32_t n = t->nvertex++;

	memcpy(t->xy[n], at, sizeof(t->xy[n]));
	t->z[n] = v->z;
	t->id[n] = n;
	for (unsigned k = 0; k < 2; k++) {
		t->extent.min[k] = at[k] < t->extent.min[k] ? at[k] : t->extent.min[k];
		t->extent.max[k] = at[k] > t->extent.max[k] ? at[k] : t->extent.max[k];
	}
}

int tri_piece_add(struct tri_pieces *p, const struct mesh_vertex *v, uint32_t root, uint32_t *ret_n)
{
	const int32_t at[2] = {v->x, v->y};
	struct tri *t = p->tri;
	bool flagged;

	if (t->nvertex >= p->cap || t->nvertex >= t->cap)
		return TRI_E_FULL;
	if (on_piece(t, &t->triangle[root], at))
		return TRI_E_CROSSING;
	/* With the two that are new. */
	if (!list_conflicts(p, at, root, &flagged) || p->most - p->ncrossed < 2)
		return TRI_E_MOST;
	vertex_set(t, v, at);
	for (unsigned i = 0; i < 2; i++)
		p->crossed[p->ncrossed++].link = (t->ntriangle + i) << 3;
	tri_insert_at(t, root);
	for (uint32_t i = 0; i < p->ncrossed; i++) {
		uint32_t place = p->crossed[i].link >> 3;
		const uint32_t *corner = t->triangle[place].corner;
		bool ghost = corner[0] == TRI_GHOST || corner[1] == TRI_GHOST || corner[2] == TRI_GHOST;

		p->flag[place / 64] &= ~(UINT64_C(1) << place % 64);
		if (flagged && !ghost)
			tri_piece_flag(p, place);
		for (unsigned k = 0; k < 3; k++)
			if (corner[k] != TRI_GHOST)
				p->at[t->id[corner[k]]] = place;
	}
	*ret_n = p->ncrossed;
	return 0;
}
