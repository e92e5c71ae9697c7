/* Sorted runs of older versions. Internal. */
#ifndef GRID_RUN_OLD_H
#define GRID_RUN_OLD_H

#include <stdbool.h>

struct err;

/* A whole header of an older version; its blocks are not read. -ERR_VERSION: a newer one; -ERR_CORRUPT. */
int grid_run_version(int dirfd, const char *name, bool *ret_older, struct err *err);
/* The records of the older run `name` in a run `to` of this version; NULL: they are only read. The old one stays. */
int grid_run_convert(int dirfd, const char *name, const char *to, bool durable, struct err *err);

#endif
