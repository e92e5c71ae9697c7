/*
 * The area of a crop or a window: polygons with holes on whole lattice numbers (absolute), and the exact test whether a
 * position is in it. The area is closed: it contains every corner and every point of an edge, also of holes. A polygon
 * is its first ring without the interiors of its other rings; an area is the union of its polygons. The interior of a
 * ring follows the even-odd rule.
 */
#ifndef VIEW_AREA_H
#define VIEW_AREA_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;
struct view_area;

/* Corners are within this of zero, so that differences to any absolute lattice number fit 64 bits. */
#define VIEW_AREA_MOST (INT64_C(1) << 60)

/* Built corner by corner. Rings need not repeat their first corner. */
struct view_area *view_area_new(void);                               /* NULL: no memory */
int view_area_ring(struct view_area *, bool shell, struct err *err); /* shell: begins a polygon */
int view_area_corner(struct view_area *, int64_t x, int64_t y, struct err *err);
/* Brings the rings to their normal form (repeated corners removed; the smallest corner first, then its smaller
 * neighbour; holes without interior removed) and indexes them. -ERR_USAGE: there is no corner. */
int view_area_end(struct view_area *, struct err *err);
void view_area_free(struct view_area *); /* NULL is fine */

/* After view_area_end only. */
bool view_area_has(const struct view_area *, int64_t x, int64_t y);
/* False only if no point of the closed box, on lattice numbers or between them, is in the area. */
bool view_area_meets(const struct view_area *, const int64_t box[4]);
/* Whether the closed triangle meets the area, exactly. Its corners are not collinear. */
bool view_area_meets_triangle(const struct view_area *, const int64_t corner[3][2]);
void view_area_bounds(const struct view_area *, int64_t ret[4]);
/* Whether it is one rectangle along the axes, so that its bounds describe it. */
bool view_area_is_box(const struct view_area *);

size_t view_area_rings(const struct view_area *);
/* Corners of ring i; ret_shell: it begins a polygon. */
size_t view_area_ring_at(const struct view_area *, size_t i, bool *ret_shell, const int64_t (**ret)[2]);

#endif
