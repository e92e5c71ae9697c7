/* What the store of geoid grids (geoid.c) and those who ask it (geoid_ask.c) share. */
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

/* What grids take of the disks of their users; reads all names. */
int geoids_count(struct geoids *, struct err *err);

enum { GEOIDS_TEXT_MOST = 2048, GEOIDS_MAX = 64 };

struct geoids_users {
	int dirfd;
	const char *hash;
	uint32_t uid;
	unsigned n, all, own; /* names of the grid, all of them, those that this user added */
};

/* The file that gives a grid this name. */
void geoids_file(const char *name, char ret[DATASET_NAME_MAX + 8]);
int geoids_check_name(const char *name, struct err *err); /* -ERR_USAGE */
/* The text of that file; its length. */
size_t geoids_write(const struct geoid_info *, char text[GEOIDS_TEXT_MOST]);
/* What the file of the name says: -ERR_NOTFOUND, -ERR_CORRUPT. */
int geoids_read(int dirfd, const char *name, struct geoid_info *ret, struct err *err);
/* Calls `each` for every name, until it returns non-zero. */
int geoids_each(int dirfd, int (*each)(const char *name, void *ctx, struct err *err), void *ctx, struct err *err);
int geoids_users_of(int dirfd, const char *hash, uint32_t uid, struct geoids_users *ret, struct err *err);

#endif
