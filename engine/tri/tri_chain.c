/*
 * One side of a piece: ears are cut in a random order until one triangle is left, and are added again in the reverse
 * order, each with the flips of Lawson (docs/design/constraints.md, "One side of a piece").
 *
 * The polygon that is left after some cuts may overlap itself. That is harmless: the test of an ear and the in-circle
 * test look at two triangles with a common side only, and all triangles of a tree are counter-clockwise at any time.
 *
 * The order is random so that a chain along a curve, of which each vertex sees all others, takes a few flips a vertex
 * and not a number that grows with the chain. It is the same in every run, and the result does not depend on it.
 */
#include "tri_chain.h"

#include <assert.h>
#include <stddef.h>

#include "geom.h"

struct ears {
	struct tri_node *node;
	const int32_t (*xy)[2];
	uint32_t n, nlisted;
	uint64_t random;
};

static bool is_ear(const struct ears *e, uint32_t i)
{
	const struct tri_node *node = e->node, *at = &node[i];

	return geom_orient(e->xy[node[at->end[0]].vertex], e->xy[at->vertex], e->xy[node[at->end[1]].vertex]) < 0;
}

/* Lists node i if it is an ear and not listed yet. */
static void list_ear(struct ears *e, uint32_t i)
{
	if (i == 0 || i == e->n - 1 || e->node[i].listed || !is_ear(e, i))
		return;
	e->node[i].listed = 1;
	e->node[e->nlisted++].ear = i;
}

static uint32_t take_listed(struct ears *e)
{
	uint32_t at, i;

	assert(e->nlisted); /* the farthest node is an ear */
	e->random = e->random * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
	at = (uint32_t)((e->random >> 32) * e->nlisted >> 32);
	i = e->node[at].ear;
	e->node[at].ear = e->node[--e->nlisted].ear;
	e->node[i].listed = 0;
	return i;
}

/* Cuts all inner nodes but one. Each keeps the neighbours that it had. Returns the one that was cut last. */
static uint32_t cut_ears(struct tri_chain *c, const int32_t (*xy)[2])
{
	struct ears e = {.node = c->node, .xy = xy, .n = c->n, .random = c->n};
	uint32_t last = TRI_NONE, left = c->n - 2;

	for (uint32_t i = 0; i < c->n; i++) {
		c->node[i].end[0] = i - 1;
		c->node[i].end[1] = i + 1;
		c->node[i].listed = 0;
	}
	for (uint32_t i = 1; i + 1 < c->n; i++)
		list_ear(&e, i);
	while (left > 1) {
		uint32_t i = take_listed(&e);
		struct tri_node *at = &c->node[i];

		/* A cut beside it has made it reflex. Another one may list it again. */
		if (!is_ear(&e, i))
			continue;
		c->node[at->end[0]].end[1] = at->end[1];
		c->node[at->end[1]].end[0] = at->end[0];
		at->up = last;
		last = i;
		left--;
		list_ear(&e, at->end[0]);
		list_ear(&e, at->end[1]);
	}
	return last;
}

/* Whether the apex of triangle b is inside the circle of triangle a. They share a side. */
static bool conflict(const struct tri_node *node, const int32_t (*xy)[2], uint32_t a, uint32_t b)
{
	return geom_incircle(xy[node[node[a].end[0]].vertex], xy[node[node[a].end[1]].vertex], xy[node[a].vertex],
			     xy[node[b].vertex]) > 0;
}

/* Flips the side between triangle x and its parent, which becomes its child. */
static void rotate(struct tri_chain *c, uint32_t x)
{
	struct tri_node *node = c->node, *child = &node[x], *parent = &node[child->up];
	uint32_t y = child->up, up = parent->up;
	unsigned side = parent->child[1] == x, other = !side;

	parent->child[side] = child->child[other];
	if (parent->child[side] != TRI_NONE)
		node[parent->child[side]].up = y;
	child->child[other] = y;
	child->end[other] = parent->end[other];
	parent->end[side] = x;
	parent->up = x;
	child->up = up;
	if (up == TRI_NONE)
		c->root = x;
	else
		node[up].child[node[up].child[1] == y] = x;
}

/* Triangle y has come between the new node, now its end[side], and the triangle across from that end. Flips until no
 * circle of the triangles that have taken y's place contains the apex across. */
static void settle(struct tri_chain *c, const int32_t (*xy)[2], uint32_t y, unsigned side)
{
	struct tri_node *node = c->node;
	uint32_t stop = node[y].child[side];

	while (y != stop) {
		uint32_t across = node[y].child[!side];

		if (across != TRI_NONE && conflict(node, xy, y, across)) {
			rotate(c, across);
			y = across;
		} else {
			y = node[y].child[side];
		}
	}
}

/* Adds node v, an ear of what is there, between its ends, of which one is below the other in the tree. */
static void add_ear(struct tri_chain *c, const int32_t (*xy)[2], uint32_t v)
{
	struct tri_node *node = c->node, *at = &node[v];
	uint32_t before = at->end[0], after = at->end[1];
	bool below_before = before != 0 && node[before].child[1] == TRI_NONE;

	at->child[0] = at->child[1] = TRI_NONE;
	at->up = below_before ? before : after;
	node[at->up].child[below_before] = v;
	while (at->up != TRI_NONE && conflict(node, xy, at->up, v)) {
		uint32_t y = at->up;
		unsigned side = node[y].child[1] == v;

		rotate(c, v);
		settle(c, xy, y, side);
	}
}

void tri_chain_fill(struct tri_chain *c, const int32_t (*xy)[2])
{
	uint32_t last = cut_ears(c, xy), before;
	struct tri_node *root;

	c->root = c->node[0].end[1];
	root = &c->node[c->root];
	root->child[0] = root->child[1] = root->up = TRI_NONE;
	for (; last != TRI_NONE; last = before) {
		before = c->node[last].up;
		add_ear(c, xy, last);
	}
}
