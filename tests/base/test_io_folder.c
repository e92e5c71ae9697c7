/*
 * Removing folders: everything below is removed; a link is removed and its target stays; a prefix selects entries; a
 * missing folder is success. A call that fails is an error with the entry's name.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "err.h"
#include "io.h"
#include "repeat.h"

static char folder[64];
static int dirfd;

static int setup(void **state)
{
	repeat_folder(folder, sizeof folder, "folder");
	dirfd = open(folder, O_RDONLY | O_DIRECTORY);
	return dirfd < 0;
}

static int teardown(void **state)
{
	struct err err = ERR_INIT;
	int r = io_folder_empty(dirfd, &err);

	close(dirfd);
	return r || rmdir(folder);
}

static void make_file(const char *path)
{
	int fd = openat(dirfd, path, O_WRONLY | O_CREAT, 0600);

	assert_true(fd >= 0);
	close(fd);
}

static bool is_there(const char *path)
{
	struct stat st;

	return fstatat(dirfd, path, &st, AT_SYMLINK_NOFOLLOW) == 0;
}

static void make_tree(const char *name)
{
	char path[64] = "";

	strcpy(path, name);
	for (unsigned depth = 0; depth < 4; depth++) {
		assert_int_equal(mkdirat(dirfd, path, 0700), 0);
		strcat(path, "/file");
		make_file(path);
		strcpy(strrchr(path, '/'), "/link");
		assert_int_equal(symlinkat(folder, dirfd, path), 0);
		strcpy(strrchr(path, '/'), "/sub");
	}
}

static void everything_is_removed(void **state)
{
	struct err err = ERR_INIT;

	make_file("other");
	make_tree("tree");
	assert_int_equal(io_folder_remove(dirfd, "tree", &err), 0);
	assert_false(is_there("tree"));
	assert_true(is_there("other"));
	assert_int_equal(io_folder_remove(dirfd, "tree", &err), 0);
	assert_int_equal(io_folder_remove(dirfd, "other", &err), 0);
	assert_false(is_there("other"));
}

static void links_are_not_followed(void **state)
{
	struct err err = ERR_INIT;

	make_tree("target");
	assert_int_equal(symlinkat("target", dirfd, "link"), 0);
	assert_int_equal(io_folder_remove(dirfd, "link", &err), 0);
	assert_false(is_there("link"));
	assert_true(is_there("target/sub/sub/sub/file"));
	assert_int_equal(io_folder_remove(dirfd, "target", &err), 0);
}

static void prefix_selects(void **state)
{
	struct err err = ERR_INIT;

	make_tree("tmp-1");
	make_file("tmp-2");
	make_tree("keep");
	make_file("a-tmp-3");
	assert_int_equal(io_folder_sweep(dirfd, "tmp-", &err), 0);
	assert_false(is_there("tmp-1") || is_there("tmp-2"));
	assert_true(is_there("keep/sub/file") && is_there("a-tmp-3"));
	assert_int_equal(io_folder_empty(dirfd, &err), 0);
	assert_false(is_there("keep") || is_there("a-tmp-3"));
}

static const struct io_table *real;
static atomic_bool stop;

/* Another thread ends the removal after one file. */
static int stopping_unlinkat(int fd, const char *path, int flags)
{
	if (!strcmp(path, "file"))
		atomic_store(&stop, true);
	return real->unlinkat(fd, path, flags);
}

static void sweeps_stop(void **state)
{
	struct io_table table;
	struct err err = ERR_INIT;

	real = io;
	table = *io;
	table.unlinkat = stopping_unlinkat;
	make_tree("tmp-1");
	io = &table;
	assert_int_equal(io_folder_sweep_until(dirfd, "tmp-", &stop, &err), -ERR_CANCELLED);
	io = real;
	assert_true(is_there("tmp-1"));
	err_clear(&err);
	stop = false;
	assert_int_equal(io_folder_sweep_until(dirfd, "tmp-", &stop, &err), 0);
	assert_false(is_there("tmp-1"));
}

static int failing_unlinkat(int fd, const char *path, int flags)
{
	if (!strcmp(path, "file") || (flags & AT_REMOVEDIR)) {
		errno = EIO;
		return -1;
	}
	return real->unlinkat(fd, path, flags);
}

static void failed_calls_are_errors(void **state)
{
	struct err err = ERR_INIT;
	struct io_table failing = *io;

	make_tree("tree");
	assert_int_equal(mkdirat(dirfd, "empty", 0700), 0);
	real = io;
	failing.unlinkat = failing_unlinkat;
	io = &failing;
	assert_true(io_folder_remove(dirfd, "tree", &err) < 0);
	assert_non_null(strstr(err.message, "file"));
	err_clear(&err);
	assert_true(io_folder_remove(dirfd, "empty", &err) < 0);
	assert_non_null(strstr(err.message, "empty"));
	io = real;
	assert_true(is_there("tree/file") && is_there("empty"));
	err_clear(&err);
	assert_int_equal(io_folder_empty(dirfd, &err), 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(everything_is_removed),   cmocka_unit_test(links_are_not_followed),
		cmocka_unit_test(prefix_selects),          cmocka_unit_test(sweeps_stop),
		cmocka_unit_test(failed_calls_are_errors),
	};

	return cmocka_run_group_tests(tests, setup, teardown);
}
