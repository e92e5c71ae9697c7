/* Memory that sealing needs. */
#ifndef GRID_SEAL_H
#define GRID_SEAL_H

#include <stddef.h>

/* Bytes that a seal needs besides the stage's memory. */
size_t grid_seal_bytes(void);
/* Bytes of the stage's lists that it needs for n runs. */
size_t grid_seal_runs_bytes(size_t n);
/* The smallest size of the stage's halves with which n runs and the points in memory can be merged into a segment. */
size_t grid_seal_min_bytes(size_t n);

#endif
