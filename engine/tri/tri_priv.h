/*
 * The layout of the arena, and the steps of a run. Internal.
 */
#ifndef TRI_PRIV_H
#define TRI_PRIV_H

#include <stdbool.h>

#include "tri.h"

#define TRI_LIKELY(x) __builtin_expect(!!(x), 1)
#define TRI_UNLIKELY(x) __builtin_expect(!!(x), 0)

struct tri_extent {
	int32_t min[2], max[2];
};

/* At the start of the arena; `triangle`, `xy`, `z`, `id` follow, with 48, 8, 4 and 4 bytes for each point. */
struct tri {
	uint32_t cap, nvertex, ntriangle;
	struct tri_triangle *triangle;
	int32_t (*xy)[2];
	int32_t *z;
	uint32_t *id;
	struct tri_extent extent;
};

/* Chooses the order of insertion: reads n positions from `in`, fills xy, z, id and the extent. */
void tri_order(struct tri *, const struct mesh_vertex *in, uint32_t n);

/* The second half of tri_run: triangulates the nvertex vertices in their order (three may be moved to the front).
 * `narrow`: all differences of coordinates are within +-(2^31 - 1). */
int tri_build(struct tri *, bool narrow);
/* Its first step: the triangle of three vertices, which are moved to the front, and its ghosts. False: the vertices are flat. */
bool tri_seed(struct tri *);

static inline bool tri_narrow(const struct tri_extent *e)
{
	return (int64_t)e->max[0] - e->min[0] <= INT32_MAX && (int64_t)e->max[1] - e->min[1] <= INT32_MAX;
}

/* The sides after and before one, as they are shifted in a link: 0, 2, 4. */
static inline uint32_t tri_side_next(uint32_t side2)
{
	return 2 * (9 >> side2 & 3);
}

static inline uint32_t tri_side_prev(uint32_t side2)
{
	return 2 * (18 >> side2 & 3);
}

static inline uint32_t tri_link_of(const struct tri_triangle *t, uint32_t side2)
{
	return t->link[side2 >> 1];
}

static inline uint32_t tri_corner_of(const struct tri_triangle *t, uint32_t side2)
{
	return t->corner[side2 >> 1];
}

/* Inserts vertex nvertex - 1, which is in no triangle yet. False: vertex *ret_same has the same position, and nothing
 * has changed. */
bool tri_insert_one(struct tri *, bool narrow, uint32_t *ret_same);

/* With constrained links: whether the triangle conflicts with a position; and inserts vertex nvertex - 1, with which the triangle
 * `root` conflicts. The triangles that are reached from there in conflict, and the two after the last one, are its fan then. */
bool tri_conflict(const struct tri *, uint32_t triangle, const int32_t at[2]);
void tri_insert_at(struct tri *, uint32_t root);
/* Walks from a triangle to the one that contains a position, or to a ghost on whose side it is. */
uint32_t tri_locate(const struct tri *, bool narrow, const int32_t p[2], uint32_t from);

/* Inserts vertices 3 to nvertex - 1 into the four triangles of the first three. */
void tri_insert_all(struct tri *, bool narrow);

#endif
