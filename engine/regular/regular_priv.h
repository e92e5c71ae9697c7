/* A domain in progress, as the files of this room share it. Internal. */
#ifndef REGULAR_PRIV_H
#define REGULAR_PRIV_H

#include <string.h>

#include "cut_disc.h"
#include "cut_judge.h"
#include "geom_power.h"
#include "grid.h"
#include "mesh.h"
#include "regular.h"

enum {
	REGULAR_GROUP = 16,      /* discs under one box */
	REGULAR_STEPS = 1 << 15, /* between two calls of `progress`: each takes well below a microsecond */
	REGULAR_GHOSTS = 512,    /* half planes of a batch; all that is outside counts if there are more */
};

/* A finite side of the region. A height on it is that of algorithm.md 4, less the weight. */
struct regular_border {
	unsigned axis; /* 0: it is vertical */
	int64_t c2;    /* doubled */
	int64_t t[2];  /* its ends, doubled; INT64_MIN, INT64_MAX */
	/* The positions that are farthest along it, for its infinite ends: their place, and the least height of these. */
	int32_t most[2];
	geom_i128 least[2];
};

struct regular_corner {
	int64_t at[2];   /* doubled */
	uint32_t vertex; /* one of the least power */
	geom_i128 least; /* four times that */
};

/* What a position must be in to be in conflict: |p - u|^2 <= |u|^2 + more, relative to disc.a. */
struct regular_disc {
	struct cut_disc disc;
	double more;
};

/* Boxes of discs: of what any position must be in, and one without weight. */
struct regular_group {
	int32_t box[4], bare[4];
};

/* An edge between the cells of a and b that meets a side of the region. */
struct regular_cross {
	int32_t at;      /* the place of a along the side, which is before that of b */
	uint32_t side_a; /* four times a, and the side */
	uint32_t b;
};

/* A triangle at a position of the region that has no owned one. */
struct regular_candidate {
	uint32_t vertex, triangle;
	double size;
};

/* What is verified: triangles of the region, and its border; places at which positions of the region are visible; triangles of an
 * area. */
enum regular_step { REGULAR_REGION, REGULAR_PLACES, REGULAR_AREA };

struct regular_work {
	struct regular *c;
	struct err *err;
	struct tri_regular tri;
	int64_t weight[VIEW_WEIGHTS + 1], most; /* most: the greatest */
	int64_t reach; /* for the trace: that of the view, which other generations may have; without a trace `most` */
	struct cut_judge judge;
	struct tri_result r;
	struct cut_range range[4]; /* of the region */
	unsigned nrange;
	int64_t box[4]; /* its borders, as of cut_region_box */
	struct regular_border border[4];
	unsigned nborder;
	struct regular_corner corner[4];
	unsigned ncorner;
	/* Bits of triangles: owned, of all turns; watched: a position in conflict with it is loaded. And bits of vertices. */
	uint64_t *owned, *watched, *served;
	/* The first groups have no discs any more. */
	struct regular_disc *disc;
	struct regular_group *group;
	uint32_t ndisc, mostdisc, nwhole, mostgroup;
	uint32_t *hit, nhit; /* groups that meet the cell that is read */
	/* Of each border; sorted when cells are read, with the first one of each. */
	struct regular_cross *cross;
	uint32_t ncross, mostcross, side[5];
	bool beyond; /* half planes, or ends of borders, meet it */
	uint32_t ghost[REGULAR_GHOSTS], nghost;
	bool all_outside;
	enum regular_step step;
	struct regular_candidate *list;
	uint32_t mostlist;
	struct point *point; /* that are loaded in this turn */
	uint32_t npoint, mostpoint;
	/* Of cross and point: what there is in any case. */
	struct regular_cross *few_cross;
	struct point *few_points;
	uint32_t least_cross, least_points;
	struct cut_cover cover; /* of the trace */
	bool limited;           /* points are not taken in this turn from the key `limit` on, which can be the greatest one */
	uint64_t limit;
	uint32_t steps; /* since the last call of `progress` */
};

static inline bool regular_bit(const uint64_t *bits, uint32_t i)
{
	return bits[i / 64] >> i % 64 & 1;
}
static inline void regular_set(uint64_t *bits, uint32_t i, bool value)
{
	bits[i / 64] = (bits[i / 64] & ~(UINT64_C(1) << i % 64)) | (uint64_t)value << i % 64;
}
/* The corner that is TRI_GHOST, or 3. */
static inline unsigned regular_ghost_at(const struct tri_triangle *t)
{
	return t->corner[0] == TRI_GHOST ? 0 : t->corner[1] == TRI_GHOST ? 1 : t->corner[2] == TRI_GHOST ? 2 : 3;
}
static inline struct geom_weighted regular_vertex(const struct regular_work *w, uint32_t v)
{
	return tri_regular_vertex(&w->tri, v);
}

/* regular_border.c: what can happen on the border of the region. */
void regular_border_init(struct regular_work *);
void regular_border_survey(struct regular_work *); /* corners and ends, from all vertices */
/* Whether the edge between the cells of a and b, beside which are those of c and d (TRI_GHOST: none), meets border i. */
bool regular_border_meets(const struct regular_work *, unsigned i, uint32_t a, uint32_t b, uint32_t c, uint32_t d);
/* Adds that edge, and its place; reads what was added if there is no room for more. */
int regular_border_add(struct regular_work *, unsigned i, uint32_t a, uint32_t b);
void regular_border_sort(struct regular_work *);
/* Whether a position has at most the power of a and b where one of these edges meets the border. */
bool regular_border_below(const struct regular_work *, struct geom_weighted);
/* Whether it has at most the least power at a corner, or is at least as far along a border to an infinite end. */
bool regular_border_ends(const struct regular_work *, struct geom_weighted);
bool regular_border_ends_box(const struct regular_work *, const int32_t box[4]); /* for infinite ends */

/* Whether the ray outwards from the hull edge of a triangle, with TRI_GHOST at that corner, ends in the region. */
bool regular_owns_hull(const struct regular_work *, uint32_t triangle, unsigned ghost);

/* Whether all positions in the box are in the region, or area, and were loaded. */
bool regular_in_region(const struct regular_work *, const int32_t box[4]);

/* regular_watch.c: verifies all, or with `first`, after vertices from there on were added, what more may be hidden. */
int regular_watch(struct regular_work *, uint32_t first);

/* After so many steps; -ERR_CANCELLED. */
int regular_progress(struct regular_work *, uint32_t steps);
int regular_cancelled(struct regular_work *); /* the error */

/* regular_disc.c: discs, in groups. Discs that do not fit are replaced by the boxes of their groups; those of places are read. */
void regular_disc_box(const struct regular_disc *, int32_t ret[4]);
/* Vertex a, and the centre from there. */
int regular_disc_add(struct regular_work *, uint32_t a, const double u[2]);
/* Whether it has a position, or nearly has it. */
bool regular_disc_holds(const struct regular_disc *, int64_t most, struct geom_weighted);
uint32_t regular_disc_groups(const struct regular_work *);
/* Whether a group can have a position of the box, in which weights are less than the greatest by at least `lack`. */
bool regular_disc_meets(const struct regular_work *, uint32_t group, const int32_t box[4], double lack);

/* regular_read.c: half planes, and the cells that meet them or discs. */
void regular_ghost_add(struct regular_work *, uint32_t triangle);
int regular_read(struct regular_work *);    /* what has been added */
void regular_reduce(struct regular_work *); /* the points of this turn: one record for each position, in Morton order */

/* regular_trace.c: what the trace gets, if there is one. */
void regular_trace_init(struct regular_work *);
void regular_trace_disc(struct regular_work *, uint32_t a, const double u[2]);        /* as regular_disc_add */
void regular_trace_points(struct regular_work *);                                     /* those that were loaded in this turn */
void regular_trace_nearest(struct regular_work *, double x, double y, double radius); /* positions in the disc */
int regular_trace_end(struct regular_work *);

/* regular_flat.c: tri_regular_run, with more positions until they are not on one line. */
int regular_flat_run(struct regular_work *, uint64_t *ret_need);

#endif
