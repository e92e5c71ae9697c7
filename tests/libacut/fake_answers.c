/* A daemon that answers everything: made-up rows, but what was asked shows in them. */
#include "fake.h"

#include <string.h>
#include <unistd.h>

#define ANSWER(f, id, CASE, member, ptr) fake_send((f), (id), FRAME_MESSAGE(CASE, member, ptr), -1)

void fake_answer_hello(struct fake *f, uint32_t id)
{
	Acut__V1__Hello hello = ACUT__V1__HELLO__INIT;

	hello.version_min = hello.version_max = 1;
	hello.build = "fake 7";
	ANSWER(f, id, HELLO, hello, &hello);
}

void fake_answer_error(struct fake *f, uint32_t id, const char *code, const char *message)
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

void fake_answer_job(struct fake *f, uint32_t id, uint64_t job, const char *state, bool final)
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
		fake_answer_error(f, id, "truncated", "it ends early");
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
		fake_answer_error(f, id, "not-in-this-version", "what is that");
	}
}

static void answer(struct fake *f, uint32_t id, const Acut__V1__Message *m)
{
	switch (m->body_case) {
	case ACUT__V1__MESSAGE__BODY_HELLO:
		fake_answer_hello(f, id);
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
			fake_answer_error(f, id, "not-found", "no such dataset");
		else
			fake_answer_job(f, id, m->submit->generation + 40, "waiting", false);
		break;
	case ACUT__V1__MESSAGE__BODY_WAIT:
		fake_answer_job(f, id, m->wait->job, "running", false);
		if (m->wait->watch)
			fake_answer_job(f, id, m->wait->job, "done", true);
		break;
	case ACUT__V1__MESSAGE__BODY_CANCEL:
		fake_answer_job(f, id, m->cancel->job, "cancelled", true);
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

void fake_serve_all(struct fake *f)
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
