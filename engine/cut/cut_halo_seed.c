/*
 * The region's own positions: they stand in the chains for what lies inside, so that few cells outside are hits from
 * the start. All of them are looked at, few get as far as an exact test.
 */
#include "cut_halo_priv.h"

static int seed_add(struct cut_halo *h, unsigned chain, const struct mesh_vertex *v)
{
	/* Stands for its position only: never part of the result. */
	const struct point p = { .x = v->x, .y = v->y, .z = v->z };

	return cut_halo_add(h, chain, &p);
}

/*
 * The nearest own position of each column first (of many positions, of every eighth: they lie in Morton order, so
 * these are everywhere): they make a hull that is nearly the last one. Then all others, against the column's bound
 * of |X| (one comparison each) before the exact test.
 */
static int seed_chain(struct cut_halo *h, unsigned chain, const struct mesh_vertex *own, uint32_t n)
{
	struct cut_chain *c = &h->chain[chain];
	uint32_t base = c->vertical ? h->region.y : h->region.x;
	unsigned w = c->vertical ? h->region.wy : h->region.wx, shift = w > 10 ? w - 10 : 0;
	uint32_t stride = n > SEED_MANY ? 8 : 1;
	int rc = 0;

	for (unsigned i = 0; i < SEED_COLUMNS; i++) {
		h->seed.nearest[i] = NONE;
		h->seed.limit[i] = INT64_MAX;
	}
	for (uint32_t i = 0; i < n; i += stride) {
		uint32_t along = (uint32_t)(c->vertical ? own[i].y : own[i].x) + 0x80000000u - base;
		int64_t x = 2 * (int64_t)(c->vertical ? own[i].x : own[i].y) - c->c2;

		x = x < 0 ? -x : x;
		if (x < h->seed.limit[along >> shift]) {
			h->seed.limit[along >> shift] = x;
			h->seed.nearest[along >> shift] = i;
		}
	}
	for (unsigned i = 0; i < SEED_COLUMNS && !rc; i++)
		if (h->seed.nearest[i] != NONE)
			rc = seed_add(h, chain, &own[h->seed.nearest[i]]);
	if (!rc)
		rc = cut_halo_flush(h, chain);
	if (rc)
		return rc;
	cut_chain_limits(c, 2 * ((int64_t)base - ((int64_t)1 << 31)), shift + 1, SEED_COLUMNS, h->seed.limit);
	for (uint32_t i = 0; i < n && !rc; i++) {
		uint32_t along = (uint32_t)(c->vertical ? own[i].y : own[i].x) + 0x80000000u - base;
		int64_t x = 2 * (int64_t)(c->vertical ? own[i].x : own[i].y) - c->c2;

		x = x < 0 ? -x : x;
		if (x <= h->seed.limit[along >> shift])
			rc = seed_add(h, chain, &own[i]);
	}
	return rc ? rc : cut_halo_flush(h, chain);
}

int cut_halo_seed(struct cut_halo *h, const struct mesh_vertex *own, uint32_t n)
{
	if (n == 0) {
		h->columns = 16;
		return 0;
	}
	for (unsigned i = 0; i < h->nchain; i++) {
		int rc = seed_chain(h, i, own, n);

		if (rc)
			return rc;
	}
	return 0;
}
