/*
 * Cubics in the cells of a raster (crs_cells.h).
 *
 * Model: a table of 16 by 16 cells, each in the place of its numbers modulo 16, so that any window of that size
 * fits whole; a cell that finds another in its place takes it. The nodes are Chebyshev's, where the cubic through them is nearly
 * the best one. Nothing here knows what the function means.
 */
#include "crs_cells.h"

#include <math.h>

#include "err.h"

/* Chebyshev's nodes of degree four: cos((2k + 1) pi / 8). */
static const double node_at[4] = {0.92387953251128675613, 0.38268343236508977173, -0.38268343236508977173,
				  -0.92387953251128675613};

/* The cubic a0 + a1 s + a2 s^2 + a3 s^3 through the values f at the nodes, `step` apart in memory, in place:
 * Chebyshev coefficients (T0 = 1, T1 = s, T2 = 2 s^2 - 1, T3 = 4 s^3 - 3 s), then powers. */
static void to_powers(double *f, unsigned step)
{
	const double c1 = node_at[0], c3 = node_at[1], h = 0.70710678118654752440;
	double p = f[0] + f[3 * step], m = f[0] - f[3 * step], q = f[step] + f[2 * step], n = f[step] - f[2 * step];
	double t0 = (p + q) / 4, t1 = (c1 * m + c3 * n) / 2, t2 = h * (p - q) / 2, t3 = (c3 * m - c1 * n) / 2;

	f[0] = t0 - t2;
	f[step] = t1 - 3 * t3;
	f[2 * step] = 2 * t2;
	f[3 * step] = 4 * t3;
}

static void fill(struct crs_cells *c, struct crs_cell *cell)
{
	double node[CRS_CELL_NODES][2];
	struct err err = ERR_INIT;

	cell->state = CRS_CELL_DIRECT;
	for (unsigned a = 0; a < 4; a++) {
		for (unsigned b = 0; b < 4; b++) {
			double u = ((double)cell->i + (node_at[a] + 1) / 2) / c->per_unit[0];
			double v = ((double)cell->j + (node_at[b] + 1) / 2) / c->per_unit[1];

			if (c->fn(c->ctx, u, v, node[4 * a + b], &err))
				return;
		}
	}
	if (c->smooth && !c->smooth((const double(*)[2])node))
		return;
	for (unsigned k = 0; k < c->outputs; k++) {
		for (unsigned n = 0; n < CRS_CELL_NODES; n++)
			cell->c[k][n] = node[n][k];
		for (unsigned a = 0; a < 4; a++)
			to_powers(&cell->c[k][4 * a], 1);
		for (unsigned b = 0; b < 4; b++)
			to_powers(&cell->c[k][b], 4);
	}
	cell->state = CRS_CELL_CUBIC;
}

static double value(const double c[CRS_CELL_NODES], double s, double t)
{
	double row[4];

	for (unsigned a = 0; a < 4; a++)
		row[a] = ((c[4 * a + 3] * t + c[4 * a + 2]) * t + c[4 * a + 1]) * t + c[4 * a];
	return ((row[3] * s + row[2]) * s + row[1]) * s + row[0];
}

int crs_cells_at(struct crs_cells *c, double u, double v, double ret[2], struct err *err)
{
	double su = u * c->per_unit[0], sv = v * c->per_unit[1];
	int64_t i = (int64_t)floor(su), j = (int64_t)floor(sv);
	struct crs_cell *cell;

	j = j >= c->top ? c->top - 1 : j < -c->top ? -c->top : j;
	cell = &c->table[(i & 15) << 4 | (j & 15)];
	if (cell->state == CRS_CELL_EMPTY || cell->i != i || cell->j != j) {
		cell->i = i;
		cell->j = j;
		fill(c, cell);
	}
	if (cell->state == CRS_CELL_DIRECT)
		return c->fn(c->ctx, u, v, ret, err);
	su = 2 * (su - (double)i) - 1;
	sv = 2 * (sv - (double)j) - 1;
	for (unsigned k = 0; k < c->outputs; k++)
		ret[k] = value(cell->c[k], su, sv);
	return 0;
}
