/* Requests about jobs. */
#include <stdlib.h>
#include <string.h>

#include "server_priv.h"

/* NULL: there is no such job, and the request is refused. */
static struct job *find_job(struct conn *c, struct request *q, uint64_t id)
{
	struct err err = ERR_INIT;
	struct job *job = job_find(c->server->service->jobs, id, &c->peer);

	if (!job) {
		err_set(&err, ERR_NOTFOUND, "there is no job %llu", (unsigned long long)id);
		err_add_hint(&err, "acutctl jobs lists them");
		request_refuse(q, &err);
	}
	return job;
}

static void answer_job(struct request *q, const struct job *job)
{
	struct message_job m;

	message_job(job, &m);
	request_answer(q, FRAME_MESSAGE(JOB, job, &m.job));
}

void request_submitted(void *token, const struct err *why, struct job *job)
{
	struct request *q = token;
	struct conn *c = q->conn;
	struct job_info info;
	struct conn_job *b;

	if (why) {
		request_refuse(q, why);
		return;
	}
	job_info(job, &info);
	if (info.bound) {
		b = c->closed ? NULL : calloc(1, sizeof *b);
		if (!b) {
			job_leave(job);
		} else {
			b->id = info.id;
			b->next = c->bound;
			c->bound = b;
		}
	}
	answer_job(q, job);
}

void request_submit(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	const Acut__V1__Submit *in = m->submit;
	struct job_params p = {
		.generation = in->generation,
		.view = in->view,
		.bound = in->bound,
		.fresh = in->fresh,
		.priority = in->priority,
		.peer = c->peer,
	};
	struct err err = ERR_INIT;

	if (dataset_access(c->server->service->datasets, in->dataset, &c->peer, RIGHT_READ, &p.dataset, &err)) {
		request_refuse(q, &err);
		return;
	}
	if (job_names_files(p.view))
		request_named_view(q, &p, false);
	else
		job_submit(c->server->service->jobs, &p, request_submitted, q);
}

void request_fetch(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	uint32_t id = q->id; /* find_job frees the request if there is no such job */
	uint64_t from = m->fetch->from_block, since = m->fetch->changed_since;
	bool wants = *m->fetch->stream_id != 0, system = m->fetch->system, lines = m->fetch->lines;
	struct job *job = find_job(c, q, m->fetch->job);
	Acut__V1__Fetching fetching = ACUT__V1__FETCHING__INIT;
	struct err err = ERR_INIT;
	struct stream_out *out;
	struct digest want;
	char *window = NULL;
	int end = -1;

	if (!job)
		return;
	if (*m->fetch->area && job_window(job, m->fetch->area, &window, &err)) {
		request_refuse(q, &err);
		return;
	}
	if (*m->fetch->stream_id && !digest_parse(m->fetch->stream_id, &want)) {
		err_set(&err, ERR_USAGE, "\"%.40s\" is no stream id", m->fetch->stream_id);
	} else if (m->fetch->from_block && !*m->fetch->stream_id) {
		err_set(&err, ERR_USAGE, "a fetch that goes on names its stream");
	} else if (since && window) {
		err_set(&err, ERR_USAGE, "changes are those of a whole mesh, not of an area");
	}
	out = err.code ? NULL : stream_out_new(c, m->fetch->job, id, &end, &err);
	if (!out) {
		free(window);
		request_refuse(q, &err);
		return;
	}
	request_free(q);
	stream_out_from(out, from, wants ? &want : NULL, since);
	stream_out_asks(out, system, lines);
	/* If the client is gone, or there is no memory for the answer, this closes the connection and with it the stream. */
	conn_send(c, id, FRAME_MESSAGE(FETCHING, fetching, &fetching), end);
	if (!c->closed)
		stream_out_start(out, job, window);
	else
		free(window);
}

void request_wait(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	struct job *job = find_job(c, q, m->wait->job);
	struct message_job out;
	struct job_info info;

	if (!job)
		return;
	job_info(job, &info);
	if (!m->wait->watch || job_state_final(info.state)) {
		answer_job(q, job);
		return;
	}
	q->wait = q->watch = true;
	q->job = info.id;
	message_job(job, &out);
	conn_send(c, q->id, FRAME_MESSAGE(JOB, job, &out.job), -1);
}

void request_job_changed(struct conn *c, struct job *job)
{
	struct message_job m;
	struct request *q, *next;

	message_job(job, &m);
	for (q = c->requests; q && !c->closed; q = next) {
		next = q->next;
		if (!q->watch || q->job != m.job.id)
			continue;
		if (m.job.final)
			request_answer(q, FRAME_MESSAGE(JOB, job, &m.job));
		else
			conn_send(c, q->id, FRAME_MESSAGE(JOB, job, &m.job), -1);
	}
}

void request_cancel(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	struct job *job = find_job(c, q, m->cancel->job);

	if (!job)
		return;
	job_cancel(job);
	answer_job(q, job);
}

void request_remove(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	struct job *job = find_job(c, q, m->remove->job);
	struct err err = ERR_INIT;

	if (!job)
		return;
	if (job_remove(job, &err))
		request_refuse(q, &err);
	else
		request_answer_done(q);
}

/* Fits a frame, and does not keep others waiting. */
enum { PAGE_MAX = 128 };

void request_jobs(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	uint64_t after = m->jobs_request->after;
	unsigned limit = m->jobs_request->limit, n = 0;
	struct message_job row;
	struct frame_page page;
	struct job *job;
	bool more = false, counts;

	page.n = 0;
	counts = m->jobs_request->counts && message_job_rules(&page);
	if (!limit || limit > PAGE_MAX)
		limit = PAGE_MAX;
	while (!more && (job = job_after(c->server->service->jobs, after, &c->peer))) {
		if (n < limit && counts)
			message_job_counts(job, &row);
		else if (n < limit)
			message_job(job, &row);
		more = n == limit || !frame_page_add(&page, &row.job.base);
		after = row.job.id;
		n++;
	}
	request_answer_page(q, ACUT__V1__MESSAGE__BODY_JOBS, &page, more);
}
