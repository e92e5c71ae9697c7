/* The steps of breakline_build. Internal. */
#ifndef BREAKLINE_PRIV_H
#define BREAKLINE_PRIV_H

#include "breakline.h"
#include "lineset.h"
#include "snap.h"

/* Memory that is counted before it is taken. */
struct breakline_memory {
	uint64_t left, most;
};

/* NULL with err: LIMIT or NOMEM. Zeroed. */
void *breakline_take(struct breakline_memory *, uint64_t n, size_t size, struct err *);
void breakline_give(struct breakline_memory *, void *, uint64_t n, size_t size);
int breakline_over(const struct breakline_memory *, struct err *); /* raises LIMIT */

/* What the areas of all rings make of pieces. */
enum { BREAKLINE_PIECE_OUT = 4 }; /* beside LINESET_LAKE and LINESET_OUT: out on both sides */
struct breakline_areas {
	const struct snap *lines;
	const uint8_t *kind; /* of each label of `lines`, from label 1 on: enum breakline_kind */
	bool boundary;       /* there is one */
	uint8_t *side;       /* of each piece: what it turns, BREAKLINE_PIECE_OUT */
};
int breakline_areas(struct breakline_areas *, struct breakline_memory *, struct err *);

#endif
