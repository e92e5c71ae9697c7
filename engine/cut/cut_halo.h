/*
 * The halo of a region: the sites outside it whose closed Voronoi cell meets its border. Only cells that can matter are
 * read (algorithm.md 4).
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
/* The struct is at the start of `scratch`. NULL: scratch_size is too small. own_known: the caller seeds the region's
 * own positions; otherwise they are read as far as they matter. */
struct cut_halo *cut_halo_init(void *scratch, size_t scratch_size, const struct cut_source *, const struct view *,
			       const struct cut_region *, bool own_known);
/* Sites of the borders' chains that are known to exist (cut_load's `before`); call it first. Cells and points above
 * their hull are ignored. They are copied. */
void cut_halo_before(struct cut_halo *, const struct cut_trace *);
/* All of the region's own positions, once. */
int cut_halo_seed(struct cut_halo *, const struct mesh_vertex *own, uint32_t n);
/* Finds the halo. CUT_E_FULL: it does not fit the scratch; *ret_need: halo positions known so far plus the records of
 * the cells that may matter. Otherwise *ret is in the scratch, in Morton order. */
int cut_halo_find(struct cut_halo *, const struct point **ret, uint32_t *ret_n, uint64_t *ret_need, struct err *err);
/* cut_halo_find stores the sites of the chains in it (cut_valid.h). */
void cut_halo_trace(struct cut_halo *, struct cut_trace *);
void cut_halo_stats(const struct cut_halo *, uint64_t *ret_cells, uint64_t *ret_points);
/* For tests: limits the rounds before the sweep, and the recorded cells. */
void cut_halo_limit(struct cut_halo *, unsigned rounds, uint32_t seen);
/* For tests: a chain with fewer sites is merged before each walk, a longer one when its batch has this share of it. */
void cut_halo_merged(struct cut_halo *, uint32_t always, uint32_t share);
/* For tests: own positions are processed in blocks of 2^block; a border has 2^columns columns (4 to 10); at most `list`
 * hits (up to LIST) are listed; and if more than `many` points of a cell pass, they are compared with each other. */
void cut_halo_grain(struct cut_halo *, unsigned block, unsigned columns, uint32_t list, uint32_t many);

#endif
