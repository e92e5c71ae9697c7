/*
 * Where positions of less power than what is watched can be: discs, in doubles that err towards more, in groups under boxes.
 * Neighbours in the order of triangles are near each other. If there are too many, groups keep their boxes alone, two of them
 * joined to one, so that cells are read once. What is read too much is not taken.
 */
#include "regular_priv.h"

#define SLACK CUT_DISC_SLACK

void regular_disc_box(const struct regular_disc *d, int32_t ret[4])
{
	const double u[2] = {d->disc.ux, d->disc.uy}, square = u[0] * u[0] + u[1] * u[1];
	double inside = square + d->more, radius;

	inside = (inside > 0 ? inside : 0) + SLACK * (square + fabs(d->more));
	radius = sqrt(inside) * (1 + 0x1p-40) + 1 + 0x1p-40 * (fabs(u[0]) + fabs(u[1]));
	for (unsigned k = 0; k < 2; k++) {
		double low = d->disc.a[k] + u[k] - radius, high = d->disc.a[k] + u[k] + radius;

		ret[k] = low <= INT32_MIN ? INT32_MIN : low >= INT32_MAX ? INT32_MAX : (int32_t)floor(low);
		ret[2 + k] = high >= INT32_MAX ? INT32_MAX : high <= INT32_MIN ? INT32_MIN : (int32_t)ceil(high);
	}
}

static bool boxes_meet(const int32_t a[4], const int32_t b[4])
{
	return a[0] <= b[2] && a[1] <= b[3] && a[2] >= b[0] && a[3] >= b[1];
}

/* `lack`: by how much the weights in the box are less than the greatest, for which the disc is. */
static bool disc_meets(const struct regular_disc *d, const int32_t box[4], double lack)
{
	double slack, value = cut_disc_value(&d->disc, box, &slack);

	return value <= d->more - lack + SLACK * (slack + fabs(d->more) + lack);
}

uint32_t regular_disc_groups(const struct regular_work *w)
{
	return w->nwhole + (w->ndisc + REGULAR_GROUP - 1) / REGULAR_GROUP;
}

/* All groups lose their discs, and half of them remain. */
static void make_room(struct regular_work *w)
{
	uint32_t n = regular_disc_groups(w);

	for (uint32_t i = 0; i < n; i++) {
		struct regular_group *to = &w->group[i / 2];

		if (i % 2) {
			point_box_join(to->box, w->group[i].box);
			point_box_join(to->bare, w->group[i].bare);
		} else {
			*to = w->group[i];
		}
	}
	w->nwhole = (n + 1) / 2;
	w->ndisc = 0;
}

int regular_disc_add(struct regular_work *w, uint32_t a, const double u[2])
{
	const struct regular_disc d = {{w->r.xy[a], u[0], u[1]}, (double)(w->most - regular_vertex(w, a).w)};
	struct regular_group one, *group;

	if (w->ndisc == w->mostdisc || (w->ndisc % REGULAR_GROUP == 0 && regular_disc_groups(w) == w->mostgroup)) {
		int rc = w->step == REGULAR_PLACES ? regular_read(w) : 0;

		if (rc)
			return rc;
		make_room(w);
	}
	regular_disc_box(&d, one.box);
	/* Not by a difference of `more`, which has the error of the greatest weight. */
	regular_disc_box(&(struct regular_disc){d.disc, -(double)regular_vertex(w, a).w}, one.bare);
	group = &w->group[w->nwhole + w->ndisc / REGULAR_GROUP];
	if (w->ndisc % REGULAR_GROUP == 0)
		*group = one;
	point_box_join(group->box, one.box);
	point_box_join(group->bare, one.bare);
	w->disc[w->ndisc++] = d;
	regular_trace_disc(w, a, u);
	return 0;
}

bool regular_disc_holds(const struct regular_disc *d, int64_t most, struct geom_weighted p)
{
	return disc_meets(d, (const int32_t[4]){p.at[0], p.at[1], p.at[0], p.at[1]}, (double)(most - p.w));
}

bool regular_disc_meets(const struct regular_work *w, uint32_t group, const int32_t box[4], double lack)
{
	uint32_t first;

	if (!boxes_meet(lack < (double)w->most ? w->group[group].box : w->group[group].bare, box))
		return false;
	if (group < w->nwhole)
		return true;
	first = (group - w->nwhole) * REGULAR_GROUP;
	for (uint32_t i = first; i < w->ndisc && i < first + REGULAR_GROUP; i++)
		if (disc_meets(&w->disc[i], box, lack))
			return true;
	return false;
}
