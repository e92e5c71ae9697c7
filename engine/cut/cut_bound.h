/*
 * Upper bounds of halos from the index alone, without reading records.
 */
#ifndef CUT_BOUND_H
#define CUT_BOUND_H

#include <stddef.h>
#include <stdint.h>

#include "cut_source.h"

size_t cut_bound_bytes(void);
/*
 * Sets *ret to the positions of all cells outside the region that its halo may touch. It is an upper bound of the halo
 * if all records are live and the view keeps them all, and nearly always otherwise. Stops descending when the sum is
 * known to be at most `enough`. `scratch`: cut_bound_bytes.
 */
int cut_bound_halo(const struct cut_source *, const struct view *, const struct cut_region *, uint64_t enough, void *scratch,
		   uint64_t *ret, struct err *err);

#endif
