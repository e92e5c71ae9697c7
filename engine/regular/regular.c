/*
 * The steps of a domain with weights, in turns. A turn chooses what must be verified, reads the cells that can matter for it, and
 * adds the positions that do. It ends when nothing is added. After the first turn only positions that may be hidden are left.
 *
 * P(B) of the positions without their weights is only where this begins: it is near what is needed, and found by the same search
 * as in a plain mesh. Nothing relies on it.
 *
 * Memory: 5 bits for each position of the capacity, and what is left in four parts: discs, points, triangles at positions that
 * may be hidden, edges between cells at the border. The parts of points and edges are used where the kernel's arena is full.
 * Discs that are too many become coarse boxes, edges that are too many end a batch; points beyond their part wait for the next
 * turn.
 */
#include "regular_priv.h"

#include "align.h"
#include "err.h"

/* Of the rest a quarter is for so many groups of discs at least; half for edges at the border, an eighth each for points and
 * triangles. There is room for as many groups without discs. */
enum { GROUPS_LEAST = 1 };
#define GROUP_BYTES (REGULAR_GROUP * sizeof(struct regular_disc) + 2 * (sizeof(struct regular_group) + sizeof(uint32_t)))

static size_t bits_bytes(uint64_t n)
{
	return align_line((size_t)((n + 63) / 64) * sizeof(uint64_t));
}

static size_t fixed_bytes(uint32_t cap)
{
	return 2 * bits_bytes(2 * (uint64_t)cap) + bits_bytes(cap) + 8 * ALIGN_LINE;
}

size_t regular_bytes(uint32_t cap)
{
	return fixed_bytes(cap) + 4 * GROUPS_LEAST * GROUP_BYTES;
}

static void lay_out(struct regular_work *w)
{
	uint8_t *at = w->c->memory;
	const uint32_t cap = w->c->cap;
	size_t left = w->c->size - fixed_bytes(cap);

	w->owned = align_carve(&at, bits_bytes(2 * (uint64_t)cap));
	w->watched = align_carve(&at, bits_bytes(2 * (uint64_t)cap));
	w->served = align_carve(&at, bits_bytes(cap));
	w->mostgroup = (uint32_t)(left / 4 / GROUP_BYTES);
	w->mostdisc = w->mostgroup * REGULAR_GROUP;
	w->mostgroup *= 2;
	w->least_points = (uint32_t)(left / 8 / sizeof(struct point));
	w->mostlist = (uint32_t)(left / 8 / sizeof(struct regular_candidate));
	w->least_cross = (uint32_t)(left / 2 / sizeof(struct regular_cross));
	w->hit = align_carve(&at, w->mostgroup * sizeof(*w->hit));
	w->disc = align_carve(&at, w->mostdisc * sizeof(*w->disc));
	w->group = align_carve(&at, w->mostgroup * sizeof(*w->group));
	w->few_cross = align_carve(&at, w->least_cross * sizeof(*w->few_cross));
	w->few_points = align_carve(&at, w->least_points * sizeof(*w->few_points));
	w->list = align_carve(&at, w->mostlist * sizeof(*w->list));
}

/* Points and edges have the part of the kernel's arena that is free, if it is more. As many points as can be added are at its
 * end: no triangle of those that were added reaches the ones that are left. */
static void borrow(struct regular_work *w)
{
	uint8_t *room = tri_regular_room(&w->tri);
	uint32_t points = w->c->cap - w->r.nvertex;
	size_t rest = points * (TRI_REGULAR_EACH - sizeof(struct point));

	w->point = w->few_points;
	w->mostpoint = w->least_points;
	if (points > w->mostpoint) {
		w->point = (struct point *)(room + rest);
		w->mostpoint = points;
	}
	w->cross = w->few_cross;
	w->mostcross = w->least_cross;
	if (rest / sizeof(struct regular_cross) > w->mostcross) {
		w->cross = (struct regular_cross *)room;
		w->mostcross = (uint32_t)(rest / sizeof(struct regular_cross));
	}
	if (w->c->few) {
		w->mostcross = w->mostcross < w->c->few ? w->mostcross : w->c->few;
		w->mostdisc = w->mostdisc < w->c->few ? w->mostdisc : w->c->few;
		w->mostpoint = w->mostpoint < w->c->few + 4 ? w->mostpoint : w->c->few + 4;
	}
}

int regular_progress(struct regular_work *w, uint32_t steps)
{
	w->steps += steps;
	if (w->steps < REGULAR_STEPS)
		return 0;
	w->steps = 0;
	return w->c->progress && w->c->progress(w->c->progress_ctx) ? regular_cancelled(w) : 0;
}

int regular_cancelled(struct regular_work *w)
{
	return err_set(w->err, ERR_CANCELLED, "the triangulation with weights was cancelled");
}

/* ---- what was loaded ---- */

static int add_points(struct regular_work *w, uint64_t *ret_need)
{
	regular_reduce(w);
	regular_trace_points(w);
	if ((uint64_t)w->r.nvertex + w->npoint > w->c->cap) {
		*ret_need = (uint64_t)w->r.nvertex + w->npoint;
		return REGULAR_E_SPLIT;
	}
	for (uint32_t i = 0; i < w->npoint; i++) {
		const struct point p = w->point[i];
		const struct mesh_vertex v = {p.x, p.y, p.z};
		uint8_t weight = view_weight_of(w->c->view, &p);
		int rc = regular_progress(w, 1);

		if (rc)
			return rc;
		tri_regular_add(&w->tri, &v, &weight, 1);
	}
	w->c->added += w->npoint;
	w->npoint = 0;
	tri_result(w->c->tri, &w->r);
	return 0;
}

static int turns(struct regular_work *w, uint64_t *ret_need)
{
	uint32_t first = 0;

	for (;;) {
		uint32_t before = w->r.nvertex;
		int rc;

		w->limited = false;
		borrow(w);
		rc = regular_watch(w, first);
		w->c->turns++;
		if (rc || !w->npoint || w->c->not_verified)
			return rc;
		/* If some did not fit the list, all is verified again; and those of an area, which may be other triangles now. */
		first = !w->limited && !w->c->area ? before : 0;
		rc = add_points(w, ret_need);
		if (rc)
			return rc;
	}
}

/* ---- the result ---- */

static void choose_taken(struct regular_work *w)
{
	const struct regular_area *area = w->c->area;
	uint32_t n = 0;

	for (uint32_t i = 0; i < w->r.ntriangle; i++) {
		const uint32_t *c = w->r.triangle[i].corner;

		if (tri_regular_used(&w->r.triangle[i]))
			regular_set(w->owned, n++,
				    regular_bit(w->owned, i) &&
					    area->takes(area->ctx, w->r.xy[c[0]], w->r.xy[c[1]], w->r.xy[c[2]]));
	}
	w->c->chosen = w->owned;
	tri_regular_pack(&w->tri);
}

static void choose(struct regular_work *w)
{
	struct regular *c = w->c;
	uint32_t n = 0, visible = 0;

	memset(w->served, 0, bits_bytes(w->r.nvertex));
	for (uint32_t i = 0; i < w->r.ntriangle; i++) {
		const struct tri_triangle *t = &w->r.triangle[i];
		unsigned ghost = regular_ghost_at(t);

		if (!tri_regular_used(t))
			continue;
		if (ghost < 3)
			c->nhull += regular_owns_hull(w, i, ghost);
		/* The triangles behind it take the places of unused ones. */
		regular_set(w->owned, n++, ghost == 3 && regular_bit(w->owned, i));
		for (unsigned k = 0; k < 3; k++)
			if (t->corner[k] != TRI_GHOST)
				regular_set(w->served, t->corner[k], true);
	}
	for (uint32_t v = 0; v < w->r.nvertex; v++)
		visible += regular_bit(w->served, v) && cut_region_holds(c->region, w->r.xy[v][0], w->r.xy[v][1]);
	c->hidden = c->own - visible;
	c->chosen = w->owned;
	c->visible = w->served;
	tri_regular_pack(&w->tri);
}

int regular_run(struct regular *c, uint64_t *ret_need, struct err *err)
{
	struct regular_work w = {
		.c = c, .err = err, .tri = {.tri = c->tri, .weight = w.weight, .progress = c->progress, .ctx = c->progress_ctx}};
	int rc;

	c->chosen = NULL;
	c->hidden = c->nhull = c->added = c->turns = 0;
	c->cells_read = c->points_read = 0;
	if (c->size < regular_bytes(c->cap))
		return err_set(err, ERR_INTERNAL, "%zu bytes are too few to verify a domain with weights", c->size);
	w.reach = view_weights(c->view, w.weight);
	w.most = c->most;
	if (c->trace)
		regular_trace_init(&w);
	else
		w.reach = w.most;
	cut_judge_init(&w.judge, c->view);
	if (c->area) {
		memcpy(w.box, c->area->box, sizeof w.box);
	} else {
		cut_region_box(c->region, w.box);
		w.nrange = cut_region_ranges(c->region, w.range);
	}
	lay_out(&w);
	rc = regular_flat_run(&w, ret_need);
	if (rc || c->flat)
		return rc ? rc : regular_trace_end(&w);
	tri_result(c->tri, &w.r);
	if (!c->area)
		regular_border_init(&w);
	rc = turns(&w, ret_need);
	if (!rc && c->area)
		choose_taken(&w);
	else if (!rc)
		choose(&w);
	return rc ? rc : regular_trace_end(&w);
}
