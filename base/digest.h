/*
 * Digests that identify meshes (stream.md, "Digests"). A digest is two 64-bit sums, modulo 2^64, of the high and the
 * low halves of XXH3-128 hashes (seed 0). So it does not depend on the order, and digests of parts add up to the digest
 * of the whole.
 */
#ifndef DIGEST_H
#define DIGEST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

struct digest {
	uint64_t hi, lo;
};

#define DIGEST_HEX_SIZE 33

struct digest digest_hash(const void *bytes, size_t size);
/* The same for bytes that come in pieces. */
struct digest_stream;
struct digest_stream *digest_stream_new(void); /* NULL: no memory */
void digest_stream_add(struct digest_stream *, const void *bytes, size_t size);
struct digest digest_stream_end(const struct digest_stream *);    /* of everything added so far */
struct digest_stream *digest_stream_free(struct digest_stream *); /* NULL is fine; returns NULL */
void digest_add(struct digest *sum, struct digest part);
void digest_sub(struct digest *sum, struct digest part);
bool digest_equal(struct digest a, struct digest b);
bool digest_is_zero(struct digest a);

/* Adds a triangle: absolute lattice numbers (X + K) of its three corners, counter-clockwise. It is rotated so that the
 * lexicographically smallest corner (x, then y) is first. The hash is over the six int64 x, y, x, y, x, y,
 * little-endian. Heights are in the vertex digest. */
void digest_add_triangle(struct digest *sum, const int64_t corner[3][2]);
/* Adds n triangles of lattice numbers X, Y with the offset k; each corner is a digest_place. The same sum as from
 * digest_add_triangle, in a sixth of the time. */
void digest_add_triangles(struct digest *sum, const uint64_t (*place)[3], size_t n, const int64_t k[2]);
/* A position as one number, in the order of x, then y. */
static inline uint64_t digest_place(int32_t x, int32_t y)
{
	return ((uint64_t)(uint32_t)x << 32 | (uint32_t)y) ^ UINT64_C(0x8000000080000000);
}
/* The same of x and y that stand behind each other. */
static inline uint64_t digest_place_of(const int32_t *xy)
{
	uint64_t both;

	memcpy(&both, xy, sizeof both);
	return (both << 32 | both >> 32) ^ UINT64_C(0x8000000080000000);
}
/* Adds a vertex: 24 bytes x, y, z, little-endian int64, absolute. */
void digest_add_vertex(struct digest *sum, int64_t x, int64_t y, int64_t z);
/* Adds n vertices of lattice numbers with the offset k; the same sum. */
void digest_add_vertices(struct digest *sum, const int64_t k[3], const int32_t (*vertex)[3], size_t n);

char *digest_hex(struct digest d, char hex[DIGEST_HEX_SIZE]);
bool digest_parse(const char *hex, struct digest *ret);

#endif
