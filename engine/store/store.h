/*
 * Finished domains kept by what they were made of: one file a domain, checksummed, published by temp + rename.
 * Derived data: losing it loses time only, so nothing is fsynced; a file that a power cut tore fails its
 * checksum and is taken for absent. FORMAT.md, "Finished domains", has the bytes.
 */
#ifndef STORE_H
#define STORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mesh.h"

struct err;

/* `base` tells the region apart, under a lattice, a view and a kernel; `list` what was read for it (pipe_reuse.c). Of a
 * base there may be several, of different generations. */
struct store_id {
	struct digest base, list;
};

/* What is kept beside a domain. `proof`: opaque here. */
struct store_beside {
	struct digest content; /* of the generation that it was made of */
	const void *proof;
	size_t proof_size;
};
enum { STORE_PROOF_MOST = 1 << 20 };
/* Beside a proof, of the memory that store_proof takes. */
enum { STORE_PROOF_FRONT = 512 };

/* What is there under a base: at most `most`, those written or used last, latest first. */
struct store_version {
	struct digest list;
	int64_t mtime_ns;
};
int store_versions(int dirfd, struct digest base, struct store_version *ret, size_t most, size_t *ret_n, struct err *err);

/* STORE_E_ABSENT: not there, or of another format (of an earlier one it is removed). STORE_E_DAMAGED: removed, and that is why.
 */
enum { STORE_E_ABSENT = 1, STORE_E_DAMAGED = 2 };

/* The front of a file: all but closed vertices and triangles. */
struct store_front {
	struct mesh_domain domain; /* `triangle` and `final` are NULL; of `vertex` the open ones are there */
	struct store_beside beside;
	uint64_t payload;    /* checksum of links, vertices and triangles */
	uint64_t bytes;      /* of the file */
	size_t front, whole; /* bytes of memory that store_front and store_get take */
	int64_t used_ns;     /* the file's time, of what was read */
};
/* *ret: the numbers of what was written. */
int store_put(int dirfd, const struct store_id *, const struct store_beside *, const struct mesh_domain *,
	      struct store_front *ret, struct err *err);
/* The numbers alone; no pointer of *ret is valid. */
int store_head(int dirfd, const struct store_id *, struct store_front *ret, struct err *err);
/* And the proof, somewhere in `memory`. What is behind it is not looked at: it is checked when it is read. */
int store_proof(int dirfd, const struct store_id *, void *memory, size_t size, struct store_front *ret, struct err *err);
/* Into `memory` (8-byte aligned): proof, links, open vertices. STORE_E_ABSENT also where `size` is too small. */
int store_front(int dirfd, const struct store_id *, void *memory, size_t size, struct store_front *ret, struct err *err);
/* The domain alone, whole. */
int store_get(int dirfd, const struct store_id *, void *memory, size_t size, struct mesh_domain *ret, struct err *err);

/* It is in use: what is used last is evicted last. Touches no file whose time is later than `before_ns`. */
void store_touch(int dirfd, const struct store_id *, int64_t before_ns);
uint64_t store_size(int dirfd, const struct store_id *); /* bytes of its file; 0: it is not there */
/* Its file is there, of that size: its name tells what is in it. *ret_used_ns: when it was used last. */
bool store_there(int dirfd, const struct store_id *, uint64_t bytes, int64_t *ret_used_ns);
int store_remove(int dirfd, const struct store_id *, struct err *err); /* absent is success */
/* Removes files of the versions before 3, which lay in the folder itself. */
int store_sweep(int dirfd, struct err *err);
/* Reads a file in `dirfd`, a folder of the store, through `memory`. -ERR_CORRUPT: it is damaged; -ERR_VERSION: a later
 * version wrote it. It stays. */
int store_check(int dirfd, const char *name, void *memory, size_t size, struct err *err);

#endif
