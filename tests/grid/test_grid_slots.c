/*
 * Slots of sources: scans and cells give each live record with the slot of its source, whatever the segments; the content of a
 * generation says which records have which slot, and neither the numbers of the sources nor the division into segments change it.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "grid_fixture.h"
#include "ledger.h"

enum { SOURCES = 9, POINTS = 20000, GENERATIONS = 3 };

static const struct slots_range ranges[] = {{2, 3, 1}, {5, 5, 31}, {8, 200, 7}};
static const struct slots some = {ranges, 3}, none = {ranges, 0};

static unsigned slot_of(uint32_t source)
{
	return source == 2 || source == 3 ? 1 : source == 5 ? 31 : source >= 8 ? 7 : 0;
}

/* Source 3 is removed by generation 2, source 8 comes with generation 3. */
static bool alive(uint32_t source, uint64_t g)
{
	return !(source == 3 && g >= 2) && !(source == 8 && g < 3);
}

static int by_bytes(const void *a, const void *b)
{
	return memcmp(a, b, sizeof(struct point));
}

static struct grid_manifest write_manifest(const struct folder *f, const char *name, struct grid_segment_info *info, size_t n)
{
	struct grid_manifest m = manifest_of(info, n, SOURCES);
	struct err err = ERR_INIT;

	m.generation = GENERATIONS;
	m.sources[2].removed = 2;
	m.sources[7].added = 3;
	CHECK(grid_manifest_write(f->fd, name, &m, &err));
	return m;
}

static struct reader open_slots(const struct folder *f, const char *name, uint64_t g, const struct slots *slots)
{
	const struct grid_use use = {.slots = slots};
	struct err err = ERR_INIT;
	struct reader r = {0};
	size_t size;

	CHECK(grid_open_use(f->fd, name, g, &use, NULL, 1 << 20, &r.grid, &err));
	size = grid_reader_bytes(r.grid);
	r.memory = aligned_alloc(64, (size + 63) / 64 * 64);
	CHECK(grid_reader_new(r.grid, r.memory, size, &r.r, &err));
	return r;
}

/* What is live, with slots, in any order but the same for all. */
static struct point *expected(const struct set *all, uint64_t g, size_t *ret_n)
{
	struct point *pts = calloc(all->n, sizeof *pts);
	size_t n = 0;

	for (size_t i = 0; i < all->n; i++) {
		if (!alive(all->ids[i], g))
			continue;
		pts[n] = all->pts[i];
		pts[n++].tag |= (uint16_t)(slot_of(all->ids[i]) << POINT_SLOT_SHIFT);
	}
	qsort(pts, n, sizeof *pts, by_bytes);
	*ret_n = n;
	return pts;
}

static void check_gathered(struct gather *got, const struct point *want, size_t n)
{
	assert_int_equal(got->n, n);
	qsort(got->pts, got->n, sizeof *got->pts, by_bytes);
	assert_memory_equal(got->pts, want, n * sizeof *want);
	got->n = 0;
}

struct cells {
	struct reader *r;
	struct gather *to;
};

static int read_cell(void *ctx, const struct grid_cell *cell)
{
	struct cells *c = ctx;
	struct err err = ERR_INIT;

	CHECK(grid_cell_read(c->r->r, cell, gather_sink, c->to, &err));
	return 0;
}

static void check_records(const struct folder *f, const char *name, const struct set *all, uint64_t g)
{
	struct reader r = open_slots(f, name, g, &some);
	struct gather got = {.pts = calloc(all->n, sizeof *got.pts), .cap = all->n};
	struct cells cells = {&r, &got};
	const struct grid_visitor visitor = {.ctx = &cells, .cell = read_cell};
	struct err err = ERR_INIT;
	uint32_t slots = 0;
	struct point *want;
	size_t n;

	want = expected(all, g, &n);
	CHECK(grid_scan(r.r, 0, UINT64_MAX, gather_sink, &got, &err));
	check_gathered(&got, want, n);
	CHECK(grid_walk(r.r, 0, UINT64_MAX, &visitor, &err));
	check_gathered(&got, want, n);
	for (size_t i = 0; i < grid_manifest(r.grid)->nsegments; i++)
		slots |= grid_segment_slots(r.grid, i);
	assert_int_equal(slots, 1u | 1u << 1 | 1u << 31 | 1u << 7);
	free(want);
	free(got.pts);
	reader_close(&r);
}

static struct digest content(const struct folder *f, const char *name, uint64_t g, const struct slots *slots)
{
	struct reader r = open_slots(f, name, g, slots);
	struct digest d = grid_content(r.grid);

	reader_close(&r);
	return d;
}

static bool same(struct digest a, struct digest b)
{
	return digest_equal(a, b);
}

enum { RANGES = 40, WIDE = 39 /* ends in the first range */ };

static uint64_t ends[2 * RANGES + WIDE]; /* of ranges, at records */

static int by_key(const void *a, const void *b)
{
	return *(const uint64_t *)a < *(const uint64_t *)b ? -1 : *(const uint64_t *)a > *(const uint64_t *)b;
}

static void draw_ends(const struct set *all)
{
	uint64_t seed = 5;

	for (unsigned i = 0; i < 2 * RANGES + WIDE; i++) {
		const struct point *p = &all->pts[random_below(&seed, all->n)];

		ends[i] = point_morton(p->x, p->y);
	}
	qsort(ends, 2 * RANGES + WIDE, sizeof *ends, by_key);
	for (unsigned i = 1; i < 2 * RANGES + WIDE; i++)
		ends[i] += ends[i] <= ends[i - 1] ? ends[i - 1] - ends[i] + 1 : 0;
}

/* Of ranges with gaps between them, the first of which has whole cells; returns the sum of everything. */
static struct digest sums(const struct folder *f, const char *name, uint64_t g, const struct slots *slots,
			  struct digest ret[RANGES])
{
	struct reader r = open_slots(f, name, g, slots);
	struct grid_sum range[RANGES];
	struct digest all, whole = {0, 0};
	struct err err = ERR_INIT;

	for (unsigned i = 0; i < RANGES; i++)
		range[i] = (struct grid_sum){.lo = ends[i ? WIDE + 2 * i : 0], .hi = ends[WIDE + 2 * i + 1]};
	CHECK(grid_sums(r.r, range, RANGES, &err));
	CHECK(grid_sum(r.r, 0, UINT64_MAX, &all, &err));
	for (unsigned i = 0; i < RANGES; i++)
		ret[i] = range[i].sum;
	for (size_t i = 0; i < grid_manifest(r.grid)->nsegments; i++)
		digest_add(&whole, grid_segment_content(r.grid, i));
	assert_true(same(whole, all));
	reader_close(&r);
	return all;
}

/* How many sums differ. */
static unsigned differ(const struct digest a[RANGES], const struct digest b[RANGES])
{
	unsigned n = 0;

	for (unsigned i = 0; i < RANGES; i++)
		n += !same(a[i], b[i]);
	return n;
}

static void test_records(void **state)
{
	struct set all = set_make(SHAPE_DUPLICATES, POINTS, SOURCES, 11);
	struct set half = {all.pts, all.ids, all.n / 2}, rest = {all.pts + all.n / 2, all.ids + all.n / 2, all.n - all.n / 2};
	struct grid_segment_info whole, two[2], many[4];
	struct folder f = folder_new();
	struct err err = ERR_INIT;

	CHECK(stage_set(&f, "w", &all, 0, &whole, &err));
	CHECK(stage_set(&f, "a", &half, 0, &two[0], &err));
	CHECK(stage_set(&f, "b", &rest, 0, &two[1], &err));
	stage_sources(&f, &all, 4, many);
	draw_ends(&all);
	free(write_manifest(&f, "whole", &whole, 1).sources);
	free(write_manifest(&f, "two", two, 2).sources);
	free(write_manifest(&f, "many", many, 4).sources);
	for (uint64_t g = 1; g <= GENERATIONS; g++) {
		struct digest is = content(&f, "whole", g, &some), sum[3][RANGES];

		assert_true(same(sums(&f, "whole", g, &some, sum[0]), sums(&f, "two", g, &some, sum[1])));
		assert_int_equal(differ(sum[0], sum[1]), 0);
		sums(&f, "many", g, &some, sum[2]);
		assert_int_equal(differ(sum[0], sum[2]), 0);
		assert_false(same(sums(&f, "whole", g, NULL, sum[1]), sums(&f, "whole", g, &some, sum[0])));
		sums(&f, "many", g, &none, sum[2]);
		assert_int_equal(differ(sum[1], sum[2]), 0);
		assert_true(differ(sum[0], sum[1]) > 3);

		check_records(&f, "whole", &all, g);
		check_records(&f, "two", &all, g);
		check_records(&f, "many", &all, g);
		assert_true(same(content(&f, "two", g, &some), is) && same(content(&f, "many", g, &some), is));
		assert_false(same(content(&f, "whole", g, NULL), is) || same(content(&f, "whole", g, &none), is));
	}
	set_free(&all);
	folder_remove(&f);
}

/* A dataset in which sources have other numbers; then one record is of another slot. */
static void test_content(void **state)
{
	static const uint32_t other[SOURCES] = {6, 9, 8, 7, 4, 1, 5, 2, 3};
	static const struct slots_range moved[] = {{2, 3, 7}, {4, 4, 31}, {8, 9, 1}};
	const struct slots renumbered = {moved, 3};
	struct set all = set_make(SHAPE_UNIFORM, 60000, SOURCES, 12);
	struct grid_segment_info info;
	struct folder f = folder_new();
	struct grid_manifest m = manifest_of(&info, 1, SOURCES);
	struct err err = ERR_INIT;
	struct digest first, sum[2][RANGES];
	size_t at = 0;

	CHECK(stage_set(&f, "a", &all, 0, &info, &err));
	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	first = content(&f, "m", 1, &some);
	draw_ends(&all);
	sums(&f, "m", 1, &some, sum[0]);
	for (size_t i = 0; i < all.n; i++)
		all.ids[i] = other[all.ids[i] - 1];
	CHECK(stage_set(&f, "b", &all, 0, &info, &err));
	CHECK(grid_manifest_write(f.fd, "n", &m, &err));
	assert_true(same(content(&f, "n", 1, &renumbered), first));
	sums(&f, "n", 1, &renumbered, sum[1]);
	assert_int_equal(differ(sum[0], sum[1]), 0);
	assert_false(same(content(&f, "n", 1, &some), first));
	/* In the first range, and in the middle of it. */
	while (point_morton(all.pts[at].x, all.pts[at].y) < ends[WIDE / 3] ||
	       point_morton(all.pts[at].x, all.pts[at].y) > ends[WIDE / 2])
		at++;
	all.ids[at] = all.ids[at] == 4 ? 1 : 4;
	CHECK(stage_set(&f, "c", &all, 0, &info, &err));
	CHECK(grid_manifest_write(f.fd, "o", &m, &err));
	assert_true(same(content(&f, "o", 1, NULL), content(&f, "m", 1, NULL)));
	assert_false(same(content(&f, "o", 1, &renumbered), first));
	sums(&f, "o", 1, &renumbered, sum[1]);
	assert_int_equal(differ(sum[0], sum[1]), 1);
	assert_false(same(sums(&f, "o", 1, &renumbered, sum[1]), sums(&f, "m", 1, &some, sum[0])));
	free(m.sources);
	set_free(&all);
	folder_remove(&f);
}

/* Sources beside each other, so most cells have one; in one segment, and in one each. */
static void test_apart(void **state)
{
	struct set all = set_make(SHAPE_UNIFORM, 60000, 1, 13), part[2];
	struct grid_segment_info whole, two[2];
	struct folder f = folder_new();
	struct err err = ERR_INIT;
	struct digest sum[2][RANGES];
	size_t n = 0;

	qsort(all.pts, all.n, sizeof *all.pts, (int (*)(const void *, const void *))point_compare);
	for (size_t i = 0; i < all.n; i++)
		all.ids[i] = i < all.n / 2 ? 2 : 1;
	n = all.n / 2;
	part[0] = (struct set){all.pts, all.ids, n};
	part[1] = (struct set){all.pts + n, all.ids + n, all.n - n};
	draw_ends(&all);
	CHECK(stage_set(&f, "w", &all, 0, &whole, &err));
	CHECK(stage_set(&f, "a", &part[0], 0, &two[0], &err));
	CHECK(stage_set(&f, "b", &part[1], 0, &two[1], &err));
	free(write_manifest(&f, "whole", &whole, 1).sources);
	free(write_manifest(&f, "two", two, 2).sources);
	assert_true(same(sums(&f, "whole", 1, &some, sum[0]), sums(&f, "two", 1, &some, sum[1])));
	assert_int_equal(differ(sum[0], sum[1]), 0);
	set_free(&all);
	folder_remove(&f);
	(void)state;
}

static void test_table(void **state)
{
	struct slots_list list = {NULL, 0, 0};
	int32_t value[SLOTS_MOST];
	struct slots *s;
	uint32_t twice = 0;
	unsigned n;

	assert_true(slots_list_add(&list, 7, 9, 50) && slots_list_add(&list, 1, 3, 20) && slots_list_add(&list, 4, 4, 20) &&
		    slots_list_add(&list, 5, 6, 0) && slots_list_add(&list, UINT32_MAX, UINT32_MAX, 20) &&
		    slots_list_add(&list, 2, 3, 20));
	assert_int_equal(slots_list_slots(&list, &s, value, &n, &twice), SLOTS_OK);
	assert_true(n == 3 && value[0] == 0 && value[1] == 20 && value[2] == 50);
	assert_int_equal(s->n, 4);
	for (uint32_t i = 0; i < 12; i++)
		assert_int_equal(slots_of(s, i), i < 1 || i > 9 ? 0 : i < 5 ? 2 : i < 7 ? 1 : 3);
	assert_int_equal(slots_of(s, UINT32_MAX), 2);
	slots_free(s);
	assert_true(slots_list_add(&list, 9, 9, 20));
	assert_int_equal(slots_list_slots(&list, &s, value, &n, &twice), SLOTS_TWICE);
	assert_int_equal(twice, 9);
	slots_list_free(&list);
	for (int32_t i = 0; i < SLOTS_MOST; i++)
		assert_true(slots_list_add(&list, 100 - (uint32_t)i, 100 - (uint32_t)i, i));
	assert_int_equal(slots_list_slots(&list, &s, value, &n, &twice), SLOTS_OK);
	assert_int_equal(slots_of(s, 100), 1);
	assert_int_equal(slots_of(s, 70), SLOTS_MOST);
	slots_free(s);
	assert_true(slots_list_add(&list, 1, 1, 99));
	assert_int_equal(slots_list_slots(&list, &s, value, &n, &twice), SLOTS_MANY);
	slots_list_free(&list);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_records), cmocka_unit_test(test_content),
					   cmocka_unit_test(test_apart), cmocka_unit_test(test_table)};

	no_sync();
	return cmocka_run_group_tests(tests, NULL, NULL);
}
