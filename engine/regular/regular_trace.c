/*
 * What a domain with weights depends on beyond P(B), for its trace (cut_valid.h): ranges around everything that was verified. A
 * position with its key in none of them is in no disc, whatever its weight, as long as it is one of the view.
 *
 * Half planes beyond the hull need no range: a position there has a cell without weights that reaches the region, so the chains
 * see it (weights.md, "The trace"). Nor do the ends of borders: cut_valid tests positions against the first and last site of a
 * chain. But positions that were loaded because of these are in no disc, so each that was loaded gets a range.
 */
#include "regular_priv.h"

static void cover(struct regular_work *w, const int32_t box[4])
{
	cut_cover_box(&w->cover, box);
	point_box_join(w->c->trace->lines.disc, box);
}

void regular_trace_init(struct regular_work *w)
{
	w->cover = (struct cut_cover){.trace = w->c->trace};
}

void regular_trace_disc(struct regular_work *w, uint32_t a, const double u[2])
{
	struct regular_disc d = {{w->r.xy[a], u[0], u[1]}, (double)(w->reach - regular_vertex(w, a).w)};
	int32_t box[4];

	if (!w->c->trace || w->c->less_trace)
		return;
	regular_disc_box(&d, box);
	if (!regular_in_region(w, box))
		cover(w, box);
}

void regular_trace_points(struct regular_work *w)
{
	for (uint32_t i = 0; w->c->trace && !w->c->less_trace && i < w->npoint; i++) {
		const struct point *p = &w->point[i];

		cover(w, (const int32_t[4]){p->x, p->y, p->x, p->y});
	}
}

static int32_t clamped(double v)
{
	return v <= INT32_MIN ? INT32_MIN : v >= INT32_MAX ? INT32_MAX : (int32_t)v;
}

void regular_trace_nearest(struct regular_work *w, double x, double y, double radius)
{
	double wide = radius * (1 + 0x1p-40) + 1;

	if (w->c->trace)
		cover(w, (const int32_t[4]){clamped(floor(x - wide)), clamped(floor(y - wide)), clamped(ceil(x + wide)),
					    clamped(ceil(y + wide))});
}

int regular_trace_end(struct regular_work *w)
{
	struct cut_trace *t = w->c->trace;

	if (!t)
		return 0;
	/* Any position could end it. */
	if (w->c->flat) {
		t->nrange = 0;
		return 0;
	}
	return cut_cover_end(&w->cover, w->c->src, w->err);
}
