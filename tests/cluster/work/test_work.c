/*
 * The work folder: what is written is read back; of several attempts at a task one counts, also if the answer of its link is
 * lost; files that appear late are waited for; damage is reported, not believed.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cmocka.h>

#include "err.h"
#include "io.h"
#include "work.h"

static char top[64], folder[128];
static struct work *work;

static const char *const WORDS[] = {"mesh", "a b", "line\nfeed", "back\\slash\r", ""};
static const struct work_input INPUTS[] = {
	{"/data/one.laz", 17, INT64_C(1764133333123456789)},
	{"/data/two \n lines.las", UINT64_C(1) << 40, -5},
};

static void check(int r, const struct err *err)
{
	char text[1600];

	if (r)
		fail_msg("%d: %s", r, err_format(err, text, sizeof text));
}

static void make(void)
{
	struct work_about about = {.id = 0xabc, .memory = 64 << 20, .word = WORDS, .nword = 5};
	struct err err = ERR_INIT;

	about.tasks[WORK_HEAD] = 1;
	about.tasks[WORK_MESH] = 3;
	check(work_make(folder, &about, INPUTS, 2, &work, &err), &err);
	work_set_patience(work, 0);
}

static int setup(void **state)
{
	(void)state;
	strcpy(top, "/tmp/acut-work-XXXXXX");
	assert_non_null(mkdtemp(top));
	snprintf(folder, sizeof folder, "%s/work", top);
	make();
	return 0;
}

static int teardown(void **state)
{
	struct err err = ERR_INIT;

	(void)state;
	io = &io_system;
	work = work_close(work);
	return io_folder_remove(AT_FDCWD, top, &err);
}

static struct work_attempt *begin(uint32_t task)
{
	struct work_attempt *a = NULL;
	struct err err = ERR_INIT;

	check(work_begin(work, WORK_MESH, task, &a, &err), &err);
	return a;
}

/* An attempt with one file of 5 bytes. */
static struct work_attempt *begin_with_file(uint32_t task, char name[WORK_NAME])
{
	struct work_attempt *a = begin(task);
	struct err err = ERR_INIT;
	int fd;

	check(work_attempt_file(a, WORK_IN_MESH, "pack", ".x", name, &err), &err);
	fd = openat(work_fd(work), name, O_WRONLY | O_CREAT | O_EXCL, 0666);
	assert_true(fd >= 0);
	assert_int_equal(write(fd, "12345", 5), 5);
	close(fd);
	check(work_result_file(a, name, &err), &err);
	return a;
}

static bool is_there(const char *name)
{
	return faccessat(work_fd(work), name, F_OK, 0) == 0;
}

static void the_beginning_is_read_back(void **state)
{
	const struct work_about *a = work_about(work);
	struct work_input *input;
	struct err err = ERR_INIT;
	size_t n;

	(void)state;
	assert_int_equal(a->id, 0xabc);
	assert_int_equal(a->memory, 64 << 20);
	assert_int_equal(a->tasks[WORK_HEAD], 1);
	assert_int_equal(a->tasks[WORK_SORT], 0);
	assert_int_equal(a->tasks[WORK_MESH], 3);
	assert_int_equal(a->nword, 5);
	for (size_t i = 0; i < 5; i++)
		assert_string_equal(a->word[i], WORDS[i]);
	check(work_inputs(work, &input, &n, &err), &err);
	assert_int_equal(n, 2);
	for (size_t i = 0; i < 2; i++) {
		assert_string_equal(input[i].path, INPUTS[i].path);
		assert_int_equal(input[i].size, INPUTS[i].size);
		assert_int_equal(input[i].mtime_ns, INPUTS[i].mtime_ns);
	}
	free(input);
}

static void a_folder_with_something_is_refused(void **state)
{
	struct work_about about = {.id = 1, .memory = 1};
	struct err err = ERR_INIT;
	struct work *other;

	(void)state;
	assert_int_equal(work_make(folder, &about, NULL, 0, &other, &err), -ERR_CONFLICT);
	assert_non_null(strstr(err.message, "another run"));
	err_clear(&err);
	assert_int_equal(work_make(top, &about, NULL, 0, &other, &err), -ERR_CONFLICT);
	assert_non_null(strstr(err.message, "not empty"));
	err_clear(&err);
	assert_int_equal(work_open(top, &other, &err), -ERR_NOTFOUND);
}

static void a_result_is_read_back(void **state)
{
	struct work_record *rec = NULL;
	struct err err = ERR_INIT;
	char name[WORK_NAME];
	struct work_attempt *a = begin_with_file(2, name);
	uint64_t n;
	int fd;

	(void)state;
	check(work_result_u64(a, "points", 12, &err), &err);
	check(work_result(a, "note", "two\nlines", &err), &err);
	assert_int_equal(work_record_look(work, WORK_MESH, 2, &rec, &err), WORK_E_ABSENT);
	check(work_publish(a, &err), &err);
	a = work_end(a);
	assert_true(is_there(name));
	check(work_record_need(work, WORK_MESH, 2, &rec, &err), &err);
	assert_int_equal(rec->nfile, 1);
	assert_string_equal(rec->file[0].name, name);
	assert_int_equal(rec->file[0].size, 5);
	check(work_record_u64(rec, "points", &n, &err), &err);
	assert_int_equal(n, 12);
	assert_string_equal(work_record_text(rec, "note"), "two\nlines");
	assert_null(work_record_text(rec, "nothing"));
	assert_int_equal(work_record_u64(rec, "note", &n, &err), -ERR_CORRUPT);
	err_clear(&err);
	assert_true(rec->peak > 0 && *rec->host);
	check(work_file_open(work, name, 5, &fd, &err), &err);
	close(fd);
	assert_int_equal(work_file_open(work, name, 4, &fd, &err), -ERR_CORRUPT);
	err_clear(&err);
	assert_int_equal(work_file_open(work, name, 6, &fd, &err), -ERR_CORRUPT);
	err_clear(&err);
	assert_int_equal(work_begin(work, WORK_MESH, 2, &a, &err), WORK_E_DONE);
	work_record_free(rec);
}

static void one_attempt_of_two_counts(void **state)
{
	char first[WORK_NAME], second[WORK_NAME];
	struct work_attempt *a = begin_with_file(0, first), *b = begin_with_file(0, second);
	struct work_record *rec;
	struct err err = ERR_INIT;

	(void)state;
	assert_string_not_equal(first, second);
	check(work_publish(b, &err), &err);
	assert_int_equal(work_publish(a, &err), WORK_E_LOST);
	work_end(a);
	work_end(b);
	assert_false(is_there(first));
	assert_true(is_there(second));
	check(work_record_need(work, WORK_MESH, 0, &rec, &err), &err);
	assert_string_equal(rec->file[0].name, second);
	work_record_free(rec);
}

static void an_attempt_that_ends_leaves_nothing(void **state)
{
	char name[WORK_NAME];

	(void)state;
	work_end(begin_with_file(1, name));
	assert_false(is_there(name));
}

/* The link is made, and the answer says that the name exists: as if a server had repeated the request. */
static int link_twice(int olddir, const char *old, int newdir, const char *name, int flags)
{
	if (!io_system.linkat(olddir, old, newdir, name, flags))
		errno = EEXIST;
	return -1;
}

/* Publishes with this in place of linkat; the file stays, or goes. */
static void publish_by(int (*linkat_)(int, const char *, int, const char *, int), int result, bool stays, struct err *err)
{
	struct io_table table = io_system;
	char name[WORK_NAME];
	struct work_attempt *a = begin_with_file(0, name);

	table.linkat = linkat_;
	io = &table;
	assert_int_equal(work_publish(a, err), result);
	io = &io_system;
	work_end(a);
	assert_int_equal(is_there(name), stays);
}

static void a_link_whose_answer_is_lost_counts(void **state)
{
	struct err err = ERR_INIT;

	publish_by(link_twice, 0, true, &err);
}

/* Nobody knows whether the link was made: the files stay. */
static int link_unknown(int olddir, const char *old, int newdir, const char *name, int flags)
{
	(void)olddir, (void)old, (void)newdir, (void)name, (void)flags;
	errno = EIO;
	return -1;
}

static void after_an_unknown_link_files_stay(void **state)
{
	struct err err = ERR_INIT;

	publish_by(link_unknown, -ERR_IO, true, &err);
}

static int no_links(int olddir, const char *old, int newdir, const char *name, int flags)
{
	(void)olddir, (void)old, (void)newdir, (void)name, (void)flags;
	errno = EPERM;
	return -1;
}

static void no_hard_links_is_said(void **state)
{
	struct err err = ERR_INIT;

	publish_by(no_links, -ERR_PERM, false, &err);
	assert_non_null(strstr(err.hint, "hard links"));
}

/* Processes in a race for one task: exactly one wins, and only its file stays. */
static void many_attempts_at_once(void **state)
{
	enum { MOST = 8 };

	(void)state;
	for (int round = 0; round < 20; round++) {
		int won = 0, status;
		pid_t pid[MOST];

		for (int i = 0; i < MOST; i++) {
			pid[i] = fork();
			assert_true(pid[i] >= 0);
			if (!pid[i]) {
				struct err err = ERR_INIT;
				struct work_attempt *a = NULL;
				char name[WORK_NAME];
				struct work *w;
				int fd, r;

				_Exit(work_open(folder, &w, &err) || (r = work_begin(w, WORK_MESH, 1, &a, &err)) < 0 ||
						      (!r &&
						       (work_attempt_file(a, WORK_IN_MESH, "pack", "", name, &err) ||
							(fd = openat(work_fd(w), name, O_WRONLY | O_CREAT | O_EXCL, 0666)) < 0 ||
							work_result_file(a, name, &err) || (r = work_publish(a, &err)) < 0)) ?
					      3 :
					      (work_end(a), r ? 1 : 0));
			}
		}
		for (int i = 0; i < MOST; i++) {
			assert_int_equal(waitpid(pid[i], &status, 0), pid[i]);
			assert_true(WIFEXITED(status));
			assert_true(WEXITSTATUS(status) < 2);
			won += WEXITSTATUS(status) == 0;
		}
		assert_int_equal(won, 1);
		assert_int_equal(unlinkat(work_fd(work), "done/mesh-1", 0), 0);
	}
}

/* Opening fails as on a node that does not see the file yet. */
static int failures, failure;
static int open_late(int dirfd, const char *path, int flags, mode_t mode)
{
	if (failures > 0 && !(flags & O_CREAT)) {
		failures--;
		errno = failure;
		return -1;
	}
	return io_system.openat(dirfd, path, flags, mode);
}

static void what_is_late_is_waited_for(void **state)
{
	struct io_table table = io_system;
	struct work_record *rec;
	struct err err = ERR_INIT;
	char name[WORK_NAME];
	struct work_attempt *a = begin_with_file(0, name);
	int fd;

	(void)state;
	check(work_publish(a, &err), &err);
	work_end(a);
	table.openat = open_late;
	io = &table;
	work_set_patience(work, 10);
	for (int i = 0; i < 2; i++) {
		failure = i ? ESTALE : ENOENT;
		failures = 3;
		check(work_record_need(work, WORK_MESH, 0, &rec, &err), &err);
		work_record_free(rec);
		failures = 3;
		check(work_file_open(work, name, 5, &fd, &err), &err);
		close(fd);
	}
	work_set_patience(work, 0.1);
	failures = 1000;
	assert_int_equal(work_record_need(work, WORK_MESH, 0, &rec, &err), -ERR_NOTFOUND);
	assert_non_null(strstr(err.message, "task 0 of the phase mesh"));
	err_clear(&err);
	assert_int_equal(work_file_open(work, name, 5, &fd, &err), -ERR_IO);
	failures = 0;
	io = &io_system;
}

/* Every byte of a record, changed or cut off, is noticed. */
static void damage_is_not_believed(void **state)
{
	char bytes[4096], name[WORK_NAME];
	struct work_attempt *a = begin_with_file(0, name);
	struct work_record *rec;
	struct err err = ERR_INIT;
	ssize_t n;
	int fd;

	(void)state;
	check(work_publish(a, &err), &err);
	work_end(a);
	fd = openat(work_fd(work), "done/mesh-0", O_RDWR);
	n = read(fd, bytes, sizeof bytes);
	assert_true(n > 100);
	for (ssize_t i = 0; i < n; i++) {
		char bad = (char)(bytes[i] ^ 1);

		assert_int_equal(pwrite(fd, &bad, 1, i), 1);
		assert_int_equal(work_record_look(work, WORK_MESH, 0, &rec, &err), -ERR_CORRUPT);
		err_clear(&err);
		assert_int_equal(pwrite(fd, bytes + i, 1, i), 1);
	}
	assert_int_equal(work_begin(work, WORK_MESH, 0, &a, &err), WORK_E_DONE);
	for (ssize_t i = n - 1; i >= 0; i--) {
		assert_int_equal(ftruncate(fd, i), 0);
		assert_int_equal(work_record_look(work, WORK_MESH, 0, &rec, &err), -ERR_CORRUPT);
		err_clear(&err);
	}
	assert_int_equal(work_begin(work, WORK_MESH, 0, &a, &err), -ERR_CORRUPT);
	close(fd);
}

static void failures_are_counted(void **state)
{
	struct work_failure f;
	struct err err = ERR_INIT, why = ERR_INIT;

	(void)state;
	err_set(&why, ERR_NOSPACE, "cannot write");
	assert_int_equal(work_failure_look(work, WORK_MESH, 1, &f, &err), WORK_E_ABSENT);
	for (unsigned i = 1; i < 4; i++) {
		struct work_attempt *a = begin(1);

		work_fail(a, &why);
		work_end(a);
		check(work_failure_look(work, WORK_MESH, 1, &f, &err), &err);
		assert_int_equal(f.times, i);
		assert_string_equal(f.message, "cannot write");
		assert_string_equal(f.code, "no-space");
	}
}

static void a_cancelled_run_begins_nothing(void **state)
{
	struct work_attempt *a;
	struct err err = ERR_INIT;

	(void)state;
	check(work_cancel(work, &err), &err);
	assert_true(work_cancelled(work));
	assert_int_equal(work_begin(work, WORK_MESH, 0, &a, &err), -ERR_CANCELLED);
	err_clear(&err);
	check(work_uncancel(work, &err), &err);
	work_end(begin(0));
	assert_int_equal(work_begin(work, WORK_MESH, 3, &a, &err), -ERR_USAGE);
	err_clear(&err);
	assert_int_equal(work_begin(work, WORK_SORT, 0, &a, &err), -ERR_USAGE);
}

static void clean_leaves_what_is_kept(void **state)
{
	static const char *const keep[] = {"dataset", NULL};
	struct err err = ERR_INIT;

	(void)state;
	check(work_clean(work, keep, &err), &err);
	assert_true(is_there("dataset"));
	assert_false(is_there("acut-work"));
	work = work_close(work);
	assert_int_equal(access(folder, F_OK), 0);
	check(io_folder_remove(AT_FDCWD, folder, &err), &err);
	make();
	check(work_clean(work, NULL, &err), &err);
	assert_int_equal(access(folder, F_OK), -1);
}

static int fsyncs_left;

static int full(int fd)
{
	(void)fd;
	if (fsyncs_left--)
		return 0;
	errno = ENOSPC;
	return -1;
}

/* However far it came; also if the folder was there before. What a killed command leaves is in the way of nobody. */
static void a_run_that_cannot_be_made_leaves_nothing(void **state)
{
	struct work_about about = {.id = 0xabc, .memory = 64 << 20, .word = WORDS, .nword = 5};
	struct io_table table = io_system;
	struct err err = ERR_INIT;

	(void)state;
	check(work_clean(work, NULL, &err), &err);
	work = work_close(work);
	table.fsync = full;
	for (int i = 0; i < 4; i++) {
		assert_true(i < 2 || mkdir(folder, 0777) == 0);
		fsyncs_left = i % 2;
		io = &table;
		assert_int_equal(work_make(folder, &about, INPUTS, 2, &work, &err), -ERR_NOSPACE);
		io = &io_system;
		err_clear(&err);
		assert_int_equal(access(folder, F_OK) == 0, i >= 2);
		assert_true(i < 2 || rmdir(folder) == 0);
	}
	assert_int_equal(work_open(folder, &work, &err), -ERR_NOTFOUND);
	err_clear(&err);
	assert_int_equal(mkdir(folder, 0777), 0);
	assert_int_equal(chdir(folder) || mkdir("done", 0777) || mkdir("log", 0777) || chdir("/"), 0);
	make();
}

/* What is not of the run stays, and then all of it. */
static void clean_refuses_strangers(void **state)
{
	static const char *const strange[] = {"mesh.ply", "tiles", "stage-0", "stage-x-0123456789abcdef.seg", "acut-work.bak"};
	static const char *const own[] = {"stage-12-0123456789abcdef.seg.tmp", "spill.17.3.tmp", "script", ".nfs0123"};
	char name[WORK_NAME];
	struct err err = ERR_INIT;
	int fd;

	(void)state;
	work_end(begin_with_file(0, name));
	for (size_t i = 0; i < sizeof strange / sizeof *strange; i++) {
		fd = openat(work_fd(work), strange[i], O_WRONLY | O_CREAT | O_EXCL, 0666);
		assert_true(fd >= 0);
		close(fd);
		assert_int_equal(work_clean(work, NULL, &err), -ERR_CONFLICT);
		assert_non_null(strstr(err.message, strange[i]));
		err_clear(&err);
		assert_true(is_there("acut-work") && is_there("dataset") && is_there(strange[i]));
		assert_int_equal(unlinkat(work_fd(work), strange[i], 0), 0);
	}
	for (size_t i = 0; i < sizeof own / sizeof *own; i++) {
		fd = openat(work_fd(work), own[i], O_WRONLY | O_CREAT | O_EXCL, 0666);
		assert_true(fd >= 0);
		close(fd);
	}
	check(work_clean(work, NULL, &err), &err);
	assert_int_equal(access(folder, F_OK), -1);
}

/* A client of NFS, for files whose name has "open" in it: a process has them open. */
static int remove_on_nfs(int dir, const char *name, int flags)
{
	char rest[80];

	if (!strncmp(name, ".nfs", 4)) {
		errno = EBUSY;
		return -1;
	}
	if (flags || (strcmp(name, "acut-work") != 0 && !strstr(name, "open")))
		return unlinkat(dir, name, flags);
	snprintf(rest, sizeof rest, ".nfs-%s", name);
	return renameat(dir, name, dir, rest);
}

/* The error names what is left of a file that somebody has open, and what to do; with the last process gone, clean ends. */
static void clean_names_a_file_that_is_open(void **state)
{
	static const struct {
		const char *file, *left, *then;
	} of[] = {{"mesh/pack-open", "mesh/.nfs-pack-open", "clean once more"},
		  {"script-open", ".nfs-script-open", "clean once more"},
		  {"acut-work", ".nfs-acut-work", "remove the folder"}};
	struct io_table table = io_system;
	struct err err = ERR_INIT;

	(void)state;
	table.unlinkat = remove_on_nfs;
	for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
		int fd = openat(work_fd(work), of[i].file, O_WRONLY | O_CREAT, 0666);

		close(fd);
		io = &table;
		for (int again = i < 2; again >= 0; again--) {
			assert_int_equal(work_clean(work, NULL, &err), -ERR_CONFLICT);
			assert_non_null(strstr(err.file, of[i].left));
			assert_true(strstr(err.hint, of[i].left) && strstr(err.hint, of[i].then));
			assert_true(is_there(of[i].left));
			/* It is still the folder of a run that is done. */
			assert_true(is_there("acut-work") == (i < 2) && is_there("inputs") == (i < 2) &&
				    is_there("done") == (i < 2));
			err_clear(&err);
		}
		io = &io_system;
		assert_int_equal(unlinkat(work_fd(work), of[i].left, 0), 0);
		if (i < 2)
			check(work_clean(work, NULL, &err), &err);
		else
			assert_int_equal(rmdir(folder), 0);
		work = work_close(work);
		make();
	}
}

/* The folder that was opened, also from another current folder. */
static void clean_means_the_folder_that_was_opened(void **state)
{
	struct err err = ERR_INIT;
	int before = open(".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);

	(void)state;
	assert_true(before >= 0);
	work = work_close(work);
	assert_int_equal(chdir(top), 0);
	assert_int_equal(mkdir("other", 0777) || mkdir("other/work", 0777), 0);
	check(work_open("work", &work, &err), &err);
	assert_int_equal(chdir("other"), 0);
	check(work_clean(work, NULL, &err), &err);
	assert_int_equal(access(folder, F_OK), -1);
	assert_int_equal(access("work", F_OK), 0);
	assert_int_equal(fchdir(before), 0);
	close(before);
}

static void clean_leaves_a_link_and_its_folder(void **state)
{
	char link[160];
	struct err err = ERR_INIT;

	(void)state;
	for (int slash = 0; slash < 2; slash++) {
		work = work_close(work);
		snprintf(link, sizeof link, "%s/link%d", top, slash);
		assert_int_equal(symlink("work", link), 0);
		strcat(link, slash ? "/" : "");
		check(work_open(link, &work, &err), &err);
		check(work_clean(work, NULL, &err), &err);
		assert_false(is_there("acut-work") || is_there("dataset"));
		assert_int_equal(access(link, F_OK), 0);
		work = work_close(work);
		make();
	}
}

int main(void)
{
#define EACH(fn) cmocka_unit_test_setup_teardown(fn, setup, teardown)
	const struct CMUnitTest tests[] = {
		EACH(the_beginning_is_read_back),
		EACH(a_folder_with_something_is_refused),
		EACH(a_result_is_read_back),
		EACH(one_attempt_of_two_counts),
		EACH(an_attempt_that_ends_leaves_nothing),
		EACH(a_link_whose_answer_is_lost_counts),
		EACH(after_an_unknown_link_files_stay),
		EACH(no_hard_links_is_said),
		EACH(many_attempts_at_once),
		EACH(what_is_late_is_waited_for),
		EACH(damage_is_not_believed),
		EACH(failures_are_counted),
		EACH(a_cancelled_run_begins_nothing),
		EACH(a_run_that_cannot_be_made_leaves_nothing),
		EACH(clean_leaves_what_is_kept),
		EACH(clean_refuses_strangers),
		EACH(clean_names_a_file_that_is_open),
		EACH(clean_means_the_folder_that_was_opened),
		EACH(clean_leaves_a_link_and_its_folder),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
