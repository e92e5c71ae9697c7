/* Of formats that the room dem draws: its options, out of those of the output and the head of the stream. */
#ifndef FORMAT_DEM_H
#define FORMAT_DEM_H

#include "dem.h"
#include "format.h"

/* -ERR_USAGE: --cell or --z-unit is in a unit that cannot be converted. */
int format_dem_options(const struct format_options *, const struct acut_mesh_head *, enum dem_kind, struct dem_options *ret,
		       struct err *err);

int format_dem_block(struct dem *, const struct format_block *, struct err *err);
/* A height in units of x and y, for slopes; unknown units count as equal, but beside degrees heights as metres. */
double format_dem_steep(const struct acut_mesh_head *, double height);

#endif
