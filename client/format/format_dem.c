/* Options of elevation models in units of the file (format_dem.h). */
#include "format_dem.h"

#include <string.h>

#include "err.h"
#include "format_axis.h"

/* Metres of a unit; 0: unknown. A degree is one of the equator: good enough to look at slopes, never to measure. */
static double metres_of(const char *unit)
{
	int64_t num, den;

	if (unit && !strcmp(unit, "degree"))
		return 111320;
	return format_unit_ratio(unit, "metre", &num, &den) ? (double)num / (double)den : 0;
}

double format_dem_steep(const struct acut_mesh_head *head, double height)
{
	double xy = metres_of(head->unit_xy), z = metres_of(head->unit_z);

	if (xy > 1000 && z <= 0)
		return height / xy;
	return xy > 0 && z > 0 ? height * (z / xy) : height;
}

int format_dem_block(struct dem *dem, const struct format_block *block, struct err *err)
{
	const struct acut_mesh_block *b = block->mesh;
	int r = 0;

	for (uint32_t i = 0; i < b->ntriangle && !r; i++) {
		const uint32_t *t = b->triangle[i];

		r = dem_triangle(dem, block->position[t[0]], block->position[t[1]], block->position[t[2]], err);
	}
	return r;
}

int format_dem_options(const struct format_options *opt, const struct acut_mesh_head *head, enum dem_kind kind,
		       struct dem_options *to, struct err *err)
{
	int r;

	*to = (struct dem_options){
		.kind = kind,
		.cell = opt->cell,
		.cell_num = 1,
		.cell_den = 1,
		.z_num = 1,
		.z_den = 1,
		.steep = format_dem_steep(head, 1),
		.unit_xy = head->unit_xy,
		.unit_z = head->unit_z,
		.cache = opt->rasters > 1 ? (opt->rasters < DEM_CACHE / 2 ? DEM_CACHE / opt->rasters : 2) : 0,
		.interrupted = opt->interrupted,
		.ctx = opt->ctx,
	};
	r = format_unit_xy("cell", opt->cell_unit, head->unit_xy, &to->cell_num, &to->cell_den, err);
	if (!r && opt->z_unit) {
		r = format_unit_z(head->unit_z, opt->z_unit, &to->z_num, &to->z_den, err);
		to->unit_z = opt->z_unit;
		to->z_converted = to->z_num != to->z_den;
	}
	return r;
}
