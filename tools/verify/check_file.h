/*
 * The parts of acut-verify: reading a PLY back to its lattice, its digests by other code than the engine's, and the
 * points of the inputs.
 */
#ifndef CHECK_FILE_H
#define CHECK_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "digest.h"
#include "lattice.h"
#include "point.h"
#include "view.h"

struct err;

/* A mesh file in memory (check_ply.c). */
struct check_mesh {
	struct lattice lattice;
	struct decimal origin[3]; /* subtracted from the coordinates of the file; zero if the file does not name it */
	bool has_digest;
	struct digest digest, vertex_digest; /* from the file */
	char crs[512];
	char unit_xy[32];     /* "metre" ...; "" if the file does not say it */
	char unit_z[32];      /* likewise */
	bool trimmed;         /* the file says that it has a part of the mesh, */
	bool bounded;         /* and only because it ends at boundaries or holes */
	int32_t (*vertex)[3]; /* lattice numbers */
	uint32_t (*triangle)[3];
	uint8_t *edges; /* as verify_mesh has them; NULL: the file has none */
	size_t nvertex, ntriangle;
};

/* Reads all of `fd`. -ERR_INPUT: not a PLY of acutctl, or not on its lattice; -ERR_TRUNCATED. */
int check_ply_read(int fd, const char *name, struct check_mesh *ret, struct err *err);
void check_mesh_clear(struct check_mesh *);

/* The digests of what was read (check_digest.c). */
struct digest check_triangle_digest(const struct check_mesh *);
struct digest check_vertex_digest(const struct check_mesh *);

/* The points that a view keeps of some files, on a lattice (check_points.c). */
struct check_lines;
struct check_points {
	const char *columns;       /* of texts, as input_options has them; NULL */
	bool decimal_comma;        /* likewise */
	uint8_t slot;              /* of the file that is read next */
	struct check_lines *lines; /* that remove points; NULL: none */
	struct point *pts;
	size_t n, cap;
	uint64_t read, rounded;
	uint64_t removed[VIEW_RULES];
};

/* Whether the weights of the next file are those of its classes. */
bool check_points_by_class(const struct check_points *, const struct view *);
/* -ERR_USAGE: they are, and a text has none, though nobody said what its columns are. */
int check_points_read(struct check_points *, const char *path, const struct lattice *, const struct view *, struct err *err);
/* After all were read: keeps one point of each thin cell, by separate code. */
int check_points_thin(struct check_points *, const struct view *, struct err *err);
void check_points_clear(struct check_points *);
/* The vertices of a mesh on the same scales, as points that the view has kept. -ERR_INPUT: the scales differ. */
int check_points_mesh(struct check_points *, const struct check_mesh *, const struct lattice *, struct err *err);
/* Whether the file begins as a PLY does. */
int check_ply_is(const char *path, bool *ret, struct err *err);

/* Finds the triangle that has a position (check_tree.c). About 30 bytes a triangle. */
enum { CHECK_LEVELS = 12 };
struct check_tree {
	const struct check_mesh *mesh;
	struct check_order *order;           /* triangles */
	struct check_box *box[CHECK_LEVELS]; /* box[0]: of some triangles each; of the last level there is one */
	size_t n[CHECK_LEVELS];
	unsigned levels;
};
/* Triangles have an area and are counter-clockwise. -ERR_NOMEM. Free it even then. */
int check_tree_make(struct check_tree *, const struct check_mesh *, struct err *err);
void check_tree_free(struct check_tree *);
/* One of the closed triangles that have the point, and the doubled areas across from its corners. False: there is none. */
bool check_tree_find(const struct check_tree *, const struct point *, uint32_t *ret, __int128 ret_area[3]);

/* How far points lie above or below the mesh (check_error.c), in steps of the lattice of z: up / down, not negative. */
struct check_fraction {
	__int128 up, down;
};
int check_fraction_compare(struct check_fraction, struct check_fraction); /* exact; -1, 0, 1 */
struct check_error {
	uint64_t inside, outside; /* points over a triangle; over none */
	struct check_fraction largest;
	struct point worst; /* the first with it, if that is above 0 */
	struct point stray; /* the first outside */
};
int check_error(const struct check_mesh *, const struct point *pts, size_t n, struct check_error *ret, struct err *err);

/* Meshes with weights (check_power.c). `pts`: one point of each position, as verify_points leaves them. */
struct check_power {
	uint64_t hidden, outside;    /* positions that are no vertices, and are hidden; in no triangle */
	bool found;                  /* one that is not hidden */
	struct point visible, stray; /* the first of these, and of those outside */
};
/* The weight of each vertex, to be freed; 0 of one that is none of the points. -ERR_NOMEM. */
int check_power_weights(const struct check_mesh *, const struct view *, const struct point *pts, size_t n, int64_t **ret,
			struct err *err);
int check_power(const struct check_mesh *, const int64_t *weight, const struct view *, const struct point *pts, size_t n,
		struct check_power *ret, struct err *err);

#endif
