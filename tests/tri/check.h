/*
 * Checks of any result of the kernel without the kernel's own steps; and a sum over triangles that does not depend on
 * their order.
 */
#ifndef CHECK_H
#define CHECK_H

#include <stdbool.h>
#include <stdint.h>

#include "tri.h"

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

/* Runs the kernel over v[0..n) in a new arena: returns its status; *ret_arena is to be freed. */
int check_run(const struct mesh_vertex *v, uint32_t n, void **ret_arena, struct tri_result *ret);

#ifdef __cplusplus
}
#endif

#endif
