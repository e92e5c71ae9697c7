/* Made-up meshes, and the lines that the room contour finds in them. */
#ifndef SURFACE_H
#define SURFACE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "contour.h"

struct surface {
	int32_t (*vertex)[3];
	uint32_t (*triangle)[3]; /* counter-clockwise */
	uint32_t nvertex, ntriangle, columns;
};
uint64_t surface_random(uint64_t below);
void surface_seed(uint64_t);
/* A grid of jittered points; heights are multiples of `step` below `heights` of them. Some squares are left out if `holes`. */
void surface_make(struct surface *, uint32_t columns, uint32_t rows, int32_t heights, int32_t step, bool holes);
void surface_done(struct surface *);

struct lines {
	struct contour_line *line;
	double (*point)[2]; /* of all lines, one behind the other */
	char (*height)[DECIMAL_TEXT_SIZE];
	size_t n, npoint;
	uint64_t left_out;
};
struct way {
	uint32_t blocks; /* that the triangles are shared out to by chance; 0: one */
	unsigned segments, pages;
	const char *view;
	struct decimal interval, base;
	uint64_t tile_p, tile_q; /* p 0: no tiles; else all lines of all tiles */
	double simplify;
	unsigned cell;
	uint64_t sort_memory;
	int64_t k[2]; /* 0: 1000000, 2000000 */
};
/* All lines, of triangles in any order; the scale is 0.01 of all axes. */
void surface_lines(const struct surface *, const struct way *, struct lines *ret);
void lines_done(struct lines *);
void lines_same(const struct lines *, const struct lines *);

#endif
