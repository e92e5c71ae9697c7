/*
 * Digests from their description alone (proto/STREAM.md): XXH3-128 of 48 bytes a triangle and 24 a
 * vertex, halves summed apart. Straight from the library, sharing nothing with base/digest.c.
 */
#include <xxhash.h>

#include "check_file.h"

static void put(uint8_t *to, int64_t v)
{
	for (unsigned i = 0; i < 8; i++)
		to[i] = (uint8_t)((uint64_t)v >> (8 * i));
}

static void sum(struct digest *d, const uint8_t *bytes, size_t n)
{
	XXH128_hash_t h = XXH3_128bits(bytes, n);

	d->hi += h.high64;
	d->lo += h.low64;
}

struct digest check_triangle_digest(const struct check_mesh *m)
{
	struct digest d = {0, 0};

	for (size_t t = 0; t < m->ntriangle; t++) {
		uint8_t bytes[48];
		unsigned first = 0;

		for (unsigned i = 1; i < 3; i++) {
			const int32_t *a = m->vertex[m->triangle[t][i]], *b = m->vertex[m->triangle[t][first]];

			if (a[0] < b[0] || (a[0] == b[0] && a[1] < b[1]))
				first = i;
		}
		for (unsigned i = 0; i < 3; i++) {
			const int32_t *v = m->vertex[m->triangle[t][(first + i) % 3]];

			put(bytes + 16 * i, v[0] + m->lattice.k[0]);
			put(bytes + 16 * i + 8, v[1] + m->lattice.k[1]);
		}
		sum(&d, bytes, sizeof bytes);
	}
	return d;
}

struct digest check_vertex_digest(const struct check_mesh *m)
{
	struct digest d = {0, 0};

	for (size_t v = 0; v < m->nvertex; v++) {
		uint8_t bytes[24];

		for (unsigned i = 0; i < 3; i++)
			put(bytes + 8 * i, m->vertex[v][i] + m->lattice.k[i]);
		sum(&d, bytes, sizeof bytes);
	}
	return d;
}
