/*
 * What must be verified. At first owned triangles, the places where edges between cells meet the border, its corners, and half
 * planes outside hull edges whose rays end in the region. What is loaded then is all that can change them: powers only get less
 * when positions are added, so what has less power than all in the region later on had it from the beginning.
 *
 * Then, in each turn, for positions of the region that have no owned triangle one of theirs, the smallest: if it is in the mesh,
 * the position is not hidden.
 */
#include "regular_priv.h"

/* The centre of a triangle, from its first corner. Numerators are exact before they are converted. */
static void centre(const struct regular_work *w, const uint32_t c[3], double ret[2])
{
	struct geom_weighted p = regular_vertex(w, c[0]), q = regular_vertex(w, c[1]), r = regular_vertex(w, c[2]);
	int64_t bx = (int64_t)q.at[0] - p.at[0], by = (int64_t)q.at[1] - p.at[1];
	int64_t cx = (int64_t)r.at[0] - p.at[0], cy = (int64_t)r.at[1] - p.at[1];
	geom_i128 bz = geom_power_lift(bx, by, q.w - p.w), cz = geom_power_lift(cx, cy, r.w - p.w);
	double twice = 2 * (double)((geom_i128)bx * cy - (geom_i128)by * cx);

	ret[0] = (double)(bz * cy - cz * by) / twice;
	ret[1] = (double)(cz * bx - bz * cx) / twice;
}

/* Each number of u has a relative error below 2^-51. *ret_inside: the distance to the nearest border, if it is owned. */
static bool owns(const struct regular_work *w, const uint32_t c[3], const double u[2], double *ret_inside)
{
	*ret_inside = INFINITY;
	for (unsigned side = 0; side < 4; side++) {
		unsigned axis = side & 1;
		double off, value;
		bool upper;

		if (w->box[side] == INT64_MIN || w->box[side] == INT64_MAX)
			continue;
		off = (double)(2 * (int64_t)w->r.xy[c[0]][axis] - w->box[side]);
		value = off + 2 * u[axis];
		if (fabs(value) > 0x1p-46 * (fabs(off) + 2 * fabs(u[axis])))
			upper = value > 0;
		else
			upper = geom_power_side(regular_vertex(w, c[0]), regular_vertex(w, c[1]), regular_vertex(w, c[2]),
						w->box[side], axis == 0) > 0;
		if (upper != (side < 2))
			return false;
		*ret_inside = fmin(*ret_inside, fabs(value) / 2);
	}
	return true;
}

/* Whether the ray outwards from the hull edge a, b (outside on its left) can end in the region: by its direction. */
static bool ends_here(const struct regular_work *w, const int32_t a[2], const int32_t b[2])
{
	const int64_t to[2] = {(int64_t)a[1] - b[1], (int64_t)b[0] - a[0]};

	for (unsigned axis = 0; axis < 2; axis++)
		if (to[axis] > 0 ? w->box[2 + axis] != INT64_MAX : to[axis] < 0 && w->box[axis] != INT64_MIN)
			return false;
	return true;
}

/* Whether the disc of an owned triangle, with its centre so far inside, is certainly in the region. */
static bool disc_inside(const struct regular_work *w, uint32_t corner, const double u[2], double inside)
{
	double square = u[0] * u[0] + u[1] * u[1], more = (double)(w->reach - regular_vertex(w, corner).w);

	inside -= 1 + 0x1p-40 * (fabs(u[0]) + fabs(u[1]));
	return inside > 0 && inside * inside > (square + more) + 0x1p-30 * (square + fabs(more));
}

bool regular_in_region(const struct regular_work *w, const int32_t box[4])
{
	if (w->c->area)
		return w->c->area->holds(w->c->area->ctx, box);
	return 2 * (int64_t)box[0] > w->box[0] && 2 * (int64_t)box[1] > w->box[1] && 2 * (int64_t)box[2] < w->box[2] &&
	       2 * (int64_t)box[3] < w->box[3];
}

/* A disc that is not in the region. */
static int watch_place(struct regular_work *w, uint32_t a, const double u[2])
{
	const struct regular_disc d = {{w->r.xy[a], u[0], u[1]}, (double)(w->most - regular_vertex(w, a).w)};
	int32_t box[4];

	regular_disc_box(&d, box);
	if (!regular_in_region(w, box))
		return regular_disc_add(w, a, u);
	regular_trace_disc(w, a, u);
	return 0;
}

static int watch_triangle(struct regular_work *w, uint32_t i, const double u[2])
{
	regular_set(w->watched, i, true);
	return watch_place(w, w->r.triangle[i].corner[0], u);
}

/* The edges of a triangle that is not owned, or of a ghost, each once. Between two owned ones no edge of cells meets the border.
 */
static int watch_edges(struct regular_work *w, uint32_t i)
{
	const struct tri_triangle *t = &w->r.triangle[i];
	int rc = 0;

	for (unsigned k = 0; k < 3; k++) {
		uint32_t a = t->corner[(k + 1) % 3], b = t->corner[(k + 2) % 3], link = t->link[k];
		uint32_t d = w->r.triangle[link >> 3].corner[(link & 6) >> 1];

		if (a == TRI_GHOST || b == TRI_GHOST || (link >> 3 < i && !regular_bit(w->owned, link >> 3)))
			continue;
		for (unsigned side = 0; !rc && side < w->nborder; side++)
			if (regular_border_meets(w, side, a, b, t->corner[k], d))
				rc = regular_border_add(w, side, a, b);
	}
	return rc;
}

static int watch_one(struct regular_work *w, uint32_t i)
{
	const struct tri_triangle *t = &w->r.triangle[i];
	unsigned ghost = regular_ghost_at(t);
	double u[2], inside;

	if (!tri_regular_used(t))
		return 0;
	if (ghost == 3) {
		centre(w, t->corner, u);
		if (!owns(w, t->corner, u, &inside))
			return watch_edges(w, i);
		regular_set(w->owned, i, true);
		regular_set(w->watched, i, true);
		return disc_inside(w, t->corner[0], u, inside) ? 0 : watch_triangle(w, i, u);
	}
	if (!w->c->no_hull && ends_here(w, w->r.xy[t->corner[(ghost + 1) % 3]], w->r.xy[t->corner[(ghost + 2) % 3]])) {
		regular_set(w->watched, i, true);
		regular_ghost_add(w, i);
	}
	return watch_edges(w, i);
}

static int watch_all(struct regular_work *w)
{
	int rc = 0;

	w->step = REGULAR_REGION;
	regular_border_survey(w);
	for (unsigned i = 0; i < w->ncorner && !rc; i++) {
		const struct regular_corner *c = &w->corner[i];
		const int32_t *at = w->r.xy[c->vertex];

		rc = regular_disc_add(w, c->vertex,
				      (const double[2]){(double)(c->at[0] - 2 * (int64_t)at[0]) / 2,
							(double)(c->at[1] - 2 * (int64_t)at[1]) / 2});
	}
	for (uint32_t i = 0; i < w->r.ntriangle && !rc; i++) {
		rc = regular_progress(w, 1);
		rc = rc ? rc : watch_one(w, i);
	}
	return rc ? rc : regular_read(w);
}

/* Triangles that meet the area. A half plane outside of the hull needs no test: no position is beyond it where it meets the area,
 * and one on its line is in conflict with the triangle at the edge. */
static int watch_area(struct regular_work *w)
{
	const struct regular_area *area = w->c->area;
	int rc = 0;

	w->step = REGULAR_AREA;
	for (uint32_t i = 0; i < w->r.ntriangle && !rc; i++) {
		const uint32_t *c = w->r.triangle[i].corner;
		double u[2];

		rc = regular_progress(w, 1);
		if (!tri_regular_used(&w->r.triangle[i]) || regular_ghost_at(&w->r.triangle[i]) < 3 ||
		    !area->meets(area->ctx, w->r.xy[c[0]], w->r.xy[c[1]], w->r.xy[c[2]]))
			continue;
		regular_set(w->owned, i, true);
		centre(w, c, u);
		rc = rc ? rc : watch_triangle(w, i, u);
	}
	return rc ? rc : regular_read(w);
}

/* Which triangles are owned, of those with a vertex from `first` on. */
static void find_owned(struct regular_work *w, uint32_t first)
{
	for (uint32_t i = 0; i < w->r.ntriangle; i++) {
		const struct tri_triangle *t = &w->r.triangle[i];
		bool real = regular_ghost_at(t) == 3;
		double u[2], inside;

		if (real && t->corner[0] < first && t->corner[1] < first && t->corner[2] < first)
			continue;
		if (real)
			centre(w, t->corner, u);
		regular_set(w->owned, i, real && owns(w, t->corner, u, &inside));
	}
}

/* ---- positions that may be hidden ---- */

/* Whether another position has at most the power of the first one at its place. */
static bool is_under(struct geom_weighted p, struct geom_weighted q)
{
	const int64_t x = (int64_t)q.at[0] - p.at[0], y = (int64_t)q.at[1] - p.at[1];

	return q.w > p.w && geom_power_lift(x, y, q.w - p.w) <= 0;
}

/* Positions of the region are served if they are certainly in the mesh: what they have of the region in their cells is exact.
 * That can be their place, the centre of an owned triangle, or the end of a ray. */
static void serve(struct regular_work *w)
{
	memset(w->served, 0xff, ((size_t)w->r.nvertex + 63) / 64 * sizeof(*w->served));
	for (uint32_t i = 0; i < w->r.ntriangle; i++) {
		const uint32_t *c = w->r.triangle[i].corner;

		for (unsigned k = 0; k < 3 && !regular_bit(w->owned, i); k++) {
			uint32_t from = c[k], to = c[(k + 1) % 3];

			if (from == TRI_GHOST || to == TRI_GHOST)
				continue;
			if (is_under(regular_vertex(w, from), regular_vertex(w, to)))
				regular_set(w->served, from, false);
			if (is_under(regular_vertex(w, to), regular_vertex(w, from)))
				regular_set(w->served, to, false);
		}
	}
	for (uint32_t i = 0; i < w->r.ntriangle; i++) {
		const struct tri_triangle *t = &w->r.triangle[i];
		unsigned ghost = regular_ghost_at(t);
		bool all = regular_bit(w->owned, i) ||
			   (ghost < 3 && tri_regular_used(t) && !w->c->no_hull && regular_owns_hull(w, i, ghost));

		for (unsigned k = 0; all && k < 3; k++)
			if (t->corner[k] != TRI_GHOST)
				regular_set(w->served, t->corner[k], true);
	}
}

/* From p, the place of its cell that is nearest to it, if that is inside of the edge to the cell of a, beside those of c and d.
 * It is near p, where the centres of triangles can be far. */
static bool nearest(const struct regular_work *w, uint32_t p, uint32_t a, uint32_t c, uint32_t d, double ret[2])
{
	const struct geom_weighted from = regular_vertex(w, p), to = regular_vertex(w, a);
	const int64_t x = (int64_t)to.at[0] - from.at[0], y = (int64_t)to.at[1] - from.at[1];
	double part = (double)geom_power_lift(x, y, to.w - from.w) / (2 * (double)geom_power_lift(x, y, 0));
	struct regular_disc disc;

	ret[0] = part * (double)x;
	ret[1] = part * (double)y;
	disc = (struct regular_disc){{from.at, ret[0], ret[1]}, (double)(w->most - from.w)};
	return (c == TRI_GHOST || !regular_disc_holds(&disc, w->most, regular_vertex(w, c))) &&
	       (d == TRI_GHOST || !regular_disc_holds(&disc, w->most, regular_vertex(w, d)));
}

static bool is_asked(const struct regular_work *w, uint32_t v)
{
	return v != TRI_GHOST && !regular_bit(w->served, v) && cut_region_holds(w->c->region, w->r.xy[v][0], w->r.xy[v][1]);
}

/* Positions of which the nearest place of the cell is on an edge of it. */
static int watch_nearest(struct regular_work *w)
{
	int rc = 0;

	for (uint32_t i = 0; i < w->r.ntriangle && !rc; i++) {
		const struct tri_triangle *t = &w->r.triangle[i];

		rc = regular_progress(w, 1);
		for (unsigned k = 0; k < 3 && !rc && tri_regular_used(t) && !regular_bit(w->owned, i); k++) {
			uint32_t p = t->corner[(k + 1) % 3], a = t->corner[(k + 2) % 3], link = t->link[k];
			uint32_t d = w->r.triangle[link >> 3].corner[(link & 6) >> 1];
			double u[2];

			if (a == TRI_GHOST || !is_asked(w, p) || !nearest(w, p, a, t->corner[k], d, u))
				continue;
			regular_set(w->served, p, true);
			rc = watch_place(w, p, u);
		}
	}
	return rc;
}

static bool before(const struct regular_candidate *a, const struct regular_candidate *b)
{
	return a->size != b->size ? a->size < b->size : a->triangle < b->triangle;
}

/* A heap in which the smallest triangle is first. */
static void sift(struct regular_candidate *c, uint32_t n, uint32_t at)
{
	struct regular_candidate moved = c[at];

	for (uint32_t child = 2 * at + 1; child < n; child = 2 * at + 1) {
		child += child + 1 < n && before(&c[child + 1], &c[child]);
		if (!before(&c[child], &moved))
			break;
		c[at] = c[child];
		at = child;
	}
	c[at] = moved;
}

/* For each position the smallest of its triangles that are listed. */
static int watch_listed(struct regular_work *w, struct regular_candidate *c, uint32_t n)
{
	int rc = 0;

	for (uint32_t i = n / 2; i-- > 0;)
		sift(c, n, i);
	while (n && !rc) {
		struct regular_candidate least = c[0];
		double u[2];

		c[0] = c[--n];
		if (n)
			sift(c, n, 0);
		if (regular_bit(w->served, least.vertex))
			continue;
		regular_set(w->served, least.vertex, true);
		if (regular_bit(w->watched, least.triangle))
			continue;
		centre(w, w->r.triangle[least.triangle].corner, u);
		rc = watch_triangle(w, least.triangle, u);
	}
	return rc;
}

/* They are few, at the border. A list that is full is watched, and begins again. */
static int watch_positions(struct regular_work *w)
{
	struct regular_candidate *list = w->list;
	uint32_t n = 0;
	int rc = 0;

	for (uint32_t i = 0; i < w->r.ntriangle && !rc; i++) {
		const struct tri_triangle *t = &w->r.triangle[i];

		rc = regular_progress(w, 1);
		if (regular_ghost_at(t) != 3 || regular_bit(w->owned, i))
			continue;
		for (unsigned k = 0; k < 3 && !rc; k++) {
			double u[2];

			if (!is_asked(w, t->corner[k]))
				continue;
			centre(w, t->corner, u);
			list[n++] = (struct regular_candidate){
				t->corner[k], i, u[0] * u[0] + u[1] * u[1] - (double)regular_vertex(w, t->corner[0]).w};
			if (n == w->mostlist) {
				rc = watch_listed(w, list, n);
				n = 0;
			}
		}
	}
	return rc ? rc : watch_listed(w, list, n);
}

int regular_watch(struct regular_work *w, uint32_t first)
{
	size_t bytes = ((size_t)w->r.ntriangle + 63) / 64 * sizeof(uint64_t);
	int rc = 0;

	memset(w->watched, 0, bytes);
	if (first) {
		find_owned(w, first);
	} else {
		memset(w->owned, 0, bytes);
		if (w->c->area)
			return watch_area(w);
		rc = watch_all(w);
	}
	if (rc)
		return rc;
	serve(w);
	w->step = REGULAR_PLACES;
	rc = watch_nearest(w);
	rc = rc ? rc : watch_positions(w);
	return rc || !regular_disc_groups(w) ? rc : regular_read(w);
}
