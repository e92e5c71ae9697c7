/*
 * Small sets of points for fuzzing: on few places, on lines, circles and grids, in clusters, at the ends of the
 * lattice; in several segments, with duplicates and records that a view removes.
 */
#ifndef SETS_H
#define SETS_H

#include "tiling.h"
#include "view.h"

enum { SETS_MAX_N = 60, SETS_MAX_RECORDS = 4 * SETS_MAX_N };

struct sets {
	struct point record[TILING_SEGMENTS][SETS_MAX_RECORDS];
	size_t nrecord[TILING_SEGMENTS];
	unsigned segments;
	struct mesh_vertex pos[SETS_MAX_N]; /* after the view, Morton order */
	unsigned n;
	bool all_kept; /* the view removes nothing */
};

unsigned sets_below(uint64_t *seed, unsigned n);
/* A set and a view of it. */
void sets_make(uint64_t *seed, struct sets *, struct view *ret_view);
/* Computes again the positions that the view keeps, each with the record it prefers. */
void sets_reduce(struct sets *, const struct view *);
/* Radii for some of its classes, and often for sources, of the size of its distances or anything. Calls sets_reduce; view_done
 * frees what the view has then. */
void sets_weights(uint64_t *seed, struct sets *, struct view *);
/* The number of the weight of a position of the set: of the record that the view prefers. */
uint8_t sets_weight_of(const struct sets *, const struct view *, const struct mesh_vertex *);
/* The set's records; valid as long as the set. */
void sets_tiling(uint64_t *seed, struct sets *, struct tiling *ret);

#endif
