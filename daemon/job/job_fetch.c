/*
 * Streams of a job's mesh.
 *
 * The model: the first stream of a bound job is the output of the job's own run, so triangles are sent as soon as their domain is
 * made. Every other stream has a run of its own over the job's plan. The stream of a running unbound job follows the job: domains
 * that the job has emitted are in the store. What is missing there is made again. The digests must be those of the job.
 */
#include "job_fetch.h"

#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "job_priv.h"
#include "history.h"

#define WAITING_SECONDS 0.5 /* a stream that begins sooner reports no waiting */

static void fetch_free(struct job_fetch *f)
{
	struct job_fetch **at;

	for (at = &f->job->fetches; *at != f; at = &(*at)->next)
		;
	*at = f->next;
	slot_withdraw(f->job->jobs->admission, &f->slot);
	run_free(f->run);
	if (f->window)
		uncharge(f->job->jobs->core, strlen(f->window) + 1);
	free(f->window);
	free(f);
}

static void fetch_ended(void *ctx, const struct err *why)
{
	struct job_fetch *f = ctx;

	f->run_ended = true;
	if (why)
		f->why = *why;
}

static void fetch_abandoned(void *ctx, const struct err *why)
{
	struct job_fetch *f = ctx;

	run_stop(f->run, why);
}

/* Domains that the job has emitted are in the store. */
static size_t fetch_reach(void *ctx)
{
	const struct job_fetch *f = ctx;
	const struct job *job = f->job;

	if (job->state == JOB_done || f->window)
		return SIZE_MAX;
	return job->run && !job_state_final(job->state) ? run_emitted(job->run) : 0;
}

static void forget_output(struct run_output *output)
{
	if (output->waiting)
		((struct job_fetch *)output->waiting)->output = NULL;
	output->waiting = NULL;
}

static const struct run_calls calls = {.abandoned = fetch_abandoned, .ended = fetch_ended, .reach = fetch_reach};

/* The whole mesh, from its first block. */
static bool is_whole_stream(const struct run_output *output)
{
	return !output->from && !output->wants && !output->window && !output->since;
}

static void fetch_begin(struct job_fetch *f);

static void on_slot_granted(struct slot *slot)
{
	struct job_fetch *f = (struct job_fetch *)((char *)slot - offsetof(struct job_fetch, slot));

	if (f->run) {
		run_begin(f->run);
		return;
	}
	/* At once: the slot counts as taken only when its run exists. */
	f->slot_granted = true;
	fetch_begin(f);
}

void job_fetch(struct job *job, struct run_output *output)
{
	char *window = output->window;
	struct job_fetch *f, **at;
	struct err err = ERR_INIT;

	THREAD_LOOP_ONLY();
	output->run = NULL;
	output->waiting = NULL;
	if (history_activate(job, &job, &err)) {
		output->calls->end(output, &err, NULL, NULL);
		return;
	}
	if (job->bound && is_whole_stream(output) && job->run && !job->run_ended && run_attach(job->run, output))
		return;
	f = calloc(1, sizeof *f);
	output->window = NULL;
	if (!f)
		err_set(&err, ERR_NOMEM, "no memory for a stream");
	else if (window)
		charge(job->jobs->core, strlen(window) + 1, "the area of a stream", &err);
	if (err.code) {
		free(window);
		free(f);
		output->calls->end(output, &err, NULL, NULL);
		return;
	}
	f->job = job;
	f->output = output;
	f->window = window;
	f->why = ERR_INIT;
	f->begun_ns = clock_mono_ns();
	f->slot.owner = job->slot.owner;
	f->slot.granted = on_slot_granted;
	f->slot.reader = true;
	output->waiting = f;
	output->forget = forget_output;
	for (at = &job->fetches; *at; at = &(*at)->next)
		;
	*at = f;
	job_fetch_settle(job);
}

void job_fetch_attach(struct job *job)
{
	struct job_fetch *f = job->fetches;

	if (!job->bound || !f || !f->output || f->window || !is_whole_stream(f->output) || !run_attach(job->run, f->output))
		return;
	f->output->waiting = NULL;
	fetch_free(f);
}

static void fetch_end(struct job_fetch *f, struct run_output *output, const struct err *why)
{
	struct job_report report;

	if (why)
		event_damage(ABOUT_JOB(f->job), why);
	if (output) {
		output->waiting = NULL;
		if (f->window && f->run && !why) {
			report_make(run_totals(f->run), &report);
			report_window(&report);
			report_simplified(&report, f->run);
			report.points_read += run_plan(f->run)->points_read;
			report.seconds = clock_since(f->begun_ns);
		}
		output->calls->end(output, why, f->run && !why ? run_totals(f->run) : NULL,
				   why       ? NULL :
				   f->window ? &report :
					       &f->job->report);
	}
	fetch_free(f);
}

static uint64_t distance(uint64_t a, uint64_t b)
{
	return a < b ? b - a : a - b;
}

static int refuse_future(const struct run_since *s, struct err *err)
{
	err_set(err, ERR_NOTFOUND, "the dataset %s has no generation %llu: it has %llu to %llu", s->dataset,
		(unsigned long long)s->generation, (unsigned long long)s->oldest, (unsigned long long)s->newest);
	return s->near ? err_add_hint(err, "--changed-since %llu can be had, or the whole mesh without it",
				      (unsigned long long)s->near) :
			 err_add_hint(err, "fetch the whole mesh, without --changed-since");
}

/* Finds the newest finished jobs with the mesh of that generation, for a stream of changes. */
static int find_base(struct job_fetch *f, uint64_t generation, struct err *err)
{
	enum { MOST = sizeof f->since.base / sizeof *f->since.base };
	const struct job *job = f->job, *other;
	struct run_since *s = &f->since;

	*s = (struct run_since){.generation = generation,
				.job = job->id,
				.dataset = job->dataset->name,
				.oldest = dataset_oldest(job->dataset),
				.newest = job->dataset->generation};
	if (job->bound)
		return err_set(err, ERR_USAGE, "changes exist for submitted jobs, not for one-step meshes");
	if (!digest_parse(job->report.digest, &s->digest) || !digest_parse(job->report.vertex_digest, &s->vertex_digest))
		return err_set(err, ERR_GONE, "the digests of job %llu are not known", (unsigned long long)job->id);
	for (other = history_next(job->jobs, job->dataset, 0); other; other = history_next(job->jobs, job->dataset, other->id)) {
		struct run_base base = {.job = other->id};

		if (other->bound || other->removed || other->state != JOB_done || strcmp(other->view, job->view) ||
		    report_without_flat(&other->report) || !digest_parse(other->report.digest, &base.digest) ||
		    !digest_parse(other->report.vertex_digest, &base.vertex_digest))
			continue;
		if (other->generation != generation) {
			if (other->generation != job->generation &&
			    (!s->near || distance(other->generation, generation) <= distance(s->near, generation)))
				s->near = other->generation;
			continue;
		}
		memmove(s->base + 1, s->base, (MOST - 1) * sizeof *s->base);
		s->base[0] = base;
		s->n += s->n < MOST;
	}
	return generation > s->newest ? refuse_future(s, err) : 0;
}

static int check_meshable(const struct job *job, struct err *err)
{
	if (!job->dataset)
		return err_set(err, ERR_GONE, "the dataset of job %llu is gone", (unsigned long long)job->id);
	if (!report_without_flat(&job->report))
		return 0;
	err_set(err, ERR_GONE, "job %llu was done by an older acutd, which left positions without triangles out of the mesh",
		(unsigned long long)job->id);
	return err_add_hint(err, "submit %s again: the new mesh has them", job->dataset->name);
}

static void fetch_begin(struct job_fetch *f)
{
	struct job *job = f->job;
	struct run_params p = {
		.job = job->id,
		.runs = job->jobs->runs,
		.dataset = job->dataset,
		.generation = job->generation,
		.view_text = f->window ? f->window : job->view,
		.keep = !job->bound && !f->window,
		.lazy = true,
		.client = true,
		.owner = f->slot.owner,
		.slot = &f->slot,
		.plan = f->window ? NULL : job->plan,
		.calls = &calls,
		.ctx = f,
	};
	struct err err = ERR_INIT;

	if (!f->output) {
		/* Its client has left while it waited for a slot. job_fetch_settle frees it. */
		f->slot_granted = false;
		return;
	}
	if (job_state_final(job->state) && job->state != JOB_done) {
		fetch_end(f, f->output, &job->err);
		return;
	}
	if (check_meshable(job, &err)) {
		fetch_end(f, f->output, &err);
		return;
	}
	if (f->output->since && !f->since.generation && find_base(f, f->output->since, &err)) {
		fetch_end(f, f->output, &err);
		return;
	}
	p.since = f->output->since ? &f->since : NULL;
	if (!f->slot_granted) {
		slot_request(job->jobs->admission, &f->slot, 0);
		return;
	}
	f->slot_granted = false;
	switch (run_new(&p, &f->run, &err)) {
	case 0:
		break;
	case -ERR_BUSY:
		return; /* no memory for its view now */
	default:
		fetch_end(f, f->output, &err);
		return;
	}
	f->output->waiting = NULL;
	if (!run_attach(f->run, f->output)) {
		err_set(&err, ERR_INTERNAL, "a new stream cannot be attached");
		fetch_end(f, f->output, &err);
		return;
	}
	f->output = NULL;
	run_begin(f->run);
}

/* The stream of a job must be the job's mesh. If not, the client must not keep it. */
static void fetch_finish(struct job_fetch *f)
{
	struct run_output *output = run_detach(f->run);
	char hex[DIGEST_HEX_SIZE];

	if (!f->why.code && f->job->state != JOB_done && !f->window)
		f->why = f->job->err;
	if (!f->why.code && f->since.generation)
		run_change_agrees(f->run, &f->why);
	else if (!f->why.code && !f->window && strcmp(digest_hex(run_totals(f->run)->digest, hex), f->job->report.digest))
		err_set(&f->why, ERR_DIGEST, "the mesh made again has digest %s, the job had %s", hex, f->job->report.digest);
	fetch_end(f, output, f->why.code ? &f->why : NULL);
}

/* The job is finished, or has a plan and puts its domains into the store. */
static bool can_begin(const struct job *job, const struct job_fetch *f)
{
	/* Changes can be computed only when all regions are known. */
	if (f->output && f->output->since && !job_state_final(job->state))
		return false;
	return job_state_final(job->state) || (job->state == JOB_meshing && !job->bound && job->planned && !job->run_ended);
}

void job_fetch_settle(struct job *job)
{
	bool failed = job_state_final(job->state) && job->state != JOB_done;
	struct job_fetch *f, *next;

	for (f = job->fetches; f; f = next) {
		next = f->next;
		if (f->run && !f->run_ended && failed)
			run_stop(f->run, &job->err);
		if (f->run && !f->run_ended)
			run_settle(f->run);
		/* The mesh is complete, but the job has not ended yet. */
		if (f->run && f->run_ended && !f->why.code && !job_state_final(job->state) && !f->window)
			continue;
		if (f->run && f->run_ended)
			fetch_finish(f);
		else if (!f->run && !f->output)
			fetch_free(f);
		else if (!f->run && (can_begin(job, f) || f->window)) /* a window needs nothing that the job makes */
			fetch_begin(f);
	}
}

/* Tells the client why no data comes. */
static void check_waiting(struct job_fetch *f)
{
	struct run_output *output = f->run ? run_output(f->run) : f->output;
	char waits[sizeof f->waiting_text] = "";

	if (!output || !output->calls->waits)
		return;
	if (f->slot.requested)
		slot_wait_text(f->job->jobs->admission, &f->slot, waits, sizeof waits);
	else if (f->run && !f->run_ended)
		run_waiting(f->run, waits, sizeof waits);
	if (!strcmp(waits, f->waiting_text))
		return;
	memcpy(f->waiting_text, waits, sizeof waits);
	output->calls->waits(output, waits);
}

void job_fetch_tick(struct job *job)
{
	struct job_fetch *f;

	/* While the job is unfinished, its own progress is reported. The reason comes first, before run_tick may end the
	 * stream. */
	for (f = job->fetches; f; f = f->next)
		if (job_state_final(job->state) && clock_since(f->begun_ns) >= WAITING_SECONDS)
			check_waiting(f);
	for (f = job->fetches; f; f = f->next)
		if (f->run && !f->run_ended)
			run_tick(f->run);
	job_fetch_settle(job);
}

void job_fetch_park(struct job *job)
{
	struct job_fetch *f, *next;
	struct err err = ERR_INIT;

	err_set(&err, ERR_BUSY, "the daemon is stopping");
	for (f = job->fetches; f; f = next) {
		next = f->next;
		if (!f->run)
			fetch_end(f, f->output, &err);
		else if (!f->run_ended)
			run_stop(f->run, &err);
	}
}
