/*
 * The folder of the store: which file systems are refused, what is a store and what is not, whose marker is believed.
 * The kinds of file systems come through the table of file calls.
 */
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <cmocka.h>

#include "err.h"
#include "io.h"
#include "log.h"
#include "marker.h"
#include "place.h"
#include "place_fs.h"
#include "repeat.h"

static char root[64], state_path[128], cache_path[128];
static uint32_t magic;

static int fake_fstatfs(int fd, struct statfs *fs)
{
	int r = fstatfs(fd, fs);

	if (magic)
		fs->f_type = (__typeof__(fs->f_type))magic;
	return r;
}

static int setup(void **state)
{
	static struct io_table table;

	log_init("test", LOG_LEVEL_ERROR);
	table = io_system;
	table.fstatfs = fake_fstatfs;
	io = &table;
	magic = 0;
	repeat_folder(root, sizeof root, "place");
	snprintf(state_path, sizeof state_path, "%s/a/b/state", root);
	snprintf(cache_path, sizeof cache_path, "%s/cache", root);
	return 0;
}

static int teardown(void **state)
{
	io = &io_system;
	return repeat_remove(root);
}

static char *below(const char *name)
{
	static char path[256];

	snprintf(path, sizeof path, "%s/%s", state_path, name);
	return path;
}

static void put(const char *name, const void *bytes, size_t n)
{
	FILE *f = fopen(below(name), "w");

	assert_non_null(f);
	assert_int_equal(fwrite(bytes, 1, n, f), n);
	fclose(f);
}

/* r, of a place that is given back at once. */
static int place(bool init, struct marker *ret, struct err *err)
{
	int fd, lock, r;

	*err = ERR_INIT;
	r = place_state(state_path, init, &fd, &lock, ret, err);
	if (r)
		return r;
	close(fd);
	close(lock);
	return 0;
}

static void network_by_name(void **state)
{
	static const struct {
		uint32_t magic;
		const char *name;
	} bad[] = {{0x6969, "nfs"},    {0xFF534D42, "cifs"}, {0xFE534D42, "smb2"},   {0x517B, "smb"},      {0x5346414F, "afs"},
		   {0x01021997, "9p"}, {0x00C36400, "ceph"}, {0x0BD00BD0, "lustre"}, {0x47504653, "gpfs"}, {0x7461636F, "ocfs2"}};
	static const uint32_t good[] = {0xEF53, 0x58465342, 0x9123683E, 0x2FC12FC1, 0x01021994, 0x794C7630, 0xF2F52010};
	struct marker m;
	struct err err;

	for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
		magic = bad[i].magic;
		assert_int_equal(place(true, &m, &err), -ERR_UNSUPPORTED);
		assert_non_null(strstr(err.message, bad[i].name));
		assert_non_null(strstr(err.hint, "disk of this machine"));
		assert_string_equal(err.file, state_path);
		/* Nothing was left there. */
		assert_int_not_equal(access(below("lock"), F_OK), 0);
		assert_int_not_equal(access(below("acut-state"), F_OK), 0);
		/* The number as a signed long, as some machines have it. */
		assert_string_equal(place_fs_network((uint64_t)(int64_t)(int32_t)bad[i].magic, NULL), bad[i].name);
	}
	for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
		magic = good[i];
		assert_int_equal(place(true, &m, &err), 0);
	}
}

static void fuse_by_mount(void **state)
{
	char path[160], type[64];
	FILE *f;

	snprintf(path, sizeof path, "%s/mountinfo", root);
	f = fopen(path, "w");
	assert_non_null(f);
	fputs("22 1 254:0 / / rw,relatime shared:1 - ext4 /dev/vda rw\n"
	      "30 22 0:51 / /mnt/far\\040away rw,nosuid shared:9 master:1 - fuse.sshfs me@there:/ rw,user_id=0\n"
	      "31 22 0:52 / /mnt/ntfs rw - fuseblk /dev/sdb1 rw\n",
	      f);
	fclose(f);
	place_fs_mount_type(path, 0, 51, type, sizeof type);
	assert_string_equal(type, "fuse.sshfs");
	assert_string_equal(place_fs_network(0x65735546, type), "sshfs");
	place_fs_mount_type(path, 0, 52, type, sizeof type);
	assert_string_equal(type, "fuseblk");
	assert_null(place_fs_network(0x65735546, type));
	place_fs_mount_type(path, 7, 7, type, sizeof type);
	assert_string_equal(type, "");
	assert_null(place_fs_network(0x65735546, NULL));
	assert_null(place_fs_network(0xEF53, "fuse.sshfs"));
}

static void unmounted_is_not_empty(void **state)
{
	struct marker m, again;
	struct err err;
	struct stat st;

	assert_int_equal(place(false, &m, &err), -ERR_IO);
	assert_non_null(strstr(err.message, "an unmounted disk is not an empty store"));
	assert_non_null(strstr(err.hint, "--init"));
	assert_string_equal(err.file, state_path);
	assert_int_not_equal(stat(state_path, &st), 0);
	/* Empty: neither. */
	assert_int_equal(place(true, &m, &err), 0);
	assert_int_equal(unlink(below("acut-state")), 0);
	assert_int_equal(unlink(below("lock")), 0);
	assert_int_equal(place(false, &again, &err), -ERR_IO);
	assert_non_null(strstr(err.message, "no marker"));
	assert_int_not_equal(access(below("lock"), F_OK), 0);
	/* What lies beside is not taken over, told or not. */
	put("precious", "x", 1);
	assert_int_equal(place(true, &again, &err), -ERR_IO);
	assert_non_null(strstr(err.message, "precious"));
	assert_int_not_equal(access(below("acut-state"), F_OK), 0);
	assert_int_equal(unlink(below("precious")), 0);
	/* A file system of its own is empty with this. */
	assert_int_equal(mkdir(below("lost+found"), 0700), 0);
	assert_int_equal(place(true, &again, &err), 0);
	assert_memory_not_equal(m.id, again.id, sizeof m.id);
	/* And stays the same store, told or not. */
	assert_int_equal(place(true, &m, &err), 0);
	assert_memory_equal(m.id, again.id, sizeof m.id);
	assert_int_equal(place(false, &m, &err), 0);
	assert_memory_equal(m.id, again.id, sizeof m.id);
}

static void older_gets_one(void **state)
{
	struct marker m, again;
	struct err err;

	assert_int_equal(place(true, &m, &err), 0);
	put("catalogue.db", "", 0);
	assert_int_equal(unlink(below("acut-state")), 0);
	assert_int_equal(place(false, &m, &err), 0);
	assert_int_equal(place(false, &again, &err), 0);
	assert_memory_equal(m.id, again.id, sizeof m.id);
	/* A catalogue that is gone is not made anew beside datasets. */
	assert_int_equal(unlink(below("catalogue.db")), 0);
	assert_int_equal(mkdir(below("datasets"), 0700), 0);
	assert_int_equal(place(false, &m, &err), 0);
	assert_int_equal(mkdir(below("datasets/1"), 0700), 0);
	assert_int_equal(place(false, &m, &err), -ERR_CORRUPT);
	assert_non_null(strstr(err.message, "catalogue"));
	/* Nor one that is empty, which SQLite takes for a new one; with a marker or without. */
	put("catalogue.db", "", 0);
	assert_int_equal(place(false, &m, &err), -ERR_CORRUPT);
	assert_non_null(strstr(err.message, "catalogue"));
	assert_non_null(strstr(err.hint, "backup"));
	assert_string_equal(err.file, state_path);
	assert_int_equal(unlink(below("acut-state")), 0);
	assert_int_equal(place(true, &m, &err), -ERR_CORRUPT);
	assert_int_not_equal(access(below("acut-state"), F_OK), 0);
	/* One with something in it is read. */
	put("catalogue.db", "x", 1);
	assert_int_equal(place(false, &m, &err), 0);
}

static void marker_is_checked(void **state)
{
	struct marker m;
	struct err err;
	uint8_t good[64], b[64];
	FILE *f;

	assert_int_equal(place(true, &m, &err), 0);
	f = fopen(below("acut-state"), "r");
	assert_int_equal(fread(good, 1, sizeof good + 1, f), sizeof good);
	fclose(f);
	for (size_t i = 0; i < sizeof good; i++) {
		memcpy(b, good, sizeof b);
		b[i] ^= 0x10;
		put("acut-state", b, sizeof b);
		assert_true(place(false, &m, &err) < 0);
		assert_true(err.code == ERR_CORRUPT || err.code == ERR_VERSION);
	}
	for (size_t n = 0; n < sizeof good; n += 9) {
		put("acut-state", good, n);
		assert_int_equal(place(true, &m, &err), -ERR_CORRUPT);
		assert_string_equal(err.file, below("acut-state"));
		assert_non_null(strstr(err.hint, "backup"));
	}
	/* A newer one by name, also where its layout is another. */
	memcpy(b, good, sizeof b);
	b[8] = 2;
	put("acut-state", b, 40);
	assert_int_equal(place(false, &m, &err), -ERR_VERSION);
	assert_non_null(strstr(err.message, "a newer acutd"));
	assert_non_null(strstr(err.message, "version 2"));
	/* Another byte order. */
	memcpy(b, good, sizeof b);
	for (int i = 0; i < 4; i++)
		b[12 + i] = good[15 - i];
	put("acut-state", b, sizeof b);
	assert_int_equal(place(false, &m, &err), -ERR_VERSION);
	assert_non_null(strstr(err.message, "byte order"));
	put("acut-state", good, sizeof good);
	assert_int_equal(place(false, &m, &err), 0);
}

static void cache_knows_whom(void **state)
{
	struct marker a, b, seen;
	struct err err = ERR_INIT;
	int fd, lock;

	assert_int_equal(marker_new(&a, &err), 0);
	assert_int_equal(marker_new(&b, &err), 0);
	assert_memory_not_equal(a.id, b.id, sizeof a.id);
	assert_int_equal(place_cache(cache_path, &fd, &lock, &err), 0);
	assert_int_equal(marker_read(fd, MARKER_CACHE, &seen, &err), MARKER_E_ABSENT);
	assert_int_equal(place_cache_claim(fd, root, &a, &err), 0);
	assert_int_equal(marker_read(fd, MARKER_CACHE, &seen, &err), 0);
	assert_memory_equal(seen.id, a.id, sizeof a.id);
	assert_int_equal(place_cache_claim(fd, root, &b, &err), 0);
	assert_int_equal(marker_read(fd, MARKER_CACHE, &seen, &err), 0);
	assert_memory_equal(seen.id, b.id, sizeof b.id);
	/* A state's marker is no cache's. */
	assert_int_equal(marker_read(fd, MARKER_STATE, &seen, &err), MARKER_E_ABSENT);
	close(fd);
	close(lock);
}

/* Refused with these words, whichever way it is called; NULL: accepted. */
static void apart(const char *state, const char *cache, const char *words)
{
	char a[200], b[200];
	struct err err = ERR_INIT;
	int r;

	snprintf(a, sizeof a, "%s/%s", root, state);
	snprintf(b, sizeof b, "%s/%s", root, cache);
	r = place_check_separate(a, b, false, &err);
	if (!words && r)
		fail_msg("%s, %s: %s", state, cache, err.message);
	if (words && (r != -ERR_USAGE || !strstr(err.message, words) || !strstr(err.file, cache)))
		fail_msg("%s, %s: %d %s: %s", state, cache, r, err.file, err.message);
}

static void cache_is_apart(void **state)
{
	static const char *const folders[] = {"s", "s/datasets", "s/datasets/1", "s/plans", "c", "c/deep", "other"};
	static const char *const is = "is the state folder", *const holds = "lies in the cache folder",
				 *const within = "has what was pushed";
	char path[200], to[200];
	struct err err = ERR_INIT;

	for (size_t i = 0; i < sizeof folders / sizeof *folders; i++) {
		snprintf(path, sizeof path, "%s/%s", root, folders[i]);
		assert_int_equal(mkdir(path, 0700), 0);
	}
	snprintf(path, sizeof path, "%s/link", root);
	snprintf(to, sizeof to, "%s/s", root);
	assert_int_equal(symlink(to, path), 0);
	/* One folder, by any path, there or not. */
	apart("s", "s", is);
	apart("s", "s/", is);
	apart("s", "link", is);
	apart("link/.", "other/../s", is);
	apart("new", "new", is);
	apart("new", ".//new/", is);
	apart("new/x", "other/../new/x", is);
	/* The cache holds the state. */
	apart("c/deep", "c", holds);
	apart("c/new", "c", holds);
	apart("new/s", "new", holds);
	apart("s", "", holds);
	/* The cache in what the store has made, and in what it will make. */
	apart("s", "s/datasets", within);
	apart("s", "s/datasets/1/new", within);
	apart("s", "link/plans", within);
	apart("s", "s/geoids/new", within);
	apart("new", "new/datasets", within);
	/* By names that are made on the way, and left again. */
	apart("s", "no/../s", is);
	apart("s", "s/no/../datasets", within);
	apart("s", "s/no/no/../../datasets/new", within);
	apart("new/no/../x", "new/x", is);
	apart("no/../c/new", "other/no/../../c", holds);
	apart("s", "s/no/../cache", NULL);
	/* What does nobody any harm. */
	apart("s", "c", NULL);
	apart("s", "s/cache", NULL);
	apart("new", "new/cache", NULL);
	apart("new", "newer", NULL);
	apart("newer", "new", NULL);
	apart("s", "new/s", NULL);
	/* A daemon of one command has a state that goes with it. */
	snprintf(path, sizeof path, "%s/c/new", root);
	snprintf(to, sizeof to, "%s/c", root);
	assert_int_equal(place_check_separate(path, to, true, &err), 0);
	assert_int_equal(place_check_separate(to, to, true, &err), -ERR_USAGE);
}

/* The folder is named: there are two, and each has a marker. */
static void newer_cache_is_named(void **state)
{
	struct marker m;
	struct err err = ERR_INIT;
	uint32_t version = 2;
	char path[200];
	int fd, lock, file;

	assert_int_equal(marker_new(&m, &err), 0);
	assert_int_equal(place_cache(cache_path, &fd, &lock, &err), 0);
	assert_int_equal(place_cache_claim(fd, cache_path, &m, &err), 0);
	snprintf(path, sizeof path, "%s/acut-cache", cache_path);
	file = open(path, O_WRONLY);
	assert_int_equal(pwrite(file, &version, sizeof version, 8), (ssize_t)sizeof version);
	close(file);
	assert_int_equal(place_cache_claim(fd, cache_path, &m, &err), -ERR_VERSION);
	assert_string_equal(err.file, path);
	assert_non_null(strstr(err.message, "a newer acutd"));
	close(fd);
	close(lock);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(network_by_name, setup, teardown),
		cmocka_unit_test_setup_teardown(fuse_by_mount, setup, teardown),
		cmocka_unit_test_setup_teardown(unmounted_is_not_empty, setup, teardown),
		cmocka_unit_test_setup_teardown(older_gets_one, setup, teardown),
		cmocka_unit_test_setup_teardown(marker_is_checked, setup, teardown),
		cmocka_unit_test_setup_teardown(cache_knows_whom, setup, teardown),
		cmocka_unit_test_setup_teardown(cache_is_apart, setup, teardown),
		cmocka_unit_test_setup_teardown(newer_cache_is_named, setup, teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
