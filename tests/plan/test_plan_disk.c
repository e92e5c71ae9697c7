/*
 * Plan files and the disk: the removal of plans of jobs that do not exist, failing file calls, plans that become durable later,
 * and what a power cut leaves.
 */
#include "plan_fixture.h"

#include <pthread.h>
#include <stdatomic.h>

static bool is_there(const char *name)
{
	return faccessat(dirfd, name, F_OK, 0) == 0;
}

static bool among(void *ctx, uint64_t job)
{
	const uint64_t *jobs = ctx;

	for (; jobs && *jobs && *jobs != job; jobs++)
		;
	return jobs && *jobs;
}

/* Plans of jobs that do not exist are removed, and temporary files; those of later jobs stay. */
static void test_sweep(void **state)
{
	static uint64_t jobs[] = {3, 5, 8, 0};
	static const char *const all[] = {"plan-3", "plan-4",  "plan-5.tmp",  "plan-8",
					  "plan-9", "plan-10", "plan-10.tmp", "other"};
	static const bool stays[] = {true, false, false, true, false, true, false, false};
	struct err err = ERR_INIT;

	for (size_t i = 0; i < sizeof all / sizeof *all; i++)
		close(openat(dirfd, all[i], O_CREAT | O_WRONLY, 0600));
	assert_int_equal(plan_file_sweep(dirfd, 9, among, jobs, &(atomic_bool){true}, &err), -ERR_CANCELLED);
	for (size_t i = 0; i < sizeof all / sizeof *all; i++)
		assert_true(is_there(all[i]));
	err_clear(&err);
	assert_int_equal(plan_file_sweep(dirfd, 9, among, jobs, &(atomic_bool){false}, &err), 0);
	for (size_t i = 0; i < sizeof all / sizeof *all; i++)
		assert_int_equal(is_there(all[i]), stays[i]);
	assert_int_equal(plan_file_sweep(dirfd, 10, among, NULL, NULL, &err), 0);
	for (size_t i = 0; i < sizeof all / sizeof *all; i++)
		assert_false(is_there(all[i]));
}

static atomic_bool writes;
static pthread_t writer;

static void *write_seven(void *arg)
{
	struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL);
	struct plan_kept kept = {.load = 100, .cap = 200};
	struct cut_plan p = plan_of(5);
	struct err err = ERR_INIT;

	assert_int_equal(plan_file_write(f, &p, &kept, &err), 0);
	cut_plan_done(&p);
	plan_file_free(f);
	return NULL;
}

static int noting_openat(int fd, const char *path, int flags, mode_t mode)
{
	writes |= !strcmp(path, "plan-7.tmp");
	return io_system.openat(fd, path, flags, mode);
}

/* A write during the reading of the folder. The reader waits for it a while: then the plan has its name. */
static struct dirent *held_readdir(void *dir)
{
	if (!writer) {
		assert_int_equal(pthread_create(&writer, NULL, write_seven, NULL), 0);
		for (int i = 0; i < 100 && !writes; i++)
			usleep(1000);
		assert_false(writes);
	}
	return io_system.readdir(dir);
}

/* A file that is being written is not swept: the writer waits. */
static void test_sweep_writes(void **state)
{
	static uint64_t jobs[] = {7, 0};
	struct io_table table = io_system;
	struct err err = ERR_INIT;

	table.readdir = held_readdir;
	table.openat = noting_openat;
	io = &table;
	assert_int_equal(plan_file_sweep(dirfd, 7, among, jobs, NULL, &err), 0);
	assert_int_equal(pthread_join(writer, NULL), 0);
	io = &io_system;
	assert_true(writes);
	assert_true(is_there("plan-7"));
}

static int calls, fail_at;

static int failing_fsync(int fd)
{
	if (++calls == fail_at) {
		errno = EIO;
		return -1;
	}
	return io_system.fsync(fd);
}

static int failing_unlinkat(int dir, const char *path, int flags)
{
	errno = EROFS;
	return -1;
}

static ssize_t failing_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	if (++calls == fail_at) {
		errno = ENOSPC;
		return -1;
	}
	return io_system.pwrite(fd, buf, n, off);
}

/* Any failure to write a durable plan is an error; a plan that is not durable may be lost. */
static void test_failing_disk(void **state)
{
	struct io_table table = io_system;
	struct cut_plan p = plan_of(9);
	struct cut_leaf half[2] = {p.leaf[0], p.leaf[1]};

	table.fsync = failing_fsync;
	table.pwrite = failing_pwrite;
	io = &table;
	for (fail_at = 1; fail_at <= 6; fail_at++) {
		for (int durable = 0; durable < 2; durable++) {
			struct plan_file *f = plan_file_new(dirfd, 7, 3, durable, NULL);
			struct plan_kept kept = {.load = 500, .cap = 600};
			struct err err = ERR_INIT;
			int r;

			calls = 0;
			r = plan_file_write(f, &p, &kept, &err);
			if (!r)
				r = plan_file_settle(f, &err);
			if (!r)
				r = plan_file_split(f, &p.leaf[3].region, half, &err);
			if (durable && calls >= fail_at)
				assert_true(r < 0);
			else
				assert_int_equal(r, 0);
			plan_file_free(f);
		}
	}
	io = &io_system;
	cut_plan_done(&p);
}

enum settled_by { BY_READ, BY_SETTLE };

/* Writes of a plan do not wait for the disk until it is read, or its first block leaves: that waits once, and later splits wait.
 */
static void check_later(enum settled_by by)
{
	struct io_table table = io_system;
	struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL);
	struct plan_kept kept = {.load = 500, .cap = 600};
	struct cut_plan p = plan_of(9), q;
	struct cut_leaf half[2];
	struct err err = ERR_INIT;
	size_t seen;

	table.fsync = failing_fsync;
	io = &table;
	calls = fail_at = 0;
	assert_int_equal(plan_file_write(f, &p, &kept, &err), 0);
	split_leaf(f, &p.leaf[3].region, half);
	assert_int_equal(calls, 0);
	for (int again = 0; again < 2; again++) {
		if (by == BY_SETTLE || again)
			assert_int_equal(plan_file_settle(f, &err), 0);
		if (by == BY_READ || again) {
			assert_int_equal(plan_file_read(f, &q, &kept, &seen, &err), 0);
			assert_int_equal(q.n, 10);
			cut_plan_done(&q);
		}
		assert_int_equal(calls, 2);
	}
	split_leaf(f, &p.leaf[5].region, half);
	assert_int_equal(calls, 3);
	assert_int_equal(plan_file_write(f, &p, &kept, &err), 0);
	split_leaf(f, &p.leaf[4].region, half);
	assert_int_equal(calls, 3);
	io = &io_system;
	cut_plan_done(&p);
	plan_file_free(f);
}

static void test_later(void **state)
{
	check_later(BY_READ);
	check_later(BY_SETTLE);
}

/* A plan that is not durable waits for no disk at all. */
static void test_settle_temporary(void **state)
{
	struct io_table table = io_system;
	struct plan_file *f = plan_file_new(dirfd, 7, 3, false, NULL);
	struct cut_plan p = plan_of(9);
	struct err err = ERR_INIT;

	write_plan(f, &p, 600);
	table.fsync = failing_fsync;
	io = &table;
	calls = fail_at = 0;
	assert_int_equal(plan_file_settle(f, &err), 0);
	assert_int_equal(calls, 0);
	io = &io_system;
	cut_plan_done(&p);
	plan_file_free(f);
}

/* A plan that did not reach the disk is lost, and its job continues: nobody has a block of it. */
static void test_later_lost(void **state)
{
	struct io_table table = io_system;
	struct plan_kept kept = {.load = 500, .cap = 600};
	struct cut_plan p = plan_of(9), q;

	table.fsync = failing_fsync;
	io = &table;
	for (int i = 0; i < 4; i++) {
		const bool settle = i / 2;
		struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL);
		struct plan_done d = done_of(&p.leaf[2], 9);
		struct cut_leaf half[2];
		struct err err = ERR_INIT;
		struct records t;
		size_t seen;

		calls = 0;
		fail_at = 1 + i % 2;
		assert_int_equal(plan_file_write(f, &p, &kept, &err), 0);
		assert_true((settle ? plan_file_settle(f, &err) : plan_file_read(f, &q, &kept, &seen, &err)) < 0);
		assert_false(is_there("plan-7"));
		assert_int_equal(plan_file_read(f, &q, &kept, &seen, &err), PLAN_FILE_ABSENT);
		split_leaf(f, &p.leaf[3].region, half);
		assert_int_equal(plan_file_done(f, &d, 1, &err), 0);
		assert_false(is_there("plan-7"));
		write_plan(f, &p, 600);
		assert_int_equal(plan_file_done(f, &d, 1, &err), 0);
		assert_int_equal(leaves_now(), 9);
		assert_int_equal(records_now(&t), 1);
		plan_file_free(f);
	}
	io = &io_system;
	cut_plan_done(&p);
}

/* If the file cannot be removed either, it is not trusted: an fsync that failed is never repeated. */
static void test_later_lost_stays(void **state)
{
	struct io_table table = io_system;
	struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL);
	struct plan_kept kept = {.load = 500, .cap = 600};
	struct cut_plan p = plan_of(9), q;
	struct err err = ERR_INIT;
	size_t seen;

	table.fsync = failing_fsync;
	table.unlinkat = failing_unlinkat;
	io = &table;
	calls = 0;
	fail_at = 1;
	assert_int_equal(plan_file_write(f, &p, &kept, &err), 0);
	for (int again = 0; again < 2; again++)
		assert_true(plan_file_read(f, &q, &kept, &seen, &err) < 0);
	assert_int_equal(calls, 1);
	table.unlinkat = io_system.unlinkat;
	assert_int_equal(plan_file_read(f, &q, &kept, &seen, &err), PLAN_FILE_ABSENT);
	assert_false(is_there("plan-7"));
	assert_int_equal(calls, 1);
	io = &io_system;
	cut_plan_done(&p);
	plan_file_free(f);
}

static int noting_renameat(int from, const char *old, int to, const char *new)
{
	assert_false(is_there(new));
	calls++;
	return io_system.renameat(from, old, to, new);
}

/* A plan that is written anew does not replace the file: an error of writing would be lost with that. */
static void test_written_anew(void **state)
{
	struct io_table table = io_system;
	struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL);
	struct plan_kept kept = {.load = 500, .cap = 600};
	struct cut_plan p = plan_of(9);
	struct err err = ERR_INIT;

	table.renameat = noting_renameat;
	io = &table;
	calls = 0;
	for (int i = 0; i < 2; i++)
		assert_int_equal(plan_file_write(f, &p, &kept, &err), 0);
	assert_int_equal(calls, 2);
	io = &io_system;
	cut_plan_done(&p);
	plan_file_free(f);
}

/* A power cut may leave an empty file of an unread plan: that is no plan, and no damage. */
static void test_empty(void **state)
{
	struct err err = ERR_INIT;
	uint64_t bytes;

	close(openat(dirfd, "plan-7", O_CREAT | O_WRONLY | O_TRUNC, 0600));
	assert_int_equal(leaves_now(), 0);
	assert_int_equal(plan_file_check(dirfd, 7, &bytes, &err), 0);
}

/* An existing file is not the plan of a new job, and is removed. What the job wrote stays. */
static void test_fresh(void **state)
{
	struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL);
	struct cut_plan p = plan_of(9), q;
	struct plan_kept kept;
	struct err err = ERR_INIT;
	size_t seen;

	write_plan(f, &p, 600);
	plan_file_free(f);
	f = plan_file_new(dirfd, 7, 3, true, NULL);
	plan_file_fresh(f);
	assert_int_equal(plan_file_read(f, &q, &kept, &seen, &err), PLAN_FILE_ABSENT);
	assert_false(is_there("plan-7"));
	write_plan(f, &p, 600);
	assert_int_equal(plan_file_read(f, &q, &kept, &seen, &err), 0);
	cut_plan_done(&q);
	plan_file_fresh(f);
	write_plan(f, &p, 600);
	assert_int_equal(plan_file_read(f, &q, &kept, &seen, &err), 0);
	cut_plan_done(&q);
	cut_plan_done(&p);
	plan_file_free(f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_failing_disk), cmocka_unit_test(test_later),
		cmocka_unit_test(test_later_lost),   cmocka_unit_test(test_later_lost_stays),
		cmocka_unit_test(test_written_anew), cmocka_unit_test(test_empty),
		cmocka_unit_test(test_fresh),        cmocka_unit_test(test_sweep),
		cmocka_unit_test(test_sweep_writes), cmocka_unit_test(test_settle_temporary),
	};

	return cmocka_run_group_tests(tests, setup, teardown);
}
