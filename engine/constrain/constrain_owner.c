/*
 * The owned triangles that pieces cross, and in which of them a centroid is: a tree of boxes over the list. The list follows the
 * pieces, and these follow a curve, so that a box is small.
 */
#include "constrain_priv.h"

#include <string.h>

#include "point.h"

static uint32_t groups(uint32_t n)
{
	return (n + INDEX - 1) / INDEX;
}

static void box_of(const struct constrain_work *w, unsigned level, uint32_t i, int32_t ret[4])
{
	if (level == 0)
		constrain_triangle_box(&w->r, w->own[i], ret);
	else
		memcpy(ret, w->index[level - 1][i], 4 * sizeof(int32_t));
}

bool constrain_owner_index(struct constrain_work *w)
{
	uint32_t n = w->nown;

	for (w->levels = 0; w->levels == 0 || n > 1; w->levels++) {
		unsigned level = w->levels;

		w->nindex[level] = groups(n);
		w->index[level] = constrain_take(w, w->nindex[level] * sizeof(*w->index[level]));
		if (!w->index[level])
			return false;
		for (uint32_t i = 0; i < n; i++) {
			int32_t box[4];

			box_of(w, level, i, box);
			if (i % INDEX == 0)
				memcpy(w->index[level][i / INDEX], box, sizeof(box));
			point_box_join(w->index[level][i / INDEX], box);
		}
		n = w->nindex[level];
	}
	return true;
}

/* Whether the point sum / 3 is in the triangle, or on a side of it that is directed upwards. */
static bool triangle_has(const struct constrain_work *w, const uint32_t corner[3], const int64_t sum[2])
{
	for (unsigned i = 0; i < 3; i++) {
		const int32_t *a = w->r.xy[corner[i]], *b = w->r.xy[corner[(i + 1) % 3]];
		geom_i128 side = (geom_i128)((int64_t)b[0] - a[0]) * (sum[1] - 3 * (int64_t)a[1]) -
				 (geom_i128)((int64_t)b[1] - a[1]) * (sum[0] - 3 * (int64_t)a[0]);

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

static bool group_has(const struct constrain_work *w, unsigned level, uint32_t i, const int64_t sum[2])
{
	uint32_t from = i * INDEX, n = level ? w->nindex[level - 1] : w->nown;

	if (!box_has(w->index[level][i], sum))
		return false;
	for (uint32_t k = from; k < n && k < from + INDEX; k++)
		if (level ? group_has(w, level - 1, k, sum) : triangle_has(w, w->own[k], sum))
			return true;
	return false;
}

bool constrain_owner_has(const struct constrain_work *w, const uint32_t corner[3])
{
	int64_t sum[2] = {0, 0};

	for (unsigned i = 0; i < 3; i++)
		for (unsigned k = 0; k < 2; k++)
			sum[k] += w->r.xy[corner[i]][k];
	return w->nown && group_has(w, w->levels - 1, 0, sum);
}
