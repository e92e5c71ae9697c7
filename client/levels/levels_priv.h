/* Shared by the files of this room: passes (levels.c), the tree (levels_tree.c), grids (levels_grid.c), their error
 * (levels_error.c), files (levels_tile.c). */
#ifndef LEVELS_PRIV_H
#define LEVELS_PRIV_H

#include <stdbool.h>
#include <string.h>

#include "err.h"
#include "levels.h"
#include "outfile.h"
#include "page.h"
#include "sort.h"

enum {
	LEVELS_SIDE = 128, /* steps of a grid along a side: a power of two */
	LEVELS_BITS = 7,
	LEVELS_ROW = LEVELS_SIDE + 1,
	LEVELS_SAMPLES = LEVELS_ROW * LEVELS_ROW,
	LEVELS_DEPTHS = 33,
	LEVELS_QUADS = LEVELS_SIDE / 2 * (LEVELS_SIDE / 2), /* of a grid in one of its four children */
	LEVELS_PIECE = 1024,                                /* triangles that are read at a time */
};

typedef __int128 levels_i128;

/* A triangle: places are relative to the low corner of the box, below 2^32. */
struct levels_triangle {
	uint64_t key; /* Morton code of its centroid, the first bits of which are the root's children */
	uint32_t at[3][2];
	int32_t z[3];
	uint32_t leaf; /* of foreign ones: that they lie in, too */
};

/* A square of the quadtree. Its triangles are those whose centroid is in it. */
struct levels_cell {
	uint64_t key; /* the first code in it */
	unsigned depth;
};

struct levels_leaf {
	struct levels_cell cell;
	uint32_t count;
};

/* What the parent of a tile knows of it. */
struct levels_about {
	uint64_t triangles; /* 0: there is nothing, and no file */
	bool grid;
	double error;   /* of a grid, in lattice steps of z */
	double lost;    /* the part of the corners of its triangles, 0 to 1, at which it has no triangle */
	int32_t box[6]; /* of its triangles, lattice numbers */
};

struct levels_grid {
	struct levels_cell cell;
	uint64_t x, y; /* of its corner */
	unsigned step; /* a power of two: its logarithm */
	struct levels_about child[4];
	uint64_t stored; /* where it is in the spool */
	double error;
	uint64_t corners, lost; /* of its triangles, in its square; those where it has no triangle */
	int32_t z[LEVELS_SAMPLES];
	uint8_t has[LEVELS_SAMPLES];
	uint8_t border[4][LEVELS_QUADS]; /* quads in a child, a leaf, that triangles of other leaves meet */
};

struct levels_tile {
	uint32_t x, y; /* of its cell, in cells of this depth */
	uint8_t depth;
};

struct levels {
	struct levels_options opt;
	int32_t low[2]; /* of the box */
	unsigned bits;  /* the root's side is 2^bits lattice steps */
	uint64_t triangles;
	struct sort *sort;
	struct outfile *own, *foreign, *grids; /* sorted triangles; those that reach into other leaves; grids */
	struct levels_leaf *leaf;
	size_t nleaf, leaf_room;
	struct levels_tile *tile; /* that were written */
	size_t ntile, tile_room;
	struct levels_grid *stack[LEVELS_DEPTHS]; /* grids that a leaf is in, by depth */
	uint64_t *inner;                          /* where grids are stored, in the order in which they are entered */
	size_t ninner, inner_room;
	struct levels_about root;
	uint64_t bytes;
	const char *stamp;
	struct page_pack *pack;
	struct levels_buffers *buffers; /* levels_tile.c */
};

int levels_no_memory(struct err *err);
/* Room for one more element of a list. */
int levels_grow(void **list, size_t *room, size_t used, size_t size, struct err *err);

/* levels_tree.c */
uint64_t levels_key(const struct levels *, const uint32_t at[3][2]);
uint64_t levels_place_key(const uint32_t at[2]); /* Morton code of a place */
/* The greatest depth at which both are in one cell. */
unsigned levels_common(uint64_t a, uint64_t b);
bool levels_holds(const struct levels_cell *, uint64_t key);
void levels_corner(const struct levels *, const struct levels_cell *, uint64_t ret[2]);
uint64_t levels_side(const struct levels *, const struct levels_cell *);
/* The sorted triangles into leaves; leaves without triangles are added where others of the same parent have some. */
int levels_cut(struct levels *, struct err *err);
/* Whether a triangle and a square have a place in common; both are closed. */
bool levels_meets(const struct levels_triangle *, const uint64_t corner[2], uint64_t side);
/* Calls `each` for the leaves but `own` that a triangle meets. */
int levels_elsewhere(const struct levels *, const struct levels_triangle *, size_t own,
		     int (*each)(void *ctx, size_t leaf, struct err *err), void *ctx, struct err *err);

/* levels_grid.c */
/* Heights of a triangle at the places of the grid of a leaf's parent, in the leaf, to all grids that the leaf is in. */
void levels_sample(struct levels *, const struct levels_leaf *, const struct levels_triangle *);

/* levels_error.c */
/* The greatest difference between a grid and a triangle where the grid has heights goes into its error; if the triangle is one of
 * its own, corners are counted. */
void levels_compare(struct levels_grid *, const struct levels_triangle *, bool own);
double levels_up(double); /* to thousandths, as numbers are written */

/* levels_tile.c */
const char *levels_tile_name(const struct levels_tile *, char *buf);
int levels_buffers_new(struct levels *, struct err *err);
void levels_buffers_free(struct levels *);
int levels_put_leaf(struct levels *, const struct levels_leaf *, uint64_t first, struct levels_about *ret, struct err *err);
int levels_put_grid(struct levels *, const struct levels_grid *, struct err *err);
void levels_put_about(FILE *, const struct levels_about *);

#endif
