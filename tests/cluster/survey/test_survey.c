/*
 * The phases from inputs to a dataset: the same content however many tasks there are and however often each is run, changed and
 * unusable inputs refused by their names, nothing believed of an attempt that ended early.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
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
#include <cmocka.h>

#include "err.h"
#include "grid.h"
#include "no_sync.h"
#include "random.h"
#include "survey.h"

enum { FILES = 12, POINTS = 300 };

static char top[64];
static unsigned runs; /* names of work folders */

/* What the callbacks were told. */
static struct {
	unsigned refused, warned;
	char all[4096]; /* "FILE: MESSAGE" lines */
	uint64_t stop;  /* progress refuses from here on; 0: never */
	bool kills;     /* ... or kills the process */
} told;

static void check(int r, const struct err *err)
{
	char text[1600];

	if (r)
		fail_msg("%d: %s", r, err_format(err, text, sizeof text));
}

static void refused(void *ctx, const struct err *why)
{
	size_t n = strlen(told.all);

	told.refused++;
	snprintf(told.all + n, sizeof told.all - n, "%s: %s\n", why->file, why->message);
}

static void warned(void *ctx, const char *path, const char *text)
{
	size_t n = strlen(told.all);

	told.warned++;
	snprintf(told.all + n, sizeof told.all - n, "%s: %s\n", path, text);
}

static int progress(void *ctx, const char *phase, uint64_t done, uint64_t all)
{
	assert_true(done <= all || !all || !strcmp(phase, "stage"));
	if (!told.stop || done < told.stop || strcmp(phase, "stage"))
		return 0;
	if (told.kills)
		raise(SIGKILL);
	return -1;
}

static struct survey_params params(void)
{
	return (struct survey_params){.progress = progress, .refused = refused, .warned = warned};
}

/* ---- inputs ---- */

struct inputs {
	char path[FILES + 4][128];
	struct work_input file[FILES + 4];
	size_t n;
};

static void see(struct work_input *in)
{
	struct stat st;

	assert_int_equal(stat(in->path, &st), 0);
	in->size = (uint64_t)st.st_size;
	in->mtime_ns = (int64_t)st.st_mtim.tv_sec * 1000000000 + st.st_mtim.tv_nsec;
}

static void add(struct inputs *in, const char *name, const char *text)
{
	char *path = in->path[in->n];
	FILE *f;

	snprintf(path, sizeof in->path[0], "%s/%s", top, name);
	f = fopen(path, "w");
	assert_non_null(f);
	fputs(text, f);
	fclose(f);
	in->file[in->n].path = path;
	see(&in->file[in->n++]);
}

static void put(uint8_t *at, const void *value, size_t n)
{
	memcpy(at, value, n); /* LAS is little-endian, as all machines that acut runs on */
}

/* Three points, LAS 1.2 format 0, with the EPSG number of a projected system. */
static void add_las(struct inputs *in, const char *name, uint16_t epsg, int32_t x)
{
	enum { HEAD = 227, KEYS = 54 + 24 };
	static const double box[6] = {500100, 500000, 5400010, 5400000, 110, 100};
	const uint16_t keys[12] = {1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, epsg};
	uint8_t all[HEAD + KEYS + 60] = "LASF", *at = all + HEAD;
	const uint16_t head = HEAD, key = 34735, bytes = sizeof keys, record = 20;
	const uint32_t start = HEAD + KEYS, n = 3, one = 1;
	FILE *f;

	all[24] = 1;
	all[25] = 2;
	put(all + 94, &head, 2);
	put(all + 96, &start, 4);
	put(all + 100, &one, 4);
	put(all + 105, &record, 2);
	put(all + 107, &n, 4);
	put(all + 111, &n, 4);
	for (int k = 0; k < 3; k++)
		put(all + 131 + 8 * k, &(double){.01}, 8);
	put(all + 179, box, sizeof box);
	strcpy((char *)at + 2, "LASF_Projection");
	put(at + 18, &key, 2);
	put(at + 20, &bytes, 2);
	put(at + 54, keys, sizeof keys);
	for (int i = 0; i < 3; i++) {
		const int32_t p[3] = {50000000 + x + i * 10, 540000000 + i * i, 10000 + i};

		put(all + start + 20 * i, p, sizeof p);
		all[start + 20 * i + 14] = 0x09;
		all[start + 20 * i + 15] = 2;
	}
	add(in, name, "");
	f = fopen(in->path[in->n - 1], "w");
	assert_int_equal(fwrite(all, 1, sizeof all, f), sizeof all);
	fclose(f);
	see(&in->file[in->n - 1]);
}

/* Tiles in rows of four; some have more points than others, and one has none of its own. */
static struct inputs tiles(void)
{
	static struct inputs in;
	static char text[POINTS * 3 * 64];
	uint64_t seed = 7;

	in.n = 0;
	for (unsigned i = 0; i < FILES; i++) {
		unsigned n = POINTS * (1 + i % 3);
		size_t at = 0;
		char name[32];

		for (unsigned k = 0; k < n; k++) {
			unsigned x = (unsigned)random_below(&seed, 10000), y = (unsigned)random_below(&seed, 10000);

			at += (size_t)snprintf(text + at, sizeof text - at, "%u.%02u %u.%02u %u.%u\n",
					       500000 + i % 4 * 100 + x / 100, x % 100, 5400000 + i / 4 * 100 + y / 100, y % 100,
					       100 + k % 50, k % 10);
		}
		snprintf(name, sizeof name, "tile%u.xyz", i * 7 % FILES);
		add(&in, name, text);
	}
	return in;
}

/* ---- runs ---- */

struct shape {
	uint32_t stages;
	uint64_t memory;
	uint32_t sorts;
};

static struct work *open_work(const char *folder)
{
	struct work *w = NULL;
	struct err err = ERR_INIT;

	check(work_open(folder, &w, &err), &err);
	work_set_patience(w, 0);
	return w;
}

static struct work *make_run(const struct inputs *in, const struct shape *shape)
{
	struct work_about about = {.id = 0x1234, .memory = shape->memory};
	char folder[128];
	struct work *w;
	struct err err = ERR_INIT;

	about.tasks[WORK_HEAD] = about.tasks[WORK_COMMIT] = 1;
	about.tasks[WORK_STAGE] = shape->stages;
	about.tasks[WORK_SORT] = shape->sorts;
	snprintf(folder, sizeof folder, "%s/work%u", top, runs++);
	check(work_make(folder, &about, in->file, in->n, &w, &err), &err);
	work_set_patience(w, 0);
	return w;
}

static void run_all(struct work *w, const struct survey_params *p)
{
	struct err err = ERR_INIT;

	check(survey_head(w, p, &err), &err);
	for (uint32_t i = 0; i < work_about(w)->tasks[WORK_STAGE]; i++)
		check(survey_stage(w, i, p, &err), &err);
	for (uint32_t i = 0; i < work_about(w)->tasks[WORK_SORT]; i++)
		check(survey_sort(w, i, p, &err), &err);
	check(survey_commit(w, p, &err), &err);
}

static uint64_t value_of(struct work *w, enum work_phase phase, uint32_t task, const char *key)
{
	struct work_record *record = NULL;
	struct err err = ERR_INIT;
	uint64_t n = 0;

	check(work_record_need(w, phase, task, &record, &err), &err);
	check(work_record_u64(record, key, &n, &err), &err);
	work_record_free(record);
	return n;
}

struct content {
	struct digest digest;
	uint64_t points;
	size_t sources, segments;
	struct digest hash[FILES]; /* of the sources, by their names */
	uint32_t id[FILES];
};

/* Also checks that the folder has what the manifest names, and no more. */
static struct content content_of(struct work *w)
{
	struct content c = {.points = 0};
	const struct grid_manifest *m;
	struct grid *g;
	struct err err = ERR_INIT;
	struct dirent *e;
	size_t files = 0;
	DIR *dir;
	int fd;

	check(io_open(work_fd(w), WORK_IN_DATASET, O_RDONLY | O_DIRECTORY, 0, &fd, &err), &err);
	check(grid_open(fd, "manifest", GRID_NEWEST, NULL, 1 << 20, &g, &err), &err);
	m = grid_manifest(g);
	c.digest = grid_content(g);
	c.points = grid_points(g);
	c.sources = m->nsources;
	c.segments = m->nsegments;
	for (size_t i = 0; i < m->nsources; i++) {
		unsigned k = FILES;

		assert_non_null(m->sources[i].name);
		if (sscanf(m->sources[i].name, "tile%u.xyz", &k) == 1) {
			assert_true(k < FILES);
			c.hash[k] = m->sources[i].hash;
			c.id[k] = m->sources[i].id;
		}
	}
	assert_int_equal(m->ngenerations, 1);
	assert_int_equal(m->generations[0].kind, GRID_PUSH);
	assert_int_equal(m->generations[0].points_added, c.points);
	assert_int_equal(m->generations[0].files, c.sources);
	dir = fdopendir(fd);
	while ((e = readdir(dir)))
		files += *e->d_name != '.';
	assert_int_equal(files, 1 + m->nsegments);
	grid_close(g);
	closedir(dir);
	return c;
}

static void same(const struct content *a, const struct content *b)
{
	assert_true(digest_equal(a->digest, b->digest));
	assert_int_equal(a->points, b->points);
	assert_int_equal(a->sources, b->sources);
	for (unsigned i = 0; i < FILES; i++) {
		assert_true(digest_equal(a->hash[i], b->hash[i]));
		assert_int_equal(a->id[i], b->id[i]);
	}
}

/* ---- tests ---- */

static const struct shape one = {1, 64 << 20, 0};

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

		snprintf(path, sizeof path, "%s/tile%u.xyz", top, i);
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
	struct work *w = make_run(&in, &one);
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
	snprintf(scratch, sizeof scratch, "%s/scratch", top);
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
	struct work *w = make_run(&in, &one);
	char scratch[128], path[256];
	int living;

	snprintf(scratch, sizeof scratch, "%s/scratch", top);
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
	struct work *w = make_run(&in, &one);
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
	struct work *w = make_run(&in, &one);

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
		told.stop = POINTS;
		told.kills = true;
		survey_stage(w, 0, &p, &err);
		_exit(1);
	}
	assert_int_equal(waitpid(child, &status, 0), child);
	assert_true(WIFSIGNALED(status));
	told.stop = POINTS;
	assert_int_equal(survey_stage(w, 0, &p, &err), -ERR_CANCELLED);
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

static void touch(const char *path)
{
	const struct timespec times[2] = {{.tv_nsec = UTIME_OMIT}, {.tv_sec = 1000000000}};

	assert_int_equal(utimensat(AT_FDCWD, path, times, 0), 0);
}

static void inputs_that_changed_are_refused_by_name(void **state)
{
	struct inputs in = tiles();
	struct survey_params p = params();
	struct work *w = make_run(&in, &one);
	struct work_failure why;
	struct err err = ERR_INIT;

	/* Before the head. */
	touch(in.path[5]);
	assert_int_equal(survey_head(w, &p, &err), -ERR_CHANGED);
	assert_non_null(strstr(err.message, in.path[5]));
	assert_int_equal(told.refused, 1);
	assert_int_equal(work_failure_look(w, WORK_HEAD, 0, &why, &err), 0);
	work_close(w);

	/* After it. */
	for (unsigned i = 0; i < 2; i++) {
		see(&in.file[5]);
		w = make_run(&in, &one);
		err = ERR_INIT;
		check(survey_head(w, &p, &err), &err);
		if (i)
			assert_int_equal(truncate(in.path[5], 10), 0);
		else
			utimensat(AT_FDCWD, in.path[5], NULL, 0);
		assert_int_equal(survey_stage(w, 0, &p, &err), -ERR_CHANGED);
		assert_string_equal(err.file, in.path[5]);
		work_close(w);
	}
	/* A pipe has come in its place: nobody waits for a writer. */
	see(&in.file[5]);
	w = make_run(&in, &one);
	unlink(in.path[5]);
	assert_int_equal(mkfifo(in.path[5], 0600), 0);
	err = ERR_INIT;
	alarm(60);
	assert_true(survey_head(w, &p, &err) < 0);
	alarm(0);
	assert_non_null(strstr(told.all, "it is no regular file"));
	work_close(w);
	w = make_run(&in, &one);
	unlink(in.path[5]);
	err = ERR_INIT;
	assert_true(survey_head(w, &p, &err) < 0);
	assert_non_null(strstr(told.all, in.path[5]));
	work_close(w);
}

static void all_that_cannot_be_used_are_named(void **state)
{
	static struct inputs in;
	struct survey_params p = params();
	struct err err = ERR_INIT;
	struct work *w;

	in.n = 0;
	add(&in, "good.xyz", "1 2 3\n4 5 6\n2 7 8\n");
	add(&in, "broken.las", "LASF and no more");
	add(&in, "lines.txt", "acut lines 1\nline\n0 0 0\n1 1 1\n");
	add(&in, "empty.xyz", "");
	w = make_run(&in, &one);
	assert_int_not_equal(survey_head(w, &p, &err), 0);
	assert_non_null(strstr(told.all, "broken.las"));
	assert_non_null(strstr(told.all, "lines.txt"));
	assert_null(strstr(told.all, "good.xyz"));
	assert_non_null(strstr(err.message, "of 4 inputs"));
	work_close(w);
}

static void mixed_systems_are_refused(void **state)
{
	static struct inputs in;
	struct survey_params p = params();
	struct err err = ERR_INIT;
	struct work *w;

	in.n = 0;
	add_las(&in, "b.las", 25832, 0);
	add_las(&in, "a.las", 25833, 5);
	w = make_run(&in, &one);
	assert_int_equal(survey_head(w, &p, &err), -ERR_INPUT);
	assert_non_null(strstr(err.file, "a.las"));
	assert_non_null(strstr(err.message, "b.las"));
	work_close(w);
	/* One of them is right, says a person. */
	p.says.override[0] = "EPSG:25832";
	w = make_run(&in, &one);
	run_all(w, &p);
	assert_int_equal(content_of(w).points, 6);
	work_close(w);
}

enum { MANY = 64 };
static _Atomic unsigned opens[MANY];

static int count_openat(int dirfd, const char *path, int flags, mode_t mode)
{
	const char *name = strstr(path, "/input");
	unsigned i;

	if (name && sscanf(name, "/input%u.las", &i) == 1)
		opens[i]++;
	return io_system.openat(dirfd, path, flags, mode);
}

/* A node that does not see the inputs: it does not wait for each. */
static void absent_inputs_are_waited_for_together(void **state)
{
	static struct work_input file[MANY];
	static char path[MANY][128];
	const struct work_about about = {.id = 1, .memory = 64 << 20, .tasks = {[WORK_HEAD] = 1}};
	struct survey_params p = params();
	char folder[128];
	struct work *w;
	struct err err = ERR_INIT;
	unsigned waited = 0;

	for (unsigned i = 0; i < MANY; i++) {
		snprintf(path[i], sizeof path[i], "%s/input%u.las", top, i);
		file[i] = (struct work_input){.path = path[i], .size = 1000};
	}
	snprintf(folder, sizeof folder, "%s/absent", top);
	check(work_make(folder, &about, file, MANY, &w, &err), &err);
	work_set_patience(w, 1);
	no_sync()->openat = count_openat;
	assert_int_equal(survey_head(w, &p, &err), -ERR_IO);
	assert_int_equal(told.refused, MANY);
	for (unsigned i = 0; i < MANY; i++) {
		assert_true(opens[i] >= 1);
		waited += opens[i] > 1;
	}
	assert_true(waited >= 1 && waited <= 16); /* as many are opened at a time */
	work_close(w);
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
	w = make_run(&in, &one);
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

static void too_little_memory_is_said(void **state)
{
	struct inputs in = tiles();
	struct survey_params p = params();
	struct shape small = {1, survey_least_bytes(FILES) - (2 << 20), 0};
	struct work *w = make_run(&in, &small);
	struct err err = ERR_INIT;

	check(survey_head(w, &p, &err), &err);
	assert_int_equal(survey_stage(w, 0, &p, &err), -ERR_LIMIT);
	assert_true(err.need > small.memory && err.need <= survey_least_bytes(FILES));
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
	struct work *w = make_run(&in, &one);
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

static int setup(void **state)
{
	memset(&told, 0, sizeof told);
	no_sync();
	strcpy(top, "/tmp/acut-survey-XXXXXX");
	return mkdtemp(top) ? 0 : -1;
}

static int teardown(void **state)
{
	struct err err = ERR_INIT;

	io = &io_system;
	return io_folder_remove(AT_FDCWD, top, &err);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)

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
		TEST(inputs_that_changed_are_refused_by_name),
		TEST(all_that_cannot_be_used_are_named),
		TEST(absent_inputs_are_waited_for_together),
		TEST(mixed_systems_are_refused),
		TEST(degrees_are_projected_in_the_stages),
		TEST(what_is_odd_is_counted),
		TEST(without_points_there_is_an_empty_dataset),
		TEST(too_little_memory_is_said),
		TEST(every_write_that_fails_is_an_error),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
