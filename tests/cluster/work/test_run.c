/* A task from beginning to end (work_run): what it returns, and what is left of an attempt that fails, is cancelled, or loses. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "err.h"
#include "io.h"
#include "work.h"

static char top[64], folder[128];
static struct work *work;

static int setup(void **state)
{
	static const char *const words[] = {"mesh"};
	static const struct work_input input = {"/data/one.laz", 17, 1};
	struct work_about about = {.id = 1, .memory = 64 << 20, .tasks[WORK_STAGE] = 1, .word = words, .nword = 1};
	struct err err = ERR_INIT;

	(void)state;
	strcpy(top, "/tmp/acut-work-XXXXXX");
	assert_non_null(mkdtemp(top));
	snprintf(folder, sizeof folder, "%s/work", top);
	assert_int_equal(work_make(folder, &about, &input, 1, &work, &err), 0);
	work_set_patience(work, 0);
	return 0;
}

static int teardown(void **state)
{
	struct err err = ERR_INIT;

	(void)state;
	work = work_close(work);
	return io_folder_remove(AT_FDCWD, top, &err);
}

struct task {
	int result;     /* of the attempt */
	bool overtaken; /* another attempt does the task meanwhile */
	unsigned calls;
	char file[WORK_NAME];
};

static int make(void *ctx, struct work_attempt *a, uint32_t task, struct err *err)
{
	struct task *t = ctx;
	struct task other = {0};
	int fd;

	assert_int_equal(task, 0);
	t->calls++;
	assert_int_equal(work_attempt_file(a, "", "x", "", t->file, err), 0);
	fd = openat(work_fd(work), t->file, O_WRONLY | O_CREAT | O_EXCL, 0666);
	assert_true(fd >= 0);
	close(fd);
	assert_int_equal(work_result_file(a, t->file, err), 0);
	if (t->overtaken)
		assert_int_equal(work_run(work, WORK_STAGE, 0, make, &other, err), 0);
	return t->result ? err_set(err, (enum err_code) - t->result, "the disk is full") : 0;
}

static bool is_there(const struct task *t)
{
	return faccessat(work_fd(work), t->file, F_OK, 0) == 0;
}

static unsigned failures(void)
{
	struct work_failure f;
	struct err err = ERR_INIT;

	return work_failure_look(work, WORK_STAGE, 0, &f, &err) ? 0 : f.times;
}

static void a_task_is_done_once(void **state)
{
	struct task t = {0}, again = {0};
	struct err err = ERR_INIT;

	(void)state;
	assert_int_equal(work_run(work, WORK_STAGE, 0, make, &t, &err), 0);
	assert_true(is_there(&t));
	assert_int_equal(work_run(work, WORK_STAGE, 0, make, &again, &err), WORK_E_DONE);
	assert_int_equal(again.calls, 0);
	assert_int_equal(work_run(work, WORK_STAGE, 1, make, &again, &err), -ERR_USAGE);
}

static void a_failure_is_recorded_and_leaves_no_file(void **state)
{
	struct task t = {.result = -ERR_NOSPACE}, cancelled = {.result = -ERR_CANCELLED};
	struct err err = ERR_INIT;

	(void)state;
	assert_int_equal(work_run(work, WORK_STAGE, 0, make, &t, &err), -ERR_NOSPACE);
	assert_string_equal(err.message, "the disk is full");
	assert_false(is_there(&t));
	assert_int_equal(failures(), 1);
	err_clear(&err);
	assert_int_equal(work_run(work, WORK_STAGE, 0, make, &cancelled, &err), -ERR_CANCELLED);
	assert_false(is_there(&cancelled));
	assert_int_equal(failures(), 1);
}

static int always(void *ctx)
{
	return 1;
}

/* Told to end while it waits for a file, it does not wait for the rest of its patience, and has not failed. */
static void a_task_that_waits_is_interrupted(void **state)
{
	struct task t = {.result = -ERR_NOTFOUND};
	struct err err = ERR_INIT;
	double waited = 0;

	work_set_patience(work, 1000);
	work_set_interrupt(work, always, NULL);
	assert_false(work_wait(work, &waited));
	assert_int_equal(work_run(work, WORK_STAGE, 0, make, &t, &err), -ERR_CANCELLED);
	assert_non_null(strstr(err.message, "interrupted"));
	assert_false(is_there(&t));
	assert_int_equal(failures(), 0);
}

static void who_is_overtaken_has_not_failed(void **state)
{
	static const int results[] = {0, -ERR_NOSPACE, -ERR_CANCELLED};

	for (size_t i = 0; i < sizeof results / sizeof *results; i++) {
		struct task t = {.result = results[i], .overtaken = true};
		struct err err = ERR_INIT;

		assert_int_equal(work_run(work, WORK_STAGE, 0, make, &t, &err), WORK_E_LOST);
		assert_int_equal(err.code, 0);
		assert_false(is_there(&t));
		assert_int_equal(failures(), 0);
		teardown(state);
		setup(state);
	}
}

/* Not after the two minutes that a task waits for what another node has made. */
static void a_task_is_told_at_once_that_a_folder_is_none(void **state)
{
	struct work *other = NULL;
	struct err err = ERR_INIT;

	(void)state;
	assert_int_equal(work_open_task(top, &other, &err), -ERR_NOTFOUND);
	err_clear(&err);
	assert_int_equal(work_open_task(folder, &other, &err), 0);
	work_close(other);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(a_task_is_done_once, setup, teardown),
		cmocka_unit_test_setup_teardown(a_failure_is_recorded_and_leaves_no_file, setup, teardown),
		cmocka_unit_test_setup_teardown(a_task_that_waits_is_interrupted, setup, teardown),
		cmocka_unit_test_setup_teardown(who_is_overtaken_has_not_failed, setup, teardown),
		cmocka_unit_test_setup_teardown(a_task_is_told_at_once_that_a_folder_is_none, setup, teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
