/*
 * The catalogue: what was put is there after it was opened again; ids are never given twice; newer and broken
 * files are refused.
 */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <poll.h>
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
#include "ledger.h"

struct seen {
	int datasets, jobs, pushes;
	uint64_t dataset, job, generation;
	char name[80], state[20], message[80];
	int32_t box[4];
};

static int see_dataset(void *ctx, const struct catalogue_dataset *d, struct err *err)
{
	struct seen *s = ctx;

	s->datasets++;
	s->dataset = d->id;
	s->generation = d->generation;
	snprintf(s->name, sizeof s->name, "%s", d->name);
	memcpy(s->box, d->box, sizeof s->box);
	return 0;
}

static int see_job(void *ctx, const struct catalogue_job *j, struct err *err)
{
	struct seen *s = ctx;

	s->jobs++;
	s->job = j->id;
	snprintf(s->state, sizeof s->state, "%s", j->state);
	snprintf(s->message, sizeof s->message, "%s", j->error_message);
	return 0;
}

static int see_push(void *ctx, const struct catalogue_push *p, struct err *err)
{
	((struct seen *)ctx)->pushes++;
	return 0;
}

static struct catalogue *reopen(struct catalogue *c, struct seen *seen, uint64_t last[3])
{
	struct catalogue_reader reader = {seen, see_dataset, see_job, see_push};
	struct err err = ERR_INIT;

	catalogue_free(c);
	memset(seen, 0, sizeof *seen);
	assert_int_equal(catalogue_new(path, NULL, &c, &err), 0);
	assert_int_equal(catalogue_load(c, &reader, last, &err), 0);
	assert_int_equal(catalogue_start(c, &err), 0);
	return c;
}

static int told, told_r;

static void tell(void *ctx, int r, const struct err *why)
{
	told++;
	told_r = r;
}

static void settle(struct catalogue *c)
{
	while (catalogue_busy(c)) {
		struct pollfd p = {.fd = catalogue_fd(c), .events = POLLIN};

		assert_int_equal(poll(&p, 1, 100000), 1);
		catalogue_dispatch(c);
	}
}

static const struct catalogue_dataset dataset = {
	.id = 7,
	.name = "valley",
	.uid = 1000,
	.created_us = 1,
	.pushed_us = 2,
	.manifest = "manifest-1",
	.generation = 1,
	.points = 10,
	.bytes = 160,
	.files = 1,
	.lattice = "0.01 0.01 1 2 3",
	.crs = "unknown",
	.unit_xy = "metre",
	.unit_z = "metre",
	.box = {-5, INT32_MIN, INT32_MAX, 6},
};

static void kept(void **state)
{
	struct catalogue_job job = {
		.id = 3,
		.dataset = 7,
		.generation = 1,
		.view = "view 1",
		.state = "failed",
		.report = "",
		.error_code = "bad-input",
		.error_message = "it is \"broken\"; DROP TABLE job",
		.error_file = "f",
		.error_field = "",
		.error_hint = "",
		.error_offset = -1,
	};
	struct catalogue_push push = {.id = 4, .dataset = 7, .uid = 1000};
	struct err err = ERR_INIT;
	struct seen seen;
	uint64_t last[3];
	struct catalogue *c = reopen(NULL, &seen, last);

	assert_int_equal(last[0] + last[1] + last[2], 0);
	told = 0;
	assert_int_equal(catalogue_put_push(c, &push, tell, NULL, &err), 0);
	assert_int_equal(catalogue_put_dataset(c, &dataset, 0, tell, NULL, &err), 0);
	assert_int_equal(catalogue_put_job(c, &job, tell, NULL, &err), 0);
	settle(c);
	assert_int_equal(told, 3);
	assert_int_equal(told_r, 0);
	c = reopen(c, &seen, last);
	assert_int_equal(seen.datasets + seen.jobs + seen.pushes, 3);
	assert_int_equal(seen.dataset, 7);
	assert_string_equal(seen.name, "valley");
	assert_memory_equal(seen.box, dataset.box, sizeof seen.box);
	assert_string_equal(seen.state, "failed");
	assert_string_equal(seen.message, job.error_message);
	/* The commit of a push takes its row away in the same transaction. */
	assert_int_equal(catalogue_put_dataset(c, &dataset, 4, tell, NULL, &err), 0);
	/* Ids of rows that are gone are not given again. */
	assert_int_equal(catalogue_drop_job(c, 3, NULL, NULL, &err), 0);
	c = reopen(c, &seen, last); /* free waits for what is queued */
	assert_int_equal(seen.pushes, 0);
	assert_int_equal(seen.jobs, 0);
	assert_int_equal(last[0], 7);
	assert_int_equal(last[1], 3);
	assert_int_equal(last[2], 4);
	catalogue_free(c);
}

/* A change that fails is told, with a reason, and leaves the others alone. */
static void failure_is_told(void **state)
{
	struct catalogue_dataset same = dataset;
	struct err err = ERR_INIT;
	struct seen seen;
	uint64_t last[3];
	struct catalogue *c = reopen(NULL, &seen, last);
	sqlite3 *other;

	assert_int_equal(sqlite3_open(path, &other), SQLITE_OK);
	assert_int_equal(sqlite3_exec(other, "DROP TABLE job", NULL, NULL, NULL), SQLITE_OK);
	sqlite3_close(other);
	told = 0;
	assert_int_equal(catalogue_drop_job(c, 1, tell, NULL, &err), 0);
	settle(c);
	assert_int_equal(told, 1);
	assert_true(told_r < 0);
	assert_int_equal(catalogue_put_dataset(c, &same, 1, tell, NULL, &err), 0);
	settle(c);
	assert_int_equal(told_r, 0);
	catalogue_free(c);
}

static struct err told_why;

static void tell_why(void *ctx, int r, const struct err *why)
{
	told++;
	told_r = r;
	told_why = why ? *why : ERR_INIT;
}

/* An index that points into another table: nobody would see it by reading rows. */
static void damage_is_found(void **state)
{
	struct err err = ERR_INIT;
	struct seen seen;
	uint64_t last[3];
	struct catalogue *c = reopen(NULL, &seen, last);
	sqlite3 *db;

	assert_int_equal(catalogue_put_dataset(c, &dataset, 0, NULL, NULL, &err), 0);
	told = 0;
	assert_int_equal(catalogue_check(c, tell_why, NULL, &err), 0);
	settle(c);
	assert_int_equal(told, 1);
	assert_int_equal(told_r, 0);
	catalogue_free(c);
	assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
	assert_int_equal(sqlite3_exec(db,
				      "DROP INDEX dataset_name; CREATE INDEX dataset_name ON dataset (name) WHERE id < 0;"
				      "PRAGMA writable_schema = 1;"
				      "UPDATE sqlite_master SET sql = 'CREATE INDEX dataset_name ON dataset (name)'"
				      " WHERE name = 'dataset_name'",
				      NULL, NULL, NULL),
			 SQLITE_OK);
	sqlite3_close(db);
	c = reopen(NULL, &seen, last);
	assert_int_equal(seen.datasets, 1);
	assert_int_equal(catalogue_check(c, tell_why, NULL, &err), 0);
	settle(c);
	assert_int_equal(told_r, -ERR_CORRUPT);
	assert_non_null(strstr(told_why.message, "dataset_name"));
	assert_string_equal(told_why.file, "catalogue.db");
	catalogue_free(c);
}

/* A page of pushes loses its last row, and nothing else tells. */
static void lose_row(void)
{
	enum { PAGE = 4096, LEAF = 13 };
	int fd = open(path, O_RDWR);
	uint8_t head[8];
	off_t at = 0;

	assert_true(fd >= 0);
	for (off_t page = PAGE; pread(fd, head, sizeof head, page) == sizeof head; page += PAGE)
		if (head[0] == LEAF && head[3] * 256 + head[4] > 50)
			at = page;
	assert_true(at > 0);
	assert_int_equal(pread(fd, head, sizeof head, at), sizeof head);
	head[4]--;
	assert_int_equal(pwrite(fd, head, sizeof head, at), sizeof head);
	close(fd);
}

/* A row on a damaged page would be taken for absent. The pages are checked while rows are read, and the reading ends with that.
 */
static void hidden_row(void **state)
{
	enum { ROWS = 400 };
	struct catalogue_reader reader = {.dataset = see_dataset, .job = see_job, .push = see_push};
	struct catalogue_push push = {.dataset = 7, .uid = 1000};
	struct err err = ERR_INIT;
	struct seen seen;
	uint64_t last[3];
	struct catalogue *c = reopen(NULL, &seen, last);

	for (push.id = 1; push.id <= ROWS; push.id++)
		assert_int_equal(catalogue_put_push(c, &push, NULL, NULL, &err), 0);
	catalogue_free(reopen(c, &seen, last));
	assert_int_equal(seen.pushes, ROWS);
	lose_row();
	seen = (struct seen){0};
	reader.ctx = &seen;
	assert_int_equal(catalogue_new(path, NULL, &c, &err), 0);
	assert_int_equal(catalogue_load(c, &reader, last, &err), -ERR_CORRUPT);
	assert_true(seen.pushes < ROWS);
	assert_non_null(strstr(err.message, "the catalogue is damaged"));
	assert_non_null(strstr(err.hint, "backup"));
	assert_string_equal(err.file, path);
	catalogue_free(c);
	/* Of a start that ends before it has read the rows. */
	assert_int_equal(catalogue_new(path, NULL, &c, &err), 0);
	catalogue_free(c);
}

static void newer_and_broken(void **state)
{
	struct err err = ERR_INIT;
	struct catalogue *c;
	sqlite3 *db;
	int fd;

	assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
	assert_int_equal(sqlite3_exec(db, "PRAGMA user_version = 999", NULL, NULL, NULL), SQLITE_OK);
	sqlite3_close(db);
	assert_int_equal(catalogue_new(path, NULL, &c, &err), -ERR_VERSION);
	assert_non_null(strstr(err.message, "a newer acutd"));
	assert_non_null(strstr(err.message, "version 999"));
	assert_non_null(strstr(err.hint, "--state"));
	assert_string_equal(err.file, path);
	unlink(path);
	fd = open(path, O_CREAT | O_WRONLY, 0600);
	for (int i = 0; i < 100; i++)
		assert_int_equal(write(fd, "this is not a database, not at all", 34), 34);
	close(fd);
	err_clear(&err);
	assert_int_equal(catalogue_new(path, NULL, &c, &err), -ERR_CORRUPT);
	assert_string_equal(err.file, path);
}

/* A caller that exceeds the room of the queue waits for the disk. All rows are written, and all memory is released. */
static void queue_is_charged(void **state)
{
	enum { ROOM = 8 << 10, ROWS = 200 };
	struct ledger *ledger = ledger_new(CATALOGUE_HEAP + ROOM);
	struct catalogue_reader reader = {.dataset = see_dataset, .job = see_job, .push = see_push};
	struct catalogue_push push = {.dataset = 7, .uid = 1000};
	struct err err = ERR_INIT;
	struct catalogue *c;
	struct seen seen = {0};
	char name[40];
	uint64_t last[3];

	reader.ctx = &seen;
	assert_int_equal(catalogue_new(path, ledger, &c, &err), 0);
	assert_int_equal(ledger_held(ledger, LEDGER_CATALOGUE), CATALOGUE_HEAP);
	assert_int_equal(catalogue_load(c, &reader, last, &err), 0);
	assert_int_equal(catalogue_start(c, &err), 0);
	told = told_r = 0;
	for (int i = 0; i < ROWS; i++) {
		struct catalogue_dataset d = dataset;

		snprintf(name, sizeof name, "valley-%d", i);
		d.name = name;
		push.id = d.id = (uint64_t)i + 1;
		assert_int_equal(catalogue_put_dataset(c, &d, 0, tell, NULL, &err), 0);
		assert_int_equal(catalogue_put_push(c, &push, tell, NULL, &err), 0);
	}
	settle(c);
	assert_int_equal(told, 2 * ROWS);
	assert_int_equal(told_r, 0);
	assert_true(ledger_peak(ledger, LEDGER_CATALOGUE) > CATALOGUE_HEAP + ROOM / 2);
	assert_int_equal(ledger_held(ledger, LEDGER_CATALOGUE), CATALOGUE_HEAP);
	catalogue_free(c);
	assert_int_equal(ledger_held(ledger, LEDGER_CATALOGUE), 0);
	ledger_free(ledger);
	catalogue_free(reopen(NULL, &seen, last));
	assert_int_equal(seen.datasets, ROWS);
	assert_int_equal(seen.pushes, ROWS);
	/* A start that fails: what it queued is not written, and given back. */
	ledger = ledger_new(CATALOGUE_HEAP + ROOM);
	assert_int_equal(catalogue_new(path, ledger, &c, &err), 0);
	assert_int_equal(catalogue_drop_push(c, 1, NULL, NULL, &err), 0);
	assert_true(ledger_held(ledger, LEDGER_CATALOGUE) > CATALOGUE_HEAP);
	catalogue_free(c);
	ledger_free(ledger);
	/* No room for the heap: said. */
	ledger = ledger_new(CATALOGUE_HEAP - 1);
	assert_int_equal(catalogue_new(path, ledger, &c, &err), -ERR_LIMIT);
	ledger_free(ledger);
}

/* ---- errors of the disk ---- */

static int syncs, fail_from, fail_to; /* syncs that fail, counted from 1 */

static bool faking;

static int fake_sync(void)
{
	if (!faking || ++syncs < fail_from || syncs >= fail_to)
		return 0;
	errno = EIO;
	return -1;
}

/* In place of the C library's, also for SQLite. */
int fsync(int fd)
{
	return fake_sync();
}

int fdatasync(int fd)
{
	return fake_sync();
}

static void fake(bool on)
{
	faking = on;
}

/* Whatever fsync fails: what was told is what is there afterwards, and the catalogue goes on when the disk does. */
static void sync_fails(void **state)
{
	struct catalogue_dataset d = dataset;
	struct err err = ERR_INIT;
	struct seen seen;
	uint64_t last[3];
	int failures = 0;

	for (int at = 1; at < 12; at++) {
		struct catalogue *c = reopen(NULL, &seen, last);
		uint64_t before = seen.generation;

		fake(true);
		syncs = 0;
		fail_from = at;
		fail_to = at + 1;
		d.generation = before + 1;
		assert_int_equal(catalogue_put_dataset(c, &d, 0, tell, NULL, &err), 0);
		settle(c);
		failures += told_r != 0;
		uint64_t want = told_r ? before : before + 1;

		if (told_r)
			assert_int_equal(told_r, -ERR_IO);
		assert_false(catalogue_is_uncertain(c) && !told_r);
		fail_to = 0;
		/* The connection before is not used any more; this change is a new one. */
		struct catalogue_push p = {.id = (uint64_t)at, .dataset = 7};

		assert_int_equal(catalogue_put_push(c, &p, tell, NULL, &err), 0);
		settle(c);
		assert_int_equal(told_r, 0);
		bool unsure = catalogue_is_uncertain(c);

		catalogue_free(c);
		fake(false);
		catalogue_free(reopen(NULL, &seen, last));
		if (!unsure)
			assert_int_equal(seen.generation, want);
		assert_int_equal(seen.pushes, at);
	}
	assert_true(failures > 0);
}

static void disk_stays_broken(void **state)
{
	struct catalogue_dataset d = dataset;
	struct err err = ERR_INIT;
	struct seen seen;
	uint64_t last[3];
	struct catalogue *c = reopen(NULL, &seen, last);

	assert_int_equal(catalogue_put_dataset(c, &d, 0, tell, NULL, &err), 0);
	settle(c);
	fake(true);
	syncs = 0;
	fail_from = 1;
	fail_to = INT_MAX;
	d.generation = 2;
	for (int i = 0; i < 3; i++) {
		assert_int_equal(catalogue_put_dataset(c, &d, 0, tell, NULL, &err), 0);
		settle(c);
		assert_int_equal(told_r, -ERR_IO);
		assert_true(catalogue_is_uncertain(c));
	}
	fail_to = 0;
	d.generation = 3;
	assert_int_equal(catalogue_put_dataset(c, &d, 0, tell, NULL, &err), 0);
	settle(c);
	assert_int_equal(told_r, 0);
	catalogue_free(c);
	fake(false);
	catalogue_free(reopen(NULL, &seen, last));
	assert_int_equal(seen.generation, 3);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(kept, setup, teardown),
		cmocka_unit_test_setup_teardown(failure_is_told, setup, teardown),
		cmocka_unit_test_setup_teardown(queue_is_charged, setup, teardown),
		cmocka_unit_test_setup_teardown(newer_and_broken, setup, teardown),
		cmocka_unit_test_setup_teardown(sync_fails, setup, teardown),
		cmocka_unit_test_setup_teardown(disk_stays_broken, setup, teardown),
		cmocka_unit_test_setup_teardown(damage_is_found, setup, teardown),
		cmocka_unit_test_setup_teardown(hidden_row, setup, teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
