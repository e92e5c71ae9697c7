/*
 * Ways through an area: where a segment between two places goes in and out.
 *
 * Whether a place is inside, and which edges a segment crosses, is exact, by the rule of area.h: as if the segment were moved to
 * greater x and, much less, to greater y. So it neither passes through a corner nor runs along an edge, two segments that end at
 * one place agree on it, and of areas side by side each part of a segment is in exactly one. Where an edge is crossed is a
 * double, and the same one for two areas that share the edge.
 */
#ifndef AREA_WAY_H
#define AREA_WAY_H

#include "area.h"

/* n / d of the way between two points, 0 <= n <= d, 0 < d <= 2^60; the points are within 2^33 of each other. */
struct area_place {
	int64_t from[2], to[2], n, d;
};

/* `side` of the line from a to b: 1: p is left of it, -1: right; as if p were moved to lesser x and, much less, to lesser y, so
 * never 0. It is not asked for a segment whose ends are one place. */
struct area_segment {
	struct area_place a, b;
	int (*side)(const void *ctx, const int64_t p[2]);
	const void *ctx;
};

/* An edge where the segment comes in or leaves; `low` is its lesser end (x, y). */
struct area_crossing {
	double part; /* of the way from a to b; exactly 0 or 1 at these */
	const int64_t *low, *high;
	size_t ring;
};

struct area_way;
int area_way_new(const struct area *, struct area_way **ret, struct err *err);
struct area_way *area_way_free(struct area_way *);
/* *ret_in: whether the segment begins inside; it changes at each crossing. They are valid until the next call. */
int area_way(struct area_way *, const struct area_segment *, bool *ret_in, const struct area_crossing **ret, size_t *ret_n,
	     struct err *err);

#endif
