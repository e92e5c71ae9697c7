/* The kernel's triangles become a finished domain, in place, in four steps. The steps are separate so that a caller can
 * time them, or choose the triangles itself. */
#ifndef FINISH_H
#define FINISH_H

#include <stdbool.h>
#include <stdint.h>

#include "cut.h"
#include "mesh.h"
#include "tri.h"
#include "view.h"

/* Marks of a vertex while triangles are chosen, one byte each, in the memory of the kernel's ids: it is a corner of a
 * chosen triangle; it is a corner of another triangle or of a ghost. */
enum { FINISH_USED = 1, FINISH_OPEN = 2 };

struct finish {
	const struct cut_region *region;
	int64_t k[3];
	const struct view_map *map; /* positions were mapped, and are mapped back; NULL: they were not */
	struct tri_result tri;
	bool chosen; /* finish_chosen chose the triangles */
	bool edges;  /* a side of one is a piece of a line */
	struct mesh_domain out;
};

/* After tri_run, in this order. Each step adds to `out`: */
void finish_init(struct finish *, const struct cut_region *, const int64_t k[3], const struct tri *);
/* For a view that may have a map (view_bind_map): vertices, box and digests are of the positions before they were mapped; the
 * region, and counts.most, are of the mapped ones. */
void finish_map(struct finish *, const struct view *);
void finish_owned(struct finish *); /* the region's triangles, their digest, the marks of vertices */
/* Or instead: the triangles whose bits are set in `chosen`, and if `special` is not NULL the region's triangles whose bits are
 * not set there. A vertex may then be closed in the domain of another region. */
struct finish_choice {
	const uint64_t *chosen, *special;
};
void finish_chosen(struct finish *, const struct finish_choice *);
bool finish_vertices(struct finish *); /* vertices, box, digest of the closed ones. False: they do not fit */
void finish_numbers(struct finish *);  /* local numbers in the triangles, links of open vertices */

/* Instead of the steps, if tri_run found the positions flat: own_digest and nhull. */
void finish_flat(struct finish *);

/* A position of the kernel as the mesh has it. */
static inline void finish_position(const struct finish *f, const int32_t at[2], int32_t ret[2])
{
	if (f->map) {
		view_map_back(f->map, at, ret);
		return;
	}
	ret[0] = at[0];
	ret[1] = at[1];
}
static inline uint64_t finish_place(const struct finish *f, const int32_t at[2])
{
	int32_t xy[2];

	if (!f->map)
		return digest_place_of(at);
	view_map_back(f->map, at, xy);
	return digest_place_of(xy);
}

#endif
