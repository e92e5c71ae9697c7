/*
 * Geoid grids that the daemon keeps: checked copies in its state folder, each with a name. The loop submits requests; workers
 * read and write the disk.
 */
#ifndef GEOID_H
#define GEOID_H

#include "core.h"
#include "crs_geo.h"
#include "digest.h"

struct geoids;

/* Opens the folder in the state folder, removes leftovers of a crash, and charges the grids to their users. Reads the disk. */
int geoids_new(struct core *, struct geoids **ret, struct err *err);
struct geoids *geoids_free(struct geoids *);    /* NULL is fine; returns NULL */
uint64_t geoids_changes(const struct geoids *); /* grids that were added or removed; loop */
/* Counts the names, and the bad ones: their description or grid is missing or damaged. Returns 0 also if there are bad ones; *err
 * then describes the first of them. Worker. */
int geoids_check(const struct geoids *, unsigned *ret_n, unsigned *ret_bad, struct err *err);
struct geoids_found {
	char path[64]; /* for crs_geoid_open; valid until geoids_free */
	char hash[DIGEST_HEX_SIZE];
};
/* -ERR_NOTFOUND: there is no such name; the hint names `acutctl geoid add`. Worker. */
int geoids_find(const struct geoids *, const char *name, struct geoids_found *ret, struct err *err);

struct geoid_info {
	char name[72], hash[DIGEST_HEX_SIZE];
	uint32_t uid; /* who added it */
	struct crs_geoid_info grid;
};
typedef void geoid_answer_fn(void *token, const struct err *why, const struct geoid_info *list, size_t n);
/* Adds a checked copy of the file under that name; the answer's list has this one grid. Takes `fd` in any case. Messages call the
 * file `file`. */
void geoid_add(struct geoids *, int fd, const char *name, const char *file, const struct peer *, geoid_answer_fn *answer,
	       void *token);
void geoid_list(struct geoids *, const struct peer *, geoid_answer_fn *answer, void *token); /* sorted by name */
void geoid_remove(struct geoids *, const char *name, const struct peer *, geoid_answer_fn *answer, void *token);

#endif
