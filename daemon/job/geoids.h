/*
 * Geoid grids that the daemon keeps: checked copies in its state folder, by name. What works on the disk runs on
 * workers; the loop only asks and gets the answer.
 */
#ifndef GEOIDS_H
#define GEOIDS_H

#include "crs_geo.h"
#include "job.h"

struct geoids_found {
	char path[64]; /* for crs_geoid_open, as long as the folder is open */
	char hash[DIGEST_HEX_SIZE];
};

/* At the start: the folder in the state folder, without what a crash left in it. */
int geoids_open(int statefd, int *ret_fd, struct err *err);
/* What they take of the disks of their users (limit.c); reads all names. */
int geoids_count(struct jobs *, struct err *err);
/* How many there are, and of these without a sound text or grid; *err is set for the first of these, and 0 returned. Worker. */
int geoids_look(int dirfd, unsigned *ret_n, unsigned *ret_bad, struct err *err);
/* -ERR_NOTFOUND names `acutctl geoid add`. Worker. */
int geoids_find(int dirfd, const char *name, struct geoids_found *ret, struct err *err);

#endif
