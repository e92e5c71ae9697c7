/*
 * A raster of squares that are nodes of the tree of keys. A triangle that meets more than a few is marked row by row: its part in
 * a row is between the least and the greatest x of its sides there. These are computed in doubles, with coordinates relative to
 * the raster, whose errors are far less than a position, and marked with a position more on either side.
 */
#include "simplify_raster.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "point.h"

static uint32_t biased(int32_t v)
{
	return (uint32_t)v ^ 0x80000000u;
}

void simplify_raster_init(struct simplify_raster *r, const int32_t box[4], uint32_t most)
{
	memset(r->row, 0, sizeof r->row);
	r->shift = 0;
	for (unsigned k = 0; k < 2; k++)
		while ((biased(box[2 + k]) >> r->shift) - (biased(box[k]) >> r->shift) >= most)
			r->shift++;
	for (unsigned k = 0; k < 2; k++)
		r->low[k] = biased(box[k]) >> r->shift;
}

static void mark(struct simplify_raster *r, uint32_t row, uint32_t from, uint32_t to)
{
	r->row[row] |= (UINT64_MAX >> (63 - (to - from))) << from;
}

/* The square of a coordinate, within the raster. */
static uint32_t square(const struct simplify_raster *r, double at)
{
	double n = floor(ldexp(at, -(int)r->shift));

	return n < 0 ? 0 : n >= SIMPLIFY_RASTER ? SIMPLIFY_RASTER - 1 : (uint32_t)n;
}

/* Extends the part of x by the side p, q within a row. */
static void clip(const double p[2], const double q[2], double low, double high, double x[2])
{
	double from = p[1] < q[1] ? p[1] : q[1], to = p[1] < q[1] ? q[1] : p[1];

	from = from < low ? low : from;
	to = to > high ? high : to;
	if (from > to)
		return;
	for (unsigned k = 0; k < 2; k++) {
		double y = k ? to : from;
		double at = p[1] == q[1] ? (k ? p[0] : q[0]) : p[0] + (q[0] - p[0]) * ((y - p[1]) / (q[1] - p[1]));

		x[0] = at < x[0] ? at : x[0];
		x[1] = at > x[1] ? at : x[1];
	}
}

static void mark_rows(struct simplify_raster *r, const int32_t *const corner[3], uint32_t first, uint32_t last)
{
	double at[3][2];

	for (unsigned i = 0; i < 3; i++)
		for (unsigned k = 0; k < 2; k++)
			at[i][k] = (double)((int64_t)biased(corner[i][k]) - ((int64_t)r->low[k] << r->shift));
	for (uint32_t row = first; row <= last; row++) {
		double low = ldexp(row, (int)r->shift) - 1, high = ldexp(row + 1, (int)r->shift) + 1,
		       x[2] = {INFINITY, -INFINITY};

		for (unsigned i = 0; i < 3; i++)
			clip(at[i], at[(i + 1) % 3], low, high, x);
		if (x[0] <= x[1])
			mark(r, row, square(r, x[0] - 1), square(r, x[1] + 1));
	}
}

void simplify_raster_mark(struct simplify_raster *r, const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	const int32_t *const corner[3] = {a, b, c};
	uint32_t low[2], high[2];

	for (unsigned k = 0; k < 2; k++) {
		int32_t least = a[k] < b[k] ? a[k] : b[k], most = a[k] < b[k] ? b[k] : a[k];

		least = c[k] < least ? c[k] : least;
		most = c[k] > most ? c[k] : most;
		low[k] = (biased(least) >> r->shift) - r->low[k];
		high[k] = (biased(most) >> r->shift) - r->low[k];
	}
	if (high[0] - low[0] > 1 && high[1] - low[1] > 1) {
		mark_rows(r, corner, low[1], high[1]);
		return;
	}
	for (uint32_t row = low[1]; row <= high[1]; row++)
		mark(r, row, low[0], high[0]);
}

/* The square of a coordinate, or the one next to the border that it is beyond. */
static uint32_t nearest(const struct simplify_raster *r, int32_t at, unsigned axis)
{
	uint32_t n = biased(at) >> r->shift;

	return n < r->low[axis] ? 0 : n - r->low[axis] >= SIMPLIFY_RASTER ? SIMPLIFY_RASTER - 1 : n - r->low[axis];
}

void simplify_raster_square(struct simplify_raster *r, const int32_t box[4])
{
	for (uint32_t row = nearest(r, box[1], 1); row <= nearest(r, box[3], 1); row++)
		mark(r, row, nearest(r, box[0], 0), nearest(r, box[2], 0));
}

void simplify_raster_line(struct simplify_raster *r, const int32_t a[2], const int32_t b[2])
{
	const int32_t *const corner[3] = {a, b, b};
	uint32_t p = nearest(r, a[1], 1), q = nearest(r, b[1], 1);

	mark_rows(r, corner, p < q ? p : q, p < q ? q : p);
}

bool simplify_raster_meets(const struct simplify_raster *r, const int32_t box[4])
{
	uint32_t from = nearest(r, box[0], 0), to = nearest(r, box[2], 0), last = nearest(r, box[3], 1);
	uint64_t bits = (UINT64_MAX >> (63 - (to - from))) << from;

	for (uint32_t row = nearest(r, box[1], 1); row <= last; row++)
		if (r->row[row] & bits)
			return true;
	return false;
}

static int range_order(const void *a, const void *b)
{
	const struct simplify_range *p = a, *q = b;

	return p->lo < q->lo ? -1 : p->lo > q->lo;
}

size_t simplify_raster_ranges(struct simplify_raster *r)
{
	size_t n = 0, joined = 0;

	for (uint32_t row = 0; row < SIMPLIFY_RASTER; row++)
		for (uint64_t bits = r->row[row]; bits; bits &= bits - 1) {
			uint32_t x = (r->low[0] + (uint32_t)__builtin_ctzll(bits)) << r->shift, y = (r->low[1] + row) << r->shift;
			uint64_t lo = point_morton((int32_t)(x ^ 0x80000000u), (int32_t)(y ^ 0x80000000u));

			r->range[n++] = (struct simplify_range){lo, lo + ((UINT64_C(1) << 2 * r->shift) - 1)};
		}
	qsort(r->range, n, sizeof *r->range, range_order);
	for (size_t i = 0; i < n; i++)
		if (joined && r->range[joined - 1].hi + 1 == r->range[i].lo)
			r->range[joined - 1].hi = r->range[i].hi;
		else
			r->range[joined++] = r->range[i];
	return joined;
}
