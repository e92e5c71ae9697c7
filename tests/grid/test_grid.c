/*
 * The cache against a second implementation: cells by halving the whole key space in memory, scans by filtering.
 * Whatever the order of the points and the memory, cells and records must be the same.
 */
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "grid_fixture.h"

struct cells_check {
	struct reader *r;
	const struct set *s;
	const struct ref_cell *ref;
	size_t n, at;
};

static int check_cell(void *ctx, const struct grid_cell *cell)
{
	struct cells_check *c = ctx;
	const struct ref_cell *ref = &c->ref[c->at];
	struct gather g = {0};
	struct err err = ERR_INIT;

	assert_true(c->at < c->n);
	assert_true(cell->lo == ref->lo && cell->hi == ref->hi);
	assert_true(cell->count == ref->n && cell->distinct == ref->distinct);
	assert_memory_equal(cell->box, ref->box, sizeof ref->box);
	assert_int_equal(cell->blocks, (ref->n + GRID_CELL_RECORDS - 1) / GRID_CELL_RECORDS);
	CHECK(grid_cell_read(c->r->r, cell, gather_sink, &g, &err));
	assert_int_equal(g.n, ref->n);
	assert_memory_equal(g.pts, c->s->pts + ref->first, ref->n * sizeof *g.pts);
	assert_true(g.largest <= GRID_CELL_RECORDS);
	free(g.pts);
	c->at++;
	return 0;
}

/* Checks all of one segment with this content. */
static void check_segment(struct reader *r, const struct set *sorted, const struct grid_segment_info *info)
{
	struct cells_check c = {.r = r, .s = sorted};
	struct ref_cell *ref = ref_cells(sorted, &c.n);
	struct grid_visitor v = {.ctx = &c, .cell = check_cell};
	struct digest sum = {0, 0}, got;
	struct err err = ERR_INIT;
	uint64_t classes[256] = {0}, count;
	bool exact;

	c.ref = ref;
	CHECK(grid_walk(r->r, 0, UINT64_MAX, &v, &err));
	assert_int_equal(c.at, c.n);
	assert_true(info->cells == c.n && info->points == sorted->n);
	for (size_t i = 0; i < c.n; i++) {
		struct digest part;

		digest_add(&sum, ref[i].sum);
		CHECK(grid_sum(r->r, ref[i].lo, ref[i].hi, &part, &err));
		assert_true(digest_equal(part, ref[i].sum));
	}
	for (size_t i = 0; i < sorted->n; i++)
		classes[sorted->pts[i].cls]++;
	assert_memory_equal(classes, info->classes, sizeof classes);
	assert_true(digest_equal(sum, info->sum));
	CHECK(grid_sum(r->r, 0, UINT64_MAX, &got, &err));
	assert_true(digest_equal(sum, got));
	CHECK(grid_count(r->r, 0, UINT64_MAX, &count, &exact, &err));
	assert_true(exact && count == sorted->n && grid_points(r->grid) == sorted->n);
	free(ref);
}

static void same_file(const struct folder *f, const char *a, const char *b)
{
	char paths[2][256];
	FILE *file[2];
	int ca, cb;

	snprintf(paths[0], sizeof paths[0], "%s/%s", f->path, a);
	snprintf(paths[1], sizeof paths[1], "%s/%s", f->path, b);
	file[0] = fopen(paths[0], "rb");
	file[1] = fopen(paths[1], "rb");
	assert_true(file[0] && file[1]);
	do {
		ca = getc(file[0]);
		cb = getc(file[1]);
		assert_int_equal(ca, cb);
	} while (ca != EOF);
	fclose(file[0]);
	fclose(file[1]);
}

static void one_content(enum shape shape, size_t n, unsigned sources, uint64_t seed)
{
	static const size_t memories[] = {0, GRID_STAGE_MIN, 3 * GRID_STAGE_MIN / 2};
	struct set s = set_make(shape, n, sources, seed), sorted = set_make(shape, n, sources, seed);
	struct grid_segment_info info[3];
	struct folder f = folder_new();
	struct err err = ERR_INIT;
	uint64_t rng = seed;

	set_sort(&sorted);
	for (unsigned i = 0; i < 3; i++) {
		char name[16];

		snprintf(name, sizeof name, "part%u", i);
		CHECK(stage_set(&f, name, &s, memories[i], &info[i], &err));
		set_shuffle(&s, seed + i);
	}
	assert_int_equal(folder_files(&f, ""), 3); /* the runs were removed */
	same_file(&f, info[0].file, info[1].file);
	same_file(&f, info[0].file, info[2].file);

	struct grid_manifest m = manifest_of(info, 1, sources);

	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	struct reader r = reader_open(&f, "m", 1, seed % 2 ? 1 << 20 : 0);

	check_segment(&r, &sorted, &info[0]);
	for (int i = 0; i < 40; i++) {
		uint64_t lo, hi;

		random_range(&sorted, &rng, &lo, &hi);
		reader_check(&r, &sorted, lo, hi, true);
	}
	reader_close(&r);
	free(m.sources);
	set_free(&s);
	set_free(&sorted);
	folder_remove(&f);
}

static void test_cells(void **state)
{
	for (int shape = 0; shape < SHAPES; shape++)
		for (unsigned sources = 1; sources <= 7; sources += 6)
			one_content(shape, 60000, sources, 11 + (unsigned)shape);
}

static void test_small(void **state)
{
	static const size_t sizes[] = {0, 1, 2, 1023, 1024, 1025, 1026, 2048, 5000};

	for (int shape = 0; shape < SHAPES; shape++)
		for (unsigned i = 0; i < sizeof sizes / sizeof *sizes; i++)
			one_content(shape, sizes[i], 1 + i % 3, 100 + i);
}

/* More sources than a tag can distinguish, in random order: runs end because of their number. */
static void test_many_sources(void **state)
{
	enum { SOURCES = 9000 };

	one_content(SHAPE_DUPLICATES, 40000, SOURCES, 5);
	one_content(SHAPE_ONE_POSITION, 30000, SOURCES, 6);
	one_content(SHAPE_UNIFORM, 30000, SOURCES, 7);
}

/* Several pushes to one area, sources removed later: every generation stays the same. */
static void generations(enum shape shape, uint64_t seed)
{
	enum { PUSHES = 4, EACH = 3, N = 20000 };
	struct set all = set_make(shape, PUSHES * N, PUSHES * EACH, seed);
	struct grid_segment_info info[PUSHES];
	struct folder f = folder_new();
	struct err err = ERR_INIT;
	uint64_t rng = seed;

	for (size_t i = 0; i < all.n; i++)
		all.ids[i] = 1 + (uint32_t)(i / N * EACH + random_below(&rng, EACH));
	for (unsigned i = 0; i < PUSHES; i++) {
		struct set part = {all.pts + i * N, all.ids + i * N, N};
		char name[16];

		snprintf(name, sizeof name, "push%u", i);
		CHECK(stage_set(&f, name, &part, i % 2 ? GRID_STAGE_MIN : 0, &info[i], &err));
	}
	struct grid_manifest m = manifest_of(info, PUSHES, PUSHES * EACH);

	m.generation = 8;
	for (unsigned i = 0; i < PUSHES * EACH; i++) {
		m.sources[i].added = 1 + i / EACH;
		m.sources[i].removed = i == 5 ? m.sources[i].added : i % EACH == 0 ? 5 : i == 4 ? 7 : i / EACH == 2 ? 8 : 0;
	}
	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	set_sort(&all);
	for (uint64_t g = 0; g <= 8; g++) {
		struct reader r = reader_open(&f, "m", g < 8 ? g : GRID_NEWEST, 200000);
		struct set live = set_make(shape, all.n, 1, 0);
		bool removed = g >= 2;

		live.n = 0;
		for (size_t i = 0; i < all.n; i++) {
			const struct grid_source *s = &m.sources[all.ids[i] - 1];

			if (s->added <= g && (!s->removed || s->removed > g))
				live.pts[live.n++] = all.pts[i];
		}
		assert_true(grid_points(r.grid) == live.n);
		reader_check(&r, &live, 0, UINT64_MAX, !removed);
		for (int i = 0; i < 25; i++) {
			uint64_t lo, hi;

			random_range(&all, &rng, &lo, &hi);
			reader_check(&r, &live, lo, hi, !removed);
		}
		set_free(&live);
		reader_close(&r);
	}
	free(m.sources);
	set_free(&all);
	folder_remove(&f);
}

static void test_generations(void **state)
{
	for (int shape = 0; shape < SHAPES; shape++)
		generations(shape, 50 + (unsigned)shape);
}

/* ---- walking with pruning ---- */

struct box_walk {
	int32_t box[4];
	uint64_t records, entered;
};

static bool meets(const int32_t a[4], const int32_t b[4])
{
	return a[0] <= b[2] && b[0] <= a[2] && a[1] <= b[3] && b[1] <= a[3];
}

static bool box_enter(void *ctx, const struct grid_cell *subtree)
{
	struct box_walk *w = ctx;

	w->entered++;
	return meets(w->box, subtree->box);
}

static int box_cell(void *ctx, const struct grid_cell *cell)
{
	struct box_walk *w = ctx;

	if (meets(w->box, cell->box))
		w->records += cell->count;
	return 0;
}

static int stop_cell(void *ctx, const struct grid_cell *cell)
{
	return ++*(int *)ctx == 3 ? 42 : 0;
}

static void test_prune(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, 400000, 2, 3);
	struct grid_segment_info info;
	struct folder f = folder_new();
	struct err err = ERR_INIT;
	uint64_t rng = 9, pruned_pages = 0, plain_pages = 0;
	int stopped = 0;

	CHECK(stage_set(&f, "a", &s, 0, &info, &err));
	struct grid_manifest m = manifest_of(&info, 1, 2);

	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	struct reader r = reader_open(&f, "m", 1, 1 << 20);

	for (int i = 0; i < 50; i++) {
		struct box_walk with = {
			.box = {(int32_t)random_below(&rng, 2000000) - 1000000, (int32_t)random_below(&rng, 2000000) - 1000000}};
		with.box[2] = with.box[0] + 30000;
		with.box[3] = with.box[1] + 30000;
		struct box_walk without = with;
		struct grid_visitor pruned = {&with, box_enter, box_cell}, plain = {&without, NULL, box_cell};
		struct grid_reader_stats before = grid_reader_stats(r.r), after;

		CHECK(grid_walk(r.r, 0, UINT64_MAX, &pruned, &err));
		after = grid_reader_stats(r.r);
		CHECK(grid_walk(r.r, 0, UINT64_MAX, &plain, &err));
		assert_true(with.records == without.records && with.entered > 1);
		assert_true(grid_reader_stats(r.r).records == 0);
		pruned_pages += after.pages - before.pages;
		plain_pages += grid_reader_stats(r.r).pages - after.pages;
	}
	assert_true(pruned_pages < plain_pages * 3 / 4);
	struct grid_visitor stop = {&stopped, NULL, stop_cell};

	assert_int_equal(grid_walk(r.r, 0, UINT64_MAX, &stop, &err), 42);
	assert_int_equal(stopped, 3);
	reader_close(&r);
	free(m.sources);
	set_free(&s);
	folder_remove(&f);
}

/* Two segments whose pages are at the same offsets: they must not be confused. */
static void test_twins(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, 3000, 1, 3);
	struct grid_segment_info info[2];
	struct folder f = folder_new();
	struct err err = ERR_INIT;
	struct gather g = {0};
	struct digest sum, want;

	CHECK(stage_set(&f, "a", &s, 0, &info[0], &err));
	for (size_t i = 0; i < s.n; i++)
		s.pts[i].z++;
	CHECK(stage_set(&f, "b", &s, 0, &info[1], &err));
	assert_true(info[0].bytes == info[1].bytes);
	struct grid_manifest m = manifest_of(info, 2, 1);

	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	struct reader r = reader_open(&f, "m", 1, 0);

	CHECK(grid_scan(r.r, 0, UINT64_MAX, gather_sink, &g, &err));
	assert_int_equal(g.n, 2 * s.n);
	CHECK(grid_sum(r.r, 0, UINT64_MAX, &sum, &err));
	want = info[0].sum;
	digest_add(&want, info[1].sum);
	assert_true(digest_equal(sum, want));
	reader_close(&r);
	free(g.pts);
	free(m.sources);
	set_free(&s);
	folder_remove(&f);
}

/* The box is that of all sources, live or not; an empty dataset has none. */
static void test_box(void **state)
{
	struct set s = set_make(SHAPE_EXTREME, 3000, 1, 3), none = {0};
	struct grid_segment_info info[2];
	struct folder f = folder_new();
	struct err err = ERR_INIT;
	int32_t box[4] = {1, 2, 3, 4}, want[4] = {INT32_MIN, INT32_MIN, INT32_MAX, INT32_MAX};

	CHECK(stage_set(&f, "empty", &none, 0, &info[0], &err));
	CHECK(stage_set(&f, "full", &s, 0, &info[1], &err));
	struct grid_manifest m = manifest_of(info, 1, 1);

	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	struct reader r = reader_open(&f, "m", 0, 0);

	assert_false(grid_box(r.grid, box));
	assert_int_equal(box[0], 1);
	reader_close(&r);
	m.nsegments = 2;
	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	r = reader_open(&f, "m", 0, 0);
	assert_true(grid_box(r.grid, box));
	assert_memory_equal(box, want, sizeof box);
	assert_true(grid_points(r.grid) == 0);
	reader_close(&r);
	free(m.sources);
	set_free(&s);
	folder_remove(&f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_small),       cmocka_unit_test(test_cells), cmocka_unit_test(test_many_sources),
		cmocka_unit_test(test_generations), cmocka_unit_test(test_prune), cmocka_unit_test(test_twins),
		cmocka_unit_test(test_box),
	};

	no_sync();
	return cmocka_run_group_tests_name("grid", tests, NULL, NULL);
}
