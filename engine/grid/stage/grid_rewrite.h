/*
 * Rewriting: the records of several segments in one folder become one new segment, byte for byte the one that a seal
 * of the same records makes. The old segments stay. One thread at a time.
 *
 * Or those of a range of keys: then other rewrites make the other ranges, and all of them together take the place of the old
 * segments. Cells at the ends of a range are larger than those of one segment would be.
 */
#ifndef GRID_REWRITE_H
#define GRID_REWRITE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid_segment_info.h"

struct err;

enum { GRID_REWRITE_MOST = 512 }; /* segments */
struct grid_rewrite;
struct grid_rewrite_params {
	int dirfd;                                /* of the old segments, and of the new one; borrowed until the end */
	const struct grid_segment_info *segments; /* borrowed during grid_rewrite_new only */
	size_t nsegments;                         /* at most GRID_REWRITE_MOST */
	size_t nsources;      /* the most sources that all of them have together; or that one has, if no two share one */
	const char *name;     /* file name stem of the new segment */
	const uint32_t *drop; /* sources whose records are omitted, ascending; borrowed until the end */
	size_t ndrop;
	bool part; /* only records with keys from lo to hi, both included */
	uint64_t lo, hi;
	size_t memory;  /* bytes it may use; the caller has charged them */
	bool temporary; /* the new segment need not survive a crash */
};
size_t grid_rewrite_min_bytes(const struct grid_segment_info *segments, size_t n, size_t nsources); /* of `memory` */
int grid_rewrite_new(const struct grid_rewrite_params *, struct grid_rewrite **ret, struct err *err);
/* Rewrites about 100 KiB. GRID_REWRITE_DONE: only grid_rewrite_finish remains. */
enum { GRID_REWRITE_DONE = 1 };
int grid_rewrite_step(struct grid_rewrite *, struct err *err);
/* Publishes the segment. Frees the rewrite, also on failure. */
int grid_rewrite_finish(struct grid_rewrite *, struct grid_segment_info *ret, struct err *err);
struct grid_rewrite *grid_rewrite_free(struct grid_rewrite *); /* abandons it; removes the new file */
/* Keys that divide a segment into n parts of about equal numbers of records: ret[i] is the first key of part i + 1, of n - 1.
 * Reads its index. */
int grid_segment_divide(int dirfd, const struct grid_segment_info *, unsigned n, uint64_t *ret, struct err *err);
/* Counts the records of these sources (ascending) in a segment. Allocates 32 bytes for each source of the segment. */
int grid_segment_count_sources(int dirfd, const struct grid_segment_info *, const uint32_t *ids, size_t n, uint64_t *ret_points,
			       struct err *err);

#endif
