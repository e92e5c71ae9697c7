/*
 * A smooth function of two variables, kept as cubics in the cells of a fixed raster. What it gives at a place
 * depends on that place alone: the cell is found from it, and the cell's cubic is made from the function at
 * sixteen nodes of the cell, whichever place asked first. Shared by the geodetic files of this room.
 */
#ifndef CRS_CELLS_H
#define CRS_CELLS_H

#include <stdbool.h>
#include <stdint.h>

struct err;

enum { CRS_CELLS = 16 * 16, CRS_CELL_NODES = 16 };

typedef int crs_cells_fn(void *ctx, double u, double v, double ret[2], struct err *err);

struct crs_cell {
	int64_t i, j;
	enum { CRS_CELL_EMPTY, CRS_CELL_CUBIC, CRS_CELL_DIRECT } state;
	double c[2][CRS_CELL_NODES]; /* of s^a t^b at 4a + b, s and t from -1 to 1 */
};

struct crs_cells {
	crs_cells_fn *fn;
	/* Whether the values at the nodes may be interpolated; NULL: always. Where not, and where a node has no
	 * value, the function itself is asked at each place. */
	bool (*smooth)(const double node[CRS_CELL_NODES][2]);
	void *ctx;
	unsigned outputs;   /* 1 or 2 */
	double per_unit[2]; /* cells in one unit of u and v */
	int64_t top;        /* cells of v reach from -top to top: the edge itself belongs to the last */
	struct crs_cell table[CRS_CELLS];
};

/* ret[0] and, with two outputs, ret[1]. Errors are the function's own. */
int crs_cells_at(struct crs_cells *, double u, double v, double ret[2], struct err *err);

#endif
