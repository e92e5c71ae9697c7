/*
 * Greedy insertion into one block: into the triangulation of a base, again and again a point that is far from the surface, the
 * farthest of its triangle. In memory of the caller, without I/O.
 */
#ifndef SIMPLIFY_GREEDY_H
#define SIMPLIFY_GREEDY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "point.h"

enum { SIMPLIFY_BLOCK = 1 << 16 }; /* the most positions of a block */

/* The distance of a point to the surface, up or down, as floor(distance * 2^16): 49 bits at most. */
enum { SIMPLIFY_KEY_SHIFT = 16 };

/* Point `at`, with a key that fell from pick to pick by steps: not more than it had when it was inserted. One of the base has a
 * key above all others. So the picks with a key above another one are nearly those of a run that ends there. */
struct simplify_pick {
	uint64_t key;
	uint32_t at;
};

/* What a task found, in `info` of its file. */
struct simplify_found {
	uint64_t tests;
	uint64_t far;       /* the greatest error of a triangle that stays, in thousandths, rounded up */
	uint64_t corner[3]; /* of one that has it: digest_place */
	uint64_t full;      /* something was not tested, since there was no room */
};

struct simplify_raster;

enum { SIMPLIFY_EDGE = 1, SIMPLIFY_RING = 2 };

struct simplify_greedy {
	const struct point *pts; /* distinct, in Morton order. The base: POINT_LINE, and the corners of the hull */
	uint32_t n;
	uint64_t least; /* it ends when no key is greater */
	bool rough;     /* the base has more points, where the ground is rough for an error of this key */
	unsigned step;  /* 0: as usual; the greater, the nearer to strictly greedy insertion, and the slower */
	/* A box in which no other points of the view are (min x, min y, max x, max y). NULL: what is settled is not asked;
	 * else `least` is that of a whole error. */
	const int32_t *clear;
	const struct simplify_raster *pieces; /* squares that pieces of lines meet; NULL: there are no pieces */
	/* results, in the memory */
	struct simplify_pick *pick; /* in order of insertion */
	uint32_t npick;
	uint32_t *hull; /* corners of the hull, counter-clockwise; of collinear points the two ends */
	uint32_t nhull;
	/* With `clear`: of each point, SIMPLIFY_EDGE if it is a corner of a triangle that is not settled (simplify_settle.c), or
	 * of a side of the hull; SIMPLIFY_RING if it shares a triangle with such a point; and the greatest error of settled
	 * triangles. */
	uint32_t *corner;
	struct simplify_found found;
};

/* Bytes of `memory` for n points. */
size_t simplify_greedy_bytes(uint32_t n);
void simplify_greedy_run(struct simplify_greedy *, void *memory);

/* The corners of the convex hull of n > 0 distinct positions, counter-clockwise from the first by x, then y: their indices, in
 * `ret`, which has room for n + 1: the first one comes again before it is dropped. `order`: room for n. Returns how many. Of
 * collinear points these are the two ends. */
struct simplify_place {
	uint64_t place; /* digest_place */
	uint32_t at;
};
uint32_t simplify_hull(const struct point *pts, uint32_t n, struct simplify_place *order, uint32_t *ret);

#endif
