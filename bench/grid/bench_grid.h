/* A file of points as a grid in a folder, for benchmarks. */
#ifndef BENCH_GRID_H
#define BENCH_GRID_H

#include <stddef.h>
#include <stdint.h>

#include "grid_segment_info.h"

struct err;
struct grid;
struct ledger;

/* The file becomes one segment, whose info is *ret_info. `lap`, if it is not NULL, is called with NULL when the file is open,
 * with "ingest" when its points are staged, and with "seal". `ledger` may be NULL. */
int bench_grid(int dirfd, const char *path, size_t memory, struct ledger *ledger, void (*lap)(const char *what, uint64_t points),
	       struct grid_segment_info *ret_info, struct grid **ret, struct err *err);

#endif
