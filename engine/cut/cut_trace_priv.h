/* Traces, as cut_trace.c and cut_valid.c share them. */
#ifndef CUT_TRACE_PRIV_H
#define CUT_TRACE_PRIV_H

#include "cut_chain.h"
#include "cut_valid.h"

/* The region's finite borders, without sites; returns how many. */
unsigned cut_trace_borders(const struct cut_region *region, struct cut_chain ret[4]);
/* The same, with the hull E' of the trace's sites. */
unsigned cut_trace_chains(const struct cut_trace *t, const struct cut_region *region, struct cut_chain ret[4]);
/* Prepares the chains for many calls of cut_chains_hit. */
void cut_chains_survey(struct cut_chain *chain, unsigned n);
/* Whether a point in the box can have h <= E' on a border. */
bool cut_chains_hit(const struct cut_chain *chain, unsigned n, const int32_t box[4]);
/* The keys of the box's corners; the keys of all points in it are between. */
void cut_box_keys(const int32_t box[4], uint64_t *ret_lo, uint64_t *ret_hi);
/* The first range of the trace that ends at `from` or later; NULL: there is none. */
const struct grid_sum *cut_trace_find(const struct cut_trace *t, uint64_t from);
/* Whether one range contains from..to. */
bool cut_trace_contains(const struct cut_trace *t, uint64_t from, uint64_t to);

#endif
