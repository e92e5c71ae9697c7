/*
 * What each piece turns (docs/design/constraints.md, "Areas").
 *
 * A line is swept over the plane by x. It crosses pieces that share ends only, so their order along the line stays, and a
 * balanced tree (a treap) has the sum of what is below any position. Pieces that stand upright are not crossed by a line that is
 * moved a little to the right; they are looked at from the region at their right side.
 *
 * It is done once for the pieces of each label: a piece of a ring has the inside of the area above it if the number of its
 * pieces up to it is odd. Then each piece has a weight for each kind of area: the number of areas that begin where it is crossed
 * upwards, less those that end. And once for all pieces: sums of weights are the numbers of areas on both sides.
 */
#include <stdlib.h>
#include <string.h>

#include "breakline_priv.h"
#include "err.h"
#include "geom.h"
#include "order.h"

enum { LAKE, BOUNDARY, HOLE, AREAS };

struct weight {
	int32_t of[AREAS];
};

struct node {
	uint32_t below, above; /* subtrees; 0: none */
	uint32_t draw, piece;
	struct weight own, sum; /* sum: of the subtree */
};

struct sweep {
	const struct snap *lines;
	struct node *node; /* from 1 on */
	uint32_t free, unused, nnodes, root;
	uint32_t *start; /* pieces that begin at a vertex, in their order upwards */
	uint32_t nstart;
	uint64_t draws;
};

static void weight_add(struct weight *w, const struct weight *more)
{
	for (unsigned i = 0; i < AREAS; i++)
		w->of[i] += more->of[i];
}

static bool weight_is_zero(const struct weight *w)
{
	return !w->of[LAKE] && !w->of[BOUNDARY] && !w->of[HOLE];
}

static const int32_t *position(const struct sweep *s, uint32_t vertex)
{
	return &s->lines->vertex[vertex].x;
}

static bool is_upright(const struct snap *l, uint32_t piece)
{
	return l->vertex[l->piece[piece][0]].x == l->vertex[l->piece[piece][1]].x;
}

/* ---- the tree ---- */

static uint32_t node_new(struct sweep *s, uint32_t piece, const struct weight *own)
{
	uint32_t i = s->free;

	if (i)
		s->free = s->node[i].below;
	else
		i = ++s->unused;
	s->draws = s->draws * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
	s->node[i] = (struct node){.draw = (uint32_t)(s->draws >> 32), .piece = piece, .own = *own, .sum = *own};
	return i;
}

static void node_free_all(struct sweep *s, uint32_t t)
{
	if (!t)
		return;
	node_free_all(s, s->node[t].above);
	node_free_all(s, s->node[t].below);
	s->node[t].below = s->free;
	s->free = t;
}

static void node_sum(struct sweep *s, uint32_t t)
{
	struct node *n = &s->node[t];

	n->sum = n->own;
	weight_add(&n->sum, &s->node[n->below].sum);
	weight_add(&n->sum, &s->node[n->above].sum);
}

static uint32_t tree_join(struct sweep *s, uint32_t lower, uint32_t upper)
{
	if (!lower || !upper)
		return lower ? lower : upper;
	if (s->node[lower].draw > s->node[upper].draw) {
		s->node[lower].above = tree_join(s, s->node[lower].above, upper);
		node_sum(s, lower);
		return lower;
	}
	s->node[upper].below = tree_join(s, lower, s->node[upper].below);
	node_sum(s, upper);
	return upper;
}

/* Parts the pieces of which the vertex is on that side (1: above) or more from the others. */
static void tree_part(struct sweep *s, uint32_t t, uint32_t vertex, int side, uint32_t *lower, uint32_t *upper)
{
	const uint32_t *end;

	if (!t) {
		*lower = *upper = 0;
		return;
	}
	end = s->lines->piece[s->node[t].piece];
	if (geom_orient(position(s, end[0]), position(s, end[1]), position(s, vertex)) >= side) {
		tree_part(s, s->node[t].above, vertex, side, &s->node[t].above, upper);
		*lower = t;
	} else {
		tree_part(s, s->node[t].below, vertex, side, lower, &s->node[t].below);
		*upper = t;
	}
	node_sum(s, t);
}

/* ---- a step of the sweep ---- */

/* Of two pieces that begin at one vertex, whether the first is lower. */
static int compare_starts(const void *a, const void *b, void *ctx)
{
	const struct sweep *s = ctx;
	const uint32_t *p = s->lines->piece[*(const uint32_t *)a], *q = s->lines->piece[*(const uint32_t *)b];

	return -geom_orient(position(s, p[0]), position(s, p[1]), position(s, q[1]));
}

/* Ends what ends at the vertex. *ret: the weights of all that is below; the rest of the tree is in `lower` and `upper`. */
static void step_begin(struct sweep *s, uint32_t vertex, uint32_t *lower, uint32_t *upper, struct weight *ret)
{
	uint32_t through;

	tree_part(s, s->root, vertex, 1, lower, upper);
	tree_part(s, *upper, vertex, 0, &through, upper);
	node_free_all(s, through);
	*ret = s->node[*lower].sum;
	if (s->nstart > 1)
		qsort_r(s->start, s->nstart, sizeof *s->start, compare_starts, s);
}

static void step_add(struct sweep *s, uint32_t *lower, uint32_t piece, const struct weight *own)
{
	*lower = tree_join(s, *lower, node_new(s, piece, own));
}

/* ---- memory ---- */

static uint64_t sweep_nodes(const struct sweep *s)
{
	return (uint64_t)s->nnodes + 1;
}

/* The most pieces of a list that the line crosses at a time, and the most that begin at a vertex. `list`: in order; NULL: all. */
static uint32_t most_active(const struct snap *l, const uint32_t (*list)[2], uint32_t n, int32_t *change)
{
	int64_t active = 0, most = 0;

	memset(change, 0, ((size_t)l->nvertex + 1) * sizeof *change);
	for (uint32_t i = 0; i < n; i++) {
		const uint32_t *end = l->piece[list ? list[i][1] : i];

		change[end[0]]++;
		change[end[1]]--;
	}
	for (uint32_t i = 0; i < l->nvertex; i++) {
		active += change[i];
		most = active > most ? active : most;
	}
	return (uint32_t)most;
}

/* Before the pieces that end at a vertex are gone those that begin there are not added, so the count of most_active holds. */
static int sweep_new(struct sweep *s, const struct snap *l, struct breakline_memory *m, struct err *err)
{
	uint32_t starts = 0, most = 0;
	int32_t *change = breakline_take(m, (uint64_t)l->nvertex + 1, sizeof *change, err);

	if (!change)
		return -(int)err->code;
	*s = (struct sweep){.lines = l, .nnodes = most_active(l, NULL, l->npiece, change)};
	breakline_give(m, change, (uint64_t)l->nvertex + 1, sizeof *change);
	for (uint32_t i = 0; i < l->npiece; i++) {
		starts = i && l->piece[i][0] == l->piece[i - 1][0] ? starts + 1 : 1;
		most = starts > most ? starts : most;
	}
	s->nstart = most;
	s->node = breakline_take(m, sweep_nodes(s), sizeof *s->node, err);
	s->start = s->node ? breakline_take(m, (uint64_t)most + 1, sizeof *s->start, err) : NULL;
	if (!s->start) {
		breakline_give(m, s->node, sweep_nodes(s), sizeof *s->node);
		return -(int)err->code;
	}
	return 0;
}

static void sweep_free(struct sweep *s, uint32_t most, struct breakline_memory *m)
{
	breakline_give(m, s->start, (uint64_t)most + 1, sizeof *s->start);
	breakline_give(m, s->node, sweep_nodes(s), sizeof *s->node);
}

static void sweep_restart(struct sweep *s)
{
	s->root = s->free = s->unused = 0;
	s->draws = 1;
}

/* ---- the pieces of one label ---- */

static void add_to(struct weight *w, unsigned area, bool begins)
{
	w->of[area] += begins ? 1 : -1;
}

/* The pieces from *at on that begin at this vertex. */
static void step_label(struct sweep *s, const uint32_t (*along)[2], uint32_t *at, uint32_t n, uint32_t vertex, unsigned area,
		       struct weight *weight)
{
	const struct weight one = {{1}};
	uint32_t upright = UINT32_MAX, lower, upper;
	struct weight below;

	for (s->nstart = 0; *at < n && s->lines->piece[along[*at][1]][0] == vertex; ++*at) {
		if (is_upright(s->lines, along[*at][1]))
			upright = along[*at][1];
		else
			s->start[s->nstart++] = along[*at][1];
	}
	step_begin(s, vertex, &lower, &upper, &below);
	for (uint32_t i = 0; i < s->nstart; i++) {
		below.of[0]++;
		add_to(&weight[s->start[i]], area, below.of[0] & 1);
		step_add(s, &lower, s->start[i], &one);
	}
	if (upright != UINT32_MAX)
		add_to(&weight[upright], area, below.of[0] & 1);
	s->root = tree_join(s, lower, upper);
}

static int sweep_label(struct sweep *s, const uint32_t (*along)[2], uint32_t n, unsigned area, struct weight *weight,
		       struct breakline_memory *m, struct err *err)
{
	/* qsort may take as much again. */
	uint32_t *vertex = breakline_take(m, 4 * (uint64_t)n, sizeof *vertex, err), at = 0;

	if (!vertex)
		return -(int)err->code;
	for (uint32_t i = 0; i < n; i++)
		memcpy(&vertex[2 * (size_t)i], s->lines->piece[along[i][1]], 2 * sizeof *vertex);
	qsort(vertex, 2 * (size_t)n, sizeof *vertex, order_u32);
	sweep_restart(s);
	for (size_t i = 0; i < 2 * (size_t)n; i++)
		if (i == 0 || vertex[i] != vertex[i - 1])
			step_label(s, along, &at, n, vertex[i], area, weight);
	breakline_give(m, vertex, 4 * (uint64_t)n, sizeof *vertex);
	return 0;
}

static int sweep_labels(struct sweep *s, const struct breakline_areas *a, struct weight *weight, struct breakline_memory *m,
			struct err *err)
{
	const uint32_t(*along)[2] = (const uint32_t(*)[2])a->lines->along;
	int rc = 0;

	for (uint32_t from = 0, to; rc == 0 && from < a->lines->nalong; from = to) {
		uint8_t kind = a->kind[along[from][0] - 1];

		for (to = from; to < a->lines->nalong && along[to][0] == along[from][0]; to++)
			;
		rc = sweep_label(s, along + from, to - from,
				 kind == BREAKLINE_LAKE     ? LAKE :
				 kind == BREAKLINE_BOUNDARY ? BOUNDARY :
							      HOLE,
				 weight, m, err);
	}
	return rc;
}

/* ---- all pieces ---- */

static unsigned state_of(const struct breakline_areas *a, const struct weight *w)
{
	if (w->of[HOLE] > 0 || (a->boundary && w->of[BOUNDARY] <= 0))
		return LINESET_OUT;
	return w->of[LAKE] > 0 ? LINESET_LAKE : 0;
}

/* `below`: of what is on one side of the piece, here its lower or left one. */
static void judge_piece(struct breakline_areas *a, uint32_t piece, const struct weight *below, const struct weight *above)
{
	unsigned lower = state_of(a, below), upper = state_of(a, above);

	a->side[piece] = (uint8_t)(lower ^ upper);
	if (lower & upper & LINESET_OUT)
		a->side[piece] |= BREAKLINE_PIECE_OUT;
}

static void step_all(struct sweep *s, struct breakline_areas *a, uint32_t *at, uint32_t vertex, const struct weight *weight)
{
	const struct snap *l = s->lines;
	uint32_t upright = UINT32_MAX, lower, upper;
	struct weight below;

	for (s->nstart = 0; *at < l->npiece && l->piece[*at][0] == vertex; ++*at) {
		if (is_upright(l, *at))
			upright = *at;
		else
			s->start[s->nstart++] = *at;
	}
	step_begin(s, vertex, &lower, &upper, &below);
	for (uint32_t i = 0; i < s->nstart; i++) {
		const struct weight *own = &weight[s->start[i]];
		struct weight above = below;

		weight_add(&above, own);
		judge_piece(a, s->start[i], &below, &above);
		if (!weight_is_zero(own))
			step_add(s, &lower, s->start[i], own);
		below = above;
	}
	if (upright != UINT32_MAX) {
		struct weight left = below;

		for (unsigned i = 0; i < AREAS; i++)
			left.of[i] -= weight[upright].of[i];
		judge_piece(a, upright, &left, &below);
	}
	s->root = tree_join(s, lower, upper);
}

int breakline_areas(struct breakline_areas *a, struct breakline_memory *m, struct err *err)
{
	const struct snap *l = a->lines;
	struct weight *weight;
	struct sweep s;
	uint32_t most, at = 0;
	int rc;

	if (!l->nalong && !a->boundary)
		return 0;
	weight = breakline_take(m, l->npiece, sizeof *weight, err);
	if (!weight)
		return -(int)err->code;
	rc = sweep_new(&s, l, m, err);
	if (rc == 0) {
		most = s.nstart;
		rc = sweep_labels(&s, a, weight, m, err);
		if (rc == 0) {
			sweep_restart(&s);
			for (uint32_t i = 0; i < l->nvertex; i++)
				step_all(&s, a, &at, i, weight);
		}
		sweep_free(&s, most, m);
	}
	breakline_give(m, weight, l->npiece, sizeof *weight);
	return rc;
}
