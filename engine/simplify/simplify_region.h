/* A task of a round, and the test of one region in it. Internal. */
#ifndef SIMPLIFY_REGION_H
#define SIMPLIFY_REGION_H

#include "pipe.h"
#include "simplify_error.h"
#include "simplify_priv.h"
#include "simplify_raster.h"
#include "tri.h"

/* What a task knows of its region when it ends, in `info` of its file; a later round goes on from there. */
struct simplify_found {
	uint64_t tests;
	uint64_t far;       /* the greatest error in the region's triangles, in thousandths, rounded up; or SIMPLIFY_UNKNOWN */
	uint64_t corner[3]; /* of a triangle that has it: digest_place */
	uint64_t is;        /* SIMPLIFY_CLOSED and SIMPLIFY_BOUND */
};
#define SIMPLIFY_UNKNOWN UINT64_MAX
enum {
	SIMPLIFY_CLOSED = 1, /* the region is the whole plane, and with what it added no point is too far */
	SIMPLIFY_BOUND = 2,  /* it is finite, has a vertex in it and no pieces of lines: points far away do not change it */
};
_Static_assert(sizeof(struct simplify_found) == SIMPLIFY_INFO * sizeof(uint64_t), "it is the info of a file");

struct simplify_check {
	const struct simplify *s;
	struct pipe_budget budget;
	struct cut_plan plan; /* of the task's region, split as often as necessary */
	struct simplify_in in;
	struct simplify_out out;
	struct simplify_sink sink;
	struct simplify_raster raster;
	uint8_t *domain, *source; /* the memory of the domain, of the reader of the points */
	struct point *worst;      /* of each triangle that is tested, its farthest point; the tag is NONE if there is none */
	uint64_t *mine;           /* a bit for each triangle that is tested, or was */
	uint64_t *key;            /* of points that were added, ascending */
	uint32_t *list, nlist;    /* the triangles that are tested now; in the memory of `key`, which is used before */
	uint64_t *fresh;          /* a bit for each vertex that was added */
	struct tri_result tri;
	uint32_t at; /* the triangle of the last point */
	uint32_t random;
	struct simplify_plane plane;
	uint32_t plane_of;
	geom_u128 most; /* of the farthest point of that triangle */
	struct simplify_found before, found;
	bool whole; /* all triangles are tested, not only those with a fresh corner */
	bool all;   /* nothing was left untested, whole or not */
	bool again; /* the triangle of `before` is still there */
	bool open;  /* a point that is too far was left to the next round */
};

static inline bool simplify_bit(const uint64_t *bits, uint32_t i)
{
	return bits[i / 64] >> i % 64 & 1;
}

/* Tests the triangles of a region with a corner in `fresh`, adds points until none is too far, and notes the greatest error in
 * `found`. */
int simplify_region(struct simplify_check *, const struct pipe_kernel *, const struct cut_region *, struct err *err);

#endif
