/* Sums of products of 128-bit numbers, exact: for signs of determinants that do not fit 128 bits; their common divisor, and
 * quotients rounded down. */
#ifndef WIDE_H
#define WIDE_H

#include <math.h>
#include <stdint.h>

struct wide {
	unsigned __int128 low;
	__int128 high;
};

static inline struct wide wide_negative(struct wide a)
{
	return (struct wide){-a.low, (__int128)(~(unsigned __int128)a.high + !a.low)};
}

static inline struct wide wide_product(__int128 a, __int128 b)
{
	const unsigned __int128 x = a < 0 ? -(unsigned __int128)a : (unsigned __int128)a, mask = UINT64_MAX;
	const unsigned __int128 y = b < 0 ? -(unsigned __int128)b : (unsigned __int128)b;
	const unsigned __int128 ll = (x & mask) * (y & mask), lh = (x & mask) * (y >> 64), hl = (x >> 64) * (y & mask);
	const unsigned __int128 middle = (ll >> 64) + (lh & mask) + (hl & mask);
	const struct wide p = {(ll & mask) | middle << 64,
			       (__int128)((x >> 64) * (y >> 64) + (lh >> 64) + (hl >> 64) + (middle >> 64))};

	return (a < 0) != (b < 0) ? wide_negative(p) : p;
}

static inline struct wide wide_sum(struct wide a, struct wide b)
{
	const unsigned __int128 low = a.low + b.low;

	return (struct wide){low, (__int128)((unsigned __int128)a.high + (unsigned __int128)b.high + (low < a.low))};
}

static inline int wide_sign(struct wide a)
{
	return a.high < 0 ? -1 : a.high || a.low;
}

/* The greatest common divisor, of numbers of either sign; 0 of two zeros. */
static inline __int128 wide_gcd(__int128 a, __int128 b)
{
	while (b) {
		const __int128 rest = a % b;

		a = b;
		b = rest;
	}
	return a < 0 ? -a : a;
}

/* n / d, rounded down; d > 0. */
static inline __int128 wide_floor(__int128 n, __int128 d)
{
	const __int128 i = n / d;

	return i * d > n ? i - 1 : i;
}

/* Near: some units in the last place. */
static inline double wide_double(struct wide a)
{
	const struct wide size = a.high < 0 ? wide_negative(a) : a;
	const double v = ldexp((double)size.high, 128) + (double)size.low;

	return a.high < 0 ? -v : v;
}

#endif
