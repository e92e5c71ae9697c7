/*
 * The bytes of a stored domain. Internal. format.md, "Finished domains".
 */
#ifndef STORE_FORMAT_H
#define STORE_FORMAT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "store.h"

/* NAME: "ab/d-BASE-LIST" */
enum { STORE_HEADER = 384, STORE_FOLDER = 3, STORE_NAME = STORE_FOLDER + 2 + 32 + 1 + 32 + 1, STORE_TEMP = STORE_NAME + 48 };
_Static_assert((int)STORE_HEADER <= (int)STORE_PROOF_FRONT, "a proof's front has room for the header");

static inline size_t store_padded(size_t n)
{
	return (n + 7) & ~(size_t)7;
}

/* Where the arrays of a domain are in memory, from its links on. */
struct store_layout {
	size_t vertex, open_end, triangle, final, edges, total; /* bytes; open_end: end of the open vertices */
};
struct store_layout store_layout_of(const struct mesh_domain *);

/* How closed vertices and triangles are written: each coordinate relative to a base, and each corner, in that many
 * bytes, 2 or 4. If all coordinates have 4 the base is 0, so the bytes are those in memory. */
struct store_code {
	int32_t base[3];
	uint8_t vertex[3], triangle;
};
struct store_code store_code_of(const struct mesh_domain *);

/* The same for the file, behind the proof. */
struct store_extent {
	size_t open, closed, triangle, edges;        /* bytes, without padding; edges directly follow the triangles */
	size_t open_at, closed_at, triangle_at, end; /* offsets in the file */
};
struct store_extent store_extent_of(const struct mesh_domain *, const struct store_code *, size_t proof_size);

/* Checksums of: the proof; links and open vertices; closed vertices and triangles as they are written, and edges. */
struct store_sums {
	uint64_t proof, open, rest;
};

/* A header. It does not include the pointers and sizes of `front`. */
struct store_header {
	struct store_code code;
	struct store_sums sums;
};

void store_header_pack(const struct store_front *, const struct store_id *, const struct store_header *,
		       uint8_t bytes[STORE_HEADER]);
/* Sets what follows from the header's numbers: payload, and the sizes of the file and in memory. */
void store_sizes(struct store_front *, const struct store_header *);
/* STORE_HEADER_OLD, _NEWER: intact, of another version; the checksum is at the same place in all versions. */
enum store_header_is { STORE_HEADER_GOOD, STORE_HEADER_OLD, STORE_HEADER_NEWER, STORE_HEADER_DAMAGED };
enum store_header_is store_header_unpack(const uint8_t bytes[STORE_HEADER], const struct store_id *, struct store_front *,
					 struct store_header *);

/* Packs n elements of `vertex` or `triangle`; returns how many bytes. */
size_t store_pack_vertices(const struct store_code *, const struct mesh_vertex *, size_t n, uint8_t *out);
size_t store_pack_triangles(const struct store_code *, const uint32_t (*)[3], size_t n, uint8_t *out);
/* In place: the bytes are at the end of the array's memory. */
void store_unpack_vertices(const struct store_code *, struct mesh_vertex *, size_t n);
void store_unpack_triangles(const struct store_code *, uint32_t (*)[3], size_t n);

/* Whether all of n packed corners are vertices. */
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

/* ---- bytes in files; `at`: the place of the domain's header, 0 in a file of the store ---- */

uint64_t store_open_sum(const struct mesh_domain *);
/* Writes f->domain and f->beside, and sets the other fields of *f. */
int store_write(int fd, const char *name, uint64_t at, const struct store_id *, struct store_front *f, struct err *);
/* f, h: from the header. Reads the rest to `memory` of f->whole bytes, and sets the pointers of f->domain. *ret_whole: it agrees
 * with its checksums. */
int store_read(int fd, const char *name, uint64_t at, struct store_front *f, const struct store_header *h, void *memory,
	       bool *ret_whole, struct err *);
/* Reads and checks the rest through `memory`. */
int store_check_at(int fd, const char *name, uint64_t at, const struct store_front *, const struct store_header *, void *memory,
		   size_t size, struct err *);

/* A temporary file for a domain, and what it becomes. `who`: different for each domain that this process writes at once. If r is
 * not 0 the file is removed, and r is returned. Closes it in any case. */
int store_temp_open(int dirfd, const struct store_id *, const void *who, char name[STORE_NAME], char temp[STORE_TEMP],
		    int *ret_fd, struct err *);
int store_temp_publish(int dirfd, int fd, const char *temp, const char *name, int r, struct err *);

#endif
