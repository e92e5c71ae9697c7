/*
 * The verifier: whether a mesh is the Delaunay triangulation of its vertices, and whether the vertices are the points.
 * It shares no code with the kernel: it has its own predicates, adjacency and order of points. In memory, O(n log n),
 * about 60 bytes for each vertex besides the mesh; no I/O.
 *
 * It checks the following, in this order, and reports the first fault with its place:
 * - indices are in range and distinct; triangles are strictly counter-clockwise; each edge is used at most once in each
 *   direction; every vertex is used;
 * - the boundary is a single loop; Euler's formula of a disc holds; the boundary is convex (collinear vertices are
 *   allowed) and turns once;
 * - every inner edge is locally Delaunay, exactly; of cocircular vertices the tie rule's diagonal is used (algorithm.md
 *   1: the lexicographically last vertex of a cocircular polygon is cut off as an ear, repeatedly).
 *
 * An edge that is marked as a piece of a line in both of its triangles need not be Delaunay; one that is marked in one of them
 * alone is a fault. So the mesh is the constrained triangulation of its vertices and its marked edges.
 *
 * With weights (docs/design/weights.md) the mesh is the regular triangulation of its vertices: powers take the place of circles,
 * and the tie rule is the one of there.
 *
 * Of a trimmed mesh the boundary, the formula, and unused or missing vertices are not checked: each edge that has two
 * triangles is still one of the whole mesh.
 *
 * Strict orientation, a disc, and a convex boundary that turns once imply that the triangles cover the hull without
 * overlap. Then local Delaunay of all edges is global.
 */
#ifndef VERIFY_H
#define VERIFY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "point.h"
#include "view.h"

struct err;

enum verify_fault {
	VERIFY_GOOD,
	VERIFY_INDEX,       /* a triangle has a vertex number out of range, or the same one twice */
	VERIFY_ORIENTATION, /* a triangle is clockwise or without area */
	VERIFY_EDGE,        /* an edge has the same direction in two triangles */
	VERIFY_UNUSED,      /* a vertex is in no triangle, unless there are no triangles and all vertices are collinear */
	VERIFY_BOUNDARY,    /* the boundary is not a single loop */
	VERIFY_EULER,       /* the numbers of vertices, edges and triangles are not those of a disc */
	VERIFY_CONVEX,      /* the boundary is not the convex hull */
	VERIFY_DELAUNAY,    /* a vertex is strictly inside the circumcircle of a neighbour */
	VERIFY_TIE,         /* an edge is Delaunay, but not the diagonal of the tie rule */
	VERIFY_MISSING,     /* a point is not a vertex */
	VERIFY_EXTRA,       /* a vertex is not a point, or two vertices have the same position */
	VERIFY_HEIGHT,      /* a vertex has a height other than its point's */
	VERIFY_PIECE,       /* an edge is a piece of a line in one of its triangles only */
	VERIFY_POWER,       /* with weights: a vertex has less power than a neighbour at the centre of that */
	VERIFY_FAULTS
};

struct verify_mesh {
	const int32_t (*vertex)[3]; /* lattice numbers x, y, z */
	const uint32_t (*triangle)[3];
	size_t nvertex, ntriangle;
	bool trimmed;         /* triangles of a mesh that were left out, or other vertices, are no fault */
	const uint8_t *edges; /* a byte a triangle, bit k: the side across from corner k is a piece of a line; NULL: none is */
	/* k > 0: circles and ties are those of the positions p x + q y, k (p y - q x); each within 2^14 */
	int64_t p, q, k;
	const int64_t *weight; /* of each vertex, from 0 to 2^60; not with k. NULL: without weights */
};

struct verify_report {
	enum verify_fault fault;
	char text[256]; /* the fault, in one sentence; "" if there is none */
	bool has_place;
	int32_t place[3];   /* lattice numbers of the first fault */
	uint64_t edges;     /* undirected */
	uint64_t inner;     /* inner edges, tested for Delaunay */
	uint64_t ties;      /* inner edges with four cocircular vertices, decided by the tie rule */
	uint64_t pieces;    /* edges that are pieces of lines */
	uint64_t hull;      /* vertices on the boundary, collinear ones included */
	uint64_t points;    /* points to compare with */
	uint64_t positions; /* distinct positions among them */
	uint64_t absent;    /* of these: no vertices of a trimmed mesh, or of one with lines */
};

/* 0 and the report, or -ERR_NOMEM; -ERR_LIMIT: mapped positions reach over more than 32 bits, or there are too many triangles. A
 * mesh without triangles is good if all vertices are collinear; verify_points then checks that they are the points. */
int verify_mesh(const struct verify_mesh *, struct verify_report *ret, struct err *err);

/* Compares vertices and points (those that the view takes) in both directions; duplicates are reduced as the view says.
 * Sorts `pts` in place. Continues a report without a fault. -ERR_NOMEM. */
int verify_points(const struct verify_mesh *, const struct view *, struct point *pts, size_t n, struct verify_report *,
		  struct err *err);

/* With weights: 1 if the last position has less power than p[0..2], which are counter-clockwise, at the point where they have the
 * same; -1 if it has more. *ret_tie: it has as much, and the tie rule has decided. */
int verify_power(const int32_t *const p[4], const int64_t w[4], bool *ret_tie);

const char *verify_fault_text(enum verify_fault);

#endif
