/*
 * What a region's halo may come to, told by the index alone: nothing is read.
 */
#ifndef CUT_BOUND_H
#define CUT_BOUND_H

#include <stddef.h>
#include <stdint.h>

#include "cut_source.h"

size_t cut_bound_bytes(void);
/*
 * The positions of all cells outside the region that its halo may touch, into *ret. It is an upper bound of the halo
 * where all records are live and the view keeps them all; else nearly always. Stops descending where it knows
 * that the sum is at most `enough`. `scratch` of cut_bound_bytes.
 */
int cut_bound_halo(const struct cut_source *, const struct view *, const struct cut_region *, uint64_t enough, void *scratch,
		   uint64_t *ret, struct err *err);

#endif
