/*
 * The owned triangles that pieces cross, in which of them a centroid is, and whether one overlaps a triangle: a tree of boxes
 * over the list. The list is in the order of the kernel's triangles, which follow a curve, so that a box is small however long
 * the pieces are.
 */
#include "constrain_priv.h"

#include <string.h>

#include "point.h"

bool constrain_owner_index(struct constrain_work *w)
{
	uint32_t n = w->nown;

	for (w->levels = 0; w->levels == 0 || n > 1; w->levels++) {
		unsigned level = w->levels;
		uint32_t each = level ? INDEX : 1, below = n;

		n = (n + each - 1) / each;
		w->nindex[level] = n;
		w->index[level] = constrain_take(w, n * sizeof(*w->index[level]));
		if (!w->index[level])
			return false;
		for (uint32_t i = 0; i < below; i++) {
			int32_t box[4];

			if (level)
				memcpy(box, w->index[level - 1][i], sizeof(box));
			else
				constrain_triangle_box(&w->r, w->own[i], box);
			if (i % each == 0)
				memcpy(w->index[level][i / each], box, sizeof(box));
			point_box_join(w->index[level][i / each], box);
		}
	}
	return true;
}

/* > 0: the point sum / 3 is on the left of the line from a to b, 0: on it. Doubles decide where their error cannot. */
static int side_of(const int32_t a[2], const int32_t b[2], const int64_t sum[2])
{
	int64_t dx = (int64_t)b[0] - a[0], dy = (int64_t)b[1] - a[1], x = sum[0] - 3 * (int64_t)a[0],
		y = sum[1] - 3 * (int64_t)a[1];
	double left = (double)dx * (double)y, right = (double)dy * (double)x, side = left - right;

	if (fabs(side) > 0x1p-50 * (fabs(left) + fabs(right)))
		return side > 0 ? 1 : -1;
	return geom_sign128((geom_i128)dx * y - (geom_i128)dy * x);
}

/* Whether the point sum / 3 is in the triangle, or on a side of it that is directed upwards. */
static bool triangle_has(const struct constrain_work *w, const uint32_t corner[3], const int64_t sum[2])
{
	for (unsigned i = 0; i < 3; i++) {
		const int32_t *a = w->r.xy[corner[i]], *b = w->r.xy[corner[(i + 1) % 3]];
		int side = side_of(a, b, sum);

		if (side < 0 || (side == 0 && !geom_less(a, b)))
			return false;
	}
	return true;
}

static bool box_has(const int32_t box[4], const int64_t sum[2])
{
	return 3 * (int64_t)box[0] <= sum[0] && sum[0] <= 3 * (int64_t)box[2] && 3 * (int64_t)box[1] <= sum[1] &&
	       sum[1] <= 3 * (int64_t)box[3];
}

static bool group_has(struct constrain_work *w, unsigned level, uint32_t i, const int64_t sum[2])
{
	if (!box_has(w->index[level][i], sum))
		return false;
	if (!level) {
		w->last = i / INDEX;
		return triangle_has(w, w->own[i], sum);
	}
	for (uint32_t k = i * INDEX; k < w->nindex[level - 1] && k < (i + 1) * INDEX; k++)
		if (group_has(w, level - 1, k, sum))
			return true;
	return false;
}

bool constrain_owner_has(struct constrain_work *w, const uint32_t corner[3])
{
	int64_t sum[2] = {0, 0};

	for (unsigned i = 0; i < 3; i++)
		for (unsigned k = 0; k < 2; k++)
			sum[k] += w->r.xy[corner[i]][k];
	if (!w->nown)
		return false;
	/* The one before was probably near. */
	return (w->levels > 1 && w->last < w->nindex[1] && group_has(w, 1, w->last, sum)) || group_has(w, w->levels - 1, 0, sum);
}

/* ---- overlaps ---- */

/* Whether all of b is on the right of a side of a, or on it. */
static bool separates(const struct constrain_work *w, const uint32_t a[3], const uint32_t b[3])
{
	const int32_t(*xy)[2] = w->r.xy;

	for (unsigned i = 0; i < 3; i++) {
		const int32_t *from = xy[a[i]], *to = xy[a[(i + 1) % 3]];

		if (geom_orient(from, to, xy[b[0]]) <= 0 && geom_orient(from, to, xy[b[1]]) <= 0 &&
		    geom_orient(from, to, xy[b[2]]) <= 0)
			return true;
	}
	return false;
}

/* Whether all of the box is on the right of a side of the triangle. */
static bool is_beside(const struct constrain_work *w, const uint32_t corner[3], const int32_t box[4])
{
	for (unsigned i = 0; i < 3; i++) {
		const int32_t *from = w->r.xy[corner[i]], *to = w->r.xy[corner[(i + 1) % 3]];
		const int32_t left[2] = {to[1] > from[1] ? box[0] : box[2], to[0] > from[0] ? box[3] : box[1]};

		if (geom_orient(from, to, left) < 0)
			return true;
	}
	return false;
}

struct overlap {
	const uint32_t *corner;
	int32_t box[4];
};

static bool group_overlaps(const struct constrain_work *w, const struct overlap *o, unsigned level, uint32_t i)
{
	if (!constrain_boxes_meet(w->index[level][i], o->box) || is_beside(w, o->corner, w->index[level][i]))
		return false;
	if (!level)
		return !separates(w, o->corner, w->own[i]) && !separates(w, w->own[i], o->corner);
	for (uint32_t k = i * INDEX; k < w->nindex[level - 1] && k < (i + 1) * INDEX; k++)
		if (group_overlaps(w, o, level - 1, k))
			return true;
	return false;
}

bool constrain_owner_overlaps(const struct constrain_work *w, const uint32_t corner[3])
{
	struct overlap o = {.corner = corner};

	constrain_triangle_box(&w->r, corner, o.box);
	return w->nown && group_overlaps(w, &o, w->levels - 1, 0);
}
