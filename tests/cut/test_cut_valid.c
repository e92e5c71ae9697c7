/*
 * Validity on tens of thousands of cases: a small dataset, what every region of a plan loads of it, and its trace; then
 * another generation (more and fewer points, other segments, other cells). If the trace is valid, the region must load
 * the same; and of the regions that load the same, nearly all must be found. The same for the test by boxes, of that
 * generation by the first, and of a third by the second.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "cut_order.h"
#include "cut_valid.h"
#include "err.h"
#include "parts.h"
#include "tiling.h"
#include "repeat.h"

enum { MOST = 400, LEAVES = 48, SOURCES = 6 };

struct record {
	struct point p;
	unsigned source;
};

/* Everything that was ever pushed. */
struct history {
	struct record record[MOST];
	size_t n;
};

/* A generation, in segments. */
struct state {
	struct point pts[TILING_SEGMENTS][MOST];
	bool dead[TILING_SEGMENTS][MOST];
	struct tiling tiling;
	struct cut_source src;
};

static struct history history;
static struct state old, new, later;
static struct view view;
static void *scratch;
static size_t scratch_size;
static uint64_t judged, same, found, changed, boxes;
static uint32_t most_sites = CUT_TRACE_SITES, most_ranges = CUT_TRACE_RANGES;
static uint64_t traces[CUT_TRACE_BYTES / 8 + 1];

static unsigned below(uint64_t *seed, unsigned n)
{
	return (unsigned)(random_next(seed) % n);
}

static void place(uint64_t *seed, unsigned family, unsigned range, const int32_t base[2], int32_t ret[2])
{
	static const int32_t ends[5] = {INT32_MIN, INT32_MIN + 1, 0, INT32_MAX - 1, INT32_MAX};
	bool far = below(seed, 2);

	ret[0] = base[0] + (int32_t)below(seed, range);
	ret[1] = base[1] + (int32_t)below(seed, range);
	if (family == 0) {
		ret[0] = ends[below(seed, 5)];
		ret[1] = ends[below(seed, 5)];
	} else if (family == 1) {
		ret[0] += far ? 1000000 : 0;
		ret[1] += far ? 700000 : 0;
	} else if (family == 2) {
		ret[1] = base[1] + 2 * (ret[0] - base[0]);
	}
}

static void add(uint64_t *seed, const int32_t at[2], unsigned source)
{
	struct record *r = &history.record[history.n];

	if (history.n == MOST)
		return;
	history.n++;
	*r = (struct record){.source = source};
	r->p = (struct point){
		.x = at[0], .y = at[1], .z = (int32_t)below(seed, 3), .cls = (uint8_t)(1 + below(seed, 2)), .ret = 0x11};
	if (below(seed, 10) == 0)
		r->p.cls = 7;
	if (below(seed, 10) == 0)
		r->p.tag = POINT_WITHHELD;
}

static bool point_less(const void *ctx, const struct point *a, const struct point *b)
{
	(void)ctx;
	return point_compare(a, b) < 0;
}

/* What is live in a segment was live there before, except for sources that were added or removed: only these are tested. */
static bool by_source, merged;

static unsigned segment_of(unsigned source)
{
	if (merged && source == SOURCES)
		return segment_of(1);
	return source >= SOURCES ? TILING_SEGMENTS - 2 + source - SOURCES : source % (TILING_SEGMENTS - 2);
}

/* The live sources in arbitrary segments, with some that are not live. */
static void lay_out(uint64_t *seed, struct state *s, unsigned live)
{
	unsigned segments = by_source ? TILING_SEGMENTS : 1 + below(seed, TILING_SEGMENTS);
	bool prune = below(seed, 3) == 0;

	memset(s, 0, sizeof *s);
	s->tiling = (struct tiling){.segments = segments, .salt = random_next(seed)};
	s->tiling.cell_records = below(seed, 4) ? 1 + below(seed, 5) : 1000;
	for (size_t i = 0; i < history.n; i++) {
		unsigned at = by_source ? segment_of(history.record[i].source) : below(seed, segments);
		struct point p = history.record[i].p;

		if (!(live >> history.record[i].source & 1)) {
			if (prune)
				continue;
			p.tag |= 0x8000; /* distinguished below: no other point has it */
		}
		s->pts[at][s->tiling.n[at]++] = p;
	}
	for (unsigned k = 0; k < segments; k++) {
		cut_order_sort(s->pts[k], s->tiling.n[k], point_less, NULL);
		for (size_t i = 0; i < s->tiling.n[k]; i++) {
			s->dead[k][i] = s->pts[k][i].tag >> 15;
			s->pts[k][i].tag &= 0x7fff;
		}
		s->tiling.pts[k] = s->pts[k];
		s->tiling.dead[k] = s->dead[k];
	}
	tiling_source(&s->tiling, &s->src);
}

static unsigned make_leaves(uint64_t *seed, const struct cut_source *src, struct cut_region *ret, struct cut_region *ret_root)
{
	unsigned want = 1 + below(seed, LEAVES - 1);
	int32_t box[4];

	if (!src->box(src->ctx, box))
		return 0;
	cut_region_root(box, &ret[0]);
	*ret_root = ret[0];
	return parts_halve(seed, want, 150, ret);
}

/* Returns how many points were read. */
static uint64_t load(const struct state *s, const struct cut_region *region, struct mesh_vertex *out,
		     const struct cut_trace *before, struct cut_trace *trace, struct cut_load *ret)
{
	struct err err = ERR_INIT;
	uint64_t need = 0, read;

	*ret = (struct cut_load){
		.out = out, .cap = MOST, .scratch = scratch, .scratch_size = scratch_size, .before = before, .trace = trace};
	assert_int_equal(cut_load_from(&s->src, &view, region, ret, &need, &err), 0);
	read = ret->counts.points_read;
	ret->counts.cells_read = ret->counts.points_read = 0;
	return read;
}

static bool loads_same(const struct cut_load *a, const struct cut_load *b)
{
	return a->n == b->n && a->own == b->own && !memcmp(a->out, b->out, a->n * sizeof *a->out) &&
	       !memcmp(&a->counts, &b->counts, sizeof a->counts);
}

/* No plan of this generation has such regions: there are points beyond their infinite sides. */
static bool outgrown(const struct state *s, const struct cut_region *root)
{
	int32_t box[4];

	if (!s->src.box(s->src.ctx, box))
		return false;
	return !cut_region_holds(root, box[0], box[1]) || !cut_region_holds(root, box[2], box[3]);
}

/* Whether everything that was live still is; regions whose halo the earlier sites bounded, how many of them changed,
 * and what was read for these, with and without. */
static bool still;
static uint64_t bounded, bounded_changed, bounded_read, all_read;

static void live_of(const struct state *s, struct cut_live *ret)
{
	struct cut_segment segment[CUT_TRACE_PARTS];

	*ret = (struct cut_live){.n = 0};
	ret->n = (uint32_t)s->src.parts(s->src.ctx, ret->part, segment, CUT_TRACE_PARTS);
}

/* The test by boxes, from what was live in an earlier generation in which the trace is valid. */
static void check_far(const struct cut_region *region, const struct cut_reach *reach, const struct state *then,
		      const struct state *now, const struct cut_load *was)
{
	struct mesh_vertex out[MOST];
	struct cut_live live;
	struct cut_load is;

	live_of(then, &live);
	if (!cut_additions_far_from(&now->src, region, reach, &live))
		return;
	boxes++;
	load(now, region, out, NULL, NULL, &is);
	if (!loads_same(was, &is)) {
		char text[CUT_REGION_TEXT_SIZE];

		fail_msg("all that came is said to be far from %s: %u of %u, now %u of %u", cut_region_text(region, text),
			 was->own, was->n, is.own, is.n);
	}
}

static void check_region(const struct cut_region *region)
{
	struct mesh_vertex before[MOST], after[MOST], again[MOST];
	struct cut_reach reach;
	struct cut_trace trace;
	struct cut_load a, b, c;
	struct err err = ERR_INIT;
	bool valid = false, equal;
	uint64_t all;

	cut_trace_init(&trace, traces);
	trace.most_sites = most_sites;
	trace.most_ranges = most_ranges;
	load(&old, region, before, NULL, &trace, &a);
	assert_true(cut_trace_fits(&trace, region));
	assert_int_equal(cut_valid_from(&old.src, &view, region, &trace, &valid, &err), 0);
	assert_true(valid);
	assert_int_equal(cut_valid_from(&new.src, &view, region, &trace, &valid, &err), 0);
	all = load(&new, region, after, NULL, NULL, &b);
	cut_reach_of(&trace, region, &reach);
	check_far(region, &reach, &old, &new, &a);
	if (valid)
		check_far(region, &reach, &new, &later, &a);
	equal = loads_same(&a, &b);
	if (still || cut_trace_still_live_in(&new.src, &trace)) {
		bounded_read += load(&new, region, again, &trace, NULL, &c);
		assert_true(loads_same(&b, &c));
		all_read += all;
		bounded++;
		bounded_changed += !equal;
	}
	if (valid && !equal) {
		char text[CUT_REGION_TEXT_SIZE];

		fail_msg("region %s is said to be unchanged: %u of %u, now %u of %u", cut_region_text(region, text), a.own, a.n,
			 b.own, b.n);
	}
	/* Also if segments were merged since. */
	if (cut_trace_still_live_in(&later.src, &trace)) {
		load(&later, region, after, NULL, NULL, &b);
		load(&later, region, again, &trace, NULL, &c);
		assert_true(loads_same(&b, &c));
	}
	judged++;
	same += equal;
	changed += !equal;
	found += valid;
}

static void one_case(uint64_t seed)
{
	unsigned family = below(&seed, 12), n = below(&seed, 60), live, then, more;
	unsigned range = below(&seed, 3) ? 1 + below(&seed, 6) : 1 + below(&seed, 300);
	int32_t base[2] = {(int32_t)below(&seed, 1000) - 500, (int32_t)below(&seed, 1000) - 500};
	struct cut_region leaf[LEAVES], root = {0};
	unsigned nleaf;

	if (below(&seed, 3) == 0)
		base[0] = base[1] = -(int32_t)below(&seed, 4);
	view = VIEW_INIT;
	view.duplicates = below(&seed, 2) ? VIEW_LOWEST : VIEW_HIGHEST;
	view.keep_withheld = below(&seed, 2);
	view.keep_noise = below(&seed, 2);
	/* Thinned chains, coarser ranges. */
	most_sites = below(&seed, 3) ? CUT_TRACE_SITES : 2 + below(&seed, 4);
	most_ranges = below(&seed, 3) ? CUT_TRACE_RANGES : 4 + 4 * below(&seed, 3);
	history.n = 0;
	by_source = below(&seed, 2);
	for (unsigned i = 0; i < n; i++) {
		int32_t at[2];

		place(&seed, family, range, base, at);
		add(&seed, at, below(&seed, SOURCES));
	}
	/* Most of the sources are live; the new ones are SOURCES. */
	live = (1u << SOURCES) - 1;
	if (below(&seed, 2))
		live &= ~(1u << below(&seed, SOURCES));
	lay_out(&seed, &old, live);
	then = live | 1u << SOURCES;
	if (below(&seed, 3) == 0)
		then &= ~(1u << below(&seed, SOURCES));
	if (below(&seed, 6) == 0)
		then |= 1u << below(&seed, SOURCES);
	more = below(&seed, 4);
	for (unsigned i = 0; i < more; i++) {
		int32_t at[2];

		place(&seed, family, range + below(&seed, 2) * 2, base, at);
		/* Sometimes at the position of another point, or the same record again. */
		if (history.n && below(&seed, 3) == 0) {
			const struct point *p = &history.record[below(&seed, (unsigned)history.n)].p;

			at[0] = p->x;
			at[1] = p->y;
		}
		add(&seed, at, SOURCES);
	}
	still = !(live & ~then);
	lay_out(&seed, &new, then);
	for (unsigned i = 0; i < more; i++) {
		int32_t at[2];

		place(&seed, family, range, base, at);
		add(&seed, at, SOURCES + 1);
	}
	then |= 1u << (SOURCES + 1);
	merged = below(&seed, 2);
	lay_out(&seed, &later, below(&seed, 4) ? then : then & ~(1u << below(&seed, SOURCES)));
	merged = false;
	nleaf = make_leaves(&seed, below(&seed, 2) ? &new.src : &old.src, leaf, &root);
	if (nleaf && outgrown(&old, &root))
		return;
	for (unsigned i = 0; i < nleaf; i++)
		check_region(&leaf[i]);
}

/* Many points in small cells, and a push, a removal, or both in one corner: regions away from there are found. */
static void local_case(uint64_t seed)
{
	const int32_t zero[2] = {-100, -90};
	struct cut_region leaf[LEAVES], root;
	unsigned nleaf, live = 3, then;
	int32_t at[2];

	view = VIEW_INIT;
	most_sites = below(&seed, 2) ? CUT_TRACE_SITES : 6;
	most_ranges = CUT_TRACE_RANGES;
	history.n = 0;
	by_source = below(&seed, 2);
	for (unsigned i = 0; i < 300; i++) {
		place(&seed, 9, 256, zero, at);
		add(&seed, at, 0);
	}
	for (unsigned i = 0; i < 20; i++) {
		place(&seed, 9, 32, zero, at);
		add(&seed, at, 1 + below(&seed, 2));
	}
	lay_out(&seed, &old, live);
	then = 1 + below(&seed, 4) * 2;
	still = !(live & ~then);
	lay_out(&seed, &new, then);
	for (unsigned i = 0; i < 5; i++) {
		place(&seed, 9, 32, zero, at);
		add(&seed, at, SOURCES + 1);
	}
	merged = below(&seed, 2);
	lay_out(&seed, &later, then | 1u << (SOURCES + 1));
	merged = false;
	old.tiling.cell_records = new.tiling.cell_records = later.tiling.cell_records = 1 + below(&seed, 4);
	nleaf = make_leaves(&seed, &new.src, leaf, &root);
	for (unsigned i = 0; i < nleaf && !outgrown(&old, &root); i++)
		check_region(&leaf[i]);
}

struct fuzz {
	const char *name;
	uint64_t cases, least, boxes; /* percent of those that load the same that are found, in all and by boxes */
	void (*one)(uint64_t seed);
};

static void run(const struct fuzz *f)
{
	uint64_t n = repeat_cases(5000) / f->cases, at = repeat_first();

	judged = same = found = changed = boxes = bounded = bounded_changed = bounded_read = all_read = 0;
	scratch_size = cut_load_scratch_bytes(MOST);
	scratch = malloc(scratch_size);
	assert_non_null(scratch);
	for (uint64_t i = 0; i < n; i++)
		f->one(at + i * 7919);
	free(scratch);
	printf("%s: %llu regions: %llu load the same, %llu of these found; %llu changed; %llu by boxes\n", f->name,
	       (unsigned long long)judged, (unsigned long long)same, (unsigned long long)found, (unsigned long long)changed,
	       (unsigned long long)boxes);
	printf("%s: %llu bounded by what was there, %llu of these changed; %llu points read, else %llu\n", f->name,
	       (unsigned long long)bounded, (unsigned long long)bounded_changed, (unsigned long long)bounded_read,
	       (unsigned long long)all_read);
	assert_true(bounded > judged / 5 && bounded_changed > bounded / 20 && bounded_read < all_read);
	assert_true(changed > judged / 50);
	assert_true(found >= same * f->least / 100);
	assert_true(boxes >= same * f->boxes / 100);
}

/* Most cells are about as large as the data here, and a change in one changes all regions that see it. */
static void test_random(void **state)
{
	const struct fuzz f = {"random", 1, 30, 5, one_case};

	(void)state;
	run(&f);
}

static void test_local(void **state)
{
	const struct fuzz f = {"local", 20, 80, 30, local_case};

	(void)state;
	run(&f);
}

/* Content of two segments that is now in one is not an addition, wherever it is. */
static void test_merged(void **state)
{
	const int32_t zero[2] = {-100, -90};
	struct cut_reach nothing = {0};
	struct cut_region root;
	struct cut_live live;
	uint64_t seed = 5;
	int32_t at[2], box[4];

	(void)state;
	view = VIEW_INIT;
	history.n = 0;
	by_source = true;
	for (unsigned i = 0; i < 200; i++) {
		place(&seed, 9, 256, zero, at);
		add(&seed, at, i % (SOURCES + 1));
	}
	lay_out(&seed, &old, (2u << SOURCES) - 1);
	live_of(&old, &live);
	assert_int_equal(live.n, 3);
	for (unsigned k = 0; k < 4; k++) {
		merged = k & 1;
		lay_out(&seed, &new, (2u << SOURCES) - 1 - (k >> 1));
		assert_true(new.src.box(new.src.ctx, box));
		cut_region_root(box, &root);
		/* A little of it is no longer live. */
		assert_true(cut_additions_far_from(&new.src, &root, &nothing, &live) == (k < 2));
	}
	merged = false;
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_random), cmocka_unit_test(test_local),
					   cmocka_unit_test(test_merged)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
