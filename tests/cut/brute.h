/*
 * Slow and simple: triangulations by wrapping, and P_B by its definition. Shares no ideas with engine/cut.
 */
#ifndef BRUTE_H
#define BRUTE_H

#include <stdbool.h>
#include <stdint.h>

#include "mesh.h"

enum { BRUTE_POINTS = 128 };

/* Triangles of n distinct positions, counter-clockwise, smallest corner (x, then y) first; returns how many. */
unsigned brute_triangles(const struct mesh_vertex *p, unsigned n, int32_t (*ret)[6]);
/* Whether the closed Voronoi cell of p[i] meets the closed box (doubled odd borders; INT64_MIN, INT64_MAX: infinite). */
bool brute_meets(const struct mesh_vertex *p, unsigned n, unsigned i, const int64_t box[4]);

#endif
