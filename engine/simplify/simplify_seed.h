/* From the blocks to the first grid of chosen points. Internal. */
#ifndef SIMPLIFY_SEED_H
#define SIMPLIFY_SEED_H

#include "simplify_priv.h"

enum { SIMPLIFY_BUCKETS = 1024 + 24 * 512 };

/* The file "hull": the corners of the hull of all points that are no vertices of lines; how many, and how many vertices lines
 * have. With max_points the file "histogram", too. */
int simplify_seed_hull(const struct simplify *, struct simplify_where *, struct err *err);
int simplify_seed_histogram(const struct simplify *, uint64_t ret[SIMPLIFY_BUCKETS], struct err *err);
/* The least error of those that end a bucket which leaves at most `most` of the points that the blocks inserted. */
uint64_t simplify_seeds_error(const uint64_t histogram[SIMPLIFY_BUCKETS], uint64_t most);

/* A segment `name` of the points for this error. */
int simplify_seed_grid(const struct simplify *, uint64_t error, const char *name, struct grid_segment_info *ret, struct err *err);

#endif
