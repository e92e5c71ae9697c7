/*
 * The steps of snap_round. Internal.
 */
#ifndef SNAP_PRIV_H
#define SNAP_PRIV_H

#include <stddef.h>

#include "snap.h"

/* Memory that is counted: `left` of it may be taken. */
struct snap_memory {
	uint64_t left, most;
	struct err *err;
};

/* An array that grows. */
struct snap_array {
	void *at;
	size_t n, cap, size; /* bytes of an item */
};

/* Room for n items in all. A negative error. */
int snap_array_room(struct snap_memory *, struct snap_array *, size_t n);
/* Adds one item. */
int snap_array_add(struct snap_memory *, struct snap_array *, const void *item);
void snap_array_done(struct snap_memory *, struct snap_array *);

/* Sorts n records of `words` words by word `by`, stable. */
int snap_sort(struct snap_memory *, uint64_t *record, size_t n, unsigned words, unsigned by);
/* The same for single words, and keeps one of equal ones. */
int snap_sort_unique(struct snap_memory *, struct snap_array *word);

/* A position as a word: in the order by x, then y. */
static inline uint64_t snap_word(int32_t x, int32_t y)
{
	return (uint64_t)((uint32_t)x ^ UINT32_C(0x80000000)) << 32 | ((uint32_t)y ^ UINT32_C(0x80000000));
}

static inline int32_t snap_word_x(uint64_t word)
{
	return (int32_t)((uint32_t)(word >> 32) ^ UINT32_C(0x80000000));
}

static inline int32_t snap_word_y(uint64_t word)
{
	return (int32_t)((uint32_t)word ^ UINT32_C(0x80000000));
}

/* A segment by its ends. */
struct snap_segment {
	int32_t a[2], b[2];
};

/* Whether two segments cross between their ends. Then where, rounded, and the height of a line there, rounded, whose ends
 * have the heights za and zb. */
bool snap_cross(const struct snap_segment *, const struct snap_segment *, int32_t ret[2]);
int32_t snap_cross_height(const struct snap_segment *, int32_t za, int32_t zb, const struct snap_segment *other);

/* Whether the segment meets the pixel of `at`: x and y from half before it to half behind it, without the latter. */
bool snap_meet_pixel(const struct snap_segment *, const int32_t at[2]);
/* Segments by the numbers of their ends. */
struct snap_set {
	const int32_t (*xy)[2];
	const uint32_t (*end)[2];
	uint32_t n;
};

static inline struct snap_segment snap_segment_of(const struct snap_set *s, uint32_t i)
{
	const int32_t *a = s->xy[s->end[i][0]], *b = s->xy[s->end[i][1]];

	return (struct snap_segment){{a[0], a[1]}, {b[0], b[1]}};
}

/* Calls `found` for each two segments that cross, once, in any order. An error of `found` ends the search. */
typedef int (*snap_pair_fn)(void *ctx, uint32_t i, uint32_t k, const int32_t at[2]);
int snap_join_pairs(struct snap_memory *, const struct snap_set *, snap_pair_fn found, void *ctx);

/* Calls `found` for each segment and each point whose pixel it meets, once, in any order. */
typedef int (*snap_point_fn)(void *ctx, uint32_t i, uint32_t point);
int snap_join_pixels(struct snap_memory *, const struct snap_set *, const int32_t (*point)[2], uint32_t npoint,
		     snap_point_fn found, void *ctx);

#endif
