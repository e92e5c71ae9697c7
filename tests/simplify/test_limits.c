/*
 * What a simplification refuses, and what it survives: little memory, too few points, cancelling, torn and missing files, a
 * folder that is complete, views without points; and a survey of many blocks and regions of usual size, whose result is that of
 * another order and of interruptions.
 */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "io.h"
#include "simplify_fixture.h"
#include "simplify_priv.h"

static struct view view;

static struct set survey(size_t n, uint32_t side, uint32_t heights)
{
	struct set s = {calloc(n, sizeof *s.pts), calloc(n, sizeof *s.ids), n};

	for (size_t i = 0; i < n; i++) {
		s.pts[i] = (struct point){.x = (int32_t)rnd(side), .y = (int32_t)rnd(side), .cls = 2, .ret = 0x11};
		s.pts[i].z = (int32_t)(((int64_t)s.pts[i].x * s.pts[i].y) >> 9) + (int32_t)rnd(heights);
		s.ids[i] = 1 + (uint32_t)rnd(FIXTURE_SOURCES);
	}
	return s;
}

static struct dataset dataset(size_t n, uint32_t side, uint32_t heights)
{
	struct set s = survey(n, side, heights);
	struct dataset d = dataset_of(&s, 2, NULL);

	set_free(&s);
	view = VIEW_INIT;
	view_bind(&view, &grid_manifest(d.reader.grid)->lattice);
	return d;
}

static struct simplify_params params_of(const struct dataset *d, const struct folder *f)
{
	return (struct simplify_params){.grid = d->reader.grid,
					.view = &view,
					.max_error = 3,
					.memory = simplify_memory_min(d->reader.grid),
					.index_memory = 1 << 16,
					.dirfd = f->fd};
}

static void test_memory(void **state)
{
	struct dataset d = dataset(100, 50, 9);
	struct folder f = folder_new();
	struct simplify_params p = params_of(&d, &f);
	struct err err = ERR_INIT;
	struct simplify *s;

	(void)state;
	p.memory--;
	assert_int_equal(simplify_open(&p, &s, &err), -ERR_LIMIT);
	err_clear(&err);
	p.memory++;
	p.max_error = -1;
	assert_int_equal(simplify_open(&p, &s, &err), -ERR_USAGE);
	folder_remove(&f);
	dataset_end(&d);
}

/* Does the tasks of a step. */
static int tasks(struct simplify *s, void *memory, struct err *err)
{
	int r = 0;

	for (uint32_t i = 0; !r && i < simplify_tasks(s); i++)
		r = simplify_task(s, i, memory, err);
	return r;
}

static void test_too_few(void **state)
{
	struct dataset d = dataset(100, 50, 9);
	struct folder f = folder_new();
	struct simplify_params p = params_of(&d, &f);
	void *memory = aligned_alloc(64, (p.memory + 63) & ~(size_t)63);
	struct err err = ERR_INIT;
	struct simplify *s;
	uint64_t need;

	(void)state;
	p.max_points = 3;
	CHECK(simplify_open(&p, &s, &err));
	CHECK(tasks(s, memory, &err));
	CHECK(simplify_next(s, &err));
	CHECK(tasks(s, memory, &err));
	assert_int_equal(simplify_next(s, &err), -ERR_LIMIT);
	assert_int_equal(err.need, 0); /* more memory would not help */
	assert_int_equal(sscanf(err.hint, "ask for at least %" SCNu64 " points", &need), 1);
	assert_true(need > 3 && need < 40);
	simplify_free(s);
	folder_remove(&f);
	/* That many it can be. */
	struct how how = {.max_points = need};
	struct simplify_report report;

	f = simplify_in_folder(&d, &view, &how, &report);
	assert_int_equal(report.kept, need);
	assert_int_equal(report.hull, need);
	free(memory);
	folder_remove(&f);
	dataset_end(&d);
}

/* An attempt ends in the round whose points are too many, before the next one begins. */
static void test_too_many(void **state)
{
	struct dataset d = dataset(3000, 300, 40);
	struct folder f = folder_new();
	struct simplify_params p = params_of(&d, &f);
	void *memory = aligned_alloc(64, (p.memory + 63) & ~(size_t)63);
	struct err err = ERR_INIT;
	struct simplify *s;
	uint64_t attempts = 0;
	int r;

	(void)state;
	for (p.max_points = 400; p.max_points < 2000; p.max_points += 100) {
		CHECK(simplify_open(&p, &s, &err));
		do {
			s->load = 100;
			s->block = 200;
			CHECK(tasks(s, memory, &err));
			r = simplify_next(s, &err);
			assert_true(s->at.step != SIMPLIFY_CHECK || !s->at.round || s->at.chosen <= p.max_points);
			attempts = s->at.step == SIMPLIFY_CHECK && s->at.attempt > attempts ? s->at.attempt : attempts;
		} while (!r);
		assert_int_equal(r, SIMPLIFY_E_DONE);
		simplify_free(s);
		folder_remove(&f);
		f = folder_new();
		p.dirfd = f.fd;
	}
	assert_true(attempts > 0);
	free(memory);
	folder_remove(&f);
	dataset_end(&d);
}

static int cancel(void *ctx)
{
	return (*(int *)ctx)-- == 0;
}

static void test_cancel(void **state)
{
	struct dataset d = dataset(70000, 3000, 9);
	struct folder f = folder_new();
	struct simplify_params p = params_of(&d, &f);
	void *memory = aligned_alloc(64, (p.memory + 63) & ~(size_t)63);
	int left = 2;
	struct err err = ERR_INIT;
	struct simplify *s;

	(void)state;
	p.progress = cancel;
	p.ctx = &left;
	CHECK(simplify_open(&p, &s, &err));
	assert_int_equal(simplify_task(s, 0, memory, &err), -ERR_CANCELLED);
	assert_false(simplify_task_done(s, 0));
	err_clear(&err);
	left = INT32_MAX;
	CHECK(simplify_task(s, 0, memory, &err));
	assert_true(simplify_task_done(s, 0));
	simplify_free(s);
	free(memory);
	folder_remove(&f);
	dataset_end(&d);
}

/* Also while the points of a round are merged, file by file. */
static void test_cancel_merge(void **state)
{
	struct dataset d = dataset(3000, 300, 40);
	struct folder f = folder_new();
	struct simplify_params p = params_of(&d, &f);
	void *memory = aligned_alloc(64, (p.memory + 63) & ~(size_t)63);
	int left = INT32_MAX;
	struct err err = ERR_INIT;
	struct simplify *s;

	(void)state;
	p.progress = cancel;
	p.ctx = &left;
	CHECK(simplify_open(&p, &s, &err));
	s->load = 100;
	s->block = 200;
	while (s->at.step != SIMPLIFY_CHECK) {
		CHECK(tasks(s, memory, &err));
		CHECK(simplify_next(s, &err));
	}
	CHECK(tasks(s, memory, &err));
	assert_true(simplify_tasks(s) > 3);
	left = 2;
	assert_int_equal(simplify_next(s, &err), -ERR_CANCELLED);
	assert_int_equal(s->at.round, 0);
	err_clear(&err);
	left = INT32_MAX;
	CHECK(simplify_next(s, &err));
	assert_int_equal(s->at.round, 1);
	simplify_free(s);
	free(memory);
	folder_remove(&f);
	dataset_end(&d);
}

/* What a crash of the machine may leave of a file, or a disk. */
enum damage { FLIPPED, EMPTY, GONE, DAMAGES };

static void damage(const struct folder *f, const char *name, enum damage how)
{
	int fd = openat(f->fd, name, O_RDWR);
	char byte;

	assert_true(fd >= 0);
	if (how == FLIPPED) {
		assert_int_equal(pread(fd, &byte, 1, 110), 1);
		byte ^= 1;
		assert_int_equal(pwrite(fd, &byte, 1, 110), 1);
	} else if (how == EMPTY) {
		assert_int_equal(ftruncate(fd, 0), 0);
	} else {
		assert_int_equal(unlinkat(f->fd, name, 0), 0);
	}
	close(fd);
}

/* A damaged file of a task is made again. */
static void check_torn(enum damage how)
{
	struct dataset d = dataset(3000, 300, 40);
	struct folder f = folder_new(), g;
	struct simplify_params p = params_of(&d, &f);
	void *memory = aligned_alloc(64, (p.memory + 63) & ~(size_t)63);
	struct how usual = {.max_error = p.max_error};
	struct simplify_report report;
	struct err err = ERR_INIT;
	struct simplify *s;
	int r;

	CHECK(simplify_open(&p, &s, &err));
	CHECK(tasks(s, memory, &err));
	CHECK(simplify_next(s, &err));
	CHECK(tasks(s, memory, &err));
	damage(&f, "part-0-0-0", how);
	assert_int_equal(simplify_next(s, &err), -ERR_CORRUPT);
	assert_false(simplify_task_done(s, 0));
	err_clear(&err);
	do {
		CHECK(tasks(s, memory, &err));
		r = simplify_next(s, &err);
	} while (!r);
	assert_int_equal(r, SIMPLIFY_E_DONE);
	simplify_free(s);
	g = simplify_in_folder(&d, &view, &usual, &report);
	struct reader a = simplify_reader(&d, &f, SIMPLIFY_MANIFEST), b = simplify_reader(&d, &g, SIMPLIFY_MANIFEST);

	assert_true(digest_equal(grid_content(a.grid), grid_content(b.grid)));
	reader_close(&a);
	reader_close(&b);
	/* It is complete, and stays so. */
	CHECK(simplify_open(&p, &s, &err));
	assert_int_equal(simplify_tasks(s), 0);
	assert_int_equal(simplify_next(s, &err), SIMPLIFY_E_DONE);
	simplify_free(s);
	damage(&f, "report", how);
	assert_int_equal(simplify_open(&p, &s, &err), -ERR_CORRUPT);
	free(memory);
	folder_remove(&f);
	folder_remove(&g);
	dataset_end(&d);
}

/* Begins one with small regions, and does the rounds up to this one; *ret_memory: of tasks. */
static struct simplify *begin_small(const struct simplify_params *p, uint64_t round, void **ret_memory)
{
	struct err err = ERR_INIT;
	struct simplify *s;

	*ret_memory = aligned_alloc(64, (p->memory + 63) & ~(size_t)63);
	CHECK(simplify_open(p, &s, &err));
	s->load = 100;
	s->block = 200;
	while (s->at.step != SIMPLIFY_CHECK || s->at.round < round) {
		CHECK(tasks(s, *ret_memory, &err));
		CHECK(simplify_next(s, &err));
	}
	return s;
}

/* So is one with two files. */
static void check_torn_edge(enum damage how)
{
	struct dataset d = dataset(3000, 300, 40);
	struct folder f = folder_new(), g;
	struct simplify_params p = params_of(&d, &f);
	struct how usual = {.max_error = p.max_error, .load = 100, .block = 200};
	struct simplify_report report;
	struct err err = ERR_INIT;
	void *memory;
	struct simplify *s = begin_small(&p, 0, &memory);
	int r;

	CHECK(tasks(s, memory, &err));
	damage(&f, "edge-0-0-2", how);
	assert_int_equal(simplify_next(s, &err), -ERR_CORRUPT);
	assert_true(simplify_task_done(s, 1));
	assert_false(simplify_task_done(s, 2));
	err_clear(&err);
	do {
		CHECK(tasks(s, memory, &err));
		r = simplify_next(s, &err);
	} while (!r);
	assert_int_equal(r, SIMPLIFY_E_DONE);
	simplify_free(s);
	g = simplify_in_folder(&d, &view, &usual, &report);
	struct reader a = simplify_reader(&d, &f, SIMPLIFY_MANIFEST), b = simplify_reader(&d, &g, SIMPLIFY_MANIFEST);

	assert_true(digest_equal(grid_content(a.grid), grid_content(b.grid)));
	reader_close(&a);
	reader_close(&b);
	free(memory);
	folder_remove(&f);
	folder_remove(&g);
	dataset_end(&d);
}

static void test_torn(void **state)
{
	(void)state;
	for (unsigned how = 0; how < DAMAGES; how++)
		check_torn((enum damage)how);
	for (unsigned how = 0; how < DAMAGES; how++)
		check_torn_edge((enum damage)how);
}

/* A round around stars, and what an earlier version left: neither is continued if its file is not as it should be. */
static void test_stars_continued(void **state)
{
	struct dataset d = dataset(3000, 300, 40);
	struct folder f = folder_new();
	struct simplify_params p = params_of(&d, &f);
	struct err err = ERR_INIT;
	void *memory;
	struct simplify *s = begin_small(&p, 1, &memory);
	int fd;

	(void)state;
	assert_true(s->at.stars > 0);
	simplify_free(s);
	CHECK(simplify_open(&p, &s, &err));
	simplify_free(s);
	damage(&f, "star-0-1-0", FLIPPED);
	assert_int_equal(simplify_open(&p, &s, &err), -ERR_CORRUPT);
	err_clear(&err);
	damage(&f, "star-0-1-0", FLIPPED);
	CHECK(simplify_open(&p, &s, &err));
	simplify_free(s);
	fd = openat(f.fd, "state", O_RDWR);
	assert_int_equal(pwrite(fd, "acut-simplify-state 1", 21, 0), 21);
	close(fd);
	assert_int_equal(simplify_open(&p, &s, &err), -ERR_CORRUPT);
	err_clear(&err);
	free(memory);
	folder_remove(&f);
	dataset_end(&d);
}

/* Files that tasks read in part: damage behind their heads is found when the folder is opened again. */
static void test_continued(void **state)
{
	struct dataset d = dataset(3000, 300, 40);
	struct simplify_params p;
	struct err err = ERR_INIT;

	(void)state;
	for (unsigned steps = 1; steps <= 2; steps++) {
		struct folder f = folder_new();
		void *memory;
		struct simplify *s;

		p = params_of(&d, &f);
		memory = aligned_alloc(64, (p.memory + 63) & ~(size_t)63);
		CHECK(simplify_open(&p, &s, &err));
		for (unsigned i = 0; i < steps; i++) {
			CHECK(tasks(s, memory, &err));
			CHECK(simplify_next(s, &err));
		}
		simplify_free(s);
		CHECK(simplify_open(&p, &s, &err));
		simplify_free(s);
		damage(&f, steps == 1 ? "blocks" : "plan-0-0-0", FLIPPED);
		assert_int_equal(simplify_open(&p, &s, &err), -ERR_CORRUPT);
		err_clear(&err);
		free(memory);
		folder_remove(&f);
	}
	dataset_end(&d);
}

static void test_no_points(void **state)
{
	struct dataset d = dataset(100, 50, 9);
	struct how how = {.max_error = 2};
	struct simplify_report report;
	struct err err = ERR_INIT;
	struct folder f;

	(void)state;
	CHECK(view_set_classes(&view, "9", &err));
	f = simplify_in_folder(&d, &view, &how, &report);
	assert_int_equal(report.points, 0);
	assert_int_equal(report.kept, 0);
	assert_int_equal(report.removed[VIEW_BY_CLASS], 100);
	struct reader r = simplify_reader(&d, &f, SIMPLIFY_MANIFEST);

	assert_int_equal(grid_points(r.grid), 0);
	reader_close(&r);
	folder_remove(&f);
	dataset_end(&d);
}

static void test_key(void **state)
{
	struct dataset d = dataset(100, 50, 9);
	struct digest a = simplify_key(d.reader.grid, &view, 5, 0), b;

	(void)state;
	assert_true(digest_equal(a, simplify_key(d.reader.grid, &view, 5, 0)));
	assert_false(digest_equal(a, simplify_key(d.reader.grid, &view, 6, 0)));
	assert_false(digest_equal(a, simplify_key(d.reader.grid, &view, 5, 5)));
	b = simplify_key(d.reader.grid, &view, 5, 9);
	assert_true(digest_equal(b, simplify_key(d.reader.grid, &view, 0, 9)));
	view.duplicates = VIEW_HIGHEST;
	assert_false(digest_equal(a, simplify_key(d.reader.grid, &view, 5, 0)));
	dataset_end(&d);
}

/* Several blocks, and several regions of 2^17 positions. */
static void test_many(void **state)
{
	struct dataset d = dataset(400000, 1 << 18, 40);
	struct how how = {.max_error = 12, .stop = 20, .shuffle = true}, other = {.max_error = 12, .more = 8 << 20};
	struct simplify_report report, again;
	struct folder f = simplify_in_folder(&d, &view, &how, &report), g = simplify_in_folder(&d, &view, &other, &again);
	struct reader a = simplify_reader(&d, &f, SIMPLIFY_MANIFEST), b = simplify_reader(&d, &g, SIMPLIFY_MANIFEST);

	(void)state;
	assert_true(digest_equal(grid_content(a.grid), grid_content(b.grid)));
	assert_int_equal(report.rounds, again.rounds);
	assert_true(report.kept > 1 << 17 && report.kept < report.points && report.rounds > 1);
	print_message("%llu of %llu points, %llu of them seeds, %llu rounds, in %zu bytes\n", (unsigned long long)report.kept,
		      (unsigned long long)report.points, (unsigned long long)report.seeds, (unsigned long long)report.rounds,
		      simplify_memory_min(d.reader.grid));
	reader_close(&a);
	reader_close(&b);
	folder_remove(&f);
	folder_remove(&g);
	dataset_end(&d);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_memory),    cmocka_unit_test(test_too_few),         cmocka_unit_test(test_too_many),
		cmocka_unit_test(test_cancel),    cmocka_unit_test(test_cancel_merge),    cmocka_unit_test(test_torn),
		cmocka_unit_test(test_continued), cmocka_unit_test(test_no_points),       cmocka_unit_test(test_key),
		cmocka_unit_test(test_many),      cmocka_unit_test(test_stars_continued),
	};

	no_sync();
	rng = 7;
	return cmocka_run_group_tests(tests, NULL, NULL);
}
