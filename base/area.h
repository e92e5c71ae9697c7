/*
 * Areas of polygons, and the exact test whether a point is in one.
 *
 * A polygon is its first ring without the interiors of its other rings; an area is the union of its polygons; the interior of a
 * ring follows the even-odd rule. A closed area has all of its borders, those of holes too. In a half-open one a point on a
 * border counts as moved to greater x and, much less, to greater y. So of half-open areas side by side each point is in exactly
 * one: a square has its left and lower sides, not the others.
 *
 * Read-only after area_end. A test takes time in proportion to the logarithm of the number of corners, as long as few rings lie
 * over each other and follow their course; memory is about 24 bytes a corner.
 */
#ifndef AREA_H
#define AREA_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct area;
struct err;

/* Corners and points are within this of zero, so that differences fit 64 bits. */
#define AREA_MOST ((INT64_C(1) << 62) - 1)

enum area_border { AREA_HALF_OPEN, AREA_CLOSED };

struct area *area_new(enum area_border);                   /* NULL: no memory */
int area_ring(struct area *, bool shell, struct err *err); /* shell: begins a polygon; the first ring does */
int area_corner(struct area *, int64_t x, int64_t y, struct err *err);
/* Brings the rings to their normal form, before area_end: repeated corners are removed; the smallest corner comes first, then its
 * smaller neighbour; holes without interior are removed. */
void area_normal_form(struct area *);
/* After the last corner; rings need not repeat their first one. */
int area_end(struct area *, struct err *err);
struct area *area_free(struct area *);

/* At any time. The bounds of an area without corners are zeros. */
void area_bounds(const struct area *, int64_t ret[4]);
size_t area_rings(const struct area *);
/* The number of corners of ring i; *ret_shell: it begins a polygon. */
size_t area_ring_at(const struct area *, size_t i, bool *ret_shell, const int64_t (**ret)[2]);

/* After area_end. */
bool area_has(const struct area *, int64_t x, int64_t y);
/* For the closed box x1, y1, x2, y2: an edge meets it, perhaps (AREA_MIXED); or all of its points are inside, or outside. */
enum area_side { AREA_OUT, AREA_IN, AREA_MIXED };
enum area_side area_box(const struct area *, const int64_t box[4]);
/* Whether an edge of a ring meets the closed triangle, which is counter-clockwise. */
bool area_edge_meets(const struct area *, const int64_t corner[3][2]);

/* Whether (x, y) is on the edge from (ax, ay) to (bx, by), ay <= by. *crosses is inverted if a ray to greater x crosses the edge,
 * its lower end included, its upper one not; never if it is on it. Differences of the numbers fit 64 bits. */
static inline bool area_edge_holds(int64_t ax, int64_t ay, int64_t bx, int64_t by, int64_t x, int64_t y, bool *crosses)
{
	__int128 turn;

	if (y < ay || y > by)
		return false;
	if (ay == by)
		return ax < bx ? x >= ax && x <= bx : x >= bx && x <= ax;
	if (x > ax && x > bx)
		return false;
	if (x < ax && x < bx) {
		*crosses ^= y < by;
		return false;
	}
	turn = (__int128)(bx - ax) * (y - ay) - (__int128)(x - ax) * (by - ay);
	if (!turn)
		return true;
	*crosses ^= turn > 0 && y < by;
	return false;
}

#endif
