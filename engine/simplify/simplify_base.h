/* The base of greedy insertion. Internal. */
#ifndef SIMPLIFY_BASE_H
#define SIMPLIFY_BASE_H

#include "simplify_greedy.h"
#include "tri.h"

/* Marks the points of the base; returns how many. The hull is there. */
enum { SIMPLIFY_ROUGH = 1, SIMPLIFY_BASE = 2 }; /* there because the ground is rough; because it has to be */
uint32_t simplify_base(const struct simplify_greedy *, uint32_t *from);

/* Numbers the triangles of the base by their first corners, so that neighbours in memory are neighbours in the plane; UINT32_MAX:
 * it is a ghost. `index`: of each vertex, the point. `count`: room for n. Returns how many there are. */
uint32_t simplify_base_number(uint32_t n, const struct tri_result *, const uint32_t *index, uint32_t *count, uint32_t *number);

#endif
