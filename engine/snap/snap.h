/*
 * Breaklines to pieces: lines of any number and origin, which may cross, touch and overlap, become segments between
 * lattice positions that meet at their ends only (docs/design/constraints.md, "Snap rounding"). That is what
 * tri_piece.h takes, if the vertices are among the positions of the mesh.
 *
 * The result depends on the set of lines alone: neither on their order and direction, nor on where a line was cut into
 * files, nor on the memory. Rounding the result once more may change it, so the lines are what is kept.
 */
#ifndef SNAP_H
#define SNAP_H

#include <stdbool.h>
#include <stdint.h>

#include "mesh.h"

struct err;

/* Two segments that cross between their ends, or a position at which vertices of lines have different heights. */
struct snap_crossing {
	int32_t x, y;         /* the position that it was rounded to */
	int32_t lower, upper; /* the heights of both there */
};

struct snap {
	struct mesh_vertex *vertex;     /* distinct positions, by x, then y; the lowest height of each */
	int32_t *highest;               /* and its highest height */
	uint32_t (*piece)[2];           /* numbers of vertices, the smaller one first; distinct, in order */
	uint32_t (*along)[2];           /* a label, and a piece along which an odd number of its segments run; in order */
	struct snap_crossing *crossing; /* by position, then heights */
	struct snap_crossing *uneven;   /* of vertices of lines, lowest and highest; by position */
	uint32_t nvertex, npiece, nalong, ncrossing, nuneven;
	uint32_t points;      /* segments of the input without length */
	uint32_t doubled;     /* segments of the input that were there before, in either direction */
	uint32_t widest;      /* the largest difference of heights of `uneven` */
	int32_t widest_at[2]; /* the first such position */
};

/* `label`: of each segment, 0: none; NULL: none has one. So rings are found again in the pieces. The lowest height of a position
 * is taken of the lowest of the vertices of lines there, and of the lines that cross there between vertices of their lowest
 * heights, and so for the highest; the heights of crossings are those of the lowest. `memory`: bytes that may be in use at a
 * time, the result included. Fails with LIMIT if that is not enough (err->need is not known), and with NOMEM. */
int snap_round(const struct mesh_vertex *, uint32_t nvertex, const uint32_t (*segment)[2], const uint32_t *label,
	       uint32_t nsegment, uint64_t memory, struct snap *ret, struct err *err);
/* Bytes of a result. */
uint64_t snap_bytes(const struct snap *);
void snap_done(struct snap *);

#endif
