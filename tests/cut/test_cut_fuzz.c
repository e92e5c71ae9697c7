/*
 * The box rule on tens of thousands of cases: random small point sets, tilings, views and dyadic partitions. For every
 * region cut_load returns exactly P_B by its definition. The owned triangles of P_B, and of random supersets of it, are
 * over all regions the triangles of the whole, each once.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "brute.h"
#include "cut_bound.h"
#include "cut_halo.h"
#include "cut_cache.h"
#include "cut_order.h"
#include "cut_sites.h"
#include "err.h"
#include "sets.h"
#include "repeat.h"

enum { MAX_N = SETS_MAX_N, MAX_RECORDS = SETS_MAX_RECORDS, MAX_LEAVES = 64, MAX_TRIANGLES = 4 * BRUTE_POINTS };

static struct sets set;
static struct view view;
static int32_t whole[MAX_TRIANGLES][6], parts[2 * MAX_TRIANGLES][6], extra[2 * MAX_TRIANGLES][6];
static void *scratch;
static size_t scratch_size;
static uint64_t cases, regions, triangles, halos, empty_owners, together, bounds;

/* ---- partitions ---- */

/* Queries that a plan skips when all records are live do not change it. */
static void check_plan_asked(const struct cut_source *src, const struct cut_plan *plan)
{
	struct cut_source asking = *src;
	struct err err = ERR_INIT;
	struct cut_plan again;

	asking.all_live = NULL;
	assert_int_equal(cut_plan_make_from(&asking, plan->load, &again, &err), 0);
	assert_int_equal(again.n, plan->n);
	for (size_t i = 0; i < plan->n; i++)
		assert_true(cut_region_same(&again.leaf[i].region, &plan->leaf[i].region) &&
			    again.leaf[i].count == plan->leaf[i].count && again.leaf[i].exact == plan->leaf[i].exact);
	cut_plan_done(&again);
}

static unsigned make_leaves(uint64_t *seed, const struct cut_source *src, struct cut_region *ret)
{
	struct err err = ERR_INIT;
	struct cut_plan plan;
	unsigned want = 1 + sets_below(seed, sets_below(seed, 4) ? 12 : MAX_LEAVES), n = 0;

	assert_int_equal(cut_plan_make_from(src, 1 + sets_below(seed, 8) + (uint32_t)(2 * MAX_RECORDS / want), &plan, &err), 0);
	check_plan_asked(src, &plan);
	for (size_t i = 0; i < plan.n && n < MAX_LEAVES; i++)
		ret[n++] = plan.leaf[i].region;
	if (plan.n > MAX_LEAVES) {
		/* Too many: only the root, split at random below. */
		int32_t box[4];

		assert_true(src->box(src->ctx, box));
		cut_region_root(box, &ret[0]);
		n = 1;
	}
	cut_plan_done(&plan);
	for (unsigned tries = 0; n < want && n > 0 && tries < 200; tries++) {
		unsigned i = sets_below(seed, n);
		struct cut_region half[2];

		if (!cut_region_split(&ret[i], half))
			continue;
		memmove(&ret[i + 2], &ret[i + 1], (n - i - 1) * sizeof(*ret)); /* in the order of a plan */
		ret[i] = half[0];
		ret[i + 1] = half[1];
		n++;
	}
	return n;
}

/* ---- checks ---- */

static int triangle_compare(const void *a, const void *b)
{
	return memcmp(a, b, 6 * sizeof(int32_t));
}

static unsigned owned(const struct cut_region *region, const struct mesh_vertex *p, unsigned n, int32_t (*ret)[6])
{
	static int32_t all[MAX_TRIANGLES][6];
	unsigned m = brute_triangles(p, n, all), k = 0;

	for (unsigned i = 0; i < m; i++)
		if (cut_region_owns(region, &all[i][0], &all[i][2], &all[i][4]))
			memcpy(ret[k++], all[i], sizeof(all[i]));
	return k;
}

/* The other ways to find a halo: the sweep instead of rounds, a full table of cells, own positions unknown. */
static void check_halo(uint64_t *seed, const struct cut_source *src, const struct cut_region *region,
		       const struct mesh_vertex *pb, unsigned n)
{
	bool known = sets_below(seed, 2);
	struct cut_halo *h = cut_halo_init(scratch, scratch_size, src, &view, region, known);
	struct err err = ERR_INIT;
	const struct point *pts;
	uint64_t need;
	uint32_t m, k = 0;

	assert_non_null(h);
	cut_halo_merged(h, sets_below(seed, 2) ? 0 : UINT32_MAX, sets_below(seed, 3));
	cut_halo_limit(h, sets_below(seed, 2) ? sets_below(seed, 4) : 1000, sets_below(seed, 2) ? sets_below(seed, 4) : 1000);
	cut_halo_grain(h, sets_below(seed, 5), 4 + sets_below(seed, 7), sets_below(seed, 2) ? sets_below(seed, 10) : 1000,
		       sets_below(seed, 8));
	if (known) {
		struct mesh_vertex own[MAX_N];
		uint32_t nown = 0;

		for (unsigned i = 0; i < n; i++)
			if (cut_region_holds(region, pb[i].x, pb[i].y))
				own[nown++] = pb[i];
		assert_int_equal(cut_halo_seed(h, own, nown), 0);
	}
	assert_int_equal(cut_halo_find(h, &pts, &m, &need, &err), 0);
	for (unsigned i = 0; i < n; i++) {
		if (cut_region_holds(region, pb[i].x, pb[i].y))
			continue;
		assert_true(k < m);
		assert_int_equal(pts[k].x, pb[i].x);
		assert_int_equal(pts[k].y, pb[i].y);
		assert_int_equal(pts[k].z, pb[i].z);
		k++;
	}
	assert_int_equal(k, m);
}

/* Halos found together: each through one source that caches what it has read, with any memory. */
struct group {
	struct cut_region region[MAX_LEAVES];
	bool member[MAX_LEAVES];
	unsigned n;
	void *memory;
	struct cut_cache *keep;
	struct cut_sites *sites;
};

static unsigned halo_of(const struct cut_region *region, struct mesh_vertex *ret)
{
	int64_t box[4];
	unsigned n = 0;

	cut_region_box(region, box);
	for (unsigned i = 0; i < set.n; i++)
		if (!cut_region_holds(region, set.pos[i].x, set.pos[i].y) && brute_meets(set.pos, set.n, i, box))
			ret[n++] = set.pos[i];
	return n;
}

/* Some of the leaves; their halos by definition, and other positions, as sites. */
static void make_group(uint64_t *seed, const struct cut_source *src, const struct cut_region *leaf, unsigned n, struct group *g)
{
	size_t size = 300000;
	struct point sites[MAX_N];
	bool wanted[MAX_N] = {false};
	struct cut_region root;
	int32_t box[4];
	uint32_t m = 0;

	memset(g, 0, sizeof(*g));
	for (unsigned i = 0; i < n; i++) {
		struct mesh_vertex halo[MAX_N];
		unsigned k;

		if (sets_below(seed, 2))
			continue;
		g->member[i] = true;
		g->region[g->n++] = leaf[i];
		k = halo_of(&leaf[i], halo);
		for (unsigned j = 0; j < set.n; j++)
			for (unsigned l = 0; l < k; l++)
				wanted[j] = wanted[j] || !memcmp(&set.pos[j], &halo[l], sizeof(halo[l]));
	}
	for (unsigned j = 0; j < set.n; j++)
		if (wanted[j] || sets_below(seed, 4) == 0)
			sites[m++] = (struct point){.x = set.pos[j].x, .y = set.pos[j].y, .z = set.pos[j].z, .ret = 0x11};
	g->sites = cut_sites_new(sites, m, NULL);
	assert_non_null(g->sites);
	if (g->n == 0 || !src->box(src->ctx, box))
		return;
	cut_region_root(box, &root);
	g->memory = malloc(size);
	assert_non_null(g->memory);
	g->keep = cut_cache_init(g->memory, size, src, &view, &root, g->region, g->n);
	assert_non_null(g->keep);
	if (sets_below(seed, 3) == 0)
		cut_cache_limit(g->keep, sets_below(seed, 40));
}

static void check_kept(uint64_t *seed, struct group *g, const struct cut_region *region, const struct mesh_vertex *pb, unsigned n)
{
	struct err err = ERR_INIT;
	const struct point *pts;
	struct cut_source src;
	struct cut_halo *h;
	uint64_t need;
	uint32_t m, k = 0;

	cut_cache_source(g->keep, &src);
	h = cut_halo_init(scratch, scratch_size, &src, &view, region, false);
	cut_halo_merged(h, 0, 1);
	cut_halo_limit(h, sets_below(seed, 8), 1000);
	cut_halo_grain(h, 0, 10, sets_below(seed, 100), sets_below(seed, 8));
	assert_int_equal(cut_halo_find(h, &pts, &m, &need, &err), 0);
	for (unsigned i = 0; i < n; i++) {
		if (cut_region_holds(region, pb[i].x, pb[i].y))
			continue;
		assert_true(k < m && pts[k].x == pb[i].x && pts[k].y == pb[i].y && pts[k].z == pb[i].z);
		k++;
	}
	assert_int_equal(k, m);
	together++;
}

/* A bound reads nothing, and is an upper bound. */
static void check_bound(uint64_t *seed, const struct cut_source *src, const struct cut_region *region, unsigned halo)
{
	struct tiling *t = src->ctx;
	struct err err = ERR_INIT;
	uint64_t bound, reads = t->reads;

	assert_int_equal(cut_bound_halo(src, &view, region, sets_below(seed, 2) * sets_below(seed, 50), scratch, &bound, &err),
			 0);
	assert_true(t->reads == reads);
	if (set.all_kept) {
		assert_true(bound >= halo);
		bounds++;
	}
}

static void check_load(uint64_t *seed, const struct cut_source *src, const struct cut_sites *sites,
		       const struct cut_region *region, const struct mesh_vertex *pb, unsigned n, unsigned own)
{
	struct mesh_vertex out[MAX_N];
	struct cut_load load = {.out = out, .cap = MAX_N, .scratch = scratch, .scratch_size = scratch_size, .sites = sites};
	struct err err = ERR_INIT;
	uint64_t need = 0, removed = 0;

	assert_int_equal(cut_load_from(src, &view, region, &load, &need, &err), 0);
	assert_int_equal(load.n, n);
	assert_int_equal(load.own, own);
	if (n)
		assert_memory_equal(out, pb, n * sizeof(*pb));
	for (unsigned i = 0; i < MESH_RULES; i++)
		removed += load.counts.removed[i];
	assert_int_equal(load.counts.points, load.counts.used + removed);
	assert_int_equal(load.counts.used, own);
	assert_int_equal(load.counts.halo, n - own);
	if (n == 0)
		return;
	load.cap = sets_below(seed, n);
	assert_int_equal(cut_load_from(src, &view, region, &load, &need, &err), CUT_E_FULL);
	assert_true(need > load.cap && need <= n);
}

static unsigned check_region(uint64_t *seed, const struct cut_source *src, struct group *g, bool member,
			     const struct cut_region *region, unsigned nparts)
{
	struct mesh_vertex pb[MAX_N], super[MAX_N];
	unsigned n = 0, own = 0, nsuper = 0, k, m;
	int64_t box[4];

	cut_region_box(region, box);
	for (unsigned i = 0; i < set.n; i++) {
		bool in = brute_meets(set.pos, set.n, i, box);

		if (in) {
			pb[n++] = set.pos[i];
			own += cut_region_holds(region, set.pos[i].x, set.pos[i].y);
		}
		if (in || sets_below(seed, 3) == 0)
			super[nsuper++] = set.pos[i];
	}
	check_load(seed, src, NULL, region, pb, n, own);
	if (member) {
		check_kept(seed, g, region, pb, n);
		check_load(seed, src, g->sites, region, pb, n, own);
	}
	check_bound(seed, src, region, n - own);
	check_halo(seed, src, region, pb, n);
	k = owned(region, pb, n, parts + nparts);
	m = owned(region, super, nsuper, extra);
	qsort(parts + nparts, k, sizeof(parts[0]), triangle_compare);
	qsort(extra, m, sizeof(extra[0]), triangle_compare);
	assert_int_equal(k, m);
	if (k)
		assert_memory_equal(parts + nparts, extra, k * sizeof(parts[0]));
	regions++;
	halos += n - own;
	empty_owners += own == 0 && k > 0;
	return k;
}

static void one_case(uint64_t seed)
{
	struct cut_region leaf[MAX_LEAVES];
	struct cut_source src;
	struct tiling t;
	struct group g;
	unsigned n, m, k = 0;

	sets_make(&seed, &set, &view);
	sets_tiling(&seed, &set, &t);
	tiling_source(&t, &src);
	n = make_leaves(&seed, &src, leaf);
	m = brute_triangles(set.pos, set.n, whole);
	make_group(&seed, &src, leaf, n, &g);
	for (unsigned i = 0; i < n; i++)
		k += check_region(&seed, &src, &g, g.member[i], &leaf[i], k);
	cut_sites_free(g.sites);
	free(g.memory);
	assert_int_equal(k, m);
	qsort(whole, m, sizeof(whole[0]), triangle_compare);
	qsort(parts, m, sizeof(parts[0]), triangle_compare);
	if (m)
		assert_memory_equal(whole, parts, m * sizeof(whole[0]));
	cases++;
	triangles += m;
}

static void fuzz(void **state)
{
	uint64_t n = repeat_cases(10000), from = repeat_first();

	scratch_size = cut_load_scratch_bytes(MAX_N);
	assert_true(cut_bound_bytes() <= scratch_size);
	scratch = malloc(scratch_size);
	assert_non_null(scratch);
	for (uint64_t i = 0; i < n; i++) {
		if (getenv("ACUT_FUZZ_TRACE"))
			fprintf(stderr, "case %llu\n", (unsigned long long)(from + i));
		one_case((from + i) * UINT64_C(0x2545f4914f6cdd1d));
	}
	free(scratch);
	print_message("%llu cases, %llu regions, %llu triangles, %llu halo sites, %llu empty regions with triangles, "
		      "%llu halos found together, %llu bounds\n",
		      (unsigned long long)cases, (unsigned long long)regions, (unsigned long long)triangles,
		      (unsigned long long)halos, (unsigned long long)empty_owners, (unsigned long long)together,
		      (unsigned long long)bounds);
	if (n >= 1000)
		assert_true(empty_owners > 0 && halos > 0 && together > 0 && bounds > 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(fuzz)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
