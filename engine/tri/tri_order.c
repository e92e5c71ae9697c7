/*
 * The order of insertion: rounds of growing size (biased randomized insertion order), each along a Hilbert curve
 * (algorithm.md 10).
 *
 * A position moves to the next smaller round with probability 1/4, by a fixed hash of its coordinates. The smallest
 * round is first. Every second round follows the curve backwards, so a round begins near the end of the previous one.
 * The curve has 2^12 steps on each axis of the bounding square: as many as two passes of a radix sort can handle, and
 * far more cells than a round has positions. If many positions of a round share a cell nevertheless (tight clusters far
 * apart), they are sorted along a curve of their own, recursively until its steps are single lattice units. Nothing is
 * random: the same input gives the same order.
 *
 * The scratch holds two arrays of curve position << 32 | index in the input.
 */
#include "tri_priv.h"

#include <string.h>

enum {
	ROUND_MAX = 14,
	CURVE_STEP_BITS = 4, /* bits of each axis that one table look-up handles */
	CURVE_STATES = 4,    /* bit 0: axes swapped, bit 1: both axes inverted */
	CURVE_CELLS = 1 << (2 * CURVE_STEP_BITS),
	CURVE_BITS = 12,         /* on each axis */
	DIGIT_BITS = CURVE_BITS, /* of the radix sort: two passes */
	DIGITS = 1 << DIGIT_BITS,
	SORT_FEW = 48,  /* below this, insertion sort is faster */
	CELL_MANY = 12, /* positions in a cell that justify a curve of their own */
};

struct curve {
	uint16_t step[CURVE_STATES][CURVE_CELLS]; /* curve bits << 2 | next state, by x bits << 4 | y bits */
	int32_t min[2];
	uint64_t mul; /* cells per unit, times 2^32 */
};

/*
 * The curve visits the quarters (x, y) = (0,0), (0,1), (1,1), (1,0). In the first one its axes are swapped, in the last
 * one swapped and inverted. The two operations commute, so two bits describe the orientation of a cell.
 */
static uint16_t curve_step(unsigned state, unsigned x, unsigned y)
{
	unsigned place = 0;

	for (int bit = CURVE_STEP_BITS - 1; bit >= 0; bit--) {
		unsigned flip = state >> 1, swap = state & 1;
		unsigned bx = (x >> bit & 1) ^ flip, by = (y >> bit & 1) ^ flip;
		unsigned u = swap ? by : bx, v = swap ? bx : by;

		place = place << 2 | (u << 1) | (u ^ v);
		if (!v)
			state ^= u ? 3 : 1;
	}
	return (uint16_t)(place << 2 | state);
}

static void curve_init(struct curve *c)
{
	for (unsigned s = 0; s < CURVE_STATES; s++)
		for (unsigned i = 0; i < CURVE_CELLS; i++)
			c->step[s][i] = curve_step(s, i >> CURVE_STEP_BITS, i & ((1 << CURVE_STEP_BITS) - 1));
}

static void curve_over(struct curve *c, const struct tri_extent *extent)
{
	uint64_t width = (uint64_t)((int64_t)extent->max[0] - extent->min[0]);
	uint64_t height = (uint64_t)((int64_t)extent->max[1] - extent->min[1]);

	memcpy(c->min, extent->min, sizeof(c->min));
	c->mul = (UINT64_C(1) << (32 + CURVE_BITS)) / ((width > height ? width : height) + 1);
}

/* The position on the curve, 24 bits. */
static inline uint32_t curve_place(const struct curve *c, const struct mesh_vertex *v)
{
	uint32_t x = (uint32_t)(((uint32_t)v->x - (uint32_t)c->min[0]) * c->mul >> 32);
	uint32_t y = (uint32_t)(((uint32_t)v->y - (uint32_t)c->min[1]) * c->mul >> 32);
	uint32_t place = 0, state = 0;

	for (int shift = CURVE_BITS - CURVE_STEP_BITS; shift >= 0; shift -= CURVE_STEP_BITS) {
		uint32_t cell = (x >> shift & 15) << CURVE_STEP_BITS | (y >> shift & 15);
		uint32_t step = c->step[state][cell];

		place = place << (2 * CURVE_STEP_BITS) | step >> 2;
		state = step & 3;
	}
	return place;
}

/* How many rounds a position moves down: k or more with probability 4^-k. */
static inline unsigned round_of(const struct mesh_vertex *v)
{
	uint64_t h = ((uint64_t)(uint32_t)v->x << 32 | (uint32_t)v->y) * UINT64_C(0x9e3779b97f4a7c15);

	h = (h ^ h >> 32) * UINT64_C(0xd6e8feb86659fd93);
	return (unsigned)__builtin_ctzll(h >> 32 | UINT64_C(1) << (2 * ROUND_MAX)) / 2;
}

static inline void extent_add(struct tri_extent *e, const struct mesh_vertex *v)
{
	e->min[0] = v->x < e->min[0] ? v->x : e->min[0];
	e->max[0] = v->x > e->max[0] ? v->x : e->max[0];
	e->min[1] = v->y < e->min[1] ? v->y : e->min[1];
	e->max[1] = v->y > e->max[1] ? v->y : e->max[1];
}

static const struct tri_extent nowhere = {{INT32_MAX, INT32_MAX}, {INT32_MIN, INT32_MIN}};

static void extent_and_rounds(const struct mesh_vertex *in, uint32_t n, struct tri_extent *ret, uint32_t count[ROUND_MAX + 1])
{
	struct tri_extent e = nowhere;

	for (uint32_t i = 0; i < n; i++) {
		extent_add(&e, &in[i]);
		count[round_of(&in[i])]++;
	}
	*ret = e;
}

static void sort_few(uint64_t *key, uint32_t n)
{
	for (uint32_t i = 1; i < n; i++) {
		uint64_t v = key[i];
		uint32_t at = i;

		for (; at > 0 && key[at - 1] > v; at--)
			key[at] = key[at - 1];
		key[at] = v;
	}
}

static void sort_pass(const uint64_t *from, uint64_t *to, uint32_t n, uint32_t place[DIGITS], unsigned shift)
{
	uint32_t sum = 0;

	for (unsigned d = 0; d < DIGITS; d++) {
		uint32_t count = place[d];

		place[d] = sum;
		sum += count;
	}
	for (uint32_t i = 0; i < n; i++)
		to[place[from[i] >> shift & (DIGITS - 1)]++] = from[i];
}

/* Sorts by the position on the curve, stable. `other`: room for as many. */
static void sort_round(uint64_t *key, uint64_t *other, uint32_t n)
{
	uint32_t count[2][DIGITS];

	if (n < SORT_FEW) {
		sort_few(key, n);
		return;
	}
	memset(count, 0, sizeof(count));
	for (uint32_t i = 0; i < n; i++) {
		uint64_t v = key[i] >> 32;

		count[0][v & (DIGITS - 1)]++;
		count[1][v >> DIGIT_BITS & (DIGITS - 1)]++;
	}
	sort_pass(key, other, n, count[0], 32);
	sort_pass(other, key, n, count[1], 32 + DIGIT_BITS);
}

/*
 * Positions of a sorted round that share a cell of the curve, if they are many, are sorted along a curve over their own
 * box. A cell of the first curve is at most 2^20 units wide, of the second 2^8, of the third one unit; this bounds the
 * recursion.
 */
static void sort_cells(struct curve *curve, const struct mesh_vertex *in, uint64_t *key, uint64_t *other, uint32_t n,
		       uint32_t backwards)
{
	for (uint32_t first = 0, end; first < n; first = end) {
		struct tri_extent box = nowhere;

		for (end = first + 1; end < n && key[end] >> 32 == key[first] >> 32;)
			end++;
		if (end - first < CELL_MANY)
			continue;
		for (uint32_t i = first; i < end; i++)
			extent_add(&box, &in[(uint32_t)key[i]]);
		curve_over(curve, &box);
		for (uint32_t i = first; i < end; i++) {
			uint32_t at = (uint32_t)key[i];

			key[i] = (uint64_t)(curve_place(curve, &in[at]) ^ backwards) << 32 | at;
		}
		sort_round(key + first, other + first, end - first);
		sort_cells(curve, in, key + first, other + first, end - first, backwards);
	}
}

static void vertices_place(struct tri *t, const struct mesh_vertex *in, const uint64_t *order, uint32_t n)
{
	enum { AHEAD = 24 };

	for (uint32_t i = 0; i < n; i++) {
		uint32_t from = (uint32_t)order[i];

		if (i + AHEAD < n)
			__builtin_prefetch(&in[(uint32_t)order[i + AHEAD]]);
		t->xy[i][0] = in[from].x;
		t->xy[i][1] = in[from].y;
		t->z[i] = in[from].z;
		t->id[i] = from;
	}
}

static inline uint32_t round_direction(unsigned round)
{
	return 0u - (round & 1);
}

void tri_order(struct tri *t, const struct mesh_vertex *in, uint64_t *scratch, uint32_t n, struct tri_extent *ret)
{
	uint32_t count[ROUND_MAX + 1] = {0}, place[ROUND_MAX + 1], sum = 0;
	uint64_t *key = scratch, *other = scratch + n;
	struct curve curve;

	extent_and_rounds(in, n, ret, count);
	curve_init(&curve);
	curve_over(&curve, ret);
	for (unsigned r = ROUND_MAX + 1; r-- > 0;) {
		place[r] = sum;
		sum += count[r];
	}
	for (uint32_t i = 0; i < n; i++) {
		unsigned r = round_of(&in[i]);

		key[place[r]++] = (uint64_t)(curve_place(&curve, &in[i]) ^ round_direction(r)) << 32 | i;
	}
	for (unsigned r = 0; r <= ROUND_MAX; r++) {
		uint32_t first = place[r] - count[r];

		sort_round(key + first, other + first, count[r]);
		sort_cells(&curve, in, key + first, other + first, count[r], round_direction(r));
	}
	vertices_place(t, in, key, n);
}
