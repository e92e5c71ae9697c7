/*
 * The verifier: is this mesh the Delaunay triangulation of its vertices, and are its vertices the points?
 * It shares no code with the kernel: predicates, adjacency and the order of points are its own. In memory,
 * O(n log n), about 60 bytes a vertex beside the mesh; no I/O.
 *
 * What is checked, in this order (the first fault is reported, with its place):
 *   indices in range and distinct; triangles strictly counter-clockwise; each edge at most once in each
 *   direction; every vertex used; one outer boundary, a single loop; Euler's count of a disc; the boundary
 *   convex (collinear vertices allowed), turning once; every inner edge locally Delaunay, exactly; of
 *   cocircular points the diagonal that the tie rule takes (algorithm.md 1: the lexicographically last vertex
 *   of a cocircular polygon is cut off as an ear, again and again).
 * Strict orientation, a disc and a convex boundary that turns once make the triangles cover the hull without
 * overlap; local Delaunay of all edges then is global.
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
	VERIFY_INDEX,       /* a triangle names a vertex that is not there, or one twice */
	VERIFY_ORIENTATION, /* clockwise or without area */
	VERIFY_EDGE,        /* one edge in the same direction in two triangles */
	VERIFY_UNUSED,      /* a vertex of no triangle, unless there is none and all vertices lie on one line */
	VERIFY_BOUNDARY,    /* not one loop */
	VERIFY_EULER,       /* vertices, edges and triangles are not those of a disc */
	VERIFY_CONVEX,      /* the boundary is not the convex hull */
	VERIFY_DELAUNAY,    /* a vertex strictly inside the circle of a neighbour */
	VERIFY_TIE,         /* Delaunay, but not the diagonal of the tie rule */
	VERIFY_MISSING,     /* a point that is no vertex */
	VERIFY_EXTRA,       /* a vertex that is no point, or two vertices of one position */
	VERIFY_HEIGHT,      /* a vertex with another height than its point */
	VERIFY_FAULTS
};

struct verify_mesh {
	const int32_t (*vertex)[3]; /* lattice numbers x, y, z */
	const uint32_t (*triangle)[3];
	size_t nvertex, ntriangle;
};

struct verify_report {
	enum verify_fault fault;
	char text[256]; /* what is wrong, in one sentence; "" if good */
	bool has_place;
	int32_t place[3];   /* lattice numbers, where the first fault is */
	uint64_t edges;     /* undirected */
	uint64_t inner;     /* of them tested for Delaunay */
	uint64_t ties;      /* of those with four cocircular vertices, decided by the tie rule */
	uint64_t hull;      /* vertices on the boundary, collinear ones included */
	uint64_t points;    /* given for comparison */
	uint64_t positions; /* distinct ones among them */
};

/* 0 and the report; -ERR_NOMEM. No triangles is good if all vertices lie on one line; that they are the points, each once, is
 * asked by verify_points. */
int verify_mesh(const struct verify_mesh *, struct verify_report *ret, struct err *err);

/* Compares vertices and points (already judged by the view) both ways; duplicates are reduced as the view
 * says. `pts` is sorted in place. Goes on with a report that is good so far. -ERR_NOMEM. */
int verify_points(const struct verify_mesh *, const struct view *, struct point *pts, size_t n, struct verify_report *,
		  struct err *err);

const char *verify_fault_text(enum verify_fault);

#endif
