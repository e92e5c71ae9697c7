/*
 * File helpers with every call of the table made to fail, once or forever, by short transfers, EINTR and errors. The
 * error must have the right file and offset, and nothing may be half published.
 */
#include <setjmp.h>
#include <stdbool.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <dirent.h>
#include <errno.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "clock.h"
#include "err.h"
#include "io.h"
#include "repeat.h"

static char folder[64];
static int dir = -1;
static pthread_t loop; /* the thread that must not wait */

/* The faulty table: the call `fault.at`, counted over all calls, fails with `fault.error`. */
static struct {
	int at, count, error;
	bool short_transfers, interrupts;
} fault;

static bool fails(void)
{
	if (++fault.count != fault.at)
		return false;
	errno = fault.error;
	return true;
}

static bool interrupted(void)
{
	static int turn;

	if (!fault.interrupts || turn++ % 2)
		return false;
	errno = EINTR;
	return true;
}

static size_t cut(size_t n)
{
	return fault.short_transfers && n > 3 ? n / 2 : n;
}

static int f_openat(int d, const char *path, int flags, mode_t mode)
{
	if (interrupted() || fails())
		return -1;
	assert_true(flags & O_CLOEXEC);
	return openat(d, path, flags, mode);
}

static ssize_t f_pread(int fd, void *buf, size_t n, off_t off)
{
	return interrupted() || fails() ? -1 : pread(fd, buf, cut(n), off);
}

static ssize_t f_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	return interrupted() || fails() ? -1 : pwrite(fd, buf, cut(n), off);
}

static int f_fsync(int fd)
{
	return fails() ? -1 : fsync(fd);
}

static int f_renameat(int a, const char *old, int b, const char *name)
{
	return fails() ? -1 : renameat(a, old, b, name);
}

static int f_unlinkat(int d, const char *path, int flags)
{
	return fails() ? -1 : unlinkat(d, path, flags);
}

static int f_mkdirat(int d, const char *path, mode_t mode)
{
	return fails() ? -1 : mkdirat(d, path, mode);
}

static const struct io_table faulty = {
	.openat = f_openat,
	.close = close,
	.read = read,
	.pread = f_pread,
	.pwrite = f_pwrite,
	.fsync = f_fsync,
	.renameat = f_renameat,
	.unlinkat = f_unlinkat,
	.ftruncate = ftruncate,
	.fstat = fstat,
	.mkdirat = f_mkdirat,
};

static void fault_set(int at, int error)
{
	memset(&fault, 0, sizeof fault);
	fault.at = at;
	fault.error = error;
	io = &faulty;
}

static unsigned threads(void)
{
	DIR *tasks = opendir("/proc/self/task");
	unsigned n = 0;

	for (struct dirent *e; (e = readdir(tasks));)
		n += e->d_name[0] != '.';
	closedir(tasks);
	return n;
}

static unsigned alone; /* threads before the first closer */

static void *nothing(void *ctx)
{
	return ctx;
}

static int set_up(void **state)
{
	pthread_t first;

	/* A sanitizer starts its own thread with the first one. */
	if (pthread_create(&first, NULL, nothing, NULL) || pthread_join(first, NULL))
		return -1;
	alone = threads();
	repeat_folder(folder, sizeof folder, "io");
	dir = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	return dir < 0;
}

static int tear_down(void **state)
{
	io = &io_system;
	unlinkat(dir, "a", 0);
	unlinkat(dir, "a.tmp", 0);
	unlinkat(dir, "sub", AT_REMOVEDIR);
	close(dir);
	return rmdir(folder);
}

static bool there(const char *name)
{
	return faccessat(dir, name, F_OK, 0) == 0;
}

/* Writes a file and publishes it, as all storage does. */
static int publish(const char *text, struct err *err)
{
	int fd = -1, rc = io_open(dir, "a.tmp", O_RDWR | O_CREAT | O_TRUNC, 0600, &fd, err);

	if (rc)
		return rc;
	rc = io_write_at(fd, text, strlen(text), 0, "a", err);
	if (rc == 0)
		rc = io_publish(dir, fd, "a.tmp", "a", err);
	else
		unlinkat(dir, "a.tmp", 0);
	assert_int_equal(io_close(fd), -1);
	return rc;
}

static void test_publish_each_fault(void **state)
{
	static const int errors[] = {EIO, ENOSPC, EDQUOT, EACCES, ENOMEM};
	static const enum err_code codes[] = {ERR_IO, ERR_NOSPACE, ERR_NOSPACE, ERR_PERM, ERR_NOMEM};

	for (unsigned e = 0; e < 5; e++) {
		for (int at = 1;; at++) {
			struct err err = ERR_INIT;

			unlinkat(dir, "a", 0);
			fault_set(at, errors[e]);
			int rc = publish("hello, world", &err);

			if (fault.count < at) {
				assert_int_equal(rc, 0);
				assert_true(at > 5); /* open, write, fsync, rename, fsync of the folder */
				break;
			}
			assert_int_equal(rc, -(int)codes[e]);
			assert_int_equal(err.code, codes[e]);
			assert_int_equal(err.sys, errors[e]);
			assert_string_equal(err.file, at == 1 ? "a.tmp" : "a");
			assert_false(there("a.tmp"));
			assert_int_equal(there("a"), at == 5); /* only the last fsync may fail with the file in place */
		}
	}
	io = &io_system;
	(void)state;
}

static void test_short_and_interrupted(void **state)
{
	char text[1000], back[1200];
	struct err err = ERR_INIT;
	size_t got = 0;
	int fd = -1;

	for (size_t i = 0; i < sizeof text; i++)
		text[i] = (char)('a' + i % 26);
	fault_set(0, 0);
	fault.short_transfers = fault.interrupts = true;
	assert_int_equal(io_open(dir, "a", O_RDWR | O_CREAT | O_TRUNC, 0600, &fd, &err), 0);
	assert_int_equal(io_write_at(fd, text, sizeof text, 7, "a", &err), 0);
	assert_int_equal(io_read_at(fd, back, sizeof text, 7, "a", &err), 0);
	assert_memory_equal(text, back, sizeof text);
	assert_int_equal(io_read_some(fd, back, sizeof back, 7, "a", &got, &err), 0);
	assert_int_equal(got, sizeof text);
	assert_int_equal(io_read_at(fd, back, 10, 1000, "a", &err), -ERR_TRUNCATED);
	assert_int_equal(err.offset, 1007);
	assert_string_equal(err.file, "a");
	fd = io_close(fd);
	io = &io_system;
	(void)state;
}

static void test_read_fault(void **state)
{
	struct err err = ERR_INIT;
	size_t got = 99;
	char b[8];
	int fd = -1;

	fault_set(0, 0);
	assert_int_equal(io_open(dir, "a", O_RDWR | O_CREAT, 0600, &fd, &err), 0);
	fault_set(1, EIO);
	assert_int_equal(io_read_some(fd, b, sizeof b, 3, "a", &got, &err), -ERR_IO);
	assert_int_equal(got, 99);
	assert_int_equal(err.offset, 3);
	err_clear(&err);
	assert_int_equal(io_read_some(fd, b, sizeof b, UINT64_MAX - 3, "a", &got, &err), -ERR_INTERNAL);
	io_close(fd);
	io = &io_system;
	(void)state;
}

static void test_remove_and_make_dir(void **state)
{
	struct err err = ERR_INIT;
	int fd = 77;

	fault_set(0, 0);
	assert_int_equal(io_remove(dir, "nothing", &err), 0);
	assert_int_equal(io_make_dir(dir, "sub", 0700, &err), 0);
	assert_int_equal(io_make_dir(dir, "sub", 0700, &err), 0);
	fault_set(1, EROFS);
	assert_int_equal(io_make_dir(dir, "sub", 0700, &err), -ERR_IO);
	err_clear(&err);
	fault_set(1, EPERM);
	assert_int_equal(io_remove(dir, "sub", &err), -ERR_PERM);
	err_clear(&err);
	fault_set(0, 0);
	assert_int_equal(io_open(dir, "missing", O_RDONLY, 0, &fd, &err), -ERR_IO);
	assert_int_equal(fd, 77);
	assert_int_equal(err.sys, ENOENT);
	assert_int_equal(io_close(-1), -1);
	io = &io_system;
	(void)state;
}

static _Atomic int closed, closing;
static _Atomic bool gate;

static bool is_open(int fd)
{
	return fcntl(fd, F_GETFD) >= 0;
}

/* In any thread: holds background closes until the gate is open. */
static int gated_close(int fd)
{
	closing = fd + 1;
	while (!gate && !pthread_equal(pthread_self(), loop))
		usleep(1000);
	closed++;
	return close(fd);
}

/* Files are closed by another thread, which may take its time; pipes and sockets at once, unless they contain unread data. */
static void closes_in_background(void **state)
{
	struct io_table table = io_system;
	struct err err = ERR_INIT;
	int file = memfd_create("x", 0), pipes[2], sockets[2], unread[2], plain = memfd_create("y", 0);

	assert_int_equal(pipe(pipes), 0);
	assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM, 0, sockets), 0);
	assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM, 0, unread), 0);
	assert_int_equal(write(unread[1], "x", 1), 1);
	table.close = gated_close;
	io = &table;
	loop = pthread_self();
	io_close(plain); /* not in the background yet */
	assert_int_equal(closed, 1);
	assert_int_equal(io_close_background(&err), 0);
	assert_int_equal(io_close_background(&err), 0);
	io_close(pipes[0]);
	io_close(pipes[1]);
	io_close(sockets[0]);
	assert_int_equal(closed, 4);
	io_close(file);
	io_close(unread[0]);
	while (closing != file + 1 && closing != unread[0] + 1)
		usleep(1000);
	assert_int_equal(closed, 4);
	assert_true(is_open(file) && is_open(unread[0]));
	gate = true;
	while (closed < 6 || is_open(file))
		usleep(1000);
	io_close_foreground();
	io_close(sockets[1]);
	assert_int_equal(closed, 7);
	io = &io_system;
	close(unread[1]);
}

/* ---- of several owners ---- */

enum { HANGS = 1, OTHER = 2, MOST = 5 };
static _Atomic int hung, answers; /* closes that have begun; that may end */
static int never[MOST];

static int hanging_close(int fd)
{
	for (int i = 0; i < MOST; i++)
		if (fd == never[i]) {
			int n = ++hung;

			while (n > answers)
				usleep(1000);
		}
	return close(fd);
}

/* An owner of files that never close only blocks itself: files of others are closed, and the backlog is reported. */
static void owners_are_independent(void **state)
{
	struct io_table table = io_system;
	struct err err = ERR_INIT;
	uint64_t begin = clock_mono_ns(), first, since;
	int other, noted;

	(void)state;
	table.close = hanging_close;
	io = &table;
	assert_int_equal(io_close_background(&err), 0);
	assert_int_equal(io_close_owner(HANGS), 0);
	for (int i = 0; i < MOST; i++) {
		assert_false(io_close_backlog(HANGS, (size_t)i + 1, &since));
		never[i] = memfd_create("never", 0);
		if (i == MOST - 1) {
			/* Assigned to the owner, and closed by another one. */
			io_close_assign(never[i], HANGS);
			io_close_owner(OTHER);
		}
		io_close(never[i]);
		assert_true(io_close_backlog(HANGS, (size_t)i + 1, &since));
	}
	for (int i = 0; i < 20; i++) {
		other = memfd_create("other", 0);
		io_close(other);
		while (is_open(other))
			usleep(1000);
	}
	assert_int_equal(io_close_owner(0), OTHER);
	while (!hung)
		usleep(1000);
	assert_int_equal(hung, 1);
	/* The time since the first one hangs, however many wait behind it. */
	assert_true(io_close_backlog(HANGS, MOST, &first));
	assert_true(begin <= first && first <= clock_mono_ns());
	usleep(1000);
	assert_true(io_close_backlog(HANGS, MOST, &since));
	assert_int_equal(since, first);
	for (int i = 0; i < MOST; i++)
		assert_true(is_open(never[i]));
	/* The number then belongs to another file. */
	noted = memfd_create("noted", 0);
	io_close_assign(noted, HANGS);
	io_close_foreground();
	io_close(noted);
	assert_int_equal(io_close_background(&err), 0);
	assert_int_equal(memfd_create("again", 0), noted);
	io_close(noted);
	while (is_open(noted))
		usleep(1000);
	/* One hangs, one waits; other threads may have helped meanwhile. */
	while (threads() > alone + 2)
		usleep(1000);
	assert_int_equal(threads(), alone + 2);
	/* The next one's own time counts, not its time in the list. */
	begin = clock_mono_ns();
	answers = 1;
	while (hung < 2)
		usleep(1000);
	assert_true(io_close_backlog(HANGS, MOST - 1, &since));
	assert_true(begin <= since && since <= clock_mono_ns());
	answers = MOST;
	while (io_close_backlog(HANGS, 1, &since) || io_close_backlog(OTHER, 1, &since))
		usleep(1000);
	assert_int_equal(hung, MOST);
	for (int i = 0; i < MOST; i++)
		assert_false(is_open(never[i]));
	/* Helping threads have ended, and are started again. */
	while (threads() > alone + 1)
		usleep(1000);
	io_close_foreground();
	io = &io_system;
}

/* After io_reserve_standard: files do not get these numbers, and reading and writing them fails as if they were closed. */
static int take_standard_in_child(void)
{
	char byte;

	for (int fd = 0; fd <= 2; fd++)
		close(fd);
	io_reserve_standard();
	for (int fd = 0; fd <= 2; fd++)
		if (fcntl(fd, F_GETFD) < 0 || (fd ? write(fd, "x", 1) : read(fd, &byte, 1)) >= 0 || errno != EBADF)
			return 1 + fd;
	return dup(0) > 2 ? 0 : 4;
}

static void takes_standard(void **state)
{
	pid_t child = fork();
	int status;

	assert_true(child >= 0);
	if (!child)
		_exit(take_standard_in_child());
	assert_int_equal(waitpid(child, &status, 0), child);
	assert_int_equal(status, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(takes_standard),
		cmocka_unit_test(test_publish_each_fault),
		cmocka_unit_test(test_short_and_interrupted),
		cmocka_unit_test(test_read_fault),
		cmocka_unit_test(test_remove_and_make_dir),
		cmocka_unit_test(closes_in_background),
		cmocka_unit_test(owners_are_independent),
	};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
