/*
 * How a piece is inserted: the triangles that it crosses are found (tri_piece.c) and replaced (tri_piece_fill.c).
 * Internal.
 */
#ifndef TRI_PIECE_PRIV_H
#define TRI_PIECE_PRIV_H

#include "tri_chain.h"
#include "tri_piece.h"
#include "tri_priv.h"

/* A triangle that the piece crosses. */
struct tri_crossed {
	uint32_t link;    /* the triangle, and the side by which the piece enters it; of the first the side by which it leaves */
	uint32_t left;    /* whether its apex across from that side is left of the piece; neither of the first and the last */
	uint32_t flagged; /* how many before it have a flag */
};

/* At the start of the memory; the arrays follow. */
struct tri_pieces {
	struct tri *tri;
	uint64_t *flag;              /* a bit a triangle */
	struct tri_crossed *crossed; /* room for most + 1 */
	struct tri_node *node;       /* room for the chains of both sides, most + 4 */
	uint32_t *at;                /* by id: a triangle at the vertex */
	uint32_t most, cap;
	uint32_t ncrossed;
	uint32_t first, last; /* the ends of the piece, as it was followed */
};

/* Replaces the triangles in `crossed` by those of the two sides of the piece. */
void tri_piece_fill(struct tri_pieces *);

#endif
