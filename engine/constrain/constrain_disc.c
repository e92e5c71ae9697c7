/*
 * Verification: reads the cells that meet the disc of a flagged triangle. Of the positions in it that are visible from the
 * triangle (constrain_sight.c) and no vertices, it takes for each side of the triangle the one from which the side is seen at the
 * largest angle: that would be the apex of the next triangle on this side. So a few of many positions are loaded, and the next
 * turn looks from there. If the disc is wide, its triangle is searched alone at first, and the rest only if nothing is in it.
 *
 * Discs are collected in a batch and tested against the index in one walk. A disc within the region needs nothing, since all
 * positions there are vertices. What is taken depends on triangles and positions alone, never on cells: so the domain does not
 * either.
 */
#include "constrain_priv.h"

#include <string.h>

#include "squares.h"
#include "view.h"

static bool in_region(const struct constrain_work *w, const int32_t box[4])
{
	return 2 * (int64_t)box[0] > w->border[0] && 2 * (int64_t)box[1] > w->border[1] && 2 * (int64_t)box[2] < w->border[2] &&
	       2 * (int64_t)box[3] < w->border[3];
}

/* Of a wide disc only its triangle is searched at first, which is the first in which it sees. */
static bool takes_part(const struct constrain_disc *d, bool inside)
{
	return inside ? d->wide : !d->wide || !(d->pick[0].any || d->pick[1].any || d->pick[2].any);
}

/* Whether positions in the box may be in the disc. */
static bool may_have(const struct constrain_work *w, const struct constrain_disc *d, const int32_t box[4])
{
	return d->part && constrain_boxes_meet(box, w->inside ? w->sight[d->sight].box : d->box) && cut_disc_meets(&d->disc, box);
}

static bool disc_meets(const struct constrain_work *w, const struct constrain_disc *d, const int32_t box[4])
{
	if (!may_have(w, d, box))
		return false;
	return w->inside ? constrain_sight_meets(w, d, 0, box) : constrain_sight_box(w, d, box);
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

/* Whether a position is in the closed disc. */
static bool disc_has(const struct constrain_work *w, const struct constrain_disc *d, const int32_t at[2])
{
	const uint32_t *corner = w->r.triangle[d->triangle].corner;
	const int32_t box[4] = {at[0], at[1], at[0], at[1]};
	double slack, value = cut_disc_value(&d->disc, box, &slack);

	if (fabs(value) > CUT_DISC_SLACK * slack)
		return value < 0;
	return geom_incircle_plain(w->r.xy[corner[0]], w->r.xy[corner[1]], w->r.xy[corner[2]], at) >= 0;
}

/* The cotangent of the angle at which a side is seen from a position on its left; else INFINITY. */
static double flat_of(const int32_t u[2], const int32_t v[2], const int32_t at[2])
{
	double ux = (double)u[0] - at[0], uy = (double)u[1] - at[1], vx = (double)v[0] - at[0], vy = (double)v[1] - at[1];
	double area = ux * vy - uy * vx;

	return area > 0 ? (ux * vx + uy * vy) / area : INFINITY;
}

static bool is_better(const struct constrain_work *w, const struct constrain_pick *pick, double flat, const struct point *p)
{
	uint64_t key, old;

	if (!pick->any || flat != pick->flat)
		return !pick->any || flat < pick->flat;
	key = point_morton(p->x, p->y);
	old = point_morton(pick->point.x, pick->point.y);
	return key == old ? view_prefers(w->c->view, p, &pick->point) : key < old;
}

/* The vertex at a position that is in a triangle in which a disc sees. */
static uint32_t vertex_at(struct constrain_work *w, const struct constrain_hit *hit, const int32_t at[2])
{
	const struct constrain_disc *d = &w->disc[hit->disc];
	const struct tri_triangle *t = hit->sight == NONE ? NULL : &w->r.triangle[w->sight[d->sight + hit->sight].triangle];

	if (!t || !constrain_real(t)) {
		uint32_t vertex, near = w->near;

		w->near = d->triangle;
		vertex = constrain_vertex(w, at);
		/* Other walks do not depend on cells. */
		w->near = near;
		return vertex;
	}
	for (unsigned k = 0; k < 3; k++)
		if (w->r.xy[t->corner[k]][0] == at[0] && w->r.xy[t->corner[k]][1] == at[1])
			return t->corner[k];
	return NONE;
}

/* Of an area not all records at a vertex may have been read. */
static void prefer(const struct constrain_work *w, uint32_t v, const struct point *p)
{
	int32_t *z = (int32_t *)(uintptr_t)w->r.z; /* in the arena */

	if (view_prefers(w->c->view, &(struct point){.z = p->z}, &(struct point){.z = z[v]}))
		z[v] = p->z;
}

/* Offers a position to a disc: for each side of its triangle it keeps the best one that is visible and no vertex. */
static void hit_offer(struct constrain_work *w, const struct constrain_hit *hit, const struct point *p)
{
	struct constrain_disc *d = &w->disc[hit->disc];
	const uint32_t *corner = w->r.triangle[d->triangle].corner;
	const int32_t at[2] = {p->x, p->y};
	double flat[3];
	bool better = w->c->area, any = false;
	uint32_t v;

	if (p->x < d->box[0] || p->y < d->box[1] || p->x > d->box[2] || p->y > d->box[3])
		return;
	if ((hit->sight != NONE && !constrain_sight_near(w, d, hit->sight, at)) || !disc_has(w, d, at) ||
	    view_judge(w->c->view, p) != VIEW_KEPT)
		return;
	for (unsigned k = 0; k < 3; k++) {
		flat[k] = flat_of(w->r.xy[corner[(k + 1) % 3]], w->r.xy[corner[(k + 2) % 3]], at);
		any |= flat[k] < INFINITY;
	}
	for (unsigned k = 0; k < 3; k++)
		better |= (flat[k] < INFINITY || !any) && is_better(w, &d->pick[k], flat[k], p);
	if (!better || !(hit->sight == NONE ? constrain_sight_point(w, d, at) : constrain_sight_in(w, d, hit->sight, at)))
		return;
	v = vertex_at(w, hit, at);
	if (v != NONE) {
		prefer(w, v, p);
		return;
	}
	for (unsigned k = 0; k < 3; k++)
		if ((flat[k] < INFINITY || !any) && is_better(w, &d->pick[k], flat[k], p))
			d->pick[k] = (struct constrain_pick){flat[k], *p, true};
}

/* Where positions of a hit can be: beyond the side over which its path begins, or in the disc's own triangle. */
static struct squares_strip strip_of(const struct constrain_work *w, const struct constrain_hit *hit)
{
	const struct constrain_disc *d = &w->disc[hit->disc];
	const struct constrain_sight *list = w->sight + d->sight;
	const uint32_t *corner = w->r.triangle[d->triangle].corner;
	const int32_t *a = w->r.xy[corner[0]], *b = w->r.xy[corner[1]], *c = w->r.xy[corner[2]];
	unsigned side = hit->sight == NONE || hit->sight == 0 ? 0 : list[hit->sight].side;

	if (hit->sight == NONE)
		return squares_strip(a, b, -INFINITY, INFINITY);
	if (hit->sight > 0)
		return squares_strip(w->r.xy[corner[(side + 2) % 3]], w->r.xy[corner[(side + 1) % 3]], 0, d->height[side]);
	return squares_strip(a, b, 0, (double)geom_area(a, b, c) / hypot((double)b[0] - a[0], (double)b[1] - a[1]));
}

/* Offers positions to some of the hits. */
static void offer(struct constrain_work *w, const struct constrain_hit *hit, unsigned nhit, const struct point *pts, size_t n)
{
	struct squares_strip strip[SQUARES_BOXES];
	struct squares s;

	squares_init(&s, w->cell);
	for (unsigned i = 0; i < nhit; i++) {
		const struct constrain_disc *d = &w->disc[hit[i].disc];
		const int32_t *box = hit[i].sight == NONE ? d->box : w->sight[d->sight + hit[i].sight].box;

		squares_add(&s, i, (const int64_t[2]){box[0], box[1]}, (const int64_t[2]){box[2], box[3]});
		strip[i] = strip_of(w, &hit[i]);
	}
	for (size_t i = 0; i < n; i++) {
		const struct point *p = &pts[i];
		uint64_t bits = squares_at(&s, p->x, p->y);

		if (!bits || (!w->c->area && cut_region_holds(w->c->region, p->x, p->y)))
			continue;
		for (; bits; bits &= bits - 1)
			if (squares_in_strip(&strip[__builtin_ctzll(bits)], p->x, p->y))
				hit_offer(w, &hit[__builtin_ctzll(bits)], p);
	}
}

static int disc_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct constrain_work *w = ctx;

	(void)err;
	w->c->points_read += n;
	for (uint32_t k = 0; k < w->nhit; k += SQUARES_BOXES)
		offer(w, &w->hit[k], w->nhit - k < SQUARES_BOXES ? w->nhit - k : SQUARES_BOXES, pts, n);
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

		if (!may_have(w, d, box))
			continue;
		if (w->inside) {
			n = constrain_sight_meets(w, d, 0, box);
			hit[0].sight = 0;
		} else {
			n = constrain_sight_list(w, d, box, hit, most);
			if (n > most || !d->nsight) {
				n = 1;
				hit[0].sight = NONE;
			}
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
	memcpy(w->cell, cell->box, sizeof(w->cell));
	return w->c->src->read(w->c->src->ctx, cell, disc_points, w, w->err);
}

/* Reads the cells for the discs that take part. */
static int search(struct constrain_work *w, bool inside)
{
	const struct grid_visitor v = {.ctx = w, .segment = enter, .enter = enter, .cell = disc_cell};
	bool any = false;

	w->inside = inside;
	for (uint32_t i = 0; i < w->ndisc; i++) {
		struct constrain_disc *d = &w->disc[i];
		const int32_t *box = inside ? w->sight[d->sight].box : d->box;

		d->part = takes_part(d, inside);
		if (!d->part)
			continue;
		point_box_join(w->c->depends.disc, box);
		if (w->c->cover)
			cut_cover_box(w->c->cover, box);
		if (!any)
			memcpy(w->disc_around, box, sizeof(w->disc_around));
		point_box_join(w->disc_around, box);
		any = true;
	}
	return any ? w->c->src->walk(w->c->src->ctx, 0, UINT64_MAX, &v, w->err) : 0;
}

int constrain_disc_flush(struct constrain_work *w)
{
	int rc = search(w, true);

	if (!rc)
		rc = search(w, false);
	for (uint32_t i = 0; i < w->ndisc && !rc; i++)
		for (unsigned k = 0; k < 3 && !rc; k++) {
			const struct constrain_pick *pick = &w->disc[i].pick[k];

			if (!pick->any)
				continue;
			constrain_bit_set(w->todo, w->disc[i].triangle);
			rc = constrain_points_add(w, &pick->point);
		}
	w->ndisc = w->nsight = 0;
	return rc;
}

static bool is_wide(const struct constrain_work *w, const struct constrain_disc *d)
{
	double x = (double)d->box[2] - d->box[0], y = (double)d->box[3] - d->box[1];

	return d->nsight && x * y > w->wide && (w->c->area || !in_region(w, w->sight[d->sight].box));
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
	d->wide = is_wide(w, d);
	for (unsigned k = 0; k < 3; k++)
		d->pick[k].any = false;
	return ++w->ndisc == w->mostdisc || w->nsight + SIGHT > w->mostsight ? constrain_disc_flush(w) : 0;
}
