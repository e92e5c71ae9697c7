/*
 * Verification: reads the cells that meet the disc of a flagged triangle, and takes the positions in it that are visible from the
 * triangle (constrain_sight.c) and no vertices. Discs are collected in a batch and tested against the index in one walk. A disc
 * within the region needs nothing, since all positions there are vertices.
 *
 * What is taken depends on the triangle and the position alone, never on cells: so the domain does not either.
 */
#include "constrain_priv.h"

#include <string.h>

#include "view.h"

static bool in_region(const struct constrain_work *w, const int32_t box[4])
{
	return 2 * (int64_t)box[0] > w->border[0] && 2 * (int64_t)box[1] > w->border[1] && 2 * (int64_t)box[2] < w->border[2] &&
	       2 * (int64_t)box[3] < w->border[3];
}

static bool disc_meets(const struct constrain_work *w, const struct constrain_disc *d, const int32_t box[4])
{
	return constrain_boxes_meet(box, d->box) && cut_disc_meets(&d->disc, box) && constrain_sight_box(w, d, box);
}

static bool any_meets(const struct constrain_work *w, const struct grid_cell *cell)
{
	if (!cell->count || !constrain_boxes_meet(cell->box, w->disc_around))
		return false;
	for (uint32_t i = 0; i < w->ndisc; i++)
		if (disc_meets(w, &w->disc[i], cell->box))
			return true;
	return false;
}

static bool enter(void *ctx, const struct grid_cell *subtree)
{
	return any_meets(ctx, subtree);
}

static bool hit_takes(const struct constrain_work *w, const struct constrain_hit *hit, const struct point *p)
{
	const struct constrain_disc *d = &w->disc[hit->disc];
	const uint32_t *corner = w->r.triangle[d->triangle].corner;
	const int32_t at[2] = {p->x, p->y};

	if (p->x < d->box[0] || p->y < d->box[1] || p->x > d->box[2] || p->y > d->box[3])
		return false;
	if (hit->sight != NONE && !constrain_sight_near(w, d, hit->sight, at))
		return false;
	if (geom_incircle_plain(w->r.xy[corner[0]], w->r.xy[corner[1]], w->r.xy[corner[2]], at) < 0)
		return false;
	return hit->sight == NONE ? constrain_sight_point(w, d, at) : constrain_sight_in(w, d, hit->sight, at);
}

static int disc_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct constrain_work *w = ctx;

	(void)err;
	w->c->points_read += n;
	for (size_t i = 0; i < n; i++) {
		const struct point *p = &pts[i];
		uint32_t k = 0;
		int rc;

		if ((!w->c->area && cut_region_holds(w->c->region, p->x, p->y)) || view_judge(w->c->view, p) != VIEW_KEPT)
			continue;
		while (k < w->nhit && !hit_takes(w, &w->hit[k], p))
			k++;
		if (k == w->nhit || constrain_points_known(w, p))
			continue;
		rc = constrain_points_add(w, p);
		if (rc)
			return rc;
	}
	return 0;
}

static bool is_own(const struct constrain_work *w, const struct grid_cell *cell)
{
	if (w->c->area)
		return w->c->area->has(w->c->area->ctx, cell);
	for (unsigned i = 0; i < w->nrange; i++)
		if (w->range[i].lo <= cell->lo && cell->hi <= w->range[i].hi)
			return true;
	return false;
}

static void find_hits(struct constrain_work *w, const int32_t box[4])
{
	w->nhit = 0;
	for (uint32_t i = 0; i < w->ndisc; i++) {
		const struct constrain_disc *d = &w->disc[i];
		struct constrain_hit *hit = &w->hit[w->nhit];
		uint32_t n, most = w->mosthit - w->nhit - (w->ndisc - i - 1); /* there is one for each disc that follows */

		if (!constrain_boxes_meet(box, d->box) || !cut_disc_meets(&d->disc, box))
			continue;
		n = constrain_sight_list(w, d, box, hit, most);
		if (n > most || !d->nsight) {
			n = 1;
			hit[0].sight = NONE;
		}
		for (uint32_t k = 0; k < n; k++)
			hit[k].disc = i;
		w->nhit += n;
	}
}

static int disc_cell(void *ctx, const struct grid_cell *cell)
{
	struct constrain_work *w = ctx;

	if (!cell->count || is_own(w, cell) || !constrain_boxes_meet(cell->box, w->disc_around))
		return 0;
	find_hits(w, cell->box);
	if (!w->nhit)
		return 0;
	w->c->cells_read++;
	return w->c->src->read(w->c->src->ctx, cell, disc_points, w, w->err);
}

int constrain_disc_flush(struct constrain_work *w)
{
	const struct grid_visitor v = {.ctx = w, .segment = enter, .enter = enter, .cell = disc_cell};
	int rc = w->ndisc ? w->c->src->walk(w->c->src->ctx, 0, UINT64_MAX, &v, w->err) : 0;

	w->ndisc = w->nsight = 0;
	return rc;
}

int constrain_disc_add(struct constrain_work *w, uint32_t triangle)
{
	const uint32_t *corner = w->r.triangle[triangle].corner;
	struct constrain_disc *d = &w->disc[w->ndisc];

	cut_disc_init(&d->disc, w->r.xy[corner[0]], w->r.xy[corner[1]], w->r.xy[corner[2]]);
	cut_disc_box(&d->disc, d->box);
	d->triangle = triangle;
	if (!w->c->area && in_region(w, d->box))
		return 0;
	constrain_sight_follow(w, d);
	if (!w->c->area && in_region(w, d->box)) {
		w->nsight = d->sight;
		return 0;
	}
	point_box_join(w->c->depends.disc, d->box);
	if (w->c->cover)
		cut_cover_box(w->c->cover, d->box);
	if (!w->ndisc)
		memcpy(w->disc_around, d->box, sizeof(d->box));
	point_box_join(w->disc_around, d->box);
	return ++w->ndisc == w->mostdisc || w->nsight + SIGHT > w->mostsight ? constrain_disc_flush(w) : 0;
}
