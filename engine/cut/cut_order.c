/*
 * Sorting without extra memory: introsort (quicksort that falls back to heapsort), so that no order of points costs
 * more than n log n. qsort of the C library may allocate, which a domain must not.
 */
#include "cut_order.h"

static void swap(struct point *a, struct point *b)
{
	struct point t = *a;

	*a = *b;
	*b = t;
}

static void insertion(struct point *pts, size_t n, cut_less_fn less, const void *ctx)
{
	for (size_t i = 1; i < n; i++) {
		struct point p = pts[i];
		size_t j = i;

		for (; j > 0 && less(ctx, &p, &pts[j - 1]); j--)
			pts[j] = pts[j - 1];
		pts[j] = p;
	}
}

static void sift(struct point *pts, size_t root, size_t n, cut_less_fn less, const void *ctx)
{
	for (;;) {
		size_t child = 2 * root + 1;

		if (child >= n)
			return;
		if (child + 1 < n && less(ctx, &pts[child], &pts[child + 1]))
			child++;
		if (!less(ctx, &pts[root], &pts[child]))
			return;
		swap(&pts[root], &pts[child]);
		root = child;
	}
}

static void heap(struct point *pts, size_t n, cut_less_fn less, const void *ctx)
{
	for (size_t i = n / 2; i-- > 0;)
		sift(pts, i, n, less, ctx);
	for (size_t i = n; i-- > 1;) {
		swap(&pts[0], &pts[i]);
		sift(pts, 0, i, less, ctx);
	}
}

/* Moves the median of three to the front, then Hoare's partition; returns the place of the pivot. */
static size_t partition(struct point *pts, size_t n, cut_less_fn less, const void *ctx)
{
	size_t mid = n / 2, last = n - 1, i = 0, j = n;
	struct point pivot;

	if (less(ctx, &pts[mid], &pts[0]))
		swap(&pts[mid], &pts[0]);
	if (less(ctx, &pts[last], &pts[0]))
		swap(&pts[last], &pts[0]);
	if (less(ctx, &pts[last], &pts[mid]))
		swap(&pts[last], &pts[mid]);
	swap(&pts[0], &pts[mid]);
	pivot = pts[0];
	for (;;) {
		do
			i++;
		while (i < n && less(ctx, &pts[i], &pivot));
		do
			j--;
		while (less(ctx, &pivot, &pts[j]));
		if (i >= j)
			break;
		swap(&pts[i], &pts[j]);
	}
	swap(&pts[0], &pts[j]);
	return j;
}

static void sort(struct point *pts, size_t n, unsigned depth, cut_less_fn less, const void *ctx)
{
	while (n > 24) {
		size_t p;

		if (depth-- == 0) {
			heap(pts, n, less, ctx);
			return;
		}
		p = partition(pts, n, less, ctx);
		/* The smaller part by recursion, the larger one in the loop: at most log n frames. */
		if (p < n - p - 1) {
			sort(pts, p, depth, less, ctx);
			pts += p + 1;
			n -= p + 1;
		} else {
			sort(pts + p + 1, n - p - 1, depth, less, ctx);
			n = p;
		}
	}
	insertion(pts, n, less, ctx);
}

void cut_order_sort(struct point *pts, size_t n, cut_less_fn less, const void *ctx)
{
	unsigned depth = 2;

	for (size_t m = n; m; m >>= 1)
		depth += 2;
	sort(pts, n, depth, less, ctx);
}
