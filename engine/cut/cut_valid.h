/*
 * What a region's points depend on, and whether they are the same in another generation (cut_valid.c has the proof).
 */
#ifndef CUT_VALID_H
#define CUT_VALID_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "cut.h"
#include "grid.h"

struct cut_chain;
struct cut_source;

/* Sites kept of a border's chain, and ranges, at most: what is more is thinned, or made coarser. */
enum { CUT_TRACE_SITES = 128, CUT_TRACE_RANGES = 1024, CUT_TRACE_OWN = 4, CUT_TRACE_PARTS = 16 };

/* What was live in a generation, by segments, of each its records and their content sum; none: there were too many. */
struct cut_live {
	struct cut_part {
		uint64_t points;
		struct digest sum;
	} part[CUT_TRACE_PARTS];
	uint32_t n;
};

/*
 * The trace of a load. `range`: of Morton keys, ascending, disjoint and not adjacent, with the content sums of the live
 * records in them; the region's own ranges are inside. `site`: the border chains (algorithm.md 4), those of the finite
 * borders in the order left, right, lower, upper; of these sites x and y count. `live`: where it was made.
 */
struct cut_trace {
	struct grid_sum *range;
	struct point *site;
	uint32_t nrange, nsite[4];
	struct cut_live live;
	uint32_t most_ranges, most_sites; /* of a border; at least 4 and 2; tests make them less than there is room for */
};

/* `memory` (8-byte aligned) of this size is what the trace points to. */
#define CUT_TRACE_BYTES \
	((CUT_TRACE_RANGES + CUT_TRACE_OWN) * sizeof(struct grid_sum) + 4 * CUT_TRACE_SITES * sizeof(struct point))
void cut_trace_init(struct cut_trace *, void *memory);

/* The steps of a load: the chains, thinned; then all that they can see, and its sums. */
void cut_trace_sites(struct cut_trace *, const struct cut_chain *chain, unsigned n);
int cut_trace_ranges(struct cut_trace *, const struct cut_source *, const struct cut_region *, struct err *err);
/* All that was live where it was made is live here, whatever else is: so its sites are sites here, too, if the view is the same.
 */
bool cut_trace_stands(struct grid_reader *, const struct cut_trace *);
/* Whether a trace, of whatever origin, is one of that region by its form. */
bool cut_trace_fits(const struct cut_trace *, const struct cut_region *);

/* *ret: cut_load gives the same points and counts of the region here as where the trace was made, under the same view
 * (reading aside: cells_read, points_read). The same lattice is the caller's to see to. False may be said of some that
 * would be the same. */
int cut_valid(struct grid_reader *, const struct view *, const struct cut_region *, const struct cut_trace *, bool *ret,
	      struct err *err);

/*
 * What boxes alone tell of a trace, in some numbers, for whoever looks at many regions again and again. `border`: of each
 * finite border where its first and last site are, and how far a point that it sees can be from it at most.
 */
struct cut_reach {
	struct cut_reach_border {
		int64_t first, last, far;
		bool any; /* it has sites */
	} border[4];
};
void cut_reach_of(const struct cut_trace *, const struct cut_region *, struct cut_reach *ret);
/* `then`: of a generation in which the trace was valid, or made. True: it is here too, since all that was live then is, and what
 * came is far. False says nothing. */
bool cut_far(const struct grid *, const struct cut_region *, const struct cut_reach *, const struct cut_live *then);

#endif
