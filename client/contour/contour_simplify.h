/* Lines with fewer vertices: the driver is contour_simplify.c, one cell contour_cell.c, the search in it contour_tree.c. */
#ifndef CONTOUR_SIMPLIFY_H
#define CONTOUR_SIMPLIFY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;

/* A vertex of a line, as the sort has it. The last point of a closed line, which is the first one again, is one of its own. */
struct contour_vertex {
	uint64_t key[2]; /* its position as a Morton number: vertices of a square of the quadtree are next to each other */
	uint64_t number; /* in the order of lines and points, times 8, with the marks below */
	double at[2];
};
enum { CONTOUR_FIRST = 1, CONTOUR_LAST = 2, CONTOUR_RING = 4, CONTOUR_MARKS = 8 };

/* ---- whether a triangle has a vertex: contour_tree.c ---- */

struct contour_tree;
int contour_tree_new(unsigned vertices, struct contour_tree **ret, struct err *err);
struct contour_tree *contour_tree_free(struct contour_tree *);
/* Of n vertices by their keys; they stay where they are. */
void contour_tree_fill(struct contour_tree *, const struct contour_vertex *, size_t n);
void contour_tree_remove(struct contour_tree *, uint32_t vertex);
/* True if one of the vertices is in the closed triangle of the corners, or nearly: *found. It is where the search begins, unless
 * it is CONTOUR_NONE. Those in `but` do not count. */
enum { CONTOUR_BUT = 5 };
#define CONTOUR_NONE UINT32_MAX
bool contour_tree_meets(const struct contour_tree *, const double *const corner[3], const uint32_t but[CONTOUR_BUT],
			uint32_t *found);

/* ---- a cell: contour_cell.c ---- */

struct contour_cell;
int contour_cell_new(unsigned vertices, double tolerance, struct contour_cell **ret, struct err *err);
struct contour_cell *contour_cell_free(struct contour_cell *);
/* n vertices by their keys: all that a convex part of the plane has. */
void contour_cell_simplify(struct contour_cell *, const struct contour_vertex *, size_t n);
bool contour_cell_keeps(const struct contour_cell *, size_t vertex);

#endif
