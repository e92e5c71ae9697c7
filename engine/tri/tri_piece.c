/*
 * Finds the triangles that a piece crosses: around its ends, then from triangle to triangle (docs/design/constraints.md,
 * "The triangles of a piece"). All tests are exact orientations, so nothing is decided by a point on the piece.
 *
 * The search around the ends takes a step at either in turn, so that it ends with the smaller of the two: of a thousand
 * pieces that meet in one vertex none looks at all triangles there.
 */
#include "tri_piece_priv.h"

#include <string.h>

#include "geom.h"

enum { PIECES_HEAD_BYTES = 64 };

_Static_assert(sizeof(struct tri_pieces) <= PIECES_HEAD_BYTES, "the head of the memory");
_Static_assert(sizeof(struct tri_crossed) + sizeof(struct tri_node) == 44, "the bytes for each crossed triangle");

/* Two triangles a vertex. */
static size_t flag_words(uint32_t cap)
{
	return ((size_t)cap * 2 + 63) / 64;
}

size_t tri_pieces_bytes(uint32_t cap, uint32_t most)
{
	return PIECES_HEAD_BYTES + flag_words(cap) * 8 + (size_t)cap * 4 + ((size_t)most + 1) * sizeof(struct tri_crossed) +
	       ((size_t)most + 4) * sizeof(struct tri_node);
}

struct tri_pieces *tri_pieces_open(void *memory, struct tri *t, uint32_t cap, uint32_t most)
{
	struct tri_pieces *p = memory;

	memset(p, 0, sizeof(*p));
	p->tri = t;
	p->cap = cap;
	p->most = most;
	p->flag = (uint64_t *)((unsigned char *)memory + PIECES_HEAD_BYTES);
	p->node = (struct tri_node *)(p->flag + flag_words(cap));
	p->crossed = (struct tri_crossed *)(p->node + most + 4);
	p->at = (uint32_t *)(p->crossed + most + 1);
	memset(p->flag, 0, flag_words(cap) * sizeof(*p->flag));
	return p;
}

struct tri_pieces *tri_pieces_init(void *memory, struct tri *t, uint32_t most)
{
	struct tri_pieces *p = tri_pieces_open(memory, t, t->nvertex, most);

	for (uint32_t i = 0; i < t->ntriangle; i++)
		for (unsigned k = 0; k < 3; k++)
			if (t->triangle[i].corner[k] != TRI_GHOST)
				p->at[t->id[t->triangle[i].corner[k]]] = i;
	return p;
}

void tri_piece_end(struct tri_pieces *p, uint32_t id, uint32_t triangle)
{
	p->at[id] = triangle;
}

void tri_piece_flag(struct tri_pieces *p, uint32_t triangle)
{
	p->flag[triangle / 64] |= UINT64_C(1) << triangle % 64;
}

bool tri_piece_flagged(const struct tri_pieces *p, uint32_t triangle)
{
	return p->flag[triangle / 64] >> triangle % 64 & 1;
}

const uint64_t *tri_piece_flags(const struct tri_pieces *p)
{
	return p->flag;
}

/* A place in the search around a vertex: a triangle, as a link with the side across from the vertex. */
struct around {
	uint32_t vertex, link;
};

static bool around_start(const struct tri_pieces *p, uint32_t id, struct around *ret)
{
	const struct tri *t = p->tri;

	if (id >= t->nvertex)
		return false;
	for (uint32_t side2 = 0; side2 < 6; side2 += 2) {
		uint32_t corner = tri_corner_of(&t->triangle[p->at[id]], side2);

		if (corner == TRI_GHOST || t->id[corner] != id)
			continue;
		*ret = (struct around){corner, p->at[id] << 3 | side2};
		return true;
	}
	return false;
}

/* To the next triangle, counter-clockwise. */
static void around_step(const struct tri *t, struct around *a)
{
	uint32_t link = tri_link_of(&t->triangle[a->link >> 3], tri_side_next(a->link & 6));

	a->link = (link & ~7u) | tri_side_next(link & 6);
}

enum start { START_NOT_HERE, START_EDGE, START_VERTEX, START_HERE };

/* How the piece to vertex `to` begins in this triangle. At an edge or a vertex *ret_side2 is the side of that edge, or
 * the corner. */
static enum start around_look(const struct tri *t, const struct around *a, uint32_t to, uint32_t *ret_side2)
{
	const struct tri_triangle *at = &t->triangle[a->link >> 3];
	uint32_t next = tri_side_next(a->link & 6), prev = tri_side_prev(a->link & 6);
	uint32_t right = tri_corner_of(at, next), left = tri_corner_of(at, prev);
	const int32_t *from = t->xy[a->vertex];
	int turn;

	*ret_side2 = right == to ? prev : next;
	if (right == to || left == to)
		return START_EDGE;
	if (right == TRI_GHOST)
		return START_NOT_HERE;
	turn = geom_orient(from, t->xy[right], t->xy[to]);
	if (turn == 0 && geom_less(from, t->xy[right]) == geom_less(from, t->xy[to]))
		return START_VERTEX;
	if (turn <= 0 || left == TRI_GHOST)
		return START_NOT_HERE;
	return geom_orient(from, t->xy[left], t->xy[to]) < 0 ? START_HERE : START_NOT_HERE;
}

/* Finds the triangle in which the piece begins, at either end. */
static enum start find_start(const struct tri *t, struct around a[2], unsigned *ret_end, uint32_t *ret_side2)
{
	for (;;)
		for (unsigned end = 0; end < 2; end++) {
			enum start start = around_look(t, &a[end], a[!end].vertex, ret_side2);

			*ret_end = end;
			if (start != START_NOT_HERE)
				return start;
			around_step(t, &a[end]);
		}
}

static int crossed_add(struct tri_pieces *p, uint32_t link, bool left)
{
	struct tri_crossed *c = &p->crossed[p->ncrossed];

	if (p->ncrossed == p->most)
		return TRI_E_MOST;
	c->link = link & ~1u;
	c->left = left;
	c[1].flagged = c->flagged + tri_piece_flagged(p, link >> 3);
	p->ncrossed++;
	return 0;
}

/* Follows the piece from the triangle of `start` to its last one. */
static int follow(struct tri_pieces *p, const struct around *start, uint32_t to, uint32_t *ret_at)
{
	const struct tri *t = p->tri;
	const int32_t *from_xy = t->xy[start->vertex], *to_xy = t->xy[to];
	uint32_t link = tri_link_of(&t->triangle[start->link >> 3], start->link & 6);
	int wrong = crossed_add(p, start->link, false);

	while (!wrong) {
		const struct tri_triangle *at = &t->triangle[link >> 3];
		uint32_t side2 = link & 6, apex = tri_corner_of(at, side2);
		int turn;

		if (link & 1) {
			*ret_at = t->id[tri_corner_of(at, tri_side_next(side2))];
			return TRI_E_CROSSING;
		}
		if (apex == to)
			return crossed_add(p, link, false);
		turn = geom_orient(from_xy, to_xy, t->xy[apex]);
		if (turn == 0) {
			*ret_at = t->id[apex];
			return TRI_E_VERTEX;
		}
		wrong = crossed_add(p, link, turn > 0);
		link = tri_link_of(at, turn > 0 ? tri_side_next(side2) : tri_side_prev(side2));
	}
	return wrong;
}

/* Finds what the piece crosses. If it is an edge, *ret_edge is the link to it from one triangle, else TRI_NONE. */
static int find(struct tri_pieces *p, uint32_t from, uint32_t to, uint32_t *ret_edge, uint32_t *ret_at)
{
	struct around a[2];
	uint32_t side2;
	unsigned end;

	p->ncrossed = 0;
	p->crossed[0].flagged = 0;
	*ret_edge = TRI_NONE;
	if (from == to || !around_start(p, from, &a[0]) || !around_start(p, to, &a[1]))
		return TRI_E_END;
	switch (find_start(p->tri, a, &end, &side2)) {
	case START_EDGE:
		*ret_edge = (a[end].link & ~7u) | side2;
		return 0;
	case START_VERTEX:
		*ret_at = p->tri->id[tri_corner_of(&p->tri->triangle[a[end].link >> 3], side2)];
		return TRI_E_VERTEX;
	default:
		p->first = a[end].vertex;
		p->last = a[!end].vertex;
		return follow(p, &a[end], p->last, ret_at);
	}
}

int tri_piece_insert(struct tri_pieces *p, uint32_t from, uint32_t to, uint32_t *ret_at)
{
	struct tri_triangle *triangle = p->tri->triangle;
	uint32_t edge, *link;
	int wrong = find(p, from, to, &edge, ret_at);

	if (wrong)
		return wrong;
	if (edge == TRI_NONE) {
		tri_piece_fill(p);
		return 0;
	}
	link = &triangle[edge >> 3].link[(edge & 6) >> 1];
	*link |= 1;
	triangle[*link >> 3].link[(*link & 6) >> 1] |= 1;
	return 0;
}

int tri_piece_find(struct tri_pieces *p, uint32_t from, uint32_t to, uint32_t *ret_n, uint32_t *ret_at)
{
	uint32_t edge;
	int wrong = find(p, from, to, &edge, ret_at);

	if (!wrong)
		*ret_n = p->ncrossed;
	return wrong;
}

uint32_t tri_piece_found(const struct tri_pieces *p, uint32_t i)
{
	return p->crossed[i].link >> 3;
}
