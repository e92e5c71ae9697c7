/*
 * Stored domains, by what they depend on: one checksummed file for each domain, published by temporary name and rename.
 * They are derived data: losing one costs only time, so nothing is fsynced; a file that a power cut damaged fails its
 * checksum and counts as absent. format.md, "Finished domains", has the bytes.
 */
#ifndef STORE_H
#define STORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mesh.h"

struct err;

/* `base` identifies the region, under a lattice, a view and a kernel; `list` identifies the data that were read for it
 * (pipe_reuse.c). A base can have several lists, of different generations. */
struct store_id {
	struct digest base, list;
};

/* What is stored beside a domain. `proof` is opaque here. */
struct store_beside {
	struct digest content; /* of the generation from which it was made */
	const void *proof;
	size_t proof_size;
};
enum { STORE_PROOF_MOST = 1 << 20 };
/* Memory that store_proof needs besides the proof. */
enum { STORE_PROOF_FRONT = 512 };

/* What is stored under a base: at most `most` versions, those that were written or used last, the latest first. */
struct store_version {
	struct digest list;
	int64_t mtime_ns;
};
int store_versions(int dirfd, struct digest base, struct store_version *ret, size_t most, size_t *ret_n, struct err *err);

/* STORE_E_ABSENT: it does not exist, or has another format (an earlier one is removed). STORE_E_DAMAGED: it was
 * damaged, and was removed. */
enum { STORE_E_ABSENT = 1, STORE_E_DAMAGED = 2 };

/* The front of a file: everything except closed vertices and triangles. */
struct store_front {
	struct mesh_domain domain; /* `triangle` and `final` are NULL; `vertex` has only the open ones */
	struct store_beside beside;
	uint64_t payload;    /* checksum of links, vertices and triangles */
	uint64_t bytes;      /* of the file */
	size_t front, whole; /* bytes of memory that store_front and store_get need */
	int64_t used_ns;     /* time of the file when it was read */
};
/* *ret: the numbers of the stored domain. */
int store_put(int dirfd, const struct store_id *, const struct store_beside *, const struct mesh_domain *,
	      struct store_front *ret, struct err *err);
/* Reads only the numbers; no pointer of *ret is valid. */
int store_head(int dirfd, const struct store_id *, struct store_front *ret, struct err *err);
/* Reads the numbers and the proof, somewhere in `memory`. The rest is checked when it is read. */
int store_proof(int dirfd, const struct store_id *, void *memory, size_t size, struct store_front *ret, struct err *err);
/* Reads proof, links and open vertices to `memory` (8-byte aligned). STORE_E_ABSENT also if `size` is too small. */
int store_front(int dirfd, const struct store_id *, void *memory, size_t size, struct store_front *ret, struct err *err);
/* Reads the whole domain. */
int store_get(int dirfd, const struct store_id *, void *memory, size_t size, struct mesh_domain *ret, struct err *err);

/* Marks it as used: what was used last is evicted last. Does nothing if the time of the file is later than `before_ns`. */
void store_touch(int dirfd, const struct store_id *, int64_t before_ns);
uint64_t store_size(int dirfd, const struct store_id *); /* bytes of its file; 0: it does not exist */
/* Whether its file exists with that size; its name determines its content. *ret_used_ns: when it was last used. */
bool store_there(int dirfd, const struct store_id *, uint64_t bytes, int64_t *ret_used_ns);
int store_remove(int dirfd, const struct store_id *, struct err *err); /* success if it does not exist */
/* Removes files of versions before 3, which were in the folder itself. */
int store_sweep(int dirfd, struct err *err);
/* Reads a file in `dirfd`, a folder of the store, through `memory`. -ERR_CORRUPT: it is damaged; -ERR_VERSION: a later
 * version wrote it. It stays in both cases. */
int store_check(int dirfd, const char *name, void *memory, size_t size, struct err *err);

#endif
