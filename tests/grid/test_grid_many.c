/*
 * Grids of very many segments: the same records as if they were in one, with few descriptors and bounded memory, however the
 * segments lie: beside each other, across each other, all in one place.
 */
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include <cmocka.h>

#include "grid_fixture.h"

enum layout { LAYOUT_TILES, LAYOUT_PARTS, LAYOUT_ACROSS, LAYOUTS };
enum { READER_MOST = 8 << 20, DESCRIPTORS = 129 };

/* The segment of a point: of tiles of the plane, of parts of the order of keys (`i` of n), or any. */
static uint32_t segment_of(enum layout layout, const struct point *p, size_t i, size_t n, unsigned segments, uint64_t *rng)
{
	unsigned side = 1;

	while ((side + 1) * (side + 1) <= segments)
		side++;
	switch (layout) {
	case LAYOUT_TILES:
		return (uint32_t)(((uint64_t)p->x - INT32_MIN) * side >> 32) * side +
		       (uint32_t)(((uint64_t)p->y - INT32_MIN) * side >> 32);
	case LAYOUT_PARTS:
		return (uint32_t)(i * segments / n);
	default:
		return (uint32_t)random_below(rng, segments);
	}
}

struct many {
	struct folder folder;
	struct set sorted;
	struct grid_segment_info *info;
	struct grid_manifest manifest;
};

static struct many many_make(enum layout layout, enum shape shape, size_t n, unsigned segments, uint64_t seed)
{
	struct many m = {.folder = folder_new(), .sorted = set_make(shape, n, 1, seed)};
	uint32_t *segment = malloc(n * sizeof *segment);
	struct point *pts = malloc(n * sizeof *pts);
	uint32_t *ids = malloc(n * sizeof *ids);
	struct err err = ERR_INIT;

	assert_true(segment && pts && ids);
	set_sort(&m.sorted);
	for (size_t i = 0; i < n; i++)
		segment[i] = segment_of(layout, &m.sorted.pts[i], i, n, segments, &seed);
	m.info = calloc(segments, sizeof *m.info);
	for (unsigned s = 0; s < segments; s++) {
		struct set part = {pts, ids, 0};
		char name[16];

		for (size_t i = 0; i < n; i++)
			if (segment[i] == s) {
				pts[part.n] = m.sorted.pts[i];
				ids[part.n++] = m.sorted.ids[i];
			}
		snprintf(name, sizeof name, "s%u", s);
		CHECK(stage_set(&m.folder, name, &part, GRID_STAGE_MIN, &m.info[s], &err));
	}
	m.manifest = manifest_of(m.info, segments, 1);
	CHECK(grid_manifest_write(m.folder.fd, "m", &m.manifest, &err));
	free(segment);
	free(pts);
	free(ids);
	return m;
}

static void many_free(struct many *m)
{
	free(m->manifest.sources);
	free(m->info);
	set_free(&m->sorted);
	folder_remove(&m->folder);
}

static void check_many(enum layout layout, enum shape shape, size_t n, unsigned segments, unsigned ranges, uint64_t seed)
{
	struct many m = many_make(layout, shape, n, segments, seed);
	size_t before = open_descriptors();
	struct reader r = reader_open(&m.folder, "m", 1, 1 << 20);

	/* Segments beside each other take little more than one. */
	assert_true(grid_reader_bytes(r.grid) <= (layout == LAYOUT_ACROSS ? READER_MOST : READER_MOST / 4));
	reader_check(&r, &m.sorted, 0, UINT64_MAX, true);
	for (unsigned i = 0; i < ranges; i++) {
		uint64_t lo, hi;

		random_range(&m.sorted, &seed, &lo, &hi);
		reader_check(&r, &m.sorted, lo, hi, true);
	}
	assert_true(open_descriptors() - before <= DESCRIPTORS);
	reader_close(&r);
	assert_int_equal(open_descriptors(), before);
	many_free(&m);
}

static void test_layouts(void **state)
{
	for (int layout = 0; layout < LAYOUTS; layout++)
		for (int shape = 0; shape < SHAPES; shape++)
			for (unsigned segments = 1; segments <= 12; segments++)
				check_many(layout, shape, 3000 + 400 * segments, segments, 12, 1000 * segments + (unsigned)shape);
}

/* Fewer descriptors than segments. */
static void test_descriptors(void **state)
{
	struct rlimit old, few;

	assert_int_equal(getrlimit(RLIMIT_NOFILE, &old), 0);
	few = old;
	few.rlim_cur = open_descriptors() + DESCRIPTORS + 8;
	assert_int_equal(setrlimit(RLIMIT_NOFILE, &few), 0);
	for (int layout = 0; layout < LAYOUTS; layout++)
		check_many(layout, SHAPE_UNIFORM, 30000, 300, 30, 7 + (unsigned)layout);
	assert_int_equal(setrlimit(RLIMIT_NOFILE, &old), 0);
}

/* So many meet that a cursor has no room for a block: blocks are read several times. */
static void test_small_buffers(void **state)
{
	check_many(LAYOUT_ACROSS, SHAPE_CLUSTERED, 400000, 1200, 3, 5);
}

struct task {
	const struct many *many;
	const struct grid *grid;
	uint64_t seed;
	bool same;
};

static void *read_ranges(void *arg)
{
	struct task *t = arg;
	struct err err = ERR_INIT;
	void *memory = malloc(grid_reader_bytes(t->grid));
	struct grid_reader *r;

	if (!memory || grid_reader_new(t->grid, memory, grid_reader_bytes(t->grid), &r, &err))
		return NULL;
	t->same = true;
	for (int i = 0; t->same && i < 20; i++) {
		struct gather g = {0};
		uint64_t lo, hi;
		size_t first = 0, n = 0;

		random_range(&t->many->sorted, &t->seed, &lo, &hi);
		for (size_t k = 0; k < t->many->sorted.n; k++) {
			uint64_t key = point_morton(t->many->sorted.pts[k].x, t->many->sorted.pts[k].y);

			first += key < lo;
			n += key >= lo && key <= hi;
		}
		t->same = grid_scan(r, lo, hi, gather_sink, &g, &err) == 0 && g.n == n &&
			  (!n || memcmp(g.pts, t->many->sorted.pts + first, n * sizeof *g.pts) == 0);
		free(g.pts);
	}
	grid_reader_free(r);
	free(memory);
	return NULL;
}

/* Readers of several threads open and close the files of each other. */
static void test_threads(void **state)
{
	enum { THREADS = 6 };
	struct many m = many_make(LAYOUT_ACROSS, SHAPE_UNIFORM, 20000, 400, 3);
	struct reader r = reader_open(&m.folder, "m", 1, 1 << 20);
	struct task task[THREADS];
	pthread_t thread[THREADS];

	for (unsigned i = 0; i < THREADS; i++) {
		task[i] = (struct task){&m, r.grid, i + 1, false};
		assert_int_equal(pthread_create(&thread[i], NULL, read_ranges, &task[i]), 0);
	}
	for (unsigned i = 0; i < THREADS; i++) {
		assert_int_equal(pthread_join(thread[i], NULL), 0);
		assert_true(task[i].same);
	}
	reader_close(&r);
	many_free(&m);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_layouts),
		cmocka_unit_test(test_descriptors),
		cmocka_unit_test(test_small_buffers),
		cmocka_unit_test(test_threads),
	};

	no_sync();
	return cmocka_run_group_tests(tests, NULL, NULL);
}
