/*
 * Which cells of a grid a triangle meets: row by row, so that a sliver is in the cells along it and not in those of its box.
 *
 * A cell more is harmless, one that is missing is not: the triangle counts as two lattice steps larger on each side, which is
 * more than the doubles here, and than those of the place by which a pair is assigned to one cell, are wrong.
 */
#include <math.h>

#include "volume_priv.h"

enum { MARGIN = 2 };
#define END (INT64_C(1) << 40)

/* About as many cells as are asked for, nearly square. */
struct volume_grid volume_grid_of(const int64_t box[4], double cells)
{
	struct volume_grid g = {.x = box[0], .y = box[1]};
	double w = (double)(box[2] - box[0]) + 1, h = (double)(box[3] - box[1]) + 1, side;

	cells = fmin(fmax(cells, 1), 1 << 24);
	side = fmax(ceil(sqrt(w * h / cells)), 1);
	side = fmax(side, ceil(fmax(w, h) / fmin(cells, 1 << 20)));
	g.w = g.h = (int64_t)side;
	g.nx = (uint32_t)ceil(w / side);
	g.ny = (uint32_t)ceil(h / side);
	return g;
}

static uint32_t index_of(int64_t at, int64_t from, int64_t side, uint32_t n)
{
	int64_t i = at < from ? 0 : (at - from) / side;

	return i < n ? (uint32_t)i : n - 1;
}

/* The edge between two heights; adds to the range of x. */
static void edge_range(const int32_t *p, const int32_t *q, double low, double high, double range[2])
{
	const int32_t *a = p[1] <= q[1] ? p : q, *b = p[1] <= q[1] ? q : p;
	double dx = (double)b[0] - a[0], dy = (double)b[1] - a[1], x[2];

	if (a[1] > high || b[1] < low)
		return;
	x[0] = a[1] < low ? a[0] + dx * ((low - a[1]) / dy) : a[0];
	x[1] = b[1] > high ? a[0] + dx * ((high - a[1]) / dy) : b[0];
	for (int i = 0; i < 2; i++) {
		range[0] = fmin(range[0], x[i]);
		range[1] = fmax(range[1], x[i]);
	}
}

int volume_cells(const struct volume_grid *g, const struct volume_triangle *t,
		 int (*each)(void *ctx, uint32_t y, uint32_t x1, uint32_t x2), void *ctx)
{
	int64_t box[4] = {t->at[0][0], t->at[0][1], t->at[0][0], t->at[0][1]};
	uint32_t x1, x2, y1, y2;
	int r = 0;

	for (int i = 1; i < 3; i++)
		for (int k = 0; k < 2; k++) {
			box[k] = t->at[i][k] < box[k] ? t->at[i][k] : box[k];
			box[2 + k] = t->at[i][k] > box[2 + k] ? t->at[i][k] : box[2 + k];
		}
	x1 = index_of(box[0] - MARGIN, g->x, g->w, g->nx);
	x2 = index_of(box[2] + MARGIN, g->x, g->w, g->nx);
	y1 = index_of(box[1] - MARGIN, g->y, g->h, g->ny);
	y2 = index_of(box[3] + MARGIN, g->y, g->h, g->ny);
	if (x1 == x2 || y1 == y2) {
		for (uint32_t y = y1; y <= y2 && !r; y++)
			r = each(ctx, y, x1, x2);
		return r;
	}
	for (uint32_t y = y1; y <= y2 && !r; y++) {
		double low = y ? (double)(g->y + (int64_t)y * g->h - MARGIN) : -(double)END;
		double high = y + 1 < g->ny ? (double)(g->y + ((int64_t)y + 1) * g->h + MARGIN) : (double)END;
		double range[2] = {INFINITY, -INFINITY};

		for (int i = 0; i < 3; i++)
			edge_range(t->at[i], t->at[i == 2 ? 0 : i + 1], low, high, range);
		if (range[0] <= range[1])
			r = each(ctx, y, index_of((int64_t)floor(range[0]) - MARGIN, g->x, g->w, g->nx),
				 index_of((int64_t)ceil(range[1]) + MARGIN, g->x, g->w, g->nx));
	}
	return r;
}

struct volume_rect volume_grid_cell(const struct volume_grid *g, const struct volume_rect *rect, uint32_t x, uint32_t y)
{
	return (struct volume_rect){
		x ? g->x + (int64_t)x * g->w : rect->x1,
		y ? g->y + (int64_t)y * g->h : rect->y1,
		x + 1 < g->nx ? g->x + ((int64_t)x + 1) * g->w : rect->x2,
		y + 1 < g->ny ? g->y + ((int64_t)y + 1) * g->h : rect->y2,
	};
}
