/*
 * The kernel: distinct positions to their unique Delaunay triangulation (docs/design/algorithm.md 1, 2, 10), inside an
 * arena of the caller. No allocation, no I/O, no globals. The same positions in the same order give the same triangles
 * in the same order.
 */
#ifndef TRI_H
#define TRI_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mesh.h"

enum { TRI_BYTES_PER_POINT = 64 };
#define TRI_MAX_POINTS (1u << 26)

/* Bytes of an arena for up to `cap` positions: 64 for each, and a small constant. */
size_t tri_bytes(uint32_t cap);

struct tri; /* at the start of the arena */

/* `memory`: tri_bytes(cap) bytes, aligned to 64. */
struct tri *tri_init(void *memory, uint32_t cap);
/* Memory in the arena for up to `cap` positions, which the caller writes in Morton order and distinct. In another order the
 * triangles are the same, but each costs a walk across the mesh if neighbours are not near each other. (regular_flat.c writes
 * what a result had, in its order, and one position behind it: all but that one are on a line.) */
struct mesh_vertex *tri_input(struct tri *);

/* Triangulates the first n. 0, or TRI_E_FLAT: fewer than three positions, or all collinear, so no triangles. */
enum { TRI_E_FLAT = 1 };
int tri_run(struct tri *, uint32_t n);

/*
 * Adds positions to the result of a tri_run that returned 0, up to the capacity. They are inserted in their order; it
 * is fastest if each is near the previous one. A position that exists becomes no second vertex; the lower height stays,
 * or the higher one with `highest`. TRI_E_FULL: the positions before the one that did not fit were added. The id of an
 * added vertex is its own number.
 */
enum { TRI_E_FULL = 2 };
int tri_add(struct tri *, const struct mesh_vertex *, uint32_t n, bool highest);
uint32_t tri_count(const struct tri *); /* number of vertices, also after TRI_E_FLAT */

/* The triangle that a position is in or on, or a ghost whose side it is strictly beyond; also with pieces (tri_piece.h). The walk
 * begins at triangle `from`, best one that is near. */
uint32_t tri_walk(const struct tri *, const int32_t at[2], uint32_t from);

/*
 * The result. Vertices are renumbered in the order of insertion; `id` is the index in the input. Triangles [0, ntriangle) include
 * ghosts: corner[i] == TRI_GHOST is the infinite vertex. link[i] is across from corner[i]: the other triangle times 8,
 * its side times 2, and 1 if the edge is constrained (tri_piece.h).
 */
#define TRI_GHOST UINT32_MAX
struct tri_triangle {
	uint32_t corner[3];
	uint32_t link[3];
};

struct tri_result {
	uint32_t nvertex, ntriangle;
	const int32_t (*xy)[2];
	const int32_t *z;
	const uint32_t *id;
	struct tri_triangle *triangle; /* the caller may overwrite it (compaction in place) */
};

void tri_result(const struct tri *, struct tri_result *ret);

#endif
