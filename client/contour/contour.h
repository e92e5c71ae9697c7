/*
 * Contours: the lines of a mesh on which the height is a level.
 *
 * A vertex is up if its height is at the level or above, else down; a line goes through the edges between up and down, with up
 * on its left. So exactly two triangles share each crossing of an edge inside of the mesh, nothing branches, and a line ends at
 * the border of the mesh or of the window only. Lines, their order, first points and directions depend on the triangles alone,
 * not on how these came in blocks. Memory does not grow with the mesh.
 */
#ifndef CONTOUR_H
#define CONTOUR_H

#include "acut.h"
#include "decimal.h"

struct cursor;
struct err;
struct outfile;
struct packer;

/* A coordinate of lattice number X is (X * a + b) * 10^e; if not `whole`, (X + k) * scale. */
struct contour_axis {
	int64_t a, b;
	int32_t e;
	bool whole;
	struct decimal scale;
	int64_t k;
};

/* A number times num / den; both below 2^31. */
struct contour_length {
	struct decimal value;
	int64_t num, den;
};

struct contour_options {
	struct contour_axis axis[2];
	struct contour_length interval, base; /* levels are base + i * interval, in the unit of heights as they are written */
	int64_t z_num, z_den;                 /* that unit: heights of the stream times this */
	int (*interrupted)(void *ctx);        /* not 0: give up; called while blocks come and lines are joined; may be NULL */
	void *ctx;
	/* Lines are cut at squares of p / q lattice numbers, from the multiples of it, and at most so many have some; p 0: they
	 * are not. A line has a part in each square: low <= c < high. */
	uint64_t tile_p, tile_q; /* q below 2^60 */
	unsigned tiles;
	unsigned segments; /* at once in memory; 0: CONTOUR_SEGMENTS */
	unsigned pages;    /* of 4 KiB in memory when lines are joined; 0: CONTOUR_PAGES */
	/* Above 0: vertices that are no farther than this from what replaces them are left out, in the units of the coordinates.
	 * Lines then meet nowhere but where they did before, and rings stay rings. */
	double simplify;
	unsigned cell;        /* vertices that are looked at together, 2 or more; 0: CONTOUR_CELL */
	uint64_t sort_memory; /* bytes; 0: as it needs */
};
enum { CONTOUR_SEGMENTS = 1 << 15, CONTOUR_PAGES = 1024, CONTOUR_LEVELS = 1000000, CONTOUR_CELL = 1 << 16 };

struct contour;
int contour_new(struct outfile *, struct contour **ret, struct err *err);
/* -ERR_USAGE: an interval that these heights cannot have. */
int contour_head(struct contour *, const struct acut_mesh_head *, const struct contour_options *, struct err *err);
/* In place of contour_head; between two blocks nothing is kept but what contour_save packs and the annex of the output. */
int contour_resume(struct contour *, const struct acut_mesh_head *, const struct contour_options *, struct cursor *,
		   struct err *err);
void contour_save(const struct contour *, struct packer *);
/* `position` is of the block's vertices; corners counter-clockwise. -ERR_USAGE: more than CONTOUR_LEVELS levels from the lowest
 * to the highest vertex. */
int contour_block(struct contour *, const struct acut_mesh_block *, const int32_t (*position)[3], struct err *err);

/* ---- after the last block ---- */

int contour_join(struct contour *, struct err *err);
struct contour_simplified {
	uint64_t vertices, left_out; /* of all lines; by `simplify` */
};
struct contour_simplified contour_simplified(const struct contour *); /* after contour_join; zeros without `simplify` */
/* The numbers of the lowest and the highest level that has lines; false: there are no lines. */
bool contour_range(const struct contour *, int64_t ret[2]);

struct contour_line {
	int64_t level; /* its number: base + level * interval */
	uint64_t points;
	bool closed;   /* the last point is the first one again */
	double box[4]; /* least x y, greatest x y */
	double length; /* in the plane */
};
/* With tiles, before contour_range and contour_next, which are then of it: the next one that has lines, in any order. *ret_any
 * false: there is none. */
int contour_next_tile(struct contour *, int64_t ret[2], bool *ret_any, struct err *err);
/* The next line: by level, then by its first edge. ret->points 0: there is none. */
int contour_next(struct contour *, struct contour_line *ret, struct err *err);
/* Points of this line, from its first on; *ret is valid until the next call. *ret_n 0: there are no more. */
int contour_points(struct contour *, const double (**ret)[2], size_t *ret_n, struct err *err);
/* The height of a level as a double and as text: exact where it is a decimal, as without conversion of units; else rounded to six
 * decimals, or more if levels are less than 0.0001 apart. */
double contour_height(const struct contour *, int64_t level);
char *contour_height_text(const struct contour *, int64_t level, char buf[DECIMAL_TEXT_SIZE]);
/* After the last line: what is left of them in the output's file is removed. */
int contour_done(struct contour *, struct err *err);
struct contour *contour_free(struct contour *);

#endif
