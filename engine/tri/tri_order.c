/*
 * The order of insertion: rounds of growing size (biased randomized insertion order), each in the order of the input, which is
 * Morton order (algorithm.md 10).
 *
 * A position moves to the next smaller round with probability 1/8, by a fixed hash of its coordinates. The smallest round is
 * first. Every second round goes backwards, so a round begins near the end of the previous one. Nothing is random: the same input
 * gives the same order.
 */
#include "tri_priv.h"

enum { ROUND_BITS = 3, ROUND_MAX = 9 };

/* How many rounds a position moves down: k or more with probability 8^-k. */
static inline unsigned round_of(const struct mesh_vertex *v)
{
	uint64_t h = ((uint64_t)(uint32_t)v->x << 32 | (uint32_t)v->y) * UINT64_C(0x9e3779b97f4a7c15);

	h = (h ^ h >> 32) * UINT64_C(0xd6e8feb86659fd93);
	return (unsigned)__builtin_ctzll(h >> 32 | UINT64_C(1) << (ROUND_BITS * ROUND_MAX)) / ROUND_BITS;
}

static struct tri_extent extent_and_rounds(const struct mesh_vertex *in, uint32_t n, uint32_t count[ROUND_MAX + 1])
{
	struct tri_extent e = {{INT32_MAX, INT32_MAX}, {INT32_MIN, INT32_MIN}};

	for (uint32_t i = 0; i < n; i++) {
		const struct mesh_vertex *v = &in[i];

		e.min[0] = v->x < e.min[0] ? v->x : e.min[0];
		e.max[0] = v->x > e.max[0] ? v->x : e.max[0];
		e.min[1] = v->y < e.min[1] ? v->y : e.min[1];
		e.max[1] = v->y > e.max[1] ? v->y : e.max[1];
		count[round_of(v)]++;
	}
	return e;
}

void tri_order(struct tri *t, const struct mesh_vertex *in, uint32_t n)
{
	uint32_t count[ROUND_MAX + 1] = {0}, place[ROUND_MAX + 1], sum = 0;

	t->extent = extent_and_rounds(in, n, count);
	for (unsigned r = ROUND_MAX + 1; r-- > 0;) {
		sum += count[r];
		place[r] = r & 1 ? sum - 1 : sum - count[r];
	}
	for (uint32_t i = 0; i < n; i++) {
		unsigned r = round_of(&in[i]);
		uint32_t at = place[r];

		place[r] += r & 1 ? UINT32_MAX : 1;
		t->xy[at][0] = in[i].x;
		t->xy[at][1] = in[i].y;
		t->z[at] = in[i].z;
		t->id[at] = i;
	}
}
