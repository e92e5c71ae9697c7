/*
 * Elevation models: the triangles of a mesh to the pixels of a raster, and the raster to a GeoTIFF.
 *
 * Each pixel whose centre is in the mesh has the height of one triangle there, the nearest float32 to the exact one. So the
 * raster depends on the triangles alone, neither on their order nor on the memory. Memory does not grow with the raster, but
 * for 48 to 96 bytes a touched tile of 256 x 256 pixels.
 */
#ifndef DEM_H
#define DEM_H

#include "acut.h"
#include "decimal.h"

struct err;
struct outfile;

enum dem_kind {
	DEM_ELEVATION,
	DEM_SLOPE,      /* degrees, of the triangle */
	DEM_HILLSHADE,  /* whole numbers 0 to 255, light from 315 degrees, 45 high */
	DEM_DIFFERENCE, /* of the heights of two meshes (dem_difference) */
};

/* Where a ratio is meant, num / den. */
struct dem_options {
	enum dem_kind kind;
	struct decimal cell;           /* side of a pixel: cell * cell_num / cell_den units of the file */
	int64_t cell_num, cell_den;    /* below 2^31 */
	int64_t z_num, z_den;          /* heights are written times this; below 2^31 */
	double steep;                  /* units of x and y in one unit of z: for slopes */
	double less;                   /* of DEM_DIFFERENCE: each value is made less by this */
	const char *unit_xy, *unit_z;  /* names of units that are written ("metre"); NULL: unknown */
	bool z_converted;              /* the vertical system of the mesh is not that of the heights */
	int (*interrupted)(void *ctx); /* not 0: give up; called while the file is made; may be NULL */
	void *ctx;
	bool big;       /* BigTIFF also below 4 GiB, for tests */
	unsigned cache; /* tiles in memory; 0: DEM_CACHE */
};
enum { DEM_TILE = 256, DEM_CACHE = 40 };
#define DEM_TILES_MAX (1u << 17) /* that a raster may have: 8.6 thousand million pixels */

struct dem_tile {
	bool no_heights;
	uint64_t width, height;
	double box[4]; /* x1, y1, x2, y2 */
};

struct dem;
int dem_new(struct outfile *, struct dem **ret, struct err *err);
/* -ERR_USAGE: a cell that this lattice cannot have. */
int dem_head(struct dem *, const struct acut_mesh_head *, const struct dem_options *, struct err *err);
/* The same of this scale, before there is a head. */
int dem_check_cell(const char *scale_xy, const struct dem_options *, struct err *err);
/* Polygons in place of a window, after dem_head: pixels whose centres are in none of them have no value. Corners are absolute
 * lattice numbers times DEM_CLIP_PART. A shell begins a polygon, its holes follow. The head's box is that of the polygons;
 * triangles may reach out of it. */
enum { DEM_CLIP_PART = 256 };
int dem_clip_ring(struct dem *, bool shell, struct err *err);
int dem_clip_corner(struct dem *, int64_t x, int64_t y, struct err *err);
int dem_clip_end(struct dem *, struct err *err);
/* Adds a line to the description in the file (ImageDescription), before dem_finish. */
int dem_describe(struct dem *, const char *line, struct err *err);
/* Corners counter-clockwise, in the head's box. */
int dem_triangle(struct dem *, const int32_t a[3], const int32_t b[3], const int32_t c[3], struct err *err);
/* Of DEM_DIFFERENCE, in place of dem_triangle: pixels that both triangles own have how much b is higher than a. */
int dem_difference(struct dem *, const int32_t a[3][3], const int32_t b[3][3], struct err *err);
/* Writes the file; `box` is that of the vertices, NULL if there are none. */
int dem_finish(struct dem *, const int32_t box[6], struct err *err);
/* In place of dem_finish, of DEM_HILLSHADE or with colours: rows from the north, two bytes a pixel: grey, and 255, or 0 where
 * there is nothing.
 */
struct dem_frame {
	struct outfile *out; /* of the rows */
	uint64_t width, height;
	double side, left, top; /* of a pixel; the centre of the one in the north-west */
	unsigned epsg;          /* of the plane; 0: it has no number */
	const char *wkt;        /* likewise, as long as the model; NULL: none is known */
};
struct dem_rows {
	int (*begin)(void *ctx, const struct dem_frame *, struct err *err);
	int (*row)(void *ctx, const uint8_t *grey, struct err *err);
	int (*end)(void *ctx, struct err *err);
	void *ctx;
	/* Of a pixel that has something; then rows have four bytes a pixel, red, green, blue and 255, or zeros. May be NULL. */
	void (*color)(void *ctx, float value, uint8_t ret[3]);
};
enum { DEM_ROW_MOST = 32768 }; /* pixels; -ERR_USAGE beyond */
int dem_finish_rows(struct dem *, const int32_t box[6], const struct dem_rows *, struct err *err);
/* The files of a raster in tiles: squares of p / q lattice units, from the multiples of it. A tile has the pixels whose centres
 * are in it, those on its left and lower border included, also where it has no heights for them; it is aligned to the pixels, and
 * together tiles are the whole. `begin` opens the output of tile `at`, whose numbers are absolute; `end` gets it back, complete,
 * or with no_heights empty: there is no such tile. In the order of rows and columns. */
struct dem_tiler {
	uint64_t p, q;
	unsigned most; /* tiles */
	int (*begin)(void *ctx, const int64_t at[2], struct outfile **ret, struct err *err);
	int (*end)(void *ctx, const int64_t at[2], struct outfile *, const struct dem_tile *, struct err *err);
	void *ctx;
	const struct dem_rows *rows; /* NULL: GeoTIFF */
};
/* In place of dem_finish. */
int dem_finish_tiles(struct dem *, const struct dem_tiler *, struct err *err);
void dem_tiled(struct dem *); /* before dem_head: dem_finish_tiles will come, so the whole may have any size */
struct dem *dem_free(struct dem *);

#endif
