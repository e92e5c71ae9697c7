/*
 * How far a grid is from the mesh, measured.
 *
 * Both are piecewise linear, so the greatest vertical difference is at a corner of where their triangles meet: at a vertex of the
 * mesh, at a place of the grid, or where an edge of the mesh crosses one of the grid. At its places a grid differs by rounding
 * alone, half a step at most. The others are all looked at here; so the error holds everywhere, not only at the vertices. Where
 * the grid has no triangle there is no difference; how often that is so is counted, so that a page knows which grids leave out a
 * narrow part of the mesh.
 *
 * Quads of the grid have the diagonal from the low corner to the high one. Numbers are doubles in steps of the grid: places are
 * exact, as the step is a power of two, and crossings are rounded, which is small beside the rounding of the result.
 */
#include <math.h>

#include "levels_priv.h"

struct corner {
	double x, y, z;
};

static bool has(const struct levels_grid *g, int i, int j)
{
	return g->has[j * LEVELS_ROW + i];
}

static double at(const struct levels_grid *g, int i, int j)
{
	return g->z[j * LEVELS_ROW + i];
}

/* The height of half a quad; false: it is not there. */
static bool half(const struct levels_grid *g, int i, int j, bool upper, double u, double v, double *ret)
{
	double a, b, c;

	if (i < 0 || j < 0 || i >= LEVELS_SIDE || j >= LEVELS_SIDE || !has(g, i, j) || !has(g, i + 1, j + 1) ||
	    !(upper ? has(g, i, j + 1) : has(g, i + 1, j)))
		return false;
	a = at(g, i, j);
	b = upper ? at(g, i, j + 1) : at(g, i + 1, j);
	c = at(g, i + 1, j + 1);
	*ret = upper ? a + v * (b - a) + u * (c - b) : a + u * (b - a) + v * (c - b);
	return true;
}

/* At a place that may be on an edge of the grid: then any half at it counts, as they agree. False: there is none. */
static bool at_place(const struct levels_grid *g, double x, double y, double *ret)
{
	int i = (int)x, j = (int)y;
	double u = x - i, v = y - j;

	for (int left = 0; left <= (u == 0); left++)
		for (int below = 0; below <= (v == 0); below++)
			for (int upper = 0; upper < 2; upper++) {
				double s = u + left, t = v + below;

				if ((upper ? t >= s : s >= t) && half(g, i - left, j - below, upper, s, t, ret))
					return true;
			}
	return false;
}

static bool in_square(const struct corner *p)
{
	return p->x >= 0 && p->y >= 0 && p->x <= LEVELS_SIDE && p->y <= LEVELS_SIDE;
}

static double between(const struct levels_grid *g, int i, int j, int di, int dj, double part, double z, double most)
{
	double a, b;

	if (!has(g, i, j) || !has(g, i + di, j + dj))
		return most;
	a = at(g, i, j);
	b = at(g, i + di, j + dj);
	return fmax(most, fabs(a + part * (b - a) - z));
}

/* The quad of a place on a line of the grid; -1: it is outside. */
static int quad(double n)
{
	return n >= 0 && n < LEVELS_SIDE ? (int)n : n == LEVELS_SIDE ? LEVELS_SIDE - 1 : -1;
}

/* The whole numbers from low to high that are between a and b. */
static void lines(double a, double b, int low, int high, int *from, int *to)
{
	double least = fmax(fmin(a, b), low), greatest = fmin(fmax(a, b), high);

	*from = least > high ? high + 1 : (int)ceil(least);
	*to = greatest < low ? low - 1 : (int)floor(greatest);
}

static double crossings(const struct levels_grid *g, const struct corner *a, const struct corner *b, double most)
{
	double dx = b->x - a->x, dy = b->y - a->y, dz = b->z - a->z;
	int from, to;

	lines(a->x, b->x, 0, LEVELS_SIDE, &from, &to);
	for (int i = from; i <= to && dx != 0; i++) {
		double t = (i - a->x) / dx, y = a->y + t * dy;
		int j = quad(y);

		if (j >= 0)
			most = between(g, i, j, 0, 1, y - j, a->z + t * dz, most);
	}
	lines(a->y, b->y, 0, LEVELS_SIDE, &from, &to);
	for (int j = from; j <= to && dy != 0; j++) {
		double t = (j - a->y) / dy, x = a->x + t * dx;
		int i = quad(x);

		if (i >= 0)
			most = between(g, i, j, 1, 0, x - i, a->z + t * dz, most);
	}
	lines(a->x - a->y, b->x - b->y, -LEVELS_SIDE, LEVELS_SIDE, &from, &to);
	for (int k = from; k <= to && dx != dy; k++) {
		double t = (k - (a->x - a->y)) / (dx - dy), x = a->x + t * dx;
		int i = quad(x), j = i - k;

		if (i >= 0 && j >= 0 && j < LEVELS_SIDE)
			most = between(g, i, j, 1, 1, x - i, a->z + t * dz, most);
	}
	return most;
}

void levels_compare(struct levels_grid *g, const struct levels_triangle *t, bool own)
{
	double scale = ldexp(1, -(int)g->step), h;
	struct corner c[3];

	for (int j = 0; j < 3; j++) {
		c[j].x = (double)((int64_t)t->at[j][0] - (int64_t)g->x) * scale;
		c[j].y = (double)((int64_t)t->at[j][1] - (int64_t)g->y) * scale;
		c[j].z = t->z[j];
	}
	for (int j = 0; j < 3; j++) {
		if (in_square(&c[j])) {
			bool there = at_place(g, c[j].x, c[j].y, &h);

			g->corners += own;
			g->lost += own && !there;
			if (there)
				g->error = fmax(g->error, fabs(h - c[j].z));
		}
		g->error = crossings(g, &c[j], &c[(j + 1) % 3], g->error);
	}
}

double levels_up(double n)
{
	return ceil(n * 1000) / 1000;
}
