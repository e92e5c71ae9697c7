/*
 * Lines for acut-verify: files of lines to segments on the lattice of a mesh (check_lines.c), these to pieces by snap rounding
 * (check_snap.c), areas of lakes, boundaries and holes (check_area.c), and a mesh compared with all of it (check_pieces.c). The
 * rules are those of docs/design/constraints.md and docs/formats/lines.md; no code is shared with engine/snap, engine/breakline
 * and engine/lineset. Everything is in memory, and nothing is rounded but where the rules say so.
 */
#ifndef CHECK_LINES_H
#define CHECK_LINES_H

#include "check_file.h"
#include "lines_export.h"

struct check_segment { /* between two vertices of a line, in its direction */
	int32_t a[2], b[2];
	uint32_t area; /* whose ring it is part of, from 1; 0: none */
	uint32_t feature, file;
};

struct check_vertex { /* a position of the result; by x, then y */
	int32_t x, y, low, high;
	bool used;   /* an end of a piece */
	bool absent; /* all of its pieces are absent */
};

struct check_piece { /* by its ends, which are numbers of vertices, the smaller one first */
	uint32_t end[2];
	uint32_t from;      /* a segment that runs along it */
	uint8_t turns;      /* CHECK_LAKE, CHECK_OUT: what differs between its sides */
	bool found, absent; /* in the mesh; need not be there */
};

enum { CHECK_LAKE = 1, CHECK_OUT = 2 };

/* Items by the square cells that they meet. */
struct check_cell {
	uint64_t key;
	uint32_t item;
};
struct check_grid {
	unsigned shift;
	struct check_cell *cell;
	size_t n, cap;
};

struct check_edge { /* of an area: a piece that an odd number of its segments run along; by pieces */
	uint32_t piece, area;
};

struct check_lines {
	char **file;
	uint32_t nfiles;
	struct check_segment *segment;
	size_t nsegment, segment_cap;
	struct check_vertex *vertex; /* first all of the input, then those of the result */
	size_t nvertex, vertex_cap;
	struct check_piece *piece;
	size_t npiece;
	uint8_t *area; /* enum lines_kind of each, from 1 */
	size_t nareas, area_cap;
	struct check_edge *edge;
	size_t nedge;
	/* States of positions. */
	struct check_grid band; /* edges by rows */
	uint8_t *parity;        /* of each area, while a state is made */
	uint32_t *touched;
	uint64_t boundaries;
	struct check_grid near; /* pieces */
	double clear;
	bool part;                /* the mesh may lack pieces and vertices */
	uint64_t left_out;        /* pieces that are out on both sides */
	uint64_t checked, absent; /* pieces in the mesh; those that need not be there */
};

struct check_lines_options {
	struct lines_export_options text;
	const char *layer, *kind_field;
};

/* A text of lines, or any file that acutctl takes as lines. May be called for several. */
int check_lines_read(struct check_lines *, const char *path, const struct check_lines_options *, const struct check_mesh *,
		     struct err *err);
/* After all were read: pieces, vertices and areas. `clear`: points that are nearer to a piece go. */
int check_lines_round(struct check_lines *, double clear, struct err *err);
/* 0, or why the record of a survey point is removed: POINT_NEAR_LINE, POINT_IN_AREA. */
unsigned check_lines_mark(struct check_lines *, int32_t x, int32_t y);

struct check_fault {
	const char *fault; /* NULL: none */
	char text[256];
	int32_t place[3];
};
/* The pieces and the edges of the mesh that are marked as such are the same, heights are those of the lines, no triangle is out,
 * and the mesh ends where it may. `view`: its crop and its heights. */
int check_lines_mesh(struct check_lines *, const struct check_mesh *, const struct view *, struct check_fault *ret,
		     struct err *err);
/* The vertices that the mesh must have, beside the points that were read. */
int check_lines_points(const struct check_lines *, const struct view *, struct check_points *, struct err *err);
void check_lines_clear(struct check_lines *);

/* ---- parts ---- */

int check_no_memory(struct err *err);

/* Twice the area of a, b, p, counter-clockwise positive. */
static inline __int128 check_side(const int32_t *a, const int32_t *b, const int32_t *p)
{
	return (__int128)((int64_t)b[0] - a[0]) * ((int64_t)p[1] - a[1]) -
	       (__int128)((int64_t)b[1] - a[1]) * ((int64_t)p[0] - a[0]);
}

static inline int check_sign(__int128 v)
{
	return (v > 0) - (v < 0);
}

static inline void check_place(const struct check_lines *l, uint32_t vertex, int32_t ret[2])
{
	ret[0] = l->vertex[vertex].x;
	ret[1] = l->vertex[vertex].y;
}

/* Cells as large as n segments are on average. */
unsigned check_grid_shift(double sum_of_lengths, size_t n);
/* Passes the cells within `wide` of a segment, column by column, perhaps some more. */
typedef int (*check_column_fn)(void *ctx, uint64_t low_key, uint64_t high_key);
int check_grid_walk(unsigned shift, const int32_t *a, const int32_t *b, int64_t wide, check_column_fn, void *ctx);
int check_grid_add(struct check_grid *, uint32_t item, const int32_t *a, const int32_t *b, int64_t wide, struct err *err);
void check_grid_sort(struct check_grid *);
/* The first cell of a key of at least this one. */
size_t check_grid_find(const struct check_grid *, uint64_t key);
uint64_t check_grid_key(unsigned shift, int64_t x, int64_t y);

/* Pieces and vertices from segments. The edges of areas are set, too. */
int check_snap(struct check_lines *, struct err *err);
/* What pieces turn; pieces that are out on both sides, and vertices without pieces, are left out. */
int check_areas(struct check_lines *, struct err *err);
/* The state of (x / den, y / den), den 1 to 3, moved to greater x and, much less, greater y. */
unsigned check_state(struct check_lines *, int64_t x, int64_t y, int64_t den);

#endif
