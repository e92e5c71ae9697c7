/* Shared by the files of this room: two triangles (volume_pair.c), polygons of --within (volume_within.c), triangles to cells and
 * pairs (volume_cells.c, volume_join.c, volume_leaf.c), one frame for both meshes (volume_frame.c). */
#ifndef VOLUME_PRIV_H
#define VOLUME_PRIV_H

#include <stdbool.h>

#include "volume.h"

typedef __int128 volume_i128;
typedef unsigned __int128 volume_u128;

/* ---- numbers ---- */

/* Sums are whole numbers of these parts of a lattice square or cube; bounds of the error are whole numbers of the smaller ones.
 */
enum { VOLUME_PART = 20, VOLUME_ERROR_PART = 40 };

/* In lattice numbers of the frame, counter-clockwise, the lexicographically least corner (x, y) first. */
struct volume_triangle {
	int32_t at[3][3];
};
/* False: it has no area. Rotates, and turns one that is clockwise. */
bool volume_triangle_normal(struct volume_triangle *);
/* Twice its area. */
volume_i128 volume_triangle_area(const struct volume_triangle *);

enum { VOLUME_CORNERS = 12 };

/* A convex polygon, counter-clockwise, with the difference of two heights over it. Places count from `origin`. */
struct volume_polygon {
	unsigned n;
	int32_t origin[2];
	double x[VOLUME_CORNERS], y[VOLUME_CORNERS], f[VOLUME_CORNERS];
	double extent;          /* of the box that it is in */
	double edge;            /* that, or the longest edge along which a corner was computed */
	double range;           /* of all heights that the differences are made of */
	volume_i128 exact_area; /* twice, where it is known exactly, else 0 */
	int64_t box[4];         /* that it is in: whole numbers, absolute */
};

/* In lattice squares and cubes. */
struct volume_sums {
	volume_i128 fill, cut;               /* volumes */
	volume_i128 shared, filled, lowered; /* areas: compared, with fill, with cut */
	volume_i128 covered[2];              /* area of each mesh */
	volume_u128 error, area_error;
	uint64_t pairs;
};

/* ---- both meshes on one lattice: volume_frame.c ---- */

/* The lattice is divided by this for corners of polygons. */
enum { VOLUME_CORNER_PART = 256 };

/* coordinate = (number + k) * step; axis 0 is x and y, 1 is z. */
struct volume_frame {
	struct decimal step[2];
	int64_t k[3];
	int64_t times[2][2];     /* of a side: steps in one of its own */
	volume_i128 shift[2][3]; /* number = own number * times + shift */
	int64_t level;           /* of z, rounded down */
	double level_part;       /* what is left of a step */
};
/* -ERR_USAGE: they have no common lattice, unit or coordinate system. */
int volume_frame_init(struct volume_frame *, const struct volume_options *, struct err *err);
/* With the offsets that the stream has. */
int volume_frame_head(struct volume_frame *, unsigned side, const struct acut_mesh_head *, const struct volume_options *,
		      struct err *err);
/* False: it does not fit the lattice. */
bool volume_frame_point(const struct volume_frame *, unsigned side, const int32_t from[3], int32_t to[3]);
/* A corner of a polygon in parts of the lattice, absolute. */
int64_t volume_frame_corner(const struct volume_frame *, struct decimal);
/* Nearest double of v / 2^part cubes or squares. */
double volume_frame_cubes(const struct volume_frame *, volume_i128 v, int part);
double volume_frame_squares(const struct volume_frame *, volume_i128 v, int part);

/* ---- two triangles: volume_pair.c ---- */

/* The part of the plane that both cover, and how much b is higher there. False: their interiors do not meet. */
bool volume_pair(const struct volume_triangle *a, const struct volume_triangle *b, struct volume_polygon *ret);
/* A triangle against the height `whole` + `part`, 0 <= part < 1. */
void volume_above(const struct volume_triangle *, int64_t whole, double part, struct volume_polygon *ret);
/* Adds its integrals. `clips`: how often it was cut by a line, none farther off than `reach`; `sign` 1 or -1. */
struct volume_cuts {
	unsigned clips;
	double reach;
	int sign;
};
void volume_add(const struct volume_polygon *, const struct volume_cuts *, struct volume_sums *);

/* ---- polygons: volume_within.c ---- */

struct volume_area;
/* Rings that cross each other are refused. */
int volume_area_new(const struct volume_frame *, const struct ctl_area *, size_t feature, struct volume_area **ret, struct err *);
struct volume_area *volume_area_free(struct volume_area *);
void volume_area_box(const struct volume_area *, int64_t ret[4]); /* lattice numbers, rounded outwards */
/* Adds the part of it that is inside. */
void volume_area_add(const struct volume_area *, const struct volume_polygon *, struct volume_sums *);

/* ---- trees of boxes over a list: its nodes in the order of a walk from the root ---- */

struct volume_node {
	size_t box, low, high; /* its leaves: low <= i < high */
};
static inline struct volume_node volume_half(struct volume_node n, bool second)
{
	size_t middle = n.low + (n.high - n.low) / 2;

	return second ? (struct volume_node){n.box + 2 * (middle - n.low), middle, n.high} :
			(struct volume_node){n.box + 1, n.low, middle};
}

/* ---- results: volume_rows.c ---- */

/* One for all, or one for each polygon. */
struct volume_rows;
int volume_rows_new(const struct volume_frame *, const struct volume_options *, struct volume_rows **ret, struct err *);
struct volume_rows *volume_rows_free(struct volume_rows *);
size_t volume_rows_count(const struct volume_rows *);
/* *ret_name: "" if it has none. */
const struct volume_sums *volume_rows_sums(const struct volume_rows *, size_t i, const char **ret_name);
/* Returns how much of the plane is in a result, in those parts. */
volume_i128 volume_rows_add(struct volume_rows *, const struct volume_polygon *);
/* Of a stream of changes: what the second mesh has beside it, of twice its whole area, both meshes have. */
void volume_rows_kept(struct volume_rows *, volume_i128 area);
void volume_rows_cover(struct volume_rows *, const struct volume_triangle *, unsigned side);

/* ---- images of the difference: volume_image.c ---- */

struct volume_images;
/* Checks all that is known before the meshes, the size of polygons too. Then the files are made, nameless. */
int volume_images_new(const struct volume_options *, const struct volume_frame *, struct volume_images **ret, struct err *);
struct volume_images *volume_images_free(struct volume_images *);
int volume_images_head(struct volume_images *, const struct volume_frame *, const struct acut_mesh_head *, struct err *);
/* -ERR_USAGE: of this box, or of one `slack` times smaller, an image would be too large. With polygons their box counts, which is
 * known. */
int volume_images_check(const struct volume_images *, const struct volume_frame *, const int32_t box[6], double slack,
			struct err *);
int volume_images_pair(struct volume_images *, const struct volume_triangle *a, const struct volume_triangle *b,
		       const struct volume_polygon *, volume_i128 area, struct err *);
/* `box`: where both meshes are; NULL: nowhere. Publishes. *ret_range: of the colours, in the unit of the results, of which `unit`
 * are in one of the meshes'. */
int volume_images_finish(struct volume_images *, const struct volume_frame *, const int32_t box[6], double unit,
			 double *ret_range, struct err *);
/* One of them, for files beside it; NULL: there is none. */
const struct outfile *volume_images_file(const struct volume_images *);

/* ---- cells: volume_cells.c ---- */

/* Cells of whole lattice steps from (x, y); those at the borders have no end. */
struct volume_grid {
	int64_t x, y, w, h;
	uint32_t nx, ny;
};
struct volume_grid volume_grid_of(const int64_t box[4], double cells);
/* Calls `each` for rows of cells that the triangle meets, or comes near to within two lattice steps. */
int volume_cells(const struct volume_grid *, const struct volume_triangle *,
		 int (*each)(void *ctx, uint32_t y, uint32_t x1, uint32_t x2), void *ctx);
/* low <= place < high; the cell of the grid in `rect`. */
struct volume_rect {
	int64_t x1, y1, x2, y2;
};
struct volume_rect volume_grid_cell(const struct volume_grid *, const struct volume_rect *rect, uint32_t x, uint32_t y);

/* ---- pairs in memory: volume_leaf.c ---- */

struct volume_leaf;
enum { VOLUME_LEAF = 1 << 15 }; /* triangles of a side */
/* `interrupted` not 0: joins give up; may be NULL. */
struct volume_leaf *volume_leaf_new(int (*interrupted)(void *ctx), void *ctx);
struct volume_leaf *volume_leaf_free(struct volume_leaf *);
/* Calls `pair` for each two triangles whose common polygon begins in the rectangle. */
struct volume_call {
	int (*pair)(void *ctx, const struct volume_triangle *a, const struct volume_triangle *b, const struct volume_polygon *,
		    struct err *err);
	void *ctx;
};
int volume_leaf_join(struct volume_leaf *, const struct volume_triangle *a, size_t na, const struct volume_triangle *b, size_t nb,
		     const struct volume_rect *, const struct volume_call *, struct err *err);

/* ---- slivers: volume_slab.c ---- */

struct volume_slab_call {
	int (*each)(void *ctx, uint32_t a, uint32_t b); /* not 0: ends it */
	void *ctx;
	int (*interrupted)(void *ctx); /* may be NULL */
	void *ctx_interrupted;
};
/* Calls `each` once for each a[ia[i]] and b[ib[k]] that overlap between x[0] and x[1], with i and k; and perhaps for a few that
 * only touch. Those of a side must not overlap each other. */
int volume_slabs(const struct volume_triangle *a, const uint32_t *ia, size_t na, const struct volume_triangle *b,
		 const uint32_t *ib, size_t nb, const int64_t x[2], const struct volume_slab_call *, struct err *err);

/* ---- pairs of any number: volume_join.c ---- */

struct volume_join;
int volume_join_new(const int64_t box[4], double triangles, const struct outfile *beside, const struct volume_call *,
		    int (*interrupted)(void *ctx), void *ctx, struct volume_join **ret, struct err *err);
int volume_join_add(struct volume_join *, unsigned side, const struct volume_triangle *, struct err *err);
int volume_join_run(struct volume_join *, void (*progress)(void *ctx, double share), struct err *err);
struct volume_join *volume_join_free(struct volume_join *);
/* For tests: other sizes, at which the same comes out. */
struct volume_join_sizes {
	unsigned cell, leaf, depth; /* triangles of a cell, and of a side that are joined in memory; levels of grids */
	uint64_t sort;              /* bytes */
	unsigned crowd;             /* tries, and four times the cells, a triangle, beyond which cells give way to slabs */
};
extern struct volume_join_sizes volume_join_sizes;

#endif
