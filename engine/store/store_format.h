/*
 * The bytes of a stored domain: inner door of store/. FORMAT.md, "Finished domains".
 */
#ifndef STORE_FORMAT_H
#define STORE_FORMAT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "store.h"

/* NAME: "ab/d-BASE-LIST" */
enum { STORE_HEADER = 384, STORE_FOLDER = 3, STORE_NAME = STORE_FOLDER + 2 + 32 + 1 + 32 + 1 };
_Static_assert((int)STORE_HEADER <= (int)STORE_PROOF_FRONT, "a proof's front has room for the header");

static inline size_t store_padded(size_t n)
{
	return (n + 7) & ~(size_t)7;
}

/* Where the arrays of a domain lie in memory, from its links on. */
struct store_layout {
	size_t vertex, open_end, triangle, final, total; /* bytes; open_end: of the open vertices */
};
struct store_layout store_layout_of(const struct mesh_domain *);

/* How closed vertices and triangles are written: each coordinate as what it is above a base, each corner, in so many
 * bytes, 2 or 4. Where all of a vertex are 4 the base is 0, so that the bytes are those in memory. */
struct store_code {
	int32_t base[3];
	uint8_t vertex[3], triangle;
};
struct store_code store_code_of(const struct mesh_domain *);

/* The same in the file, behind the proof. */
struct store_extent {
	size_t open, closed, triangle;               /* bytes, without padding */
	size_t open_at, closed_at, triangle_at, end; /* offsets in the file */
};
struct store_extent store_extent_of(const struct mesh_domain *, const struct store_code *, size_t proof_size);

/* Checks of: the proof; links and open vertices; closed vertices and triangles as they are written. */
struct store_sums {
	uint64_t proof, open, rest;
};

/* All of a header. Of `front` the pointers and sizes are no part of it. */
struct store_header {
	struct store_code code;
	struct store_sums sums;
};

void store_header_pack(const struct store_front *, const struct store_id *, const struct store_header *,
		       uint8_t bytes[STORE_HEADER]);
/* What follows from the header's numbers: payload, and sizes of the file and in memory. */
void store_sizes(struct store_front *, const struct store_header *);
/* STORE_HEADER_OLD, _NEWER: whole, of another version, with the checksum where all versions have it. */
enum store_header_is { STORE_HEADER_GOOD, STORE_HEADER_OLD, STORE_HEADER_NEWER, STORE_HEADER_DAMAGED };
enum store_header_is store_header_unpack(const uint8_t bytes[STORE_HEADER], const struct store_id *, struct store_front *,
					 struct store_header *);

/* n elements from `vertex` or `triangle` on, as bytes; returns how many bytes. */
size_t store_pack_vertices(const struct store_code *, const struct mesh_vertex *, size_t n, uint8_t *out);
size_t store_pack_triangles(const struct store_code *, const uint32_t (*)[3], size_t n, uint8_t *out);
/* In place: the bytes lie at the end of the array's room. */
void store_unpack_vertices(const struct store_code *, struct mesh_vertex *, size_t n);
void store_unpack_triangles(const struct store_code *, uint32_t (*)[3], size_t n);

/* Whether all of n corners, as they are written, are vertices. */
bool store_corners_fit(const struct store_code *, const uint8_t *bytes, size_t n, uint32_t nvertex);

static inline size_t store_vertex_bytes(const struct store_code *c)
{
	return (size_t)c->vertex[0] + c->vertex[1] + c->vertex[2];
}

static inline size_t store_triangle_bytes(const struct store_code *c)
{
	return 3 * (size_t)c->triangle;
}

void store_name(const struct store_id *, char name[STORE_NAME]);

#endif
