/* Shared by the store of geoid grids (geoid.c) and the requests to it (geoid_ask.c). */
#ifndef GEOID_PRIV_H
#define GEOID_PRIV_H

#include <stddef.h>
#include <stdint.h>

#include "dataset.h"
#include "geoid.h"

struct geoids {
	struct core *core;
	int fd; /* state/geoids */
	uint64_t changes;
};

/* Charges all grids to the quotas of their users. Reads all names. */
int geoids_charge(struct geoids *, struct err *err);

enum { GEOIDS_TEXT_MOST = 2048, GEOIDS_MAX = 64 };

struct geoids_names {
	int dirfd;
	const char *hash;
	uint32_t uid;
	unsigned n;   /* names of the grid with this hash */
	unsigned all; /* names of all grids */
	unsigned own; /* names that this user added */
};

/* The name of the file that holds the description. */
void geoids_file(const char *name, char ret[DATASET_NAME_MAX + 8]);
int geoids_check_name(const char *name, struct err *err); /* -ERR_USAGE */
/* The description as text. Returns its length. */
size_t geoids_write(const struct geoid_info *, char text[GEOIDS_TEXT_MOST]);
/* Reads the description: -ERR_NOTFOUND, -ERR_CORRUPT. */
int geoids_read(int dirfd, const char *name, struct geoid_info *ret, struct err *err);
/* Calls `each` for every name, until it returns non-zero. */
int geoids_each(int dirfd, int (*each)(const char *name, void *ctx, struct err *err), void *ctx, struct err *err);
/* Counts names; those with a damaged description count only in `all`. */
int geoids_count_names(int dirfd, const char *hash, uint32_t uid, struct geoids_names *ret, struct err *err);

#endif
