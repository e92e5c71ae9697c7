/*
 * Attempts at the tasks of plan and mesh: a repeated one writes the same bytes, of two at once one counts, one that was killed or
 * whose calls fail does no harm; damage is refused by name.
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

static void empty_mesh(const struct run *run)
{
	int fd = openat(work_fd(run->work), WORK_IN_MESH, O_RDONLY | O_DIRECTORY);
	struct err err = ERR_INIT;

	CHECK(io_folder_empty(fd, &err));
	close(fd);
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

/* Processes of their own. */
static pid_t start(const struct run *run, uint32_t task, unsigned killed)
{
	pid_t pid = fork();

	if (pid == 0) {
		struct err err = ERR_INIT;
		struct work *work = run_opened(run, killed);

		_exit(mesh_phase_mesh(work, task, &run->p, &err) != 0);
	}
	assert_true(pid > 0);
	return pid;
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
	work_set_interrupt(run.work, give_up, &left);
	assert_int_equal(mesh_phase_mesh(run.work, 0, &run.p, &err), -ERR_CANCELLED);
	assert_int_equal(files_in_mesh(&run), 0);
	err = ERR_INIT;
	assert_int_equal(work_failure_look(run.work, WORK_MESH, 0, &failure, &err), WORK_E_ABSENT);
	run_remove(&run);
}

/* ---- calls that fail ---- */

static struct io_table *table;
static unsigned calls, fail_at;
static bool reads_fail; /* else the others */

static bool fails(bool reads, int sys)
{
	errno = sys;
	return reads == reads_fail && ++calls == fail_at;
}

static ssize_t fail_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	return fails(false, ENOSPC) ? -1 : io_system.pwrite(fd, buf, n, off);
}

static ssize_t fail_pread(int fd, void *buf, size_t n, off_t off)
{
	return fails(true, EIO) ? -1 : io_system.pread(fd, buf, n, off);
}

static int fail_fsync(int fd)
{
	return fails(false, EIO) ? -1 : 0;
}

static int fail_openat(int dirfd, const char *path, int flags, mode_t mode)
{
	return fails(false, EMFILE) ? -1 : io_system.openat(dirfd, path, flags, mode);
}

static void calls_fail(bool on)
{
	table->pwrite = on ? fail_pwrite : io_system.pwrite;
	table->pread = on ? fail_pread : io_system.pread;
	table->fsync = on ? fail_fsync : no_sync_call;
	table->openat = on ? fail_openat : io_system.openat;
}

static int run_phase(const struct run *run, enum work_phase phase, struct err *err)
{
	return phase == WORK_PLAN ? mesh_phase_plan(run->work, &run->p, err) : mesh_phase_mesh(run->work, 0, &run->p, err);
}

/* A task without a record has left nothing; one with a record, whatever it returned, has made what it should. Forgets it. */
static void check_after(const struct run *run, enum work_phase phase, const struct whole *want)
{
	struct work_record *record = NULL;
	struct err err = ERR_INIT;
	int r = work_record_look(run->work, phase, 0, &record, &err);

	work_record_free(record);
	if (r == WORK_E_ABSENT) {
		assert_int_equal(files_in_mesh(run), 0);
		return;
	}
	CHECK(r);
	if (phase == WORK_PLAN)
		CHECK(mesh_phase_mesh(run->work, 0, &run->p, &err));
	compare(run, want);
	forget(run, WORK_MESH, 0);
	if (phase == WORK_PLAN)
		forget(run, WORK_PLAN, 0);
	empty_mesh(run);
}

/* Whichever call fails, the task fails with no file left and works when it is tried again; or it does not need the call. */
static void fail_calls(const struct run *run, enum work_phase phase, unsigned step, const struct whole *want)
{
	unsigned failed = 0;
	struct err err = ERR_INIT;
	int r = -1;

	for (fail_at = 1; r || calls >= fail_at; fail_at += step) {
		err = ERR_INIT;
		calls = 0;
		calls_fail(true);
		r = run_phase(run, phase, &err);
		calls_fail(false);
		failed += r != 0;
		assert_true(!r || (r < 0 && r != -ERR_INTERNAL && *err.message));
		check_after(run, phase, want);
	}
	assert_true(failed > 3);
	print_message("%s: %u failures\n", work_phase_text(phase), failed);
}

static void test_calls(void **state)
{
	struct err err = ERR_INIT;
	struct whole want;
	struct run run;

	(void)state;
	make_medium(&run, 1);
	whole_make(&run, 100, 20000, &want);
	for (enum work_phase phase = WORK_PLAN; phase <= WORK_MESH; phase++) {
		for (unsigned reads = 0; reads < 2; reads++) {
			reads_fail = reads;
			fail_calls(&run, phase, reads ? 7 * repeat_step(3) : phase == WORK_MESH ? repeat_step(3) : 1, &want);
		}
		CHECK(run_phase(&run, phase, &err));
	}
	compare(&run, &want);
	whole_free(&want);
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
	run.p.view = "ask 1 class=2,3";
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
	/* All of them: the manifest keeps its size, which the record has. */
	for (size_t i = 0; i < m->nsources; i++)
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

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_again),           cmocka_unit_test(test_two_at_once),
		cmocka_unit_test(test_killed),          cmocka_unit_test(test_interrupted),
		cmocka_unit_test(test_calls),           cmocka_unit_test(test_damaged_plan),
		cmocka_unit_test(test_changed_dataset), cmocka_unit_test(test_damaged_segment),
	};

	table = no_sync();
	return cmocka_run_group_tests(tests, run_begin, run_end);
}
