/* Several threads read one grid at the same time, through a cache of two pages; also run under the thread sanitizer. */
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "grid_fixture.h"

enum { THREADS = 4, ROUNDS = 150, POINTS = 400000 };

struct job {
	const struct grid *grid;
	const struct set *sorted;
	uint64_t seed;
	size_t wrong;
};

/* Position in the sorted set, advanced as pieces come. */
struct follow {
	const struct point *next;
	size_t n;
	bool differ;
};

static int follow_sink(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct follow *f = ctx;

	f->differ = f->differ || n > f->n || memcmp(pts, f->next, n * sizeof *pts);
	if (f->differ)
		return 1;
	f->next += n;
	f->n -= n;
	return 0;
}

static void *work(void *ctx)
{
	struct job *j = ctx;
	size_t size = grid_reader_bytes(j->grid);
	void *memory = malloc(size);
	struct err err = ERR_INIT;
	struct grid_reader *r;

	if (grid_reader_new(j->grid, memory, size, &r, &err))
		j->wrong++;
	for (int i = 0; i < ROUNDS && !j->wrong; i++) {
		size_t a = random_below(&j->seed, j->sorted->n), b = a + random_below(&j->seed, 3000);
		const struct point *p = j->sorted->pts;

		b = b < j->sorted->n ? b : j->sorted->n - 1;
		uint64_t lo = point_morton(p[a].x, p[a].y), hi = point_morton(p[b].x, p[b].y), count;
		bool exact;

		while (a && point_morton(p[a - 1].x, p[a - 1].y) == lo)
			a--;
		while (b + 1 < j->sorted->n && point_morton(p[b + 1].x, p[b + 1].y) == hi)
			b++;
		struct follow f = {p + a, b - a + 1, false};

		j->wrong += grid_scan(r, lo, hi, follow_sink, &f, &err) || f.n;
		j->wrong += grid_count(r, lo, hi, &count, &exact, &err) || !exact || count != b - a + 1;
	}
	grid_reader_free(r);
	free(memory);
	return NULL;
}

static void test_threads(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, POINTS, 2, 3);
	struct set half = {s.pts, s.ids, POINTS / 2}, rest = {s.pts + POINTS / 2, s.ids + POINTS / 2, POINTS / 2};
	struct grid_segment_info info[2];
	struct folder f = folder_new();
	struct err err = ERR_INIT;
	pthread_t thread[THREADS];
	struct job job[THREADS];

	CHECK(stage_set(&f, "a", &half, 0, &info[0], &err));
	CHECK(stage_set(&f, "b", &rest, 0, &info[1], &err));
	struct grid_manifest m = manifest_of(info, 2, 2);

	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	struct reader r = reader_open(&f, "m", 1, 2 * 16600);

	set_sort(&s);
	for (unsigned i = 0; i < THREADS; i++) {
		job[i] = (struct job){r.grid, &s, i, 0};
		assert_int_equal(pthread_create(&thread[i], NULL, work, &job[i]), 0);
	}
	for (unsigned i = 0; i < THREADS; i++) {
		pthread_join(thread[i], NULL);
		assert_int_equal(job[i].wrong, 0);
	}
	reader_close(&r);
	free(m.sources);
	set_free(&s);
	folder_remove(&f);
}

/* Pages that a new reader of the same grid reads from the disk for a full scan. */
static uint64_t misses_of_another(struct reader *r)
{
	struct err err = ERR_INIT;
	struct gather g = {0};

	grid_reader_free(r->r);
	CHECK(grid_reader_new(r->grid, r->memory, grid_reader_bytes(r->grid), &r->r, &err));
	CHECK(grid_scan(r->r, 0, UINT64_MAX, gather_sink, &g, &err));
	free(g.pts);
	return grid_reader_stats(r->r).misses;
}

/* Cached pages are not read again. */
static void test_cache(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, POINTS, 1, 3);
	struct grid_segment_info info;
	struct folder f = folder_new();
	struct err err = ERR_INIT;
	struct gather g = {0};

	CHECK(stage_set(&f, "a", &s, 0, &info, &err));
	struct grid_manifest m = manifest_of(&info, 1, 1);

	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	struct reader r = reader_open(&f, "m", 1, 1 << 20), none = reader_open(&f, "m", 1, 0);

	CHECK(grid_scan(r.r, 0, UINT64_MAX, gather_sink, &g, &err));
	struct grid_reader_stats a = grid_reader_stats(r.r);

	assert_true(a.records == POINTS && a.cells == info.cells && a.bytes > 16 * POINTS && a.bytes < info.bytes);
	assert_true(a.misses < 10 && a.misses < a.pages);
	g.n = 0;
	CHECK(grid_scan(r.r, 0, UINT64_MAX, gather_sink, &g, &err));
	assert_true(grid_reader_stats(r.r).misses == a.misses);
	g.n = 0;
	CHECK(grid_scan(none.r, 0, UINT64_MAX, gather_sink, &g, &err));
	struct grid_reader_stats b = grid_reader_stats(none.r);

	/* Pages that a reader holds are not fetched; pages that neither it nor the cache has are read. */
	assert_true(b.pages == a.pages && b.misses == a.misses);
	assert_int_equal(misses_of_another(&r), 0);
	assert_int_equal(misses_of_another(&none), b.misses);
	reader_close(&none);
	reader_close(&r);
	free(g.pts);
	free(m.sources);
	set_free(&s);
	folder_remove(&f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_threads), cmocka_unit_test(test_cache)};

	no_sync();
	return cmocka_run_group_tests_name("grid: threads", tests, NULL, NULL);
}
