/*
 * The marker of a folder: a small file that says whose it is. The state folder's is made once, when the store is, and
 * again when a backup of it is restored; the cache's tells which store the folder served last. FORMAT.md has its bytes.
 */
#ifndef MARKER_H
#define MARKER_H

#include <stdint.h>

struct err;

enum marker_kind { MARKER_STATE, MARKER_CACHE };

struct marker {
	uint8_t id[16];  /* of the store */
	int64_t made_us; /* since 1970 */
};

enum { MARKER_E_ABSENT = 1 };
/* -ERR_VERSION: of a newer acutd; -ERR_CORRUPT; MARKER_E_ABSENT: there is none. */
int marker_read(int dirfd, enum marker_kind, struct marker *ret, struct err *err);
/* Published: on the disk, whole, when it returns 0. Replaces one that is there. */
int marker_write(int dirfd, enum marker_kind, const struct marker *, struct err *err);
/* Of a new store: by chance. */
int marker_new(struct marker *ret, struct err *err);

#endif
