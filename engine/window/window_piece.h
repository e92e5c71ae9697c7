/*
 * A piece of a window: the part of a view's window in one dyadic box of the plane (window_area.c).
 *
 * Boxes cover the window. A rectangle is its own cover; the cover of a polygon is the dyadic squares of one size that
 * its index cannot exclude. A piece is the part of the cover in its region. A triangle that meets the window meets the
 * cover. It is sent with the first piece, in the order of the plane's halvings, whose part of the cover it meets. So
 * the piece that sends a triangle depends on the triangle, the view and the region alone: pieces are independent of
 * each other, and any may be halved at any time. All tests are exact.
 */
#ifndef WINDOW_PIECE_H
#define WINDOW_PIECE_H

#include "cut.h"
#include "view.h"

struct window_piece {
	const struct view *view;
	struct cut_region region;
	bool is_box;                  /* the window is its own cover */
	int64_t clip[4];              /* doubled: the window's bounds within the box of the data */
	int64_t box[4];               /* doubled: clip within the region; empty if box[0] > box[2] or box[1] > box[3] */
	unsigned grain;               /* the squares that cover a polygon have side 2^grain */
	struct cut_region before[64]; /* boxes before the region, in the order of the halvings, that meet the bounds */
	unsigned nbefore;
};

/* The plane as a region. Its sides are finite: all positions lie within the lattice. */
static inline struct cut_region window_piece_plane(void)
{
	return (struct cut_region){.wx = 32, .wy = 32};
}

/* `data`: a box that contains all points. The view has a window, is bound, and is borrowed. False: the piece is
 * empty, and no triangle meets it. */
bool window_piece_init(struct window_piece *, const struct view *, const int32_t data[4], const struct cut_region *);
/* The smallest region that contains the whole piece. */
void window_piece_tighten(const struct window_piece *, struct cut_region *ret);

/* The piece meets a closed box of lattice numbers; a closed triangle that is not flat. */
bool window_piece_meets_box(const struct window_piece *, const int32_t box[4]);
/* All lattice positions of the box are in the piece. False if that is not certain. */
bool window_piece_holds_box(const struct window_piece *, const int32_t box[4]);
bool window_piece_meets(const struct window_piece *, const int32_t a[2], const int32_t b[2], const int32_t c[2]);
/* The triangle is sent with the piece: it meets the piece and the window, and no earlier piece. */
bool window_piece_sends(const struct window_piece *, const int32_t a[2], const int32_t b[2], const int32_t c[2]);

#endif
