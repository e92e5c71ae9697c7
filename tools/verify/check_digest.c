/*
 * Digests from their description alone (docs/formats/stream.md): XXH3-128 of 48 bytes for each triangle and 24 for each
 * vertex, both halves summed separately. Uses the library directly and no code of base/digest.c.
 */
#include <xxhash.h>

#include "check_file.h"

static void put_i64(uint8_t *to, int64_t v)
{
	for (unsigned i = 0; i < 8; i++)
		to[i] = (uint8_t)((uint64_t)v >> (8 * i));
}

static void add_hash(struct digest *d, const uint8_t *bytes, size_t n)
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

			put_i64(bytes + 16 * i, v[0] + m->lattice.k[0]);
			put_i64(bytes + 16 * i + 8, v[1] + m->lattice.k[1]);
		}
		add_hash(&d, bytes, sizeof bytes);
	}
	return d;
}

struct digest check_vertex_digest(const struct check_mesh *m)
{
	struct digest d = {0, 0};

	for (size_t v = 0; v < m->nvertex; v++) {
		uint8_t bytes[24];

		for (unsigned i = 0; i < 3; i++)
			put_i64(bytes + 8 * i, m->vertex[v][i] + m->lattice.k[i]);
		add_hash(&d, bytes, sizeof bytes);
	}
	return d;
}
