/* Sealing a stage, in steps. Internal; the door is grid.h. */
#ifndef GRID_SEAL_H
#define GRID_SEAL_H

#include <stddef.h>

/* What a seal takes besides the stage's memory. */
size_t grid_seal_bytes(void);
/* Of the stage's lists, for n runs. */
size_t grid_seal_runs_bytes(size_t n);
/* The least of the stage's halves with which n runs and what else there is can be merged into a segment. */
size_t grid_seal_least(size_t n);

#endif
