/* The triangulation of greedy insertion. Internal. */
#ifndef SIMPLIFY_CELL_H
#define SIMPLIFY_CELL_H

#include "simplify_greedy.h"
#include "tri.h"

#define SIMPLIFY_NONE UINT32_MAX
enum { SIMPLIFY_FAN = 64 }; /* the most triangles of a fan that is dealt out in 64 bits */

/* Half of a cache line: most of the time goes into reaching these. */
struct cell {
	uint32_t corner[3], beside[3]; /* neighbours across from the corners */
	uint32_t first;                /* of its points */
	uint32_t worst;                /* the farthest of them */
};

/* A side of the hole, counter-clockwise, and what is behind it. */
struct side {
	uint32_t a, b, beyond, cell;
};

/* A point, and the next in the list of its triangle. */
struct node {
	int32_t x, y, z;
	uint32_t next;
};

/* A triangle of the hole, and the one from which it was reached. */
struct pit {
	uint32_t cell, from;
};

/* A triangle of a fan: its corners a and b relative to the new point, and the farthest of its points so far. */
struct blade {
	int64_t ax, ay, az, bx, by, bz, area;
	uint64_t most;
	uint32_t worst, first, before, after;
};

struct greedy {
	struct simplify_greedy *g;
	const struct point *pts;
	struct node *node;
	struct cell *cell;
	struct side *side;
	uint64_t
		*key; /* of each cell: that of its farthest point; if that is near enough, about that, and no more than `least` */
	struct pit *hole;
	uint32_t *from;  /* of a vertex of the hole, the side that begins there */
	struct tri *tri; /* of the base; in the memory of sides and keys, which are used later */
	struct simplify_place *order;
	uint32_t ncell, nhole, nside;
	int64_t high;  /* the range of heights; 0: the block is too wide for 64 bits */
	int64_t error; /* what is not farther is near enough; within the range */
	struct blade blade[SIMPLIFY_FAN];
	uint32_t list[SIMPLIFY_FAN], nlist; /* the first points of lists */
};

/* Finds the settled triangles, at the end (simplify_settle.c). */
void simplify_settle(struct greedy *);

#endif
