/*
 * Lives of small sets for tests of traces: generations of the same records, of which sources come and go. Each generation has a
 * tiling of its own.
 */
#ifndef LIVES_H
#define LIVES_H

#include "cut_source.h"
#include "sets.h"
#include "tiling.h"

enum { LIVES_SOURCES = 8, LIVES_LEAVES = 16, LIVES_GENERATIONS = 3 };

struct lives {
	struct {
		struct point p;
		unsigned source;
	} record[SETS_MAX_N];
	unsigned nrecord;
};

struct lives_generation {
	struct sets set;
	struct tiling tiling;
	struct cut_source src;
};

/* Within [0, range), most of them of source 0. Classes are 1, and with `two` 2, too. */
void lives_records(uint64_t *seed, int32_t range, bool two, struct lives *);
/* The records of the sources with these bits, each source in a segment of its own or any. `slot`: of each source; NULL: none. */
void lives_lay_out(uint64_t *seed, const struct lives *, const struct view *, unsigned live, const unsigned *slot,
		   struct lives_generation *);
/* Up to two sources come or go; source 0 stays. */
unsigned lives_change(uint64_t *seed, unsigned live);
/* Regions of all records, live or not. Returns their number. */
unsigned lives_leaves(uint64_t *seed, const struct lives *, struct cut_region ret[LIVES_LEAVES]);

#endif
