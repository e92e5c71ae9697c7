/* An area query in progress: the search for the triangles that meet a piece of a window. window_area.c has the model. */
#ifndef WINDOW_AREA_H
#define WINDOW_AREA_H

#include "constrain.h"
#include "cut_disc.h"
#include "cut_source.h"
#include "tri.h"
#include "window.h"
#include "window_piece.h"

enum {
	WINDOW_RASTER = 256,  /* squares on each axis */
	WINDOW_PICK = 256,    /* most cells in a round */
	WINDOW_DISCS = 4096,  /* most discs in a batch */
	WINDOW_CAP_BYTES = 8, /* of the tables, per position of the arena */
	WINDOW_AGAIN = 100,   /* result of window_area_test */
};

/* The closed disc of a triangle that meets the piece, or the closed half plane of a ghost, if it may contain
 * points of cells that were not read. */
struct window_disc {
	const int32_t *a, *b; /* of a ghost: its side, with the outside on the left */
	struct cut_disc disc; /* unless it is a ghost */
	double at[2];         /* the cells nearest to it are read first */
	double best;          /* distance squared of `cell` from there; INFINITY: no cell */
	bool ghost;
	struct grid_cell cell;
	double depth; /* of `deepest`, the deepest point of the sifted cell in the disc; 0: none */
	struct mesh_vertex deepest;
};

struct window_seen {
	uint64_t place;
	uint32_t segment, used;
};

struct window_pick {
	double far; /* squared */
	struct grid_cell cell;
};

/* Tests choose small ones, so that a few points reach them. 0: the engine's own. */
struct window_limits {
	uint32_t round;  /* most cells in a round, at most WINDOW_PICK */
	uint32_t guess;  /* the first try has room for so many positions more than the cells of the piece have */
	uint32_t inner;  /* in the inner box are at most so many more than twice these */
	double spacings; /* the inner box reaches so many spacings of points around the piece */
	int64_t squares; /* of the raster on each axis, at least; at most WINDOW_RASTER */
};

struct window_area {
	/* the query */
	struct cut_source src;
	const struct view *view;
	const struct cut_region *region;
	struct window_limits limits;
	uint32_t cap; /* positions of the arena */
	struct tri *tri;
	bool highest; /* the view prefers the higher of two heights at a position */
	bool guessed; /* there is more room than `cap` */
	bool clips;   /* of the first cells, only points in `inner` are taken */
	/* its state */
	struct window_piece window;
	bool built;          /* tri has triangles, and points are inserted into them */
	struct point *pts;   /* until then: the points, in the arena */
	uint32_t npts, most; /* most: of the points that are collected */
	uint32_t base;       /* the points read first */
	double spacing;      /* of these points, about */
	int64_t inner[4];    /* with `clips`: a box around the piece, of which all points were read */
	bool begun;          /* they were read */
	bool unsorted;
	bool sift;        /* only points inside a disc are taken from a cell, and the cell counts as not read */
	bool thorough;    /* cells give few points: all cells that meet a disc are read, not only the nearest */
	uint64_t waiting; /* estimate of the positions needed, when the arena is full */
	struct mesh_counts counts;
	/* the cells read beside those that meet the piece */
	struct window_seen *seen;
	uint32_t seen_size, nseen;
	/* around the piece: the squares touched by a cell that was not read */
	int64_t zone[4];
	unsigned shift;
	uint64_t dirty[WINDOW_RASTER][WINDOW_RASTER / 64];
	uint8_t clear[WINDOW_RASTER + 2][WINDOW_RASTER + 2]; /* of [y + 1][x + 1], squares to the nearest touched one */
	struct window_disc *disc;
	uint32_t ndisc, disc_room;
	uint32_t hit[WINDOW_DISCS], nhit; /* discs that meet the sifted cell */
	struct window_pick pick[WINDOW_PICK];
	uint32_t npick;
};

size_t window_area_tables(uint32_t cap);
/* The engine's own in place of each 0. */
struct window_limits window_limits_of(struct window_limits);
/* A query of the region's piece in `tables`, of window_area_tables(cap) bytes. `tri`: after tri_init with `cap`. */
struct window_area *window_area_init(const struct cut_source *, const struct view *, const struct cut_region *,
				     struct window_limits, struct tri *, uint32_t cap, void *tables);
/* Triangulates the piece. *ret_flat: it has no triangle. WINDOW_E_SPLIT as of window_domain. */
int window_area_run(struct window_area *, bool *ret_flat, uint64_t *ret_need, struct err *err);

/* window_domain and window_plan for any source of cells. `memory`: an arena of `room` bytes, at least tri_bytes(cap), then the
 * tables. `lines`: NULL if there are none; for pieces a kernel of about as many positions more must fit the room, for weights a
 * byte a position and regular_bytes(cap). */
struct window_from {
	const struct cut_source *src;
	const struct constrain_lines *lines;
	const struct view *view;
	const struct cut_region *region;
	const struct lattice *lattice; /* for the text of an error; may be NULL */
	struct window_weights weights;
	struct window_limits limits;
	uint32_t cap;
	void *memory;
	size_t room;
};
int window_domain_from(const struct window_from *, const int64_t k[3], struct mesh_domain *ret, uint64_t *ret_need,
		       struct err *err);
/* window_domain_from with weights (window_regular.c). */
int window_regular(const struct window_from *, const int64_t k[3], struct mesh_domain *ret, uint64_t *ret_need, struct err *err);
/* *ret: the positions of all cells that meet the window. */
int window_positions(const struct cut_source *, const struct window_piece *window, uint64_t *ret, struct err *err);
int window_plan_from(const struct cut_source *, const struct view *, uint32_t cap, unsigned pieces, struct cut_plan *ret,
		     struct err *err);

/* window_area_cells.c: reading. WINDOW_E_SPLIT: the points do not fit. */
bool window_area_has_read(const struct window_area *, const struct grid_cell *); /* the cell was read */
int window_area_begin(struct window_area *, struct err *err);       /* reads the cells that meet the piece into pts */
int window_area_around(struct window_area *, struct err *err);      /* reads those next to them, as long as there is room */
int window_area_read_picked(struct window_area *, struct err *err); /* reads the cells of pick */
int window_area_pick_nearest(struct window_area *, uint32_t n, struct err *err); /* picks the n nearest the piece */
/* Adds up to three points from anywhere, so that pts is not collinear; their cells count as not read. */
int window_area_apex(struct window_area *, struct err *err);
bool window_area_full(const struct window_area *);                     /* the table of read cells is full */
bool window_area_build(struct window_area *);                          /* triangulates pts. False: they are collinear */
double window_area_distance(const int32_t box[4], const double at[2]); /* distance squared */
void window_area_pick(struct window_area *, uint32_t most, double far, const struct grid_cell *);

/* window_area_disc.c: tests the triangles that meet the piece. WINDOW_AGAIN: some may be wrong, and the cells to read are picked;
 * when sifting, points were inserted. 0: all are right. */
int window_area_test(struct window_area *, struct err *err);

#endif
