/*
 * Loading a region: its own positions from the index's ranges, then the halo, merged in Morton order where
 * the caller wants them. Exactly P_B goes out, so that what is made of it depends on the generation, the view
 * and the region alone, never on how cells, segments or memory lie.
 */
#include "cut_source.h"

#include <string.h>

#include "cut_halo.h"
#include "cut_order.h"
#include "cut_sites.h"
#include "cut_valid.h"
#include "err.h"

_Static_assert(MESH_RULES >= VIEW_RULES, "counts by rule");

struct own {
	struct cut_load *load;
	const struct view *view;
	struct point last;      /* the record taken so far of the position under way */
	bool has_last;
};

static int own_put(struct own *o)
{
	struct cut_load *l = o->load;

	if (!o->has_last)
		return 0;
	o->has_last = false;
	if (l->own == l->cap)
		return CUT_E_FULL;
	l->out[l->own++] = (struct mesh_vertex){ o->last.x, o->last.y, o->last.z };
	return 0;
}

static int own_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct own *o = ctx;
	struct mesh_counts *counts = &o->load->counts;

	(void)err;
	counts->points += n;
	for (size_t i = 0; i < n; i++) {
		enum view_rule rule = view_judge(o->view, &pts[i]);

		if (rule != VIEW_KEPT) {
			counts->removed[rule]++;
			continue;
		}
		if (o->has_last && o->last.x == pts[i].x && o->last.y == pts[i].y) {
			counts->removed[VIEW_BY_DUPLICATE]++;
			if (view_prefers(o->view, &pts[i], &o->last))
				o->last = pts[i];
			continue;
		}
		if (own_put(o))
			return CUT_E_FULL;
		o->last = pts[i];
		o->has_last = true;
	}
	return 0;
}

static int load_own(const struct cut_source *src, const struct view *view, const struct cut_region *region,
		    struct cut_load *load, struct err *err)
{
	struct own o = { .load = load, .view = view };
	struct cut_range range[4];
	unsigned n = cut_region_ranges(region, range);

	for (unsigned i = 0; i < n; i++) {
		int rc = src->scan(src->ctx, range[i].lo, range[i].hi, own_points, &o, err);

		if (rc)
			return rc;
	}
	return own_put(&o);
}

/* Merge m halo points behind the own positions, from the back, in place. Both in Morton order. */
static void merge(struct cut_load *load, const struct point *halo, uint32_t m)
{
	uint32_t i = load->own, k = load->own + m;

	load->n = k;
	while (m > 0) {
		const struct point *p = &halo[m - 1];

		if (i > 0 && cut_order_before(p->x, p->y, load->out[i - 1].x, load->out[i - 1].y)) {
			load->out[--k] = load->out[--i];
		} else {
			load->out[--k] = (struct mesh_vertex){ p->x, p->y, p->z };
			m--;
		}
	}
}

size_t cut_load_scratch_bytes(uint32_t cap)
{
	return cut_halo_bytes(cap);
}

int cut_load_from(const struct cut_source *src, const struct view *view, const struct cut_region *region,
		  struct cut_load *load, uint64_t *ret_need, struct err *err)
{
	struct cut_source near = *src;
	const struct point *halo;
	struct cut_halo *h;
	uint64_t need = 0;
	uint32_t m;
	int rc;

	if (load->sites)
		cut_sites_source(load->sites, &near);
	h = cut_halo_init(load->scratch, load->scratch_size, &near, view, region, true);
	load->n = load->own = 0;
	memset(&load->counts, 0, sizeof(load->counts));
	if (!h)
		return err_set(err, ERR_INTERNAL, "%zu bytes of scratch are too few to load a region", load->scratch_size);
	rc = load_own(src, view, region, load, err);
	if (rc == CUT_E_FULL) {
		*ret_need = (uint64_t)load->cap + 1;
		return rc;
	}
	if (rc)
		return rc;
	load->counts.used = load->own;
	if (load->trace)
		cut_halo_trace(h, load->trace);
	rc = cut_halo_seed(h, load->out, load->own);
	if (!rc)
		rc = cut_halo_find(h, &halo, &m, &need, err);
	else if (rc == CUT_E_FULL)
		need = load->own; /* its own border alone overflows the chains */
	if (rc == CUT_E_FULL) {
		need += load->own;
		*ret_need = need > load->cap ? need : (uint64_t)load->cap + 1;
	}
	if (rc)
		return rc;
	if (!load->sites)
		cut_halo_stats(h, &load->counts.cells_read, &load->counts.points_read);
	load->counts.points_read += load->counts.points;
	if ((uint64_t)load->own + m > load->cap) {
		*ret_need = (uint64_t)load->own + m;
		return CUT_E_FULL;
	}
	load->counts.halo = m;
	merge(load, halo, m);
	return load->trace ? cut_trace_ranges(load->trace, src, region, err) : 0;
}
