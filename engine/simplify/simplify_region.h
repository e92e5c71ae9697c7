/* A task of a round, and the test of one region in it. Internal. */
#ifndef SIMPLIFY_REGION_H
#define SIMPLIFY_REGION_H

#include "pipe.h"
#include "simplify_error.h"
#include "simplify_priv.h"
#include "simplify_raster.h"
#include "tri.h"

_Static_assert(sizeof(struct simplify_found) == SIMPLIFY_INFO * sizeof(uint64_t), "it is the info of a file");

struct simplify_check {
	const struct simplify *s;
	struct pipe_budget budget;
	struct cut_plan plan; /* of the task's region, split as often as necessary */
	struct simplify_in in, border;
	struct simplify_out out, edge; /* points that are added; those around which others are to test triangles */
	struct simplify_sink sink;
	struct simplify_raster raster;
	uint8_t *domain, *source; /* the memory of the domain, of the reader of the points */
	struct point *worst;      /* of each triangle that is tested, its farthest point; the tag is NONE if there is none */
	uint64_t *mine;           /* a bit for each triangle that is tested, or was */
	uint32_t *list, nlist;    /* the triangles that are tested now */
	uint64_t *fresh;          /* a bit for each vertex that was added */
	uint64_t *calm, *keyed;   /* a bit for each vertex that is known not to be in the file "border"; to be in it */
	struct tri_result tri;
	uint32_t at; /* the triangle of the last point */
	uint32_t random;
	struct simplify_plane plane;
	uint32_t plane_of;
	geom_u128 most; /* of the farthest point of that triangle */
	struct simplify_found found;
};

static inline bool simplify_bit(const uint64_t *bits, uint32_t i)
{
	return bits[i / 64] >> i % 64 & 1;
}

/* Whether the first round tests no settled triangles, and has only some of the chosen points. */
static inline bool simplify_in_strip(const struct simplify_check *c)
{
	return c->border.fd >= 0;
}
/* Of a region in the strip: marks its vertices; whether a triangle of the strip is in the mesh, and may be not settled
 * (simplify_calm.c). */
int simplify_calm(struct simplify_check *, const struct cut_region *, struct err *err);
int simplify_in_mesh(struct simplify_check *, uint32_t triangle, bool *ret, struct err *err);
bool simplify_is_calm(const struct simplify_check *, uint32_t triangle);
/* Reads the points in the squares that were marked in the raster. */
int simplify_check_read(struct simplify_check *, struct err *err);
/* Tests the triangles of a region, adds points until none is too far, and notes the greatest error in `found`. */
int simplify_region(struct simplify_check *, const struct pipe_kernel *, const struct cut_region *, struct err *err);
/* A task of a later round (simplify_star.c). */
int simplify_stars(struct simplify_check *, uint32_t task, struct err *err);

#endif
