/*
 * Finished domains kept by content key: one file a domain, checksummed, published by temp + rename.
 * Derived data: losing it loses time only, so nothing is fsynced; a file that a power cut tore fails its
 * checksum and is taken for absent. FORMAT.md, "Finished domains", has the bytes.
 */
#ifndef STORE_H
#define STORE_H

#include <stdbool.h>
#include <stddef.h>

#include "mesh.h"

struct err;

/* The key is a digest over lattice, generation, view, region and kernel version (pipe_domain_key). */
int store_put(int dirfd, struct digest key, const struct mesh_domain *, struct err *err);
/* It is there, as far as its name says. */
bool store_has(int dirfd, struct digest key);

/* Bytes of memory that a load of it takes. STORE_E_ABSENT: not there, or damaged (then it is removed). */
enum { STORE_E_ABSENT = 1 };
int store_size(int dirfd, struct digest key, size_t *ret, struct err *err);
/* Load into `memory` (8-byte aligned); the arrays of *ret lie in it. STORE_E_ABSENT as above. */
int store_get(int dirfd, struct digest key, void *memory, size_t size, struct mesh_domain *ret,
	      struct err *err);
int store_remove(int dirfd, struct digest key, struct err *err); /* absent is success */

#endif
