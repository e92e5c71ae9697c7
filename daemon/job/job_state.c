/*
 * The states of a job: a table (job_state.def) with a function for each state that gives the next one.
 *
 * The model: events (the run has planned, progressed or ended; a request to cancel; the client left) only change fields of the
 * job and then call job_step, which calls state functions until one waits. A job's mesh is made by its own run; later streams are
 * runs of their own (job_fetch.c). A final state never changes.
 */
#include <assert.h>
#include <stdio.h>
#include <string.h>

#include "clock.h"
#include "job_fetch.h"
#include "job_priv.h"
#include "log.h"

#define REPORT_SECONDS 0.2
#define WAITING_SECONDS 0.5
/* how long the first block of a bound job waits for its client to fetch it */
#define PATIENCE_SECONDS 2.0

typedef enum job_state job_state_fn(struct job *);
#define JOB_STATE(name, wire, next) static job_state_fn job_state_##name;
#include "job_state.def"
#undef JOB_STATE

static const struct {
	const char *wire;
	unsigned next; /* bits of the states that may follow */
	job_state_fn *step;
} states[JOB_STATES] = {
#define NEXT(name) (1u << JOB_##name)
#define JOB_STATE(name, wire, next) {wire, next, job_state_##name},
#include "job_state.def"
#undef JOB_STATE
#undef NEXT
};

const char *job_state_text(enum job_state state)
{
	return states[state].wire;
}

bool job_state_final(enum job_state state)
{
	return !states[state].next;
}

static void report_change(struct job *job)
{
	job->reported_ns = clock_mono_ns();
	job->progressed = false;
	if (job->jobs->changed && !job->waiting_row)
		job->jobs->changed(job->jobs->changed_ctx, job);
}

/* ---- events of the run ---- */

static void run_planned(void *ctx)
{
	struct job *job = ctx;

	job->planned = true;
	job_step(job);
}

static void run_progressed(void *ctx)
{
	((struct job *)ctx)->progressed = true;
}

static void run_ended(void *ctx, const struct err *why)
{
	struct job *job = ctx;

	job->run_ended = true;
	if (why && !job->has_error) {
		job->has_error = true;
		job->err = *why;
	}
}

/* A stream that ends early ends nothing else. */
static bool run_followed(void *ctx)
{
	return ((const struct job *)ctx)->fetches != NULL;
}

static const struct run_calls calls = {
	.planned = run_planned, .progressed = run_progressed, .ended = run_ended, .followed = run_followed};

/* ---- the end of a job ---- */

static void set_error(struct job *job, const struct err *why)
{
	job->has_error = true;
	job->err = *why;
}

/* --ground was asked for and left no point. */
static void fail_without_ground(struct job *job, const struct mesh_counts *counts)
{
	struct err err = ERR_INIT;

	/* A crop removes points before their class is judged. */
	if (counts->removed[VIEW_BY_CLASS] == counts->points || (counts->removed[VIEW_BY_CLASS] && run_unclassified(job->run))) {
		err_set(&err, ERR_INPUT, "the dataset has no ground points (classes 2 and 8, key-points)");
		err_add_hint(&err, "classify it first, for example with PDAL (filters.smrf, filters.csf), "
				   "LAStools (lasground) or CloudCompare (CSF), or leave --ground out");
	} else {
		err_set(&err, ERR_INPUT, "what else the view asks for leaves no ground points");
		err_add_hint(&err, "leave out --ground, or some of the other options that choose points");
	}
	set_error(job, &err);
}

/* Hints that vegetation is part of the mesh, which is seldom intended for terrain. */
static void note_classes(struct job *job, const struct view *view)
{
	uint64_t ground, other;
	bool exact = run_classes(job->run, &ground, &other);

	if (*job->report.note || !ground || !other || view->ground || view->has_classes ||
	    view->not_classes[0] | view->not_classes[1] | view->not_classes[2] | view->not_classes[3] ||
	    view_normal(view).duplicates == VIEW_HIGHEST)
		return;
	snprintf(job->report.note, sizeof job->report.note,
		 "points of all classes are meshed, %s%llu of the ground (class 2) and %s%llu others: "
		 "--ground takes the ground alone",
		 exact ? "" : "at least ", (unsigned long long)ground, exact ? "" : "at least ", (unsigned long long)other);
}

/* Weights by class do nothing for data that is not classified. */
static void note_weights(struct job *job)
{
	if (!*job->report.note && run_unweighted(job->run))
		snprintf(
			job->report.note, sizeof job->report.note,
			"points that are not classified (0, 1) have no weight by class: --weight takes a file and its radius, too");
}

static void note_cropped(struct job *job)
{
	uint64_t n = run_cropped(job->run);

	if (!*job->report.note && n)
		snprintf(
			job->report.note, sizeof job->report.note,
			"%llu edge%s of lines %s an end outside of the crop and %s left out: a boundary cuts exactly, --densify makes them "
			"shorter",
			(unsigned long long)n, n == 1 ? "" : "s", n == 1 ? "has" : "have", n == 1 ? "is" : "are");
}

static void make_report(struct job *job)
{
	const struct pipe_totals *totals = run_totals(job->run);
	uint64_t first = run_first_ns(job->run);
	const struct view *view = run_view(job->run);

	if (view->ground && !view->window && !totals->counts.used && totals->counts.points) {
		fail_without_ground(job, &totals->counts);
		return;
	}
	report_make(totals, &job->report);
	if (view->window)
		report_window(&job->report);
	job->report.points_read += run_plan(job->run)->points_read;
	job->report.cells_read += run_plan(job->run)->cells_read;
	job->report.domains_reused = run_reused(job->run);
	report_simplified(&job->report, job->run);
	if (view->hidden) /* they make no triangles, and nothing is amiss */
		*job->report.note = 0;
	note_cropped(job);
	note_weights(job);
	note_classes(job, view);
	job->report.seconds = clock_since(job->begun_ns);
	job->report.worked_seconds = run_worked(job->run);
	job->report.stage_seconds = job->dataset->stage_seconds;
	job->report.seal_seconds = job->dataset->seal_seconds;
	run_seconds(job->run, &job->report.plan_seconds, &job->report.domains_seconds);
	job->report.first_triangle_seconds = first ? (double)(first - job->begun_ns) / 1e9 : 0;
	job->has_report = true;
}

/* The run has ended: passes the result to its output. */
static enum job_state job_result(struct job *job)
{
	struct run_output *output;

	if (!job->has_error)
		make_report(job);
	output = run_detach(job->run);
	if (output)
		output->calls->end(output, job->has_error ? &job->err : NULL, run_totals(job->run), &job->report);
	if (!job->has_error)
		return JOB_done;
	return job->cancel || job->err.code == ERR_CANCELLED ? JOB_cancelled : JOB_failed;
}

/* Called when the first row is written, or for a bound job, which has none. A job whose first row failed is refused
 * (job_submit.c). */
void job_record_end(struct job *job)
{
	struct err err = ERR_INIT;

	if (!job->bound && job->removed)
		return;
	if (!job->bound && job_put_row(job, NULL, &err))
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, ABOUT_JOB(job), "the catalogue", &err);
	job_event_end(job);
}

static void job_finish(struct job *job)
{
	struct err err = ERR_INIT;

	assert(job->run_ended || !job->run);
	job->finished_us = clock_real_us();
	if (job->state == JOB_cancelled && !job->has_error) {
		err_set(&err, ERR_CANCELLED, "the job was cancelled");
		set_error(job, &err);
	}
	job->run = run_free(job->run);
	if (!job->waiting_row)
		job_record_end(job);
}

/* ---- the states ---- */

static void on_slot_granted(struct slot *slot)
{
	struct job *job = (struct job *)((char *)slot - offsetof(struct job, slot));

	if (job->run) {
		run_begin(job->run);
		return;
	}
	job->slot_granted = true;
	job_step(job);
}

void job_slot_init(struct job *job)
{
	job->slot.owner = (struct sched_owner){
		.uid = job->peer.uid, .rank = (enum sched_rank)job->priority, .exempt = rights_admin(&job->peer)};
	job->slot.granted = on_slot_granted;
}

static enum job_state job_state_queued(struct job *job)
{
	bool slot_granted = job->slot_granted;
	struct run_params p = {
		.job = job->id,
		.runs = job->jobs->runs,
		.dataset = job->dataset,
		.generation = job->generation,
		.view_text = job->view,
		.keep = !job->bound,
		.client = job->bound,
		.patience = job->bound ? PATIENCE_SECONDS : 0,
		.owner = job->slot.owner,
		.slot = &job->slot,
		.plan = job->plan,
		.calls = &calls,
		.ctx = job,
	};
	struct err err = ERR_INIT;

	job->slot_granted = false;
	if (job->cancel || job->removed || job->jobs->core->stopping) {
		slot_withdraw(job->jobs->admission, &job->slot);
		return job->cancel ? JOB_cancelled : JOB_queued;
	}
	if (!slot_granted) {
		slot_request(job->jobs->admission, &job->slot, 0);
		return JOB_queued;
	}
	switch (run_new(&p, &job->run, &err)) {
	case 0:
		break;
	case -ERR_BUSY:
		return JOB_queued; /* no memory for its view now */
	default:
		set_error(job, &err);
		return JOB_failed;
	}
	job->run_ended = job->planned = false;
	if (!job->begun_ns)
		job->begun_ns = clock_mono_ns();
	job_fetch_attach(job);
	run_begin(job->run);
	return JOB_planning;
}

static enum job_state job_state_planning(struct job *job)
{
	if (job->cancel || job->jobs->core->stopping)
		return JOB_cancelling;
	if (job->run_ended)
		return job_result(job);
	return job->planned ? JOB_meshing : JOB_planning;
}

static enum job_state job_state_meshing(struct job *job)
{
	if (job->cancel || job->jobs->core->stopping)
		return JOB_cancelling;
	return job->run_ended ? job_result(job) : JOB_meshing;
}

static enum job_state job_state_cancelling(struct job *job)
{
	if (!job->run_ended)
		return JOB_cancelling;
	/* A daemon that stops leaves the job for the next start. */
	return job->jobs->core->stopping && !job->bound && !job->cancel ? JOB_queued : job_result(job);
}

static enum job_state job_state_done(struct job *job)
{
	return JOB_done;
}

static enum job_state job_state_failed(struct job *job)
{
	return JOB_failed;
}

static enum job_state job_state_cancelled(struct job *job)
{
	return JOB_cancelled;
}

/* ---- steps ---- */

static void stop_run(struct job *job)
{
	struct err err = ERR_INIT;

	if (job->cancel)
		err_set(&err, ERR_CANCELLED, "the job was cancelled");
	else
		err_set(&err, ERR_BUSY, "the daemon is stopping");
	if (!job->run_ended)
		run_stop(job->run, &err);
}

static void requeue(struct job *job)
{
	struct run_output *output = run_detach(job->run);

	assert(job->run_ended);
	if (output)
		output->calls->end(output, &job->err, NULL, NULL);
	job->run = run_free(job->run);
	job->has_error = false;
	job->err = ERR_INIT;
}

void job_step(struct job *job)
{
	enum job_state before = job->state, next;

	THREAD_LOOP_ONLY();
	if (job_state_final(before))
		return;
	for (;;) {
		next = states[job->state].step(job);
		if (next == job->state)
			break;
		assert(states[job->state].next >> next & 1);
		job->state = next;
		if (next == JOB_cancelling)
			stop_run(job);
		if (next == JOB_queued) {
			requeue(job);
			break;
		}
		if (job_state_final(next)) {
			job_finish(job);
			break;
		}
	}
	assert(!job->run == (job->state == JOB_queued || job_state_final(job->state)));
	if (job->state != before)
		report_change(job);
}

void job_settle(struct job *job)
{
	if (job->run && !job->run_ended)
		run_settle(job->run);
	job_step(job);
	job_fetch_settle(job);
}

/* Reports what the job waits for when that changes. If very many jobs wait for a slot, only progress is reported. */
static void check_waiting(struct job *job)
{
	enum { MANY = 256 };
	struct job_info info = {.waiting = ""};

	job->waiting_checked_ns = clock_mono_ns();
	if (job->slot.requested && slots_requested(job->jobs->admission) > MANY)
		return;
	job_waiting(job, &info);
	if (!strcmp(info.waiting, job->waiting_text))
		return;
	memcpy(job->waiting_text, info.waiting, sizeof job->waiting_text);
	job->progressed = true;
}

void job_tick(struct job *job)
{
	if (job->run && !job->run_ended)
		run_tick(job->run);
	job_step(job);
	if (clock_since(job->waiting_checked_ns) >= WAITING_SECONDS && !job_state_final(job->state))
		check_waiting(job);
	if (job->progressed && clock_since(job->reported_ns) >= REPORT_SECONDS)
		report_change(job);
	job_fetch_tick(job);
}
