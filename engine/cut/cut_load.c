/*
 * Loading a region: its own positions from ranges of the index, then its halo, merged in Morton order. The result is
 * exactly P_B, so the domain depends only on the generation, the view and the region, never on cells, segments or
 * memory.
 */
#include "cut_source.h"

#include <string.h>

#include "cut_halo.h"
#include "cut_judge.h"
#include "cut_order.h"
#include "cut_sites.h"
#include "cut_valid.h"
#include "err.h"

_Static_assert(MESH_RULES >= VIEW_RULES,
	       "stored domains count by rule: MESH_RULES is part of their format (docs/formats/format.md)");

struct own {
	struct cut_load *load;
	struct cut_judge judge;
	struct point last; /* the record chosen so far for the last position */
	uint64_t here;     /* points of that position */
};

static int own_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct own *o = ctx;
	struct cut_load *l = o->load;
	struct mesh_counts *counts = &l->counts;
	const struct point *last = &o->last;
	uint8_t *weight = l->weight;
	uint32_t own = l->own;
	uint64_t here = o->here;

	(void)err;
	counts->points += n;
	for (size_t i = 0; i < n; i++) {
		const struct point *p = &pts[i];
		enum view_rule rule = cut_judge(&o->judge, p);

		if (rule != VIEW_KEPT) {
			counts->removed[rule]++;
			continue;
		}
		if (own > 0 && last->x == p->x && last->y == p->y) {
			counts->removed[VIEW_BY_DUPLICATE]++;
			mesh_most_add(&counts->most, ++here, p->x, p->y);
			if (!view_prefers(o->judge.view, p, last))
				continue;
			own--;
		} else if (own == l->cap) {
			l->own = own;
			return CUT_E_FULL;
		} else {
			here = 1;
		}
		last = p;
		if (weight)
			weight[own] = view_weight_of(o->judge.view, p);
		l->out[own++] = (struct mesh_vertex){p->x, p->y, p->z};
	}
	o->last = *last;
	o->here = here;
	l->own = own;
	return 0;
}

static int load_own(const struct cut_source *src, const struct view *view, const struct cut_region *region, struct cut_load *load,
		    struct err *err)
{
	struct own o = {.load = load};
	struct cut_range range[4];
	unsigned n = cut_region_ranges(region, range);

	cut_judge_init(&o.judge, view);
	for (unsigned i = 0; i < n; i++) {
		int rc = src->scan(src->ctx, range[i].lo, range[i].hi, own_points, &o, err);

		if (rc)
			return rc;
	}
	return 0;
}

/* How many of the first n positions come before p. */
static uint32_t count_before(const struct mesh_vertex *v, uint32_t n, const struct point *p)
{
	uint32_t lo = 0, hi = n;

	while (lo < hi) {
		uint32_t mid = lo + (hi - lo) / 2;

		if (cut_order_before(p->x, p->y, v[mid].x, v[mid].y))
			hi = mid;
		else
			lo = mid + 1;
	}
	return lo;
}

/* Merges m halo points into the own positions, from the end, in place. Both are in Morton order. The halo is much
 * smaller, so its places are found by binary search. */
static void merge_halo(struct cut_load *load, const struct view *view, const struct point *halo, uint32_t m)
{
	uint32_t i = load->own;

	load->n = load->own + m;
	for (; m > 0; m--) {
		const struct point *p = &halo[m - 1];
		uint32_t at = count_before(load->out, i, p);

		memmove(load->out + at + m, load->out + at, (i - at) * sizeof(*load->out));
		load->out[at + m - 1] = (struct mesh_vertex){p->x, p->y, p->z};
		if (load->weight) {
			memmove(load->weight + at + m, load->weight + at, i - at);
			load->weight[at + m - 1] = view_weight_of(view, p);
		}
		i = at;
	}
}

size_t cut_load_scratch_bytes(uint32_t cap)
{
	return cut_halo_bytes(cap);
}

int cut_load_from(const struct cut_source *src, const struct view *view, const struct cut_region *region, struct cut_load *load,
		  uint64_t *ret_need, struct err *err)
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
	if (load->flat) {
		load->counts.points_read = load->counts.points;
		load->n = load->own;
		return 0;
	}
	if (load->before)
		cut_halo_before(h, load->before);
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
	merge_halo(load, view, halo, m);
	return load->trace ? cut_trace_ranges(load->trace, src, region, err) : 0;
}
