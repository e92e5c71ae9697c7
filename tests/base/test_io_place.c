/*
 * Links on the path of an output: followed where a kernel with protected_symlinks=1 follows them, whatever the actual
 * setting. Root makes the links of another user and gives them away; without root only own links are tested.
 */
#include <errno.h>
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "err.h"
#include "io.h"
#include "io_place.h"
#include "repeat.h"

enum { OTHER = 3001, THIRD = 3002 };

static char base[64];

static int setup(void **state)
{
	snprintf(base, sizeof base, "/tmp/acut-place-XXXXXX");
	return !mkdtemp(base) || chdir(base) || mkdir("shared", 0700) || chmod("shared", 01777) || mkdir("own", 0700) ||
	       mkdir("own/sub", 0700);
}

static int teardown(void **state)
{
	return chdir("/") || repeat_remove(base);
}

/* "FOLDER NAME" of the result, relative to `base`, or the error. */
static const char *find(const char *path, bool follow)
{
	static char text[4096];
	char link[64], real[2048] = "";
	struct err err = ERR_INIT;
	struct io_place p;

	if (io_place_find(path, follow, &p, &err)) {
		snprintf(text, sizeof text, "%s", err.code == ERR_PERM && !err.sys ? "refused" : strerror(err.sys));
		assert_string_equal(err.file, path);
		assert_true(err.sys || *err.hint);
		return text;
	}
	snprintf(link, sizeof link, "/proc/self/fd/%d", p.dirfd);
	assert_true(readlink(link, real, sizeof real - 1) > 0);
	snprintf(text, sizeof text, "%s %s%s",
		 !strcmp(real, base)                ? "." :
		 !strncmp(real, base, strlen(base)) ? real + strlen(base) + 1 :
						      real,
		 p.name, p.opaque ? " opaque" : "");
	io_place_done(&p);
	return text;
}

static void chown_link(const char *link, uid_t uid)
{
	assert_int_equal(lchown(link, uid, uid), 0);
}

static void plain_paths(void **state)
{
	char whole[128];

	assert_string_equal(find("a.ply", true), ". a.ply");
	assert_string_equal(find("own//sub/./a.ply", true), "own/sub a.ply");
	assert_string_equal(find("own/sub/../a.ply", true), "own a.ply");
	assert_string_equal(find("own/sub/", true), "own/sub ");
	assert_string_equal(find("own", true), ". own");
	assert_string_equal(find("/", true), "/ ");
	snprintf(whole, sizeof whole, "%s/own/a.ply", base);
	assert_string_equal(find(whole, true), "own a.ply");
	assert_string_equal(find("none/a.ply", true), strerror(ENOENT));
	assert_string_equal(find("", true), strerror(ENOENT));
	assert_int_equal(close(open("file", O_WRONLY | O_CREAT, 0600)), 0);
	assert_string_equal(find("file/a.ply", true), strerror(ENOTDIR));
}

static void own_links(void **state)
{
	assert_int_equal(symlink("../own/a.ply", "shared/mine") | symlink("../own", "shared/folder") | symlink("round", "round") |
				 symlink("shared/mine", "twice") | symlink("nowhere/x", "dangling"),
			 0);
	assert_string_equal(find("shared/mine", true), "own a.ply");
	assert_string_equal(find("shared/mine", false), "shared mine");
	assert_string_equal(find("twice", true), "own a.ply");
	assert_string_equal(find("shared/folder/b.ply", true), "own b.ply");
	assert_string_equal(find("shared/folder/b.ply", false), "own b.ply");
	assert_string_equal(find("round", true), strerror(ELOOP));
	assert_string_equal(find("dangling", true), strerror(ENOENT));
}

/* Behind /dev/stdout is a pipe, which has no folder. */
static void links_without_a_path(void **state)
{
	int p[2];
	char path[64], want[96];

	assert_int_equal(pipe(p), 0);
	snprintf(path, sizeof path, "/proc/self/fd/%d", p[1]);
	snprintf(want, sizeof want, "/proc/%d/fd %d opaque", (int)getpid(), p[1]);
	assert_string_equal(find(path, true), want);
	close(p[0]);
	close(p[1]);
}

/* A folder that is replaced by a link to another one after it was checked. */
static int exchanging_openat(int dirfd, const char *name, int flags, mode_t mode)
{
	if (!strcmp(name, "mid") && !rename("own/mid", "own/was"))
		assert_int_equal(symlink("sub", "own/mid"), 0);
	return openat(dirfd, name, flags, mode);
}

static void exchanged_folder(void **state)
{
	struct io_table exchanging = *io;
	const struct io_table *was = io;

	assert_int_equal(mkdir("own/mid", 0700), 0);
	exchanging.openat = exchanging_openat;
	io = &exchanging;
	assert_string_not_equal(find("own/mid/a.ply", true), "own/sub a.ply");
	io = was;
}

/* The current folder may be inaccessible; a path from the root does not need it. */
static void closed_folder(void **state)
{
	uid_t was = geteuid();

	if (was != 0) {
		print_message("skipped: a folder that is closed to us is made by root\n");
		skip();
	}
	assert_int_equal(seteuid(OTHER), 0);
	assert_string_equal(find("/tmp/a.ply", true), "/tmp a.ply");
	assert_string_equal(find("a.ply", true), strerror(EACCES));
	assert_int_equal(seteuid(was), 0);
}

static void links_of_others(void **state)
{
	if (geteuid() != 0) {
		print_message("skipped: links of other users are made by root\n");
		skip();
	}
	/* not sticky: everybody can replace everything anyway */
	assert_int_equal(mkdir("free", 0777) | chmod("free", 0777), 0);
	assert_int_equal(symlink("../own/a.ply", "shared/x") | symlink("../own", "shared/d") | symlink("shared/x", "way") |
				 symlink("../own/a.ply", "free/x"),
			 0);
	chown_link("shared/x", OTHER);
	chown_link("shared/d", OTHER);
	chown_link("free/x", OTHER);
	assert_string_equal(find("shared/x", true), "refused");
	assert_string_equal(find("shared/x", false), "shared x");
	assert_string_equal(find("way", true), "refused");
	assert_string_equal(find("shared/d/a.ply", true), "refused");
	assert_string_equal(find("shared/d/a.ply", false), "refused");
	assert_string_equal(find("shared/d/sub/../a.ply", false), "refused");
	assert_string_equal(find("free/x", true), "own a.ply");
	/* The folder's owner may; other users may not. */
	assert_int_equal(chown("shared", OTHER, OTHER), 0);
	assert_string_equal(find("shared/x", true), "own a.ply");
	assert_int_equal(chown("shared", THIRD, THIRD), 0);
	assert_string_equal(find("shared/x", true), "refused");
	/* Not everybody may write there, so it is up to those who may. */
	assert_int_equal(chmod("shared", 01775), 0);
	assert_string_equal(find("shared/x", true), "own a.ply");
}

static void folders(void **state)
{
	struct err err = ERR_INIT;
	struct stat st;
	bool made;
	int fd;

	assert_int_equal(io_place_folder("own/new/", 0700, &fd, &made, &err), 0);
	assert_true(made);
	close(fd);
	assert_int_equal(symlink("own/new", "link"), 0);
	assert_int_equal(io_place_folder("link", 0700, &fd, &made, &err), 0);
	assert_false(made);
	close(fd);
	assert_int_equal(io_place_folder(".", 0, &fd, &made, &err), 0);
	close(fd);
	assert_true(io_place_folder("none", 0, &fd, &made, &err) && err.sys == ENOENT);
	assert_string_equal(err.file, "none");
	if (geteuid() != 0)
		return;
	assert_int_equal(symlink("../own/planted", "shared/f"), 0);
	chown_link("shared/f", OTHER);
	err = ERR_INIT;
	assert_int_equal(io_place_folder("shared/f", 0700, &fd, &made, &err), -ERR_PERM);
	assert_int_equal(io_place_folder("shared/f/", 0700, &fd, &made, &err), -ERR_PERM);
	assert_true(stat("own/planted", &st) && errno == ENOENT);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(plain_paths, setup, teardown),
		cmocka_unit_test_setup_teardown(own_links, setup, teardown),
		cmocka_unit_test_setup_teardown(links_without_a_path, setup, teardown),
		cmocka_unit_test_setup_teardown(exchanged_folder, setup, teardown),
		cmocka_unit_test_setup_teardown(closed_folder, setup, teardown),
		cmocka_unit_test_setup_teardown(links_of_others, setup, teardown),
		cmocka_unit_test_setup_teardown(folders, setup, teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
