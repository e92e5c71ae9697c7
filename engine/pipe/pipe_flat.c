/*
 * Positions that make no triangle: fewer than three, or all collinear. Their mesh is its vertices.
 *
 * A scan of the view's points ends at the first three that are not collinear; ordinary data end it within the first
 * cell. If it reaches the end, the plan's leaves are marked `flat`. A flat leaf loads its own positions and no halo,
 * because every region of a collinear survey would need all of its points (algorithm.md 5). Its domain is these
 * positions, all of them closed. So such a mesh is made like any other, region by region, in bounded memory. Its
 * domains are not stored: they do not record on which data they depend.
 */
#include "pipe.h"

#include <string.h>

#include "err.h"
#include "geom.h"
#include "pipe_priv.h"

struct flat {
	const struct view *view;
	struct mesh_counts counts;
	int32_t first[2], second[2], last[2];
};

enum { NOT_FLAT = 100 };

static int flat_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct flat *f = ctx;
	size_t i;

	(void)err;
	f->counts.points += n;
	f->counts.points_read += n;
	for (i = 0; i < n; i++) {
		enum view_rule rule = view_judge(f->view, &pts[i]);
		int32_t at[2] = {pts[i].x, pts[i].y};

		if (rule == VIEW_KEPT && f->counts.used && !memcmp(at, f->last, sizeof at))
			rule = VIEW_BY_DUPLICATE;
		if (rule != VIEW_KEPT) {
			f->counts.removed[rule]++;
			continue;
		}
		memcpy(f->last, at, sizeof at);
		if (f->counts.used < 2)
			memcpy(f->counts.used ? f->second : f->first, at, sizeof at);
		else if (geom_orient(f->first, f->second, at))
			return NOT_FLAT;
		f->counts.used++;
	}
	return 0;
}

int pipe_flat_scan(struct grid_reader *reader, const struct view *view, bool *ret, struct mesh_counts *ret_counts,
		   struct err *err)
{
	struct flat flat = {.view = view};
	int r = grid_scan(reader, 0, UINT64_MAX, flat_points, &flat, err);

	if (r && r != NOT_FLAT)
		return r;
	*ret = !r;
	*ret_counts = flat.counts;
	return 0;
}

static void add_vertex(struct mesh_domain *d, const struct mesh_vertex *v, const int64_t k[3])
{
	const int32_t at[3] = {v->x, v->y, v->z};

	for (unsigned i = 0; i < 3; i++) {
		d->box[i] = at[i] < d->box[i] ? at[i] : d->box[i];
		d->box[3 + i] = at[i] > d->box[3 + i] ? at[i] : d->box[3 + i];
	}
	digest_add_vertex(&d->closed_digest, v->x + k[0], v->y + k[1], v->z + k[2]);
}

struct mesh_domain pipe_flat_domain(const struct cut_load *load, const struct view *view, const int64_t k[3])
{
	uint8_t *end = (uint8_t *)load->out + align_line(load->own * sizeof *load->out);
	struct mesh_domain d = {
		.counts = load->counts,
		.vertex = load->out,
		.nvertex = load->own,
		.link = (struct mesh_link *)end, /* no links, and no triangle */
		.triangle = (uint32_t(*)[3])end,
		.final = end,
		.box = {INT32_MAX, INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN, INT32_MIN},
	};

	for (uint32_t i = 0; i < load->own; i++) {
		struct mesh_vertex *v = &load->out[i];

		if (view->map.is.k) {
			const int32_t at[2] = {v->x, v->y};
			int32_t back[2];

			view_map_back(&view->map, at, back);
			v->x = back[0];
			v->y = back[1];
		}
		add_vertex(&d, v, k);
	}
	d.own_digest = d.closed_digest;
	return d;
}
