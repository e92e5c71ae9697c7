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
#include "tri_regular.h"

struct err;

struct regular {
	const struct cut_source *src;
	const struct view *view; /* with weights */
	int64_t most;            /* no position of the source has a greater one */
	/* No record of the cell, subtree or segment has a greater one; it is at most `most`. NULL: that. */
	int64_t (*most_of)(void *ctx, const struct grid_cell *);
	void *most_ctx;
	const struct cut_region *region;
	struct tri *tri; /* after tri_init; its input has the n positions of P(B), those of the region among them */
	uint32_t n, own, cap;
	uint8_t *weight; /* the numbers of their weights, with room for `cap` */
	void *memory;    /* aligned to 8 */
	size_t size;     /* at least regular_bytes(cap) */
	/* for tests: P(B) alone; only what is in the region and on its borders is verified */
	bool not_verified, no_hull;
	/* results, for finish.h */
	bool flat;               /* all positions of the view are on one line: nothing is hidden, and there is no triangle */
	const uint64_t *chosen;  /* in `memory`: a bit for each triangle of `tri` that the region owns */
	const uint64_t *visible; /* likewise: a bit for each vertex of `tri` that is in a triangle */
	uint32_t hidden, nhull;  /* positions of the region that are hidden; edges of the hull whose outer rays end in it */
	uint32_t added, turns;   /* positions beyond P(B) */
	uint64_t cells_read, points_read;
};

size_t regular_bytes(uint32_t cap);

/* REGULAR_E_SPLIT: it does not fit; *ret_need > cap is an estimate of the positions. */
enum { REGULAR_E_SPLIT = 1 };
int regular_run(struct regular *, uint64_t *ret_need, struct err *);

#endif
