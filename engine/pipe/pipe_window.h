/*
 * A window's piece: what one dyadic box of the plane has of the window of a view (pipe_area.c).
 *
 * The window is covered by boxes: one rectangle is its own cover; of a polygon the cover is those dyadic squares of
 * one size that its index does not tell to be outside. A piece is the part of the cover in its region. A triangle that
 * meets the window meets the cover, and is sent with the first piece, in the order of the plane's halvings, whose
 * part of the cover it meets. So which piece sends it depends on triangle, view and region alone: pieces know nothing
 * of each other, and one may be halved at any time. All exact.
 */
#ifndef PIPE_WINDOW_H
#define PIPE_WINDOW_H

#include "cut.h"
#include "view.h"

struct pipe_window {
	const struct view *view;
	struct cut_region region;
	int64_t clip[4];              /* doubled: the window's bounds within the box of the data */
	int64_t box[4];               /* doubled: those within the region; nothing if box[0] > box[2] or box[1] > box[3] */
	unsigned grain;               /* the cover of a polygon is made of squares of side 2^grain */
	struct cut_region before[64]; /* boxes that come before the region and meet the bounds; they and what is behind */
	unsigned nbefore;             /* it, and the region, are the plane */
};

/* The plane. Its sides are finite: all that is asked lies within the lattice. */
static inline struct cut_region pipe_window_plane(void)
{
	return (struct cut_region){.wx = 32, .wy = 32};
}

/* `data`: a box that holds all points. The view, bound, has a window, and stays the caller's. False: the piece is
 * empty, no triangle meets it. */
bool pipe_window_init(struct pipe_window *, const struct view *, const int32_t data[4], const struct cut_region *);
/* The smallest region in it that has all of its piece. */
void pipe_window_tighten(const struct pipe_window *, struct cut_region *ret);

/* Whether a closed box of lattice numbers, a closed triangle (not flat), meets the piece. */
bool pipe_window_has_box(const struct pipe_window *, const int32_t box[4]);
bool pipe_window_has(const struct pipe_window *, const int32_t a[2], const int32_t b[2], const int32_t c[2]);
/* Of a triangle that meets the piece: it meets the window, and no piece before this one. */
bool pipe_window_sends(const struct pipe_window *, const int32_t a[2], const int32_t b[2], const int32_t c[2]);

#endif
