/* Area queries, inside the room: the piece of a window in the middle of being found. pipe_area.c has the model. */
#ifndef PIPE_AREA_H
#define PIPE_AREA_H

#include "cut_source.h"
#include "pipe_window.h"
#include "tri.h"

enum {
	AREA_RASTER = 256,  /* squares an axis */
	AREA_PICK = 256,    /* cells of a round */
	AREA_DISCS = 4096,  /* of a batch, at most */
	AREA_CAP_BYTES = 8, /* of tables, for a position of the arena */
	AREA_AGAIN = 100,   /* from pipe_area_test */
};

/* The closed disc of a triangle that meets the piece, or the closed half plane of a ghost, as far as it may hold
 * points of cells that were not read. */
struct area_disc {
	const int32_t *a, *b; /* corners; a ghost's: its side, outside on the left */
	double ux, uy;        /* from a to the centre */
	double at[2];         /* near which cells are looked for first */
	double best;          /* distance squared of `cell` from there; INFINITY: no cell */
	bool ghost;
	struct grid_cell cell;
	double depth; /* of `deepest` in the disc, in the cell that is sifted; 0: none */
	struct mesh_vertex deepest;
};

struct area_seen {
	uint64_t place;
	uint32_t segment, used;
};

struct area_pick {
	double far; /* squared */
	struct grid_cell cell;
};

struct pipe_area {
	/* what is asked */
	struct cut_source src;
	const struct view *view;
	const struct cut_region *region;
	uint32_t cap;   /* positions of the arena */
	uint32_t round; /* cells of a round, at most AREA_PICK */
	struct tri *tri;
	bool highest; /* of two heights of a position the view prefers the higher one */
	/* the work */
	struct pipe_window window;
	bool built;          /* tri has triangles: points go into them */
	struct point *pts;   /* before: in the arena */
	uint32_t npts, base; /* base: of the cells that meet the piece */
	bool unsorted;
	bool sift;        /* of cells only points that are in the way are taken, and the cells count as not read */
	bool thorough;    /* few points come of the cells: all hits are read, not the nearest ones only */
	uint64_t waiting; /* estimate, when the arena is full */
	struct mesh_counts counts;
	/* what was read beside the cells that meet the piece */
	struct area_seen *seen;
	uint32_t seen_size, nseen;
	/* squares that a cell touches which was not read, around the piece */
	int64_t zone[4];
	unsigned shift;
	uint64_t dirty[AREA_RASTER][AREA_RASTER / 64];
	struct area_disc *disc;
	uint32_t ndisc, disc_room;
	uint32_t hit[AREA_DISCS], nhit; /* discs that the cell that is sifted meets */
	struct area_pick pick[AREA_PICK];
	uint32_t npick;
};

size_t pipe_area_tables(uint32_t cap);
/* The piece of the region into `tri` (of `cap`, tri_init done): *ret_flat: there is no triangle. `tables` of
 * pipe_area_tables(cap). The rest as of pipe_domain, PIPE_E_SPLIT too. `round`: cells a round, for tests; 0: as many as
 * there is room for. */
struct pipe_area *pipe_area_find(const struct cut_source *, const struct view *, const struct cut_region *, uint32_t round,
				 struct tri *, uint32_t cap, void *tables);
int pipe_area_run(struct pipe_area *, bool *ret_flat, uint64_t *ret_need, struct err *err);

/* All of it: a piece to a finished domain, in `memory` for an arena of cap and its tables behind it. */
int pipe_area_from(const struct cut_source *, const struct view *, const struct cut_region *, uint32_t round, uint32_t cap,
		   void *memory, const int64_t k[3], struct mesh_domain *ret, uint64_t *ret_need, struct err *err);
int pipe_area_plan_from(const struct cut_source *, const struct view *, uint32_t cap, struct cut_plan *ret, struct err *err);

/* pipe_area_cells.c: reading. PIPE_E_SPLIT: what was read does not fit. */
bool pipe_area_read(const struct pipe_area *, const struct grid_cell *); /* it was */
int pipe_area_begin(struct pipe_area *, struct err *err);                /* the cells that meet the piece, into pts */
int pipe_area_picked(struct pipe_area *, struct err *err);               /* those of pick */
int pipe_area_nearest(struct pipe_area *, uint32_t n, struct err *err);  /* picks the n nearest the piece */
/* Points that are not on one line with those in pts, from wherever: three at most, their cells count as not read. */
int pipe_area_apex(struct pipe_area *, struct err *err);
bool pipe_area_seen_full(const struct pipe_area *);             /* no more cells can be remembered */
bool pipe_area_build(struct pipe_area *);                       /* pts to triangles. False: they are flat */
double pipe_area_far(const int32_t box[4], const double at[2]); /* distance squared */
void pipe_area_pick(struct pipe_area *, uint32_t most, double far, const struct grid_cell *);

/* pipe_area_disc.c: what may be wrong with the triangles that meet the piece. AREA_AGAIN: cells are picked that must be
 * read; where cells are sifted, points came in. 0: there is nothing wrong. */
int pipe_area_test(struct pipe_area *, struct err *err);

#endif
