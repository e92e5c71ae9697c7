/*
 * The halo sites of those regions of a plan that have few points of their own, in memory. They are found once, when the
 * plan is made, so that these regions need not all read the same cells.
 */
#ifndef CUT_SITES_H
#define CUT_SITES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "cut_source.h"

struct cut_sites;

/* A copy of n sites after the view, in Morton order, each position once; charged to the ledger (LEDGER_PLAN; may be
 * NULL). NULL: no memory. */
struct cut_sites *cut_sites_new(const struct point *pts, uint32_t n, struct ledger *);
/* cut_sites_bytes and cut_sites_free are in cut.h. As a source of cells it has walk, read and box, but no scan and no
 * count. */
void cut_sites_source(const struct cut_sites *, struct cut_source *ret);

#endif
