/* Files of lines made byte by byte, for the tests and as the first inputs of the fuzz targets. */
#ifndef LINES_MADE_H
#define LINES_MADE_H

#include "lines_case.h"

/* ---- Shapefile ---- */

/* Begins a .shp and its .shx. */
void lines_made_shape_begin(struct lines_case_bytes *shp, struct lines_case_bytes *shx, uint32_t type);
/* A record: the type, and if it has vertices one part of each of the counts, which a zero ends. Vertex i of the shape is i, 10 i,
 * i / 4; a ring ends at its first one. */
void lines_made_shape(struct lines_case_bytes *shp, struct lines_case_bytes *shx, uint32_t type, const uint32_t *count);
/* A .dbf with the fields NAME (8) and KIND_OF_LI (6); row i is deleted if deleted[i] is '*'. */
void lines_made_table(struct lines_case_bytes *dbf, const char *deleted, uint32_t rows);

/* ---- GeoPackage ---- */

/* A geometry of WKB: vertices i, 10 i, i / 4, m 9; a ring ends at its first one. `code` is as it stands in the file; a polygon
 * has one ring of `n`, a collection or multi-geometry none: its members follow. */
void lines_made_wkb(struct lines_case_bytes *, int big, uint32_t code, uint32_t n);
/* The head of GeoPackage in front of it. */
void lines_made_gpkg_head(struct lines_case_bytes *, unsigned flags);

struct lines_made_row {
	const char *kind; /* NULL */
	const uint8_t *geometry;
	size_t n; /* 0: NULL */
};
/* A file with the layer `breaks` (EPSG:25832) of these rows in the columns geom and sort, the empty layer `lakes` without a
 * system, and a view. SQL (NULL: none) is done at the end. */
void lines_made_gpkg(const char *path, const struct lines_made_row *rows, size_t n, const char *sql);

#endif
