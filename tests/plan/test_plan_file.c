/*
 * Plans in files: a written plan is read back, splits are applied once and in any order, an incomplete split after a
 * crash is ignored, damage anywhere is found, and every failing file call is an error.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "err.h"
#include "io.h"
#include "log.h"
#include "plan_file.h"

enum { RECORD = 104 };

static int dirfd;
static char folder[] = "/tmp/acut-plan-XXXXXX";

static int setup(void **state)
{
	assert_non_null(mkdtemp(folder));
	dirfd = open(folder, O_RDONLY | O_DIRECTORY);
	return dirfd < 0;
}

static int teardown(void **state)
{
	unlinkat(dirfd, "plan-7", 0);
	unlinkat(dirfd, "plan-7.tmp", 0);
	close(dirfd);
	return rmdir(folder);
}

/* The root of a box, split n - 1 times, always the last leaf. */
static struct cut_plan plan_of(size_t n)
{
	static const int32_t box[4] = {0, 0, 1 << 30, 1 << 30};
	struct cut_plan p = {calloc(n, sizeof(struct cut_leaf)), 1, n};

	cut_region_root(box, &p.leaf[0].region);
	while (p.n < n) {
		struct cut_region half[2];

		assert_true(cut_region_split(&p.leaf[p.n - 1].region, half));
		p.leaf[p.n - 1].region = half[0];
		p.leaf[p.n++].region = half[1];
	}
	for (size_t i = 0; i < n; i++) {
		p.leaf[i].count = 1000 + i;
		p.leaf[i].exact = i % 2;
		p.leaf[i].stuck = (uint8_t)(i % 8);
		p.leaf[i].above = i % 3 ? 0 : 77 * i;
	}
	return p;
}

static void same_leaf(const struct cut_leaf *a, const struct cut_leaf *b)
{
	assert_true(cut_region_same(&a->region, &b->region));
	assert_int_equal(a->count, b->count);
	assert_int_equal(a->exact, b->exact);
	assert_int_equal(a->stuck, b->stuck);
	assert_int_equal(a->above, b->above);
}

static int read_plan(struct cut_plan *plan, struct plan_kept *kept, size_t *seen)
{
	struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL);
	struct err err = ERR_INIT;
	int r = plan_file_read(f, plan, kept, seen, &err);

	plan_file_free(f);
	return r;
}

static struct digest write_plan(struct plan_file *f, const struct cut_plan *p, uint32_t cap)
{
	struct plan_kept kept = {.load = 500, .cap = cap};
	struct err err = ERR_INIT;

	assert_int_equal(plan_file_write(f, p, &kept, &err), 0);
	return kept.base;
}

static void test_written_is_read(void **state)
{
	static const size_t sizes[] = {1, 2, 40, 61};

	for (size_t k = 0; k < 4; k++) {
		struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL);
		struct cut_plan p = plan_of(sizes[k]), q;
		struct digest base = write_plan(f, &p, 600);
		struct plan_kept kept;
		size_t seen;

		assert_int_equal(read_plan(&q, &kept, &seen), 0);
		assert_int_equal(q.n, p.n);
		for (size_t i = 0; i < p.n; i++)
			same_leaf(&q.leaf[i], &p.leaf[i]);
		assert_int_equal(kept.load, 500);
		assert_int_equal(kept.cap, 600);
		assert_true(digest_equal(kept.base, base));
		/* Another cap splits otherwise: another stream. */
		assert_false(digest_equal(write_plan(f, &p, 601), base));
		assert_true(digest_equal(write_plan(f, &p, 600), base));
		cut_plan_done(&q);
		cut_plan_done(&p);
		plan_file_free(f);
	}
}

static void split_leaf(struct plan_file *f, const struct cut_region *whole, struct cut_leaf half[2])
{
	struct cut_region r[2];
	struct err err = ERR_INIT;

	assert_true(cut_region_split(whole, r));
	half[0] = (struct cut_leaf){.region = r[0], .count = 11, .above = 9};
	half[1] = (struct cut_leaf){.region = r[1], .count = 12, .exact = true};
	assert_int_equal(plan_file_split(f, whole, half, &err), 0);
}

static void test_splits(void **state)
{
	struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL), *g = plan_file_new(dirfd, 7, 3, true, NULL);
	struct cut_plan p = plan_of(5), q, follower;
	struct cut_leaf half[2], quarter[2];
	struct plan_kept kept;
	struct err err = ERR_INIT;
	struct digest base = write_plan(f, &p, 600);
	size_t seen, none;

	assert_int_equal(plan_file_read(f, &follower, &kept, &none, &err), 0);
	assert_int_equal(none, 0);
	split_leaf(f, &p.leaf[2].region, half);
	split_leaf(f, &half[1].region, quarter);
	/* Again, by another walk and by another process: once in the plan. */
	split_leaf(f, &p.leaf[2].region, half);
	assert_int_equal(plan_file_read(g, &q, &kept, &seen, &err), 0);
	cut_plan_done(&q);
	split_leaf(g, &p.leaf[2].region, half);
	assert_int_equal(read_plan(&q, &kept, &seen), 0);
	assert_int_equal(q.n, 7);
	same_leaf(&q.leaf[1], &p.leaf[1]);
	same_leaf(&q.leaf[2], &half[0]);
	same_leaf(&q.leaf[3], &quarter[0]);
	same_leaf(&q.leaf[4], &quarter[1]);
	same_leaf(&q.leaf[5], &p.leaf[3]);
	assert_true(digest_equal(kept.base, base));
	/* Who follows takes them over, those before `least` not. */
	assert_int_equal(plan_file_follow(f, &none, 2, &follower, &err), 0);
	assert_int_equal(none, 2);
	assert_int_equal(follower.n, 7);
	for (size_t i = 0; i < 7; i++)
		same_leaf(&follower.leaf[i], &q.leaf[i]);
	cut_plan_done(&q);
	cut_plan_done(&follower);
	cut_plan_done(&p);
	plan_file_free(f);
	plan_file_free(g);
}

static size_t leaves_now(void)
{
	struct plan_kept kept;
	struct cut_plan q = {0};
	size_t seen, n;
	int r = read_plan(&q, &kept, &seen);

	n = r ? 0 : q.n;
	if (r)
		assert_int_equal(r, PLAN_FILE_ABSENT);
	else
		cut_plan_done(&q);
	return n;
}

/* Cut at any byte of its last split: as if there were none; and the next split takes its place. */
static void test_torn_split(void **state)
{
	struct cut_plan p = plan_of(4);

	for (size_t cut = 1; cut <= 3 * RECORD; cut += 37) {
		struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL), *g = plan_file_new(dirfd, 7, 3, true, NULL);
		struct cut_leaf half[2];
		struct plan_kept kept;
		struct cut_plan q;
		struct err err = ERR_INIT;
		size_t seen;

		write_plan(f, &p, 600);
		split_leaf(f, &p.leaf[0].region, half);
		split_leaf(f, &p.leaf[1].region, half);
		assert_int_equal(leaves_now(), 6);
		assert_int_equal(plan_file_read(g, &q, &kept, &seen, &err), 0);
		cut_plan_done(&q);
		{
			int fd = openat(dirfd, "plan-7", O_RDWR);

			assert_int_equal(ftruncate(fd, (off_t)(11 * RECORD - cut)), 0);
			close(fd);
		}
		assert_int_equal(leaves_now(), 5);
		plan_file_free(g);
		g = plan_file_new(dirfd, 7, 3, true, NULL);
		assert_int_equal(plan_file_read(g, &q, &kept, &seen, &err), 0);
		split_leaf(g, &p.leaf[3].region, half);
		assert_int_equal(leaves_now(), 6);
		cut_plan_done(&q);
		plan_file_free(f);
		plan_file_free(g);
	}
	cut_plan_done(&p);
}

static struct plan_done done_of(const struct cut_leaf *leaf, uint64_t salt)
{
	return (struct plan_done){.region = leaf->region,
				  .base = {1, salt},
				  .list = {2, salt},
				  .digest = {3, salt},
				  .payload = 4 * salt,
				  .triangles = 5 + salt,
				  .bytes = 6 + salt};
}

struct told {
	struct plan_done done[16];
	size_t n;
};

static int tell(void *ctx, const struct plan_done *d, struct err *err)
{
	struct told *t = ctx;

	t->done[t->n++] = *d;
	return t->n == 16 ? 77 : 0;
}

static size_t told_now(struct told *t)
{
	struct err err = ERR_INIT;

	t->n = 0;
	assert_int_equal(plan_file_each_done(dirfd, 7, tell, t, &err), 0);
	return t->n;
}

/* Finished domains between splits: both are read, what is torn at the end is not there. */
static void test_done(void **state)
{
	struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL);
	struct cut_plan p = plan_of(4);
	struct cut_leaf half[2];
	struct err err = ERR_INIT;
	struct told t;

	unlinkat(dirfd, "plan-7", 0);
	assert_int_equal(told_now(&t), 0);
	write_plan(f, &p, 600);
	for (uint64_t i = 0; i < 4; i++) {
		struct plan_done d = done_of(&p.leaf[i], i);

		assert_int_equal(plan_file_done(f, &d, 1, &err), 0);
		if (i == 1)
			split_leaf(f, &p.leaf[0].region, half);
	}
	split_leaf(f, &p.leaf[1].region, half);
	assert_int_equal(leaves_now(), 6);
	assert_int_equal(told_now(&t), 4);
	for (uint64_t i = 0; i < 4; i++) {
		struct plan_done d = done_of(&p.leaf[i], i);

		assert_true(cut_region_same(&t.done[i].region, &d.region));
		assert_true(digest_equal(t.done[i].base, d.base) && digest_equal(t.done[i].list, d.list) &&
			    digest_equal(t.done[i].digest, d.digest));
		assert_true(t.done[i].payload == d.payload && t.done[i].triangles == d.triangles && t.done[i].bytes == d.bytes);
	}
	{
		struct plan_done d = done_of(&p.leaf[2], 9);
		int fd = openat(dirfd, "plan-7", O_RDWR);
		off_t end = lseek(fd, 0, SEEK_END);

		assert_int_equal(plan_file_done(f, &d, 1, &err), 0);
		assert_int_equal(told_now(&t), 5);
		assert_int_equal(ftruncate(fd, end + RECORD - 1), 0);
		assert_int_equal(told_now(&t), 4);
		assert_int_equal(leaves_now(), 6);
		close(fd);
	}
	cut_plan_done(&p);
	plan_file_free(f);
}

static void test_damage(void **state)
{
	struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL);
	struct cut_plan p = plan_of(4);
	int fd;

	log_init("test", LOG_LEVEL_ERROR);
	write_plan(f, &p, 600);
	fd = openat(dirfd, "plan-7", O_RDWR);
	for (off_t at = 0; at < 5 * RECORD; at += 3) {
		uint8_t byte;

		assert_int_equal(pread(fd, &byte, 1, at), 1);
		byte ^= 16;
		assert_int_equal(pwrite(fd, &byte, 1, at), 1);
		assert_int_equal(leaves_now(), 0);
		byte ^= 16;
		assert_int_equal(pwrite(fd, &byte, 1, at), 1);
	}
	assert_int_equal(leaves_now(), 4);
	assert_int_equal(ftruncate(fd, 5 * RECORD - 1), 0);
	assert_int_equal(leaves_now(), 0);
	close(fd);
	/* Of another job or generation. */
	write_plan(f, &p, 600);
	{
		struct plan_file *other = plan_file_new(dirfd, 7, 4, true, NULL);
		struct plan_kept kept;
		struct cut_plan q;
		struct err err = ERR_INIT;
		size_t seen;

		assert_int_equal(plan_file_read(other, &q, &kept, &seen, &err), PLAN_FILE_ABSENT);
		plan_file_free(other);
	}
	assert_int_equal(plan_file_job("plan-7"), 7);
	assert_int_equal(plan_file_job("plan-7.tmp"), 0);
	assert_int_equal(plan_file_job("catalogue"), 0);
	cut_plan_done(&p);
	plan_file_free(f);
}

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

/* Plans of jobs that are not there go, and what writes left; those of jobs that came since stay. */
static void test_sweep(void **state)
{
	static uint64_t jobs[] = {3, 5, 8, 0};
	static const char *const all[] = {"plan-3", "plan-4",  "plan-5.tmp",  "plan-8",
					  "plan-9", "plan-10", "plan-10.tmp", "other"};
	static const bool stays[] = {true, false, false, true, false, true, false, false};
	struct err err = ERR_INIT;

	for (size_t i = 0; i < sizeof all / sizeof *all; i++)
		close(openat(dirfd, all[i], O_CREAT | O_WRONLY, 0600));
	assert_int_equal(plan_file_sweep(dirfd, 9, among, jobs, &err), 0);
	for (size_t i = 0; i < sizeof all / sizeof *all; i++)
		assert_int_equal(is_there(all[i]), stays[i]);
	assert_int_equal(plan_file_sweep(dirfd, 10, among, NULL, &err), 0);
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

static int telling_openat(int fd, const char *path, int flags, mode_t mode)
{
	writes |= !strcmp(path, "plan-7.tmp");
	return io_system.openat(fd, path, flags, mode);
}

/* Somebody writes a plan when the folder is looked through, which waits for him for a while: then it is at its name. */
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

/* What is being written is not swept: whoever writes waits. */
static void test_sweep_writes(void **state)
{
	static uint64_t jobs[] = {7, 0};
	struct io_table table = io_system;
	struct err err = ERR_INIT;

	table.readdir = held_readdir;
	table.openat = telling_openat;
	io = &table;
	assert_int_equal(plan_file_sweep(dirfd, 7, among, jobs, &err), 0);
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

/* A durable plan that could not be written is an error, whatever failed; one that need not last is none. */
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

/* Of a plan that nobody has read nothing waits for the disk; who reads it does, once, and what comes then waits again. */
static void test_later(void **state)
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
	assert_int_equal(plan_file_write_later(f, &p, &kept, &err), 0);
	split_leaf(f, &p.leaf[3].region, half);
	assert_int_equal(calls, 0);
	for (int again = 0; again < 2; again++) {
		assert_int_equal(plan_file_read(f, &q, &kept, &seen, &err), 0);
		assert_int_equal(q.n, 10);
		cut_plan_done(&q);
		assert_int_equal(calls, 2);
	}
	split_leaf(f, &p.leaf[5].region, half);
	assert_int_equal(calls, 3);
	assert_int_equal(plan_file_write_later(f, &p, &kept, &err), 0);
	split_leaf(f, &p.leaf[4].region, half);
	assert_int_equal(calls, 3);
	io = &io_system;
	cut_plan_done(&p);
	plan_file_free(f);
}

/* What did not reach the disk is gone, and its job goes on: nobody has a block of it. */
static void test_later_lost(void **state)
{
	struct io_table table = io_system;
	struct plan_kept kept = {.load = 500, .cap = 600};
	struct cut_plan p = plan_of(9), q;

	table.fsync = failing_fsync;
	io = &table;
	for (fail_at = 1; fail_at <= 2; fail_at++) {
		struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL);
		struct plan_done d = done_of(&p.leaf[2], 9);
		struct cut_leaf half[2];
		struct err err = ERR_INIT;
		struct told t;
		size_t seen;

		calls = 0;
		assert_int_equal(plan_file_write_later(f, &p, &kept, &err), 0);
		assert_true(plan_file_read(f, &q, &kept, &seen, &err) < 0);
		assert_false(is_there("plan-7"));
		assert_int_equal(plan_file_read(f, &q, &kept, &seen, &err), PLAN_FILE_ABSENT);
		split_leaf(f, &p.leaf[3].region, half);
		assert_int_equal(plan_file_done(f, &d, 1, &err), 0);
		assert_false(is_there("plan-7"));
		write_plan(f, &p, 600);
		assert_int_equal(plan_file_done(f, &d, 1, &err), 0);
		assert_int_equal(leaves_now(), 9);
		assert_int_equal(told_now(&t), 1);
		plan_file_free(f);
	}
	io = &io_system;
	cut_plan_done(&p);
}

/* Where it cannot even be removed, nobody believes it either: an fsync that failed is never tried again. */
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
	assert_int_equal(plan_file_write_later(f, &p, &kept, &err), 0);
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

/* A power cut can leave an empty file of one that nobody had read: no plan, and no damage. */
static void test_empty(void **state)
{
	struct err err = ERR_INIT;
	uint64_t bytes;

	close(openat(dirfd, "plan-7", O_CREAT | O_WRONLY | O_TRUNC, 0600));
	assert_int_equal(leaves_now(), 0);
	assert_int_equal(plan_file_check(dirfd, 7, &bytes, &err), 0);
}

/* Of a new job nothing that is there counts; it goes. What the job wrote stays. */
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
		cmocka_unit_test(test_written_is_read),
		cmocka_unit_test(test_splits),
		cmocka_unit_test(test_torn_split),
		cmocka_unit_test(test_done),
		cmocka_unit_test(test_damage),
		cmocka_unit_test(test_failing_disk),
		cmocka_unit_test(test_later),
		cmocka_unit_test(test_later_lost),
		cmocka_unit_test(test_later_lost_stays),
		cmocka_unit_test(test_empty),
		cmocka_unit_test(test_fresh),
		cmocka_unit_test(test_sweep),
		cmocka_unit_test(test_sweep_writes),
	};

	return cmocka_run_group_tests(tests, setup, teardown);
}
