/* From the blocks to the first grid of chosen points. Internal. */
#ifndef SIMPLIFY_SEED_H
#define SIMPLIFY_SEED_H

#include "simplify_priv.h"

enum { SIMPLIFY_BUCKETS = 1024 + 24 * 512 };

/* The file "hull": the corners of the hull of all points that are no vertices of lines; how many, how many vertices lines have,
 * and the greatest error of a settled triangle. With max_points the file "histogram", too. */
int simplify_seed_hull(const struct simplify *, struct simplify_where *, struct err *err);
int simplify_seed_histogram(const struct simplify *, uint64_t ret[SIMPLIFY_BUCKETS], struct err *err);
/* The least error of those that end a bucket which leaves at most `most` of the points that the blocks inserted. */
uint64_t simplify_seeds_error(const uint64_t histogram[SIMPLIFY_BUCKETS], uint64_t most);

/* A segment `name` of the points for where->error. If it is known which triangles are settled, also the file "border-ATTEMPT":
 * keys of positions that may be corners of others, ascending; and the manifest "strip-ATTEMPT" of these points and those around
 * them. where->edges: the number of these keys, or 0. */
int simplify_seed_grid(const struct simplify *, struct simplify_where *where, const char *name, struct grid_segment_info *ret,
		       struct err *err);

#endif
