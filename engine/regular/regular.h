/*
 * Domains with weights (docs/design/weights.md, "Domains with weights"): which triangles of the regular triangulation a region
 * owns. Loads what they depend on beyond P(B), inside the memory of the caller.
 */
#ifndef REGULAR_H
#define REGULAR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "cut_source.h"
#include "cut_valid.h"
#include "tri_regular.h"

struct err;

/* The triangles of an area instead of those of a region (docs/design/weights.md, "Windows with weights"). The part of it that is
 * in the hull of all positions is in that of those loaded at the beginning. */
struct regular_area {
	void *ctx;
	/* Whether a triangle meets the area: it is verified. And whether it is chosen then. */
	bool (*meets)(void *ctx, const int32_t a[2], const int32_t b[2], const int32_t c[2]);
	bool (*takes)(void *ctx, const int32_t a[2], const int32_t b[2], const int32_t c[2]);
	/* All positions in the box are in the area, and were loaded at the beginning. */
	bool (*holds)(void *ctx, const int32_t box[4]);
	int64_t box[4]; /* doubled: contains the area */
};

struct regular {
	const struct cut_source *src;
	const struct view *view; /* with weights */
	int64_t most;            /* no position of the source has a greater one */
	/* No record of the cell, subtree or segment has a greater one; it is at most `most`. NULL: that. */
	int64_t (*most_of)(void *ctx, const struct grid_cell *);
	void *most_ctx;
	const struct cut_region *region;
	const struct regular_area *area; /* NULL: the region's triangles */
	struct tri *tri; /* after tri_init; its input has the n positions of P(B), those of the region, or area, among them */
	uint32_t n, own, cap;
	uint8_t *weight;         /* the numbers of their weights, with room for `cap` */
	void *memory;            /* aligned to 8 */
	size_t size;             /* at least regular_bytes(cap) */
	struct cut_trace *trace; /* of P(B); gets what the region depends on. Not of an area; may be NULL */
	/* Called every few milliseconds; non-zero cancels (-ERR_CANCELLED). May be NULL. */
	int (*progress)(void *ctx);
	void *progress_ctx;
	/* for tests: how many edges a batch can have, and how many discs; points can be four more. 0: the room is the limit */
	uint32_t few;
	/* for tests: P(B) alone; only what is in the region and on its borders is verified; the trace stays that of P(B) */
	bool not_verified, no_hull, less_trace;
	/* results, for finish.h */
	bool flat;               /* all positions of the view are on one line: nothing is hidden, and there is no triangle */
	const uint64_t *chosen;  /* in `memory`: a bit for each triangle of `tri` that the region owns, or the area takes */
	const uint64_t *visible; /* likewise: a bit for each vertex of `tri` that is in a triangle */
	uint32_t hidden,
		nhull; /* not of an area: positions of the region that are hidden; edges of the hull whose outer rays end in it */
	uint32_t added, turns; /* positions beyond P(B) */
	uint64_t cells_read, points_read;
};

size_t regular_bytes(uint32_t cap);

/* REGULAR_E_SPLIT: it does not fit; *ret_need > cap is an estimate of the positions. */
enum { REGULAR_E_SPLIT = 1 };
int regular_run(struct regular *, uint64_t *ret_need, struct err *);

#endif
