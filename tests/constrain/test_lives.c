/*
 * Traces of domains with pieces, on thousands of lives: points and lines come and go, heights change. If the trace of a domain is
 * valid in another generation, or all that came is far, the domain there is the same, byte by byte; and of those that are the
 * same many are found.
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
#include "cut_valid.h"
#include "err.h"
#include "geom.h"
#include "lives.h"
#include "made.h"
#include "repeat.h"

enum { PIECES = 24, OFFERS = 40 };

struct generation {
	struct lives_generation life;
	struct lineset_piece piece[PIECES];
	unsigned npiece;
	struct constrain_lines lines;
};

static struct lives lives;
static struct generation generation[LIVES_GENERATIONS];
static struct view view;
static void *memory[2];
static uint64_t traces[CUT_TRACE_BYTES / 8 + 1];
static uint64_t domains, pieces, same, valid, valid_pieces, far, changed;

/* ---- lines of a generation ---- */

static bool meets(const struct lineset_piece *p, const int32_t box[4])
{
	int32_t low = p->a[1] < p->b[1] ? p->a[1] : p->b[1], high = p->a[1] < p->b[1] ? p->b[1] : p->a[1];

	return p->a[0] <= box[2] && p->b[0] >= box[0] && low <= box[3] && high >= box[1];
}

static int find(void *ctx, const int32_t box[4], lineset_piece_fn fn, void *sink, struct err *err)
{
	const struct generation *g = ctx;

	for (unsigned i = 0; i < g->npiece; i++) {
		int rc = meets(&g->piece[i], box) ? fn(sink, &g->piece[i], err) : 0;

		if (rc)
			return rc;
	}
	return 0;
}

static struct digest sum_of(const struct generation *g, const int32_t box[4])
{
	struct digest sum = {0, 0};

	for (unsigned i = 0; i < g->npiece; i++)
		if (meets(&g->piece[i], box))
			digest_add(&sum, digest_hash(&g->piece[i], sizeof(g->piece[i])));
	return sum;
}

static struct generation *of(void *tiling)
{
	for (unsigned i = 0; i < LIVES_GENERATIONS; i++)
		if (tiling == &generation[i].life.tiling)
			return &generation[i];
	return NULL;
}

static int line_sum(void *ctx, const int32_t box[4], struct digest *ret, struct err *err)
{
	(void)err;
	*ret = sum_of(of(ctx), box);
	return 0;
}

static struct digest content(void *ctx)
{
	const int32_t all[4] = {INT32_MIN, INT32_MIN, INT32_MAX, INT32_MAX};

	return sum_of(of(ctx), all);
}

/* ---- generations ---- */

static void lay_out(uint64_t *seed, struct generation *g, unsigned live)
{
	lives_lay_out(seed, &lives, &view, live, NULL, &g->life);
	g->life.src.line_sum = line_sum;
	g->life.src.lines = content;
	g->lines = (struct constrain_lines){.ctx = g, .find = find};
}

static unsigned position(const struct generation *g, const int32_t at[2])
{
	unsigned i = 0;

	while (i < g->life.set.n && (g->life.set.pos[i].x != at[0] || g->life.set.pos[i].y != at[1]))
		i++;
	return i;
}

static void offer(struct generation *g, struct tri_pieces *p, unsigned a, unsigned b)
{
	const int32_t ends[2][2] = {{g->life.set.pos[a].x, g->life.set.pos[a].y}, {g->life.set.pos[b].x, g->life.set.pos[b].y}};
	bool swap = !geom_less(ends[0], ends[1]);
	struct lineset_piece *to = &g->piece[g->npiece];
	uint32_t at;

	if (g->npiece == PIECES || tri_piece_insert(p, a, b, &at))
		return;
	*to = (struct lineset_piece){.turns = 0};
	memcpy(to->a, ends[swap], sizeof(to->a));
	memcpy(to->b, ends[!swap], sizeof(to->b));
	for (unsigned i = 0; i < g->npiece; i++)
		if (!memcmp(&g->piece[i], to, sizeof(*to)))
			return;
	g->npiece++;
}

/* Those of the generation before that still can be pieces, most of them; and new ones. False: its points are flat. */
static bool make_lines(uint64_t *seed, struct generation *g, const struct generation *before)
{
	unsigned new = !before             ? sets_below(seed, OFFERS) :
		       sets_below(seed, 3) ? 0 :
					     sets_below(seed, 4),
		 drop = sets_below(seed, 3);
	struct tri *t = g->life.set.n < 3 ? NULL : check_tri(g->life.set.pos, g->life.set.n);
	struct tri_pieces *p;

	g->npiece = 0;
	if (!t)
		return false;
	p = check_pieces(t, 2 * g->life.set.n);
	for (unsigned i = 0; before && i < before->npiece; i++) {
		unsigned a = position(g, before->piece[i].a), b = position(g, before->piece[i].b);

		if (a < g->life.set.n && b < g->life.set.n && (drop || sets_below(seed, 6)))
			offer(g, p, a, b);
	}
	for (; new > 0; new --)
		offer(g, p, sets_below(seed, g->life.set.n), sets_below(seed, g->life.set.n));
	free(p);
	free(t);
	return true;
}

static void check_region(const struct cut_region *region, const struct generation *then, const struct generation *now,
			 const struct generation *later)
{
	struct made a = {.src = &then->life.src, .view = &view, .region = region, .lines = &then->lines, .memory = memory[0]};
	struct made b = {.src = &now->life.src, .view = &view, .region = region, .lines = &now->lines, .memory = memory[1]};
	struct mesh_domain before, after;
	struct cut_reach reach;
	struct cut_trace trace;
	struct cut_live live;
	struct err err = ERR_INIT;
	bool is_valid = false, equal;

	cut_trace_init(&trace, traces);
	a.trace = &trace;
	made_domain(&a, &before);
	assert_true(cut_trace_fits(&trace, region));
	assert_int_equal(cut_valid_from(&then->life.src, &view, region, &trace, &is_valid, &err), 0);
	assert_true(is_valid);
	made_domain(&b, &after);
	equal = made_same(&before, &after);
	cut_reach_of(&trace, region, &reach);
	live = trace.live;
	if (cut_additions_far_from(&now->life.src, region, &reach, &live)) {
		assert_true(equal);
		far++;
	}
	assert_int_equal(cut_valid_from(&now->life.src, &view, region, &trace, &is_valid, &err), 0);
	if (is_valid && !equal)
		fail_msg("a domain that changed is said to be valid (%u and %u triangles)", before.ntriangle, after.ntriangle);
	domains++;
	pieces += a.c.crossed > 0;
	same += equal;
	changed += !equal;
	valid += is_valid;
	valid_pieces += is_valid && a.c.crossed;
	if (!is_valid || !later)
		return;
	/* Of the second by what was live in it. */
	live.n = (uint32_t)now->life.src.parts(now->life.src.ctx, live.part, (struct cut_segment[CUT_TRACE_PARTS]){{0}},
					       CUT_TRACE_PARTS);
	live.lines = content(now->life.src.ctx);
	b.src = &later->life.src;
	b.lines = &later->lines;
	if (!cut_additions_far_from(&later->life.src, region, &reach, &live))
		return;
	made_domain(&b, &after);
	assert_true(made_same(&before, &after));
	far++;
}

static void one_life(uint64_t seed)
{
	static const int32_t ranges[] = {5, 8, 20, 400};
	struct cut_region leaf[LIVES_LEAVES];
	unsigned live = (unsigned)random_next(&seed) | 1, n;

	view = VIEW_INIT;
	lives_records(&seed, ranges[sets_below(&seed, 4)], false, &lives);
	for (unsigned i = 0; i < LIVES_GENERATIONS; i++) {
		lay_out(&seed, &generation[i], live);
		if (!make_lines(&seed, &generation[i], i ? &generation[i - 1] : NULL))
			return;
		live = lives_change(&seed, live);
	}
	n = lives_leaves(&seed, &lives, leaf);
	for (unsigned i = 0; i < n; i++)
		check_region(&leaf[i], &generation[0], &generation[1], &generation[2]);
}

static void valid_domains_are_the_same(void **unused)
{
	uint64_t n = repeat_cases(4000);

	for (uint64_t i = 0; i < n; i++)
		one_life((repeat_first() + i) * UINT64_C(0x2545f4914f6cdd1d));
	print_message(
		"%llu domains, %llu with crossed triangles; %llu stay the same, %llu change; %llu valid, %llu of these with "
		"crossed triangles; %llu far from all that came\n",
		(unsigned long long)domains, (unsigned long long)pieces, (unsigned long long)same, (unsigned long long)changed,
		(unsigned long long)valid, (unsigned long long)valid_pieces, (unsigned long long)far);
	assert_true(n < 400 || (valid > same / 4 && valid_pieces > pieces / 20 && changed > domains / 20 && far > 0));
}

/* Also at the ends of the lattice, and if there are so many that ranges are made coarser. */
static void ranges_cover_boxes(void **unused)
{
	static const int32_t ends[] = {INT32_MIN, INT32_MIN + 1, -1, 0, INT32_MAX - 1, INT32_MAX};
	static int32_t box[2000][4];
	uint64_t seed = 11;

	generation[0].life.set.n = 0;
	lay_out(&seed, &generation[0], 0);
	for (unsigned n = 1; n <= 2000; n *= 3) {
		struct cut_trace trace;
		struct cut_cover cover = {.trace = &trace};
		struct err err = ERR_INIT;

		cut_trace_init(&trace, traces);
		for (unsigned i = 0; i < n; i++) {
			for (unsigned k = 0; k < 2; k++) {
				int32_t a = sets_below(&seed, 2) ? ends[sets_below(&seed, 6)] : (int32_t)random_next(&seed);
				int32_t b = sets_below(&seed, 2) ? a : ends[sets_below(&seed, 6)];

				box[i][k] = a < b ? a : b;
				box[i][2 + k] = a < b ? b : a;
			}
			cut_cover_box(&cover, box[i]);
		}
		assert_int_equal(cut_cover_end(&cover, &generation[0].life.src, &err), 0);
		assert_true(trace.nrange <= trace.most_ranges);
		for (unsigned i = 0; i < n; i++)
			for (unsigned k = 0; k < 4; k++) {
				uint64_t key = point_morton(box[i][k & 1 ? 2 : 0], box[i][k & 2 ? 3 : 1]);
				size_t at = grid_sum_find(trace.range, trace.nrange, key);

				assert_true(at < trace.nrange && trace.range[at].lo <= key);
			}
	}
}

static int set_up(void **unused)
{
	memory[0] = aligned_alloc(64, MADE_BYTES);
	memory[1] = aligned_alloc(64, MADE_BYTES);
	return memory[0] && memory[1] ? 0 : -1;
}

static int tear_down(void **unused)
{
	free(memory[0]);
	free(memory[1]);
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(ranges_cover_boxes), cmocka_unit_test(valid_domains_are_the_same)};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
