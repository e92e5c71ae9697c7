/*
 * Every call of libacut against a daemon of a few lines: what is asked arrives, what is answered is handed
 * out, and errors keep all their parts.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "fake.h"

/* An open regular file. */
static int some_file(void)
{
	FILE *f = tmpfile();
	int fd = dup(fileno(f));

	fclose(f);
	return fd;
}

/* ---- */

static void test_small_calls(void **state)
{
	unsigned before = fake_open_descriptors();
	const struct acut_status *status;
	const struct acut_plan *plan;
	const struct acut_job *job;
	struct fake *f;
	struct acut *a = fake_attach(&f, fake_serve_all, NULL, NULL);
	double seconds = -1;

	assert_string_equal(acut_daemon_build(a), "fake 7");
	assert_true(acut_fd(a) >= 0);
	assert_int_equal(acut_ping(a, &seconds), 0);
	assert_true(seconds >= 0);
	assert_int_equal(acut_status(a, &status), 0);
	assert_string_equal(status->version, "1.2");
	assert_string_equal(status->ledger[0].name, "stage");
	assert_int_equal(status->ledger[0].bytes, 4096);
	assert_int_equal(acut_plan(a, "alps", 0, "", &plan), 0);
	assert_int_equal(plan->domains, 17);
	assert_int_equal(acut_submit(a, "alps", 2, "", false, false, &job), 0);
	assert_int_equal(job->id, 42);
	assert_string_equal(job->state, "waiting");
	assert_string_equal(job->progress.phase, "");
	assert_int_equal(acut_job_cancel(a, 9, &job), 0);
	assert_true(job->final);
	assert_int_equal(job->report.triangles, 99);
	assert_string_equal(job->report.removed[0].rule, "withheld");
	assert_int_equal(acut_job_remove(a, 9), 0);
	assert_int_equal(acut_dispatch(a), 0);
	acut_close(a);
	fake_stop(f);
	assert_int_equal(fake_open_descriptors(), before);
}

static void test_error_parts(void **state)
{
	const struct acut_failure *e;
	const struct acut_job *job = NULL;
	struct fake *f;
	struct acut *a = fake_attach(&f, fake_serve_all, NULL, NULL);
	double seconds;

	assert_int_equal(acut_submit(a, "none", 0, "", false, false, &job), -ACUT_E_NOTFOUND);
	assert_null(job);
	e = acut_error(a);
	assert_int_equal(e->code, ACUT_E_NOTFOUND);
	assert_string_equal(e->name, "not-found");
	assert_int_equal(e->exit_status, 4);
	assert_string_equal(e->message, "no such dataset");
	assert_string_equal(e->file, "b.las");
	assert_string_equal(e->field, "points");
	assert_string_equal(e->hint, "do this");
	assert_int_equal(e->offset, 77);
	assert_int_equal(acut_ping(a, &seconds), 0); /* the connection goes on */
	assert_int_equal(acut_error(a)->code, 0);
	acut_close(a);
	fake_stop(f);
	assert_int_equal(acut_error(NULL)->code, ACUT_E_NOMEM);
}

struct seen {
	unsigned calls;
	uint64_t last;
	char text[64];
};

static void see_job(void *ctx, const struct acut_job *job)
{
	struct seen *seen = ctx;

	seen->calls++;
	seen->last = job->id;
	strcpy(seen->text, job->state);
}

static void see_dataset(void *ctx, const struct acut_dataset *d)
{
	struct seen *seen = ctx;

	seen->calls++;
	strcat(seen->text, d->name);
	assert_true(d->min[2] == 3);
}

static void see_progress(void *ctx, const struct acut_progress *p)
{
	struct seen *seen = ctx;

	seen->calls++;
	seen->last = p->points;
	strcpy(seen->text, p->phase);
}

static void test_wait_and_lists(void **state)
{
	const struct acut_job *job;
	struct seen seen = {0};
	struct fake *f;
	struct acut *a = fake_attach(&f, fake_serve_all, NULL, NULL);

	assert_int_equal(acut_job_wait(a, 5, false, NULL, NULL, &job), 0);
	assert_string_equal(job->state, "running");
	assert_int_equal(acut_job_wait(a, 5, true, see_job, &seen, &job), 0);
	assert_int_equal(seen.calls, 2);
	assert_string_equal(job->state, "done");
	assert_true(job->has_report);
	seen = (struct seen){0};
	assert_int_equal(acut_jobs(a, see_job, &seen), 0);
	assert_int_equal(seen.calls, 6); /* 1 3, 4 6, 7 9 */
	assert_int_equal(seen.last, 9);
	seen = (struct seen){0};
	assert_int_equal(acut_datasets(a, NULL, see_dataset, &seen), 0);
	assert_int_equal(seen.calls, 2);
	assert_string_equal(seen.text, "alpsrhine");
	acut_close(a);
	fake_stop(f);
}

static void test_push(void **state)
{
	unsigned before = fake_open_descriptors();
	struct seen seen = {0};
	struct acut_push_options options = {
		.dataset = "alps", .format = "xyz", .progress = see_progress, .ctx = &seen};
	const struct acut_probe *probe;
	const struct acut_file_result *file;
	const struct acut_push_result *done;
	const char *lattice;
	struct acut_push *push;
	struct fake *f;
	struct acut *a = fake_attach(&f, fake_serve_all, NULL, NULL);
	int fd = some_file();

	/* No name is not one step. */
	options.dataset = "";
	assert_int_equal(acut_push_begin(a, &options, &push), -ACUT_E_USAGE);
	assert_int_equal(acut_backup(a, "", NULL), -ACUT_E_NOTFOUND);
	assert_int_equal(acut_dataset_at(a, "", 0, NULL), -ACUT_E_NOTFOUND);
	options.dataset = "alps";
	assert_int_equal(acut_push_begin(a, &options, &push), 0);
	assert_int_equal(acut_push_probe(push, fd, "a\xff.las", &probe), 0);
	assert_string_equal(probe->name, "a?.las");
	assert_string_equal(probe->format, "xyz");
	assert_string_equal(probe->scale[2], "0.001");
	assert_string_equal(probe->offset[0], "");
	assert_true(probe->max[1] == 8);
	assert_int_equal(acut_push_plan(push, &lattice), 0);
	assert_string_equal(lattice, "0.01 0.01 0 0 0");
	assert_int_equal(acut_push_durable(push), 0);
	assert_int_equal(acut_push_file(push, fd, "bad.las", &file), -ACUT_E_TRUNCATED);
	assert_int_equal(acut_push_file(push, fd, "a.las", &file), 0);
	assert_int_equal(file->points, 20);
	assert_true(file->max_shift[0] == 0.5);
	assert_int_equal(seen.calls, 1);
	assert_int_equal(seen.last, 10);
	assert_int_equal(acut_push_durable(push), 1);
	assert_int_equal(acut_push_commit(push, &done), 0);
	assert_int_equal(done->points, 55); /* the fake answers with the push's number */
	assert_int_equal(done->generation, 3);
	assert_null(acut_push_end(push));
	assert_int_equal(acut_info(a, fd, "b.las", NULL, NULL, &probe), 0);
	assert_string_equal(probe->format, "las");
	close(fd);
	acut_close(a);
	fake_stop(f);
	assert_int_equal(fake_open_descriptors(), before);
}

static void test_push_abort(void **state)
{
	struct acut_push_options options = {0};
	const struct acut_file_result *file;
	struct acut_push *push;
	uint64_t aborted = 0;
	struct fake *f;
	struct acut *a = fake_attach(&f, fake_serve_all, &aborted, NULL);
	int fd = some_file(), fds[2];

	assert_int_equal(acut_push_begin(a, &options, &push), 0);
	assert_int_equal(acut_push_file(push, fd, "bad.las", &file), -ACUT_E_TRUNCATED);
	acut_push_end(push);
	assert_int_equal(acut_error(a)->code, ACUT_E_TRUNCATED); /* still why */
	assert_int_equal(aborted, 55);
	assert_int_equal(acut_push_begin(a, &options, &push), 0);
	fake_pipe(fds);
	assert_int_equal(acut_push_file(push, fds[0], "pipe", &file), -ACUT_E_INPUT);
	assert_string_equal(acut_error(a)->file, "pipe");
	close(fds[0]);
	close(fds[1]);
	aborted = 0;
	acut_push_leave(push);
	assert_int_equal(aborted, 0);
	close(fd);
	acut_close(a);
	fake_stop(f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_small_calls),    cmocka_unit_test(test_error_parts),
		cmocka_unit_test(test_wait_and_lists), cmocka_unit_test(test_push),
		cmocka_unit_test(test_push_abort),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
