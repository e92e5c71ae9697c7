/*
 * Areas of a crop or a window (view_area.h): an area of base with all of its borders, behind a table of cells that decides most
 * positions at once. Cells are over the bounds of the area, with steps of a power of two; one that no edge touches is entirely
 * inside or outside. Only the other positions are asked of the area.
 *
 * All arithmetic is in integers of up to 128 bits. An area is read-only after view_area_end.
 */
#include "view_area.h"

#include <stdlib.h>
#include <string.h>

#include "area.h"
#include "err.h"

enum { CELLS = 128 };

/* from its lower end to its upper end: ay <= by */
struct edge {
	int64_t ax, ay, bx, by;
};

struct view_area {
	struct area *area;
	int64_t bounds[4];
	unsigned cell_shift[2];
	uint8_t cell[CELLS][CELLS]; /* by y, by x: an enum area_side */
};

struct view_area *view_area_new(void)
{
	struct view_area *a = calloc(1, sizeof(*a));

	if (a)
		a->area = area_new(AREA_CLOSED);
	if (a && a->area)
		return a;
	free(a);
	return NULL;
}

void view_area_free(struct view_area *a)
{
	if (a)
		area_free(a->area);
	free(a);
}

int view_area_ring(struct view_area *a, bool shell, struct err *err)
{
	return area_ring(a->area, shell, err);
}

int view_area_corner(struct view_area *a, int64_t x, int64_t y, struct err *err)
{
	return area_corner(a->area, x, y, err);
}

/* ---- the cells ---- */

/* The smallest shift that brings span below n. */
static unsigned shift_for(uint64_t span, uint64_t n)
{
	unsigned shift = 0;

	while (span >> shift >= n)
		shift++;
	return shift;
}

static int64_t cell_of(const struct view_area *a, unsigned axis, int64_t v)
{
	int64_t d = v - a->bounds[axis];

	if (d < 0)
		return 0;
	d >>= a->cell_shift[axis];
	return d < CELLS ? d : CELLS - 1;
}

static int64_t floor_div(__int128 a, int64_t b)
{
	__int128 q = a / b;

	return (int64_t)(a % b < 0 ? q - 1 : q);
}

/* The x interval of the edge between y1 and y2, both within it, rounded outwards. */
static void edge_reach(const struct edge *e, int64_t y1, int64_t y2, int64_t ret[2])
{
	int64_t at[2] = {y1, y2};

	for (unsigned i = 0; i < 2; i++) {
		__int128 up = (__int128)(e->bx - e->ax) * (at[i] - e->ay);
		int64_t x = e->ax + floor_div(up, e->by - e->ay);

		if (!i || x < ret[0])
			ret[0] = x;
		if (!i || x + 1 > ret[1])
			ret[1] = x + 1;
	}
}

/* Cells are closed and extended by one lattice step on every side, so an edge that passes between two cells touches both. */
static void mark_edge(struct view_area *a, const struct edge *e)
{
	int64_t row = cell_of(a, 1, e->ay - 1), last = cell_of(a, 1, e->by + 1);

	for (; row <= last; row++) {
		int64_t low = a->bounds[1] + (row << a->cell_shift[1]) - 1,
			high = a->bounds[1] + ((row + 1) << a->cell_shift[1]) + 1, reach[2];

		if (e->ay == e->by) {
			reach[0] = e->ax < e->bx ? e->ax : e->bx;
			reach[1] = e->ax < e->bx ? e->bx : e->ax;
		} else {
			low = low < e->ay ? e->ay : low > e->by ? e->by : low;
			high = high > e->by ? e->by : high < e->ay ? e->ay : high;
			edge_reach(e, low, high, reach);
		}
		int64_t c = cell_of(a, 0, reach[0] - 1), end = cell_of(a, 0, reach[1] + 1);

		memset(&a->cell[row][c], AREA_MIXED, (size_t)(end - c + 1));
	}
}

static void mark_edges(struct view_area *a)
{
	const int64_t(*c)[2];
	bool shell;

	for (size_t r = 0; r < area_rings(a->area); r++) {
		size_t n = area_ring_at(a->area, r, &shell, &c);

		for (size_t i = 0; i < n; i++) {
			const int64_t *p = c[i], *q = c[(i + 1) % n], *low = p[1] <= q[1] ? p : q, *high = low == p ? q : p;

			mark_edge(a, &(struct edge){low[0], low[1], high[0], high[1]});
		}
	}
}

static void fill_cells(struct view_area *a)
{
	for (unsigned k = 0; k < 2; k++)
		a->cell_shift[k] = shift_for((uint64_t)(a->bounds[2 + k] - a->bounds[k]), CELLS);
	mark_edges(a);
	for (int64_t row = 0; row < CELLS; row++) {
		int64_t y = a->bounds[1] + (row << a->cell_shift[1]);

		for (int64_t c = 0; c < CELLS && y <= a->bounds[3]; c++) {
			int64_t x = a->bounds[0] + (c << a->cell_shift[0]);

			if (a->cell[row][c] == AREA_MIXED)
				continue;
			/* No edge runs between two adjacent cells that no edge touches. */
			if (c && a->cell[row][c - 1] != AREA_MIXED)
				a->cell[row][c] = a->cell[row][c - 1];
			else
				a->cell[row][c] = area_has(a->area, x, y) ? AREA_IN : AREA_OUT;
		}
	}
}

int view_area_end(struct view_area *a, struct err *err)
{
	int r;

	area_normal_form(a->area);
	if (!area_rings(a->area))
		return err_set(err, ERR_USAGE, "the area has no corners");
	area_bounds(a->area, a->bounds);
	for (unsigned k = 0; k < 2; k++) {
		if (a->bounds[k] < -VIEW_AREA_MOST || a->bounds[2 + k] > VIEW_AREA_MOST) {
			err_set(err, ERR_USAGE, "the area reaches too far out for the lattice of the dataset");
			return err_add_hint(err, "give its corners in the coordinates of the dataset");
		}
	}
	r = area_end(a->area, err);
	if (!r)
		fill_cells(a);
	return r;
}

/* ---- queries ---- */

bool view_area_has(const struct view_area *a, int64_t x, int64_t y)
{
	if (x < a->bounds[0] || y < a->bounds[1] || x > a->bounds[2] || y > a->bounds[3])
		return false;
	switch (a->cell[(y - a->bounds[1]) >> a->cell_shift[1]][(x - a->bounds[0]) >> a->cell_shift[0]]) {
	case AREA_OUT:
		return false;
	case AREA_IN:
		return true;
	default:
		return area_has(a->area, x, y);
	}
}

bool view_area_meets(const struct view_area *a, const int64_t box[4])
{
	const int64_t *b = a->bounds;

	if (box[0] > b[2] || box[1] > b[3] || box[2] < b[0] || box[3] < b[1])
		return false;
	int64_t c1 = cell_of(a, 0, box[0]), c2 = cell_of(a, 0, box[2]);

	for (int64_t row = cell_of(a, 1, box[1]); row <= cell_of(a, 1, box[3]); row++)
		for (int64_t c = c1; c <= c2; c++)
			if (a->cell[row][c] != AREA_OUT)
				return true;
	return false;
}

bool view_area_meets_triangle(const struct view_area *a, const int64_t corner[3][2])
{
	const int64_t *p = corner[0], *q = corner[1], *r = corner[2];
	int64_t t[3][2], box[4];

	memcpy(t, corner, sizeof t);
	for (unsigned k = 0; k < 2; k++) {
		box[k] = box[2 + k] = t[0][k];
		for (unsigned i = 1; i < 3; i++) {
			box[k] = t[i][k] < box[k] ? t[i][k] : box[k];
			box[2 + k] = t[i][k] > box[2 + k] ? t[i][k] : box[2 + k];
		}
	}
	if (!view_area_meets(a, box))
		return false;
	for (unsigned i = 0; i < 3; i++)
		if (view_area_has(a, t[i][0], t[i][1]))
			return true;
	if ((__int128)(q[0] - p[0]) * (r[1] - p[1]) < (__int128)(q[1] - p[1]) * (r[0] - p[0])) {
		memcpy(t[1], r, sizeof t[1]);
		memcpy(t[2], q, sizeof t[2]);
	}
	/* No corner is in the area, so the part of the triangle that is in the area ends at an edge. */
	return area_edge_meets(a->area, (const int64_t(*)[2])t);
}

void view_area_bounds(const struct view_area *a, int64_t ret[4])
{
	memcpy(ret, a->bounds, sizeof a->bounds);
}

bool view_area_is_box(const struct view_area *a)
{
	const int64_t(*c)[2];
	bool shell;

	/* In normal form: the lower left corner is first, then the upper left. */
	return area_rings(a->area) == 1 && area_ring_at(a->area, 0, &shell, &c) == 4 && c[0][0] == c[1][0] &&
	       c[1][1] == c[2][1] && c[2][0] == c[3][0] && c[3][1] == c[0][1];
}

size_t view_area_rings(const struct view_area *a)
{
	return area_rings(a->area);
}

size_t view_area_ring_at(const struct view_area *a, size_t i, bool *ret_shell, const int64_t (**ret)[2])
{
	return area_ring_at(a->area, i, ret_shell, ret);
}
