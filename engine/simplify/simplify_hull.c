/* The convex hull of positions, by Andrew's chains. What lies inside an octagon of extreme points is not sorted; most of that
 * lies in a box inside it. */
#include <stdlib.h>

#include "digest.h"
#include "geom.h"
#include "simplify_greedy.h"

enum { SIDES = 8 };

static int place_order(const void *a, const void *b)
{
	const struct simplify_place *p = a, *q = b;

	return p->place < q->place ? -1 : p->place > q->place;
}

static void corner(const struct point *p, int32_t ret[2])
{
	ret[0] = p->x;
	ret[1] = p->y;
}

/* The farthest points in eight directions, counter-clockwise. */
static void find_octagon(const struct point *pts, uint32_t n, int32_t ret[SIDES][2])
{
	static const int way[SIDES][2] = {{1, 0}, {1, 1}, {0, 1}, {-1, 1}, {-1, 0}, {-1, -1}, {0, -1}, {1, -1}};
	int64_t most[SIDES];

	for (unsigned k = 0; k < SIDES; k++)
		most[k] = INT64_MIN;
	for (uint32_t i = 0; i < n; i++)
		for (unsigned k = 0; k < SIDES; k++) {
			int64_t far = (int64_t)pts[i].x * way[k][0] + (int64_t)pts[i].y * way[k][1];

			if (far > most[k]) {
				most[k] = far;
				corner(&pts[i], ret[k]);
			}
		}
}

static bool is_inside(int32_t octagon[SIDES][2], const struct point *p)
{
	bool any = false;
	int32_t at[2];

	corner(p, at);
	for (unsigned k = 0; k < SIDES; k++) {
		const int32_t *a = octagon[k], *b = octagon[(k + 1) % SIDES];

		if (a[0] == b[0] && a[1] == b[1])
			continue;
		any = true;
		if (geom_orient(a, b, at) <= 0)
			return false;
	}
	return any; /* a single point has no side */
}

/* A box inside the octagon, somewhat smaller than that between its oblique corners; empty if that is not inside. */
static void find_box(int32_t octagon[SIDES][2], int32_t ret[4])
{
	const int32_t *ne = octagon[1], *nw = octagon[3], *sw = octagon[5], *se = octagon[7];
	const int64_t low[2] = {sw[0] > nw[0] ? sw[0] : nw[0], sw[1] > se[1] ? sw[1] : se[1]},
		      high[2] = {se[0] < ne[0] ? se[0] : ne[0], nw[1] < ne[1] ? nw[1] : ne[1]};

	for (unsigned k = 0; k < 2; k++) {
		ret[k] = (int32_t)(low[k] + (high[k] - low[k]) / 16);
		ret[2 + k] = (int32_t)(high[k] - (high[k] - low[k]) / 16);
	}
	for (unsigned k = 0; k < 4; k++) {
		const struct point p = {.x = ret[k & 1 ? 2 : 0], .y = ret[k & 2 ? 3 : 1]};

		if (!is_inside(octagon, &p))
			ret[0] = INT32_MAX;
	}
}

/* Extends a chain that turns left. */
static uint32_t extend(const struct point *pts, uint32_t *chain, uint32_t n, uint32_t least, uint32_t next)
{
	int32_t a[2], b[2], c[2];

	corner(&pts[next], c);
	for (; n >= least + 2; n--) {
		corner(&pts[chain[n - 2]], a);
		corner(&pts[chain[n - 1]], b);
		if (geom_orient(a, b, c) > 0)
			break;
	}
	chain[n] = next;
	return n + 1;
}

uint32_t simplify_hull(const struct point *pts, uint32_t n, struct simplify_place *order, uint32_t *ret)
{
	int32_t octagon[SIDES][2], box[4];
	uint32_t m = 0, count = 0, lower;

	find_octagon(pts, n, octagon);
	find_box(octagon, box);
	for (uint32_t i = 0; i < n; i++)
		if ((pts[i].x < box[0] || pts[i].y < box[1] || pts[i].x > box[2] || pts[i].y > box[3]) &&
		    !is_inside(octagon, &pts[i]))
			order[m++] = (struct simplify_place){digest_place(pts[i].x, pts[i].y), i};
	qsort(order, m, sizeof *order, place_order);
	for (uint32_t i = 0; i < m; i++)
		count = extend(pts, ret, count, 0, order[i].at);
	lower = count - 1;
	for (uint32_t i = m - 1; i-- > 0;)
		count = extend(pts, ret, count, lower, order[i].at);
	return count > 1 ? count - 1 : count; /* the first came again */
}
