/* Partitions of the plane at random, and the triangles of a small mesh, with heights, in an order that depends on them alone. */
#ifndef PARTS_H
#define PARTS_H

#include "cut.h"
#include "mesh.h"
#include "sets.h"

enum { PARTS_TRIANGLES = 4 * SETS_MAX_N };

struct parts_mesh {
	int32_t triangle[PARTS_TRIANGLES][9]; /* smallest corner first; x, y, z */
	unsigned n;
};

void parts_add(struct parts_mesh *, const int32_t at[3][3]);
void parts_sort(struct parts_mesh *);
bool parts_same(const struct parts_mesh *, const struct parts_mesh *); /* after parts_sort */

/* The corners of a triangle of a domain. */
void parts_corners(const struct mesh_domain *, uint32_t triangle, int32_t ret[3][3]);

/* Halves regions, from the first one on, until there are `want` or `tries` are over. Returns how many there are. */
unsigned parts_halve(uint64_t *seed, unsigned want, unsigned tries, struct cut_region *ret);
/* Up to `most` regions that are the plane, for the points of a source. */
unsigned parts_make(uint64_t *seed, const struct cut_source *, unsigned most, struct cut_region *ret);

#endif
