/*
 * Domains with weights (engine/regular) on thousands of random sets, tilings, weights and partitions, infinite regions among
 * them: the triangles of all domains are those of the regular triangulation of all positions, each once, the emitter takes them,
 * and the positions that are hidden are counted once. A domain depends on the points alone, not on cells. P(B) alone is too
 * little, and so is a verification without the half planes beyond the hull, which is tested as well.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "check.h"
#include "err.h"
#include "finish.h"
#include "parts.h"
#include "pipe.h"
#include "regular.h"
#include "repeat.h"
#include "sets.h"

enum { MAX_N = SETS_MAX_N, MAX_LEAVES = 40, CAP = 2 * MAX_N, ARENA = 1 << 19, SCRATCH = 1 << 19 };
enum how { ALL, HALO_ALONE, WITHOUT_HULL };

static struct sets set;
static struct view view;
static struct parts_mesh whole, parts;
static struct digest visible; /* of the vertices of the whole */
static unsigned nvisible;
static void *arena, *other;
static uint64_t scratch[SCRATCH / 8];
static uint64_t cases, domains, infinite, turns, added, loaded, positions, hidden, splits, batches;

static unsigned below(uint64_t *seed, unsigned n)
{
	return sets_below(seed, n);
}

/* ---- the whole mesh ---- */

/* False: the positions are flat. */
static bool make_whole(void)
{
	bool seen[MAX_N] = {false};
	int64_t weight[VIEW_WEIGHTS + 1];
	struct tri_regular r = {.tri = tri_init(arena, MAX_N), .weight = weight};
	struct tri_result t;
	uint8_t kind[MAX_N];

	view_weights(&view, weight);
	for (unsigned i = 0; i < set.n; i++)
		kind[i] = sets_weight_of(&set, &view, &set.pos[i]);
	memcpy(tri_input(r.tri), set.pos, set.n * sizeof *set.pos);
	if (tri_regular_run(&r, set.n, kind))
		return false;
	tri_result(r.tri, &t);
	whole.n = nvisible = 0;
	visible = (struct digest){0, 0};
	for (uint32_t i = 0; i < t.ntriangle; i++) {
		const uint32_t *c = t.triangle[i].corner;
		int32_t at[3][3];

		if (c[0] == TRI_GHOST || c[1] == TRI_GHOST || c[2] == TRI_GHOST)
			continue;
		for (unsigned k = 0; k < 3; k++) {
			memcpy(at[k], t.xy[c[k]], sizeof t.xy[0]);
			at[k][2] = t.z[c[k]];
			if (!seen[c[k]])
				digest_add_vertex(&visible, at[k][0], at[k][1], at[k][2]);
			nvisible += !seen[c[k]];
			seen[c[k]] = true;
		}
		parts_add(&whole, (const int32_t(*)[3])at);
	}
	parts_sort(&whole);
	positions += set.n;
	hidden += set.n - nvisible;
	return true;
}

/* ---- domains ---- */

/* Of the records of a cell, or segment: exactly, or as much as all have. */
static int64_t most_in(void *ctx, const struct grid_cell *cell)
{
	int64_t weight[VIEW_WEIGHTS + 1], most = 0;

	(void)ctx;
	view_weights(&view, weight);
	for (size_t i = 0; i < set.nrecord[cell->segment]; i++) {
		const struct point *p = &set.record[cell->segment][i];
		int64_t w = weight[view_weight_of(&view, p)];

		if (p->x >= cell->box[0] && p->y >= cell->box[1] && p->x <= cell->box[2] && p->y <= cell->box[3] && w > most)
			most = w;
	}
	return most;
}

/* What a region loads before it is verified, in `memory`. */
static struct regular load(const struct cut_source *src, const struct cut_region *region, uint32_t cap, void *memory,
			   struct mesh_counts *ret)
{
	static uint8_t weight[CAP];
	struct tri *tri = tri_init(memory, cap);
	struct cut_load l = {
		.out = tri_input(tri), .weight = weight, .cap = MAX_N, .scratch = scratch, .scratch_size = sizeof scratch};
	struct err err = ERR_INIT;
	int64_t weights[VIEW_WEIGHTS + 1];
	uint64_t need = 0;

	assert_int_equal(cut_load_from(src, &view, region, &l, &need, &err), 0);
	*ret = l.counts;
	loaded += l.n;
	return (struct regular){.src = src,
				.view = &view,
				.most = view_weights(&view, weights),
				.most_of = cases % 3 ? most_in : NULL,
				.region = region,
				.tri = tri,
				.n = l.n,
				.own = l.own,
				.cap = cap,
				.weight = weight,
				.memory = (uint8_t *)memory + (tri_bytes(cap) + 63) / 64 * 64,
				.size = ARENA / 2};
}

/* The region's own positions alone: the result does not depend on where it begins. */
static void drop_halo(struct regular *r)
{
	struct mesh_vertex *in = tri_input(r->tri);
	uint32_t n = 0;

	for (uint32_t i = 0; i < r->n; i++)
		if (cut_region_holds(r->region, in[i].x, in[i].y)) {
			r->weight[n] = r->weight[i];
			in[n++] = in[i];
		}
	r->n = n;
}

static void domain_make(const struct cut_source *src, const struct cut_region *region, enum how how, bool bare, void *memory,
			bool least, struct mesh_domain *ret)
{
	static const int64_t k[3] = {0, 0, 0};
	struct finish f = {0};
	struct regular r = load(src, region, CAP, memory, &f.out.counts);
	struct err err = ERR_INIT;
	uint64_t need = 0;
	int rc;

	r.not_verified = how == HALO_ALONE;
	r.no_hull = how == WITHOUT_HULL;
	if (bare)
		drop_halo(&r);
	r.size = least ? regular_bytes(r.cap) : r.size;
	r.few = least ? 1 + cases % 3 : 0;
	rc = regular_run(&r, &need, &err);
	if (rc)
		fail_msg("case %llu: %d, %s", (unsigned long long)cases, rc, err.message);
	domains++;
	infinite += region->inf != 0;
	turns += r.turns;
	added += r.added;
	*ret = f.out;
	if (r.flat) {
		assert_true(how != ALL);
		return;
	}
	finish_init(&f, region, k, r.tri);
	finish_chosen(&f, &(struct finish_choice){r.chosen, NULL});
	assert_true(finish_vertices(&f));
	finish_numbers(&f);
	f.out.nhull = r.nhull;
	f.out.counts.used -= r.hidden;
	f.out.counts.removed[VIEW_BY_WEIGHT] = r.hidden;
	*ret = f.out;
}

/* A kernel with less room says how much would suffice. */
static void domain_in_less(uint64_t *seed, const struct cut_source *src, const struct cut_region *region)
{
	struct mesh_counts counts;
	struct regular r = load(src, region, MAX_N, other, &counts);
	struct err err = ERR_INIT;
	uint64_t need = 0;
	int rc;

	/* As if there were room for a few more only. The result is not used. */
	r.cap = r.n + below(seed, 4);
	r.size = regular_bytes(r.cap);
	rc = regular_run(&r, &need, &err);
	assert_true(rc == 0 || rc == REGULAR_E_SPLIT);
	splits += rc != 0;
	if (rc)
		assert_true(need > r.cap);
}

static void check_same(const struct mesh_domain *a, const struct mesh_domain *b)
{
	assert_int_equal(a->nvertex, b->nvertex);
	assert_int_equal(a->nopen, b->nopen);
	assert_int_equal(a->ntriangle, b->ntriangle);
	assert_int_equal(a->nhull, b->nhull);
	assert_int_equal(a->counts.used, b->counts.used);
	assert_true(digest_equal(a->own_digest, b->own_digest));
	if (a->nvertex)
		assert_memory_equal(a->vertex, b->vertex, a->nvertex * sizeof *a->vertex);
	if (a->ntriangle)
		assert_memory_equal(a->triangle, b->triangle, a->ntriangle * sizeof *a->triangle);
}

/* Other positions may have been loaded. */
static void check_same_mesh(const struct mesh_domain *a, const struct mesh_domain *b)
{
	assert_true(digest_equal(a->digest, b->digest) && digest_equal(a->own_digest, b->own_digest));
	assert_int_equal(a->nhull, b->nhull);
	assert_int_equal(a->counts.removed[VIEW_BY_WEIGHT], b->counts.removed[VIEW_BY_WEIGHT]);
}

static void check_totals(const struct pipe_totals *t)
{
	assert_int_equal(t->triangles, whole.n);
	assert_int_equal(t->vertices, nvisible);
	assert_int_equal(t->counts.used, nvisible);
	assert_int_equal(t->counts.removed[VIEW_BY_WEIGHT], set.n - nvisible);
	assert_true(digest_equal(t->vertex_digest, visible));
}

/* Emits all domains of a partition; `sums`: only their totals. Returns whether they are the whole. */
static bool partition(uint64_t *seed, const struct cut_source *src, const struct cut_source *again, const struct cut_region *leaf,
		      unsigned n, enum how how, bool sums)
{
	const struct lattice lattice = {.scale_xy = {1, 0}, .scale_z = {1, 0}};
	struct pipe_emitter *e;
	struct pipe_totals totals;
	struct err err = ERR_INIT;
	bool same;
	int rc = 0;

	assert_int_equal(pipe_emitter_new(&lattice, 1 << 16, -1, &e, &err), 0);
	pipe_emitter_sums(e, sums);
	parts.n = 0;
	for (unsigned i = 0; i < n; i++) {
		struct mesh_domain d, o;

		bool bare = how != HALO_ALONE && below(seed, 3) == 0;

		domain_make(src, &leaf[i], how, bare, arena, false, &d);
		for (uint32_t k = 0; k < d.ntriangle; k++) {
			int32_t at[3][3];

			parts_corners(&d, k, at);
			parts_add(&parts, (const int32_t(*)[3])at);
		}
		if (how == ALL && below(seed, 2)) {
			domain_make(again, &leaf[i], how, bare, other, false, &o);
			check_same(&d, &o);
		} else if (how == ALL) {
			/* With the least memory there are batches, coarse boxes, and turns that are broken off. */
			domain_make(again, &leaf[i], how, !bare, other, true, &o);
			check_same_mesh(&d, &o);
			batches++;
		}
		rc = rc ? rc : pipe_emit(e, &d, &leaf[i], NULL, &err);
	}
	parts_sort(&parts);
	same = parts_same(&parts, &whole);
	if (how == ALL && same) {
		rc = rc ? rc : pipe_emitter_finish(e, &totals, &err);
		if (rc)
			fail_msg("case %llu: %s", (unsigned long long)cases, err.message);
		check_totals(&totals);
	}
	pipe_emitter_free(e);
	return same;
}

static bool one_case(uint64_t seed, enum how how)
{
	struct cut_region leaf[MAX_LEAVES];
	struct cut_source src, again;
	struct tiling t, u;
	unsigned n;

	view_done(&view);
	sets_make(&seed, &set, &view);
	sets_weights(&seed, &set, &view);
	cases++;
	if (set.n < 3 || !make_whole())
		return true;
	sets_tiling(&seed, &set, &t);
	sets_tiling(&seed, &set, &u);
	tiling_source(&t, &src);
	tiling_source(&u, &again);
	n = parts_make(&seed, &src, MAX_LEAVES, leaf);
	if (how == ALL)
		domain_in_less(&seed, &src, &leaf[below(&seed, n)]);
	return partition(&seed, &src, &again, leaf, n, how, below(&seed, 2));
}

static uint64_t run(uint64_t n, enum how how)
{
	uint64_t wrong = 0;

	cases = 0;
	for (uint64_t i = 0; i < n; i++) {
		if (one_case((repeat_first() + i) * UINT64_C(0x2545f4914f6cdd1d), how))
			continue;
		wrong++;
		if (how == ALL)
			fail_msg("case %llu: the domains are not the whole mesh", (unsigned long long)(repeat_first() + i));
	}
	return wrong;
}

static void domains_are_the_whole(void **unused)
{
	uint64_t n = repeat_cases(8000);

	run(n, ALL);
	print_message("%llu cases, %llu domains, %llu of them infinite, %llu in the least memory; %llu of %llu positions hidden; "
		      "%llu turns, %llu positions beyond %llu of P(B); %llu did not fit\n",
		      (unsigned long long)cases, (unsigned long long)domains, (unsigned long long)infinite,
		      (unsigned long long)batches, (unsigned long long)hidden, (unsigned long long)positions,
		      (unsigned long long)turns, (unsigned long long)added, (unsigned long long)loaded,
		      (unsigned long long)splits);
	assert_true(n < 1000 || (hidden > positions / 20 && added > 0 && splits > 0 && infinite > domains / 10));
}

/* A list of points that is full at the position with the greatest key of all. */
static void the_greatest_key_is_a_limit(void **unused)
{
	for (cases = 0; cases < 3;)
		assert_true(one_case(UINT64_C(7002608) * UINT64_C(0x2545f4914f6cdd1d), ALL));
}

/* The controls. */
static void the_halo_alone_is_too_little(void **unused)
{
	uint64_t wrong = run(1500, HALO_ALONE);

	print_message("%llu of 1500 sets are wrong\n", (unsigned long long)wrong);
	assert_true(wrong > 100);
}

static void the_hull_matters(void **unused)
{
	uint64_t wrong = run(1500, WITHOUT_HULL);

	print_message("%llu of 1500 sets are wrong\n", (unsigned long long)wrong);
	assert_true(wrong > 20);
}

static int set_up(void **unused)
{
	arena = aligned_alloc(64, ARENA);
	other = aligned_alloc(64, ARENA);
	return arena && other ? 0 : -1;
}

static int tear_down(void **unused)
{
	free(arena);
	free(other);
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(domains_are_the_whole),
		cmocka_unit_test(the_greatest_key_is_a_limit),
		cmocka_unit_test(the_halo_alone_is_too_little),
		cmocka_unit_test(the_hull_matters),
	};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
