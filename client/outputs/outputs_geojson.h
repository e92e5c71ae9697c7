/* GeoJSON that the indexes of tiles and changes share. Coordinates are in the plane of the dataset, so the system is named:
 * in the old member "crs" if it has an EPSG number, which readers of files look for. */
#ifndef OUTPUTS_GEOJSON_H
#define OUTPUTS_GEOJSON_H

#include <stdio.h>

#include "outputs_priv.h"

/* Text is printed into memory, a page at a time, and written to the output at the end of the page. */
struct outputs_page {
	FILE *f;
	char *text;
	size_t size;
};
int outputs_page_start(struct outputs_page *, struct err *err);
int outputs_page_end(struct outputs_page *, struct outfile *to, struct err *err); /* frees, also on failure */

void outputs_geojson_text(FILE *, const char *text); /* quoted; null if it is NULL or "" */
void outputs_geojson_crs(FILE *, const char *crs);   /* the member and its comma, or nothing */
/* "lattice":..., "crs":..., "units":[...] */
void outputs_geojson_head(FILE *, const struct acut_mesh_head *, const struct format_options *);
void outputs_geojson_origin(FILE *, const struct acut_mesh_head *, const struct format_options *); /* ,"origin":... */
/* "left_out":number of triangles,"left_out_by":{"max_edge":{"triangles":...,"area":...},...} */
void outputs_geojson_left_out(FILE *, const struct outputs_report *);
/* A closed ring of a Polygon: corners as texts. */
void outputs_geojson_square(FILE *, const char *x0, const char *y0, const char *x1, const char *y1);

#endif
