/*
 * The check of the pages beside the reading of the rows: if it has no memory, all rows are read; if it fails for good, the load
 * fails, and tells no largest id.
 */
#include <dlfcn.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>
#include <sqlite3.h>

#include "catalogue.h"
#include "catalogue_fixture.h"
#include "err.h"

/* More than are read between two looks at the check. */
enum { ROWS = 100 };

static enum { SIDE_WORKS, SIDE_NO_MEMORY, SIDE_NO_FILE } side;
static pthread_t loop;
static pthread_key_t check_ends;
static _Atomic int asked, ended;

static void check_ended(void *at)
{
	*(_Atomic int *)at = 1;
}

/* In the place of that of SQLite. The check opens the catalogue on a thread of its own. */
int sqlite3_open_v2(const char *name, sqlite3 **db, int flags, const char *vfs)
{
	int (*real)(const char *, sqlite3 **, int, const char *) = dlsym(RTLD_NEXT, "sqlite3_open_v2");

	if (side == SIDE_WORKS || pthread_equal(pthread_self(), loop))
		return real(name, db, flags, vfs);
	pthread_setspecific(check_ends, (void *)&ended);
	asked = 1;
	if (side == SIDE_NO_FILE)
		return real("/proc/none/catalogue.db", db, flags, vfs);
	*db = NULL;
	return SQLITE_NOMEM;
}

struct seen {
	int datasets, jobs;
};

/* The check ends before the second row is read. */
static int see_dataset(void *ctx, const struct catalogue_dataset *d, struct err *err)
{
	struct seen *s = ctx;

	while (side != SIDE_WORKS && !ended)
		usleep(1000);
	s->datasets++;
	return 0;
}

static int see_job(void *ctx, const struct catalogue_job *j, struct err *err)
{
	((struct seen *)ctx)->jobs++;
	return 0;
}

static int see_push(void *ctx, const struct catalogue_push *p, struct err *err)
{
	return 0;
}

static void fill(void)
{
	const struct catalogue_reader reader = {&(struct seen){0}, see_dataset, see_job, see_push};
	struct catalogue *c;
	struct err err = ERR_INIT;
	uint64_t last[3];

	side = SIDE_WORKS;
	assert_int_equal(catalogue_new(path, NULL, &c, &err), 0);
	assert_int_equal(catalogue_load(c, &reader, last, &err), 0);
	assert_int_equal(catalogue_start(c, &err), 0);
	for (uint64_t i = 1; i <= ROWS; i++) {
		char name[24];
		const struct catalogue_dataset d = {
			.id = i, .name = name, .manifest = "", .lattice = "", .crs = "", .unit_xy = "", .unit_z = ""};
		const struct catalogue_job j = {.id = i,
						.dataset = i,
						.view = "",
						.state = "done",
						.report = "",
						.error_code = "",
						.error_message = "",
						.error_file = "",
						.error_field = "",
						.error_hint = "",
						.area = ""};

		snprintf(name, sizeof name, "d%u", (unsigned)i);
		assert_int_equal(catalogue_put_dataset(c, &d, 0, NULL, NULL, &err), 0);
		assert_int_equal(catalogue_put_job(c, &j, NULL, NULL, &err), 0);
	}
	catalogue_free(c);
}

static int load(struct seen *seen, uint64_t last[3])
{
	const struct catalogue_reader reader = {seen, see_dataset, see_job, see_push};
	struct catalogue *c;
	struct err err = ERR_INIT;
	int r;

	loop = pthread_self();
	asked = ended = 0;
	assert_int_equal(catalogue_new(path, NULL, &c, &err), 0);
	r = catalogue_load(c, &reader, last, &err);
	catalogue_free(c);
	return r;
}

static void check_without_memory(void **state)
{
	struct seen seen = {0};
	uint64_t last[3];

	fill();
	side = SIDE_NO_MEMORY;
	assert_int_equal(load(&seen, last), 0);
	assert_true(asked);
	assert_int_equal(seen.datasets, ROWS);
	assert_int_equal(seen.jobs, ROWS);
	assert_int_equal(last[0], ROWS);
}

static void check_fails(void **state)
{
	struct seen seen = {0};
	uint64_t last[3] = {1, 1, 1};

	fill();
	side = SIDE_NO_FILE;
	assert_true(load(&seen, last) < 0);
	assert_true(asked);
	assert_in_range(seen.datasets, 1, ROWS - 1);
	assert_int_equal(last[0] | last[1] | last[2], 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(check_without_memory, setup, teardown),
		cmocka_unit_test_setup_teardown(check_fails, setup, teardown),
	};

	alarm(100); /* a check that does not end */
	pthread_key_create(&check_ends, check_ended);
	return cmocka_run_group_tests(tests, NULL, NULL);
}
