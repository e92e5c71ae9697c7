/*
 * Sealing by several workers, and staging in lanes: the segment is the same byte for byte whichever thread does what,
 * for any memory and order; what fits the memory is written once; a failure fails all threads.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "grid_fixture.h"
#include "io.h"
#include "repeat.h"

enum { MIB = 1 << 20, WORKERS_MAX = 8 };

/* ---- a guard ---- */

struct guard {
	pthread_mutex_t mutex;
	pthread_cond_t woken;
};

static void lock(void *g)
{
	pthread_mutex_lock(&((struct guard *)g)->mutex);
}

static void unlock(void *g)
{
	pthread_mutex_unlock(&((struct guard *)g)->mutex);
}

static void wait_for(void *g)
{
	pthread_cond_wait(&((struct guard *)g)->woken, &((struct guard *)g)->mutex);
}

static void wake(void *g)
{
	pthread_cond_broadcast(&((struct guard *)g)->woken);
}

static struct guard guard = {PTHREAD_MUTEX_INITIALIZER, PTHREAD_COND_INITIALIZER};
static const struct grid_guard how = {lock, unlock, wait_for, wake, &guard};

/* ---- workers ---- */

struct work {
	struct grid_stage *stage;
	struct grid_seal *seal;
	const struct set *set;
	atomic_size_t next;
};

struct worker {
	struct work *work;
	pthread_t thread;
	int rc;
};

/* Adds pieces of the set, in any order, all of one source. */
static void *add_pieces(void *arg)
{
	struct worker *w = arg;
	const struct set *s = w->work->set;
	struct err err = ERR_INIT;

	for (;;) {
		size_t at = atomic_fetch_add(&w->work->next, 1000), n = 1000;

		if (at >= s->n || w->rc)
			return NULL;
		n = s->n - at < n ? s->n - at : n;
		w->rc = grid_stage_share(w->work->stage, s->pts + at, n, &err);
	}
}

static void *take_steps(void *arg)
{
	struct worker *w = arg;
	struct err err = ERR_INIT;

	while (!(w->rc = grid_seal_step(w->work->seal, &err)))
		;
	return NULL;
}

static int in_parallel(struct work *work, unsigned n, void *(*run)(void *))
{
	struct worker w[WORKERS_MAX] = {0};
	int rc = 0;

	for (unsigned i = 0; i < n; i++) {
		w[i].work = work;
		assert_int_equal(pthread_create(&w[i].thread, NULL, run, &w[i]), 0);
	}
	for (unsigned i = 0; i < n; i++) {
		pthread_join(w[i].thread, NULL);
		rc = w[i].rc < 0 ? w[i].rc : rc;
	}
	return rc;
}

static int seal(struct grid_stage *stage, unsigned workers, struct grid_segment_info *ret, struct err *err)
{
	struct work work = {.stage = stage};
	int rc = grid_seal_begin(stage, workers, &how, &work.seal, err);

	if (rc)
		return rc;
	assert_in_range(grid_seal_workers(work.seal), 1, workers);
	in_parallel(&work, workers, take_steps);

	uint64_t done, all;

	grid_seal_progress(work.seal, &done, &all);
	rc = grid_seal_finish(work.seal, ret, err);
	assert_true(done <= all && (rc || done == ret->points));
	return rc;
}

/* A run after every `each` records; 0: only when the memory is full. */
static struct grid_stage *staged(const struct folder *f, const char *name, const struct set *s, size_t memory, size_t each)
{
	struct grid_stage_params params = {.dirfd = f->fd, .name = name, .memory = memory, .durable = each > 0};
	struct grid_stage *stage;
	struct err err = ERR_INIT;

	CHECK(grid_stage_new(&params, &stage, &err));
	for (size_t at = 0, n; at < s->n; at += n) {
		for (n = 1; at + n < s->n && n < 777 && s->ids[at + n] == s->ids[at];)
			n++;
		CHECK(grid_stage_source(stage, s->ids[at], &err));
		CHECK(grid_stage_add(stage, s->pts + at, n, &err));
		if (each && at / each != (at + n) / each)
			CHECK(grid_stage_sync(stage, &err));
	}
	return stage;
}

static void same(const struct folder *f, const char *a, const char *b)
{
	static char bytes[2][1 << 16];
	int fd[2] = {openat(f->fd, a, O_RDONLY), openat(f->fd, b, O_RDONLY)};
	ssize_t n, m;

	assert_true(fd[0] >= 0 && fd[1] >= 0);
	do {
		n = read(fd[0], bytes[0], sizeof bytes[0]);
		m = read(fd[1], bytes[1], sizeof bytes[1]);
		assert_int_equal(n, m);
		assert_memory_equal(bytes[0], bytes[1], (size_t)n);
	} while (n > 0);
	close(fd[0]);
	close(fd[1]);
}

/* ---- tests ---- */

static void seal_every_way(const struct set *in, const char *what)
{
	static const struct way {
		size_t memory, each;
		unsigned workers;
	} ways[] = {
		{4 * MIB, 0, 1}, {4 * MIB, 0, 4}, {4 * MIB, 9000, 3}, {4 * MIB, 1500, 2},
		{MIB, 20000, 2}, {MIB, 700, 2},   {64 * MIB, 0, 8},   {16 * MIB, 30000, 8},
	};
	struct set s = {malloc(in->n * sizeof *s.pts), malloc(in->n * sizeof *s.ids), in->n};
	struct folder f = folder_new();
	struct grid_segment_info want, got;
	struct err err = ERR_INIT;

	memcpy(s.pts, in->pts, s.n * sizeof *s.pts);
	memcpy(s.ids, in->ids, s.n * sizeof *s.ids);
	CHECK(stage_set(&f, "want", &s, 0, &want, &err)); /* one slice, in memory: test_grid.c tests that it is correct */
	for (unsigned i = 0; i < sizeof ways / sizeof *ways; i += repeat_step(3)) {
		if (i % 2)
			set_shuffle(&s, i);
		struct grid_stage *stage = staged(&f, "got", &s, ways[i].memory, ways[i].each);

		CHECK(seal(stage, ways[i].workers, &got, &err));
		grid_stage_free(stage);
		assert_int_equal(got.points, s.n);
		assert_memory_equal(&got.sum, &want.sum, sizeof got.sum);
		assert_memory_equal(got.classes, want.classes, sizeof got.classes);
		same(&f, want.file, got.file);
	}
	assert_int_equal(folder_files(&f, ""), 2);
	print_message("%s: %zu points, %llu cells\n", what, s.n, (unsigned long long)want.cells);
	set_free(&s);
	folder_remove(&f);
}

static void test_every_way(void **state)
{
	static const char *const names[SHAPES] = {"uniform", "clustered", "duplicates", "extreme", "one position"};

	for (int shape = 0; shape < SHAPES; shape++) {
		for (unsigned sources = 1; sources <= 300; sources += 299) {
			struct set s = set_make(shape, 150000, sources, 77 + sources);

			seal_every_way(&s, names[shape]);
			set_free(&s);
		}
	}
}

/* Stretches of all kinds: positions with any number of records, around borders of all sizes. */
static struct set make_stretches(uint64_t seed)
{
	uint64_t rng = seed;
	struct set s = {.n = 0};
	size_t cap = 250000;

	s.pts = calloc(cap, sizeof *s.pts);
	s.ids = calloc(cap, sizeof *s.ids);
	while (s.n + 6000 < cap) {
		uint64_t key = random_next(&rng);
		unsigned bits = (unsigned)random_below(&rng, 60);
		size_t n = 1 + (size_t)random_below(&rng, random_below(&rng, 4) ? 60 : 5000);
		bool one = random_below(&rng, 3) == 0;

		switch (random_below(&rng, 5)) {
		case 0:
			key = 0;
			break;
		case 1:
			key = UINT64_MAX;
			break;
		default:
			key = key >> bits << bits;
		}
		for (size_t i = 0; i < n; i++) {
			uint64_t k = one ? key : key ^ random_below(&rng, (uint64_t)1 << bits);
			struct point *p = &s.pts[s.n];

			point_from_morton(k, &p->x, &p->y);
			p->z = (int32_t)random_below(&rng, 3);
			p->cls = (uint8_t)random_below(&rng, 4);
			p->tag = (uint16_t)random_below(&rng, 2);
			s.ids[s.n++] = 1 + (uint32_t)random_below(&rng, 5);
		}
	}
	return s;
}

static void test_stretches(void **state)
{
	for (uint64_t seed = 1; seed <= repeat_cases(4); seed++) {
		struct set s = make_stretches(seed);

		seal_every_way(&s, "made up");
		set_free(&s);
	}
}

static bool is_not_2(void *ctx, uint32_t id)
{
	return id != 2;
}

/* Dropped records leave gaps, so borders of cells are not where runs alone would suggest. */
static void test_dropped(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, 150000, 3, 5), live = set_make(SHAPE_UNIFORM, 150000, 3, 5);
	struct folder f = folder_new();
	struct grid_segment_info want, got;
	struct err err = ERR_INIT;

	live.n = 0;
	for (size_t i = 0; i < s.n; i++) {
		if (s.ids[i] == 2)
			continue;
		live.pts[live.n] = s.pts[i];
		live.ids[live.n++] = s.ids[i];
	}
	CHECK(stage_set(&f, "want", &live, 0, &want, &err));

	struct grid_stage *stage = staged(&f, "got", &s, 4 * MIB, 9000);

	CHECK(grid_stage_keep(stage, is_not_2, NULL, &err));
	CHECK(seal(stage, 3, &got, &err));
	grid_stage_free(stage);
	same(&f, want.file, got.file);
	set_free(&s);
	set_free(&live);
	folder_remove(&f);
}

/* As many runs as can be merged at once, and more, in the smallest sufficient memory. */
static void test_many_runs(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, 150000, 300, 5);
	struct folder f = folder_new();
	struct grid_segment_info want, got;
	struct err err = ERR_INIT;

	CHECK(stage_set(&f, "want", &s, 0, &want, &err));
	for (size_t memory = 4400000; memory < 5000000; memory += 100000) {
		struct grid_stage *stage = staged(&f, "got", &s, memory, 230);

		CHECK(seal(stage, 2, &got, &err));
		grid_stage_free(stage);
		same(&f, want.file, got.file);
	}
	set_free(&s);
	folder_remove(&f);
}

static atomic_size_t written, given_back;

static ssize_t counting_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	ssize_t put = io_system.pwrite(fd, buf, n, off);

	written += put > 0 ? (size_t)put : 0;
	return put;
}

static int counting_punch(int fd, off_t from, off_t n)
{
	given_back += (size_t)n;
	return io_system.punch(fd, from, n);
}

static void in_lanes(const struct folder *f, const struct set *s, unsigned lanes, size_t memory, size_t before, const char *name,
		     struct grid_segment_info *ret)
{
	struct grid_stage_params params = {.dirfd = f->fd, .name = name, .memory = memory};
	struct work work = {.set = s};
	struct err err = ERR_INIT;

	CHECK(grid_stage_new(&params, &work.stage, &err));
	assert_true(grid_stage_lanes(work.stage) >= lanes);
	CHECK(grid_stage_source(work.stage, 4, &err));
	CHECK(grid_stage_add(work.stage, s->pts, before, &err));
	atomic_store(&work.next, before);
	CHECK(grid_stage_split(work.stage, lanes, &how, &err));
	CHECK(in_parallel(&work, lanes, add_pieces));
	CHECK(seal(work.stage, lanes, ret, &err));
	grid_stage_free(work.stage);
}

/* Points added in several lanes, after some that were already there. */
static void test_lanes(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, 400000, 1, 9);
	struct folder f = folder_new();
	struct grid_segment_info want, got;
	struct err err = ERR_INIT;

	for (size_t i = 0; i < s.n; i++)
		s.ids[i] = 4;
	CHECK(stage_set(&f, "want", &s, 0, &want, &err));
	for (unsigned i = 0; i < 8; i++) {
		static const size_t before[] = {0, 1, 20000, 55000, 61000, 100000, 399999, 400000};

		in_lanes(&f, &s, 2 + i % 2, i < 6 ? 2 * MIB : 5 * MIB, before[i], "got", &got);
		same(&f, want.file, got.file);
	}
	set_free(&s);
	folder_remove(&f);
}

/* What fits the stage is written once, as the segment; the rest at most twice. Runs of a stage that is not durable are
 * freed while they are merged. */
static void test_written_once(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, 1000000, 1, 9);
	const struct io_table *before = io;
	struct io_table counting = *io;
	struct folder f = folder_new();
	struct grid_segment_info info;
	double bytes;

	counting.pwrite = counting_pwrite;
	counting.punch = counting_punch;
	io = &counting;
	for (unsigned lanes = 1; lanes <= 4; lanes++) {
		written = given_back = 0;
		in_lanes(&f, &s, lanes, 33 * MIB, 0, "fits", &info);
		bytes = (double)written / (double)s.n;
		print_message("%u lanes, fits: %.2f bytes written a point\n", lanes, bytes);
		assert_true(bytes < 16.7 && given_back == 0);

		written = given_back = 0;
		in_lanes(&f, &s, lanes, 6 * MIB, 0, "spills", &info);
		bytes = (double)written / (double)s.n;
		print_message("%u lanes, spills: %.2f bytes written a point, %.2f given back\n", lanes, bytes,
			      (double)given_back / (double)s.n);
		/* The contents of the lanes at the end depend on timing: everything except what the memory holds is
		 * written twice. */
		assert_true(bytes > 32.5 - 6.0 * MIB / (double)s.n && bytes < 33.2);
		assert_true(lanes > 2 || given_back > 4 * s.n);
	}
	io = before;
	set_free(&s);
	folder_remove(&f);
}

/* ---- failures ---- */

static atomic_long left;

static bool failing(void)
{
	errno = ENOSPC;
	return --left < 0;
}

static ssize_t failing_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	return failing() ? -1 : io_system.pwrite(fd, buf, n, off);
}

static ssize_t failing_pread(int fd, void *buf, size_t n, off_t off)
{
	return failing() ? -1 : io_system.pread(fd, buf, n, off);
}

/* Any call of any worker fails: all stop, none waits forever, nothing is left behind. */
static void test_failures(void **state)
{
	struct set s = set_make(SHAPE_CLUSTERED, 120000, 3, 9);
	const struct io_table *before = io;
	struct io_table table = *io;
	struct folder f = folder_new();
	unsigned long tried = 0;
	int rc = -1;

	table.pwrite = failing_pwrite;
	table.pread = failing_pread;
	for (long n = 0; rc; n += 1 + n / 8, tried++) {
		struct grid_stage *stage = staged(&f, "x", &s, 4 * MIB, 9000);
		size_t fds = open_descriptors();
		struct grid_segment_info info;
		struct err err = ERR_INIT;

		left = n;
		io = &table;
		rc = seal(stage, 3, &info, &err);
		io = before;
		assert_true(!rc || rc == -ERR_NOSPACE);
		assert_int_equal(open_descriptors(), fds);
		grid_stage_free(stage);
		assert_int_equal(folder_files(&f, ""), !rc);
	}
	print_message("%lu failures\n", tried - 1);
	set_free(&s);
	folder_remove(&f);
}

/* A suspended stage stays intact, also if it is not durable: a seal that fails late removes nothing of it. */
static void test_suspended(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, 600000, 1, 9);
	const struct io_table *before = io;
	struct io_table table = *io;
	struct folder f = folder_new();
	struct grid_stage_params params = {.dirfd = f.fd, .name = "got", .memory = 6 * MIB};
	struct grid_stage *stage = staged(&f, "got", &s, params.memory, 0);
	struct grid_segment_info want, got;
	struct err err = ERR_INIT;
	int rc = -1;

	CHECK(stage_set(&f, "want", &s, 0, &want, &err));
	CHECK(grid_stage_suspend(stage, &err));
	table.pwrite = failing_pwrite;
	for (long n = 1; rc; n++) {
		err = ERR_INIT;
		left = n;
		io = &table;
		rc = seal(stage, 1, &got, &err);
		io = before;
		assert_true(!rc || rc == -ERR_NOSPACE);
		if (!rc)
			break;
		grid_stage_detach(stage);
		err = ERR_INIT;
		CHECK(grid_stage_resume(&params, &stage, &err));
	}
	grid_stage_free(stage);
	same(&f, want.file, got.file);
	set_free(&s);
	folder_remove(&f);
}

/* One of several threads that add fails to write: all return the same error. */
static void test_failing_lanes(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, 400000, 1, 9);
	const struct io_table *before = io;
	struct io_table table = *io;
	struct folder f = folder_new();

	table.pwrite = failing_pwrite;
	for (long n = 0; n < 8; n++) {
		struct grid_stage_params params = {.dirfd = f.fd, .name = "x", .memory = 2 * MIB};
		struct work work = {.set = &s};
		struct worker w[2] = {{.work = &work}, {.work = &work}};
		struct err err = ERR_INIT;

		CHECK(grid_stage_new(&params, &work.stage, &err));
		CHECK(grid_stage_source(work.stage, 4, &err));
		CHECK(grid_stage_split(work.stage, 2, &how, &err));
		left = n;
		io = &table;
		for (unsigned i = 0; i < 2; i++)
			assert_int_equal(pthread_create(&w[i].thread, NULL, add_pieces, &w[i]), 0);
		for (unsigned i = 0; i < 2; i++)
			pthread_join(w[i].thread, NULL);
		io = before;
		for (unsigned i = 0; i < 2; i++)
			assert_int_equal(w[i].rc, -ERR_NOSPACE);
		grid_stage_free(work.stage);
		assert_int_equal(folder_files(&f, ""), 0);
	}
	set_free(&s);
	folder_remove(&f);
}

/* A seal that is abandoned. */
static void test_given_up(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, 120000, 3, 9);
	struct folder f = folder_new();
	struct grid_stage *stage = staged(&f, "x", &s, 4 * MIB, 9000);
	size_t fds = open_descriptors();
	struct grid_seal *z;
	struct err err = ERR_INIT;

	CHECK(grid_seal_begin(stage, 2, &how, &z, &err));
	CHECK(grid_seal_step(z, &err));
	assert_null(grid_seal_free(z));
	assert_int_equal(open_descriptors(), fds);
	grid_stage_free(stage);
	assert_int_equal(folder_files(&f, ""), 0);
	set_free(&s);
	folder_remove(&f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_every_way),     cmocka_unit_test(test_stretches),    cmocka_unit_test(test_dropped),
		cmocka_unit_test(test_lanes),         cmocka_unit_test(test_written_once), cmocka_unit_test(test_failures),
		cmocka_unit_test(test_failing_lanes), cmocka_unit_test(test_given_up),     cmocka_unit_test(test_many_runs),
		cmocka_unit_test(test_suspended),
	};

	no_sync();
	return cmocka_run_group_tests_name("grid: seals", tests, NULL, NULL);
}
