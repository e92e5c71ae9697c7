/*
 * Windows: the triangles of the mesh that are requested (view.h). The window is closed, so a triangle that touches it
 * at a corner belongs to it. Boxes are handled here, polygons in view_area.c; both are exact, in integers, on absolute
 * numbers. With a metric boxes and triangles come as they are mapped, and the window stays as it is: a mapped triangle meets the
 * mapped window if and only if it meets the window before both are mapped.
 */
#include <string.h>

#include "view.h"
#include "view_area.h"

/* Twice the signed area of a, b, p for differences within 2^63. */
static __int128 side_of(const int64_t a[2], const int64_t b[2], int64_t x, int64_t y)
{
	return (__int128)(b[0] - a[0]) * (y - a[1]) - (__int128)(b[1] - a[1]) * (x - a[0]);
}

bool view_box_meets(const int64_t box[4], const int64_t t[3][2])
{
	int turn;

	for (unsigned k = 0; k < 2; k++)
		if ((t[0][k] < box[k] && t[1][k] < box[k] && t[2][k] < box[k]) ||
		    (t[0][k] > box[2 + k] && t[1][k] > box[2 + k] && t[2][k] > box[2 + k]))
			return false;
	turn = side_of(t[0], t[1], t[2][0], t[2][1]) > 0 ? 1 : -1;
	for (unsigned i = 0; i < 3; i++) {
		const int64_t *a = t[i], *b = t[(i + 1) % 3];
		int64_t dx = turn * (b[0] - a[0]), dy = turn * (b[1] - a[1]);

		/* The corner of the box that is farthest on the inner side of this side of the triangle. */
		if (side_of(a, b, dy > 0 ? box[0] : box[2], dx > 0 ? box[3] : box[1]) * turn < 0)
			return false;
	}
	return true;
}

/* Windows may be larger than any triangle; bounds farther out than this are clamped. */
static const int64_t far = INT64_C(1) << 40;

static int64_t clamp(__int128 v, int64_t most)
{
	return v < -most ? -most : v > most ? most : (int64_t)v;
}

/* Before they are mapped. */
static void bounds_within(const struct view *v, int64_t most, int64_t ret[4])
{
	for (unsigned i = 0; i < 4; i++)
		ret[i] = clamp((__int128)v->window_box[i] - v->k[i & 1], most);
}

void view_window_bounds(const struct view *v, int64_t ret[4])
{
	int64_t box[4];

	bounds_within(v, far, ret);
	if (!v->map.is.k)
		return;
	/* All positions are far within these bounds. */
	bounds_within(v, INT64_C(1) << 33, box);
	view_map_box(&v->map, box, ret);
	for (unsigned i = 0; i < 4; i++)
		ret[i] = clamp(ret[i], far);
}

bool view_window_is_box(const struct view *v)
{
	return !v->window_area && !v->map.is.k;
}

/* What of the box is in the bounds; false: nothing. So absolute numbers fit. */
static bool clip(const int64_t bounds[4], const int64_t box[4], int64_t ret[4])
{
	if (box[0] > bounds[2] || box[1] > bounds[3] || box[2] < bounds[0] || box[3] < bounds[1])
		return false;
	for (unsigned i = 0; i < 4; i++)
		ret[i] = box[i] < bounds[i & 1] ? bounds[i & 1] : box[i] > bounds[2 + (i & 1)] ? bounds[2 + (i & 1)] : box[i];
	return true;
}

bool view_window_near(const struct view *v, const int64_t box[4])
{
	int64_t bounds[4], at[4];

	if (!v->window)
		return true;
	view_window_bounds(v, bounds);
	if (!clip(bounds, box, at))
		return false;
	if (v->map.is.k) {
		int64_t part[4];

		memcpy(part, at, sizeof part);
		view_map_box_back(&v->map, part, at);
		bounds_within(v, far, bounds);
		if (!clip(bounds, at, at))
			return false;
	}
	if (!v->window_area)
		return true;
	for (unsigned i = 0; i < 4; i++)
		at[i] += v->k[i & 1];
	return view_area_meets(v->window_area, at);
}

bool view_window_meets(const struct view *v, const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	const int32_t *from[3] = {a, b, c};
	int64_t t[3][2], bounds[4];
	int32_t back[3][2];

	if (!v->window)
		return true;
	for (unsigned i = 0; i < 3 && v->map.is.k; i++) {
		view_map_back(&v->map, from[i], back[i]);
		from[i] = back[i];
	}
	for (unsigned i = 0; i < 3; i++)
		for (unsigned k = 0; k < 2; k++)
			t[i][k] = from[i][k];
	bounds_within(v, far, bounds);
	if (!view_box_meets(bounds, (const int64_t(*)[2])t))
		return false;
	for (unsigned i = 0; i < 3 && v->window_area; i++)
		for (unsigned k = 0; k < 2; k++)
			t[i][k] += v->k[k];
	return !v->window_area || view_area_meets_triangle(v->window_area, (const int64_t(*)[2])t);
}
