/*
 * A source that caches, for every cell that is read, the points that matter for the borders of some regions. So the
 * halos of these regions are found with each cell read once.
 */
#ifndef CUT_CACHE_H
#define CUT_CACHE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "cut_source.h"

struct cut_cache;

/* The struct and its cache are in `memory`; `view` and `regions` are borrowed: n > 0 disjoint regions of one dyadic
 * tree, in the order of a plan; `root` contains all cells and regions. NULL: `size` is too small to be useful. */
struct cut_cache *cut_cache_init(void *memory, size_t size, const struct cut_source *below, const struct view *,
				 const struct cut_region *root, const struct cut_region *regions, uint32_t n);
/* For cut_halo_find of those regions only, without their own positions. It returns kept points only; scan and count are
 * those of `below`. */
void cut_cache_source(struct cut_cache *, struct cut_source *ret);
/* What was read from `below`. */
void cut_cache_stats(const struct cut_cache *, uint64_t *ret_cells, uint64_t *ret_points);
/* Whether cells are read again because there was no memory to keep them. */
bool cut_cache_full(const struct cut_cache *);
/* For tests: limits the number of kept points. */
void cut_cache_limit(struct cut_cache *, uint32_t points);

#endif
