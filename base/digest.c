/*
 * Digests as sums of XXH3-128 (digest.h). The hash is compiled in with a constant length, so that a triangle takes some
 * nanoseconds. Sums do not depend on the order.
 */
#include "digest.h"

#include <stdlib.h>
#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "digest_wide.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "numbers are hashed as they lie in memory");

struct digest digest_hash(const void *bytes, size_t size)
{
	XXH128_hash_t h = XXH3_128bits(bytes, size);

	return (struct digest){h.high64, h.low64};
}

struct digest_stream {
	XXH3_state_t state;
};

struct digest_stream *digest_stream_new(void)
{
	struct digest_stream *s = aligned_alloc(64, (sizeof *s + 63) & ~(size_t)63);

	if (s) {
		XXH3_INITSTATE(&s->state);
		XXH3_128bits_reset(&s->state);
	}
	return s;
}

void digest_stream_add(struct digest_stream *s, const void *bytes, size_t size)
{
	XXH3_128bits_update(&s->state, bytes, size);
}

struct digest digest_stream_end(const struct digest_stream *s)
{
	XXH128_hash_t h = XXH3_128bits_digest(&s->state);

	return (struct digest){h.high64, h.low64};
}

struct digest_stream *digest_stream_free(struct digest_stream *s)
{
	free(s);
	return NULL;
}

void digest_add(struct digest *sum, struct digest part)
{
	sum->hi += part.hi;
	sum->lo += part.lo;
}

void digest_sub(struct digest *sum, struct digest part)
{
	sum->hi -= part.hi;
	sum->lo -= part.lo;
}

bool digest_equal(struct digest a, struct digest b)
{
	return a.hi == b.hi && a.lo == b.lo;
}

bool digest_is_zero(struct digest a)
{
	return !a.hi && !a.lo;
}

/* Positions are distinct (a precondition), so the smallest is unique. */
static inline bool less(const int64_t a[2], const int64_t b[2])
{
	return a[0] < b[0] || (a[0] == b[0] && a[1] < b[1]);
}

void digest_add_triangle(struct digest *sum, const int64_t corner[3][2])
{
	int64_t bytes[3][2];
	unsigned i = less(corner[1], corner[0]) ? 1 : 0;

	if (less(corner[2], corner[i]))
		i = 2;
	for (unsigned k = 0; k < 3; k++) {
		bytes[k][0] = corner[i][0];
		bytes[k][1] = corner[i][1];
		i = i == 2 ? 0 : i + 1;
	}
	XXH128_hash_t h = XXH3_128bits(bytes, sizeof bytes);

	sum->hi += h.high64;
	sum->lo += h.low64;
}

/* Selects b if `mask` is all ones, else a. Without a branch, because the smallest corner is unpredictable. */
static inline uint64_t either(uint64_t a, uint64_t b, uint64_t mask)
{
	return a ^ ((a ^ b) & mask);
}

/* `origin`: the offset minus the 2^31 by which a place exceeds a lattice number. */
static inline void place_take(uint64_t place, const uint64_t origin[2], uint64_t ret[2])
{
	ret[0] = (place >> 32) + origin[0];
	ret[1] = (uint32_t)place + origin[1];
}

void digest_add_triangles(struct digest *sum, const uint64_t (*place)[3], size_t n, const int64_t k[2])
{
	const uint64_t bias = UINT64_C(1) << 31, origin[2] = {(uint64_t)k[0] - bias, (uint64_t)k[1] - bias};
	size_t i = digest_wide_triangles(sum, place, n, k);
	struct digest s = *sum;

	for (; i < n; i++) {
		uint64_t p = place[i][0], q = place[i][1], r = place[i][2];
		uint64_t second = 0 - (uint64_t)(q < p), third = 0 - (uint64_t)(r < either(p, q, second));
		uint64_t bytes[3][2];
		XXH128_hash_t h;

		place_take(either(either(p, q, second), r, third), origin, bytes[0]);
		place_take(either(either(q, r, second), p, third), origin, bytes[1]);
		place_take(either(either(r, p, second), q, third), origin, bytes[2]);
		h = XXH3_128bits(bytes, sizeof bytes);
		s.hi += h.high64;
		s.lo += h.low64;
	}
	*sum = s;
}

void digest_add_vertex(struct digest *sum, int64_t x, int64_t y, int64_t z)
{
	int64_t bytes[3] = {x, y, z};
	XXH128_hash_t h = XXH3_128bits(bytes, sizeof bytes);

	sum->hi += h.high64;
	sum->lo += h.low64;
}

void digest_add_vertices(struct digest *sum, const int64_t k[3], const int32_t (*vertex)[3], size_t n)
{
	size_t i = digest_wide_vertices(sum, k, vertex, n);
	struct digest s = *sum;

	for (; i < n; i++) {
		const int64_t bytes[3] = {vertex[i][0] + k[0], vertex[i][1] + k[1], vertex[i][2] + k[2]};
		XXH128_hash_t h = XXH3_128bits(bytes, sizeof bytes);

		s.hi += h.high64;
		s.lo += h.low64;
	}
	*sum = s;
}

/* Every stored domain has two of these in its name, and printf would take ten times as long. */
char *digest_hex(struct digest d, char hex[DIGEST_HEX_SIZE])
{
	const uint64_t half[2] = {d.hi, d.lo};

	for (unsigned i = 0; i < 32; i++)
		hex[i] = "0123456789abcdef"[half[i / 16] >> (60 - 4 * (i % 16)) & 15];
	hex[32] = 0;
	return hex;
}

bool digest_parse(const char *hex, struct digest *ret)
{
	uint64_t half[2] = {0, 0};

	for (unsigned i = 0; i < 32; i++) {
		char c = hex[i];
		unsigned v;

		if (c >= '0' && c <= '9')
			v = (unsigned)(c - '0');
		else if (c >= 'a' && c <= 'f')
			v = (unsigned)(c - 'a') + 10;
		else
			return false;
		half[i / 16] = half[i / 16] << 4 | v;
	}
	if (hex[32])
		return false;
	*ret = (struct digest){half[0], half[1]};
	return true;
}
