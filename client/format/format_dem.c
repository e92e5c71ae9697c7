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

double format_dem_steep(const struct acut_mesh_head *head)
{
	double xy = metres_of(head->unit_xy), z = metres_of(head->unit_z);

	if (xy > 1000 && z <= 0)
		return 1 / xy;
	return xy > 0 && z > 0 ? z / xy : 1;
}

static int cell_units(const struct format_options *opt, const struct acut_mesh_head *head, struct dem_options *to,
		      struct err *err)
{
	if (!opt->cell_unit || format_unit_ratio(opt->cell_unit, head->unit_xy, &to->cell_num, &to->cell_den))
		return 0;
	err_set(err, ERR_USAGE, "--cell is in %s, but the unit of x and y is %.30s", opt->cell_unit,
		head->unit_xy && *head->unit_xy ? head->unit_xy : "unknown");
	return err_add_hint(err, head->unit_xy && !strcmp(head->unit_xy, "degree") ?
					 "give a bare number of degrees" :
					 "give a bare number in the units of the files, or stage the inputs with --assume-units");
}

static int z_units(const struct format_options *opt, const struct acut_mesh_head *head, struct dem_options *to, struct err *err)
{
	if (!opt->z_unit)
		return 0;
	if (!format_unit_ratio(head->unit_z, opt->z_unit, &to->z_num, &to->z_den)) {
		err_set(err, ERR_USAGE, "--z-unit cannot convert heights: the unit of z is %.30s",
			head->unit_z && *head->unit_z ? head->unit_z : "unknown");
		return err_add_hint(err, "stage the inputs with --assume-units ,m or ,ft or ,ftUS, for inputs without units");
	}
	to->unit_z = opt->z_unit;
	to->z_converted = to->z_num != to->z_den;
	return 0;
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
		.steep = format_dem_steep(head),
		.unit_xy = head->unit_xy,
		.unit_z = head->unit_z,
		.cache = opt->rasters > 1 ? (opt->rasters < DEM_CACHE / 2 ? DEM_CACHE / opt->rasters : 2) : 0,
		.interrupted = opt->interrupted,
		.ctx = opt->ctx,
	};
	r = cell_units(opt, head, to, err);
	return r ? r : z_units(opt, head, to, err);
}
