/*
 * The probe of a plan, before the first triangle: whether the halos fit, and the sites of halos for which many leaves
 * would read the same cells.
 *
 * Suspicious leaves are those at the rim (a hull), nearly empty ones (the middle of a circle, the sides of a corridor),
 * and those split from a leaf that did not fit, unless they were made before and are stored. Elsewhere, neighbours with
 * equal load keep a halo small. The index's bound clears most suspicious leaves. The halos of the others are found
 * together, through one source that caches what matters of each cell, and become the plan's sites. For example, a strip
 * of land along a diagonal has as many empty leaves of every size beside it as leaves on it, and each sees a long
 * stretch of its edge. A halo that does not fit is counted again separately, and its leaf is split.
 */
#include "cut_source.h"

#include <stdlib.h>
#include <string.h>

#include "cut_bound.h"
#include "cut_halo.h"
#include "cut_cache.h"
#include "cut_order.h"
#include "cut_sites.h"
#include "err.h"
#include "ledger.h"

enum {
	FEW = 8, /* nearly empty: an eighth of the largest leaf of this plan, or of cap */
	GAIN = 4,
};

/* TOO: fits, but would read much of what is read together anyway. */
enum how { PASSED, ALONE, TOGETHER, TOO };

struct probe {
	const struct cut_source *src;
	const struct view *view;
	struct cut_plan *plan;
	uint32_t cap;
	void *scratch;
	size_t size;
	/* parts of it, to find halos together: for the halo (at its start), for cached cells, for sites */
	void *keep;
	size_t halo_size, keep_size;
	struct point *site;
	uint32_t nsite, site_cap;
	bool sites_full;
	uint8_t *how;      /* for each leaf */
	uint64_t together; /* sum of the bounds of the leaves that are TOGETHER */
	struct cut_region *region;
	uint32_t nregion;
};

static uint64_t few_points(const struct probe *p)
{
	return (p->plan->load && p->plan->load < p->cap ? p->plan->load : p->cap) / FEW;
}

static bool nearly_empty(const struct probe *p, const struct cut_leaf *leaf)
{
	return leaf->count < few_points(p);
}

static bool suspicious(const struct probe *p, const struct cut_leaf *leaf)
{
	return leaf->region.inf || leaf->above || nearly_empty(p, leaf);
}

/* Sets *ret_need to own + halo of the leaf; an estimate with CUT_E_FULL. */
static int count_halo(const struct probe *p, const struct cut_source *src, const struct cut_leaf *leaf,
		      const struct point **ret_pts, uint32_t *ret_n, uint64_t *ret_need, struct err *err)
{
	size_t size = src == p->src ? p->size : p->halo_size;
	struct cut_halo *h = cut_halo_init(p->scratch, size, src, p->view, &leaf->region, false);
	uint64_t need = 0;
	int rc;

	if (!h)
		return err_set(err, ERR_INTERNAL, "%zu bytes of scratch are too few to plan", size);
	*ret_n = 0;
	rc = cut_halo_find(h, ret_pts, ret_n, &need, err);
	if (rc < 0)
		return rc;
	if (src == p->src) {
		uint64_t cells, points;

		cut_halo_stats(h, &cells, &points);
		p->plan->cells_read += cells;
		p->plan->points_read += points;
	}
	*ret_need = (rc ? need : *ret_n) + leaf->count;
	if (rc == 0 && *ret_need <= p->cap)
		return 0;
	*ret_need = *ret_need > p->cap ? *ret_need : (uint64_t)p->cap + 1;
	return CUT_E_FULL;
}

/* ---- by the index ---- */

static int classify(struct probe *p, const struct cut_leaf *leaf, uint8_t *ret, struct err *err)
{
	uint64_t room = leaf->count < p->cap ? p->cap - leaf->count : 0, many = few_points(p), bound = 0;
	bool empty = nearly_empty(p, leaf);
	int rc;

	*ret = leaf->above && !leaf->fits ? ALONE : PASSED;
	if (leaf->above || leaf->fits || !suspicious(p, leaf))
		return 0;
	/* A leaf with few points should not read many by itself, even if they fit. */
	many = empty && many < room ? many : room;
	rc = cut_bound_halo(p->src, p->view, &leaf->region, many, p->scratch, &bound, err);
	if (rc == 0 && bound > many) {
		*ret = p->keep ? TOGETHER : bound > room ? ALONE : PASSED;
		p->together += bound;
	}
	return rc;
}

/*
 * If the leaves found above see more positions than there are, the data are sparse, and nearly all of them will be
 * read. Then the leaves on the data gain, too, if they would read a large part of what they own again.
 */
static int classify_sparse(struct probe *p, struct err *err)
{
	uint64_t all = 0;
	int rc = 0;

	for (size_t i = 0; i < p->plan->n; i++)
		all += p->plan->leaf[i].count;
	if (!p->keep || p->together < all)
		return 0;
	for (size_t i = 0; i < p->plan->n && !rc; i++) {
		const struct cut_leaf *leaf = &p->plan->leaf[i];
		uint64_t bound = 0;

		if (p->how[i] != PASSED || leaf->fits)
			continue;
		rc = cut_bound_halo(p->src, p->view, &leaf->region, leaf->count / GAIN, p->scratch, &bound, err);
		if (bound > leaf->count / GAIN)
			p->how[i] = TOO;
	}
	return rc;
}

static int classify_all(struct probe *p, struct err *err)
{
	int rc;

	for (size_t i = 0; i < p->plan->n; i++) {
		rc = classify(p, &p->plan->leaf[i], &p->how[i], err);
		if (rc)
			return rc;
	}
	rc = classify_sparse(p, err);
	for (size_t i = 0; i < p->plan->n; i++)
		if (p->how[i] == TOGETHER || p->how[i] == TOO)
			p->region[p->nregion++] = p->plan->leaf[i].region;
	return rc;
}

/* ---- together ---- */

static bool site_less(const void *ctx, const struct point *a, const struct point *b)
{
	(void)ctx;
	return cut_order_before(a->x, a->y, b->x, b->y);
}

/* Morton order, each position once; the record of a position is the same in every halo. */
static void reduce_sites(struct probe *p)
{
	uint32_t k = 0;

	cut_order_sort(p->site, p->nsite, site_less, NULL);
	for (uint32_t i = 0; i < p->nsite; i++)
		if (k == 0 || p->site[k - 1].x != p->site[i].x || p->site[k - 1].y != p->site[i].y)
			p->site[k++] = p->site[i];
	p->nsite = k;
}

/* False: no memory. */
static bool add_sites(struct probe *p, const struct point *pts, uint32_t n)
{
	if (n > p->site_cap - p->nsite && !p->sites_full) {
		reduce_sites(p);
		/* Reducing again is worthwhile only if it frees half of the memory. */
		p->sites_full = p->nsite > p->site_cap / 2;
	}
	if (n > p->site_cap - p->nsite)
		return false;
	memcpy(p->site + p->nsite, pts, n * sizeof(*pts));
	p->nsite += n;
	return true;
}

/* For the leaves that are `how`. Those that do not fit, or whose sites do not fit the memory, are probed alone later. */
static int find_together(struct probe *p, const struct cut_source *src, enum how how, struct err *err)
{
	for (size_t i = 0; i < p->plan->n; i++) {
		struct cut_leaf *leaf = &p->plan->leaf[i];
		const struct point *pts;
		uint64_t need;
		uint32_t n;
		int rc;

		if (p->how[i] != how || (how == TOO && (p->sites_full || cut_cache_full(src->ctx))))
			continue;
		rc = count_halo(p, src, leaf, &pts, &n, &need, err);
		if (rc && rc != CUT_E_FULL)
			return rc;
		p->how[i] = rc ? ALONE : PASSED;
		leaf->known = rc == 0 && add_sites(p, pts, n);
	}
	return 0;
}

static int probe_together(struct probe *p, struct err *err)
{
	struct cut_source src;
	struct cut_region root;
	struct cut_cache *keep;
	uint64_t cells, points;
	int32_t box[4];
	int rc;

	if (p->nregion == 0 || !p->src->box(p->src->ctx, box))
		return 0;
	cut_region_root(box, &root);
	keep = cut_cache_init(p->keep, p->keep_size, p->src, p->view, &root, p->region, p->nregion);
	if (!keep) {
		/* Nothing can be cached, so they are probed alone. */
		for (size_t i = 0; i < p->plan->n; i++)
			p->how[i] = p->how[i] == TOGETHER ? ALONE : p->how[i];
		return 0;
	}
	cut_cache_source(keep, &src);
	rc = find_together(p, &src, TOGETHER, err);
	if (!rc)
		rc = find_together(p, &src, TOO, err);
	cut_cache_stats(keep, &cells, &points);
	p->plan->cells_read += cells;
	p->plan->points_read += points;
	if (rc)
		return rc;
	reduce_sites(p);
	p->plan->sites = cut_sites_new(p->site, p->nsite, p->plan->ledger);
	/* They only avoid reading, so a failure is harmless. */
	for (size_t i = 0; i < p->plan->n && !p->plan->sites; i++)
		p->plan->leaf[i].known = false;
	return 0;
}

/* ---- alone ---- */

/* Probes the leaf at *i and the leaves into which it is split; *i is then behind them. */
static int probe_leaf(struct probe *p, size_t *i, struct err *err)
{
	size_t end = *i + 1;

	while (*i < end) {
		const struct point *pts;
		uint64_t need = 0;
		uint32_t n;
		int rc = count_halo(p, p->src, &p->plan->leaf[*i], &pts, &n, &need, err);

		if (rc == 0) {
			++*i;
			continue;
		}
		if (rc == CUT_E_FULL)
			rc = cut_plan_split_from(p->src, p->plan, *i, need, p->cap, err);
		if (rc)
			return rc;
		end++;
	}
	return 0;
}

static int probe_alone(struct probe *p, struct err *err)
{
	size_t leaves = p->plan->n;

	for (size_t k = 0, i = 0; k < leaves; k++) {
		int rc;

		if (p->how[k] != ALONE) {
			i++;
			continue;
		}
		rc = probe_leaf(p, &i, err);
		if (rc)
			return rc;
	}
	return 0;
}

/* ---- all ---- */

/* Divides the scratch for finding halos together; alone, each halo has all of it. */
static void divide_scratch(struct probe *p)
{
	size_t sites = (size_t)p->cap * CUT_SITES_BYTES & ~(size_t)63, halo = cut_halo_bytes(p->cap);
	uint64_t room = p->plan->ledger ? ledger_available(p->plan->ledger, LEDGER_PLAN) / 2 : sites;

	halo = (halo > p->size / 4 ? halo : p->size / 4) & ~(size_t)63;
	if (p->size < 2 * cut_halo_bytes(p->cap) || p->size < 2 * (halo + sites))
		return;
	p->halo_size = halo;
	p->keep = (char *)p->scratch + halo;
	p->keep_size = p->size - halo - sites - 64;
	p->site = (struct point *)((char *)p->keep + (p->keep_size & ~(size_t)63));
	/* Half of what is left for plans, because this plan may grow, and there may be others. A site takes little more
	 * than 16 bytes. */
	room = room / 9 * 8;
	p->site_cap = (uint32_t)((sites < room ? sites : room) / sizeof(*p->site));
}

int cut_plan_probe_from(const struct cut_source *src, const struct view *view, struct cut_plan *plan, uint32_t cap, void *scratch,
			size_t scratch_size, struct err *err)
{
	struct probe p = {.src = src, .view = view, .plan = plan, .cap = cap, .scratch = scratch, .size = scratch_size};
	int rc;

	if (plan->n == 0)
		return 0;
	if (scratch_size < cut_halo_bytes(0) || scratch_size < cut_bound_bytes())
		return err_set(err, ERR_INTERNAL, "%zu bytes of scratch are too few to plan", scratch_size);
	divide_scratch(&p);
	p.how = malloc(plan->n);
	p.region = malloc(plan->n * sizeof(*p.region));
	if (!p.how || !p.region)
		rc = err_set(err, ERR_NOMEM, "no memory for a plan of %zu domains", plan->n);
	else
		rc = classify_all(&p, err);
	if (!rc)
		rc = probe_together(&p, err);
	if (!rc)
		rc = probe_alone(&p, err);
	free(p.how);
	free(p.region);
	return rc;
}
