/*
 * Reads the cells that can have positions of less power than what is watched, and takes those positions. Discs and half planes
 * choose the cells, and err towards reading. Whether a position is taken is exact, and depends on the triangulation,
 * the watched triangles and the position alone: it is in conflict with a watched triangle, or has at most the least power
 * somewhere on the border. It is then visible, so no vertex has its position.
 */
#include "cut_order.h"
#include "regular_priv.h"

/* What a point costs beside one step: groups of discs for another one; the search for triangles in conflict. */
enum { STEPS_HIT = 8, STEPS_SEARCH = 16 };

void regular_ghost_add(struct regular_work *w, uint32_t triangle)
{
	if (w->nghost == REGULAR_GHOSTS)
		w->all_outside = true;
	else
		w->ghost[w->nghost++] = triangle;
}

/* Whether a corner of the box is not inside of the hull edge. */
static bool ghost_meets(const struct regular_work *w, uint32_t triangle, const int32_t box[4])
{
	const struct tri_triangle *t = &w->r.triangle[triangle];
	unsigned g = regular_ghost_at(t);
	const int32_t *a = w->r.xy[t->corner[(g + 1) % 3]], *b = w->r.xy[t->corner[(g + 2) % 3]];

	for (unsigned i = 0; i < 4; i++) {
		const int32_t at[2] = {box[i & 1 ? 2 : 0], box[i & 2 ? 3 : 1]};

		if (geom_orient(a, b, at) >= 0)
			return true;
	}
	return false;
}

/* Whether a position beyond the hull, or far along a border, can be in the box. */
static bool beyond_meets(const struct regular_work *w, const int32_t box[4])
{
	if (w->all_outside || (w->step == REGULAR_REGION && regular_border_ends_box(w, box)))
		return true;
	for (uint32_t i = 0; i < w->nghost; i++)
		if (ghost_meets(w, w->ghost[i], box))
			return true;
	return false;
}

static double lack_of(const struct regular_work *w, const struct grid_cell *cell)
{
	return w->c->most_of ? (double)(w->most - w->c->most_of(w->c->most_ctx, cell)) : 0;
}

static bool cell_matters(const struct regular_work *w, const struct grid_cell *cell)
{
	double lack = lack_of(w, cell);

	for (uint32_t i = 0; i < regular_disc_groups(w); i++)
		if (regular_disc_meets(w, i, cell->box, lack))
			return true;
	return beyond_meets(w, cell->box);
}

/* ---- positions ---- */

static bool is_watched(void *ctx, uint32_t triangle)
{
	const struct regular_work *w = ctx;

	return regular_bit(w->watched, triangle);
}

/*
 * Whether a position, which is near a disc, is in conflict with a watched triangle, or has at most the least power somewhere on
 * the border. If it has not on the border, its cell is in the region or outside of it as a whole, and so are the centres of all
 * triangles in conflict: the one around the position is as good as any. Places are the centres of their discs: what is in one,
 * matters.
 */
static bool matters(struct regular_work *w, struct geom_weighted p)
{
	uint32_t around;

	if (w->step == REGULAR_AREA)
		return tri_regular_search(&w->tri, p, is_watched, w);
	return tri_regular_around(&w->tri, p, &around) && (w->step == REGULAR_PLACES || regular_bit(w->watched, around) ||
							   regular_border_ends(w, p) || regular_border_below(w, p));
}

/* Most positions of a cell are in no disc. */
static bool near_discs(const struct regular_work *w, struct geom_weighted p)
{
	const int32_t box[4] = {p.at[0], p.at[1], p.at[0], p.at[1]};

	for (uint32_t i = 0; i < w->nhit; i++)
		if (regular_disc_meets(w, w->hit[i], box, (double)(w->most - p.w)))
			return true;
	return w->beyond;
}

static bool point_before(const void *ctx, const struct point *a, const struct point *b)
{
	const struct view *view = ctx;

	if (a->x == b->x && a->y == b->y)
		return view_prefers(view, a, b);
	return cut_order_before(a->x, a->y, b->x, b->y);
}

void regular_reduce(struct regular_work *w)
{
	uint32_t n = 0;

	cut_order_sort(w->point, w->npoint, point_before, w->c->view);
	for (uint32_t i = 0; i < w->npoint; i++)
		if (!n || w->point[n - 1].x != w->point[i].x || w->point[n - 1].y != w->point[i].y)
			w->point[n++] = w->point[i];
	w->npoint = n;
}

/*
 * The list is full: if positions had several records in it, there is room again. Else those from the middle on are dropped, in
 * Morton order, and are not taken in this turn. So of the positions that stay all records are known at its end.
 */
static void make_room(struct regular_work *w)
{
	const struct point *p = &w->point[w->mostpoint / 2];

	regular_reduce(w);
	if (w->npoint <= w->mostpoint / 4 * 3)
		return;
	w->limited = true;
	w->limit = point_morton(p->x, p->y);
	w->npoint = w->mostpoint / 2;
}

/* Such positions are loaded. */
static bool is_inside(const struct regular_work *w, int32_t x, int32_t y)
{
	const struct regular_area *area = w->c->area;

	return area ? area->holds(area->ctx, (const int32_t[4]){x, y, x, y}) : cut_region_holds(w->c->region, x, y);
}

static int take_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct regular_work *w = ctx;
	uint32_t steps = 1 + w->nhit / STEPS_HIT + (w->step == REGULAR_AREA ? STEPS_SEARCH : 0);

	(void)err;
	w->c->points_read += n;
	for (size_t i = 0; i < n; i++) {
		const struct point *p = &pts[i];
		const int32_t at[2] = {p->x, p->y};
		const struct geom_weighted v = {at, w->weight[view_weight_of(w->c->view, p)]};
		int rc = regular_progress(w, steps);

		if (rc)
			return rc;
		if (!near_discs(w, v) || is_inside(w, p->x, p->y) || cut_judge(&w->judge, p) != VIEW_KEPT || !matters(w, v))
			continue;
		if (w->npoint == w->mostpoint)
			make_room(w);
		if (w->limited && point_morton(p->x, p->y) >= w->limit)
			continue;
		w->point[w->npoint++] = *p;
	}
	return 0;
}

/* ---- cells ---- */

static bool is_own(const struct regular_work *w, const struct grid_cell *cell)
{
	if (w->c->area)
		return w->c->area->holds(w->c->area->ctx, cell->box);
	for (unsigned i = 0; i < w->nrange; i++)
		if (w->range[i].lo <= cell->lo && cell->hi <= w->range[i].hi)
			return true;
	return false;
}

static bool enter(void *ctx, const struct grid_cell *subtree)
{
	return subtree->count && cell_matters(ctx, subtree);
}

static int read_cell(void *ctx, const struct grid_cell *cell)
{
	struct regular_work *w = ctx;
	double lack;
	int rc;

	if (!cell->count || is_own(w, cell))
		return 0;
	rc = regular_progress(w, 1 + regular_disc_groups(w));
	if (rc)
		return rc;
	lack = lack_of(w, cell);
	w->beyond = beyond_meets(w, cell->box);
	w->nhit = 0;
	for (uint32_t i = 0; i < regular_disc_groups(w); i++)
		if (regular_disc_meets(w, i, cell->box, lack))
			w->hit[w->nhit++] = i;
	if (!w->nhit && !w->beyond)
		return 0;
	w->c->cells_read++;
	return w->c->src->read(w->c->src->ctx, cell, take_points, w, w->err);
}

int regular_read(struct regular_work *w)
{
	const struct grid_visitor v = {.ctx = w, .segment = enter, .enter = enter, .cell = read_cell};
	int rc;

	regular_border_sort(w);
	rc = w->c->src->walk(w->c->src->ctx, 0, UINT64_MAX, &v, w->err);
	w->ndisc = w->nwhole = w->ncross = w->nghost = 0;
	w->all_outside = false;
	return rc;
}
