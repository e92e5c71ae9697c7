/*
 * Sorting points. A record is rewritten in place as two 64-bit numbers whose order is the order of
 * point_compare: the Morton key, and the rest (z, class, returns, flags, source). Those are sorted by
 * radix, digits where all keys agree being skipped, and rewritten as records at the end. No allocation, no
 * recursion that grows with the data, and time that does not depend on the order or on duplicates.
 *
 * From MSD_LEAST records on, one pass over the highest varying bits first parts them into buckets that
 * stay in the cache for the passes that follow.
 */
#include <stdbool.h>
#include <string.h>

#include "point.h"

struct pair {
	uint64_t key, rest;
};

_Static_assert(sizeof(struct pair) == sizeof(struct point), "records are rewritten in place");

enum {
	DIGIT_BITS = 8,
	DIGITS = 1 << DIGIT_BITS,
	MSD_BITS = 11,
	MSD_BUCKETS = 1 << MSD_BITS,
	MSD_LEAST = 1 << 15,
	INSERTION_MOST = 48,
};

static inline struct pair pair_of(const struct point *p)
{
	uint64_t tag = (p->tag & POINT_FLAGS) << 12 | p->tag >> POINT_SOURCE_SHIFT;

	return (struct pair){
		point_morton(p->x, p->y),
		(uint64_t)((uint32_t)p->z ^ 0x80000000u) << 32 | (uint64_t)p->cls << 24 |
			(uint64_t)p->ret << 16 | tag,
	};
}

static inline struct point point_of(struct pair q)
{
	struct point p;

	point_from_morton(q.key, &p.x, &p.y);
	p.z = (int32_t)((uint32_t)(q.rest >> 32) ^ 0x80000000u);
	p.cls = (uint8_t)(q.rest >> 24);
	p.ret = (uint8_t)(q.rest >> 16);
	p.tag = (uint16_t)((q.rest & 0xfff) << POINT_SOURCE_SHIFT | (q.rest >> 12 & POINT_FLAGS));
	return p;
}

static inline uint64_t pair_number(const struct pair *q, bool rest)
{
	return rest ? q->rest : q->key;
}

static inline bool pair_less(const struct pair *a, const struct pair *b)
{
	return a->key < b->key || (a->key == b->key && a->rest < b->rest);
}

static void insertion(struct pair *a, size_t n)
{
	for (size_t i = 1; i < n; i++) {
		struct pair q = a[i];
		size_t j = i;

		for (; j > 0 && pair_less(&q, &a[j - 1]); j--)
			a[j] = a[j - 1];
		a[j] = q;
	}
}

/* The bits of the key (or of the rest) in which the n records differ. */
static uint64_t varying(const struct pair *a, size_t n, bool rest)
{
	uint64_t all = UINT64_MAX, any = 0;

	for (size_t i = 0; i < n; i++) {
		uint64_t v = pair_number(&a[i], rest);

		all &= v;
		any |= v;
	}
	return all ^ any;
}

/* One stable pass by the digit at `shift`. */
static void pass(const struct pair *from, struct pair *to, size_t n, unsigned shift, bool rest)
{
	uint32_t at[DIGITS] = {0};
	uint32_t sum = 0;

	for (size_t i = 0; i < n; i++)
		at[pair_number(&from[i], rest) >> shift & (DIGITS - 1)]++;
	for (unsigned d = 0; d < DIGITS; d++) {
		uint32_t count = at[d];

		at[d] = sum;
		sum += count;
	}
	for (size_t i = 0; i < n; i++)
		to[at[pair_number(&from[i], rest) >> shift & (DIGITS - 1)]++] = from[i];
}

/* Least significant digit first, over the bits that vary; the result is in `a`. */
static void radix(struct pair *a, struct pair *b, size_t n, uint64_t vary, bool rest)
{
	struct pair *from = a, *to = b;

	while (vary) {
		unsigned shift = (unsigned)__builtin_ctzll(vary);

		pass(from, to, n, shift, rest);
		struct pair *t = from;

		from = to;
		to = t;
		vary = shift + DIGIT_BITS >= 64 ? 0 : vary >> (shift + DIGIT_BITS) << (shift + DIGIT_BITS);
	}
	if (from != a)
		memcpy(a, from, n * sizeof *a);
}

/* Records of one key, by the rest. */
static void ties(struct pair *a, struct pair *b, size_t n)
{
	for (size_t i = 0, end; i < n; i = end) {
		for (end = i + 1; end < n && a[end].key == a[i].key;)
			end++;
		if (end - i > INSERTION_MOST)
			radix(a + i, b, end - i, varying(a + i, end - i, true), true);
		else if (end - i > 1)
			insertion(a + i, end - i);
	}
}

static void small(struct pair *a, struct pair *b, size_t n)
{
	if (n <= INSERTION_MOST) {
		insertion(a, n);
		return;
	}
	uint64_t vary = varying(a, n, false);

	radix(a, b, n, vary, false);
	ties(a, b, n);
}

/* Parts a[0..n) by its highest varying bits into b, sorts the parts, and leaves them in a. */
static void parted(struct pair *a, struct pair *b, size_t n, uint64_t vary)
{
	uint32_t start[MSD_BUCKETS + 1] = {0}, at[MSD_BUCKETS];
	unsigned top = 64 - (unsigned)__builtin_clzll(vary), shift = top > MSD_BITS ? top - MSD_BITS : 0;

	for (size_t i = 0; i < n; i++)
		start[(a[i].key >> shift & (MSD_BUCKETS - 1)) + 1]++;
	for (unsigned d = 0; d < MSD_BUCKETS; d++) {
		start[d + 1] += start[d];
		at[d] = start[d];
	}
	for (size_t i = 0; i < n; i++)
		b[at[a[i].key >> shift & (MSD_BUCKETS - 1)]++] = a[i];
	for (unsigned d = 0; d < MSD_BUCKETS; d++) {
		size_t first = start[d], count = start[d + 1] - first;

		small(b + first, a + first, count);
		memcpy(a + first, b + first, count * sizeof *a);
	}
}

void point_sort(struct point *pts, struct point *scratch, size_t n)
{
	struct pair *a = (struct pair *)pts, *b = (struct pair *)scratch;
	uint64_t all = UINT64_MAX, any = 0;

	for (size_t i = 0; i < n; i++) {
		struct pair q = pair_of(&pts[i]);

		a[i] = q;
		all &= q.key;
		any |= q.key;
	}
	if (n >= MSD_LEAST && all != any)
		parted(a, b, n, all ^ any);
	else
		small(a, b, n);
	for (size_t i = 0; i < n; i++)
		pts[i] = point_of(a[i]);
}
