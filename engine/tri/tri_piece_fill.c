/*
 * Replaces the triangles that a piece crosses by those of its two sides (docs/design/constraints.md, "The triangles of a
 * piece").
 *
 * k triangles are removed, and k are made in their places. The chains of both sides are read first. A removed triangle
 * then keeps one thing more: at a side on a chain, instead of the link, the number of the chain's edge, marked as side
 * 3, which no link has. An edge of a chain whose outer triangle has such a mark has removed triangles on both sides: it
 * hangs into the cavity, and its chain follows it there and back. Then the new triangles on both sides are linked.
 */
#include "tri_piece_priv.h"

enum { EDGE_MARK = 6 };

struct side {
	struct tri_chain chain;
	const struct tri_crossed *slot; /* the place of the triangle of node i is that of slot[i - 1] */
	uint32_t before, after; /* the strips before the chain's first edge and after its last one, as if there were any */
};

/* Takes the edge of a removed triangle as the edge after node i of the chain. */
static void edge_take(struct tri_pieces *p, struct side *s, uint32_t i, uint32_t strip, uint32_t side2)
{
	uint32_t *link = &p->tri->triangle[p->crossed[strip].link >> 3].link[side2 >> 1];

	s->chain.node[i].outer = *link;
	s->chain.node[i].strip = strip + 1;
	*link = i << 3 | EDGE_MARK;
}

/* Reads both chains: the left one from the first to the last end of the piece, the right one backwards. */
static void chains_read(struct tri_pieces *p, struct side side[2])
{
	const struct tri_triangle *triangle = p->tri->triangle;
	struct tri_node *left = side[0].chain.node, *right = side[1].chain.node;
	uint32_t at = 0, to = side[1].chain.n - 1, last = p->ncrossed - 1;
	uint32_t side2 = p->crossed[0].link & 6, next = tri_side_next(side2), prev = tri_side_prev(side2);
	const struct tri_triangle *t = &triangle[p->crossed[0].link >> 3];

	left[0].vertex = right[to].vertex = p->first;
	left[1].vertex = tri_corner_of(t, prev);
	right[to - 1].vertex = tri_corner_of(t, next);
	edge_take(p, &side[0], at++, 0, next);
	edge_take(p, &side[1], --to, 0, prev);
	for (uint32_t i = 1; i < last; i++) {
		t = &triangle[p->crossed[i].link >> 3];
		side2 = p->crossed[i].link & 6;
		if (p->crossed[i].left) {
			left[at + 1].vertex = tri_corner_of(t, side2);
			edge_take(p, &side[0], at++, i, tri_side_prev(side2));
		} else {
			right[to - 1].vertex = tri_corner_of(t, side2);
			edge_take(p, &side[1], --to, i, tri_side_next(side2));
		}
	}
	side2 = p->crossed[last].link & 6;
	left[at + 1].vertex = right[to - 1].vertex = p->last;
	edge_take(p, &side[0], at, last, tri_side_prev(side2));
	edge_take(p, &side[1], to - 1, last, tri_side_next(side2));
}

/* Edges with removed triangles on both sides: `outer` becomes the number of the other edge with the mark. */
static void hanging_find(const struct tri_triangle *triangle, struct tri_chain *c)
{
	for (uint32_t i = 0; i + 1 < c->n; i++) {
		uint32_t outer = c->node[i].outer, there = tri_link_of(&triangle[outer >> 3], outer & 6);

		if ((there & EDGE_MARK) == EDGE_MARK)
			c->node[i].outer = there | (outer & 1);
	}
}

static uint32_t place_of(const struct side *s, uint32_t i)
{
	return s->slot[i - 1].link >> 3;
}

/* The link to the edge after node i from outside: a side of one of the two nodes' triangles. */
static uint32_t link_to_edge(const struct side *s, uint32_t i)
{
	const struct tri_node *next = &s->chain.node[i + 1];

	if (i + 2 < s->chain.n && next->end[0] == i)
		return place_of(s, i + 1) << 3 | 1 << 1;
	return place_of(s, i) << 3 | 0 << 1;
}

/* Links side k (0 or 1) of the triangle of node i: to its child, or to what is outside the chain. */
static uint32_t side_link(struct tri_pieces *p, const struct side *s, uint32_t i, unsigned k)
{
	const struct tri_node *node = s->chain.node, *at = &node[i];
	uint32_t child = at->child[!k], edge = k ? at->end[0] : i, outer, here = place_of(s, i) << 3 | k << 1;

	if (child != TRI_NONE)
		return place_of(s, child) << 3 | 2 << 1;
	outer = node[edge].outer;
	if ((outer & EDGE_MARK) == EDGE_MARK)
		return link_to_edge(s, outer >> 3) | (outer & 1);
	p->tri->triangle[outer >> 3].link[(outer & 6) >> 1] = here | (outer & 1);
	return outer;
}

/* Whether one of the removed triangles between the ends of the new one had a flag. It overlaps no other ones. */
static bool flag_of(const struct tri_pieces *p, const struct side *s, const struct tri_node *at)
{
	uint32_t a = at->end[0] ? s->chain.node[at->end[0] - 1].strip : s->before;
	uint32_t b = at->end[1] + 1 < s->chain.n ? s->chain.node[at->end[1]].strip : s->after;

	return a < b ? p->crossed[b - 1].flagged > p->crossed[a].flagged : p->crossed[a - 1].flagged > p->crossed[b].flagged;
}

static void side_write(struct tri_pieces *p, const struct side *s, uint32_t across)
{
	const struct tri_node *node = s->chain.node;
	struct tri *t = p->tri;

	for (uint32_t i = 1; i + 1 < s->chain.n; i++) {
		const struct tri_node *at = &node[i];
		uint32_t place = place_of(s, i), up = at->up;
		struct tri_triangle new = {.corner = {node[at->end[0]].vertex, node[at->end[1]].vertex, at->vertex}};

		new.link[0] = side_link(p, s, i, 0);
		new.link[1] = side_link(p, s, i, 1);
		new.link[2] = up == TRI_NONE ? across << 3 | 2 << 1 | 1 : place_of(s, up) << 3 | (node[up].child[0] == i) << 1;
		t->triangle[place] = new;
		for (unsigned k = 0; k < 3; k++)
			p->at[t->id[new.corner[k]]] = place;
		p->flag[place / 64] &= ~(UINT64_C(1) << place % 64);
		if (flag_of(p, s, at))
			tri_piece_flag(p, place);
	}
}

void tri_piece_fill(struct tri_pieces *p)
{
	const int32_t(*xy)[2] = (const int32_t(*)[2])p->tri->xy;
	uint32_t nleft = 1, last = p->ncrossed - 1;
	struct side side[2];

	for (uint32_t i = 1; i < last; i++)
		nleft += p->crossed[i].left;
	side[0] = (struct side){{p->node, nleft + 2, 0}, p->crossed, 0, p->ncrossed + 1};
	side[1] = (struct side){{p->node + nleft + 2, p->ncrossed - nleft + 2, 0}, p->crossed + nleft, p->ncrossed + 1, 0};
	chains_read(p, side);
	for (unsigned k = 0; k < 2; k++) {
		hanging_find(p->tri->triangle, &side[k].chain);
		tri_chain_fill(&side[k].chain, xy);
	}
	for (unsigned k = 0; k < 2; k++)
		side_write(p, &side[k], place_of(&side[!k], side[!k].chain.root));
}
