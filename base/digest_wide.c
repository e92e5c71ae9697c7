/*
 * XXH3-128 of four records at once, for x86-64 processors with AVX2: 48 bytes of triangles and 24 of vertices, with seed 0. The
 * specification of xxHash calls this "medium inputs"; the secret's bytes are its default. The multiplications of 64 bits are put
 * together from those of 32. Everything that a sum of hashes depends on is independent of the lanes' order.
 */
#include "digest_wide.h"

#ifdef __x86_64__

#include <immintrin.h>

#include "digest.h"

#define WIDE static inline __attribute__((always_inline, target("avx2")))

enum { LANES = 4 };
typedef uint64_t lanes __attribute__((vector_size(LANES * 8)));

/* The first 64 bytes of the default secret. */
static const uint64_t secret[8] = {
	UINT64_C(0xbe4ba423396cfeb8), UINT64_C(0x1cad21f72c81017c), UINT64_C(0xdb979083e96dd4de), UINT64_C(0x1f67b3b7a4a44072),
	UINT64_C(0x78e5c0cc4ee679cb), UINT64_C(0x2172ffcc7dd05a82), UINT64_C(0x8e2443f7744608b8), UINT64_C(0x4c263a81e69035e0),
};
#define PRIME64_1 UINT64_C(0x9e3779b185ebca87)
#define PRIME64_2 UINT64_C(0xc2b2ae3d27d4eb4f)
#define PRIME64_4 UINT64_C(0x85ebca77c2b2ae63)
#define PRIME_MX1 UINT64_C(0x165667919e3779f9)
#define LOW UINT64_C(0xffffffff)

/* The product of the low halves. */
WIDE lanes mul32(lanes a, lanes b)
{
	return (lanes)_mm256_mul_epu32((__m256i)a, (__m256i)b);
}

WIDE lanes mul64(lanes a, uint64_t b)
{
	const lanes low = (lanes){0} + b, high = low >> 32;

	return mul32(a, low) + ((mul32(a, high) + mul32(a >> 32, low)) << 32);
}

/* The halves of the product of 128 bits of a ^ s[0] and b ^ s[1], xored. */
WIDE lanes fold(lanes a, lanes b, const uint64_t s[2])
{
	lanes low, cross, sum;

	a ^= s[0];
	b ^= s[1];
	low = mul32(a, b);
	cross = mul32(a >> 32, b) + (low >> 32);
	sum = mul32(a, b >> 32) + (cross & LOW);
	return (lanes)_mm256_blend_epi32((__m256i)low, (__m256i)(sum << 32), 0xaa) ^
	       (mul32(a >> 32, b >> 32) + (cross >> 32) + (sum >> 32));
}

WIDE lanes avalanche(lanes h)
{
	h = mul64(h ^ h >> 37, PRIME_MX1);
	return h ^ h >> 32;
}

struct sums {
	lanes hi, lo;
};

/* The end of a hash of `size` bytes, from both accumulators. */
WIDE void sums_add(struct sums *s, lanes hi, lanes lo, uint64_t size)
{
	s->lo += avalanche(hi + lo);
	s->hi -= avalanche(mul64(lo, PRIME64_1) + mul64(hi, PRIME64_4) + size * PRIME64_2);
}

static void sums_end(const struct sums *s, struct digest *sum)
{
	for (unsigned i = 0; i < LANES; i++) {
		sum->hi += s->hi[i];
		sum->lo += s->lo[i];
	}
}

WIDE lanes either(lanes a, lanes b, lanes mask)
{
	return (lanes)_mm256_blendv_pd((__m256d)a, (__m256d)b, (__m256d)mask);
}

static __attribute__((target("avx2"))) void add_triangles(struct digest *sum, const uint64_t (*place)[3], size_t n,
							  const int64_t k[2])
{
	const uint64_t bias = UINT64_C(1) << 31, x0 = (uint64_t)k[0] - bias, y0 = (uint64_t)k[1] - bias;
	struct sums s = {0};

	for (size_t i = 0; i < n; i += LANES) {
		const __m256i *at = (const __m256i *)(const void *)place[i];
		lanes u = (lanes)_mm256_loadu_si256(at), v = (lanes)_mm256_loadu_si256(at + 1),
		      w = (lanes)_mm256_loadu_si256(at + 2);
		lanes p, q, r, second, third, a, b, c, ax, ay, bx, by, cx, cy, hi, lo;

		/* The corners of the triangles 0, 3, 2, 1: elements are blended where they lie, then turned. */
		p = __builtin_shufflevector(__builtin_shufflevector(u, v, 0, 1, 6, 3), w, 0, 5, 2, 3);
		q = __builtin_shufflevector(__builtin_shufflevector(u, v, 4, 1, 2, 7), w, 0, 1, 6, 3);
		r = __builtin_shufflevector(__builtin_shufflevector(u, v, 0, 5, 2, 3), w, 4, 1, 2, 7);
		q = __builtin_shufflevector(q, q, 1, 2, 3, 0);
		r = __builtin_shufflevector(r, r, 2, 3, 0, 1);
		/* The smallest corner is the first. */
		second = (lanes)(q < p);
		third = (lanes)(r < either(p, q, second));
		a = either(either(p, q, second), r, third);
		b = either(either(q, r, second), p, third);
		c = either(either(r, p, second), q, third);
		ax = (a >> 32) + x0, ay = (a & LOW) + y0;
		bx = (b >> 32) + x0, by = (b & LOW) + y0;
		cx = (c >> 32) + x0, cy = (c & LOW) + y0;

		lo = (fold(bx, by, secret + 4) + 48 * PRIME64_1) ^ (bx + by);
		hi = fold(bx, by, secret + 6) ^ (bx + by);
		lo = (lo + fold(ax, ay, secret)) ^ (cx + cy);
		hi = (hi + fold(cx, cy, secret + 2)) ^ (ax + ay);
		sums_add(&s, hi, lo, 48);
	}
	sums_end(&s, sum);
}

static __attribute__((target("avx2"))) void add_vertices(struct digest *sum, const int64_t k[3], const int32_t (*v)[3], size_t n)
{
	struct sums s = {0};

	for (size_t i = 0; i < n; i += LANES) {
		lanes at[3];

		for (unsigned j = 0; j < 3; j++)
			at[j] = (lanes){(uint64_t)v[i][j], (uint64_t)v[i + 1][j], (uint64_t)v[i + 2][j], (uint64_t)v[i + 3][j]} +
				(uint64_t)k[j];
		sums_add(&s, fold(at[1], at[2], secret + 2) ^ (at[0] + at[1]),
			 (fold(at[0], at[1], secret) + 24 * PRIME64_1) ^ (at[1] + at[2]), 24);
	}
	sums_end(&s, sum);
}

static size_t whole(size_t n)
{
	return __builtin_cpu_supports("avx2") ? n - n % LANES : 0;
}

size_t digest_wide_triangles(struct digest *sum, const uint64_t (*place)[3], size_t n, const int64_t k[2])
{
	n = whole(n);
	if (n)
		add_triangles(sum, place, n, k);
	return n;
}

size_t digest_wide_vertices(struct digest *sum, const int64_t k[3], const int32_t (*vertex)[3], size_t n)
{
	n = whole(n);
	if (n)
		add_vertices(sum, k, vertex, n);
	return n;
}

#else

size_t digest_wide_triangles(struct digest *sum, const uint64_t (*place)[3], size_t n, const int64_t k[2])
{
	return 0;
}

size_t digest_wide_vertices(struct digest *sum, const int64_t k[3], const int32_t (*vertex)[3], size_t n)
{
	return 0;
}

#endif
