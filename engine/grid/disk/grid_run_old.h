/* Sorted runs of older versions. */
#ifndef GRID_RUN_OLD_H
#define GRID_RUN_OLD_H

#include <stdbool.h>
#include <stdint.h>

struct err;

/* Reads the header only: whether it is of an older version, and the size of the file, which it agrees with. -ERR_VERSION: of a
 * newer one; -ERR_CORRUPT. */
int grid_run_check(int dirfd, const char *name, bool *ret_older, uint64_t *ret_bytes, struct err *err);
/* Copies the records of the older run `name` to a run `to` of this version; if `to` is NULL, only checks them. The old run
 * stays. */
int grid_run_convert(int dirfd, const char *name, const char *to, bool durable, struct err *err);

#endif
