/*
 * The marker of a folder: a small file that identifies it. That of the state folder is made with the store, and again when a
 * backup is restored. That of the cache names the store that it served last. format.md has its bytes.
 */
#ifndef MARKER_H
#define MARKER_H

#include <stdint.h>

struct err;

enum marker_kind { MARKER_STATE, MARKER_CACHE };

struct marker {
	uint8_t id[16];  /* of the store */
	int64_t made_us; /* microseconds since 1970 */
};

enum { MARKER_E_ABSENT = 1 };
/* -ERR_VERSION: a newer acutd wrote it. -ERR_CORRUPT. MARKER_E_ABSENT: there is none. */
int marker_read(int dirfd, enum marker_kind, struct marker *ret, struct err *err);
/* Replaces the marker atomically; it is durable when this returns 0. */
int marker_write(int dirfd, enum marker_kind, const struct marker *, struct err *err);
/* A marker with a random id. */
int marker_new(struct marker *ret, struct err *err);

#endif
