#include "lives.h"

#include <string.h>

#include "cut_order.h"
#include "parts.h"

void lives_records(uint64_t *seed, int32_t range, bool two, struct lives *l)
{
	l->nrecord = 10 + sets_below(seed, SETS_MAX_N - 9);
	for (unsigned i = 0; i < l->nrecord; i++) {
		struct point *p = &l->record[i].p;

		l->record[i].source = sets_below(seed, 3) ? 0 : sets_below(seed, LIVES_SOURCES);
		*p = (struct point){.cls = 1, .ret = 0x11};
		p->x = (int32_t)sets_below(seed, (unsigned)range);
		p->y = (int32_t)sets_below(seed, (unsigned)range);
		p->z = (int32_t)sets_below(seed, 3);
		if (two && !sets_below(seed, 3))
			p->cls = 2;
	}
}

static bool point_less(const void *ctx, const struct point *a, const struct point *b)
{
	(void)ctx;
	return point_compare(a, b) < 0;
}

void lives_lay_out(uint64_t *seed, const struct lives *l, const struct view *view, unsigned live, const unsigned *slot,
		   struct lives_generation *g)
{
	bool by_source = sets_below(seed, 2);
	struct sets *s = &g->set;

	memset(s, 0, sizeof(*s));
	s->segments = TILING_SEGMENTS;
	for (unsigned i = 0; i < l->nrecord; i++) {
		unsigned source = l->record[i].source;
		unsigned at = by_source ? source % TILING_SEGMENTS : sets_below(seed, TILING_SEGMENTS);
		struct point p = l->record[i].p;

		if (slot)
			p.tag |= (uint16_t)(slot[source] << POINT_SLOT_SHIFT);
		if (live >> source & 1)
			s->record[at][s->nrecord[at]++] = p;
	}
	for (unsigned k = 0; k < s->segments; k++)
		cut_order_sort(s->record[k], s->nrecord[k], point_less, NULL);
	sets_reduce(s, view);
	sets_tiling(seed, s, &g->tiling);
	tiling_source(&g->tiling, &g->src);
}

unsigned lives_change(uint64_t *seed, unsigned live)
{
	for (unsigned k = sets_below(seed, 3); k > 0; k--)
		live ^= 1u << (1 + sets_below(seed, LIVES_SOURCES - 1));
	return live;
}

unsigned lives_leaves(uint64_t *seed, const struct lives *l, struct cut_region ret[LIVES_LEAVES])
{
	const struct point *p = &l->record[0].p;
	int32_t box[4] = {p->x, p->y, p->x, p->y};
	unsigned want = 1 + sets_below(seed, LIVES_LEAVES - 1);

	for (unsigned i = 1; i < l->nrecord; i++) {
		p = &l->record[i].p;
		point_box_join(box, (const int32_t[4]){p->x, p->y, p->x, p->y});
	}
	cut_region_root(box, &ret[0]);
	return parts_halve(seed, want, 100, ret);
}
