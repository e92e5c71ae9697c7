/*
 * A raster as a folder of files: each has the pixels of one square.
 *
 * A pixel belongs to the square that has its centre. The side of a pixel over that of a square is a fraction in lowest terms, so
 * that is decided in whole numbers, whether squares are multiples of pixels or not. The whole raster is drawn first, as for one
 * file; only squares that meet a stored tile are looked at.
 */
#include <stdlib.h>

#include "dem_priv.h"
#include "err.h"
#include "wide.h"

/* A pixel over a square: a / b. */
struct tiling {
	dem_i128 a, b;
};

/* Rows first. */
struct at {
	int64_t y, x;
};

struct list {
	struct at *at;
	size_t n, room;
};

static int tiling_init(struct tiling *t, const struct dem_grid *g, const struct dem_tiler *tiler, struct err *err)
{
	dem_i128 first = wide_gcd(g->p, tiler->p), second = wide_gcd(tiler->q, (dem_i128)g->q);

	t->a = g->p / first * (tiler->q / second);
	t->b = tiler->p / first * (g->q / second);
	if (t->a > t->b) {
		err_set(err, ERR_USAGE, "--tile is less than --cell: a tile would have no pixel");
		return err_add_hint(err, "give a larger --tile");
	}
	if (t->b >> 70) {
		err_set(err, ERR_USAGE, "--tile has too many digits beside --cell");
		return err_add_hint(err, "give --tile with fewer decimals, or a multiple of --cell");
	}
	return 0;
}

/* The square with the centre of an absolute pixel, and the first pixel of a square. */
static int64_t square_of(const struct tiling *t, int64_t pixel)
{
	return (int64_t)wide_floor((2 * (dem_i128)pixel + 1) * t->a, 2 * t->b);
}
static int64_t first_pixel(const struct tiling *t, int64_t square)
{
	return (int64_t)-wide_floor(t->a - 2 * t->b * square, 2 * t->a);
}

/* ---- which squares ---- */

static int by_row(const void *a, const void *b)
{
	const struct at *p = a, *q = b;

	if (p->y != q->y)
		return p->y < q->y ? -1 : 1;
	return (p->x > q->x) - (p->x < q->x);
}

static void unique(struct list *l)
{
	size_t n = 0;

	if (l->n)
		qsort(l->at, l->n, sizeof(*l->at), by_row);
	for (size_t i = 0; i < l->n; i++)
		if (!n || by_row(&l->at[i], &l->at[n - 1]))
			l->at[n++] = l->at[i];
	l->n = n;
}

static int too_many(unsigned most, struct err *err)
{
	err_set(err, ERR_USAGE, "the pixels are in more than %u tiles", most);
	return err_add_hint(err, "give a larger --tile");
}

/* The squares of one stored tile. Some may turn out to have no heights, so there is room for twice as many as may be. */
static int add_squares(struct list *l, const struct dem_grid *g, const struct tiling *t, uint64_t number, unsigned most,
		       struct err *err)
{
	int64_t west = (int64_t)(uint32_t)number * DEM_TILE, north = g->count[1] - 1 - (int64_t)(number >> 32) * DEM_TILE;
	int64_t east = west + DEM_TILE - 1, south = north - (DEM_TILE - 1);
	int64_t last[2];

	east = east < g->count[0] ? east : g->count[0] - 1;
	south = south < 0 ? 0 : south;
	last[0] = square_of(t, g->first[0] + east);
	last[1] = square_of(t, g->first[1] + north);
	for (int64_t y = square_of(t, g->first[1] + south); y <= last[1]; y++)
		for (int64_t x = square_of(t, g->first[0] + west); x <= last[0]; x++) {
			if (l->n == l->room) {
				unique(l);
				if (l->n > 2 * (size_t)most)
					return too_many(most, err);
			}
			l->at[l->n++] = (struct at){y, x};
		}
	return 0;
}

static int find_squares(struct list *l, const struct dem *d, const struct tiling *t, unsigned most, struct err *err)
{
	uint64_t *stored;
	size_t n;
	int r = dem_store_list(d->store, &stored, &n, err);

	if (r)
		return r;
	*l = (struct list){.room = 4 * (size_t)most + 1};
	l->at = malloc(l->room * sizeof(*l->at));
	if (!l->at)
		r = err_set(err, ERR_NOMEM, "no memory for the tiles of a raster");
	for (size_t i = 0; i < n && !r; i++)
		r = add_squares(l, &d->grid, t, stored[i], most, err);
	free(stored);
	unique(l);
	return r ? r : l->n > 2 * (size_t)most ? too_many(most, err) : 0;
}

/* ---- one of them ---- */

static bool is_empty(const struct dem_level *l)
{
	for (uint64_t i = 0; i < (uint64_t)l->columns * l->rows; i++)
		if (l->offset[i] != UINT64_MAX)
			return false;
	return true;
}

static int check_size(const struct dem_rect *rect, struct err *err)
{
	uint64_t columns = (rect->w + DEM_TILE - 1) / DEM_TILE, rows = (rect->h + DEM_TILE - 1) / DEM_TILE;

	if (columns <= DEM_TILES_MAX && rows <= DEM_TILES_MAX && columns * rows <= DEM_TILES_MAX)
		return 0;
	err_set(err, ERR_USAGE, "a tile would have %llu x %llu pixels, and at most %llu million are written",
		(unsigned long long)rect->w, (unsigned long long)rect->h,
		(unsigned long long)DEM_TILES_MAX * DEM_TILE * DEM_TILE / 1000000);
	return err_add_hint(err, "give a smaller --tile, or a larger --cell");
}

static int write_tiff(struct dem *d, const struct dem_rect *rect, bool *ret_any, struct err *err)
{
	struct dem_pyramid p = {0};
	int r = dem_pyramid_make(&p, d, rect, err);

	*ret_any = !r && !is_empty(&p.level[0]);
	if (*ret_any)
		r = dem_tiff_write(d, &p, rect, err);
	dem_pyramid_done(&p);
	return r;
}

static int make_tile(struct dem *d, const struct tiling *t, const struct at *at, const struct dem_tiler *tiler, struct err *err)
{
	const int64_t number[2] = {at->x, at->y};
	int64_t from[2], to[2];
	struct dem_rect rect;
	struct dem_tile tile;
	struct outfile *mine = d->out;
	bool any;
	int r;

	for (int i = 0; i < 2; i++) {
		from[i] = first_pixel(t, number[i]) - d->grid.first[i];
		to[i] = first_pixel(t, number[i] + 1) - d->grid.first[i];
	}
	rect = (struct dem_rect){from[0], from[1], (uint64_t)(to[0] - from[0]), (uint64_t)(to[1] - from[1])};
	r = check_size(&rect, err);
	if (!r)
		r = tiler->begin(tiler->ctx, number, &d->out, err);
	if (r)
		return r;
	r = tiler->rows ? dem_rows_write(d, &rect, tiler->rows, &any, err) : write_tiff(d, &rect, &any, err);
	tile = (struct dem_tile){.no_heights = r || !any, .width = rect.w, .height = rect.h};
	for (int i = 0; i < 2; i++) {
		tile.box[i] = dem_grid_line(&d->grid, i, from[i]);
		tile.box[2 + i] = dem_grid_line(&d->grid, i, to[i]);
	}
	if (r) {
		struct err ignored = ERR_INIT;

		tiler->end(tiler->ctx, number, d->out, &tile, &ignored);
	} else {
		r = tiler->end(tiler->ctx, number, d->out, &tile, err);
	}
	d->out = mine;
	return r;
}

int dem_finish_tiles(struct dem *d, const struct dem_tiler *tiler, struct err *err)
{
	struct tiling t;
	struct list l = {.n = 0};
	int r = tiling_init(&t, &d->grid, tiler, err);

	if (!r)
		r = find_squares(&l, d, &t, tiler->most, err);
	for (size_t i = 0; i < l.n && !r; i++)
		r = make_tile(d, &t, &l.at[i], tiler, err);
	free(l.at);
	return r;
}
