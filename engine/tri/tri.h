/*
 * The kernel: distinct positions to their unique Delaunay triangulation (docs/design/algorithm.md 1, 2, 10), inside one
 * arena that the caller hands in. No allocation, no I/O, no globals. Same positions in the same order:
 * same triangles in the same order.
 */
#ifndef TRI_H
#define TRI_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mesh.h"

enum { TRI_BYTES_PER_POINT = 64 };
#define TRI_MAX_POINTS (1u << 26)

/* Bytes of arena for up to `cap` positions: 64 a point and a small constant. */
size_t tri_bytes(uint32_t cap);

struct tri; /* lies at the start of the arena */

/* `memory` of tri_bytes(cap), 64-byte aligned. */
struct tri *tri_init(void *memory, uint32_t cap);
/* Where the caller writes its positions (in Morton order, distinct), up to cap: inside the arena. */
struct mesh_vertex *tri_input(struct tri *);

/* Triangulate the first n. 0, or TRI_E_FLAT: fewer than three, or all collinear: no triangles. */
enum { TRI_E_FLAT = 1 };
int tri_run(struct tri *, uint32_t n);

/*
 * More positions into what tri_run gave (0), up to the capacity, inserted as they come: fastest where each is near
 * the one before. One that is there already becomes no second vertex; of the two heights the lower stays, with
 * `highest` the higher. TRI_E_FULL: those before the one that did not fit are in. Added vertices have their own
 * number as id.
 */
enum { TRI_E_FULL = 2 };
int tri_add(struct tri *, const struct mesh_vertex *, uint32_t n, bool highest);
uint32_t tri_count(const struct tri *); /* vertices, also of a run that was flat */

/* The result. Vertices are renumbered (curve order); id is the place in the input. Triangles
 * [0, ntriangle) include ghosts: corner[i] == TRI_GHOST marks the infinite vertex. Links are
 * tri << 3 | side << 1 | constrained; link[i] is across from corner[i]. */
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
