/*
 * Checks of any result of the kernel without the kernel's own steps; and a sum over triangles that does not depend on
 * their order.
 */
#ifndef CHECK_H
#define CHECK_H

#include <stdbool.h>
#include <stdint.h>

#include "tri.h"
#include "tri_piece.h"

#ifdef __cplusplus
extern "C" {
#endif

struct check_sum {
	uint64_t lo, hi, n;
};

/* One triangle, any rotation, by positions. */
void check_sum_add(struct check_sum *, const int32_t a[2], const int32_t b[2], const int32_t c[2]);

/* The sum over all triangles that are not ghosts. */
struct check_sum check_sum_of(const struct tri_result *);

/*
 * Vertices are the input renumbered; links are mutual and across the same edge; every triangle is counter-clockwise;
 * across every edge the circle is empty (geom_incircle); the hull is convex; the counts satisfy Euler's formula.
 * Together: it is the Delaunay triangulation. NULL, or the fault.
 */
const char *check_result(const struct tri_result *, const struct mesh_vertex *in, uint32_t n);

/* The same with pieces (pairs of ids): circles need not be empty across edges that are marked constrained, and these are
 * the pieces. Together: it is the constrained Delaunay triangulation. */
const char *check_constrained(const struct tri_result *, const struct mesh_vertex *in, uint32_t n, const uint32_t (*piece)[2],
			      uint32_t npiece);

/* Runs the kernel over v[0..n) in a new arena: returns its status; *ret_arena is to be freed. */
int check_run(const struct mesh_vertex *v, uint32_t n, void **ret_arena, struct tri_result *ret);
/* The same; NULL if the positions are flat. */
struct tri *check_tri(const struct mesh_vertex *v, uint32_t n);
/* Memory for pieces, to be freed. */
struct tri_pieces *check_pieces(struct tri *, uint32_t most);
/* With room for so many positions; no end of a piece is known. */
struct tri *check_tri_room(const struct mesh_vertex *v, uint32_t n, uint32_t cap);
struct tri_pieces *check_pieces_room(struct tri *, uint32_t cap, uint32_t most);

#ifdef __cplusplus
}
#endif

#endif
