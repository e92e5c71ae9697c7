/*
 * The chain of a finite border: the lower hull E of (U, h) over the sites so far, including ties.
 *
 * All numbers are doubled and relative to the border's line: U is twice the coordinate along it; X is twice the
 * coordinate across it minus the doubled border (odd, never 0); h = X^2 + U^2. The nearest site to the border's point
 * at T minimizes h - 2TU, so a site's closed cell meets the border iff h == E(U).
 */
#ifndef CUT_CHAIN_H
#define CUT_CHAIN_H

#include <stdbool.h>
#include <stdint.h>

#include "point.h"
#include "view.h"

enum { CUT_CHAIN_PEAKS = 32 };

struct cut_chain {
	bool vertical;
	int64_t c2;       /* doubled coordinate of the border */
	int64_t t0, t1;   /* its ends, doubled; INT64_MIN, INT64_MAX: infinite */
	struct point *pt; /* by U: the sites with h == E(U); one or two (mirrored) for each U */
	uint32_t n, cap;
	struct point *batch; /* not in the chain yet */
	uint32_t nbatch, batch_cap;
	uint32_t ripe; /* the batch is merged when it has this many points: a quarter of the chain, at most batch_cap */
	double reach;  /* no point of the border is farther from its site than this; INFINITY: unknown */
	/* Edge k ends in entry k. On the edges with number k >> peak_shift, E(U) - U^2 is at most this. */
	unsigned peak_shift;
	double peak[CUT_CHAIN_PEAKS];
};

static inline int64_t cut_chain_u(const struct cut_chain *c, const struct point *p)
{
	return 2 * (int64_t)(c->vertical ? p->y : p->x);
}

static inline int64_t cut_chain_x(const struct cut_chain *c, const struct point *p)
{
	int64_t x = 2 * (int64_t)(c->vertical ? p->x : p->y) - c->c2;

	return x < 0 ? -x : x;
}

/* An empty chain: E is +infinity everywhere. n + batch never exceeds cap. */
void cut_chain_init(struct cut_chain *, bool vertical, int64_t c2, int64_t t0, int64_t t1, struct point *pt, uint32_t cap,
		    struct point *batch, uint32_t batch_cap);
/* Provides the batch's memory later; the batch is empty. */
void cut_chain_batch(struct cut_chain *, struct point *batch, uint32_t batch_cap);
/* A chain of n sites of a complete chain, in order, with its first and last site. Their E is nowhere below that of all
 * sites. They stay in pt, which belongs to the caller. */
void cut_chain_of(struct cut_chain *, struct point *pt, uint32_t n);
/* After cut_chain_of, before many boxes are tested: makes each test cheap. */
void cut_chain_survey(struct cut_chain *);
/* Whether the point is strictly above E, so that its cell does not meet the border. Exact. */
bool cut_chain_above(const struct cut_chain *, const struct point *);
/* Adds a kept point to the batch unless it is above E. CUT_E_FULL: the chain overflows. */
int cut_chain_add(struct cut_chain *, const struct view *, const struct point *);
/* Merges the batch into the chain; points with the same position are reduced to the one that the view prefers. */
int cut_chain_flush(struct cut_chain *, const struct view *);
/* Whether E(U) - U^2 reaches x^2 anywhere in the box; false only if no point in it has h <= E(U). */
bool cut_chain_hit(const struct cut_chain *, const int32_t box[4]);
/* Upper bounds of |X| of the points with h <= E(U), for U in n columns of 2^shift from u0 on; INT64_MAX where E is
 * infinite, -1 where there is no such point. */
void cut_chain_limits(const struct cut_chain *, int64_t u0, unsigned shift, unsigned n, int64_t *ret);
/* Extents of a box along the border, and its smallest distance from the line; doubled. */
void cut_chain_span(const struct cut_chain *, const int32_t box[4], int64_t *ret_u0, int64_t *ret_u1, int64_t *ret_x);

#endif
