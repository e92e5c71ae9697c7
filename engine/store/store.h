/*
 * Finished domains kept by content key: one file a domain, checksummed, published by temp + rename.
 * Derived data: losing it loses time only.
 */
#ifndef STORE_H
#define STORE_H

#include <stdbool.h>
#include <stddef.h>

#include "mesh.h"

struct err;

/* Key: a digest over lattice, generation content, view, region and kernel version, made by pipe/. */
int store_put(int dirfd, struct digest key, const struct mesh_domain *, struct err *err);
bool store_has(int dirfd, struct digest key);
/* Bytes needed to load it. STORE_E_ABSENT: not there (or damaged, and then removed). */
enum { STORE_E_ABSENT = 1 };
int store_size(int dirfd, struct digest key, size_t *ret, struct err *err);
/* Loads into `memory`; *ret points into it. */
int store_get(int dirfd, struct digest key, void *memory, size_t size, struct mesh_domain *ret, struct err *err);
int store_remove(int dirfd, struct digest key, struct err *err);

#endif
