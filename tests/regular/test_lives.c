/*
 * Traces of domains with weights, on thousands of lives: points come and go, of any weight, and other sources get a weight. If
 * the trace of a domain is valid in another generation, or all that came is far, the domain there is the same, byte by byte; and
 * of those that are the same many are found. A trace of P(B) alone is too small, which is tested as well.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "cut_valid.h"
#include "err.h"
#include "finish.h"
#include "lives.h"
#include "pipe.h"
#include "regular.h"
#include "repeat.h"

enum { SLOTS = 3, CAP = 2 * SETS_MAX_N };
enum { ARENA = 1 << 19, SCRATCH = 1 << 19 };

static struct lives lives;
static unsigned slot[LIVES_SOURCES]; /* 0: its points have the weights of their classes */
static struct lives_generation generation[LIVES_GENERATIONS];
static struct view view;
static void *memory[2];
static uint64_t scratch[SCRATCH / 8], traces[CUT_TRACE_BYTES / 8 + 1];
static bool less_trace;
static uint64_t domains, beyond, hiding, same, valid, valid_hiding, far, wrong, without;

/* ---- generations ---- */

static int32_t range; /* of the positions */

static int32_t radius_of(uint64_t *seed, unsigned size)
{
	return (int32_t)sets_below(seed, size < 3 ? 3 + (unsigned)range * size / 2 : 1u << (8 + sets_below(seed, 22)));
}

static void make_view(uint64_t *seed)
{
	static const int32_t ranges[] = {5, 8, 20, 60, 400};
	struct slots_list list = {NULL, 0, 0};
	unsigned size = sets_below(seed, 4);
	struct err err = ERR_INIT;

	range = ranges[sets_below(seed, 5)];
	view_done(&view);
	view = VIEW_INIT;
	view.duplicates = sets_below(seed, 2) ? VIEW_LOWEST : VIEW_HIGHEST;
	for (unsigned i = 0; i < 2; i++)
		if (sets_below(seed, 4))
			view_weight_set(&view, (uint8_t)(1 + i), radius_of(seed, size));
	for (uint32_t i = 1; i <= SLOTS && sets_below(seed, 2); i++)
		assert_true(slots_list_add(&list, i, i, radius_of(seed, size)));
	assert_int_equal(view_weight_sources(&view, &list, &err), 0);
	slots_list_free(&list);
}

static unsigned any_slot(uint64_t *seed)
{
	return view.slots && sets_below(seed, 2) ? slots_of(view.slots, 1 + sets_below(seed, SLOTS)) : 0;
}

/* ---- domains ---- */

/* The greatest weight of a generation. */
static int64_t most_of(const struct lives_generation *g)
{
	int64_t weight[VIEW_WEIGHTS + 1], most = 0;

	view_weights(&view, weight);
	for (unsigned s = 0; s < g->set.segments; s++)
		for (size_t i = 0; i < g->set.nrecord[s]; i++) {
			int64_t w = weight[view_weight_of(&view, &g->set.record[s][i])];

			most = w > most ? w : most;
		}
	return most;
}

/* False: all is flat, and there is no domain. */
static bool make(const struct lives_generation *g, const struct cut_region *region, struct cut_trace *trace, void *arena,
		 struct mesh_domain *ret)
{
	static const int64_t k[3] = {0, 0, 0};
	static uint8_t weight[CAP];
	struct tri *tri = tri_init(arena, CAP);
	struct cut_load l = {.out = tri_input(tri),
			     .weight = weight,
			     .cap = SETS_MAX_N,
			     .scratch = scratch,
			     .scratch_size = sizeof scratch,
			     .trace = trace};
	struct finish f = {0};
	struct regular r = {.src = &g->src,
			    .view = &view,
			    .most = most_of(g),
			    .region = region,
			    .tri = tri,
			    .cap = CAP,
			    .weight = weight,
			    .memory = (uint8_t *)arena + (tri_bytes(CAP) + 63) / 64 * 64,
			    .size = ARENA / 2,
			    .trace = trace,
			    .less_trace = less_trace};
	struct err err = ERR_INIT;
	uint64_t need = 0;

	assert_int_equal(cut_load_from(&g->src, &view, region, &l, &need, &err), 0);
	r.n = l.n;
	r.own = l.own;
	f.out.counts = l.counts;
	assert_int_equal(regular_run(&r, &need, &err), 0);
	*ret = f.out;
	if (r.flat)
		return false;
	finish_init(&f, region, k, r.tri);
	finish_chosen(&f, &(struct finish_choice){r.chosen, NULL});
	assert_true(finish_vertices(&f));
	finish_numbers(&f);
	f.out.nhull = r.nhull;
	f.out.counts.halo += r.added;
	f.out.counts.used -= r.hidden;
	f.out.counts.removed[VIEW_BY_WEIGHT] = r.hidden;
	*ret = f.out;
	beyond += trace && r.added;
	return true;
}

static bool is_same(const struct mesh_domain *a, const struct mesh_domain *b)
{
	if (a->nvertex != b->nvertex || a->nopen != b->nopen || a->ntriangle != b->ntriangle || a->nhull != b->nhull ||
	    a->counts.points != b->counts.points || a->counts.used != b->counts.used || a->counts.halo != b->counts.halo ||
	    memcmp(a->counts.removed, b->counts.removed, sizeof a->counts.removed) || !digest_equal(a->own_digest, b->own_digest))
		return false;
	return !a->nvertex || (!memcmp(a->vertex, b->vertex, a->nvertex * sizeof *a->vertex) &&
			       !memcmp(a->link, b->link, a->nopen * sizeof *a->link) &&
			       !memcmp(a->triangle, b->triangle, a->ntriangle * sizeof *a->triangle));
}

static void judge(bool is_valid, bool equal)
{
	wrong += is_valid && !equal;
	if (is_valid && !equal && !less_trace)
		fail_msg("a domain that changed is said to be valid");
}

static void check_region(const struct cut_region *region, const struct lives_generation *then, const struct lives_generation *now,
			 const struct lives_generation *later)
{
	struct mesh_domain before, after;
	struct cut_reach reach;
	struct cut_trace trace;
	struct cut_live live;
	struct err err = ERR_INIT;
	bool is_valid = false, equal, is_far;

	cut_trace_init(&trace, traces);
	if (!make(then, region, &trace, memory[0], &before)) {
		assert_int_equal(trace.nrange, 0);
		return;
	}
	domains++;
	without += !trace.nrange;
	if (!trace.nrange)
		return;
	assert_true(cut_trace_fits(&trace, region));
	assert_int_equal(cut_valid_from(&then->src, &view, region, &trace, &is_valid, &err), 0);
	assert_true(is_valid);
	equal = make(now, region, NULL, memory[1], &after) && is_same(&before, &after);
	cut_reach_of(&trace, region, &reach);
	live = trace.live;
	is_far = cut_additions_far_from(&now->src, region, &reach, &live);
	far += is_far;
	judge(is_far, equal);
	assert_int_equal(cut_valid_from(&now->src, &view, region, &trace, &is_valid, &err), 0);
	judge(is_valid, equal);
	hiding += before.counts.removed[VIEW_BY_WEIGHT] > 0;
	same += equal;
	valid += is_valid;
	valid_hiding += is_valid && before.counts.removed[VIEW_BY_WEIGHT];
	if (!is_valid)
		return;
	/* Of the second by what was live in it. */
	live.n = (uint32_t)now->src.parts(now->src.ctx, live.part, (struct cut_segment[CUT_TRACE_PARTS]){{0}}, CUT_TRACE_PARTS);
	if (!cut_additions_far_from(&later->src, region, &reach, &live))
		return;
	far++;
	judge(true, make(later, region, NULL, memory[1], &after) && is_same(&before, &after));
}

static void one_life(uint64_t seed)
{
	struct cut_region leaf[LIVES_LEAVES];
	unsigned live = (unsigned)random_next(&seed) | 1, n;

	make_view(&seed);
	if (!view.nweight)
		return;
	lives_records(&seed, range, true, &lives);
	for (unsigned i = 0; i < LIVES_SOURCES; i++)
		slot[i] = any_slot(&seed);
	for (unsigned i = 0; i < LIVES_GENERATIONS; i++) {
		lives_lay_out(&seed, &lives, &view, live, slot, &generation[i]);
		live = lives_change(&seed, live);
		if (!sets_below(&seed, 6))
			slot[sets_below(&seed, LIVES_SOURCES)] = any_slot(&seed);
	}
	n = lives_leaves(&seed, &lives, leaf);
	for (unsigned i = 0; i < n; i++)
		check_region(&leaf[i], &generation[0], &generation[1], &generation[2]);
}

static void run(uint64_t n, bool less)
{
	less_trace = less;
	domains = beyond = hiding = same = valid = valid_hiding = far = wrong = without = 0;
	for (uint64_t i = 0; i < n; i++)
		one_life((repeat_first() + i) * UINT64_C(0x2545f4914f6cdd1d));
	print_message("%llu domains, %llu with positions beyond P(B), %llu in which some are hidden, %llu without a trace; %llu "
		      "stay the same; %llu valid, %llu of these with hidden ones; %llu far from all that came; %llu wrong\n",
		      (unsigned long long)domains, (unsigned long long)beyond, (unsigned long long)hiding,
		      (unsigned long long)without, (unsigned long long)same, (unsigned long long)valid,
		      (unsigned long long)valid_hiding, (unsigned long long)far, (unsigned long long)wrong);
}

static void valid_domains_are_the_same(void **unused)
{
	uint64_t n = repeat_cases(6000);

	(void)unused;
	run(n, false);
	assert_int_equal(wrong, 0);
	assert_true(n < 400 || (valid > same / 4 && valid_hiding > hiding / 20 && same < domains && far > 0 &&
				without < domains / 10 && beyond > domains / 20));
}

/* The control. */
static void the_halo_alone_is_too_little(void **unused)
{
	(void)unused;
	run(3000, true);
	assert_true(wrong > 30);
}

static int set_up(void **unused)
{
	(void)unused;
	memory[0] = aligned_alloc(64, ARENA);
	memory[1] = aligned_alloc(64, ARENA);
	return memory[0] && memory[1] ? 0 : -1;
}

static int tear_down(void **unused)
{
	(void)unused;
	view_done(&view);
	free(memory[0]);
	free(memory[1]);
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(valid_domains_are_the_same),
					   cmocka_unit_test(the_halo_alone_is_too_little)};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
