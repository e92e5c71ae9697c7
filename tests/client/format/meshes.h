/* Made-up mesh streams: a grid of points, two triangles a square, cut into blocks of whole rows. */
#ifndef MESHES_H
#define MESHES_H

#include "outputs.h"

struct meshes {
	struct acut_mesh_head head;
	struct acut_mesh_tail tail;
	struct acut_mesh_block *block;
	size_t nblock;
	uint32_t columns, rows; /* of points; 0: no points at all */
};

struct meshes_spec {
	uint32_t columns, rows; /* of points */
	uint32_t strip;         /* rows of squares in a block */
	int32_t x0, y0, step;
	int32_t slope_x, slope_y; /* z = slope_x * column + slope_y * row */
	uint32_t shuffle;         /* numbers the rows from the top if set */
	const char *scale_xy, *scale_z;
	int64_t k[3];
};

extern const struct meshes_spec meshes_many; /* several blocks, of several rows each */

/* What a format needs to take all of these: those of 32-bit floats an origin. */
struct format_options meshes_options(const struct format *);
void meshes_make(struct meshes *, const struct meshes_spec *);
/* Block i, with the positions of all its vertices, as libacut gives it. */
int meshes_block(const struct meshes *, const struct acut_mesh_sink *, size_t i);
/* Head, the first `nblock` blocks, and the tail if that is all of them; what the sink answered. */
int meshes_send(const struct meshes *, const struct acut_mesh_sink *, size_t nblock);
/* Writes it as one output, and publishes it; 0, or what failed. `report` may be NULL. */
int meshes_write(const struct meshes *, const char *path, const struct format *, const struct format_options *,
		 const struct outputs_options *, struct outputs_report *report, struct err *);
void meshes_done(struct meshes *);

#endif
