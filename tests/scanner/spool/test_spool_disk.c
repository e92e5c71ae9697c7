/*
 * Spools and the disk: it is full, fsync fails, or is slow; the writer reports it, and what was complete stays.
 */
#include "spool_make.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include "clock.h"
#include "io.h"
#include "spool_priv.h"

static struct io_table table;
static int syncs, sync_error, sync_ms;

static int slow_fsync(int fd)
{
	__atomic_add_fetch(&syncs, 1, __ATOMIC_SEQ_CST);
	usleep((unsigned)sync_ms * 1000);
	if (sync_error) {
		errno = sync_error;
		return -1;
	}
	return 0;
}

static void test_full(void **state)
{
	struct rlimit was, small;
	struct spool_head head;
	struct spool_writer *w;
	struct make_seen seen;
	struct spool_totals totals;
	struct err err = ERR_INIT;
	uint64_t n = 0;

	signal(SIGXFSZ, SIG_IGN);
	make_head(&head);
	assert_int_equal(spool_create(make_path, &head, &w, &err), 0);
	getrlimit(RLIMIT_FSIZE, &was);
	small = was;
	small.rlim_cur = 8192 + 3000;
	setrlimit(RLIMIT_FSIZE, &small);
	for (;; n++) {
		uint8_t at[MAKE_SIZE_MAX];
		size_t size = make_payload(n, at);

		if (spool_append(w, make_kind(n), SPOOL_SHORT, (int64_t)n * 1000, at, size, &err))
			break;
	}
	assert_int_equal(err.code, ERR_IO);
	assert_int_equal(err_exit_status(err.code), 74);
	assert_string_equal(err.file, make_path);
	assert_true(n > 5);
	err = ERR_INIT;
	assert_int_equal(spool_append(w, SPOOL_DATA, 0, 0, "x", 1, &err), -ERR_IO); /* it stays failed */
	assert_true(err.message[0]);
	err = ERR_INIT;
	assert_int_equal(spool_sync(w, &err), 0);
	spool_totals(w, &totals);
	assert_int_equal(totals.durable, totals.bytes);
	setrlimit(RLIMIT_FSIZE, &was);
	spool_writer_free(w);
	make_read_all(make_path, n, &seen);
	assert_int_equal(seen.records, n);
	assert_int_equal(seen.tail.torn, 0); /* the incomplete record was cut off */
	spool_head_clear(&head);
}

static ssize_t no_space(int fd, const void *buf, size_t n, off_t off)
{
	if (off > 8192 + 2000) {
		errno = ENOSPC;
		return -1;
	}
	return pwrite(fd, buf, n > 100 ? 100 : n, off); /* short ones, too */
}

static void test_no_space(void **state)
{
	struct spool_head head = {0};
	struct spool_writer *w;
	struct err err = ERR_INIT;
	struct make_seen seen;
	uint64_t n = 0;
	uint8_t at[MAKE_SIZE_MAX];

	assert_int_equal(spool_create(make_path, &head, &w, &err), 0);
	table = io_system;
	table.pwrite = no_space;
	io = &table;
	while (!spool_append(w, make_kind(n), SPOOL_SHORT, (int64_t)n * 1000, at, make_payload(n, at), &err))
		n++;
	io = &io_system;
	assert_int_equal(err.code, ERR_NOSPACE);
	assert_int_equal(err_exit_status(err.code), 74);
	spool_writer_free(w);
	make_read_all(make_path, n, &seen);
	assert_int_equal(seen.records, n);
	assert_int_equal(seen.tail.torn, 0);
	spool_head_clear(&head);
}

/* No second fsync after a failed one, and no record, either. */
static void test_failed_sync(void **state)
{
	struct spool_head head = {0};
	struct spool_writer *w;
	struct spool_totals totals;
	struct err err = ERR_INIT;

	assert_int_equal(spool_create(make_path, &head, &w, &err), 0);
	assert_int_equal(spool_append(w, SPOOL_DATA, 0, 0, "x", 1, &err), 0);
	table = io_system;
	table.fsync = slow_fsync;
	io = &table;
	syncs = 0;
	sync_ms = 0;
	sync_error = EIO;
	assert_int_equal(spool_sync(w, &err), -ERR_IO);
	sync_error = 0;
	err = ERR_INIT;
	assert_int_equal(spool_sync(w, &err), -ERR_IO);
	assert_int_equal(syncs, 1);
	err = ERR_INIT;
	assert_int_equal(spool_append(w, SPOOL_DATA, 0, 0, "x", 1, &err), -ERR_IO);
	spool_totals(w, &totals);
	assert_int_equal(totals.durable, 0);
	spool_writer_free(w);
}

static int held;

static int held_fsync(int fd)
{
	__atomic_add_fetch(&syncs, 1, __ATOMIC_SEQ_CST);
	while (__atomic_load_n(&held, __ATOMIC_SEQ_CST))
		usleep(1000);
	return 0;
}

/* Once appending waits. */
static void *release(void *ctx)
{
	struct spool_writer *w = ctx;
	uint64_t waits = 0;

	while (!waits || !__atomic_load_n(&syncs, __ATOMIC_SEQ_CST)) {
		usleep(1000);
		pthread_mutex_lock(&w->lock);
		waits = w->totals.waits;
		pthread_mutex_unlock(&w->lock);
	}
	__atomic_store_n(&held, 0, __ATOMIC_SEQ_CST);
	return ctx;
}

/* The thread: a disk that does not answer does not stop the appending until the queue is full, which is counted;
 * everything becomes durable without further calls; failures are reported. */
static void test_flusher(void **state)
{
	struct spool_head head = {0};
	struct spool_writer *w;
	struct spool_totals totals = {0};
	struct err err = ERR_INIT;
	static uint8_t at[1000];
	pthread_t thread;

	assert_int_equal(spool_create(make_path, &head, &w, &err), 0);
	table = io_system;
	table.fsync = held_fsync;
	io = &table;
	syncs = 0;
	held = 1;
	assert_int_equal(spool_flush_start(w, 0.02, 20000, &err), 0);
	pthread_create(&thread, NULL, release, w);
	for (int i = 0; i < 80; i++)
		assert_int_equal(spool_append(w, SPOOL_DATA, 0, 0, at, sizeof(at), &err), 0);
	spool_totals(w, &totals);
	assert_int_equal(totals.durable, 0); /* still held: nothing waited so far */
	assert_int_equal(totals.waits, 0);
	for (int i = 80; i < 160; i++)
		assert_int_equal(spool_append(w, SPOOL_DATA, 0, 0, at, sizeof(at), &err), 0);
	spool_totals(w, &totals);
	assert_true(totals.waits >= 1 && totals.wait_ns > 0);
	assert_true(totals.durable + 80000 >= totals.bytes);
	for (int i = 0; i < 180000 && totals.durable < totals.bytes; i++) {
		usleep(1000);
		spool_totals(w, &totals);
	}
	assert_int_equal(totals.durable, 160000);
	pthread_join(thread, NULL);
	/* And a disk that fails. */
	table.fsync = slow_fsync;
	sync_error = EIO;
	sync_ms = 1;
	for (int i = 0; i < 180000 && !err.code; i++) {
		spool_append(w, SPOOL_DATA, 0, 0, at, 10, &err);
		usleep(1000);
	}
	assert_int_equal(err.code, ERR_IO);
	spool_totals(w, &totals);
	assert_int_equal(totals.durable, 160000);
	spool_writer_free(w);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(test_##name, make_setup, make_teardown)
	const struct CMUnitTest tests[] = {TEST(full), TEST(no_space), TEST(failed_sync), TEST(flusher)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
