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
#include "repeat.h"

static char top[64], folder[128];

static void set_up(struct run *run, struct set set, unsigned segments, uint32_t tasks)
{
	static unsigned n;

	snprintf(folder, sizeof folder, "%s/work-%u", top, n++);
	run_make(run, folder, set, segments, tasks);
}

static void run_all(const struct run *run)
{
	struct err err = ERR_INIT;

	CHECK(mesh_phase_plan(run->work, &run->p, &err));
	for (uint32_t i = 0; i < run->tasks; i++)
		CHECK(mesh_phase_mesh(run->work, run->tasks - 1 - i, &run->p, &err)); /* in any order */
}

/* The packs against one process, and the records against both. */
static void compare(const struct run *run, const struct whole *want)
{
	struct mesh_sums sums;
	struct whole got;

	whole_gather(run, &got, &sums);
	whole_same(&got, want);
	assert_true(sums.domains == want->n && sums.triangles == want->totals.triangles);
	if (want->n) {
		assert_true(sums.vertices == want->totals.vertices && sums.hull == want->totals.hull);
		assert_true(digest_equal(sums.digest, want->totals.digest));
		assert_true(digest_equal(sums.vertex_digest, want->totals.vertex_digest));
		assert_true(sums.counts.points == want->totals.counts.points &&
			    sums.counts.most.points == want->totals.counts.most.points);
		assert_memory_equal(sums.counts.removed, want->totals.counts.removed, sizeof sums.counts.removed);
	}
	whole_free(&got);
}

static const char *const VIEWS[] = {"", "ask 1 class=2,3", "ask 1 duplicates=highest keep-noise",
				    "ask 1 returns=last keep-withheld", "ask 1 class=77"};

/* ---- small sets by the thousand ---- */

/* On few places, lines and grids, or anywhere. */
static struct set small_set(uint64_t *seed)
{
	enum { SHAPE_LINE = SHAPES, SHAPE_FEW, SHAPE_GRID, SHAPE_CONVEX, ALL };
	unsigned shape = (unsigned)random_below(seed, ALL);
	size_t n = (size_t)random_below(seed, random_below(seed, 4) ? 300 : 8);
	struct set s;

	if (!n)
		n = 1;
	s = set_make(shape < SHAPES ? (enum shape)shape : SHAPE_UNIFORM, n, 5, random_next(seed));
	for (size_t i = 0; i < n && shape >= SHAPES; i++) {
		int32_t at = (int32_t)random_below(seed, 500);
		struct point *p = &s.pts[i];

		p->x = shape == SHAPE_LINE ? 3 * at : shape == SHAPE_CONVEX ? at : (int32_t)random_below(seed, 9);
		p->y = shape == SHAPE_LINE   ? 2 * at - 700 :
		       shape == SHAPE_CONVEX ? at * at :
		       shape == SHAPE_FEW    ? (int32_t)random_below(seed, 2) :
					       (int32_t)random_below(seed, 9);
	}
	return s;
}

static void test_small(void **state)
{
	uint64_t first = repeat_first(), triangles = 0, flat = 0, empty = 0, idle = 0;

	(void)state;
	for (uint64_t i = 0; i < repeat_cases(1500); i++) {
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
		char name[WORK_NAME];
		struct mesh_sums sums;
		uint64_t bytes;

		CHECK(mesh_task_about(run.work, i, &sums, name, &bytes, &err));
		all += sums.vertices;
		least = sums.vertices < least ? sums.vertices : least;
		most = sums.vertices > most ? sums.vertices : most;
	}
	assert_true(least * TASKS * 5 > all * 4 && most * TASKS * 4 < all * 5);
	CHECK(work_record_need(run.work, WORK_PLAN, 0, &record, &err));
	print_message("a plan of %llu bytes for %d tasks\n", (unsigned long long)record->file[0].size, TASKS);
	assert_true(record->file[0].size < 400 + 200 * TASKS);
	work_record_free(record);
	run_remove(&run);
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

/* ---- attempts ---- */

static void make_medium(struct run *run, uint32_t tasks)
{
	set_up(run, set_make(SHAPE_UNIFORM, 4000, 5, 11), 2, tasks);
	run->p.load = 100;
	run->p.cap = 20000;
}

static uint8_t *bytes_of(const struct run *run, const char *name, size_t *ret_n)
{
	int fd = openat(work_fd(run->work), name, O_RDONLY);
	struct stat st;
	uint8_t *all;

	assert_true(fd >= 0 && !fstat(fd, &st));
	all = malloc((size_t)st.st_size);
	assert_int_equal(read(fd, all, (size_t)st.st_size), st.st_size);
	close(fd);
	*ret_n = (size_t)st.st_size;
	return all;
}

/* The file that the record of a task names. */
static uint8_t *result_of(const struct run *run, enum work_phase phase, uint32_t task, size_t *ret_n)
{
	struct work_record *record = NULL;
	struct err err = ERR_INIT;
	uint8_t *all;

	CHECK(work_record_need(run->work, phase, task, &record, &err));
	assert_int_equal(record->nfile, 1);
	all = bytes_of(run, record->file[0].name, ret_n);
	work_record_free(record);
	return all;
}

static void forget(const struct run *run, enum work_phase phase, uint32_t task)
{
	char name[64];

	snprintf(name, sizeof name, "done/%s-%u", work_phase_text(phase), task);
	assert_int_equal(unlinkat(work_fd(run->work), name, 0), 0);
}

static unsigned files_in_mesh(const struct run *run)
{
	char path[160];
	DIR *d;
	unsigned n = 0;

	snprintf(path, sizeof path, "%s/%s", run->folder, WORK_IN_MESH);
	d = opendir(path);
	assert_non_null(d);
	for (struct dirent *e; (e = readdir(d));)
		n += e->d_name[0] != '.';
	closedir(d);
	return n;
}

static void test_again(void **state)
{
	struct err err = ERR_INIT;
	struct run run;

	(void)state;
	make_medium(&run, 3);
	run_all(&run);
	for (unsigned i = 0; i < 4; i++) {
		enum work_phase phase = i == 3 ? WORK_PLAN : WORK_MESH;
		size_t n[2];
		uint8_t *all[2];

		for (unsigned again = 0; again < 2; again++) {
			all[again] = result_of(&run, phase, i % 3, &n[again]);
			if (again)
				break;
			forget(&run, phase, i % 3);
			CHECK(phase == WORK_PLAN ? mesh_phase_plan(run.work, &run.p, &err) :
						   mesh_phase_mesh(run.work, i % 3, &run.p, &err));
		}
		assert_int_equal(n[0], n[1]);
		assert_memory_equal(all[0], all[1], n[0]);
		free(all[0]);
		free(all[1]);
	}
	/* A task that is done does nothing. */
	assert_int_equal(files_in_mesh(&run), 6);
	CHECK(mesh_phase_mesh(run.work, 1, &run.p, &err));
	assert_int_equal(files_in_mesh(&run), 6);
	run_remove(&run);
}

/* Processes of their own, each with the work folder opened anew. `kill_at`: raises SIGKILL when asked so often; 0: never. */
static unsigned asked, kill_at;

static int interrupted(void *ctx)
{
	(void)ctx;
	if (kill_at && ++asked == kill_at)
		raise(SIGKILL);
	return 0;
}

static pid_t start(const struct run *run, uint32_t task, unsigned killed)
{
	pid_t pid = fork();

	if (pid == 0) {
		struct mesh_phase_params p = run->p;
		struct err err = ERR_INIT;
		struct work *work = NULL;

		p.interrupted = interrupted;
		kill_at = killed;
		if (work_open(run->folder, &work, &err) || mesh_phase_mesh(work, task, &p, &err))
			_exit(1);
		_exit(0);
	}
	assert_true(pid > 0);
	return pid;
}

static int status_of(pid_t pid)
{
	int status;

	assert_int_equal(waitpid(pid, &status, 0), pid);
	return status;
}

static void test_two_at_once(void **state)
{
	struct err err = ERR_INIT;
	struct whole want;
	struct run run;

	(void)state;
	make_medium(&run, 2);
	whole_make(&run, 100, 20000, &want);
	CHECK(mesh_phase_plan(run.work, &run.p, &err));
	for (unsigned i = 0; i < 10; i++) {
		pid_t pid[2];

		for (uint32_t task = 0; task < 2; task++) {
			for (unsigned k = 0; k < 2; k++)
				pid[k] = start(&run, task, 0);
			for (unsigned k = 0; k < 2; k++)
				assert_int_equal(status_of(pid[k]), 0);
		}
		compare(&run, &want);
		assert_int_equal(files_in_mesh(&run), 2 + 2 * i); /* the loser's are gone */
		for (uint32_t task = 0; task < 2; task++)
			forget(&run, WORK_MESH, task);
	}
	whole_free(&want);
	run_remove(&run);
}

static void test_killed(void **state)
{
	struct err err = ERR_INIT;
	struct whole want;
	struct run run;

	(void)state;
	make_medium(&run, 2);
	whole_make(&run, 100, 20000, &want);
	CHECK(mesh_phase_plan(run.work, &run.p, &err));
	for (unsigned at = 1; at < 30; at += 7) {
		int status = status_of(start(&run, 0, at));
		struct work_record *record = NULL;

		assert_true(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
		assert_int_equal(work_record_look(run.work, WORK_MESH, 0, &record, &err), WORK_E_ABSENT);
	}
	for (uint32_t task = 0; task < 2; task++)
		CHECK(mesh_phase_mesh(run.work, task, &run.p, &err));
	compare(&run, &want);
	whole_free(&want);
	run_remove(&run);
}

static int give_up(void *ctx)
{
	unsigned *left = ctx;

	return --*left == 0;
}

static void test_interrupted(void **state)
{
	struct err err = ERR_INIT;
	struct work_failure failure;
	unsigned left = 5;
	struct run run;

	(void)state;
	make_medium(&run, 1);
	CHECK(mesh_phase_plan(run.work, &run.p, &err));
	run.p.interrupted = give_up;
	run.p.ctx = &left;
	assert_int_equal(mesh_phase_mesh(run.work, 0, &run.p, &err), -ERR_CANCELLED);
	assert_int_equal(files_in_mesh(&run), 0);
	err = ERR_INIT;
	assert_int_equal(work_failure_look(run.work, WORK_MESH, 0, &failure, &err), WORK_E_ABSENT);
	run_remove(&run);
}

/* ---- damage ---- */

static void change_byte(const struct run *run, const char *name, size_t at, uint8_t by)
{
	int fd = openat(work_fd(run->work), name, O_RDWR);
	uint8_t byte;

	assert_true(fd >= 0);
	assert_int_equal(pread(fd, &byte, 1, (off_t)at), 1);
	byte ^= by;
	assert_int_equal(pwrite(fd, &byte, 1, (off_t)at), 1);
	close(fd);
}

/* Each byte of the plan: some task refuses it, by its name, unless it is one that nobody needs. */
static void test_damaged_plan(void **state)
{
	struct work_record *record = NULL;
	struct err err = ERR_INIT;
	struct run run;
	size_t size;

	(void)state;
	make_medium(&run, 3);
	run.p.view = VIEWS[1];
	run.p.top = 500;
	run_all(&run);
	CHECK(work_record_need(run.work, WORK_PLAN, 0, &record, &err));
	size = record->file[0].size;
	for (size_t at = 0; at < size; at += repeat_step(3)) {
		unsigned refused = 0;

		change_byte(&run, record->file[0].name, at, (uint8_t)(1 << at % 8));
		for (uint32_t task = 0; task < 3; task++) {
			int r;

			err = ERR_INIT;
			forget(&run, WORK_MESH, task);
			r = mesh_phase_mesh(run.work, task, &run.p, &err);
			refused += r != 0;
			if (!r)
				continue;
			assert_true(r == -ERR_CORRUPT || r == -ERR_VERSION);
			assert_string_equal(err.file, record->file[0].name);
			change_byte(&run, record->file[0].name, at, (uint8_t)(1 << at % 8));
			err = ERR_INIT;
			CHECK(mesh_phase_mesh(run.work, task, &run.p, &err));
			change_byte(&run, record->file[0].name, at, (uint8_t)(1 << at % 8));
		}
		change_byte(&run, record->file[0].name, at, (uint8_t)(1 << at % 8));
		assert_true(refused);
		if (size > 600 && at > 400)
			at += 5;
	}
	work_record_free(record);
	run_remove(&run);
}

/* Another dataset than the planned one. */
static void test_changed_dataset(void **state)
{
	struct grid_manifest *m = NULL;
	struct err err = ERR_INIT;
	struct run run;
	int fd;

	(void)state;
	make_medium(&run, 1);
	CHECK(mesh_phase_plan(run.work, &run.p, &err));
	fd = openat(work_fd(run.work), WORK_IN_DATASET, O_RDONLY | O_DIRECTORY);
	CHECK(grid_manifest_read(fd, "manifest", &m, &err));
	for (size_t i = 0; i < m->nsources; i++)
		if (m->sources[i].id % 2)
			m->sources[i].added = m->sources[i].removed = 1;
	CHECK(grid_manifest_write(fd, "manifest", m, &err));
	close(fd);
	grid_manifest_free(m);
	assert_int_equal(mesh_phase_mesh(run.work, 0, &run.p, &err), -ERR_CHANGED);
	assert_non_null(strstr(err.message, "not the one that was planned"));
	assert_int_equal(files_in_mesh(&run), 0);
	run_remove(&run);
}

static void test_damaged_segment(void **state)
{
	struct work_failure failure;
	struct err err = ERR_INIT;
	struct run run;

	(void)state;
	make_medium(&run, 1);
	CHECK(mesh_phase_plan(run.work, &run.p, &err));
	change_byte(&run, WORK_IN_DATASET "/s0.seg", 20000, 4);
	assert_int_equal(mesh_phase_mesh(run.work, 0, &run.p, &err), -ERR_CORRUPT);
	assert_non_null(strstr(err.file, "s0.seg"));
	assert_int_equal(files_in_mesh(&run), 0);
	CHECK(work_failure_look(run.work, WORK_MESH, 0, &failure, &err));
	assert_non_null(strstr(failure.message, "s0.seg"));
	run_remove(&run);
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
	make_medium(&run, 1);
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

static int setup(void **state)
{
	(void)state;
	no_sync();
	repeat_folder(top, sizeof top, "cmesh");
	return 0;
}

static int teardown(void **state)
{
	(void)state;
	return repeat_remove(top);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_small),           cmocka_unit_test(test_budget),
		cmocka_unit_test(test_split),           cmocka_unit_test(test_division),
		cmocka_unit_test(test_memory),          cmocka_unit_test(test_again),
		cmocka_unit_test(test_two_at_once),     cmocka_unit_test(test_killed),
		cmocka_unit_test(test_interrupted),     cmocka_unit_test(test_damaged_plan),
		cmocka_unit_test(test_changed_dataset), cmocka_unit_test(test_damaged_segment),
		cmocka_unit_test(test_views),           cmocka_unit_test(test_without_ground),
	};

	return cmocka_run_group_tests(tests, setup, teardown);
}
