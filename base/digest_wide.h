/* Inside base: digests of many records at once, four in each vector register. */
#ifndef DIGEST_WIDE_H
#define DIGEST_WIDE_H

#include "digest.h"

/* Add the first of n records, as digest_add_triangles and digest_add_vertices do. They return how many they added: all but the
 * last n % 4, or none on a processor without such registers. */
size_t digest_wide_triangles(struct digest *sum, const uint64_t (*place)[3], size_t n, const int64_t k[2]);
size_t digest_wide_vertices(struct digest *sum, const int64_t k[3], const int32_t (*vertex)[3], size_t n);

#endif
