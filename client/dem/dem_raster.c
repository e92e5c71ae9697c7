/*
 * Triangles to pixels.
 *
 * A pixel belongs to the triangle that holds its centre. A centre on an edge goes to one side, as if it were moved a little to
 * the east and, much less, to the south: so every centre in the mesh has exactly one triangle, also those on edges and vertices,
 * and one outside has none. The test is the sign of a whole number; the row of a triangle's pixels is found by one division an
 * edge.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "dem_priv.h"
#include "err.h"
#include "outfile.h"

#define DEGREES 57.29577951308232

/* E(x) = c - dy * x must be at least `least`, in pixels from the triangle's first column; c grows by `step` a row. */
struct edge {
	dem_i128 c, step, d;
	int dy; /* its sign */
};

static struct edge edge_of(const struct dem_grid *g, const struct dem_corner *a, const struct dem_corner *b, int64_t left,
			   int64_t low)
{
	int64_t dx = (int64_t)b->at[0] - a->at[0], dy = (int64_t)b->at[1] - a->at[1];
	int64_t ax = a->x - 2 * g->p * left, ay = a->y - 2 * g->p * low;
	int least = dy < 0 || (dy == 0 && dx < 0) ? 0 : 1;
	struct edge e = {.step = (dem_i128)dx * 2 * g->p, .dy = (dy > 0) - (dy < 0)};

	e.c = -(dem_i128)dx * ay + (dem_i128)dy * ax - least;
	e.d = (dem_i128)(dy < 0 ? -dy : dy) * 2 * g->p;
	return e;
}

static void narrow(const struct edge *e, int64_t *from, int64_t *to)
{
	int64_t x;

	if (!e->dy) {
		if (e->c < 0)
			*to = *from - 1;
	} else if (e->dy < 0) {
		x = dem_div_up(-e->c, e->d);
		*from = x > *from ? x : *from;
	} else {
		x = dem_div_down(e->c, e->d);
		*to = x < *to ? x : *to;
	}
}

static float slope_of(const struct dem *d, const struct dem_plane *f)
{
	double g[2], run;

	dem_plane_gradient(f, g);
	run = sqrt(g[0] * g[0] + g[1] * g[1]) * d->steep;
	if (d->opt.kind == DEM_SLOPE)
		return (float)(atan(run) * DEGREES);
	/* normal (-east, -north, 1); light (-1/2, 1/2, 1/sqrt 2) */
	run = (0.5 * (g[0] - g[1]) * d->steep + M_SQRT1_2) / sqrt(1 + run * run);
	return (float)rint(run < 0 ? 0 : 255 * run);
}

static void fill(float *to, float value, uint32_t n)
{
	for (uint32_t i = 0; i < n; i++)
		to[i] = value;
}

/* The rows of a triangle that are in one row of tiles: a tile is asked for once a band, however many rows it has. */
struct band {
	int64_t y; /* the first row */
	uint32_t n;
	int64_t least, most; /* of all rows */
	int64_t from[DEM_TILE], to[DEM_TILE];
};

static int64_t north_of(const struct dem *d, int64_t y)
{
	return d->grid.count[1] - 1 - y;
}

/* What pixels get: heights of a plane, the difference of two, or one value. */
struct paint {
	struct dem_plane f, other;
	float value;
	double less;
};

/* How much `other` is higher. */
static void difference_row(const struct paint *p, int64_t x, int64_t y, uint32_t n, float *ret)
{
	double at = p->other.at - p->f.at - p->less, dx = p->other.dx - p->f.dx;

	at += (p->other.dy - p->f.dy) * (double)(y - p->f.y0);
	for (uint32_t i = 0; i < n; i++)
		ret[i] = (float)(at + dx * (double)(x - p->f.x0 + i)) + 0.0f;
}

/* Draws what is gathered. */
static int band_put(struct dem *d, const struct paint *paint, struct band *b, struct err *err)
{
	for (int64_t column = b->least / DEM_TILE; b->n && column <= b->most / DEM_TILE; column++) {
		int64_t x0 = column * DEM_TILE, x1 = x0 + DEM_TILE - 1;
		float *tile;

		if (dem_store_tile(d->store, (uint32_t)column, (uint32_t)(north_of(d, b->y) / DEM_TILE), false, &tile, err))
			return dem_too_many(d, err);
		for (uint32_t i = 0; i < b->n; i++) {
			int64_t from = b->from[i] > x0 ? b->from[i] : x0, to = b->to[i] < x1 ? b->to[i] : x1, y = b->y + i;
			float *at = tile + north_of(d, y) % DEM_TILE * DEM_TILE + (from - x0);

			if (from > to)
				continue;
			if (d->opt.kind == DEM_ELEVATION)
				dem_plane_row(&paint->f, from, y, (uint32_t)(to - from) + 1, at);
			else if (d->opt.kind == DEM_DIFFERENCE)
				difference_row(paint, from, y, (uint32_t)(to - from) + 1, at);
			else
				fill(at, paint->value, (uint32_t)(to - from) + 1);
		}
	}
	b->n = 0;
	return d->opt.interrupted && d->opt.interrupted(d->opt.ctx) ? err_set(err, ERR_CANCELLED, "interrupted") : 0;
}

static void band_add(struct band *b, int64_t y, int64_t from, int64_t to)
{
	if (!b->n) {
		b->y = y;
		b->least = from;
		b->most = to;
	}
	for (; b->n < (uint32_t)(y - b->y); b->n++) { /* a row without pixels */
		b->from[b->n] = 1;
		b->to[b->n] = 0;
	}
	b->from[b->n] = from;
	b->to[b->n++] = to;
	b->least = from < b->least ? from : b->least;
	b->most = to > b->most ? to : b->most;
}

static int64_t min3(int64_t a, int64_t b, int64_t c)
{
	return a < b ? (a < c ? a : c) : (b < c ? b : c);
}

static int64_t max3(int64_t a, int64_t b, int64_t c)
{
	return a > b ? (a > c ? a : c) : (b > c ? b : c);
}

/* The pixels of its box that are drawn; false: none, as with most triangles where the points are dense. */
static bool pixels(const struct dem *d, const struct dem_corner p[3], int64_t from[2], int64_t to[2])
{
	const struct dem_grid *g = &d->grid;

	for (int i = 0; i < 2; i++) {
		int64_t a = i ? p[0].y : p[0].x, b = i ? p[1].y : p[1].x, c = i ? p[2].y : p[2].x;

		from[i] = dem_div_up(min3(a, b, c), 2 * (dem_i128)g->p);
		to[i] = dem_div_down(max3(a, b, c), 2 * (dem_i128)g->p);
		from[i] = from[i] < g->clip[i][0] ? g->clip[i][0] : from[i];
		to[i] = to[i] > g->clip[i][1] ? g->clip[i][1] : to[i];
		if (from[i] > to[i])
			return false;
	}
	return true;
}

static dem_i128 area2(const int32_t *a, const int32_t *b, const int32_t *c)
{
	return (dem_i128)((int64_t)b[0] - a[0]) * ((int64_t)c[1] - a[1]) -
	       (dem_i128)((int64_t)b[1] - a[1]) * ((int64_t)c[0] - a[0]);
}

/* A triangle, or two: then the pixels that both have. */
struct figure {
	struct dem_corner p[2][3];
	dem_i128 area[2];
	unsigned n;
};

static void paint_init(const struct dem *d, const struct figure *t, const int64_t from[2], struct paint *ret)
{
	const struct dem_grid *g = &d->grid;

	ret->less = d->opt.less;
	dem_plane_init(&ret->f, &d->scale, g, t->p[0], t->area[0], from[0], from[1]);
	if (d->opt.kind == DEM_DIFFERENCE)
		dem_plane_init(&ret->other, &d->scale, g, t->p[1], t->area[1], from[0], from[1]);
	else if (d->opt.kind != DEM_ELEVATION)
		ret->value = slope_of(d, &ret->f);
}

static int draw(struct dem *d, const struct figure *t, const int64_t from[2], const int64_t to[2], struct err *err)
{
	struct paint paint;
	struct edge e[6];
	struct band b;
	bool any = false;
	int r = 0;

	b.n = 0;
	for (unsigned i = 0; i < 3 * t->n; i++) {
		const struct dem_corner *p = t->p[i / 3];

		e[i] = edge_of(&d->grid, &p[i % 3], &p[(i + 1) % 3], from[0], from[1]);
	}
	for (int64_t y = from[1]; y <= to[1] && !r; y++) {
		int64_t x = 0, last = to[0] - from[0];

		for (unsigned i = 0; i < 3 * t->n; i++) {
			narrow(&e[i], &x, &last);
			e[i].c += e[i].step;
		}
		if (b.n && north_of(d, y) / DEM_TILE != north_of(d, b.y) / DEM_TILE)
			r = band_put(d, &paint, &b, err);
		if (x > last)
			continue;
		if (!any)
			paint_init(d, t, from, &paint);
		any = true;
		band_add(&b, y, from[0] + x, from[0] + last);
	}
	return r || !b.n ? r : band_put(d, &paint, &b, err);
}

/* A raster that will be too large is refused before anything of it is drawn: the disk would fill first. */
static int grow(struct dem *d, const int64_t from[2], const int64_t to[2], struct err *err)
{
	struct dem_rect all;
	bool grown = false;

	for (int i = 0; i < 2; i++) {
		grown |= from[i] < d->from[i] || to[i] > d->to[i];
		d->from[i] = from[i] < d->from[i] ? from[i] : d->from[i];
		d->to[i] = to[i] > d->to[i] ? to[i] : d->to[i];
	}
	if (!grown || d->tiled)
		return 0;
	all = (struct dem_rect){d->from[0], d->from[1], (uint64_t)(d->to[0] - d->from[0]) + 1,
				(uint64_t)(d->to[1] - d->from[1]) + 1};
	return dem_check_size(d, &all, err);
}

static void corners_of(const struct dem *d, const int32_t *const at[3], struct dem_corner ret[3])
{
	for (int i = 0; i < 3; i++)
		ret[i] = (struct dem_corner){dem_place(&d->grid, 0, at[i][0]), dem_place(&d->grid, 1, at[i][1]), at[i]};
}

int dem_triangle(struct dem *d, const int32_t a[3], const int32_t b[3], const int32_t c[3], struct err *err)
{
	struct figure t = {.n = 1};
	int64_t from[2], to[2];

	corners_of(d, (const int32_t *const[3]){a, b, c}, t.p[0]);
	if (!pixels(d, t.p[0], from, to))
		return 0;
	if (grow(d, from, to, err))
		return -(int)err->code;
	t.area[0] = area2(a, b, c);
	return t.area[0] > 0 ? draw(d, &t, from, to, err) : 0;
}

int dem_difference(struct dem *d, const int32_t a[3][3], const int32_t b[3][3], struct err *err)
{
	struct figure t = {.n = 2};
	int64_t from[2][2], to[2][2];

	for (int i = 0; i < 2; i++) {
		const int32_t(*at)[3] = i ? b : a;

		corners_of(d, (const int32_t *const[3]){at[0], at[1], at[2]}, t.p[i]);
		t.area[i] = area2(at[0], at[1], at[2]);
		if (t.area[i] <= 0 || !pixels(d, t.p[i], from[i], to[i]))
			return 0;
	}
	for (int k = 0; k < 2; k++) {
		from[0][k] = from[0][k] > from[1][k] ? from[0][k] : from[1][k];
		to[0][k] = to[0][k] < to[1][k] ? to[0][k] : to[1][k];
		if (from[0][k] > to[0][k])
			return 0;
	}
	return grow(d, from[0], to[0], err) ? -(int)err->code : draw(d, &t, from[0], to[0], err);
}
