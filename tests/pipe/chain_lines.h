/* Lines for chains of generations: random pieces, as a source of line vertices, and the whole mesh to compare with. */
#ifndef CHAIN_LINES_H
#define CHAIN_LINES_H

#include "grid_fixture.h"
#include "lineset.h"
#include "pipe.h"

enum { CHAIN_PIECES = 96, CHAIN_VERTICES = 24 };

struct chain_lines {
	struct lineset_piece piece[CHAIN_PIECES];
	size_t n;
	struct point vertex[CHAIN_VERTICES];
	size_t nvertex;
	unsigned far;
};

/* Vertices near the points. `like`: most of the pieces are those of another one; or NULL. */
void chain_lines_make(uint64_t *rng, const struct set *, const struct chain_lines *like, struct chain_lines *ret);
/* Adds the vertices as records of a source. */
void chain_lines_add(const struct chain_lines *, struct set *, uint32_t source);
/* Inserts the pieces whose ends are both among n vertices into their triangulation. *ret: to be freed. Returns how many were
 * crossed by edges, before each. `l` may be NULL. */
struct tri;
struct tri_pieces;
struct tri_result;
uint64_t chain_lines_insert(const struct chain_lines *l, struct tri *, const struct mesh_vertex *, uint32_t n,
			    struct tri_pieces **ret);
/* Whether a triangle is beyond a boundary, or in a hole. */
bool chain_lines_out(const struct reader *, const struct tri_result *, const uint32_t corner[3]);
/* The totals are those of the constrained mesh of all points that the view keeps. Returns the triangles that are not Delaunay. */
uint64_t chain_lines_check(const struct reader *, const struct view *, const struct chain_lines *, const struct pipe_totals *);

#endif
