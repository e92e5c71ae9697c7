/* Sealing a stage, in steps. Internal; the door is grid.h. */
#ifndef GRID_SEAL_H
#define GRID_SEAL_H

#include <stddef.h>

/* The least memory of a slot: that in which one worker merges a slice of n runs and `pieces` of memory. */
size_t grid_seal_slot_least(size_t n, unsigned pieces);

#endif
