/* Whole numbers of up to 1024 bits: a few operations, for the rare heights that doubles cannot round. */
#include <assert.h>
#include <math.h>
#include <string.h>

#include "dem_priv.h"

typedef unsigned __int128 u128;

struct dem_big dem_big_of(dem_i128 n)
{
	u128 size = n < 0 ? -(u128)n : (u128)n;

	return (struct dem_big){.negative = n < 0, .limb = {(uint64_t)size, (uint64_t)(size >> 64)}};
}

void dem_big_times(struct dem_big *b, uint64_t by)
{
	u128 carry = 0;

	for (int i = 0; i < DEM_LIMBS; i++) {
		carry += (u128)b->limb[i] * by;
		b->limb[i] = (uint64_t)carry;
		carry >>= 64;
	}
	assert(!carry);
}

void dem_big_ten(struct dem_big *b, int power)
{
	while (power-- > 0)
		dem_big_times(b, 10);
}

void dem_big_shift(struct dem_big *b, unsigned bits)
{
	for (; bits >= 63; bits -= 63)
		dem_big_times(b, 1ull << 63);
	dem_big_times(b, 1ull << bits);
}

static int compare_sizes(const struct dem_big *a, const struct dem_big *b)
{
	for (int i = DEM_LIMBS; i--;)
		if (a->limb[i] != b->limb[i])
			return a->limb[i] < b->limb[i] ? -1 : 1;
	return 0;
}

static bool is_zero(const struct dem_big *a)
{
	static const struct dem_big zero;

	return !compare_sizes(a, &zero);
}

struct dem_big dem_big_sum(const struct dem_big *a, const struct dem_big *b)
{
	const struct dem_big *more = compare_sizes(a, b) >= 0 ? a : b, *less = more == a ? b : a;
	struct dem_big ret = {.negative = more->negative};
	bool subtract = a->negative != b->negative;
	uint64_t carry = 0;

	for (int i = 0; i < DEM_LIMBS; i++) {
		u128 n = subtract ? (u128)more->limb[i] - less->limb[i] - carry : (u128)more->limb[i] + less->limb[i] + carry;

		ret.limb[i] = (uint64_t)n;
		carry = (uint64_t)(n >> 64) & 1;
	}
	assert(!carry);
	return ret;
}

int dem_big_compare(const struct dem_big *a, const struct dem_big *b)
{
	int size = compare_sizes(a, b);

	if (is_zero(a) && is_zero(b))
		return 0;
	if (a->negative != b->negative)
		return a->negative ? -1 : 1;
	return a->negative ? -size : size;
}

static unsigned bits_of(const struct dem_big *b)
{
	for (int i = DEM_LIMBS; i--;)
		if (b->limb[i])
			return (unsigned)(64 * i + 64 - __builtin_clzll(b->limb[i]));
	return 0;
}

double dem_big_double(dem_i128 n, int power, uint64_t d)
{
	struct dem_big a = dem_big_of(n < 0 ? -n : n), b = dem_big_of((dem_i128)d);
	uint64_t quotient = 0;
	int shift, bits = 55; /* one more than a double and its rounding bit have */

	if (!n)
		return 0;
	dem_big_ten(power > 0 ? &a : &b, power > 0 ? power : -power);
	/* b << shift is the largest of its kind not above a: the quotient's first bit */
	shift = (int)bits_of(&a) - (int)bits_of(&b);
	dem_big_shift(shift > 0 ? &b : &a, (unsigned)(shift > 0 ? shift : -shift));
	if (compare_sizes(&a, &b) < 0) {
		dem_big_times(&a, 2);
		shift--;
	}
	b.negative = true;
	for (int i = 0; i < bits; i++) {
		bool one = compare_sizes(&a, &b) >= 0;

		quotient = quotient << 1 | one;
		if (one)
			a = dem_big_sum(&a, &b);
		dem_big_times(&a, 2);
	}
	quotient = quotient << 1 | !is_zero(&a); /* so that a tie is one only if it is */
	return (n < 0 ? -1 : 1) * ldexp((double)quotient, shift - bits);
}
