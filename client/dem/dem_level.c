/*
 * The levels of the pyramid: the raster, then each time half as wide and high, until one tile has all.
 *
 * A pixel of a level is the mean of those of its four pixels below that have a height (in doubles, from the north-west by rows,
 * rounded once); it has none if no pixel below has. The tiles of a level are compressed into a file of their own, since in the
 * output the smallest level comes first. A tile without heights is not written.
 */
#include <libdeflate.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "dem_priv.h"
#include "err.h"
#include "outfile.h"

enum { PIXELS = DEM_TILE * DEM_TILE, HALF = DEM_TILE / 2, BYTES = PIXELS * 4, HIGHER_CACHE = 16, DEFLATE = 3 };

struct work {
	struct dem *dem;
	struct dem_pyramid *pyramid;
	struct dem_store *store, *higher; /* of this level and the next */
	uint64_t x, y;                    /* of this level in its store */
	struct libdeflate_compressor *deflate;
	size_t room;
	float pixel[PIXELS], half[HALF * HALF];
	uint8_t plane[BYTES], packed[];
};

/* TIFF's floating point predictor: the bytes of a row by their weight, then differences. */
static int predict(struct work *w, struct err *err)
{
	for (size_t y = 0; y < DEM_TILE; y++) {
		uint8_t *row = w->plane + y * DEM_TILE * 4;

		for (size_t x = 0; x < DEM_TILE; x++) {
			float v = w->pixel[y * DEM_TILE + x];
			uint32_t bits;

			if (v == DEM_NODATA) {
				err_set(err, ERR_USAGE, "a height is " DEM_NODATA_TEXT ", which stands for no height");
				return err_add_hint(err, "convert the heights with --z-unit, or leave the points out");
			}
			v = isnan(v) ? DEM_NODATA : v;
			memcpy(&bits, &v, sizeof(bits));
			for (int k = 0; k < 4; k++)
				row[DEM_TILE * k + x] = (uint8_t)(bits >> (24 - 8 * k));
		}
		for (size_t i = DEM_TILE * 4; --i;)
			row[i] = (uint8_t)(row[i] - row[i - 1]);
	}
	return 0;
}

static float mean(const float *north, const float *south)
{
	const float v[4] = {north[0], north[1], south[0], south[1]};
	double sum = 0;
	int n = 0;

	for (int i = 0; i < 4; i++) {
		if (!isnan(v[i])) {
			sum += v[i];
			n++;
		}
	}
	return n ? (float)(sum / n) : NAN;
}

/* The tile's quarter of one of the next level. */
static int put_half(struct work *w, uint32_t column, uint32_t row, struct err *err)
{
	float *to;
	int r = dem_store_tile(w->higher, column / 2, row / 2, false, &to, err);

	if (r)
		return r;
	to += (row % 2 * DEM_TILE + column % 2) * HALF;
	for (size_t y = 0; y < HALF; y++)
		for (size_t x = 0; x < HALF; x++)
			to[y * DEM_TILE + x] =
				mean(w->pixel + 2 * y * DEM_TILE + 2 * x, w->pixel + (2 * y + 1) * DEM_TILE + 2 * x);
	return 0;
}

static int put_tile(struct work *w, struct dem_level *l, uint32_t column, uint32_t row, struct err *err)
{
	uint64_t x = (uint64_t)column * DEM_TILE, y = (uint64_t)row * DEM_TILE;
	size_t i = (size_t)row * l->columns + column, n;
	bool any;
	int r = dem_store_read(w->store, w->x + x, w->y + y, l->w - x, l->h - y, w->pixel, &any, err);

	l->offset[i] = UINT64_MAX;
	l->bytes[i] = 0;
	for (size_t k = 0; k < PIXELS && any; k++)
		if (!isnan(w->pixel[k]))
			break;
		else if (k == PIXELS - 1)
			any = false;
	if (r || !any)
		return r;
	if (w->higher)
		r = put_half(w, column, row, err);
	if (!r)
		r = predict(w, err);
	if (r)
		return r;
	n = libdeflate_zlib_compress(w->deflate, w->plane, BYTES, w->packed, w->room);
	if (!n)
		return err_set(err, ERR_INTERNAL, "a tile cannot be compressed");
	l->offset[i] = l->size;
	l->bytes[i] = (uint32_t)n;
	l->size += n;
	return outfile_write(l->data, w->packed, n, err);
}

static int level_init(struct dem_level *l, const struct outfile *beside, struct err *err)
{
	size_t n;

	l->columns = (l->w + DEM_TILE - 1) / DEM_TILE;
	l->rows = (l->h + DEM_TILE - 1) / DEM_TILE;
	n = (size_t)l->columns * l->rows;
	l->offset = malloc(n * sizeof(*l->offset));
	l->bytes = malloc(n * sizeof(*l->bytes));
	if (!l->offset || !l->bytes)
		return err_set(err, ERR_NOMEM, "no memory for %zu tiles", n);
	return outfile_spool(beside, &l->data, err);
}

static int make_level(struct work *w, struct dem_level *l, struct err *err)
{
	int r = level_init(l, w->dem->out, err);

	if (!r && l->columns * (uint64_t)l->rows > 1)
		r = dem_store_new(w->dem->out, HIGHER_CACHE, &w->higher, err);
	for (uint32_t row = 0; row < l->rows && !r; row++)
		for (uint32_t column = 0; column < l->columns && !r; column++)
			r = put_tile(w, l, column, row, err);
	dem_store_free(w->store);
	w->store = w->higher;
	w->higher = NULL;
	w->x = w->y = 0;
	return r;
}

int dem_pyramid_make(struct dem_pyramid *p, struct dem *d, const struct dem_rect *rect, struct err *err)
{
	struct libdeflate_compressor *deflate = libdeflate_alloc_compressor(DEFLATE);
	size_t room = deflate ? libdeflate_zlib_compress_bound(deflate, BYTES) : 0;
	struct work *w = deflate ? malloc(sizeof(*w) + room) : NULL;
	uint32_t width = (uint32_t)rect->w, height = (uint32_t)rect->h;
	int r = 0;

	memset(p, 0, sizeof(*p));
	if (!w) {
		libdeflate_free_compressor(deflate);
		return err_set(err, ERR_NOMEM, "no memory to compress a raster");
	}
	w->dem = d;
	w->pyramid = p;
	w->store = d->store;
	w->higher = d->store = NULL;
	w->x = (uint64_t)rect->x;
	w->y = (uint64_t)d->grid.count[1] - (uint64_t)rect->y - rect->h;
	w->deflate = deflate;
	w->room = room;
	while (w->store && !r) {
		struct dem_level *l = &p->level[p->n++];

		l->w = width;
		l->h = height;
		r = make_level(w, l, err);
		width = (width + 1) / 2;
		height = (height + 1) / 2;
	}
	dem_store_free(w->store);
	libdeflate_free_compressor(deflate);
	free(w);
	return r;
}

void dem_pyramid_done(struct dem_pyramid *p)
{
	for (unsigned i = 0; i < p->n; i++) {
		free(p->level[i].offset);
		free(p->level[i].bytes);
		outfile_free(p->level[i].data);
	}
	memset(p, 0, sizeof(*p));
}
