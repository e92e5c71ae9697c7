/*
 * The kernel for positions with weights: distinct positions to their unique regular triangulation (docs/design/weights.md), in
 * the arena of tri.h. A position whose power cell is empty is hidden: it is in no triangle. The same positions in the same order
 * give the same triangles in the same order.
 */
#ifndef TRI_REGULAR_H
#define TRI_REGULAR_H

#include "geom_power.h"
#include "tri.h"

/* A weight is one of so many. A vertex has the number of its weight above its id. */
enum { TRI_WEIGHTS = 64, TRI_WEIGHT_AT = 26 };

struct tri_regular {
	struct tri *tri;
	const int64_t *weight; /* by number, each within GEOM_WEIGHT_MOST */
	/* Called every few milliseconds of tri_regular_run; non-zero stops it. May be NULL. */
	int (*progress)(void *ctx);
	void *ctx;
	/* set by tri_regular_run: */
	const int32_t (*xy)[2];
	const uint32_t *id;
	/* private: unused triangles (their corners are all TRI_GHOST), linked; triangles to walk from, to insert and to search */
	uint32_t free, nfree, at, look;
};

/* Triangulates the first n positions of tri_input; kind[i]: the number of the weight of input i, outside of the arena, or in what
 * the arena has beyond tri_bytes of the tri's capacity. As tri_run, or TRI_E_STOPPED. */
enum { TRI_E_STOPPED = 3 };
int tri_regular_run(struct tri_regular *, uint32_t n, const uint8_t *kind);

/* Adds positions, all different from the vertices. TRI_E_FULL: those before the one that did not fit were added. */
int tri_regular_add(struct tri_regular *, const struct mesh_vertex *, const uint8_t *kind, uint32_t n);

/* The end of the arena's triangles that is not used yet, aligned to 16: TRI_REGULAR_EACH bytes for each position that can be
 * added, which takes as many from its front. */
enum { TRI_REGULAR_EACH = 2 * sizeof(struct tri_triangle) };
void *tri_regular_room(const struct tri_regular *);

static inline struct geom_weighted tri_regular_vertex(const struct tri_regular *r, uint32_t v)
{
	return (struct geom_weighted){r->xy[v], r->weight[r->id[v] >> TRI_WEIGHT_AT]};
}

/* Whether it is one of the triangles, or a ghost; not unused. */
static inline bool tri_regular_used(const struct tri_triangle *t)
{
	return t->corner[0] != TRI_GHOST || t->corner[1] != TRI_GHOST;
}

/* Whether a triangle, or a ghost, is in conflict with a position, which is no vertex of it. */
bool tri_regular_conflict(const struct tri_regular *, uint32_t triangle, struct geom_weighted);

/* The triangle that a position is in, or the ghost that it is beyond, if the position is in conflict with it. False: it would be
 * hidden, or is a vertex. */
bool tri_regular_around(struct tri_regular *, struct geom_weighted, uint32_t *ret);

/*
 * The triangles that would be removed if the position were added, and for ghosts the half planes: calls `visit` for each until it
 * returns true, which is returned. False without a call: the position would be hidden, or there is a vertex. Follows at most
 * `TRI_SEARCH` triangles; true if there are more.
 */
enum { TRI_SEARCH = 256 };
bool tri_regular_search(struct tri_regular *, struct geom_weighted, bool (*visit)(void *ctx, uint32_t triangle), void *ctx);

/* Moves unused triangles away, and numbers of weights. The links are no longer valid. */
void tri_regular_pack(struct tri_regular *);

#endif
