/*
 * Windows: the triangles of the whole mesh that meet the window of a view, from the cells that they depend on. The window is
 * divided into pieces (window_piece.h), and each piece becomes a domain.
 */
#ifndef WINDOW_H
#define WINDOW_H

#include <stdint.h>

#include "cut.h"
#include "grid.h"
#include "mesh.h"
#include "view.h"

struct err;

/* The positions that fit an arena for `cap` positions when the tables of a query share its memory. 0: none. */
uint32_t window_cap(uint32_t cap);
/* The same for a window of a grid, which may have lines. */
uint32_t window_cap_of(const struct grid *, uint32_t arena_cap);
/* The pieces of the window that fit an arena for `cap` positions each; about so many as `pieces`, or more, if they are worth it.
 */
int window_plan(struct grid_reader *, const struct view *, uint32_t cap, unsigned pieces, struct cut_plan *ret, struct err *err);
/* Shrinks a region to the part that has its piece of the window. */
void window_tighten(const struct grid *, const struct view *, struct cut_region *);

/* Of a view with weights: no position has a greater one; and as of struct regular. */
struct window_weights {
	int64_t most;
	int (*progress)(void *ctx);
	void *ctx;
};

/* The triangles that meet the region's piece. `reader`: memory of grid_reader_bytes; `arena`: of tri_bytes(cap); *ret points
 * into it. WINDOW_E_SPLIT: the piece does not fit; *ret_need positions would. */
enum { WINDOW_E_SPLIT = 1 };
int window_domain(const struct grid *, const struct view *, struct window_weights, const struct cut_region *, uint32_t cap,
		  void *reader, void *arena, struct mesh_domain *ret, uint64_t *ret_need, struct err *err);

#endif
