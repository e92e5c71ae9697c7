/*
 * A source that keeps, of every cell that is read, what can be seen of it from the borders of some regions: the
 * halos of these regions are found with each cell read once.
 */
#ifndef CUT_KEEP_H
#define CUT_KEEP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "cut_source.h"

struct cut_keep;

/* Lies at the start of `memory`, with what it keeps; `view` and `regions` are borrowed: n > 0 disjoint ones of one
 * dyadic tree, in the order of a plan, `root` around all cells and regions. NULL: `size` is too small to be of use. */
struct cut_keep *cut_keep_init(void *memory, size_t size, const struct cut_source *below, const struct view *,
			       const struct cut_region *root, const struct cut_region *regions, uint32_t n);
/* For cut_halo_find of those regions, with their own positions not known, and for nothing else. It hands out kept
 * points only; scan and count are those below. */
void cut_keep_source(struct cut_keep *, struct cut_source *ret);
/* What was read below. */
void cut_keep_stats(const struct cut_keep *, uint64_t *ret_cells, uint64_t *ret_points);
/* Whether cells are read again because there was no room to keep them. */
bool cut_keep_full(const struct cut_keep *);
/* For tests: room for no more than so many points. */
void cut_keep_limit(struct cut_keep *, uint32_t points);

#endif
