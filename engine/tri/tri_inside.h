/*
 * Inside the kernel: the arena's layout and the steps of a run. Not for other rooms.
 */
#ifndef TRI_INSIDE_H
#define TRI_INSIDE_H

#include <stdbool.h>

#include "tri.h"

#define TRI_LIKELY(x) __builtin_expect(!!(x), 1)
#define TRI_UNLIKELY(x) __builtin_expect(!!(x), 0)

struct tri_extent {
	int32_t min[2], max[2];
};

/* Lies at the start of the arena; `triangle`, `xy`, `z`, `id` follow it, 48, 8, 4 and 4 bytes a point. */
struct tri {
	uint32_t cap, nvertex, ntriangle;
	struct tri_triangle *triangle;
	int32_t (*xy)[2];
	int32_t *z;
	uint32_t *id;
	struct tri_extent extent;
};

/* The order of insertion: reads n positions from `in`, fills xy, z and id. `scratch`: 16 bytes a position. */
void tri_order(struct tri *, const struct mesh_vertex *in, uint64_t *scratch, uint32_t n, struct tri_extent *ret);

/* Triangulate the nvertex vertices in the order in which they stand (three may move to the front). The second
 * half of tri_run. `narrow`: all differences of coordinates lie within +-(2^31 - 1). */
int tri_build(struct tri *, bool narrow);

static inline bool tri_narrow(const struct tri_extent *e)
{
	return (int64_t)e->max[0] - e->min[0] <= INT32_MAX && (int64_t)e->max[1] - e->min[1] <= INT32_MAX;
}

/* Insert vertex nvertex - 1, which no triangle has yet. False: it stands where an older one does, *ret_same; nothing
 * has changed. */
bool tri_insert_one(struct tri *, bool narrow, uint32_t *ret_same);

/* Insert vertices 3 to nvertex - 1 into the four triangles of the first three. */
void tri_insert_all(struct tri *, bool narrow);

#endif
