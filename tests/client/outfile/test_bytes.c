/*
 * Outputs and their annexes: the same bytes whatever way they take to the file, past the page cache or through it,
 * behind a hole of the same file or copied from another; and errors of each way.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <linux/magic.h>
#include <pthread.h>
#include <semaphore.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>
#include <cmocka.h>

#include "err.h"
#include "outfile.h"
#include "io.h"
#include "repeat.h"

#define FRONT 24
#define BACK 13

static char dir[64];
static char path[80];
static struct io_table table;
static unsigned far_sizes;
static unsigned direct_writes, behind, writes, fail_at, fail_to;
static pthread_t writer; /* the caller of outfile_write */
static pthread_mutex_t counting = PTHREAD_MUTEX_INITIALIZER;
static off_t furthest;

static bool is_direct(int fd)
{
	return fcntl(fd, F_GETFL) & O_DIRECT;
}

static ssize_t count_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	bool fails;

	pthread_mutex_lock(&counting);
	direct_writes += is_direct(fd);
	behind += !pthread_equal(pthread_self(), writer);
	writes++;
	furthest = off > furthest ? off : furthest;
	fails = fail_at && writes >= fail_at && writes < fail_to;
	pthread_mutex_unlock(&counting);
	if (fails) {
		errno = ENOSPC;
		return -1;
	}
	return pwrite(fd, buf, n, off);
}

static ssize_t no_direct_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	if (is_direct(fd)) {
		errno = EINVAL;
		return -1;
	}
	return count_pwrite(fd, buf, n, off);
}

static int no_far_ftruncate(int fd, off_t size)
{
	if (size > 1ll << 36) {
		errno = EFBIG;
		return -1;
	}
	return ftruncate(fd, size);
}

static void record(uint8_t *to, size_t size, uint64_t number)
{
	memset(to, (int)(number % 251), size);
	memcpy(to, &number, sizeof(number));
}

/* Records of both kinds in turns, as a mesh brings them. */

static int count_far_ftruncate(int fd, off_t size)
{
	far_sizes += size > 1ll << 36;
	return ftruncate(fd, size);
}

static size_t join_by = BACK;
static bool fill; /* up to a block, with FILL */
#define FILL 0xee

static int write_both(uint64_t nfront, uint64_t nback, struct err *err)
{
	struct outfile *o = NULL, *annex = NULL;
	uint64_t f = 0, b = 0;
	uint8_t bytes[32];
	int r = outfile_new(path, false, &o, err);

	if (!r)
		r = outfile_annex(o, &annex, err);
	while (!r && (f < nfront || b < nback)) {
		for (unsigned i = 0; i < 1000 && f < nfront && !r; i++) {
			record(bytes, FRONT, f++);
			r = outfile_write(o, bytes, FRONT, err);
		}
		for (unsigned i = 0; i < 2100 && b < nback && !r; i++) {
			void *to = outfile_room(annex, BACK, err);

			record(bytes, BACK, b++);
			if (to)
				memcpy(to, bytes, BACK);
			else
				r = -err->code;
			outfile_used(annex, to ? BACK : 0);
		}
	}
	if (!r && fill)
		r = outfile_pad(o, annex, FILL, err);
	if (!r)
		r = outfile_join(o, annex, join_by, err);
	if (!r)
		r = outfile_patch(o, 8, "patched!", 8, err);
	if (!r)
		r = outfile_publish(o, err);
	outfile_free(annex);
	outfile_free(o);
	return r;
}

static void expect_file(uint64_t nfront, uint64_t nback)
{
	uint64_t front = nfront * FRONT, size, moved = 0;
	struct stat st;
	FILE *f = fopen(path, "rb");
	uint8_t *got, want[32];

	if (fill && nback * BACK > OUTFILE_BUFFER)
		front = (front + 4095) / 4096 * 4096;
	size = front + nback * BACK;
	got = malloc(size + 1);

	assert_non_null(f);
	assert_int_equal(fstat(fileno(f), &st), 0);
	assert_int_equal(st.st_size, size);
	assert_true((uint64_t)st.st_blocks * 512 < size + (64 << 10)); /* nothing else is kept */
	assert_int_equal(fread(got, 1, size + 1, f), size);
	fclose(f);
	for (uint64_t i = 0; i < nfront; i++) {
		record(want, FRONT, i);
		if (i == 0)
			memcpy(want + 8, "patched!", 8);
		assert_memory_equal(got + i * FRONT, want, FRONT);
	}
	if (join_by && nback * BACK > OUTFILE_BUFFER)
		while ((front + moved * BACK) % 4096)
			moved++;
	for (uint64_t i = nfront * FRONT; i < front; i++)
		assert_int_equal(got[i], FILL);
	for (uint64_t i = 0; i < nback; i++) {
		record(want, BACK, (i + nback - moved) % nback);
		assert_memory_equal(got + front + i * BACK, want, BACK);
	}
	free(got);
	assert_int_equal(unlink(path), 0);
}

static const uint64_t size[][2] = {
	{1, 0},         {1, 1},      {10, 80659},      {10, 80660},      {10, 80661},      {43690, 90000},
	{43691, 81000}, {100000, 7}, {150000, 300000}, {150001, 300001}, {149848, 299999},
};

static void each_size(void)
{
	for (size_t i = 0; i < sizeof(size) / sizeof(*size); i++) {
		struct err err = ERR_INIT;

		assert_int_equal(write_both(size[i][0], size[i][1], &err), 0);
		expect_file(size[i][0], size[i][1]);
	}
}

static void start(void)
{
	table = io_system;
	table.pwrite = count_pwrite;
	io = &table;
	writer = pthread_self();
	direct_writes = behind = writes = fail_at = 0;
	furthest = 0;
}

static bool extents(void)
{
	struct statfs fs;

	return !statfs(dir, &fs) && fs.f_type == EXT4_SUPER_MAGIC;
}

static void test_inside(void **state)
{
	start();
	each_size();
	if (extents()) {
		assert_true(direct_writes > 10);
		assert_int_equal(behind, direct_writes);
		assert_true((uint64_t)furthest > OUTFILE_ANNEX_AT);
	}
	io = &io_system;
}

static void test_through_cache(void **state)
{
	start();
	table.pwrite = no_direct_pwrite;
	each_size();
	assert_int_equal(direct_writes, 0);
	io = &io_system;
}

static void test_apart(void **state)
{
	struct rlimit was, limit;

	start();
	table.ftruncate = no_far_ftruncate;
	each_size();
	assert_true((uint64_t)furthest < OUTFILE_ANNEX_AT);
	table.ftruncate = ftruncate;
	/* a limit that the file keeps and the hole would not */
	assert_int_equal(getrlimit(RLIMIT_FSIZE, &was), 0);
	limit = (struct rlimit){1 << 30, was.rlim_max};
	assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
	each_size();
	assert_int_equal(setrlimit(RLIMIT_FSIZE, &was), 0);
	assert_true((uint64_t)furthest < OUTFILE_ANNEX_AT);
	io = &io_system;
}

/* Where a hole may not be one (a memory stick, a share) no file is ever made so large. */
static void test_elsewhere(void **state)
{
	char here[sizeof(path)], there[] = "/dev/shm/acut-bytes-XXXXXX";
	struct statfs fs;

	if (!mkdtemp(there))
		skip();
	if (statfs(there, &fs) || fs.f_type != TMPFS_MAGIC) {
		rmdir(there);
		skip();
	}
	memcpy(here, path, sizeof(here));
	snprintf(path, sizeof(path), "%s/out", there);
	start();
	table.ftruncate = count_far_ftruncate;
	far_sizes = 0;
	each_size();
	assert_int_equal(far_sizes, 0);
	rmdir(there);
	memcpy(path, here, sizeof(here));
	io = &io_system;
}

/* Each write in its turn is the one that finds the disk full, with all that follow or alone. */
static void each_fails(unsigned in_row)
{
	unsigned n;

	start();
	for (n = 1; n < 100; n++) {
		struct err err = ERR_INIT;
		struct dirent *e;
		DIR *d;
		int r;

		writes = 0;
		fail_at = n;
		fail_to = in_row > UINT_MAX - n ? UINT_MAX : n + in_row;
		r = write_both(150000, 300000, &err);
		if (!r)
			break;
		assert_int_equal(r, -ERR_NOSPACE);
		assert_non_null(strstr(err.file, "out"));
		d = opendir(dir);
		while ((e = readdir(d)))
			assert_true(e->d_name[0] == '.' && strlen(e->d_name) <= 2);
		closedir(d);
	}
	assert_in_range(n, 8, 99);
	expect_file(150000, 300000);
	io = &io_system;
}

static sem_t entered, go;
static atomic_bool within, masked;

static ssize_t held_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	sigset_t mask;
	ssize_t r;

	pthread_sigmask(SIG_SETMASK, NULL, &mask);
	masked = sigismember(&mask, SIGINT) == 1;
	within = true;
	sem_post(&entered);
	while (sem_wait(&go))
		;
	r = count_pwrite(fd, buf, n, off);
	within = false;
	return r;
}

static void *let_go(void *arg)
{
	usleep(20000); /* so that outfile_free has begun, or has not waited */
	sem_post(&go);
	sem_post(&go);
	return NULL;
}

/* When an output is freed its thread has ended, and has written no more than it had begun. Signals come to others. */
static void test_freed(void **state)
{
	struct err err = ERR_INIT;
	uint8_t bytes[4096] = {0};
	struct outfile *o;
	pthread_t thread;

	if (!extents())
		skip();
	start();
	table.pwrite = held_pwrite;
	sem_init(&entered, 0, 0);
	sem_init(&go, 0, 0);
	assert_int_equal(outfile_new(path, false, &o, &err), 0);
	for (size_t n = 0; n <= 2 * OUTFILE_BUFFER; n += sizeof(bytes))
		assert_int_equal(outfile_write(o, bytes, sizeof(bytes), &err), 0);
	while (sem_wait(&entered))
		;
	assert_int_equal(pthread_create(&thread, NULL, let_go, NULL), 0);
	outfile_free(o);
	assert_false(within);
	assert_int_equal(writes, 1);
	assert_true(masked);
	pthread_join(thread, NULL);
	io = &io_system;
}

static void test_full(void **state)
{
	each_fails(UINT_MAX);
	each_fails(1);
}

/* Without a size of records the order stays; with a wrong one even the smallest annex is refused. */
static void test_sizes(void **state)
{
	static const size_t wrong[] = {BACK + 1, BACK + 2, 2};

	join_by = 0;
	for (unsigned i = 0; i < sizeof(size) / sizeof(*size); i++) {
		struct err err = ERR_INIT;

		assert_int_equal(write_both(size[i][0], size[i][1], &err), 0);
		expect_file(size[i][0], size[i][1]);
	}
	for (unsigned i = 0; i < sizeof(wrong) / sizeof(*wrong); i++) {
		struct err err = ERR_INIT;

		join_by = wrong[i];
		assert_int_equal(write_both(10, 10, &err), -ERR_INTERNAL);
		assert_int_equal(access(path, F_OK), -1);
	}
	join_by = BACK;
}

/* Behind an output that is filled up to a block nothing is moved, whatever the records are. */
static void test_filled(void **state)
{
	fill = true;
	for (join_by = 0; join_by <= BACK; join_by += BACK) {
		test_inside(state);
		test_through_cache(state);
		test_apart(state);
	}
	fill = false;
	join_by = BACK;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_inside),    cmocka_unit_test(test_through_cache), cmocka_unit_test(test_apart),
		cmocka_unit_test(test_elsewhere), cmocka_unit_test(test_full),          cmocka_unit_test(test_sizes),
		cmocka_unit_test(test_filled),    cmocka_unit_test(test_freed),
	};
	int failed;

	repeat_folder(dir, sizeof dir, "bytes");
	snprintf(path, sizeof(path), "%s/out", dir);
	failed = cmocka_run_group_tests(tests, NULL, NULL);
	unlink(path);
	rmdir(dir);
	return failed;
}
