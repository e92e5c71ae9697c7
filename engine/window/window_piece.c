/*
 * Pieces of windows: the header has the model. With a metric a rectangle is none in the mapped plane, and is covered as a polygon
 * is. A test descends the halvings of the region, and ends at the first box that is outside of the cover or entirely in it. A box
 * smaller than the squares of the cover is judged by the square that it lies in, so that the cover does not depend on how the
 * plane is divided.
 */
#include "window_piece.h"

#include <string.h>

enum { GRAINS = 64 }; /* least squares along the longer side of a polygon's bounds (and less than twice as many) */

#define BIAS ((int64_t)1 << 31)

struct shape {
	const int64_t *box;         /* doubled; NULL: a triangle or the plane */
	const int64_t (*corner)[2]; /* doubled, of a triangle; both NULL: the plane */
	int64_t bounds[4];          /* of the triangle */
};

static bool clip_region(const struct window_piece *w, const struct cut_region *r, int64_t ret[4])
{
	int64_t box[4];

	cut_region_box(r, box);
	for (unsigned k = 0; k < 2; k++) {
		ret[k] = box[k] > w->clip[k] ? box[k] : w->clip[k];
		ret[2 + k] = box[2 + k] < w->clip[2 + k] ? box[2 + k] : w->clip[2 + k];
	}
	return ret[0] <= ret[2] && ret[1] <= ret[3];
}

static bool boxes_meet(const int64_t a[4], const int64_t b[4])
{
	return a[0] <= b[2] && a[1] <= b[3] && a[2] >= b[0] && a[3] >= b[1];
}

static bool shape_meets(const struct shape *s, const int64_t box[4])
{
	if (s->box)
		return boxes_meet(s->box, box);
	return !s->corner || (boxes_meet(s->bounds, box) && view_box_meets(box, s->corner));
}

static uint32_t aligned(uint32_t v, unsigned w)
{
	return w >= 32 ? 0 : v >> w << w;
}

/* The area's index cannot exclude that the area meets the box, or the square of the cover around a small box. */
static bool may_meet(const struct window_piece *w, const struct cut_region *r)
{
	unsigned wx = r->wx > w->grain ? r->wx : w->grain, wy = r->wy > w->grain ? r->wy : w->grain;
	int64_t x = (int64_t)aligned(r->x, wx) - BIAS, y = (int64_t)aligned(r->y, wy) - BIAS;
	/* Rounded outwards to whole numbers: region borders lie between these. */
	const int64_t box[4] = {x - 1, y - 1, x + ((int64_t)1 << wx), y + ((int64_t)1 << wy)};

	return view_window_near(w->view, box);
}

static bool cover_meets(const struct window_piece *w, const struct cut_region *r, const struct shape *s)
{
	struct cut_region half[2];
	int64_t box[4];

	if (!clip_region(w, r, box) || !shape_meets(s, box))
		return false;
	if (w->is_box)
		return true;
	if (!may_meet(w, r))
		return false;
	if (r->wx <= w->grain && r->wy <= w->grain)
		return true;
	cut_region_split(r, half);
	return cover_meets(w, &half[0], s) || cover_meets(w, &half[1], s);
}

static bool region_in(const struct cut_region *outer, const struct cut_region *r)
{
	return r->x >= outer->x && (uint64_t)r->x + ((uint64_t)1 << r->wx) <= (uint64_t)outer->x + ((uint64_t)1 << outer->wx) &&
	       r->y >= outer->y && (uint64_t)r->y + ((uint64_t)1 << r->wy) <= (uint64_t)outer->y + ((uint64_t)1 << outer->wy);
}

static unsigned grain_of(const struct view *view)
{
	int64_t bounds[4], size;
	unsigned grain = 0;

	view_window_bounds(view, bounds);
	size = bounds[2] - bounds[0] > bounds[3] - bounds[1] ? bounds[2] - bounds[0] : bounds[3] - bounds[1];
	while (grain < 31 && ((int64_t)GRAINS << (grain + 1)) <= size)
		grain++;
	return grain;
}

bool window_piece_init(struct window_piece *w, const struct view *view, const int32_t data[4], const struct cut_region *region)
{
	const struct shape all = {0};
	struct cut_region at = window_piece_plane(), half[2];

	memset(w, 0, sizeof(*w));
	w->view = view;
	w->is_box = view_window_is_box(view);
	w->region = *region;
	view_window_bounds(view, w->clip);
	for (unsigned k = 0; k < 2; k++) {
		w->clip[k] = 2 * (w->clip[k] > data[k] ? w->clip[k] : data[k]);
		w->clip[2 + k] = 2 * (w->clip[2 + k] < data[2 + k] ? w->clip[2 + k] : data[2 + k]);
	}
	w->grain = grain_of(view);
	if (!clip_region(w, region, w->box))
		return false;
	while (!(at.wx == region->wx && at.wy == region->wy) && cut_region_split(&at, half)) {
		bool upper = !region_in(&half[0], region);
		int64_t box[4];

		if (upper && clip_region(w, &half[0], box))
			w->before[w->nbefore++] = half[0];
		at = half[upper];
	}
	return cover_meets(w, region, &all);
}

void window_piece_tighten(const struct window_piece *w, struct cut_region *ret)
{
	const struct shape all = {0};
	struct cut_region r = w->region, half[2];

	while (cut_region_split(&r, half)) {
		bool lower = cover_meets(w, &half[0], &all);

		if (lower && cover_meets(w, &half[1], &all))
			break;
		r = half[!lower];
	}
	*ret = r;
}

bool window_piece_meets_box(const struct window_piece *w, const int32_t box[4])
{
	const int64_t twice[4] = {2 * (int64_t)box[0], 2 * (int64_t)box[1], 2 * (int64_t)box[2], 2 * (int64_t)box[3]};
	const struct shape s = {.box = twice};

	return cover_meets(w, &w->region, &s);
}

/* The squares of the cover that meet the part of the box in the region. */
static bool cover_holds(const struct window_piece *w, const struct cut_region *r, const struct shape *s)
{
	struct cut_region half[2];
	int64_t box[4];

	if (!clip_region(w, r, box) || !boxes_meet(s->box, box))
		return true;
	if (!may_meet(w, r))
		return false;
	if (r->wx <= w->grain && r->wy <= w->grain)
		return true;
	cut_region_split(r, half);
	return cover_holds(w, &half[0], s) && cover_holds(w, &half[1], s);
}

bool window_piece_holds_box(const struct window_piece *w, const int32_t box[4])
{
	const int64_t twice[4] = {2 * (int64_t)box[0], 2 * (int64_t)box[1], 2 * (int64_t)box[2], 2 * (int64_t)box[3]};
	const struct shape s = {.box = twice};

	if (twice[0] < w->box[0] || twice[1] < w->box[1] || twice[2] > w->box[2] || twice[3] > w->box[3])
		return false;
	return w->is_box || cover_holds(w, &w->region, &s);
}

static void set_bounds(struct shape *s, const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	for (unsigned k = 0; k < 2; k++) {
		int32_t low = a[k] < b[k] ? a[k] : b[k], high = a[k] < b[k] ? b[k] : a[k];

		s->bounds[k] = 2 * (int64_t)(low < c[k] ? low : c[k]);
		s->bounds[2 + k] = 2 * (int64_t)(high > c[k] ? high : c[k]);
	}
}

static void set_corners(struct shape *s, int64_t corner[3][2], const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	for (unsigned k = 0; k < 2; k++) {
		corner[0][k] = 2 * (int64_t)a[k];
		corner[1][k] = 2 * (int64_t)b[k];
		corner[2][k] = 2 * (int64_t)c[k];
	}
	s->box = NULL;
	s->corner = (const int64_t(*)[2])corner;
}

/* Fast path: most triangles that meet the piece have a corner in it. */
static bool holds_corner(const struct window_piece *w, const int32_t at[2])
{
	const struct cut_region here = {.x = (uint32_t)(at[0] + BIAS), .y = (uint32_t)(at[1] + BIAS)};
	const int64_t x = 2 * (int64_t)at[0], y = 2 * (int64_t)at[1];

	if (x < w->box[0] || y < w->box[1] || x > w->box[2] || y > w->box[3])
		return false;
	return w->is_box || may_meet(w, &here);
}

bool window_piece_meets(const struct window_piece *w, const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	int64_t corner[3][2];
	struct shape s;

	if (holds_corner(w, a))
		return true;
	set_bounds(&s, a, b, c);
	if (!boxes_meet(s.bounds, w->box))
		return false;
	set_corners(&s, corner, a, b, c);
	return cover_meets(w, &w->region, &s);
}

static bool box_inside(const int64_t inner[4], const int64_t outer[4])
{
	return inner[0] >= outer[0] && inner[1] >= outer[1] && inner[2] <= outer[2] && inner[3] <= outer[3];
}

bool window_piece_sends(const struct window_piece *w, const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	int64_t corner[3][2];
	struct shape s;

	set_bounds(&s, a, b, c);
	if (!boxes_meet(s.bounds, w->box))
		return false;
	/* It meets no other region. */
	if (w->is_box && box_inside(s.bounds, w->box))
		return true;
	set_corners(&s, corner, a, b, c);
	if (!cover_meets(w, &w->region, &s) || !view_window_meets(w->view, a, b, c))
		return false;
	for (unsigned i = 0; i < w->nbefore; i++)
		if (cover_meets(w, &w->before[i], &s))
			return false;
	return true;
}
