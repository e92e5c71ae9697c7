/*
 * The trace of a load: what a region's points depend on, and whether they are the same in another generation
 * (cut_valid.c has the proof).
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

/* Upper bounds of the sites kept of a border's chain, of ranges, and of segments; more sites are thinned, more ranges
 * made coarser. */
enum { CUT_TRACE_SITES = 128, CUT_TRACE_RANGES = 1024, CUT_TRACE_OWN = 4, CUT_TRACE_PARTS = 16 };

/* What was live in a generation: for each segment the number of its live records and their content sum. n 0: there were
 * too many segments. */
struct cut_live {
	struct cut_live_part {
		uint64_t points;
		struct digest sum;
	} part[CUT_TRACE_PARTS];
	uint32_t n;
	struct digest lines; /* content of the line set; zero: there was none */
};

/* What a domain depends on beside its points (engine/constrain): pieces that meet `box`, that of its triangles, by their sum as
 * of lineset_sum; and the points in discs, all of which are in `disc`, and in ranges of the trace. Empty boxes have their first
 * side beyond the third. */
struct cut_lines {
	int32_t box[4], disc[4];
	struct digest sum;
	uint32_t cap; /* positions of the arena in which the domain was made; 0: as one without pieces */
};
#define CUT_BOX_EMPTY                                      \
	{                                                  \
		INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN \
	}

/*
 * The trace of a load. `range`: Morton keys, ascending, disjoint and not adjacent, with the content sums of their live
 * records; the region's own ranges are among them. `site`: the border chains (algorithm.md 4) of the finite borders in
 * the order left, right, lower, upper; only x and y of these sites matter. `live`: of the generation in which it was
 * made.
 */
struct cut_trace {
	struct grid_sum *range;
	struct point *site;
	uint32_t nrange, nsite[4];
	struct cut_live live;
	struct cut_lines lines;
	uint32_t most_ranges, most_sites; /* limits, at least 4 and 2; tests use smaller ones */
};

/* `memory` (8-byte aligned) of this size holds what the trace points to. */
#define CUT_TRACE_BYTES \
	((CUT_TRACE_RANGES + CUT_TRACE_OWN) * sizeof(struct grid_sum) + 4 * CUT_TRACE_SITES * sizeof(struct point))
void cut_trace_init(struct cut_trace *, void *memory);

/* The steps of a load: first the thinned chains, then the ranges that they can see, with their sums. */
void cut_trace_sites(struct cut_trace *, const struct cut_chain *chain, unsigned n);
int cut_trace_ranges(struct cut_trace *, const struct cut_source *, const struct cut_region *, struct err *err);
/* Adds ranges: those around the boxes of discs, one after the other; at the end their sums. */
enum { CUT_COVER_RECENT = 8 };
struct cut_cover {
	struct cut_trace *trace;
	uint64_t mask; /* zero at first, as all of it; low bits that are rounded off */
	/* What was added last: neighbours are often in the same squares. */
	uint32_t recent[CUT_COVER_RECENT][4];
	unsigned nrecent, next;
};
void cut_cover_box(struct cut_cover *, const int32_t box[4]);
int cut_cover_end(struct cut_cover *, const struct cut_source *, struct err *err);
/* Whether everything that was live where the trace was made is live here; then its sites are sites here, too, under the
 * same view. */
bool cut_trace_still_live(struct grid_reader *, const struct cut_trace *);
/* Whether a trace of unknown origin has the form of one of that region. */
bool cut_trace_fits(const struct cut_trace *, const struct cut_region *);

/* *ret: cut_load gives the same points and counts here as where the trace was made, under the same view (except for
 * cells_read, points_read), and what `lines` has is the same. The caller ensures that the lattice is the same. False negatives
 * are possible. */
int cut_valid(struct grid_reader *, const struct view *, const struct cut_region *, const struct cut_trace *, bool *ret,
	      struct err *err);

/*
 * What boxes need of a trace, in a few numbers, for callers that test many regions again and again. `border`: for each
 * finite border the place of its first and last site, and the largest distance of a point that it can see.
 */
struct cut_reach {
	struct cut_reach_border {
		int64_t first, last, far;
		bool any; /* it has sites */
	} border[4];
	bool any_disc; /* of struct cut_lines */
	int32_t disc[4];
};
void cut_reach_of(const struct cut_trace *, const struct cut_region *, struct cut_reach *ret);
/* `then`: of a generation in which the trace was valid or made. True: it is valid here, because everything that was
 * live then is live here, and all added records are far. False: unknown. */
bool cut_additions_far(const struct grid *, const struct cut_region *, const struct cut_reach *, const struct cut_live *then);

#endif
