/* What an area consists of, for points (area.c) and ways through it (area_way.c). */
#ifndef AREA_PRIV_H
#define AREA_PRIV_H

#include "area.h"

enum { LEAF = 16 }; /* edges */

/* Rings, by their first item; the nodes of their tree by the first box. */
struct area_set {
	size_t item, n, box;
};

struct area_ring {
	size_t first, n; /* corners */
	size_t box;      /* nodes of its chain */
	struct area_set holes;
	bool shell;
};

struct area_item {
	uint64_t key;
	size_t ring;
};

struct area {
	enum area_border border;
	struct area_ring *ring;
	int64_t (*corner)[2];
	size_t nring, rings_room, ncorner, corners_room;
	int64_t (*box)[4];
	size_t nbox, boxes_room;
	struct area_item *item;
	struct area_set polygons;
	int64_t bounds[4];
};

static inline bool boxes_meet(const int64_t a[4], const int64_t b[4])
{
	return a[0] <= b[2] && b[0] <= a[2] && a[1] <= b[3] && b[1] <= a[3];
}

static inline size_t leaves(const struct area_ring *r)
{
	return (r->n + LEAF - 1) / LEAF;
}

static inline const int64_t *corner_of(const struct area *a, const struct area_ring *r, size_t i)
{
	return a->corner[r->first + (i < r->n ? i : 0)];
}

/* A node: the leaves from `low` up to `high` of a tree. */
struct node {
	size_t box, low, high;
};
static inline struct node left_of(struct node n)
{
	return (struct node){n.box + 1, n.low, n.low + (n.high - n.low) / 2};
}
static inline struct node right_of(struct node n)
{
	size_t middle = n.low + (n.high - n.low) / 2;

	return (struct node){n.box + 2 * (middle - n.low), middle, n.high};
}
static inline bool is_leaf(struct node n)
{
	return n.high - n.low == 1;
}

/* The edges of a node of a ring. */
static inline size_t first_edge(struct node n)
{
	return n.low * LEAF;
}
static inline size_t last_edge(const struct area_ring *r, struct node n)
{
	return n.high * LEAF < r->n ? n.high * LEAF : r->n;
}

#endif
