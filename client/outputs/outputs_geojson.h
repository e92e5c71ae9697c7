/* Pieces of GeoJSON that the indexes of this room share: tiles and changes. Coordinates are of the dataset's own plane, so
 * the system is named: in the old member "crs" where it has an EPSG number, which is what readers of files look for. */
#ifndef OUTPUTS_GEOJSON_H
#define OUTPUTS_GEOJSON_H

#include <stdio.h>

#include "outputs_priv.h"

/* Text is written by stdio into memory, a piece at a time, and goes to the output at the end of the piece. */
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
/* A closed ring of a Polygon: corners as texts. */
void outputs_geojson_square(FILE *, const char *x0, const char *y0, const char *x1, const char *y1);

#endif
