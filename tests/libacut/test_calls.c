/*
 * Every call of libacut against a daemon of a few lines: what is asked arrives, what is answered is handed
 * out; errors keep all their parts; time-out, interruption, late answers, a daemon that dies, lies or
 * babbles.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "fake.h"

#define ANSWER(f, id, CASE, member, ptr) fake_send((f), (id), FRAME_MESSAGE(CASE, member, ptr), -1)

static void answer_hello(struct fake *f, uint32_t id)
{
	Acut__V1__Hello hello = ACUT__V1__HELLO__INIT;

	hello.version_min = hello.version_max = 1;
	hello.build = "fake 7";
	ANSWER(f, id, HELLO, hello, &hello);
}

static void answer_error(struct fake *f, uint32_t id, const char *code, const char *message)
{
	Acut__V1__Error error = ACUT__V1__ERROR__INIT;

	error.code = (char *)code;
	error.message = (char *)message;
	error.file = "b.las";
	error.field = "points";
	error.hint = "do this";
	error.has_offset = true;
	error.offset = 77;
	ANSWER(f, id, ERROR, error, &error);
}

static void answer_job(struct fake *f, uint32_t id, uint64_t job, const char *state, bool final)
{
	Acut__V1__Job j = ACUT__V1__JOB__INIT;
	Acut__V1__Report report = ACUT__V1__REPORT__INIT;
	Acut__V1__Removed removed = ACUT__V1__REMOVED__INIT;
	Acut__V1__Removed *rows[] = {&removed};

	j.id = job;
	j.state = (char *)state;
	j.dataset = "alps";
	j.final = final;
	removed.rule = "withheld";
	removed.count = 12;
	report.triangles = 99;
	report.digest = "00";
	report.n_removed = 1;
	report.removed = rows;
	if (final)
		j.report = &report;
	ANSWER(f, id, JOB, job, &j);
}

static void answer_jobs(struct fake *f, uint32_t id, const Acut__V1__JobsRequest *q)
{
	Acut__V1__Jobs jobs = ACUT__V1__JOBS__INIT;
	Acut__V1__Job j[2] = {ACUT__V1__JOB__INIT, ACUT__V1__JOB__INIT};
	Acut__V1__Job *rows[] = {&j[0], &j[1]};

	j[0].id = q->after + 1;
	j[1].id = q->after + 3;
	jobs.n_jobs = 2;
	jobs.jobs = rows;
	jobs.more = q->after < 6;
	ANSWER(f, id, JOBS, jobs, &jobs);
}

static void answer_datasets(struct fake *f, uint32_t id, const Acut__V1__DatasetsRequest *q)
{
	Acut__V1__Datasets datasets = ACUT__V1__DATASETS__INIT;
	Acut__V1__Dataset d = ACUT__V1__DATASET__INIT;
	Acut__V1__Dataset *rows[] = {&d};
	double min[3] = {1, 2, 3};

	d.name = strcmp(q->after, "") == 0 ? "alps" : "rhine";
	d.points = 5;
	d.n_min = 3;
	d.min = min;
	datasets.n_datasets = 1;
	datasets.datasets = rows;
	datasets.more = strcmp(d.name, "alps") == 0;
	ANSWER(f, id, DATASETS, datasets, &datasets);
}

static void answer_probed(struct fake *f, uint32_t id, const char *name, const char *format)
{
	Acut__V1__Probed p = ACUT__V1__PROBED__INIT;
	static char *scale[] = {"0.01", "0.01", "0.001"};
	double max[3] = {7, 8, 9};

	p.name = (char *)name;
	p.format = (char *)(format[0] ? format : "las");
	p.points = 1234;
	p.n_scale = 3;
	p.scale = scale;
	p.n_max = 3;
	p.max = max;
	ANSWER(f, id, PROBED, probed, &p);
}

static void answer_file(struct fake *f, uint32_t id, const Acut__V1__File *q)
{
	Acut__V1__Progress progress = ACUT__V1__PROGRESS__INIT;
	Acut__V1__Durable durable = ACUT__V1__DURABLE__INIT;
	Acut__V1__FileDone done = ACUT__V1__FILE_DONE__INIT;
	double shift[3] = {0.5, 0, 0};

	if (strcmp(q->name, "bad.las") == 0) {
		answer_error(f, id, "truncated", "it ends early");
		return;
	}
	progress.phase = "stage";
	progress.points = 10;
	ANSWER(f, id, PROGRESS, progress, &progress);
	durable.files = 1;
	ANSWER(f, 2, DURABLE, durable, &durable); /* the number of PushBegin in these tests */
	done.name = q->name;
	done.points = 20;
	done.n_max_shift = 3;
	done.max_shift = shift;
	ANSWER(f, id, FILE_DONE, file_done, &done);
}

static void answer_rest(struct fake *f, uint32_t id, const Acut__V1__Message *m)
{
	Acut__V1__Status status = ACUT__V1__STATUS__INIT;
	Acut__V1__LedgerEntry entry = ACUT__V1__LEDGER_ENTRY__INIT, *entries[] = {&entry};
	Acut__V1__PushBegun begun = ACUT__V1__PUSH_BEGUN__INIT;
	Acut__V1__PushPlanned planned = ACUT__V1__PUSH_PLANNED__INIT;
	Acut__V1__PushCommitted committed = ACUT__V1__PUSH_COMMITTED__INIT;
	Acut__V1__Plan plan = ACUT__V1__PLAN__INIT;
	Acut__V1__Done done = ACUT__V1__DONE__INIT;

	switch (m->body_case) {
	case ACUT__V1__MESSAGE__BODY_STATUS_REQUEST:
		entry.name = "stage";
		entry.bytes = 4096;
		status.version = "1.2";
		status.n_ledger = 1;
		status.ledger = entries;
		ANSWER(f, id, STATUS, status, &status);
		break;
	case ACUT__V1__MESSAGE__BODY_PUSH_BEGIN:
		begun.push = 55;
		ANSWER(f, id, PUSH_BEGUN, push_begun, &begun);
		break;
	case ACUT__V1__MESSAGE__BODY_PUSH_PLAN:
		planned.lattice = "0.01 0.01 0 0 0";
		ANSWER(f, id, PUSH_PLANNED, push_planned, &planned);
		break;
	case ACUT__V1__MESSAGE__BODY_PUSH_COMMIT:
		committed.dataset = "alps";
		committed.generation = 3;
		committed.points = m->push_commit->push;
		ANSWER(f, id, PUSH_COMMITTED, push_committed, &committed);
		break;
	case ACUT__V1__MESSAGE__BODY_PLAN_REQUEST:
		plan.domains = 17;
		plan.exact = true;
		ANSWER(f, id, PLAN, plan, &plan);
		break;
	case ACUT__V1__MESSAGE__BODY_PUSH_ABORT:
		if (f->ctx)
			*(uint64_t *)f->ctx = m->push_abort->push;
		/* fall through */
	case ACUT__V1__MESSAGE__BODY_PING:
	case ACUT__V1__MESSAGE__BODY_REMOVE:
		ANSWER(f, id, DONE, done, &done);
		break;
	default:
		answer_error(f, id, "not-in-this-version", "what is that");
	}
}

static void answer(struct fake *f, uint32_t id, const Acut__V1__Message *m)
{
	switch (m->body_case) {
	case ACUT__V1__MESSAGE__BODY_HELLO:
		answer_hello(f, id);
		break;
	case ACUT__V1__MESSAGE__BODY_PROBE:
		answer_probed(f, id, m->probe->name, m->probe->format);
		break;
	case ACUT__V1__MESSAGE__BODY_INFO_REQUEST:
		answer_probed(f, id, m->info_request->name, m->info_request->format);
		break;
	case ACUT__V1__MESSAGE__BODY_FILE:
		answer_file(f, id, m->file);
		break;
	case ACUT__V1__MESSAGE__BODY_SUBMIT:
		if (strcmp(m->submit->dataset, "none") == 0)
			answer_error(f, id, "not-found", "no such dataset");
		else
			answer_job(f, id, m->submit->generation + 40, "waiting", false);
		break;
	case ACUT__V1__MESSAGE__BODY_WAIT:
		answer_job(f, id, m->wait->job, "running", false);
		if (m->wait->watch)
			answer_job(f, id, m->wait->job, "done", true);
		break;
	case ACUT__V1__MESSAGE__BODY_CANCEL:
		answer_job(f, id, m->cancel->job, "cancelled", true);
		break;
	case ACUT__V1__MESSAGE__BODY_JOBS_REQUEST:
		answer_jobs(f, id, m->jobs_request);
		break;
	case ACUT__V1__MESSAGE__BODY_DATASETS_REQUEST:
		answer_datasets(f, id, m->datasets_request);
		break;
	default:
		answer_rest(f, id, m);
	}
}

static void serve_all(struct fake *f)
{
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	while (fake_recv(f, &id, &m, &fd)) {
		if (fd >= 0)
			close(fd);
		answer(f, id, m);
		frame_message_free(m);
	}
}

static struct acut *attach(struct fake **ret_fake, void (*serve)(struct fake *), void *ctx,
			   const struct acut_options *options)
{
	struct acut *a;
	int fd;

	*ret_fake = fake_start(serve, ctx, &fd);
	assert_int_equal(acut_attach(fd, options, &a), 0);
	return a;
}

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
	struct acut *a = attach(&f, serve_all, NULL, NULL);
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
	struct acut *a = attach(&f, serve_all, NULL, NULL);
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
	struct acut *a = attach(&f, serve_all, NULL, NULL);

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
	struct acut *a = attach(&f, serve_all, NULL, NULL);
	int fd = some_file();

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
	assert_int_equal(acut_info(a, fd, "b.las", NULL, &probe), 0);
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
	struct acut *a = attach(&f, serve_all, &aborted, NULL);
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

/* ---- a daemon at fault ---- */

static bool greet(struct fake *f)
{
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	if (!fake_recv(f, &id, &m, &fd))
		return false;
	answer_hello(f, id);
	frame_message_free(m);
	return true;
}

/* Answers the first question only when the second has come: late, and out of turn. */
static void serve_late(struct fake *f)
{
	Acut__V1__Message *m;
	Acut__V1__Done done = ACUT__V1__DONE__INIT;
	uint32_t first, second;
	int fd;

	if (!greet(f) || !fake_recv(f, &first, &m, &fd))
		return;
	frame_message_free(m);
	if (!fake_recv(f, &second, &m, &fd))
		return;
	frame_message_free(m);
	answer_error(f, first, "io", "of the first");
	fake_send(f, first, FRAME_MESSAGE(DONE, done, &done), dup(2));
	fake_send(f, second, FRAME_MESSAGE(DONE, done, &done), dup(2)); /* a descriptor nobody asked for */
	while (fake_recv(f, &first, &m, &fd))
		frame_message_free(m);
}

static void test_timeout_and_late_answer(void **state)
{
	unsigned before = fake_open_descriptors();
	struct acut_options options = {.timeout = 0.2};
	struct fake *f;
	struct acut *a = attach(&f, serve_late, NULL, &options);
	double seconds;

	assert_int_equal(acut_ping(a, &seconds), -ACUT_E_TIMEOUT);
	assert_int_equal(acut_error(a)->exit_status, 124);
	assert_int_equal(acut_ping(a, &seconds), 0);
	assert_true(seconds < 0.2);
	acut_close(a);
	fake_stop(f);
	assert_int_equal(fake_open_descriptors(), before);
}

static int third_time(void *ctx)
{
	return ++*(int *)ctx >= 3;
}

static void test_interrupted(void **state)
{
	int asked = -1; /* once while greeting, perhaps */
	struct acut_options options = {.interrupted = third_time, .ctx = &asked};
	struct fake *f;
	struct acut *a = attach(&f, serve_late, NULL, &options);
	double seconds;

	asked = 0;
	assert_int_equal(acut_ping(a, &seconds), -ACUT_E_CANCELLED);
	assert_int_equal(asked, 3);
	asked = -1000;
	assert_int_equal(acut_ping(a, &seconds), 0);
	acut_close(a);
	fake_stop(f);
}

static void serve_death(struct fake *f)
{
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	if (greet(f) && fake_recv(f, &id, &m, &fd))
		frame_message_free(m);
}

static void serve_last_words(struct fake *f)
{
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	if (greet(f) && fake_recv(f, &id, &m, &fd)) {
		answer_error(f, 0, "protocol", "that was no good");
		frame_message_free(m);
	}
}

static void serve_wrong_kind(struct fake *f)
{
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	if (greet(f) && fake_recv(f, &id, &m, &fd)) {
		answer_job(f, id, 1, "done", true);
		frame_message_free(m);
	}
	while (fake_recv(f, &id, &m, &fd))
		frame_message_free(m);
}

static void serve_noise(struct fake *f)
{
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	if (!greet(f) || !fake_recv(f, &id, &m, &fd))
		return;
	frame_message_free(m);
	if (write(frame_conn_fd(f->conn), "HTTP/1.1 200 OK\r\n\r\n", 19) != 19)
		abort();
}

static void test_daemon_at_fault(void **state)
{
	static const struct {
		void (*serve)(struct fake *);
		int code;
		bool dead;
		const char *text;
	} row[] = {
	    {serve_death, ACUT_E_NODAEMON, true, "closed the connection"},
	    {serve_last_words, ACUT_E_PROTO, true, "that was no good"},
	    {serve_wrong_kind, ACUT_E_PROTO, false, "not asked for"},
	    {serve_noise, ACUT_E_PROTO, true, "no frame"},
	};

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		struct fake *f;
		struct acut *a = attach(&f, row[i].serve, NULL, NULL);
		double seconds;

		assert_int_equal(acut_ping(a, &seconds), -row[i].code);
		if (!strstr(acut_error(a)->message, row[i].text))
			fail_msg("row %zu: %s", i, acut_error(a)->message);
		if (row[i].dead) {
			assert_int_equal(acut_ping(a, &seconds), -row[i].code); /* stays so */
			assert_int_equal(acut_dispatch(a), -row[i].code);
		}
		acut_close(a);
		fake_stop(f);
	}
}

static void serve_other_version(struct fake *f)
{
	Acut__V1__Hello hello = ACUT__V1__HELLO__INIT;
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	if (!fake_recv(f, &id, &m, &fd))
		return;
	hello.version_min = 5;
	hello.version_max = 9;
	ANSWER(f, id, HELLO, hello, &hello);
	frame_message_free(m);
}

static void serve_nothing(struct fake *f) {}

static void test_no_greeting(void **state)
{
	struct fake *f;
	struct acut *a;
	double seconds;
	int fd;

	f = fake_start(serve_other_version, NULL, &fd);
	assert_int_equal(acut_attach(fd, NULL, &a), -ACUT_E_VERSION);
	assert_non_null(strstr(acut_error(a)->message, "5 to 9"));
	assert_int_equal(acut_ping(a, &seconds), -ACUT_E_VERSION);
	acut_close(a);
	fake_stop(f);
	f = fake_start(serve_nothing, NULL, &fd);
	assert_int_equal(acut_attach(fd, NULL, &a), -ACUT_E_NODAEMON);
	acut_close(a);
	fake_stop(f);
}

static void test_connect(void **state)
{
	char dir[] = "/tmp/acut-test-XXXXXX", path[64], lengthy[200];
	struct sockaddr_un address = {.sun_family = AF_UNIX};
	struct acut_options options = {.timeout = 0.1};
	unsigned before = fake_open_descriptors();
	struct acut *a;
	double seconds;
	int fd;

	assert_non_null(mkdtemp(dir));
	snprintf(path, sizeof path, "%s/s", dir);
	assert_int_equal(acut_connect(path, NULL, &a), -ACUT_E_NODAEMON);
	assert_int_equal(acut_error(a)->exit_status, 69);
	assert_int_equal(acut_ping(a, &seconds), -ACUT_E_NODAEMON);
	assert_int_equal(acut_fd(a), -1);
	assert_int_equal(acut_dispatch(a), -ACUT_E_NODAEMON);
	acut_close(a);
	memset(lengthy, 'x', sizeof lengthy);
	lengthy[sizeof lengthy - 1] = '\0';
	assert_int_equal(acut_connect(lengthy, NULL, &a), -ACUT_E_USAGE);
	acut_close(a);
	/* One that listens and never accepts. */
	fd = socket(AF_UNIX, SOCK_STREAM, 0);
	strcpy(address.sun_path, path);
	assert_int_equal(bind(fd, (struct sockaddr *)&address, sizeof address), 0);
	assert_int_equal(listen(fd, 1), 0);
	assert_int_equal(acut_connect(path, &options, &a), -ACUT_E_TIMEOUT);
	acut_close(a);
	close(fd);
	unlink(path);
	rmdir(dir);
	assert_int_equal(fake_open_descriptors(), before);
}

static void test_two_connections(void **state)
{
	struct fake *f, *g;
	struct acut *a = attach(&f, serve_all, NULL, NULL), *b = attach(&g, serve_death, NULL, NULL);
	const struct acut_job *job;
	double seconds;

	assert_int_equal(acut_submit(a, "alps", 1, "", false, false, &job), 0);
	assert_int_equal(acut_ping(b, &seconds), -ACUT_E_NODAEMON);
	assert_string_equal(job->state, "waiting"); /* untouched by the other */
	assert_int_equal(acut_error(a)->code, 0);
	assert_int_equal(acut_ping(a, &seconds), 0);
	acut_close(a);
	acut_close(b);
	fake_stop(f);
	fake_stop(g);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_small_calls),     cmocka_unit_test(test_error_parts),
	    cmocka_unit_test(test_wait_and_lists),  cmocka_unit_test(test_push),
	    cmocka_unit_test(test_push_abort),      cmocka_unit_test(test_timeout_and_late_answer),
	    cmocka_unit_test(test_interrupted),     cmocka_unit_test(test_daemon_at_fault),
	    cmocka_unit_test(test_no_greeting),     cmocka_unit_test(test_connect),
	    cmocka_unit_test(test_two_connections),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
