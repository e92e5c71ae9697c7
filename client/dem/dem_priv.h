/* Shared by the files of this room: lattice to pixels (dem_grid.c), windows (dem_clip.c), triangles to pixels (dem_raster.c),
 * heights (dem_plane.c, dem_big.c), tiles in memory and on the disk (dem_store.c), levels (dem_level.c), the file (dem_tiff.c,
 * dem_keys.c). */
#ifndef DEM_PRIV_H
#define DEM_PRIV_H

#include "dem.h"

struct area;
typedef __int128 dem_i128;

/* ---- numbers: dem_big.c ---- */

enum { DEM_LIMBS = 16 };
/* |value| below 2^1024; an overflow is an assertion. */
struct dem_big {
	bool negative;
	uint64_t limb[DEM_LIMBS];
};
struct dem_big dem_big_of(dem_i128);
void dem_big_times(struct dem_big *, uint64_t);
void dem_big_ten(struct dem_big *, int power); /* times 10^power, power >= 0 */
void dem_big_shift(struct dem_big *, unsigned bits);
struct dem_big dem_big_sum(const struct dem_big *, const struct dem_big *);
int dem_big_compare(const struct dem_big *, const struct dem_big *); /* -1, 0, 1 */
/* The nearest double of n * ten^power / d; d > 0. */
double dem_big_double(dem_i128 n, int power, uint64_t d);

/* ---- the lattice and the pixels: dem_grid.c ---- */

/* A pixel's side is p / q lattice units. Numbers are made whole by 2q: those of the lattice times 2q, so that pixel i has its
 * centre at (2i + 1) p. `place` counts from the centre of local pixel 0, the south-west one of the box that was announced. */
struct dem_grid {
	int64_t p, q;
	int32_t base[2]; /* the box's least lattice numbers */
	int64_t off[2];  /* their places */
	int64_t first[2], count[2];
	int64_t clip[2][2];   /* local pixels that are drawn, from and to, both included */
	int64_t zero[2];      /* lattice number 0, absolute */
	struct area *polygon; /* in parts of places, y negated; NULL: there is none */
	int64_t part;         /* of a place */
	struct decimal scale;
};
int dem_grid_init(struct dem_grid *, const struct acut_mesh_head *, const struct dem_options *, struct err *err);
/* Of the head's pixels only those whose centres are in a box of parts of absolute lattice numbers. */
void dem_grid_clip(struct dem_grid *, const int64_t box[4]);
static inline int64_t dem_place(const struct dem_grid *g, int axis, int32_t number)
{
	return 2 * g->q * ((int64_t)number - g->base[axis]) + g->off[axis];
}
struct dem_rect {
	int64_t x, y; /* local pixels from the south-west */
	uint64_t w, h;
};
/* The pixels that `box` has a part of, clipped; one pixel if there are none. */
struct dem_rect dem_grid_rect(const struct dem_grid *, const int32_t box[6]);
double dem_grid_side(const struct dem_grid *);
double dem_grid_centre(const struct dem_grid *, int axis, int64_t local); /* coordinate of the centre of a local pixel */
double dem_grid_line(const struct dem_grid *, int axis, int64_t local);   /* coordinate of the low border of a local pixel */

/* Rounded down and up; d > 0. Quotients of more than 62 bits are cut to them. */
static inline int64_t dem_div_down(dem_i128 n, dem_i128 d)
{
	const dem_i128 most = (dem_i128)1 << 62;
	dem_i128 r;

	if ((int64_t)n == n && (int64_t)d == d) {
		int64_t a = (int64_t)n, b = (int64_t)d, c = a / b;
		return c - (a % b < 0);
	}
	r = n / d;
	r -= r * d > n;
	return (int64_t)(r < -most ? -most : r > most ? most : r);
}
static inline int64_t dem_div_up(dem_i128 n, dem_i128 d)
{
	return -dem_div_down(-n, d);
}

/* ---- the polygons of a window: dem_clip.c ---- */

/* Of the text of an area; *ret_box has its bounds, absolute lattice numbers. */
int dem_clip_init(struct dem_grid *, const char *text, int64_t ret_box[4], struct err *err);
/* Pixels outside become NAN; x counts from the west, row from the north of the announced box. */
void dem_clip_tile(const struct dem_grid *, int64_t x, int64_t row, float *tile);

/* ---- heights: dem_plane.c ---- */

struct dem_scale {
	struct decimal z;
	int64_t k, num, den; /* height = (Z + k) * z * num / den */
	double factor;
};
struct dem_corner {
	int64_t x, y;      /* places */
	const int32_t *at; /* lattice numbers */
};
struct dem_plane {
	const struct dem_scale *scale;
	int64_t step; /* places a pixel */
	struct dem_corner a;
	dem_i128 east, north; /* gradients: times area a place of 1 / 2q */
	dem_i128 area;        /* twice the triangle's, lattice units */
	int64_t q2;           /* 2q */
	int64_t x0, y0;       /* the pixel that the doubles count from */
	double at, dx, dy;    /* height there, and of one pixel more */
	double slack;         /* the most that they are wrong anywhere in the triangle */
};
void dem_plane_init(struct dem_plane *, const struct dem_scale *, const struct dem_grid *, const struct dem_corner corner[3],
		    dem_i128 area, int64_t x0, int64_t y0);
/* The nearest float32 to the exact heights of n pixels of a row. */
void dem_plane_row(const struct dem_plane *, int64_t x, int64_t y, uint32_t n, float *ret);
/* dz / dx and dz / dy, lattice units. */
void dem_plane_gradient(const struct dem_plane *, double ret[2]);

/* ---- tiles: dem_store.c ---- */

struct dem_store;
int dem_store_new(const struct outfile *beside, unsigned cache, struct dem_store **ret, struct err *err);
/* A tile of DEM_TILE rows, valid until the next call. One that is not there is made, all NAN, or with `look` *ret is NULL. */
int dem_store_tile(struct dem_store *, uint32_t column, uint32_t row, bool look, float **ret, struct err *err);
/* The pixels from (x, y) on into a tile; those at `w` and `h` and further are NAN. *ret_any: some are not. */
int dem_store_read(struct dem_store *, int64_t x, int64_t y, uint64_t w, uint64_t h, float *tile, bool *ret_any, struct err *err);
/* The numbers of all tiles that were asked for, row << 32 | column, to be freed. -ERR_NOMEM. */
int dem_store_list(const struct dem_store *, uint64_t **ret, size_t *ret_n, struct err *err);
struct dem_store *dem_store_free(struct dem_store *);

/* ---- triangles to pixels: dem_raster.c ---- */

struct dem {
	struct outfile *out;
	struct dem_options opt;
	struct dem_grid grid;
	struct dem_scale scale;
	bool tiled, clipped;
	int64_t clip_box[4]; /* of the corners of dem_clip_corner */
	double steep;        /* slopes of lattice numbers times this are slopes */
	char crs[512], unit_xy[32], unit_z[32];
	char *wkt;               /* of its system; NULL: none */
	char *description;       /* lines; NULL: none */
	int64_t from[2], to[2];  /* of the pixels that triangles met; from is above to at first */
	struct dem_store *store; /* rows from the north of the announced box */
};
int dem_too_many(const struct dem *, struct err *err);
/* -ERR_USAGE with a cell that fits: a raster of these pixels has too many tiles. */
int dem_check_size(const struct dem *, const struct dem_rect *, struct err *err);

/* ---- levels of the pyramid, from the whole raster to one tile: dem_level.c ---- */

struct dem_level {
	uint32_t w, h, columns, rows;
	uint64_t size;    /* of all its tiles */
	uint64_t *offset; /* of tiles, in `data`; UINT64_MAX: it has no pixels */
	uint32_t *bytes;
	struct outfile *data;
};
enum { DEM_LEVELS = 32 };
struct dem_pyramid {
	struct dem_level level[DEM_LEVELS];
	unsigned n;
};
/* Takes the store, but of a raster in tiles. */
int dem_pyramid_make(struct dem_pyramid *, struct dem *, const struct dem_rect *, struct err *err);
void dem_pyramid_done(struct dem_pyramid *);

/* ---- the file ---- */

#define DEM_NODATA (-9999.0f)
#define DEM_NODATA_TEXT "-9999"
enum { DEM_KEYS = 16, DEM_CITATION = 4096 };
struct dem_keys {
	uint16_t key[4 * DEM_KEYS]; /* the directory, its header first */
	unsigned n;                 /* numbers of it */
	char text[DEM_CITATION];    /* that of all citations, each with its "|" */
};
unsigned dem_keys_epsg(const struct dem *);                /* of the plane; 0: none */
const char *dem_keys_wkt(const struct dem *);              /* NULL: none, or it speaks of heights, too */
void dem_keys_make(struct dem_keys *, const struct dem *); /* dem_keys.c */
int dem_tiff_write(const struct dem *, const struct dem_pyramid *, const struct dem_rect *, struct err *err);

/* ---- rows of grey: dem_rows.c ---- */

/* To d->out. *ret_any: a pixel has something. */
int dem_rows_write(struct dem *, const struct dem_rect *, const struct dem_rows *, bool *ret_any, struct err *err);

#endif
