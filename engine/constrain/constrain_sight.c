/*
 * What is visible in the disc of a triangle T: from T on triangles are followed over edges that are no piece and meet the disc.
 *
 * Let a position p in the closed disc be visible: a segment leads from the inside of T to p that crosses no piece. It may be
 * chosen so that it meets no vertex, except p. It lies in the disc, so it leaves each triangle over an edge that meets the disc
 * and is no piece. So p is in a triangle that is reached on such a path, or beyond an edge of the hull at the end of one. Let the
 * path lead over the edges 0, 1, ..., each with a left end and a right end as seen from T. Then
 *
 * (1) p is not on the near side of an edge i: the segment goes over the line of the edge there, and only once.
 * (2) Let l, the left end of edge i, lie beyond the line of edge 0, and let r, its right end, lie on the right of the line from
 * the right end of edge 0 through l, or on it. Then p is not on the left of that line: the left end of edge 0 is on its left, so
 *     the segment begins there; at edge i it is on the right, and it goes over the line only once.
 * (3) The same with left and right exchanged.
 *
 * Without the two conditions on l and r in (2) visible positions would be missed. Positions that are excluded on each path need
 * not be loaded; they are hidden by pieces that were. An edge that is excluded is not followed, nor a triangle of which nothing
 * is left when it is cut along these lines. Cutting rounds towards keeping more.
 */
#include "constrain_priv.h"

#include <string.h>

#include "point.h"

enum { POLYGON = 24 };

static const uint32_t *corners(const struct constrain_work *w, const struct constrain_sight *s)
{
	return w->r.triangle[s->triangle].corner;
}

static bool is_real(const struct constrain_work *w, const struct constrain_sight *s)
{
	return constrain_real(&w->r.triangle[s->triangle]);
}

/* ---- conditions ---- */

/* A line; what is strictly on its left is excluded. */
struct bound {
	const int32_t *from, *to;
};

/* The bounds of one edge on a path that begins with edge `first`; returns how many. */
static unsigned bounds_of(const struct constrain_work *w, const struct constrain_sight *first, const struct constrain_sight *s,
			  struct bound ret[3])
{
	const int32_t(*xy)[2] = w->r.xy, *l0 = xy[first->left], *r0 = xy[first->right], *l = xy[s->left], *r = xy[s->right];
	unsigned n = 0;

	ret[n++] = (struct bound){r, l};
	if (s->left != first->right && geom_orient(r0, l0, l) < 0 && geom_orient(r0, l, r) <= 0)
		ret[n++] = (struct bound){r0, l};
	if (s->right != first->left && geom_orient(r0, l0, r) < 0 && geom_orient(l0, r, l) >= 0)
		ret[n++] = (struct bound){r, l0};
	return n;
}

/* Whether a bound of the path to s excludes an edge without its ends. list: of the disc. */
static bool edge_excluded(const struct constrain_work *w, const struct constrain_sight *list, const struct constrain_sight *s,
			  const int32_t *const end[2])
{
	const struct constrain_sight *first = &list[s->first];

	for (; s != list; s = &list[s->parent]) {
		struct bound bound[3];
		unsigned n = bounds_of(w, first, s, bound);

		for (unsigned i = 0; i < n; i++)
			if (geom_orient(bound[i].from, bound[i].to, end[0]) >= 0 &&
			    geom_orient(bound[i].from, bound[i].to, end[1]) >= 0)
				return true;
	}
	return false;
}

/* ---- the box of what is visible in a triangle ---- */

struct polygon {
	double at[POLYGON][2];
	unsigned n;
};

/* Keeps what is not strictly on the left, and a little more than that. */
static void cut_off(struct polygon *p, const struct bound *b)
{
	double ex = (double)b->to[0] - b->from[0], ey = (double)b->to[1] - b->from[1], side[POLYGON];
	struct polygon kept;
	bool any = false;

	if (p->n > POLYGON - 2)
		return;
	kept.n = 0;
	for (unsigned i = 0; i < p->n; i++) {
		double x = p->at[i][0] - b->from[0], y = p->at[i][1] - b->from[1];

		side[i] = ex * y - ey * x - 0x1p-30 * (fabs(ex) + fabs(ey)) * 0x1p33;
		any |= side[i] > 0;
	}
	if (!any)
		return;
	for (unsigned i = 0; i < p->n; i++) {
		unsigned k = i + 1 == p->n ? 0 : i + 1;

		/* Of a polygon that is not convex any more by rounding nothing is cut off. */
		if (kept.n + 2 > POLYGON)
			return;
		if (side[i] <= 0)
			memcpy(kept.at[kept.n++], p->at[i], sizeof(p->at[i]));
		if ((side[i] <= 0) == (side[k] <= 0))
			continue;
		for (unsigned c = 0; c < 2; c++)
			kept.at[kept.n][c] = p->at[i][c] + (p->at[k][c] - p->at[i][c]) * (side[i] / (side[i] - side[k]));
		kept.n++;
	}
	*p = kept;
}

/* Sets the box of the part of a triangle that is visible, in the disc's box. False: there is none. */
static bool find_box(const struct constrain_work *w, const struct constrain_disc *d, const struct constrain_sight *list,
		     struct constrain_sight *ret)
{
	const struct constrain_sight *first = &list[ret->first];
	struct polygon p = {.n = 3};

	memcpy(ret->box, d->cap[ret->side], sizeof(ret->box));
	if (!is_real(w, ret))
		return true;
	for (unsigned i = 0; i < 3; i++)
		for (unsigned k = 0; k < 2; k++)
			p.at[i][k] = w->r.xy[corners(w, ret)[i]][k];
	/* (1) of the edges of the path; of (2) and (3) the lines that exclude most. */
	for (const struct constrain_sight *s = ret; s != list; s = &list[s->parent])
		cut_off(&p, &(struct bound){w->r.xy[s->right], w->r.xy[s->left]});
	if (ret->limit[0] != NONE)
		cut_off(&p, &(struct bound){w->r.xy[first->right], w->r.xy[ret->limit[0]]});
	if (ret->limit[1] != NONE)
		cut_off(&p, &(struct bound){w->r.xy[ret->limit[1]], w->r.xy[first->left]});
	for (unsigned k = 0; k < 2; k++) {
		double low = INFINITY, high = -INFINITY;

		for (unsigned i = 0; i < p.n; i++) {
			low = p.at[i][k] < low ? p.at[i][k] : low;
			high = p.at[i][k] > high ? p.at[i][k] : high;
		}
		if (low - 2 > ret->box[k])
			ret->box[k] = low - 2 < INT32_MAX ? (int32_t)(low - 2) : INT32_MAX;
		if (high + 2 < ret->box[2 + k])
			ret->box[2 + k] = high + 2 > INT32_MIN ? (int32_t)(high + 2) : INT32_MIN;
	}
	return ret->box[0] <= ret->box[2] && ret->box[1] <= ret->box[3];
}

/* ---- following ---- */

/* The lines of (2) all begin at the right end of edge 0 and lead beyond it, so one of them excludes most; so with (3). */
static void set_limits(const struct constrain_work *w, const struct constrain_sight *list, struct constrain_sight *s)
{
	const struct constrain_sight *first = &list[s->first];
	const int32_t(*xy)[2] = w->r.xy, *l0 = xy[first->left], *r0 = xy[first->right];
	struct bound bound[3];
	unsigned n = bounds_of(w, first, s, bound);

	s->limit[0] = s == first ? NONE : list[s->parent].limit[0];
	s->limit[1] = s == first ? NONE : list[s->parent].limit[1];
	for (unsigned i = 1; i < n; i++) {
		bool left = bound[i].from == r0;
		uint32_t *limit = &s->limit[!left], end = left ? s->left : s->right;

		if (*limit == NONE ||
		    (left ? geom_orient(r0, xy[*limit], xy[end]) < 0 : geom_orient(l0, xy[*limit], xy[end]) > 0))
			*limit = end;
	}
}

/*
 * By (1) of edge 0, what is visible over it lies in the part of the disc beyond it. If the angle across from the edge is not
 * obtuse, that part is not more than half of the disc. It is then within its height of the edge, which is half of the edge times
 * the tangent of half of the angle.
 */
static void set_caps(const struct constrain_work *w, struct constrain_disc *d)
{
	const uint32_t *corner = w->r.triangle[d->triangle].corner;

	for (unsigned k = 0; k < 3; k++) {
		const int32_t *c = w->r.xy[corner[k]], *a = w->r.xy[corner[(k + 1) % 3]], *b = w->r.xy[corner[(k + 2) % 3]];
		double ax = (double)a[0] - c[0], ay = (double)a[1] - c[1], bx = (double)b[0] - c[0], by = (double)b[1] - c[1];
		double dot = ax * bx + ay * by, both = sqrt((ax * ax + ay * ay) * (bx * bx + by * by));
		double height = hypot(ax - bx, ay - by) / 2 * ((double)geom_area(c, a, b) / (both + dot)) * (1 + 0x1p-30) + 2;

		memcpy(d->cap[k], d->box, sizeof(d->box));
		d->height[k] = dot < 0 ? INFINITY : height;
		if (dot < 0)
			continue;
		for (unsigned i = 0; i < 2; i++) {
			double low = (a[i] < b[i] ? a[i] : b[i]) - height, high = (a[i] < b[i] ? b[i] : a[i]) + height;

			if (low > d->cap[k][i])
				d->cap[k][i] = (int32_t)low;
			if (high < d->cap[k][2 + i])
				d->cap[k][2 + i] = (int32_t)high;
		}
	}
}

static bool edge_meets(const int32_t *const end[2], const int32_t box[4])
{
	int32_t own[4] = {end[0][0], end[0][1], end[0][0], end[0][1]};

	point_box_join(own, (const int32_t[4]){end[1][0], end[1][1], end[1][0], end[1][1]});
	return constrain_boxes_meet(own, box);
}

/* Whether an edge begins at a corner of the disc's triangle, which is on the circle, and leads away from the disc. */
static bool leads_away(const struct constrain_work *w, const struct constrain_disc *d, const uint32_t end[2])
{
	const uint32_t *corner = w->r.triangle[d->triangle].corner;

	for (unsigned i = 0; i < 2; i++) {
		const int32_t *from = w->r.xy[end[i]], *to = w->r.xy[end[!i]];
		double ex = (double)to[0] - from[0], ey = (double)to[1] - from[1];
		double ux = (double)d->disc.a[0] - from[0] + d->disc.ux, uy = (double)d->disc.a[1] - from[1] + d->disc.uy;
		double slack = 0x1p-40 * (fabs(ex) + fabs(ey)) * (fabs(d->disc.ux) + fabs(d->disc.uy) + fabs(ux) + fabs(uy));

		if ((end[i] == corner[0] || end[i] == corner[1] || end[i] == corner[2]) && ex * ux + ey * uy < -slack)
			return true;
	}
	return false;
}

/* Adds the triangles behind the edges of one. False: there are too many. */
static bool follow(const struct constrain_work *w, const struct constrain_disc *d, struct constrain_sight *list, uint32_t from,
		   uint32_t *n)
{
	const struct tri_triangle *t = &w->r.triangle[list[from].triangle];

	for (unsigned k = 0; k < 3; k++) {
		uint32_t right = t->corner[(k + 1) % 3], left = t->corner[(k + 2) % 3];
		const int32_t *const end[2] = {w->r.xy[right], w->r.xy[left]};
		uint32_t side = from ? list[from].side : k;

		/* Back over the edge by which it was entered: the ends are exchanged. */
		if (t->link[k] & 1 || (from && right == list[from].left && left == list[from].right) ||
		    (from && leads_away(w, d, (const uint32_t[2]){right, left})) || !edge_meets(end, d->cap[side]) ||
		    !cut_disc_meets_edge(&d->disc, end[0], end[1]) || edge_excluded(w, list, &list[from], end))
			continue;
		if (*n == SIGHT)
			return false;
		list[*n] = (struct constrain_sight){.triangle = t->link[k] >> 3,
						    .left = left,
						    .right = right,
						    .parent = (uint16_t)from,
						    .side = side,
						    .first = from ? list[from].first : (uint16_t)*n};
		set_limits(w, list, &list[*n]);
		*n += find_box(w, d, list, &list[*n]);
	}
	return true;
}

void constrain_sight_follow(struct constrain_work *w, struct constrain_disc *d)
{
	struct constrain_sight *list = w->sight + w->nsight;
	uint32_t n = 1;

	set_caps(w, d);
	d->sight = w->nsight;
	d->nsight = 0;
	list[0] = (struct constrain_sight){.triangle = d->triangle, .limit = {NONE, NONE}};
	constrain_triangle_box(&w->r, corners(w, &list[0]), list[0].box);
	for (uint32_t i = 0; i < n; i++)
		if (is_real(w, &list[i]) && !follow(w, d, list, i, &n))
			return;
	memcpy(d->box, list[0].box, sizeof(d->box));
	for (uint32_t i = 1; i < n; i++)
		point_box_join(d->box, list[i].box);
	d->nsight = n;
	w->nsight += n;
}

/* ---- what is in sight ---- */

/* Whether the closed box meets the outside beyond a ghost, or touches its side. */
static bool meets_outside(const struct constrain_work *w, const uint32_t corner[3], const int32_t box[4])
{
	unsigned k = corner[0] == TRI_GHOST ? 0 : corner[1] == TRI_GHOST ? 1 : 2;
	const int32_t *a = w->r.xy[corner[(k + 1) % 3]], *b = w->r.xy[corner[(k + 2) % 3]];
	const int32_t far[2] = {b[1] > a[1] ? box[0] : box[2], b[0] > a[0] ? box[3] : box[1]};

	return geom_orient(a, b, far) >= 0;
}

static bool triangle_has(const struct constrain_work *w, const uint32_t corner[3], const int32_t at[2])
{
	for (unsigned k = 0; k < 3; k++)
		if (geom_orient(w->r.xy[corner[k]], w->r.xy[corner[(k + 1) % 3]], at) < 0)
			return false;
	return true;
}

/* Whether all of a closed box is strictly on the left of the line. */
static bool is_left(const int32_t from[2], const int32_t to[2], const int32_t box[4])
{
	/* The corner that is farthest to the right. */
	const int32_t far[2] = {to[1] > from[1] ? box[2] : box[0], to[0] > from[0] ? box[1] : box[3]};

	return geom_orient(from, to, far) > 0;
}

/* Whether a condition excludes the box on the path to s. */
static bool excluded(const struct constrain_work *w, const struct constrain_sight *list, const struct constrain_sight *s,
		     const int32_t box[4])
{
	const int32_t(*xy)[2] = w->r.xy;
	const struct constrain_sight *first = &list[s->first];

	if ((s->limit[0] != NONE && is_left(xy[first->right], xy[s->limit[0]], box)) ||
	    (s->limit[1] != NONE && is_left(xy[s->limit[1]], xy[first->left], box)))
		return true;
	for (; s != list; s = &list[s->parent])
		if (is_left(xy[s->right], xy[s->left], box))
			return true;
	return false;
}

bool constrain_sight_meets(const struct constrain_work *w, const struct constrain_disc *d, uint32_t i, const int32_t box[4])
{
	const struct constrain_sight *list = w->sight + d->sight;

	return constrain_boxes_meet(list[i].box, box) && !excluded(w, list, &list[i], box);
}

bool constrain_sight_box(const struct constrain_work *w, const struct constrain_disc *d, const int32_t box[4])
{
	const struct constrain_sight *list = w->sight + d->sight;

	for (uint32_t i = 0; i < d->nsight; i++)
		if (constrain_boxes_meet(list[i].box, box) && !excluded(w, list, &list[i], box))
			return true;
	return !d->nsight;
}

uint32_t constrain_sight_list(const struct constrain_work *w, const struct constrain_disc *d, const int32_t box[4],
			      struct constrain_hit *ret, uint32_t most)
{
	const struct constrain_sight *list = w->sight + d->sight;
	uint32_t n = 0;

	for (uint32_t i = 0; i < d->nsight; i++) {
		if (!constrain_boxes_meet(list[i].box, box) || excluded(w, list, &list[i], box))
			continue;
		if (n < most)
			ret[n].sight = i;
		n++;
	}
	return n;
}

bool constrain_sight_in(const struct constrain_work *w, const struct constrain_disc *d, uint32_t i, const int32_t at[2])
{
	const struct constrain_sight *list = w->sight + d->sight, *s = &list[i];
	const int32_t box[4] = {at[0], at[1], at[0], at[1]};

	return constrain_boxes_meet(s->box, box) &&
	       (is_real(w, s) ? triangle_has(w, corners(w, s), box) : meets_outside(w, corners(w, s), box)) &&
	       !excluded(w, list, s, box);
}

bool constrain_sight_point(const struct constrain_work *w, const struct constrain_disc *d, const int32_t at[2])
{
	for (uint32_t i = 0; i < d->nsight; i++)
		if (constrain_sight_in(w, d, i, at))
			return true;
	return !d->nsight;
}
