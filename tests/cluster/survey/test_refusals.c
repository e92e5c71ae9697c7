/* What the phases from inputs to a dataset refuse, by name: inputs that changed, are of no use, do not fit, or are not there. */
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "io.h"
#include "no_sync.h"
#include "survey_fixture.h"

static void touch(const char *path)
{
	const struct timespec times[2] = {{.tv_nsec = UTIME_OMIT}, {.tv_sec = 1000000000}};

	assert_int_equal(utimensat(AT_FDCWD, path, times, 0), 0);
}

static void inputs_that_changed_are_refused_by_name(void **state)
{
	struct inputs in = tiles();
	struct survey_params p = params();
	struct work *w = make_run(&in, &one_stage);
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
		w = make_run(&in, &one_stage);
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
	w = make_run(&in, &one_stage);
	unlink(in.path[5]);
	assert_int_equal(mkfifo(in.path[5], 0600), 0);
	err = ERR_INIT;
	alarm(100);
	assert_true(survey_head(w, &p, &err) < 0);
	alarm(0);
	assert_non_null(strstr(told.all, "it is no regular file"));
	work_close(w);
	w = make_run(&in, &one_stage);
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
	w = make_run(&in, &one_stage);
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
	w = make_run(&in, &one_stage);
	assert_int_equal(survey_head(w, &p, &err), -ERR_INPUT);
	assert_non_null(strstr(err.file, "a.las"));
	assert_non_null(strstr(err.message, "b.las"));
	work_close(w);
	/* One of them is right, says a person. */
	p.says.override[0] = "EPSG:25832";
	w = make_run(&in, &one_stage);
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
		snprintf(path[i], sizeof path[i], "%s/input%u.las", survey_top, i);
		file[i] = (struct work_input){.path = path[i], .size = 1000};
	}
	snprintf(folder, sizeof folder, "%s/absent", survey_top);
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

int main(void)
{
	const struct CMUnitTest tests[] = {
		TEST(inputs_that_changed_are_refused_by_name),
		TEST(all_that_cannot_be_used_are_named),
		TEST(absent_inputs_are_waited_for_together),
		TEST(mixed_systems_are_refused),
		TEST(too_little_memory_is_said),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
