/*
 * The accounts of the disk over a folder of its own: what is refused and with which numbers, what is evicted first,
 * what never is, and that the accounts follow what others remove.
 */
#include <dirent.h>
#include <fcntl.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>

#include "clock.h"
#include "err.h"
#include "io.h"
#include "space.h"
#include "repeat.h"

#define KIB UINT64_C(1024)

static char folder[64];
static int fd;
static struct space *s;

static void open_with(const char *disk, const char *keep_free)
{
	struct space_params p = {.statefd = fd, .cachefd = fd};
	struct err err = ERR_INIT;

	if (*disk)
		assert_true(space_limit_parse(disk, 100, &p.disk));
	if (*keep_free)
		assert_true(space_limit_parse(keep_free, 99, &p.keep_free));
	assert_int_equal(space_new(&p, &s, &err), 0);
}

static int setup(void **state)
{
	repeat_folder(folder, sizeof folder, "space");
	fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	return fd < 0 || mkdirat(fd, "domains", 0700) || mkdirat(fd, "domains/a", 0700) || mkdirat(fd, "domains/a/b", 0700) ||
	       mkdirat(fd, "selected", 0700) || mkdirat(fd, "datasets", 0700);
}

static int teardown(void **state)
{
	s = space_free(s);
	close(fd);
	return repeat_remove(folder);
}

/* A file that was last used so many seconds ago. */
static void put(const char *name, uint64_t bytes, int seconds_ago)
{
	struct timespec t[2] = {{.tv_sec = time(NULL) - seconds_ago}, {.tv_sec = time(NULL) - seconds_ago}};
	int f = openat(fd, name, O_WRONLY | O_CREAT, 0600);

	assert_true(f >= 0);
	assert_int_equal(ftruncate(f, (off_t)bytes), 0);
	assert_int_equal(futimens(f, t), 0);
	close(f);
}

static bool is_there(const char *name)
{
	struct stat st;

	return fstatat(fd, name, &st, 0) == 0;
}

static void selection(unsigned char number, uint64_t bytes, int seconds_ago, struct digest *ret)
{
	char name[96], hex[DIGEST_HEX_SIZE];

	*ret = digest_hash(&number, 1);
	digest_hex(*ret, hex);
	snprintf(name, sizeof name, "selected/%s", hex);
	assert_int_equal(mkdirat(fd, name, 0700), 0);
	snprintf(name, sizeof name, "selected/%s/points.seg", hex);
	put(name, bytes, 0);
	snprintf(name, sizeof name, "selected/%s/manifest", hex);
	put(name, 10, seconds_ago);
}

static bool selected(struct digest d)
{
	char name[96], hex[DIGEST_HEX_SIZE];

	snprintf(name, sizeof name, "selected/%s", digest_hex(d, hex));
	return is_there(name);
}

static uint64_t bytes_of(enum space_kind kind)
{
	struct space_stat st;

	space_stat(s, &st);
	return st.kind[kind].bytes;
}

static void limits(void **state)
{
	static const char *const bad[] = {"", "%", "101%", "-1%", "80 %", "8O%", "1.5%", "x", "80%%", "0000000080%", "12q"};
	struct space_limit l;
	char text[32];

	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
		if (space_limit_parse(bad[i], 100, &l))
			fail_msg("\"%s\" is taken for a limit", bad[i]);
	assert_true(space_limit_parse("80%", 100, &l));
	assert_int_equal(l.unit, SPACE_PERCENT);
	assert_int_equal(l.n, 80);
	assert_string_equal(space_limit_text(&l, text), "80%");
	assert_false(space_limit_parse("100%", 99, &l));
	assert_true(space_limit_parse("20G", 100, &l));
	assert_int_equal(l.unit, SPACE_BYTES);
	assert_int_equal(l.n, UINT64_C(20) << 30);
	open_with("", "");
}

static void quota_is_refused_with_numbers(void **state)
{
	struct err err = ERR_INIT;
	uint64_t lacks;

	open_with("1M", "");
	space_set_counted(s, SPACE_DATASETS, 600 * KIB);
	assert_int_equal(space_take(s, SPACE_PENDING, 400 * KIB, SPACE_MUST, "the push", &err), 0);
	assert_int_equal(space_take(s, SPACE_PENDING, 100 * KIB, SPACE_MUST, "the push", &err), -ERR_NOSPACE);
	assert_int_equal(err.need, 76 * KIB);
	assert_non_null(strstr(err.message, "the push needs 100"));
	assert_non_null(strstr(err.message, "24"));
	assert_non_null(strstr(err.message, "--disk 1"));
	assert_null(strstr(err.hint, "dataset discard"));
	assert_false(space_would_fit(s, SPACE_PENDING, 100 * KIB, &lacks));
	assert_int_equal(lacks, 76 * KIB);
	/* Temporary files count on the disk of state and cache together. */
	assert_false(space_would_fit(s, SPACE_TEMPORARY, 100 * KIB, &lacks));
	space_give(s, SPACE_PENDING, 400 * KIB);
	assert_true(space_would_fit(s, SPACE_TEMPORARY, 100 * KIB, &lacks));
	err = ERR_INIT;
	/* What a lying header claims does not come round. */
	assert_int_equal(space_take(s, SPACE_PENDING, UINT64_MAX, SPACE_MUST, "the push", &err), -ERR_NOSPACE);
	assert_int_equal(bytes_of(SPACE_PENDING), 0);
	/* Interrupted pushes can be discarded. */
	assert_null(strstr(err.hint, "dataset discard"));
	err = ERR_INIT;
	space_set_counted(s, SPACE_PENDING, 100 * KIB);
	assert_int_equal(space_take(s, SPACE_PENDING, 400 * KIB, SPACE_MUST, "the push", &err), -ERR_NOSPACE);
	assert_non_null(strstr(err.hint, "acutctl dataset discard"));
}

static void keep_free_counts_what_is_promised(void **state)
{
	struct statvfs v;
	struct err err = ERR_INIT;
	char limit[32];
	uint64_t free_bytes, promised = UINT64_C(1) << 30;

	assert_int_equal(fstatvfs(fd, &v), 0);
	free_bytes = (uint64_t)v.f_bavail * v.f_frsize;
	if (free_bytes < 3 * promised)
		skip();
	/* A gigabyte and a half may be written. */
	snprintf(limit, sizeof limit, "%llu", (unsigned long long)(free_bytes - promised * 3 / 2));
	open_with("", limit);
	assert_int_equal(space_take(s, SPACE_PENDING, promised, SPACE_MUST, "a push", &err), 0);
	/* Not written yet: the file system still has it. */
	space_add_unwritten(s, SPACE_PENDING, (int64_t)promised);
	assert_int_equal(space_take(s, SPACE_PENDING, promised, SPACE_MUST, "a push", &err), -ERR_NOSPACE);
	assert_non_null(strstr(err.message, "--keep-free"));
	space_add_unwritten(s, SPACE_PENDING, -(int64_t)promised);
	err = ERR_INIT;
	assert_int_equal(space_take(s, SPACE_PENDING, promised, SPACE_MUST, "a push", &err), 0);
}

static void the_oldest_go_first(void **state)
{
	struct err err = ERR_INIT;
	struct digest sel[2];
	struct space_stat st;

	open_with("1M", "");
	put("domains/d-1", 200 * KIB, 500);
	put("domains/a/d-2", 200 * KIB, 100);
	put("domains/a/b/d-3", 200 * KIB, 300);
	put("datasets/seg", 200 * KIB, 9000);
	selection(1, 200 * KIB, 400, &sel[0]);
	selection(2, 100 * KIB, 50, &sel[1]);
	assert_int_equal(space_measure(s, NULL, &err), 0);
	assert_int_equal(bytes_of(SPACE_DOMAINS), 600 * KIB);
	assert_int_equal(bytes_of(SPACE_SELECTIONS), 300 * KIB + 20);
	/* 900 K are there: 250 K more make 126 too many. One of them goes. */
	assert_int_equal(space_take(s, SPACE_TEMPORARY, 250 * KIB, SPACE_MAY, "it", &err), 0);
	assert_false(is_there("domains/d-1"));
	assert_true(selected(sel[0]) && is_there("domains/a/b/d-3") && is_there("domains/a/d-2") && selected(sel[1]));
	/* 950 K; the selection is the next, then d-3. */
	assert_int_equal(space_take(s, SPACE_TEMPORARY, 300 * KIB, SPACE_MAY, "it", &err), 0);
	assert_false(selected(sel[0]) || is_there("domains/a/b/d-3"));
	assert_true(is_there("domains/a/d-2") && selected(sel[1]) && is_there("datasets/seg"));
	space_stat(s, &st);
	assert_int_equal(st.evicted_files, 3);
	assert_int_equal(st.evicted_bytes, 600 * KIB + 10);
	assert_int_equal(st.kind[SPACE_DOMAINS].entries, 1);
	assert_int_equal(st.kind[SPACE_DOMAINS].bytes, 200 * KIB);
	/* More than all that could go: it is refused, and nothing goes in vain. */
	assert_int_equal(space_take(s, SPACE_PENDING, 2000 * KIB, SPACE_MUST, "it", &err), -ERR_NOSPACE);
	assert_true(is_there("domains/a/d-2") && selected(sel[1]) && is_there("datasets/seg"));
}

/* A pass between the final name of a domain and its commit counts it twice, and the next one corrects that. */
static void a_pass_meets_a_writer(void **state)
{
	struct err err = ERR_INIT;

	open_with("1M", "");
	assert_int_equal(space_measure(s, NULL, &err), 0);
	assert_false(space_is_inexact(s));
	assert_int_equal(space_take(s, SPACE_DOMAINS, 300 * KIB, SPACE_MAY, "a domain", &err), 0);
	put("domains/d-1", 200 * KIB, 0);
	assert_int_equal(space_measure(s, NULL, &err), 0);
	assert_false(space_is_inexact(s)); /* while it is written, measuring does not help */
	space_commit(s, SPACE_DOMAINS, 300 * KIB, 200 * KIB);
	assert_int_equal(bytes_of(SPACE_DOMAINS), 400 * KIB);
	assert_true(space_is_inexact(s));
	assert_int_equal(space_measure(s, NULL, &err), 0);
	assert_int_equal(bytes_of(SPACE_DOMAINS), 200 * KIB);
	assert_false(space_is_inexact(s));
}

static void what_is_in_use_goes_last(void **state)
{
	struct err err = ERR_INIT;
	struct digest sel;
	struct space_stat st;

	open_with("1M", "");
	put("domains/d-old", 300 * KIB, 500);
	put("domains/d-mine", 300 * KIB, 100);
	selection(1, 300 * KIB, 1000, &sel);
	assert_int_equal(space_measure(s, NULL, &err), 0);
	space_hold(s, sel);
	space_hold(s, sel);
	space_release(s, sel);
	space_running_since(s, clock_real_us() - 200 * INT64_C(1000000));
	/* A domain to be stored makes way for nobody who is at work ... */
	assert_int_equal(space_take(s, SPACE_DOMAINS, 400 * KIB, SPACE_MAY, "a domain", &err), 0);
	assert_false(is_there("domains/d-old"));
	assert_true(is_there("domains/d-mine") && selected(sel));
	put("domains/d-new", 400 * KIB, 0);
	assert_int_equal(space_take(s, SPACE_DOMAINS, 400 * KIB, SPACE_MAY, "a domain", &err), -ERR_NOSPACE);
	assert_true(is_there("domains/d-mine") && is_there("domains/d-new") && selected(sel));
	/* ... a push does. */
	err = ERR_INIT;
	assert_int_equal(space_take(s, SPACE_PENDING, 300 * KIB, SPACE_MUST, "a push", &err), 0);
	space_stat(s, &st);
	assert_true(st.state.used <= 1024 * KIB);
	assert_false(selected(sel) && is_there("domains/d-mine"));
	space_release(s, sel);
}

static void over_the_quota(void **state)
{
	struct err err = ERR_INIT;
	uint64_t bytes, files;
	char name[128];

	open_with("1M", "");
	for (int i = 0; i < 700; i++) {
		snprintf(name, sizeof name, "domains/d-%d", i);
		put(name, 4 * KIB, 10000 - i);
	}
	assert_int_equal(space_measure(s, NULL, &err), 0);
	assert_true(space_is_exceeded(s));
	assert_int_equal(space_evict(s, false, &bytes, &files, &err), 0);
	assert_false(space_is_exceeded(s));
	/* With some to spare: 1 M is 256 of them, less a thirty-second of the quota. */
	assert_in_range(files, 700 - 256, 700 - 256 + 8);
	assert_false(is_there("domains/d-440"));
	assert_true(is_there("domains/d-460"));
	assert_int_equal(bytes, bytes_of(SPACE_DOMAINS) == (700 - files) * 4 * KIB ? files * 4 * KIB : 0);
	/* What others remove is seen by the next look. */
	for (int i = 600; i < 700; i++) {
		snprintf(name, sizeof name, "%s/domains/d-%d", folder, i);
		remove(name);
	}
	assert_int_equal(space_measure(s, NULL, &err), 0);
	assert_int_equal(bytes_of(SPACE_DOMAINS), (600 - files) * 4 * KIB);
	assert_int_equal(space_evict(s, true, &bytes, &files, &err), 0);
	assert_int_equal(bytes_of(SPACE_DOMAINS), 0);
	assert_false(is_there("domains/d-599"));
	assert_true(is_there("domains/a/b"));
}

/* What is being written while others look through the folders stays in the accounts, and what one gives back is not
 * taken from the others'. */
static void a_look_beside_what_is_written(void **state)
{
	struct err err = ERR_INIT;
	struct digest d;

	open_with("10M", "");
	put("domains/old", 300 * KIB, 100);
	selection(1, 200 * KIB, 100, &d);
	assert_int_equal(space_measure(s, NULL, &err), 0);
	assert_int_equal(bytes_of(SPACE_SELECTIONS), 200 * KIB + 10);
	assert_int_equal(space_take(s, SPACE_DOMAINS, 90 * KIB, SPACE_MAY, "a domain", &err), 0);
	assert_int_equal(space_take(s, SPACE_SELECTIONS, 500 * KIB, SPACE_MUST, "a selection", &err), 0);
	assert_int_equal(space_measure(s, NULL, &err), 0);
	assert_int_equal(bytes_of(SPACE_DOMAINS), 390 * KIB);
	assert_int_equal(bytes_of(SPACE_SELECTIONS), 700 * KIB + 10);
	/* Half of it is there, under its temporary name: it is in what was taken. What a crash left is in nobody's. */
	put("domains/new.tmp", 40 * KIB, 0);
	put("domains/a/left.tmp", 7 * KIB, 600);
	assert_int_equal(space_measure(s, NULL, &err), 0);
	assert_int_equal(bytes_of(SPACE_DOMAINS), 397 * KIB);
	assert_int_equal(unlinkat(fd, "domains/a/left.tmp", 0), 0);
	assert_int_equal(space_measure(s, NULL, &err), 0);
	assert_int_equal(renameat(fd, "domains/new.tmp", fd, "domains/new"), 0);
	put("domains/new", 80 * KIB, 0);
	space_commit(s, SPACE_DOMAINS, 90 * KIB, 80 * KIB);
	space_commit(s, SPACE_SELECTIONS, 500 * KIB, 0);
	assert_int_equal(bytes_of(SPACE_DOMAINS), 380 * KIB);
	assert_int_equal(bytes_of(SPACE_SELECTIONS), 200 * KIB + 10);
	assert_int_equal(space_measure(s, NULL, &err), 0);
	assert_int_equal(bytes_of(SPACE_DOMAINS), 380 * KIB);
	assert_int_equal(bytes_of(SPACE_SELECTIONS), 200 * KIB + 10);
}

/* What an eviction that failed halfway has left, under the name that the next one wants. */
static void an_eviction_that_failed_before(void **state)
{
	struct err err = ERR_INIT;
	uint64_t bytes, files;
	struct digest d;
	char name[96], hex[DIGEST_HEX_SIZE];

	open_with("1M", "");
	selection(1, 200 * KIB, 100, &d);
	snprintf(name, sizeof name, "selected/tmp-gone-%s", digest_hex(d, hex));
	assert_int_equal(mkdirat(fd, name, 0700), 0);
	snprintf(name, sizeof name, "selected/tmp-gone-%s/x", hex);
	put(name, 10, 0);
	assert_int_equal(space_measure(s, NULL, &err), 0);
	assert_int_equal(space_evict(s, true, &bytes, &files, &err), 0);
	assert_int_equal(files, 1);
	assert_false(selected(d));
	assert_false(is_there(name));
}

static void a_look_that_is_cancelled(void **state)
{
	const atomic_bool stop = true;
	struct err err = ERR_INIT;

	open_with("10M", "");
	put("domains/old", 300 * KIB, 100);
	assert_int_equal(space_measure(s, NULL, &err), 0);
	put("domains/older", 300 * KIB, 200);
	assert_int_equal(space_measure(s, &stop, &err), -ERR_CANCELLED);
	assert_int_equal(bytes_of(SPACE_DOMAINS), 300 * KIB);
	assert_int_equal(space_measure(s, NULL, &err), 0);
	assert_int_equal(bytes_of(SPACE_DOMAINS), 600 * KIB);
}

static void a_cache_that_is_gone(void **state)
{
	struct err err = ERR_INIT;
	uint64_t bytes, files;

	open_with("1M", "");
	assert_int_equal(unlinkat(fd, "domains/a/b", AT_REMOVEDIR) | unlinkat(fd, "domains/a", AT_REMOVEDIR) |
				 unlinkat(fd, "domains", AT_REMOVEDIR) | unlinkat(fd, "selected", AT_REMOVEDIR),
			 0);
	assert_int_equal(space_measure(s, NULL, &err), 0);
	assert_int_equal(space_evict(s, true, &bytes, &files, &err), 0);
	assert_int_equal(files, 0);
}

/* ---- a file system that does not answer ---- */

static struct {
	pthread_mutex_t lock;
	pthread_cond_t changed;
	bool holds, held;
} hang = {.lock = PTHREAD_MUTEX_INITIALIZER, .changed = PTHREAD_COND_INITIALIZER};

static int hanging_fstatvfs(int at, struct statvfs *vfs)
{
	pthread_mutex_lock(&hang.lock);
	hang.held |= hang.holds;
	pthread_cond_broadcast(&hang.changed);
	while (hang.holds)
		pthread_cond_wait(&hang.changed, &hang.lock);
	pthread_mutex_unlock(&hang.lock);
	return fstatvfs(at, vfs);
}

static void *take_one(void *ret)
{
	struct err err = ERR_INIT;

	*(int *)ret = space_take(s, SPACE_PENDING, 100 * KIB, SPACE_MUST, "a push", &err);
	return NULL;
}

/* Writers wait for the file system. Readers of the accounts do not: they get the figures of the last measurement. */
static void a_file_system_that_hangs(void **state)
{
	struct io_table table = *io;
	struct space_stat was, st;
	pthread_t thread;
	uint64_t lacks;
	int taken = 1;

	open_with("1M", "1K");
	space_stat(s, &was);
	table.fstatvfs = hanging_fstatvfs;
	io = &table;
	hang.holds = true;
	assert_int_equal(pthread_create(&thread, NULL, take_one, &taken), 0);
	pthread_mutex_lock(&hang.lock);
	while (!hang.held)
		pthread_cond_wait(&hang.changed, &hang.lock);
	pthread_mutex_unlock(&hang.lock);
	alarm(100); /* a hang of this thread */
	space_set_counted(s, SPACE_DATASETS, 10 * KIB);
	assert_false(space_is_exceeded(s));
	assert_true(space_would_fit(s, SPACE_TEMPORARY, KIB, &lacks));
	space_stat(s, &st);
	assert_int_equal(st.state.total, was.state.total);
	assert_int_equal(st.state.used, 10 * KIB);
	space_query_wait(s, clock_mono_ns(), clock_mono_ns() + 1000000);
	assert_int_equal(taken, 1);
	alarm(0);
	pthread_mutex_lock(&hang.lock);
	hang.holds = false;
	pthread_cond_broadcast(&hang.changed);
	pthread_mutex_unlock(&hang.lock);
	pthread_join(thread, NULL);
	assert_int_equal(taken, 0);
	assert_int_equal(bytes_of(SPACE_PENDING), 100 * KIB);
	io = &io_system;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(limits, setup, teardown),
		cmocka_unit_test_setup_teardown(quota_is_refused_with_numbers, setup, teardown),
		cmocka_unit_test_setup_teardown(keep_free_counts_what_is_promised, setup, teardown),
		cmocka_unit_test_setup_teardown(the_oldest_go_first, setup, teardown),
		cmocka_unit_test_setup_teardown(a_pass_meets_a_writer, setup, teardown),
		cmocka_unit_test_setup_teardown(what_is_in_use_goes_last, setup, teardown),
		cmocka_unit_test_setup_teardown(over_the_quota, setup, teardown),
		cmocka_unit_test_setup_teardown(a_look_beside_what_is_written, setup, teardown),
		cmocka_unit_test_setup_teardown(an_eviction_that_failed_before, setup, teardown),
		cmocka_unit_test_setup_teardown(a_look_that_is_cancelled, setup, teardown),
		cmocka_unit_test_setup_teardown(a_cache_that_is_gone, setup, teardown),
		cmocka_unit_test_setup_teardown(a_file_system_that_hangs, setup, teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
