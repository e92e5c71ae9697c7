/* The triangles around some positions of the mesh, from the chosen points nearby. Internal. */
#ifndef SIMPLIFY_NEAR_H
#define SIMPLIFY_NEAR_H

#include "simplify_circle.h"
#include "simplify_region.h"

enum { SIMPLIFY_DISCS = 384 };

/* Of a vertex: it is one of the positions; it has a triangle that may not be in the mesh. */
enum { SIMPLIFY_STAR = 1, SIMPLIFY_DOUBTFUL = 2 };

struct simplify_near {
	struct simplify_check *c;
	const uint64_t *key; /* of the positions, ascending */
	size_t nkey;
	double side; /* of a square with some chosen points */
	/* results: a triangulation, in the memory of the domain. All triangles around a SIMPLIFY_STAR that is not
	 * SIMPLIFY_DOUBTFUL are those of the mesh. */
	struct tri_result tri;
	uint8_t *kind;
	/* within */
	struct grid_reader *reader;
	struct tri *memory;
	struct simplify_sink sink;
	struct mesh_vertex *point;
	uint32_t n, room, cap, nread;
	bool begun;            /* there is a triangulation, of all points that were read, and its vertices have kinds */
	bool full;             /* too many points, or pieces */
	int32_t limit[4];      /* points beyond are not read this time */
	int32_t box[4];        /* all points in it were read, */
	uint32_t nseen, ndisc; /* and in the first `nseen` discs */
	struct simplify_circle disc[SIMPLIFY_DISCS];
};

/* The box of positions, of which there is at least one. */
void simplify_keys_box(const uint64_t *key, size_t n, int32_t ret[4]);

/* *ret_done: else nothing is known. */
int simplify_near(struct simplify_near *, bool *ret_done, struct err *err);

#endif
