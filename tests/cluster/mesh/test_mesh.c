/*
 * The phases plan and mesh: for any number of tasks and any size of top leaves the packs have together the domains that one
 * process makes, in its order; a repeated attempt writes the same bytes; what an attempt left that ended early does no harm;
 * damage is refused by name.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cmocka.h>

#include "ctl_view.h"
#include "mesh_fixture.h"
#include "no_sync.h"
#include "process.h"
#include "repeat.h"

static const char *const VIEWS[] = {"", "ask 1 class=2,3", "ask 1 duplicates=highest keep-noise",
				    "ask 1 returns=last keep-withheld", "ask 1 class=77"};

/* ---- small sets by the thousand ---- */

static void test_small(void **state)
{
	uint64_t first = repeat_first(), triangles = 0, flat = 0, empty = 0, idle = 0;

	(void)state;
	for (uint64_t i = 0; i < repeat_cases(1000); i++) {
		uint64_t seed = first * 1000003 + i;
		uint32_t tasks = 1 + (uint32_t)random_below(&seed, random_below(&seed, 4) ? 5 : 40),
			 load = 1 + (uint32_t)random_below(&seed, 60), cap = load + 20000;
		struct mesh_plan_about about;
		struct err err = ERR_INIT;
		struct whole want;
		struct run run;

		set_up(&run, small_set(&seed), 1 + (unsigned)random_below(&seed, 3), tasks);
		run.p.view = VIEWS[random_below(&seed, sizeof VIEWS / sizeof *VIEWS)];
		run.p.load = load;
		run.p.cap = cap;
		run.p.top = (uint32_t)random_below(&seed, 400);
		whole_make(&run, load, cap, &want);
		run_all(&run);
		compare(&run, &want);
		CHECK(mesh_plan_about(run.work, &about, &err));
		assert_true(about.load == load && about.cap == cap);
		flat += about.flat;
		empty += !want.n;
		idle += tasks > want.n;
		triangles += want.totals.triangles;
		mesh_plan_about_done(&about);
		whole_free(&want);
		run_remove(&run);
	}
	print_message("%llu triangles, %llu flat, %llu empty, %llu with idle tasks\n", (unsigned long long)triangles,
		      (unsigned long long)flat, (unsigned long long)empty, (unsigned long long)idle);
	assert_true(triangles && flat && empty && idle);
}

/* ---- a larger set, with loads as they are ---- */

static void test_budget(void **state)
{
	static const uint32_t tasks[] = {1, 3, 8};

	(void)state;
	for (unsigned i = 0; i < 3; i++) {
		struct mesh_plan_about about;
		struct err err = ERR_INIT;
		struct whole want;
		struct run run;

		set_up(&run, set_make(i == 1 ? SHAPE_CLUSTERED : SHAPE_UNIFORM, 200000, 5, 3 + i), 2, tasks[i]);
		run.p.memory = i == 2 ? (uint64_t)256 << 20 : mesh_phase_least_bytes() + (2 << 20);
		run_all(&run);
		CHECK(mesh_plan_about(run.work, &about, &err));
		/* With little memory the smallest load; else that of kept domains, however much there is. */
		assert_int_equal(about.load, i == 2 ? PIPE_KEPT_LOAD : pipe_load[0]);
		assert_true(about.cap > pipe_load[i == 2 ? 3 : 0] && about.cap < 2 * pipe_load[i == 2 ? 3 : 0]);
		whole_make(&run, about.load, about.cap, &want);
		compare(&run, &want);
		print_message("%zu domains of %u tasks, load %u\n", want.n, tasks[i], about.load);
		mesh_plan_about_done(&about);
		whole_free(&want);
		run_remove(&run);
	}
}

/* Regions that do not fit with their halos are split in the same way. */
static void test_split(void **state)
{
	(void)state;
	for (uint32_t tasks = 1; tasks < 6; tasks += 2) {
		struct whole want;
		struct run run;

		set_up(&run, set_make(SHAPE_UNIFORM, 150000, 5, tasks), 2, tasks);
		whole_make(&run, 50000, 100000, &want);
		for (size_t i = 0; i < want.n; i++)
			run.p.cap = want.domain[i].vertices > run.p.cap ? (uint32_t)want.domain[i].vertices : run.p.cap;
		run.p.cap += 20; /* less than the halo of the largest */
		run.p.load = 50000;
		whole_free(&want);
		whole_make(&run, run.p.load, run.p.cap, &want);
		assert_true(want.splits);
		run_all(&run);
		compare(&run, &want);
		whole_free(&want);
		run_remove(&run);
	}
}

/* Tasks have about as much to do, and the plan is small. */
static void test_division(void **state)
{
	enum { TASKS = 24, POINTS = 60000 };
	uint64_t all = 0, least = UINT64_MAX, most = 0;
	struct work_record *record = NULL;
	struct err err = ERR_INIT;
	struct run run;

	(void)state;
	set_up(&run, set_make(SHAPE_UNIFORM, POINTS, 5, 8), 1, TASKS);
	run.p.load = 100;
	run.p.cap = 20000;
	run_all(&run);
	for (uint32_t i = 0; i < TASKS; i++) {
		struct mesh_task t;

		CHECK(mesh_task_about(run.work, i, &t, &err));
		all += t.sums.vertices;
		least = t.sums.vertices < least ? t.sums.vertices : least;
		most = t.sums.vertices > most ? t.sums.vertices : most;
	}
	assert_true(least * TASKS * 5 > all * 4 && most * TASKS * 4 < all * 5);
	CHECK(work_record_need(run.work, WORK_PLAN, 0, &record, &err));
	print_message("a plan of %llu bytes for %d tasks\n", (unsigned long long)record->file[0].size, TASKS);
	assert_true(record->file[0].size < 400 + 200 * TASKS);
	work_record_free(record);
	run_remove(&run);
}

/* In processes of their own, because a peak does not fall. */
static void make_large(struct run *run)
{
	set_up(run, set_make(SHAPE_UNIFORM, 600000, 5, 4), 3, 2);
	_exit(0);
}

/* What the ledger counts, and a process that does nothing. */
static void run_large(struct run *run)
{
	const uint64_t before = process_peak_rss();
	struct err err = ERR_INIT;

	if (work_open(run_folder, &run->work, &err))
		_exit(1);
	run->tasks = 2;
	run->p = (struct mesh_phase_params){.view = "ask 1 keep-noise keep-withheld", .memory = 24 << 20};
	run_all(run);
	print_message("peak %.1f MB before, %.1f MB after, of 24 MiB\n", (double)before / 1e6, (double)process_peak_rss() / 1e6);
	_exit(process_peak_rss() - before > run->p.memory + (2 << 20));
}

static int in_process(void (*fn)(struct run *))
{
	pid_t pid = fork();
	struct run run;

	if (pid == 0)
		fn(&run);
	return status_of(pid);
}

static void test_peak(void **state)
{
	struct err err = ERR_INIT;

	(void)state;
	snprintf(run_folder, sizeof run_folder, "%s/work-0", run_top);
	assert_int_equal(in_process(make_large), 0);
	assert_int_equal(in_process(run_large), 0);
	CHECK(io_folder_remove(AT_FDCWD, run_folder, &err));
}

/* Too little memory is refused with what suffices. */
static void test_memory(void **state)
{
	struct err err = ERR_INIT;
	struct run run;

	(void)state;
	set_up(&run, set_make(SHAPE_UNIFORM, 2000, 5, 3), 1, 1);
	run.p.memory = mesh_phase_least_bytes() / 2;
	assert_int_equal(mesh_phase_plan(run.work, &run.p, &err), -ERR_LIMIT);
	assert_non_null(strstr(err.hint, "--task-memory"));
	assert_true(err.need > run.p.memory);
	run.p.memory = err.need;
	err = ERR_INIT;
	CHECK(mesh_phase_plan(run.work, &run.p, &err));
	/* Less memory than the plan was made with. */
	run.p.memory = mesh_phase_least_bytes() / 2;
	assert_int_equal(mesh_phase_mesh(run.work, 0, &run.p, &err), -ERR_LIMIT);
	run_remove(&run);
}

/* A region of points in convex position that needs nearly all of them, however small it is, gets an arena for as many. The
 * domains do not depend on the division, and a task whose memory is too small says what suffices. */
static void test_convex(void **state)
{
	static const uint32_t tasks[] = {1, 1, 3};
	struct whole want, got, first = {0};

	(void)state;
	for (unsigned i = 0; i < 3; i++) {
		struct set set = set_polygon(203);
		struct mesh_sums sums;
		struct err err = ERR_INIT;
		struct run run;

		set_up(&run, set, 2, tasks[i]);
		run.p.load = run.p.cap = 14000;
		run.p.top = 30000;
		run.p.memory = (uint64_t)64 << 20;
		CHECK(mesh_phase_plan(run.work, &run.p, &err));
		if (!i) {
			run.p.memory = 1600 << 10;
			assert_int_equal(mesh_phase_mesh(run.work, 0, &run.p, &err), -ERR_LIMIT);
			print_message("%s (%s)\n", err.message, err.hint);
			assert_non_null(strstr(err.message, "positions needs"));
			assert_true(err.need > run.p.memory && err.need < 2 * run.p.memory);
			run.p.memory = err.need;
			err = ERR_INIT;
		}
		for (uint32_t k = 0; k < tasks[i]; k++)
			CHECK(mesh_phase_mesh(run.work, k, &run.p, &err));
		if (!i)
			whole_make(&run, PIPE_KEPT_LOAD, (uint32_t)set.n + 1, &want);
		whole_gather(&run, &got, &sums);
		print_message("%zu corners, %zu domains\n", set.n, got.n);
		assert_true(got.totals.triangles == set.n - 2 && got.totals.hull == set.n);
		assert_true(digest_equal(got.totals.digest, want.totals.digest));
		assert_true(digest_equal(got.totals.vertex_digest, want.totals.vertex_digest));
		assert_true(digest_equal(sums.digest, want.totals.digest) && sums.domains == got.n &&
			    sums.triangles == set.n - 2);
		if (i == 1) {
			first = got;
		} else {
			if (i == 2)
				whole_same(&got, &first);
			whole_free(&got);
		}
		run_remove(&run);
	}
	whole_free(&first);
	whole_free(&want);
}

/* ---- what is refused ---- */

static void test_views(void **state)
{
	static const struct ctl_view_options no[] = {{.crop = "0,0,1,1"}, {.bbox = "0,0,1,1"}, {.polygon = "x"},
						     {.every = 2},        {.thin = "1"},       {.max_error = "1"},
						     {.max_points = 9},   {.metric = "2,0"},   {.weight = "6=1"}};
	static const char *const request[] = {"ask 1 crop=box:0,0,1,1", "every=3", "ask 1 max-points=5"};
	struct err err = ERR_INIT;
	struct run run;

	(void)state;
	CHECK(mesh_phase_check(&(struct ctl_view_options){.ground = true, .classes = "2", .every = 1, .keep_noise = true}, &err));
	for (size_t i = 0; i < sizeof no / sizeof *no; i++) {
		err = ERR_INIT;
		assert_int_equal(mesh_phase_check(&no[i], &err), -ERR_UNSUPPORTED);
		assert_non_null(strstr(err.message, "with --"));
	}
	set_up(&run, set_make(SHAPE_UNIFORM, 500, 5, 1), 1, 1);
	for (size_t i = 0; i < 3; i++) {
		err = ERR_INIT;
		run.p.view = request[i];
		assert_true(mesh_phase_plan(run.work, &run.p, &err) < 0);
		assert_int_equal(err.code, i == 1 ? ERR_PROTO : ERR_UNSUPPORTED);
	}
	run_remove(&run);
}

static void test_without_ground(void **state)
{
	struct err err = ERR_INIT;
	struct run run;
	struct set s = set_make(SHAPE_UNIFORM, 500, 5, 1);

	(void)state;
	for (size_t i = 0; i < s.n; i++) {
		s.pts[i].cls = 5;
		s.pts[i].tag &= (uint16_t)~POINT_KEY;
	}
	set_up(&run, s, 1, 2);
	run.p.view = "ask 1 ground";
	assert_int_equal(mesh_phase_plan(run.work, &run.p, &err), -ERR_INPUT);
	assert_non_null(strstr(err.message, "no ground points"));
	run_remove(&run);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_peak), /* first, while this process is small */
		cmocka_unit_test(test_small),          cmocka_unit_test(test_budget), cmocka_unit_test(test_split),
		cmocka_unit_test(test_division),       cmocka_unit_test(test_memory), cmocka_unit_test(test_views),
		cmocka_unit_test(test_without_ground), cmocka_unit_test(test_convex),
	};

	no_sync();
	return cmocka_run_group_tests(tests, run_begin, run_end);
}
