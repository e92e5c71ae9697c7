/*
 * The segments of a grid by the keys that they have records between (grid_priv.h), so that a range of keys finds those that it
 * meets without a look at all others.
 */
#include <stdlib.h>

#include "err.h"
#include "grid_priv.h"
#include "order.h"

static uint32_t leaves_of(size_t segments)
{
	uint32_t leaves = 1;

	while (leaves < segments)
		leaves *= 2;
	return leaves;
}

size_t grid_order_bytes(size_t segments)
{
	return segments * sizeof(uint32_t) + 2 * (size_t)leaves_of(segments) * sizeof(uint64_t);
}

static int by_begin(const void *a, const void *b, void *ctx)
{
	const struct grid_segment *segments = ctx, *p = &segments[*(const uint32_t *)a], *q = &segments[*(const uint32_t *)b];

	return p->lo != q->lo ? (p->lo < q->lo ? -1 : 1) : order_u32(a, b);
}

/* The greatest number of segments that meet at one key, which is the first one of some segment. `end`: n numbers, for sorting. */
static uint32_t depth_of(const struct grid_order *o, const struct grid_segment *segments, uint64_t *end)
{
	uint32_t depth = 0, ended = 0;

	for (uint32_t i = 0; i < o->n; i++)
		end[i] = segments[o->segment[i]].hi;
	qsort(end, o->n, sizeof *end, order_u64);
	for (uint32_t i = 0; i < o->n; i++) {
		while (end[ended] < segments[o->segment[i]].lo)
			ended++;
		depth = i + 1 - ended > depth ? i + 1 - ended : depth;
	}
	return depth;
}

int grid_order_make(struct grid *g, struct err *err)
{
	struct grid_order *o = &g->order;
	size_t n = g->manifest->nsegments;

	o->leaves = leaves_of(n);
	o->segment = malloc((n ? n : 1) * sizeof *o->segment);
	o->end = malloc(2 * (size_t)o->leaves * sizeof *o->end);
	if (!o->segment || !o->end)
		return err_set(err, ERR_NOMEM, "no memory for the order of %zu segments", n);
	for (uint32_t i = 0; i < n; i++)
		if (!g->live[i].none && g->segments[i].height)
			o->segment[o->n++] = i;
	qsort_r(o->segment, o->n, sizeof *o->segment, by_begin, g->segments);
	o->depth = depth_of(o, g->segments, o->end);
	for (uint32_t i = 0; i < o->leaves; i++)
		o->end[o->leaves + i] = i < o->n ? g->segments[o->segment[i]].hi : 0;
	for (uint32_t i = o->leaves; i-- > 1;)
		o->end[i] = o->end[2 * i] > o->end[2 * i + 1] ? o->end[2 * i] : o->end[2 * i + 1];
	return 0;
}

void grid_order_free(struct grid_order *o)
{
	free(o->segment);
	free(o->end);
}

uint32_t grid_order_next(const struct grid_order *o, uint32_t from, uint64_t lo)
{
	uint32_t k = o->leaves + from;

	if (from >= o->n)
		return o->n;
	while (o->end[k] < lo) {
		while (k & 1) /* up, until there is something on the right */
			k >>= 1;
		if (!k)
			return o->n;
		k++;
	}
	while (k < o->leaves) {
		k *= 2;
		k += o->end[k] < lo;
	}
	return k - o->leaves < o->n ? k - o->leaves : o->n;
}
