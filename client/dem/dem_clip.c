/*
 * The polygons of a window, or of dem_clip_ring: a raster has the pixels whose centres are in them.
 *
 * The text of a view has their corners as absolute lattice numbers, dem_clip_corner as parts of them. They become places, or
 * parts of these, in which centres are whole numbers, so that the test is exact. A centre on a border belongs to the area to its
 * east, and on a border that runs from west to east to the one to its south, as with edges of triangles: of windows side by side
 * to one. base/area.h has greater y in place of the south, so y is negated here.
 *
 * A tile is cut when it is complete: a square that no border meets is inside or outside as a whole, and another one is quartered.
 */
#include <math.h>
#include <string.h>

#include "area.h"
#include "area_code.h"
#include "dem_priv.h"
#include "err.h"

static bool place_of(const struct dem_grid *g, int axis, dem_i128 number, int64_t *ret)
{
	dem_i128 zero = ((dem_i128)g->zero[axis] + g->base[axis]) * g->part;
	dem_i128 at = 2 * (dem_i128)g->q * (number - zero) + (dem_i128)g->off[axis] * g->part;

	*ret = (int64_t)(axis ? -at : at);
	return at <= AREA_MOST && at >= -AREA_MOST;
}

static int too_far(struct err *err)
{
	err_set(err, ERR_USAGE, "the polygon reaches too far out for pixels of this size");
	return err_add_hint(err, "give a polygon that ends nearer to the survey, or a --cell with fewer digits");
}

static int add_corner(struct dem_grid *g, const dem_i128 at[2], int64_t box[4], bool first, struct err *err)
{
	int64_t x, y;

	if (!place_of(g, 0, at[0], &x) || !place_of(g, 1, at[1], &y))
		return too_far(err);
	for (int i = 0; i < 2; i++) {
		box[i] = first || at[i] < box[i] ? (int64_t)at[i] : box[i];
		box[2 + i] = first || at[i] > box[2 + i] ? (int64_t)at[i] : box[2 + i];
	}
	return area_corner(g->polygon, x, y, err);
}

int dem_clip_init(struct dem_grid *g, const char *text, int64_t ret_box[4], struct err *err)
{
	const char *end = text + strcspn(text, " ");
	dem_i128 at[2] = {0, 0}, step[2];
	bool first = true;
	int r = 0;

	g->polygon = area_new(AREA_HALF_OPEN);
	if (!g->polygon)
		return err_set(err, ERR_NOMEM, "no memory for a polygon");
	while (text < end && !r) {
		if (*text == '+' || *text == '-') {
			r = area_ring(g->polygon, *text++ == '+', err);
			continue;
		}
		if (!area_code_get(&text, end, &step[0]) || !area_code_get(&text, end, &step[1]))
			return err_set(err, ERR_PROTO, "the window of the stream's view is none");
		at[0] += step[0];
		at[1] += step[1];
		if (at[0] > INT64_MAX / 4 || at[0] < INT64_MIN / 4 || at[1] > INT64_MAX / 4 || at[1] < INT64_MIN / 4)
			return err_set(err, ERR_PROTO, "the window of the stream's view is none");
		r = add_corner(g, at, ret_box, first, err);
		first = false;
	}
	if (!r && first)
		return err_set(err, ERR_PROTO, "the window of the stream's view is none");
	return r ? r : area_end(g->polygon, err);
}

int dem_clip_ring(struct dem *d, bool shell, struct err *err)
{
	struct dem_grid *g = &d->grid;

	if (!g->polygon) {
		g->polygon = area_new(AREA_HALF_OPEN);
		if (!g->polygon)
			return err_set(err, ERR_NOMEM, "no memory for a polygon");
		g->part = DEM_CLIP_PART;
		for (int i = 0; i < 2; i++) /* centres are within, too */
			if (2 * (dem_i128)g->p * (g->count[i] + 1) * g->part > AREA_MOST)
				return too_far(err);
	}
	return area_ring(g->polygon, shell, err);
}

int dem_clip_corner(struct dem *d, int64_t x, int64_t y, struct err *err)
{
	const dem_i128 at[2] = {x, y};
	int r = add_corner(&d->grid, at, d->clip_box, !d->clipped, err);

	d->clipped = true;
	return r;
}

int dem_clip_end(struct dem *d, struct err *err)
{
	if (d->clipped)
		dem_grid_clip(&d->grid, d->clip_box);
	return d->grid.polygon ? area_end(d->grid.polygon, err) : 0;
}

/* Of a pixel; of one that is further out than any height the next one. */
static int64_t centre(const struct dem_grid *g, int axis, int64_t pixel)
{
	pixel = pixel < -1 ? -1 : pixel > g->count[axis] ? g->count[axis] : pixel;
	return 2 * g->p * pixel * g->part;
}

/* A square of pixels from local x and y, y from the south and going down. */
static void cut(const struct dem_grid *g, int64_t x, int64_t y, int64_t size, float *pixel)
{
	const int64_t box[4] = {centre(g, 0, x), -centre(g, 1, y), centre(g, 0, x + size - 1), -centre(g, 1, y - size + 1)};
	enum area_side side = area_box(g->polygon, box);

	if (side == AREA_MIXED && size == 1)
		side = area_has(g->polygon, box[0], box[1]) ? AREA_IN : AREA_OUT;
	if (side == AREA_MIXED)
		for (int64_t i = 0; i < 4; i++) {
			int64_t right = i & 1 ? size / 2 : 0, down = i & 2 ? size / 2 : 0;

			cut(g, x + right, y - down, size / 2, pixel + down * DEM_TILE + right);
		}
	for (int64_t i = 0; i < size && side == AREA_OUT; i++)
		for (int64_t k = 0; k < size; k++)
			pixel[i * DEM_TILE + k] = NAN;
}

void dem_clip_tile(const struct dem_grid *g, int64_t x, int64_t row, float *tile)
{
	if (g->polygon)
		cut(g, x, g->count[1] - 1 - row, DEM_TILE, tile);
}
