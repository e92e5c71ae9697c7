/*
 * The halo of a region: the sites outside it whose closed Voronoi cell meets its border, found by reading
 * only the cells that can matter (algorithm.md 4).
 */
#ifndef CUT_HALO_H
#define CUT_HALO_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "cut_source.h"

struct cut_halo;
struct cut_trace;

/* Scratch for halos of about cap / 2 positions. */
size_t cut_halo_bytes(uint32_t cap);
/* Lies at the start of `scratch`. NULL: scratch_size is too small for any work. With `own_known` the caller
 * seeds the region's own positions; without, they are read as far as they matter. */
struct cut_halo *cut_halo_init(void *scratch, size_t scratch_size, const struct cut_source *, const struct view *,
			       const struct cut_region *, bool own_known);
/* Sites of the borders' chains that are there for certain (cut_load's `before`), first of all: cells and points that lie above
 * the hull of these are not asked for. They are copied. */
void cut_halo_before(struct cut_halo *, const struct cut_trace *);
/* The region's own positions, all of them, once. */
int cut_halo_seed(struct cut_halo *, const struct mesh_vertex *own, uint32_t n);
/* Read and find. CUT_E_FULL: scratch does not hold it; *ret_need: halo positions now known plus the records
 * of the cells that may still matter. Else *ret is inside scratch, in Morton order. */
int cut_halo_find(struct cut_halo *, const struct point **ret, uint32_t *ret_n, uint64_t *ret_need, struct err *err);
/* cut_halo_find puts the sites of the chains into it (cut_valid.h). */
void cut_halo_trace(struct cut_halo *, struct cut_trace *);
void cut_halo_stats(const struct cut_halo *, uint64_t *ret_cells, uint64_t *ret_points);
/* For tests: at most this many rounds of nearest cells before the sweep, this many remembered cells. */
void cut_halo_limit(struct cut_halo *, unsigned rounds, uint32_t seen);
/* Likewise: own positions are looked at in stretches of 2^block, a border in 2^columns columns (4 to 10), at most
 * `list` hits (of LIST) are listed, and more than `many` points of a cell that pass are held against each other. */
void cut_halo_grain(struct cut_halo *, unsigned block, unsigned columns, uint32_t list, uint32_t many);

#endif
