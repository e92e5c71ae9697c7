/*
 * The halo sites of a plan's regions that have few points of their own, in memory: found once, when the plan is
 * made, so that each of these regions need not read the same cells for itself.
 */
#ifndef CUT_SITES_H
#define CUT_SITES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "cut_source.h"

struct cut_sites;

/* A copy of n sites after the view, in Morton order, each position once, taken from the ledger (LEDGER_PLAN; NULL:
 * none). NULL: no memory. */
struct cut_sites *cut_sites_new(const struct point *pts, uint32_t n, struct ledger *);
/* cut_sites_bytes, cut_sites_free: cut.h. As a source of cells: walk, read and box; it has no scan and no count. */
void cut_sites_source(const struct cut_sites *, struct cut_source *ret);

#endif
