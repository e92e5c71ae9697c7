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

/* A page of three jobs: what their rules removed comes with names, as numbers, and not at all. */
struct told {
	size_t names, numbers;
	bool asked; /* for numbers */
};

static void serve_counts(struct fake *f)
{
	struct told *told = f->ctx;
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	while (fake_recv(f, &id, &m, &fd)) {
		Acut__V1__Jobs jobs = ACUT__V1__JOBS__INIT;
		Acut__V1__Job j[3] = {ACUT__V1__JOB__INIT, ACUT__V1__JOB__INIT, ACUT__V1__JOB__INIT};
		Acut__V1__Job *rows[] = {&j[0], &j[1], &j[2]};
		Acut__V1__Report report[3] = {ACUT__V1__REPORT__INIT, ACUT__V1__REPORT__INIT, ACUT__V1__REPORT__INIT};
		Acut__V1__Removed removed = ACUT__V1__REMOVED__INIT, *list[] = {&removed};
		char *names[] = {"crop", "thin"};
		uint64_t numbers[] = {4, 0, 6};

		if (m->body_case == ACUT__V1__MESSAGE__BODY_HELLO) {
			fake_answer_hello(f, id);
		} else {
			told->asked = m->jobs_request->counts;
			for (unsigned i = 0; i < 3; i++) {
				j[i].id = i + 1;
				j[i].report = &report[i];
			}
			removed.rule = "every";
			removed.count = 9;
			report[0].n_removed = 1;
			report[0].removed = list;
			report[1].n_removed_counts = told->numbers;
			report[1].removed_counts = numbers;
			jobs.n_rules = told->names;
			jobs.rules = names;
			jobs.n_jobs = 3;
			jobs.jobs = rows;
			fake_send(f, id, FRAME_MESSAGE(JOBS, jobs, &jobs), -1);
		}
		frame_message_free(m);
	}
}

static void see_removed(void *ctx, const struct acut_job *job)
{
	struct seen *seen = ctx;
	const struct acut_report *p = &job->report;

	seen->calls++;
	for (size_t i = 0; i < p->nremoved; i++) {
		size_t n = strlen(seen->text);

		snprintf(seen->text + n, sizeof seen->text - n, "%u %s %u;", (unsigned)job->id, p->removed[i].rule,
			 (unsigned)p->removed[i].count);
	}
}

static void test_counts(void **state)
{
	static const struct {
		struct told told;
		const char *text; /* NULL: the daemon is at fault */
	} row[] = {
		{{2, 2, false}, "1 every 9;2 crop 4;2 thin 0;"},
		{{2, 1, false}, "1 every 9;2 crop 4;"},
		{{0, 0, false}, "1 every 9;"},
		{{2, 3, false}, NULL},
		{{0, 1, false}, NULL},
	};

	for (unsigned i = 0; i < sizeof row / sizeof *row; i++) {
		struct told told = row[i].told;
		struct seen seen = {0};
		struct fake *f;
		struct acut *a = fake_attach(&f, serve_counts, &told, NULL);
		int r = acut_jobs(a, see_removed, &seen);

		assert_true(told.asked);
		assert_int_equal(r, row[i].text ? 0 : -ERR_PROTO);
		assert_int_equal(seen.calls, row[i].text ? 3 : 1);
		assert_string_equal(seen.text, row[i].text ? row[i].text : "1 every 9;");
		acut_close(a);
		fake_stop(f);
	}
}

static void test_push(void **state)
{
	unsigned before = fake_open_descriptors();
	struct seen seen = {0};
	struct acut_push_options options = {.dataset = "alps", .format = "xyz", .progress = see_progress, .ctx = &seen};
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
		cmocka_unit_test(test_small_calls), cmocka_unit_test(test_error_parts), cmocka_unit_test(test_wait_and_lists),
		cmocka_unit_test(test_push),        cmocka_unit_test(test_push_abort),  cmocka_unit_test(test_counts),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
