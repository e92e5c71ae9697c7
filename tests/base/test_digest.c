/*
 * Digests against a second implementation of XXH3-128 from its specification (inputs of 17 to 128 bytes, seed 0), byte
 * by byte, without the library.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <string.h>

#include "digest.h"

static const uint8_t secret[64] = {
	0xb8, 0xfe, 0x6c, 0x39, 0x23, 0xa4, 0x4b, 0xbe, 0x7c, 0x01, 0x81, 0x2c, 0xf7, 0x21, 0xad, 0x1c,
	0xde, 0xd4, 0x6d, 0xe9, 0x83, 0x90, 0x97, 0xdb, 0x72, 0x40, 0xa4, 0xa4, 0xb7, 0xb3, 0x67, 0x1f,
	0xcb, 0x79, 0xe6, 0x4e, 0xcc, 0xc0, 0xe5, 0x78, 0x82, 0x5a, 0xd0, 0x7d, 0xcc, 0xff, 0x72, 0x21,
	0xb8, 0x08, 0x46, 0x74, 0xf7, 0x43, 0x24, 0x8e, 0xe0, 0x35, 0x90, 0xe6, 0x81, 0x3a, 0x26, 0x4c,
};

static const uint64_t prime1 = 0x9e3779b185ebca87u, prime2 = 0xc2b2ae3d27d4eb4fu, prime4 = 0x85ebca77c2b2ae63u;

static uint64_t read64(const uint8_t *b)
{
	uint64_t v = 0;

	for (int i = 7; i >= 0; i--)
		v = v << 8 | b[i];
	return v;
}

static uint64_t mix16(const uint8_t *in, const uint8_t *key)
{
	unsigned __int128 p = (unsigned __int128)(read64(in) ^ read64(key)) * (read64(in + 8) ^ read64(key + 8));

	return (uint64_t)p ^ (uint64_t)(p >> 64);
}

static void mix32(uint64_t *lo, uint64_t *hi, const uint8_t *a, const uint8_t *b, const uint8_t *key)
{
	*lo = (*lo + mix16(a, key)) ^ (read64(b) + read64(b + 8));
	*hi = (*hi + mix16(b, key + 16)) ^ (read64(a) + read64(a + 8));
}

static uint64_t avalanche(uint64_t h)
{
	h = (h ^ h >> 37) * 0x165667919e3779f9u;
	return h ^ h >> 32;
}

static struct digest hash_again(const uint8_t *in, size_t n)
{
	uint64_t lo = n * prime1, hi = 0;

	assert_true(n > 16 && n <= 64);
	if (n > 32)
		mix32(&lo, &hi, in + 16, in + n - 32, secret + 32);
	mix32(&lo, &hi, in, in + n - 16, secret);
	uint64_t low = lo + hi, high = lo * prime1 + hi * prime4 + (uint64_t)n * prime2;

	return (struct digest){(uint64_t)0 - avalanche(high), avalanche(low)};
}

static void put64(uint8_t *b, int64_t v)
{
	for (int i = 0; i < 8; i++)
		b[i] = (uint8_t)((uint64_t)v >> (8 * i));
}

static uint64_t random_state = 3;

static int64_t rnd(void)
{
	uint64_t z = (random_state += 0x9e3779b97f4a7c15u);

	z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
	return (int64_t)(z ^ z >> 27) >> (z & 63);
}

static void test_triangle(void **state)
{
	for (int round = 0; round < 20000; round++) {
		int64_t p[3][2], turned[3][2];
		uint8_t bytes[48];
		struct digest sum = {5, 6}, again = {5, 6}, one;
		int first = 0;

		for (int i = 0; i < 3; i++) {
			p[i][0] = round & 1 ? rnd() : i / 2; /* equal x too */
			p[i][1] = round & 1 ? rnd() : rnd() / 4 * 4 + i;
		}
		for (int i = 1; i < 3; i++)
			if (p[i][0] < p[first][0] || (p[i][0] == p[first][0] && p[i][1] < p[first][1]))
				first = i;
		for (int i = 0; i < 3; i++) {
			put64(bytes + 16 * i, p[(first + i) % 3][0]);
			put64(bytes + 16 * i + 8, p[(first + i) % 3][1]);
		}
		one = hash_again(bytes, sizeof bytes);
		digest_add_triangle(&sum, (const int64_t(*)[2])p);
		assert_true(sum.hi == 5 + one.hi && sum.lo == 6 + one.lo);
		for (int i = 0; i < 3; i++)
			memcpy(turned[i], p[(i + 1 + round % 2) % 3], sizeof turned[i]);
		digest_add_triangle(&again, (const int64_t(*)[2])turned);
		assert_true(digest_equal(sum, again));
	}
	(void)state;
}

/* Many at once give the sum of each alone, whichever corner is the smallest. */
static void test_many(void **state)
{
	for (int round = 0; round < 500; round++) {
		enum { MOST = 70 };
		const int64_t k[2] = {rnd() >> 24, rnd() >> 24};
		struct digest sum = {7, 8}, again = {7, 8};
		uint64_t place[MOST][3];
		size_t n = (size_t)(round % (MOST + 1));

		for (size_t i = 0; i < n; i++) {
			int64_t corner[3][2];

			for (int c = 0; c < 3; c++) {
				/* Sometimes equal x, and both ends of the lattice. */
				int32_t x = round % 3 ? (int32_t)rnd() : (int32_t)(rnd() % 3) - 1, y = (int32_t)rnd();

				if (rnd() % 8 == 0)
					x = rnd() % 2 ? INT32_MIN : INT32_MAX;
				place[i][c] = digest_place(x, y);
				corner[c][0] = x + k[0];
				corner[c][1] = y + k[1];
			}
			digest_add_triangle(&again, (const int64_t(*)[2])corner);
		}
		digest_add_triangles(&sum, (const uint64_t(*)[3])place, n, k);
		assert_true(digest_equal(sum, again));
	}
	(void)state;
}

static void test_many_vertices(void **state)
{
	for (int round = 0; round < 200; round++) {
		enum { MOST = 70 };
		const int64_t k[3] = {rnd() >> 24, rnd() >> 24, rnd() >> 24};
		struct digest sum = {7, 8}, again = {7, 8};
		int32_t vertex[MOST][3];
		size_t n = (size_t)(round % (MOST + 1));

		for (size_t i = 0; i < n; i++) {
			for (int c = 0; c < 3; c++)
				vertex[i][c] = rnd() % 8 ? (int32_t)rnd() : c ? INT32_MIN : INT32_MAX;
			digest_add_vertex(&again, vertex[i][0] + k[0], vertex[i][1] + k[1], vertex[i][2] + k[2]);
		}
		digest_add_vertices(&sum, k, (const int32_t(*)[3])vertex, n);
		assert_true(digest_equal(sum, again));
	}
	(void)state;
}

static void test_orientation_matters(void **state)
{
	int64_t ccw[3][2] = {{0, 0}, {1, 0}, {0, 1}}, cw[3][2] = {{0, 0}, {0, 1}, {1, 0}};
	struct digest a = {0}, b = {0};

	digest_add_triangle(&a, (const int64_t(*)[2])ccw);
	digest_add_triangle(&b, (const int64_t(*)[2])cw);
	assert_false(digest_equal(a, b));
	(void)state;
}

static void test_vertex(void **state)
{
	for (int round = 0; round < 20000; round++) {
		int64_t v[3] = {rnd(), rnd(), rnd()};
		uint8_t bytes[24];
		struct digest sum = {0}, one;

		for (int i = 0; i < 3; i++)
			put64(bytes + 8 * i, v[i]);
		one = hash_again(bytes, sizeof bytes);
		digest_add_vertex(&sum, v[0], v[1], v[2]);
		assert_true(digest_equal(sum, one));
		assert_true(digest_equal(digest_hash(bytes, sizeof bytes), one));
	}
	(void)state;
}

static void test_sums(void **state)
{
	struct digest a = {UINT64_MAX, 1}, zero = {0, 0}, b = {1, UINT64_MAX};

	digest_add(&a, b); /* each half wraps separately: no carry from low to high */
	assert_true(a.hi == 0 && a.lo == 0 && digest_is_zero(a));
	digest_sub(&a, b);
	assert_true(a.hi == UINT64_MAX && a.lo == 1 && !digest_is_zero(a));
	assert_false(digest_equal(a, zero));
	(void)state;
}

static void test_hex(void **state)
{
	static const char *const bad[] = {
		"",
		"0123456789abcdef0123456789abcde",
		"0123456789abcdef0123456789abcdef0",
		"0123456789ABCDEF0123456789abcdef",
		"0123456789abcdefg123456789abcdef",
		" 123456789abcdef0123456789abcdef",
	};
	struct digest d = {0x0123456789abcdefu, 0xfu}, e = {7, 7};
	char hex[DIGEST_HEX_SIZE];

	assert_string_equal(digest_hex(d, hex), "0123456789abcdef000000000000000f");
	assert_true(digest_parse(hex, &e));
	assert_true(digest_equal(d, e));
	for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
		assert_false(digest_parse(bad[i], &e));
	assert_true(digest_equal(d, e));
	(void)state;
}

/* In pieces it is the same as at once. */
static void test_stream(void **state)
{
	uint8_t bytes[5000];

	for (size_t i = 0; i < sizeof bytes; i++)
		bytes[i] = (uint8_t)(i * 31 + (i >> 8));
	for (size_t piece = 1; piece < sizeof bytes; piece = piece * 3 + 1) {
		struct digest_stream *s = digest_stream_new();

		assert_true(digest_equal(digest_stream_end(s), digest_hash(bytes, 0)));
		for (size_t at = 0; at < sizeof bytes; at += piece) {
			digest_stream_add(s, bytes + at, sizeof bytes - at < piece ? sizeof bytes - at : piece);
			if (at == 0)
				assert_true(digest_equal(digest_stream_end(s), digest_hash(bytes, piece)));
		}
		assert_true(digest_equal(digest_stream_end(s), digest_hash(bytes, sizeof bytes)));
		assert_null(digest_stream_free(s));
	}
	assert_null(digest_stream_free(NULL));
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_triangle),      cmocka_unit_test(test_many),
		cmocka_unit_test(test_many_vertices), cmocka_unit_test(test_orientation_matters),
		cmocka_unit_test(test_vertex),        cmocka_unit_test(test_sums),
		cmocka_unit_test(test_hex),           cmocka_unit_test(test_stream),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
