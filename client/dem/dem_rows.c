/*
 * A hillshade as rows of grey, or colours, for pictures. Tiles of a row of them are read once, into a band of 256 rows.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "dem_priv.h"
#include "err.h"

/* One tile of the band, `w` pixels wide and `h` high, at column x of it. Whether there is something in it. */
static bool put_tile(const struct dem_rows *rows, const float *tile, uint8_t *band, uint64_t width, uint64_t x, uint64_t w,
		     uint64_t h)
{
	bool any = false;

	for (uint64_t y = 0; y < h && rows->color; y++)
		for (uint64_t i = 0; i < w; i++) {
			float v = tile[y * DEM_TILE + i];
			uint8_t *to = band + 4 * (y * width + x + i);

			memset(to, 0, 4);
			if (!isnan(v)) {
				rows->color(rows->ctx, v, to);
				to[3] = 255;
				any = true;
			}
		}
	if (rows->color)
		return any;

	for (uint64_t y = 0; y < h; y++)
		for (uint64_t i = 0; i < w; i++) {
			float v = tile[y * DEM_TILE + i];
			uint8_t *to = band + 2 * (y * width + x + i);

			to[0] = isnan(v) ? 0 : (uint8_t)v;
			to[1] = isnan(v) ? 0 : 255;
			any |= !isnan(v);
		}
	return any;
}

/* The rows from `from` on, from the north of the rectangle. */
static int read_band(struct dem *d, const struct dem_rect *rect, const struct dem_rows *rows, uint64_t from, uint64_t h,
		     float *tile, uint8_t *band, bool *ret_any, struct err *err)
{
	int64_t row = d->grid.count[1] - rect->y - (int64_t)rect->h + (int64_t)from;
	bool any;

	for (uint64_t x = 0; x < rect->w; x += DEM_TILE) {
		uint64_t w = rect->w - x < DEM_TILE ? rect->w - x : DEM_TILE;

		if (dem_store_read(d->store, rect->x + (int64_t)x, row, w, h, tile, &any, err))
			return -(int)err->code;
		if (any)
			dem_clip_tile(&d->grid, rect->x + (int64_t)x, row, tile);
		*ret_any |= put_tile(rows, tile, band, rect->w, x, w, h);
	}
	return d->opt.interrupted && d->opt.interrupted(d->opt.ctx) ? err_set(err, ERR_CANCELLED, "interrupted") : 0;
}

static int put_rows(struct dem *d, const struct dem_rect *rect, float *tile, uint8_t *band, const struct dem_rows *to,
		    bool *ret_any, struct err *err)
{
	int r = 0;

	for (uint64_t y = 0; y < rect->h && !r; y += DEM_TILE) {
		uint64_t h = rect->h - y < DEM_TILE ? rect->h - y : DEM_TILE;

		r = read_band(d, rect, to, y, h, tile, band, ret_any, err);
		for (uint64_t i = 0; i < h && !r; i++)
			r = to->row(to->ctx, band + (to->color ? 4 : 2) * i * rect->w, err);
	}
	return r;
}

int dem_rows_write(struct dem *d, const struct dem_rect *rect, const struct dem_rows *to, bool *ret_any, struct err *err)
{
	struct dem_frame frame = {.out = d->out,
				  .width = rect->w,
				  .height = rect->h,
				  .side = dem_grid_side(&d->grid),
				  .epsg = dem_keys_epsg(d),
				  .wkt = dem_keys_wkt(d)};
	float *tile;
	uint8_t *band;
	int r;

	*ret_any = false;
	if (rect->w > (to->color ? DEM_ROW_MOST / 2 : DEM_ROW_MOST)) {
		err_set(err, ERR_USAGE, "the picture would be %llu pixels wide, and at most %d are written",
			(unsigned long long)rect->w, to->color ? DEM_ROW_MOST / 2 : DEM_ROW_MOST);
		return err_add_hint(err, "give a larger --cell, or write tif");
	}
	frame.left = dem_grid_centre(&d->grid, 0, rect->x);
	frame.top = dem_grid_centre(&d->grid, 1, rect->y + (int64_t)rect->h - 1);
	tile = malloc((size_t)DEM_TILE * DEM_TILE * sizeof(*tile));
	band = malloc((size_t)rect->w * (to->color ? 4 : 2) * DEM_TILE);
	r = tile && band ? to->begin(to->ctx, &frame, err) : err_set(err, ERR_NOMEM, "no memory for the rows of a raster");
	if (!r)
		r = put_rows(d, rect, tile, band, to, ret_any, err);
	if (!r)
		r = to->end(to->ctx, err);
	free(tile);
	free(band);
	return r;
}

int dem_finish_rows(struct dem *d, const int32_t box[6], const struct dem_rows *to, struct err *err)
{
	struct dem_rect rect = dem_grid_rect(&d->grid, box);
	int r = dem_check_size(d, &rect, err);
	bool any;

	return r ? r : dem_rows_write(d, &rect, to, &any, err);
}
