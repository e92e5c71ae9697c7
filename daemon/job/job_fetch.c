/*
 * Streams of a job's mesh, and plans that only tell.
 *
 * The model: the first stream of a bound job is the output of the job's own walk, so that triangles leave as
 * soon as their domain is done. Every other stream waits until the job is done and then walks the same
 * domains again, most of them from the store; what is missing there is made again. Its digests must be those
 * of the job.
 */
#include "job_fetch.h"

#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "job_priv.h"

static void fetch_free(struct job_fetch *f)
{
	struct job_fetch **at;

	for (at = &f->job->fetches; *at != f; at = &(*at)->next)
		;
	*at = f->next;
	walk_free(f->walk);
	free(f);
}

static void fetch_ended(void *ctx, const struct err *why)
{
	struct job_fetch *f = ctx;

	f->walk_ended = true;
	if (why)
		f->why = *why;
}

static void fetch_unread(void *ctx, const struct err *why)
{
	struct job_fetch *f = ctx;

	walk_stop(f->walk, why);
}

static const struct walk_calls calls = {.unread = fetch_unread, .ended = fetch_ended};

void job_fetch(struct job *job, struct job_output *output)
{
	struct job_fetch *f, **at;
	struct err err = ERR_INIT;

	output->walk = NULL;
	output->fetch = NULL;
	if (job->bound && job->walk && !job->walk_ended && walk_attach(job->walk, output))
		return;
	f = calloc(1, sizeof *f);
	if (!f) {
		err_set(&err, ERR_NOMEM, "no memory for a stream");
		output->calls->end(output, &err, NULL, NULL);
		return;
	}
	f->job = job;
	f->output = output;
	f->why = ERR_INIT;
	f->begun_ns = clock_mono_ns();
	output->fetch = f;
	for (at = &job->fetches; *at; at = &(*at)->next)
		;
	*at = f;
	job_fetch_settle(job);
}

void job_fetch_attach(struct job *job)
{
	struct job_fetch *f = job->fetches;

	if (!job->bound || !f || !f->output || !walk_attach(job->walk, f->output))
		return;
	f->output->fetch = NULL;
	fetch_free(f);
}

void job_fetch_forget(struct job_output *output)
{
	if (output->fetch)
		output->fetch->output = NULL;
	output->fetch = NULL;
}

static void end(struct job_fetch *f, struct job_output *output, const struct err *why)
{
	if (output) {
		output->fetch = NULL;
		output->calls->end(output, why, f->walk && !why ? walk_totals(f->walk) : NULL,
				   why ? NULL : &f->job->report);
	}
	fetch_free(f);
}

static void begin(struct job_fetch *f)
{
	struct job *job = f->job;
	struct walk_params p = {
		.jobs = job->jobs,
		.dataset = job->dataset,
		.generation = job->generation,
		.view_text = job->view,
		.keep = !job->bound,
		.calls = &calls,
		.ctx = f,
	};
	struct err err = ERR_INIT;

	if (job->state != JOB_done) {
		end(f, f->output, &job->err);
		return;
	}
	if (!job->dataset) {
		err_set(&err, ERR_GONE, "the dataset of job %llu is gone", (unsigned long long)job->id);
		end(f, f->output, &err);
		return;
	}
	if (!jobs_fetch_room(job->jobs))
		return;
	if (walk_new(&p, &f->walk, &err)) {
		end(f, f->output, &err);
		return;
	}
	f->output->fetch = NULL;
	if (!walk_attach(f->walk, f->output)) {
		err_set(&err, ERR_INTERNAL, "a new stream cannot be attached");
		end(f, f->output, &err);
		return;
	}
	f->output = NULL;
	walk_start(f->walk);
}

/* Same job, same mesh: anything else is a fault, and the client must not keep it. */
static void finish(struct job_fetch *f)
{
	struct job_output *output = walk_detach(f->walk);
	char hex[DIGEST_HEX_SIZE];

	if (!f->why.code && strcmp(digest_hex(walk_totals(f->walk)->digest, hex), f->job->report.digest))
		err_set(&f->why, ERR_DIGEST, "the mesh made again has digest %s, the job had %s", hex,
			f->job->report.digest);
	end(f, output, f->why.code ? &f->why : NULL);
}

void job_fetch_settle(struct job *job)
{
	struct job_fetch *f, *next;

	for (f = job->fetches; f; f = next) {
		next = f->next;
		if (f->walk && !f->walk_ended)
			walk_settle(f->walk);
		if (f->walk && f->walk_ended)
			finish(f);
		else if (!f->walk && !f->output)
			fetch_free(f);
		else if (!f->walk && job_state_final(job->state))
			begin(f);
	}
}

void job_fetch_tick(struct job *job)
{
	struct job_fetch *f;

	for (f = job->fetches; f; f = f->next)
		if (f->walk && !f->walk_ended)
			walk_tick(f->walk);
	job_fetch_settle(job);
}

void job_fetch_park(struct job *job)
{
	struct job_fetch *f, *next;
	struct err err = ERR_INIT;

	err_set(&err, ERR_BUSY, "the daemon is stopping");
	for (f = job->fetches; f; f = next) {
		next = f->next;
		if (!f->walk)
			end(f, f->output, &err);
		else if (!f->walk_ended)
			walk_stop(f->walk, &err);
	}
}

/* ---- plans ---- */

static void plan_ended(void *ctx, const struct err *why)
{
	struct job_asked_plan *p = ctx;

	p->walk_ended = true;
	p->failed = why != NULL;
	if (why)
		p->err = *why;
}

static const struct walk_calls plan_calls = {.ended = plan_ended};

/* Bytes of a stored domain a point: 2 triangles of 12, a vertex of 12, open links (measured 36 to 38). */
enum { STORED_BYTES = 38 };

/* Seconds a point of the newest finished job that was large enough to tell; 0: none. */
static double pace(const struct jobs *j)
{
	enum { TELLING = 100000 };
	const struct job *job;
	double seconds = 0;

	/* The list is by number: the last one wins. What a selection left out was not meshed. */
	for (job = j->jobs; job; job = job->next) {
		const uint64_t *removed = job->report.removed;
		uint64_t points = job->report.points - removed[VIEW_BY_CROP] - removed[VIEW_BY_EVERY] -
				  removed[VIEW_BY_THIN];

		if (job->has_report && points >= TELLING && job->report.seconds > 0)
			seconds = job->report.seconds / (double)points;
	}
	return seconds;
}

static void plan_answer(struct job_asked_plan *p)
{
	const struct cut_plan *plan = walk_plan(p->walk);
	const struct pipe_budget *budget = walk_budget(p->walk);
	struct job_plan out = {
		.points = walk_grid_points(p->walk),
		.domains = plan->n,
		.memory_bytes = (uint64_t)budget->domain_bytes * (budget->threads + 1) +
				p->jobs->emitter_share + p->jobs->index_share,
		.disk_bytes = walk_grid_points(p->walk) * STORED_BYTES,
		.exact = true,
		.load = budget->load,
		.threads = budget->threads,
		.seconds = pace(p->jobs) * (double)walk_grid_points(p->walk),
	};
	size_t i;

	for (i = 0; i < plan->n; i++)
		out.exact &= plan->leaf[i].exact;
	p->planned(p->token, NULL, &out);
}

void job_plans_settle(struct jobs *j)
{
	struct job_asked_plan **at = &j->plans, *p;

	while ((p = *at)) {
		if (p->walk && !p->walk_ended)
			walk_tick(p->walk);
		if (!p->walk_ended) {
			at = &p->next;
			continue;
		}
		*at = p->next;
		if (p->failed)
			p->planned(p->token, &p->err, NULL);
		else
			plan_answer(p);
		walk_free(p->walk);
		free(p);
	}
}

void job_plan(struct jobs *j, struct dataset *d, uint64_t generation, const char *view,
	      const struct job_peer *peer,
	      void (*planned)(void *token, const struct err *why, const struct job_plan *), void *token)
{
	struct job_asked_plan *p = calloc(1, sizeof *p);
	struct walk_params params = {
		.jobs = j,
		.dataset = d,
		.generation = generation ? generation : d->generation,
		.plan_only = true,
		.calls = &plan_calls,
		.ctx = p,
	};
	char *text = NULL;
	struct err err = ERR_INIT;

	if (!p)
		err_set(&err, ERR_NOMEM, "no memory for a plan");
	else if (j->parking)
		err_set(&err, ERR_BUSY, "the daemon is stopping");
	else if (!d->generation || generation > d->generation)
		err_set(&err, ERR_NOTFOUND, "the dataset %s has no such generation", d->name);
	else if (!job_view(view, d, &text, &err)) {
		params.view_text = text;
		walk_new(&params, &p->walk, &err);
		free(text);
	}
	if (err.code) {
		free(p);
		planned(token, &err, NULL);
		return;
	}
	p->jobs = j;
	p->peer = *peer;
	p->err = ERR_INIT;
	p->planned = planned;
	p->token = token;
	p->next = j->plans;
	j->plans = p;
	walk_start(p->walk);
}
