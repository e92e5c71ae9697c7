/*
 * Sorting points. A record is rewritten in place as two 64-bit numbers whose order is that of point_compare: the Morton
 * key, and the rest (z, class, returns, flags, source). A most significant digit radix sort, alternating between
 * records and scratch, splits them by the highest bits in which their keys differ, until buckets are small enough for
 * an insertion sort. Records with the same key are sorted by the rest, with a radix sort if there are many. Then they
 * are rewritten as records. No allocation; recursion is no deeper than the key has digits; with duplicates it takes up
 * to 1.6 times as long as without.
 */
#include <stdbool.h>
#include <string.h>

#include "point.h"

struct pair {
	uint64_t key, rest;
};

_Static_assert(sizeof(struct pair) == sizeof(struct point), "records are rewritten in place");

enum {
	FIRST_BITS = 11, /* for all records: more buckets would exceed the cache and the TLB */
	DIGIT_BITS = 10,
	/* Of all levels of the recursion: after the first digit, no more than six use up the key. */
	COUNTERS = (1 << FIRST_BITS) + ((64 - FIRST_BITS + DIGIT_BITS - 1) / DIGIT_BITS << DIGIT_BITS),
	STABLE_BITS = 8, /* in a stable pass, often over a few dozen records, which more counters would delay */
	STABLE_DIGITS = 1 << STABLE_BITS,
	LEAST_BITS = 4,
	BUCKET_BITS = 1, /* log2 of the intended number of records in a bucket */
	INSERTION_MOST = 24,
};

static inline struct pair pair_of(const struct point *p)
{
	uint64_t tag = (p->tag & POINT_FLAGS) << 12 | p->tag >> POINT_SOURCE_SHIFT;

	return (struct pair){
		point_morton(p->x, p->y),
		(uint64_t)((uint32_t)p->z ^ 0x80000000u) << 32 | (uint64_t)p->cls << 24 | (uint64_t)p->ret << 16 | tag,
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

/* Sorts from a to `to`, which may be a. */
static void insertion_sort(const struct pair *a, struct pair *to, size_t n)
{
	for (size_t i = 0; i < n; i++) {
		struct pair q = a[i];
		size_t j = i;

		for (; j > 0 && pair_less(&q, &to[j - 1]); j--)
			to[j] = to[j - 1];
		to[j] = q;
	}
}

/* The bits of the key (or of the rest) in which the n records differ. */
static uint64_t varying_bits(const struct pair *a, size_t n, bool rest)
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
static void distribute_stable(const struct pair *from, struct pair *to, size_t n, unsigned shift, bool rest)
{
	uint32_t at[STABLE_DIGITS] = {0};
	uint32_t sum = 0;

	for (size_t i = 0; i < n; i++)
		at[pair_number(&from[i], rest) >> shift & (STABLE_DIGITS - 1)]++;
	for (unsigned d = 0; d < STABLE_DIGITS; d++) {
		uint32_t count = at[d];

		at[d] = sum;
		sum += count;
	}
	for (size_t i = 0; i < n; i++)
		to[at[pair_number(&from[i], rest) >> shift & (STABLE_DIGITS - 1)]++] = from[i];
}

/* Least significant digit first, over the varying bits; the result is in `a`. */
static void radix_sort(struct pair *a, struct pair *b, size_t n, uint64_t vary, bool rest)
{
	struct pair *from = a, *to = b;

	while (vary) {
		unsigned shift = (unsigned)__builtin_ctzll(vary);

		distribute_stable(from, to, n, shift, rest);
		struct pair *t = from;

		from = to;
		to = t;
		vary = shift + STABLE_BITS >= 64 ? 0 : vary >> (shift + STABLE_BITS) << (shift + STABLE_BITS);
	}
	if (from != a)
		memcpy(a, from, n * sizeof *a);
}

/* Sorts records with the same key by the rest; into b if `over`. */
static void sort_same_key(struct pair *a, struct pair *b, size_t n, bool over)
{
	radix_sort(a, b, n, varying_bits(a, n, true), true);
	if (over)
		memcpy(b, a, n * sizeof *a);
}

/* The number of varying bits that splits n records into small buckets without having too many buckets. */
static unsigned bits_for(size_t n, unsigned most)
{
	unsigned bits = 63u - (unsigned)__builtin_clzll(n);

	bits = bits > BUCKET_BITS + LEAST_BITS ? bits - BUCKET_BITS : LEAST_BITS;
	return bits < most ? bits : most;
}

/*
 * Distributes a[0..n) to b by `bits` bits, the highest of which is the highest varying one. at[d] becomes the end of
 * bucket d.
 */
static void distribute(const struct pair *a, struct pair *b, size_t n, uint64_t vary, unsigned bits, uint32_t *at)
{
	unsigned top = 64 - (unsigned)__builtin_clzll(vary), shift = top > bits ? top - bits : 0;
	uint64_t mask = (UINT64_C(1) << bits) - 1;
	uint32_t sum = 0;

	memset(at, 0, sizeof *at << bits);
	for (size_t i = 0; i < n; i++)
		at[a[i].key >> shift & mask]++;
	for (uint64_t d = 0; d <= mask; d++) {
		uint32_t count = at[d];

		at[d] = sum;
		sum += count;
	}
	for (size_t i = 0; i < n; i++)
		b[at[a[i].key >> shift & mask]++] = a[i];
}

/* The result is in a, or in b if `over`; the other is undefined. `at`: the counters for this level and those below it. */
static void sort_by_key(struct pair *a, struct pair *b, size_t n, bool over, uint32_t *at)
{
	uint64_t vary;
	unsigned bits;

	if (n <= INSERTION_MOST) {
		insertion_sort(a, over ? b : a, n);
		return;
	}
	vary = varying_bits(a, n, false);
	if (!vary) {
		sort_same_key(a, b, n, over);
		return;
	}
	bits = bits_for(n, DIGIT_BITS);
	distribute(a, b, n, vary, bits, at);
	for (size_t d = 0, first = 0; d >> bits == 0; first = at[d++])
		if (at[d] > first)
			sort_by_key(b + first, a + first, at[d] - first, !over, at + (1 << bits));
}

void point_sort(struct point *pts, struct point *scratch, size_t n)
{
	struct pair *a = (struct pair *)pts, *b = (struct pair *)scratch;
	uint32_t at[COUNTERS];
	uint64_t all = UINT64_MAX, any = 0;

	for (size_t i = 0; i < n; i++) {
		struct pair q = pair_of(&pts[i]);

		a[i] = q;
		all &= q.key;
		any |= q.key;
	}
	if (n > INSERTION_MOST && all != any) {
		unsigned bits = bits_for(n, FIRST_BITS);

		distribute(a, b, n, all ^ any, bits, at);
		for (size_t d = 0, first = 0; d >> bits == 0; first = at[d++])
			if (at[d] > first)
				sort_by_key(b + first, a + first, at[d] - first, true, at + (1 << bits));
	} else {
		sort_by_key(a, b, n, false, at);
	}
	for (size_t i = 0; i < n; i++)
		pts[i] = point_of(a[i]);
}
