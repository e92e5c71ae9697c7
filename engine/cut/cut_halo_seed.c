/*
 * Seeding with the region's own positions. They represent the inside of the region in the chains, so that few cells
 * outside are hits from the start.
 *
 * They are in Morton order, so blocks of them have small boxes. Of the blocks nearest to a border, the nearest position
 * of each column makes a hull that is nearly final. Then positions within a column's bound of |X| are tested exactly,
 * and blocks beyond it are skipped.
 */
#include "cut_halo_priv.h"

enum { COLUMN_BITS_MOST = 10, GROUP = 4 /* log2 */ };
_Static_assert(1 << COLUMN_BITS_MOST == SEED_COLUMNS && SEED_COLUMNS >> GROUP == SEED_GROUPS, "columns");

/* The own positions relative to one border. */
struct seeding {
	const struct mesh_vertex *own;
	uint32_t n;
	unsigned block;  /* log2 of the positions of a block */
	unsigned across; /* 0: x, 1: y */
	int64_t c2;
	uint32_t base; /* start and width of its columns */
	unsigned shift, columns, blocks;
};

static int64_t distance(const struct seeding *s, int32_t v)
{
	int64_t x = 2 * (int64_t)v - s->c2;

	return x < 0 ? -x : x;
}

static uint32_t column(const struct seeding *s, int32_t v)
{
	return ((uint32_t)v + 0x80000000u - s->base) >> s->shift;
}

static int32_t coordinate(const struct mesh_vertex *v, unsigned axis)
{
	return axis ? v->y : v->x;
}

static uint32_t block_end(const struct seeding *s, uint32_t b)
{
	uint32_t end = (b + 1) << s->block;

	return end < s->n ? end : s->n;
}

static void box_blocks(struct cut_halo *h, const struct seeding *s)
{
	for (uint32_t i = 0, b = 0; i < s->n; b++) {
		uint32_t end = block_end(s, b);
		int32_t x0 = s->own[i].x, x1 = x0, y0 = s->own[i].y, y1 = y0;

		for (i++; i < end; i++) {
			int32_t x = s->own[i].x, y = s->own[i].y;

			x0 = x < x0 ? x : x0;
			x1 = x > x1 ? x : x1;
			y0 = y < y0 ? y : y0;
			y1 = y > y1 ? y : y1;
		}
		h->seed.box[b][0] = x0;
		h->seed.box[b][1] = y0;
		h->seed.box[b][2] = x1;
		h->seed.box[b][3] = y1;
	}
}

/* Distance of the block's box from the border: of its near side and its far side. A region is on one side of its border. */
static void block_gap(const struct seeding *s, const int32_t box[4], int64_t *ret_near, int64_t *ret_far)
{
	int64_t a = distance(s, box[s->across]), b = distance(s, box[s->across + 2]);

	*ret_near = a < b ? a : b;
	*ret_far = a < b ? b : a;
}

/* The next block from *b on that is within the limit of one of its groups of columns; false: there is none. */
static bool next_block(const struct cut_halo *h, const struct seeding *s, uint32_t *b)
{
	for (; *b < s->blocks; ++*b) {
		const int32_t *box = h->seed.box[*b];
		uint32_t last = column(s, box[3 - s->across]) >> GROUP;
		int64_t near, far;

		block_gap(s, box, &near, &far);
		for (uint32_t k = column(s, box[1 - s->across]) >> GROUP; k <= last; k++)
			if (near <= h->seed.most[k])
				return true;
	}
	return false;
}

/* Records the nearest positions of a block in their columns. `s` is a copy, so that the compiler knows that no write
 * changes it. */
static void block_nearest(struct cut_halo *h, const struct seeding s, uint32_t b)
{
	for (uint32_t i = b << s.block, end = block_end(&s, b); i < end; i++) {
		uint32_t k = column(&s, coordinate(&s.own[i], 1 - s.across));
		int64_t x = distance(&s, coordinate(&s.own[i], s.across));

		if (x < h->seed.x[k]) {
			h->seed.x[k] = x;
			h->seed.nearest[k] = i;
		}
	}
}

/* Finds the nearest position of each column, from the blocks nearest to the border. */
static void find_nearest(struct cut_halo *h, const struct seeding *s)
{
	for (unsigned k = 0; k < s->columns; k++) {
		h->seed.nearest[k] = NONE;
		h->seed.x[k] = h->seed.most[k >> GROUP] = INT64_MAX;
	}
	for (uint32_t b = 0; b < s->blocks; b++) {
		const int32_t *box = h->seed.box[b];
		uint32_t last = column(s, box[3 - s->across]) >> GROUP;
		int64_t near, far;

		block_gap(s, box, &near, &far);
		near += (far - near) / 4;
		for (uint32_t k = column(s, box[1 - s->across]) >> GROUP; k <= last; k++)
			h->seed.most[k] = near < h->seed.most[k] ? near : h->seed.most[k];
	}
	for (uint32_t b = 0; next_block(h, s, &b); b++)
		block_nearest(h, *s, b);
}

/* Sets the limit of each column, and of each group of columns. */
static void find_limits(struct cut_halo *h, const struct cut_chain *c, const struct seeding *s)
{
	cut_chain_limits(c, 2 * ((int64_t)s->base - ((int64_t)1 << 31)), s->shift + 1, s->columns, h->seed.limit);
	for (unsigned k = 0; k < s->columns; k++)
		if (k % (1u << GROUP) == 0 || h->seed.limit[k] > h->seed.most[k >> GROUP])
			h->seed.most[k >> GROUP] = h->seed.limit[k];
}

static int seed_add(struct cut_halo *h, unsigned chain, const struct mesh_vertex *v)
{
	/* Represents only its position; it is never part of the result. */
	const struct point p = {.x = v->x, .y = v->y, .z = v->z};

	return cut_halo_add(h, chain, &p);
}

static int seed_chain(struct cut_halo *h, unsigned chain, struct seeding *s)
{
	const struct cut_chain *c = &h->chain[chain];
	unsigned w = c->vertical ? h->region.wy : h->region.wx, bits = h->column_bits;
	int rc = 0;

	/* Twice as many columns as the side of a square with so many positions. */
	while (bits < COLUMN_BITS_MOST && s->n >> (2 * bits - 2))
		bits++;
	s->across = c->vertical ? 0 : 1;
	s->c2 = c->c2;
	s->base = c->vertical ? h->region.y : h->region.x;
	s->shift = w > bits ? w - bits : 0;
	s->columns = 1u << bits;
	find_nearest(h, s);
	for (unsigned k = 0; k < s->columns && !rc; k++)
		if (h->seed.nearest[k] != NONE)
			rc = seed_add(h, chain, &s->own[h->seed.nearest[k]]);
	if (!rc)
		rc = cut_halo_flush(h, chain);
	if (rc)
		return rc;
	find_limits(h, c, s);
	for (uint32_t b = 0; !rc && next_block(h, s, &b); b++)
		for (uint32_t i = b << s->block, end = block_end(s, b); i < end && !rc; i++) {
			uint32_t k = column(s, coordinate(&s->own[i], 1 - s->across));

			if (distance(s, coordinate(&s->own[i], s->across)) <= h->seed.limit[k] && i != h->seed.nearest[k])
				rc = seed_add(h, chain, &s->own[i]);
		}
	return rc ? rc : cut_halo_flush(h, chain);
}

int cut_halo_seed(struct cut_halo *h, const struct mesh_vertex *own, uint32_t n)
{
	struct seeding s = {.own = own, .n = n, .block = h->block_bits};

	if (n == 0) {
		h->columns = h->bounded ? COLUMNS : 16;
		return 0;
	}
	while (n >> s.block >= SEED_BLOCKS)
		s.block++;
	s.blocks = ((n - 1) >> s.block) + 1;
	box_blocks(h, &s);
	for (unsigned i = 0; i < h->nchain; i++) {
		int rc = seed_chain(h, i, &s);

		if (rc)
			return rc;
	}
	return 0;
}
