/*
 * Grids of heights.
 *
 * The grid of an inner node has a height at each place of its square whose numbers are multiples of its step and that is in a
 * triangle: the triangle's plane there, exact and then rounded to the lattice. It does not matter which of several triangles is
 * asked, since they agree. Elsewhere it has none. Steps are powers of two, so the places of a grid are places of the finer grids
 * below it: a leaf samples at the step of its parent, for all grids that it is in.
 */
#include "levels_priv.h"

/* A triangle by its first corner; differences have 33 bits. */
struct plane {
	int64_t x[3], y[3], bx, by, bz, cx, cy, cz;
	levels_i128 area, east, north;
};

static void plane_of(const struct levels_triangle *t, struct plane *p)
{
	for (int j = 0; j < 3; j++) {
		p->x[j] = t->at[j][0];
		p->y[j] = t->at[j][1];
	}
	p->bx = p->x[1] - p->x[0];
	p->by = p->y[1] - p->y[0];
	p->cx = p->x[2] - p->x[0];
	p->cy = p->y[2] - p->y[0];
	p->bz = (int64_t)t->z[1] - t->z[0];
	p->cz = (int64_t)t->z[2] - t->z[0];
	p->area = (levels_i128)p->bx * p->cy - (levels_i128)p->by * p->cx;
	p->east = (levels_i128)p->bz * p->cy - (levels_i128)p->cz * p->by;
	p->north = (levels_i128)p->cz * p->bx - (levels_i128)p->bz * p->cx;
}

static bool inside(const struct plane *p, int64_t x, int64_t y)
{
	for (int i = 0, j = 1; i < 3; i++, j = (j + 1) % 3)
		if ((levels_i128)(p->x[j] - p->x[i]) * (y - p->y[i]) < (levels_i128)(p->y[j] - p->y[i]) * (x - p->x[i]))
			return false;
	return true;
}

/* Halves go up. */
static int32_t height(const struct plane *p, int32_t z0, int64_t x, int64_t y)
{
	levels_i128 up = 2 * (p->east * (x - p->x[0]) + p->north * (y - p->y[0])) + p->area, down = 2 * p->area;
	levels_i128 whole = up / down;

	return (int32_t)(z0 + (int64_t)(whole - (whole * down > up)));
}

static void put(struct levels *lv, unsigned depths, uint64_t x, uint64_t y, int32_t z)
{
	for (unsigned d = depths; d-- > 0;) {
		struct levels_grid *g = lv->stack[d];
		uint64_t dx = x - g->x, dy = y - g->y, at = (dy >> g->step) * LEVELS_ROW + (dx >> g->step);

		if ((dx | dy) & (((uint64_t)1 << g->step) - 1))
			return; /* nor of a coarser one */
		g->z[at] = z;
		g->has[at] = 1;
	}
}

void levels_sample(struct levels *lv, const struct levels_leaf *leaf, const struct levels_triangle *t)
{
	const struct levels_grid *g = lv->stack[leaf->cell.depth - 1];
	uint64_t corner[2], side = levels_side(lv, &leaf->cell), low[2], high[2], mask = ((uint64_t)1 << g->step) - 1;
	struct plane p;
	bool known = false;

	levels_corner(lv, &leaf->cell, corner);
	for (int k = 0; k < 2; k++) {
		uint64_t a = t->at[0][k], b = t->at[1][k], c = t->at[2][k];

		low[k] = a < b ? (a < c ? a : c) : b < c ? b : c;
		high[k] = a > b ? (a > c ? a : c) : b > c ? b : c;
		low[k] = ((low[k] > corner[k] ? low[k] : corner[k]) + mask) & ~mask;
		high[k] = high[k] < corner[k] + side ? high[k] : corner[k] + side;
	}
	for (uint64_t y = low[1]; y <= high[1]; y += mask + 1) {
		for (uint64_t x = low[0]; x <= high[0]; x += mask + 1) {
			if (!known)
				plane_of(t, &p);
			known = true;
			if (inside(&p, (int64_t)x, (int64_t)y))
				put(lv, leaf->cell.depth, x, y, height(&p, t->z[0], (int64_t)x, (int64_t)y));
		}
	}
}
