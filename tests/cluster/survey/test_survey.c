/*
 * The phases from inputs to a dataset: the same content however many tasks there are and however often each is run; nothing is
 * believed of an attempt that ended early.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "io.h"
#include "no_sync.h"
#include "survey_fixture.h"

static void any_number_of_tasks_makes_the_same_dataset(void **state)
{
	static const uint32_t stages[] = {1, 3, 5, FILES, 40};
	struct inputs in = tiles();
	struct survey_params p = params();
	struct content first, c;

	for (unsigned i = 0; i < sizeof stages / sizeof *stages; i++) {
		struct shape shape = {stages[i], 64 << 20, 0};
		struct work *w = make_run(&in, &shape);

		run_all(w, &p);
		c = content_of(w);
		assert_true(c.segments <= stages[i] && c.segments <= FILES);
		assert_int_equal(value_of(w, WORK_COMMIT, 0, "points"), c.points);
		assert_int_equal(value_of(w, WORK_COMMIT, 0, "segments"), c.segments);
		assert_int_equal(value_of(w, WORK_HEAD, 0, "points"), c.points);
		if (!i)
			first = c;
		same(&first, &c);
		work_close(w);
	}
	assert_int_equal(first.points, FILES * 2 * POINTS);
	assert_int_equal(first.sources, FILES);
	for (unsigned i = 0; i < FILES; i++) {
		static char bytes[1 << 20];
		char path[128];
		FILE *f;
		size_t n;

		snprintf(path, sizeof path, "%s/tile%u.xyz", survey_top, i);
		f = fopen(path, "r");
		assert_non_null(f);
		n = fread(bytes, 1, sizeof bytes, f);
		fclose(f);
		assert_true(digest_equal(first.hash[i], digest_hash(bytes, n)));
	}
}

/* The command names them in another order, and one of them twice. */
static void the_order_of_the_inputs_does_not_count(void **state)
{
	struct inputs in = tiles(), turned = {.n = FILES + 1};
	struct survey_params p = params();
	struct shape shape = {4, 64 << 20, 0};
	struct content of[2];

	for (unsigned i = 0; i <= FILES; i++)
		turned.file[i] = in.file[i < FILES ? FILES - 1 - i : 3];
	for (unsigned i = 0; i < 2; i++) {
		struct work *w = make_run(i ? &turned : &in, &shape);

		run_all(w, &p);
		of[i] = content_of(w);
		work_close(w);
	}
	same(&of[0], &of[1]);
}

/* Sources get numbers by place: each task has neighbours. */
static void neighbours_are_staged_together(void **state)
{
	struct inputs in = tiles();
	struct survey_params p = params();
	struct work *w = make_run(&in, &one_stage);
	struct content c;

	run_all(w, &p);
	c = content_of(w);
	/* The tiles of the first two rows and columns: files 0, 1, 4 and 5, which have other names. */
	for (unsigned i = 0; i < 4; i++)
		assert_true(c.id[(i % 2 + i / 2 * 4) * 7 % FILES] <= 4);
	work_close(w);
}

/* Runs beside the segment, in a folder of their own or in the work folder, which is empty of them afterwards. */
static void little_memory_makes_runs(void **state)
{
	static struct inputs in;
	char scratch[128];
	struct content of[2];
	FILE *f;

	in.n = 0;
	add(&in, "large.xyz", "");
	f = fopen(in.path[0], "w");
	for (unsigned i = 0; i < 200000; i++)
		fprintf(f, "%u.25 %u.5 %u\n", i * 7919 % 100000, i * 104729 % 99991, i % 100);
	fclose(f);
	see(&in.file[0]);
	snprintf(scratch, sizeof scratch, "%s/scratch", survey_top);
	assert_int_equal(mkdir(scratch, 0700), 0);
	for (unsigned i = 0; i < 2; i++) {
		struct shape shape = {1, survey_least_bytes(1) + (4 << 20), 0};
		struct survey_params p = params();
		struct work *w = make_run(&in, &shape);
		struct dirent *e;
		DIR *dir;

		p.scratch = i ? scratch : NULL;
		run_all(w, &p);
		of[i] = content_of(w);
		dir = opendir(i ? scratch : work_folder(w));
		while ((e = readdir(dir))) {
			assert_null(strstr(e->d_name, "run"));
			assert_true(!i || *e->d_name == '.');
		}
		closedir(dir);
		work_close(w);
	}
	assert_int_equal(of[0].points, 200000);
	assert_true(digest_equal(of[0].digest, of[1].digest));
}

/* Folders of killed tasks, of any run, go; those of living ones, and what is of others, stays. */
static void left_scratch_is_removed(void **state)
{
	static const char *const names[] = {"acut-ff-stage-3-00000000000000aa", "acut-1b-stage-0-0123456789abcdef",
					    "acut-1b-stage-1-0123456789abcdef", "acut-1b-stage-1-x", "acut-data"};
	struct inputs in = tiles();
	struct survey_params p = params();
	struct work *w = make_run(&in, &one_stage);
	char scratch[128], path[256];
	int living;

	snprintf(scratch, sizeof scratch, "%s/scratch", survey_top);
	assert_int_equal(mkdir(scratch, 0700), 0);
	for (unsigned i = 0; i < 5; i++) {
		snprintf(path, sizeof path, "%s/%s", scratch, names[i]);
		assert_int_equal(mkdir(path, 0700), 0);
		strcat(path, "/run-1");
		close(open(path, O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
	}
	snprintf(path, sizeof path, "%s/%s", scratch, names[2]);
	living = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	assert_int_equal(flock(living, LOCK_EX), 0);
	p.scratch = scratch;
	run_all(w, &p);
	work_close(w);
	for (unsigned i = 0; i < 5; i++) {
		snprintf(path, sizeof path, "%s/%s/run-1", scratch, names[i]);
		assert_int_equal(access(path, F_OK) == 0, i >= 2);
	}
	close(living);
}

/* Segments of ranges of keys in place of those of the stages; the sources are what they were. */
static void sorted_ranges_have_the_same_records(void **state)
{
	static const uint32_t counts[][2] = {{1, 1}, {4, 1}, {4, 3}, {3, 5}, {1, 40}, {7, 7}};
	struct inputs in = tiles();
	struct survey_params p = params();
	struct work *w = make_run(&in, &one_stage);
	struct content unsorted, c;

	run_all(w, &p);
	unsorted = content_of(w);
	work_close(w);
	for (unsigned i = 0; i < sizeof counts / sizeof *counts; i++) {
		struct shape shape = {counts[i][0], 64 << 20, counts[i][1]};
		uint64_t most = 0, sum = 0;

		w = make_run(&in, &shape);
		run_all(w, &p);
		c = content_of(w);
		same(&unsorted, &c);
		assert_true(c.segments <= shape.sorts);
		for (uint32_t k = 0; k < shape.sorts; k++) {
			uint64_t n = value_of(w, WORK_SORT, k, "points");

			most = n > most ? n : most;
			sum += n;
		}
		assert_int_equal(sum, c.points);
		assert_true(most <= c.points / shape.sorts + 2048 * shape.stages); /* a cell of each, at both ends */
		work_close(w);
	}
}

/* Both attempts at every task run at once. */
static void two_attempts_at_once_leave_one_dataset(void **state)
{
	struct inputs in = tiles();
	struct survey_params p = params();
	struct shape shape = {3, 64 << 20, 2};
	struct content alone, twice;
	struct work *w = make_run(&in, &one_stage);

	run_all(w, &p);
	alone = content_of(w);
	work_close(w);
	for (unsigned round = 0; round < 4; round++) {
		char folder[128];
		pid_t child[2];

		w = make_run(&in, &shape);
		snprintf(folder, sizeof folder, "%s", work_folder(w));
		for (unsigned k = 0; k < 2; k++) {
			child[k] = fork();
			if (child[k])
				continue;
			w = open_work(folder);
			run_all(w, &p);
			work_close(w);
			_exit(0);
		}
		for (unsigned k = 0; k < 2; k++) {
			int status;

			assert_int_equal(waitpid(child[k], &status, 0), child[k]);
			assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
		}
		twice = content_of(w);
		same(&alone, &twice);
		assert_int_equal(twice.segments, 2);
		work_close(w);
	}
}

/* Killed while it reads, cancelled while it reads: the next attempt does all of it. */
static void an_attempt_that_ends_early_counts_for_nothing(void **state)
{
	struct inputs in = tiles();
	struct survey_params p = params();
	struct shape shape = {2, 64 << 20, 0};
	struct work *w = make_run(&in, &shape);
	struct err err = ERR_INIT;
	struct work_record *record;
	int status;
	pid_t child;

	check(survey_head(w, &p, &err), &err);
	child = fork();
	if (!child) {
		told.stop = 3;
		told.kills = true;
		survey_stage(w, 0, &p, &err);
		_exit(1);
	}
	assert_int_equal(waitpid(child, &status, 0), child);
	assert_true(WIFSIGNALED(status));
	told.stop = 3;
	assert_int_equal(survey_stage(w, 0, &p, &err), -ERR_CANCELLED);
	assert_int_equal(told.asked, 3);
	told.stop = 0;
	err = ERR_INIT;
	assert_int_equal(work_record_look(w, WORK_STAGE, 0, &record, &err), WORK_E_ABSENT);
	/* Nothing can be committed without it. */
	check(survey_stage(w, 1, &p, &err), &err);
	assert_int_equal(survey_commit(w, &p, &err), -ERR_NOTFOUND);
	err = ERR_INIT;
	run_all(w, &p);
	assert_int_equal(content_of(w).points, FILES * 2 * POINTS);
	work_close(w);
}

static const char *kills_at; /* the first letters of a name */

static int killing_linkat(int from, const char *old, int to, const char *name, int flags)
{
	if (!strncmp(name, kills_at, strlen(kills_at)))
		raise(SIGKILL);
	return io_system.linkat(from, old, to, name, flags);
}

/* Ends when it is to give a file that name. */
static void kill_commit(struct work *w, const struct survey_params *p, const char *at)
{
	struct err err = ERR_INIT;
	pid_t child = fork();
	int status;

	if (!child) {
		kills_at = at;
		no_sync()->linkat = killing_linkat;
		survey_commit(w, p, &err);
		_exit(1);
	}
	assert_int_equal(waitpid(child, &status, 0), child);
	assert_true(WIFSIGNALED(status));
}

static struct work *staged(const struct inputs *in, const struct survey_params *p)
{
	struct work *w = make_run(in, &one_stage);
	struct err err = ERR_INIT;

	check(survey_head(w, p, &err), &err);
	check(survey_stage(w, 0, p, &err), &err);
	return w;
}

/* What it leaves is not taken for a file of the dataset. */
static void a_killed_commit_leaves_a_dataset_that_can_be_imported(void **state)
{
	static const char *const at[] = {"sources", "manifest", "done/commit"};
	struct inputs in = tiles();
	struct survey_params p = params();

	for (unsigned i = 0; i < 3; i++) {
		struct work *w = staged(&in, &p);
		struct err err = ERR_INIT;

		told.left = true;
		kill_commit(w, &p, at[i]);
		check(survey_commit(w, &p, &err), &err);
		assert_int_equal(content_of(w).points, FILES * 2 * POINTS);
		work_close(w);
	}
}

/* The file of sources of the dataset; fails if there are more. */
static void name_of_sources(struct work *w, char ret[64])
{
	int fd = openat(work_fd(w), WORK_IN_DATASET, O_RDONLY | O_DIRECTORY);
	DIR *dir = fdopendir(fd);
	struct dirent *e;

	*ret = 0;
	while ((e = readdir(dir)))
		if (!strncmp(e->d_name, "sources-", 8) && !strchr(e->d_name, '.')) {
			assert_int_equal(*ret, 0);
			snprintf(ret, 64, "%.63s", e->d_name);
		}
	closedir(dir);
	assert_int_not_equal(*ret, 0);
}

static void give(struct work *from, struct work *to, const char *file)
{
	char path[128];

	snprintf(path, sizeof path, WORK_IN_DATASET "/%s", file);
	assert_int_equal(linkat(work_fd(from), path, work_fd(to), path, 0), 0);
}

/* A commit was killed when it had named the file of sources, and then an input changed. */
static void sources_of_other_stages_are_removed(void **state)
{
	struct inputs in = tiles();
	struct survey_params p = params();
	struct work *old = staged(&in, &p), *w;
	struct err err = ERR_INIT;
	char was[64], is[64];

	kill_commit(old, &p, "manifest");
	name_of_sources(old, was);
	in.n--;
	w = staged(&in, &p);
	give(old, w, was);
	told.left = true;
	check(survey_commit(w, &p, &err), &err);
	assert_int_equal(content_of(w).sources, FILES - 1);
	name_of_sources(w, is);
	assert_string_not_equal(is, was);
	work_close(w);
	/* It had its manifest, too: that one stays, with the file that it names. */
	check(survey_commit(old, &p, &err), &err);
	w = staged(&in, &p);
	give(old, w, was);
	give(old, w, "manifest");
	assert_int_equal(survey_commit(w, &p, &err), -ERR_CONFLICT);
	name_of_sources(w, is);
	assert_string_equal(is, was);
	work_close(w);
	work_close(old);
}

/* What is said of the inputs reaches all phases. */
static void degrees_are_projected_in_the_stages(void **state)
{
	static struct inputs in;
	struct survey_params p = params();
	struct shape shape = {2, 64 << 20, 0};
	struct work_record *record = NULL;
	struct err err = ERR_INIT;
	struct content c;
	struct work *w;

	in.n = 0;
	add(&in, "tile0.xyz", "11.5000001 47.25 100\n11.6 47.25 101\n11.5 47.3500009 102\n");
	add(&in, "tile1.xyz", "12.9 47.25 100\n12.95 47.25 101\n12.9 47.28 102\n");
	p.says.assume[0] = "EPSG:4326";
	p.says.utm = "32N";
	w = make_run(&in, &shape);
	run_all(w, &p);
	c = content_of(w);
	assert_int_equal(c.points, 6);
	check(work_record_need(w, WORK_HEAD, 0, &record, &err), &err);
	assert_string_equal(work_record_text(record, "crs"), "EPSG:32632");
	assert_string_equal(work_record_text(record, "zone"), "32N");
	work_record_free(record);
	work_close(w);
	/* Another stage is told something else. */
	w = make_run(&in, &shape);
	check(survey_head(w, &p, &err), &err);
	p.says.assume[0] = NULL;
	assert_true(survey_stage(w, 0, &p, &err) < 0);
	work_close(w);
}

/* Left-out lines and rounded points are counted, and warned of. */
static void what_is_odd_is_counted(void **state)
{
	static struct inputs in;
	struct survey_params p = params();
	struct work_record *record = NULL;
	struct err err = ERR_INIT;
	struct work *w;

	in.n = 0;
	add(&in, "a.xyz", "1.23 2.34 3\n4.11 NaN 6\n2.22 7.001 8\n");
	p.says.scale_xy = "0.01";
	p.says.scale_z = "0.01";
	w = make_run(&in, &one_stage);
	run_all(w, &p);
	assert_int_equal(value_of(w, WORK_COMMIT, 0, "points"), 2);
	assert_int_equal(value_of(w, WORK_COMMIT, 0, "left_out"), 1);
	assert_int_equal(value_of(w, WORK_COMMIT, 0, "moved"), 1);
	check(work_record_need(w, WORK_STAGE, 0, &record, &err), &err);
	assert_non_null(strstr(told.all, "a.xyz: 33 % of its lines"));
	assert_non_null(strstr(work_record_text(record, "warning-1"), "a.xyz: 33 % of its lines"));
	assert_int_equal(told.warned, 1);
	assert_int_equal(value_of(w, WORK_STAGE, 0, "warnings"), 1);
	work_record_free(record);
	work_close(w);
}

static void without_points_there_is_an_empty_dataset(void **state)
{
	static struct inputs in;
	struct survey_params p = params();
	struct shape shape = {2, 64 << 20, 0};
	struct work *w;

	in.n = 0;
	add(&in, "a.xyz", "");
	w = make_run(&in, &shape);
	run_all(w, &p);
	assert_int_equal(content_of(w).points, 0);
	work_close(w);
}

/* ---- calls that fail ---- */

static struct io_table failing;
static unsigned calls, fails_at;

static bool fails(void)
{
	return ++calls == fails_at;
}

#define FAIL(name, type, args, pass, sys)   \
	static type fail_##name args        \
	{                                   \
		if (fails()) {              \
			errno = sys;        \
			return -1;          \
		}                           \
		return io_system.name pass; \
	}

FAIL(pwrite, ssize_t, (int fd, const void *buf, size_t n, off_t off), (fd, buf, n, off), ENOSPC)
FAIL(renameat, int, (int a, const char *x, int b, const char *y), (a, x, b, y), EIO)
FAIL(linkat, int, (int a, const char *x, int b, const char *y, int flags), (a, x, b, y, flags), EIO)

static int fail_fsync(int fd)
{
	errno = EIO;
	return fails() ? -1 : no_sync_call(fd);
}

/* Each of them once: an error, and the next attempt succeeds. */
static void every_write_that_fails_is_an_error(void **state)
{
	struct inputs in = tiles();
	struct survey_params p = params();
	struct shape shape = {2, 64 << 20, 2};
	struct work *w = make_run(&in, &one_stage);
	struct content expected;
	bool failed = true;

	run_all(w, &p);
	expected = content_of(w);
	work_close(w);
	failing = io_system;
	failing.pwrite = fail_pwrite;
	failing.fsync = fail_fsync;
	failing.renameat = fail_renameat;
	failing.linkat = fail_linkat;
	for (fails_at = 1; failed; fails_at++) {
		struct err err = ERR_INIT;
		struct content c;
		int r;

		w = make_run(&in, &shape);
		calls = 0;
		io = &failing;
		r = survey_head(w, &p, &err);
		for (uint32_t i = 0; !r && i < 2; i++)
			r = survey_stage(w, i, &p, &err);
		for (uint32_t i = 0; !r && i < 2; i++)
			r = survey_sort(w, i, &p, &err);
		if (!r)
			r = survey_commit(w, &p, &err);
		no_sync();
		failed = calls >= fails_at;
		assert_true(r <= 0);
		run_all(w, &p);
		c = content_of(w);
		same(&expected, &c);
		work_close(w);
	}
	assert_true(fails_at > 20);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		TEST(any_number_of_tasks_makes_the_same_dataset),
		TEST(the_order_of_the_inputs_does_not_count),
		TEST(neighbours_are_staged_together),
		TEST(little_memory_makes_runs),
		TEST(left_scratch_is_removed),
		TEST(sorted_ranges_have_the_same_records),
		TEST(two_attempts_at_once_leave_one_dataset),
		TEST(an_attempt_that_ends_early_counts_for_nothing),
		TEST(a_killed_commit_leaves_a_dataset_that_can_be_imported),
		TEST(sources_of_other_stages_are_removed),
		TEST(degrees_are_projected_in_the_stages),
		TEST(what_is_odd_is_counted),
		TEST(without_points_there_is_an_empty_dataset),
		TEST(every_write_that_fails_is_an_error),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
