/* Segments in square cells, for acut-verify. A cell is a key of column and row; those of one column follow each other. */
#include <stdlib.h>

#include "check_lines.h"
#include "err.h"
#include "grow.h"

int check_no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory to compare a mesh with lines");
}

/* Two at least: then a column is 32 bits. */
unsigned check_grid_shift(double sum_of_lengths, size_t n)
{
	unsigned shift = 2;

	while (shift < 33 && (double)(UINT64_C(1) << shift) * (double)n < sum_of_lengths)
		shift++;
	return shift;
}

static int64_t clamp(int64_t v)
{
	return v < INT32_MIN ? INT32_MIN : v > INT32_MAX ? INT32_MAX : v;
}

uint64_t check_grid_key(unsigned shift, int64_t x, int64_t y)
{
	uint64_t column = (uint64_t)((clamp(x) >> shift) + (INT64_C(1) << 31));
	uint64_t row = (uint64_t)((clamp(y) >> shift) + (INT64_C(1) << 31));

	return column << 32 | row;
}

/* The integer below the y of the segment at x. */
static int64_t floor_y(const int32_t *a, const int32_t *b, int64_t x)
{
	int64_t d = (int64_t)b[0] - a[0];
	__int128 n = (__int128)((int64_t)b[1] - a[1]) * (x - a[0]);

	return a[1] + (int64_t)(n / d - (n % d < 0));
}

int check_grid_walk(unsigned shift, const int32_t *a, const int32_t *b, int64_t wide, check_column_fn fn, void *ctx)
{
	const int32_t *left = a[0] <= b[0] ? a : b, *right = a[0] <= b[0] ? b : a;
	int64_t first = clamp(left[0] - wide) >> shift, last = clamp(right[0] + wide) >> shift;
	int rc = 0;

	for (int64_t c = first; rc == 0 && c <= last; c++) {
		int64_t from = c * (INT64_C(1) << shift), to = from + (INT64_C(1) << shift) - 1;
		int64_t x0 = from - wide > left[0] ? from - wide : left[0], x1 = to + wide < right[0] ? to + wide : right[0];
		int64_t y0 = left[1], y1 = right[1];

		/* A cell ends one unit before the next one begins; the segment does not. */
		x1 = x1 < right[0] ? x1 + 1 : x1;
		if (left[0] < right[0]) {
			y0 = floor_y(left, right, x0);
			y1 = floor_y(left, right, x1);
		}
		int64_t low = (y0 < y1 ? y0 : y1) - wide, high = (y0 < y1 ? y1 : y0) + 1 + wide;

		rc = fn(ctx, check_grid_key(shift, from, low), check_grid_key(shift, from, high));
	}
	return rc;
}

struct adding {
	struct check_grid *grid;
	uint32_t item;
	struct err *err;
};

static int add_cells(void *ctx, uint64_t low, uint64_t high)
{
	struct adding *a = ctx;
	struct check_grid *g = a->grid;

	for (uint64_t key = low; key <= high; key++) {
		if (!grow(&g->cell, &g->cap, g->n + 1, 256, sizeof *g->cell))
			return check_no_memory(a->err);
		g->cell[g->n++] = (struct check_cell){key, a->item};
	}
	return 0;
}

int check_grid_add(struct check_grid *g, uint32_t item, const int32_t *a, const int32_t *b, int64_t wide, struct err *err)
{
	struct adding add = {g, item, err};

	return check_grid_walk(g->shift, a, b, wide, add_cells, &add);
}

static int compare_cells(const void *a, const void *b)
{
	const struct check_cell *p = a, *q = b;

	return p->key != q->key ? (p->key < q->key ? -1 : 1) : (p->item > q->item) - (p->item < q->item);
}

void check_grid_sort(struct check_grid *g)
{
	if (g->n)
		qsort(g->cell, g->n, sizeof *g->cell, compare_cells);
}

size_t check_grid_find(const struct check_grid *g, uint64_t key)
{
	size_t low = 0, high = g->n;

	while (low < high) {
		size_t middle = low + (high - low) / 2;

		if (g->cell[middle].key < key)
			low = middle + 1;
		else
			high = middle;
	}
	return low;
}
