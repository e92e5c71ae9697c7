/*
 * Jobs: a table of states, each a function that says which comes next.
 *
 * The model: events (the run planned, moved, ended; a cancel; the owner left) only set what the job knows
 * and then call job_step, which runs state functions until one waits. A job's mesh is made by its own run;
 * later streams of it are runs of their own (job_fetch.c). Final states never change. Unbound jobs have a
 * row in the catalogue from their submission on, so that they go on after a restart; bound ones end with
 * their owner.
 */
#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "job_fetch.h"
#include "job_priv.h"
#include "log.h"
#include "history.h"
#include "plan_file.h"

#define TELL_SECONDS 0.2
#define LOOK_SECONDS 0.5
/* A bound job's first block waits so long for its owner to fetch it. */
#define PATIENCE_SECONDS 2.0

typedef enum job_state job_state_fn(struct job *);
#define JOB_STATE(name, wire, next) static job_state_fn job_state_##name;
#include "job_state.def"
#undef JOB_STATE

static const struct {
	const char *wire;
	unsigned next; /* bits of states that may follow */
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

void job_done_with(struct job *job)
{
	plan_file_free(job->plan);
	if (job->dataset)
		dataset_release(job->dataset);
	uncharge(job->jobs->core, job->charged);
	free(job->view);
}

struct job *job_free(struct job *job)
{
	if (!job)
		return NULL;
	slot_withdraw(job->jobs->admission, &job->slot);
	run_free(job->run);
	history_remove(job);
	job_done_with(job);
	free(job);
	return NULL;
}

static void tell(struct job *job)
{
	job->told_ns = clock_mono_ns();
	job->moved = false;
	if (job->jobs->changed && !job->waiting_row)
		job->jobs->changed(job->jobs->changed_ctx, job);
}

/* ---- the row ---- */

int job_put_row(struct job *job, catalogue_done_fn done, struct err *err)
{
	char report[2048];
	bool final = job_state_final(job->state);
	struct catalogue_job row = {
		.id = job->id,
		.dataset = job->dataset ? job->dataset->id : 0,
		.generation = job->generation,
		.view = job->view,
		/* Whatever it does now, after a restart it is queued. */
		.state = job_state_text(final ? job->state : JOB_queued),
		.uid = job->peer.uid,
		.pid = job->peer.pid,
		.admin = job->peer.admin,
		.submitted_us = job->submitted_us,
		.finished_us = job->finished_us,
		.report = job->has_report ? report_text(&job->report, report, sizeof report) : "",
		.error_code = job->has_error ? err_wire_name(job->err.code) : "",
		.error_message = job->has_error ? job->err.message : "",
		.error_file = job->has_error ? job->err.file : "",
		.error_field = job->has_error ? job->err.field : "",
		.error_hint = job->has_error ? job->err.hint : "",
		.priority = (uint32_t)job->priority,
		.error_offset = job->has_error && job->err.offset != ERR_NO_OFFSET ? (int64_t)job->err.offset : -1,
	};

	return catalogue_put_job(job->jobs->core->p.catalogue, &row, done, job, err);
}

static void run_planned(void *ctx)
{
	struct job *job = ctx;

	job->planned = true;
	job_step(job);
}

static void run_moved(void *ctx)
{
	((struct job *)ctx)->moved = true;
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

static const struct run_calls calls = {.planned = run_planned, .moved = run_moved, .ended = run_ended, .followed = run_followed};

/* ---- the states ---- */

static void fail(struct job *job, const struct err *why)
{
	job->has_error = true;
	job->err = *why;
}

static void granted(struct slot *slot)
{
	struct job *job = (struct job *)((char *)slot - offsetof(struct job, slot));

	if (job->run) {
		run_begin(job->run);
		return;
	}
	job->placed = true;
	job_step(job);
}

void job_slot_init(struct job *job)
{
	job->slot.owner = (struct sched_owner){
		.uid = job->peer.uid, .rank = (enum sched_rank)job->priority, .exempt = rights_admin(&job->peer)};
	job->slot.granted = granted;
}

static enum job_state job_state_queued(struct job *job)
{
	bool placed = job->placed;
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

	job->placed = false;
	if (job->stop || job->removed || job->jobs->core->stopping) {
		slot_withdraw(job->jobs->admission, &job->slot);
		return job->stop ? JOB_cancelled : JOB_queued;
	}
	if (!placed) {
		slot_request(job->jobs->admission, &job->slot, 0);
		return JOB_queued;
	}
	switch (run_new(&p, &job->run, &err)) {
	case 0:
		break;
	case -ERR_BUSY:
		return JOB_queued; /* no memory for its view now */
	default:
		fail(job, &err);
		return JOB_failed;
	}
	job->run_ended = job->planned = false;
	if (!job->begun_ns)
		job->begun_ns = clock_mono_ns();
	job_fetch_attach(job);
	run_begin(job->run);
	return JOB_planning;
}

static enum job_state end_of(struct job *job);

static enum job_state job_state_planning(struct job *job)
{
	if (job->stop || job->jobs->core->stopping)
		return JOB_cancelling;
	if (job->run_ended)
		return end_of(job);
	return job->planned ? JOB_meshing : JOB_planning;
}

static enum job_state job_state_meshing(struct job *job)
{
	if (job->stop || job->jobs->core->stopping)
		return JOB_cancelling;
	return job->run_ended ? end_of(job) : JOB_meshing;
}

static enum job_state job_state_cancelling(struct job *job)
{
	if (!job->run_ended)
		return JOB_cancelling;
	/* A daemon that stops leaves it for the next start. */
	return job->jobs->core->stopping && !job->bound && !job->stop ? JOB_queued : end_of(job);
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

/* ---- the end of a job ---- */

/* Every point was left out, and --ground was asked for. */
static void no_ground(struct job *job, const struct mesh_counts *counts)
{
	struct err err = ERR_INIT;

	/* What lies outside a crop is not judged by its class. */
	if (counts->removed[VIEW_BY_CLASS] == counts->points || (counts->removed[VIEW_BY_CLASS] && run_unclassified(job->run))) {
		err_set(&err, ERR_INPUT, "the dataset has no ground points (classes 2 and 8, key-points)");
		err_add_hint(&err, "classify it first, for example with PDAL (filters.smrf, filters.csf), "
				   "LAStools (lasground) or CloudCompare (CSF), or leave --ground out");
	} else {
		err_set(&err, ERR_INPUT, "what else the view asks for leaves no ground points");
		err_add_hint(&err, "leave out --ground, or some of the other options that choose points");
	}
	fail(job, &err);
}

/* Vegetation in a terrain mesh is seldom meant. */
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

static void make_report(struct job *job)
{
	const struct pipe_totals *totals = run_totals(job->run);
	uint64_t first = run_first_ns(job->run);
	const struct view *view = run_view(job->run);

	if (view->ground && !view->window && !totals->counts.used && totals->counts.points) {
		no_ground(job, &totals->counts);
		return;
	}
	report_make(totals, &job->report);
	if (view->window)
		report_window(&job->report);
	job->report.points_read += run_plan(job->run)->points_read;
	job->report.cells_read += run_plan(job->run)->cells_read;
	job->report.domains_reused = run_reused(job->run);
	note_classes(job, view);
	job->report.seconds = clock_since(job->begun_ns);
	job->report.worked_seconds = run_worked(job->run);
	job->report.stage_seconds = job->dataset->stage_seconds;
	job->report.seal_seconds = job->dataset->seal_seconds;
	run_seconds(job->run, &job->report.plan_seconds, &job->report.domains_seconds);
	job->report.first_triangle_seconds = first ? (double)(first - job->begun_ns) / 1e9 : 0;
	job->has_report = true;
}

/* The run is over: its output hears how, then it goes. */
static enum job_state end_of(struct job *job)
{
	struct run_output *output;

	if (!job->has_error)
		make_report(job);
	output = run_detach(job->run);
	if (output)
		output->calls->end(output, job->has_error ? &job->err : NULL, run_totals(job->run), &job->report);
	if (!job->has_error)
		return JOB_done;
	return job->stop || job->err.code == ERR_CANCELLED ? JOB_cancelled : JOB_failed;
}

/* Its first row is there, or there is to be none. One whose first row did not come was never there (job_submit.c). */
void job_over(struct job *job)
{
	struct err err = ERR_INIT;

	if (!job->bound && job->removed)
		return;
	if (!job->bound && job_put_row(job, NULL, &err))
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, ABOUT_JOB(job), "the catalogue", &err);
	job_tell_end(job);
}

static void ended(struct job *job)
{
	struct err err = ERR_INIT;

	job->finished_us = clock_real_us();
	if (job->state == JOB_cancelled && !job->has_error) {
		err_set(&err, ERR_CANCELLED, "the job was cancelled");
		fail(job, &err);
	}
	job->run = run_free(job->run);
	if (!job->waiting_row)
		job_over(job);
}

static void stop_run(struct job *job)
{
	struct err err = ERR_INIT;

	if (job->stop)
		err_set(&err, ERR_CANCELLED, "the job was cancelled");
	else
		err_set(&err, ERR_BUSY, "the daemon is stopping");
	if (!job->run_ended)
		run_stop(job->run, &err);
}

static void requeue(struct job *job)
{
	struct run_output *output = run_detach(job->run);

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
			ended(job);
			break;
		}
	}
	if (job->state != before)
		tell(job);
}

void job_settle(struct job *job)
{
	if (job->run && !job->run_ended)
		run_settle(job->run);
	job_step(job);
	job_fetch_settle(job);
}

/* Whoever watches it hears why it stands still. Of very many that wait, only when they get on. */
static void look_waiting(struct job *job)
{
	enum { MANY = 256 };
	struct job_info info = {.waiting = ""};

	job->looked_ns = clock_mono_ns();
	if (job->slot.requested && slots_requested(job->jobs->admission) > MANY)
		return;
	job_waiting(job, &info);
	if (!strcmp(info.waiting, job->waited))
		return;
	memcpy(job->waited, info.waiting, sizeof job->waited);
	job->moved = true;
}

void job_tick(struct job *job)
{
	if (job->run && !job->run_ended)
		run_tick(job->run);
	job_step(job);
	if (clock_since(job->looked_ns) >= LOOK_SECONDS && !job_state_final(job->state))
		look_waiting(job);
	if (job->moved && clock_since(job->told_ns) >= TELL_SECONDS)
		tell(job);
	job_fetch_tick(job);
}

/* ---- what is asked ---- */

/* With what its connection, its plan's file and its dataset keep of it. */
size_t job_bytes(size_t view)
{
	return sizeof(struct job) + view + 512;
}

struct job *job_add(struct jobs *j, uint64_t id, char *view, const struct peer *peer, struct err *err)
{
	size_t bytes = job_bytes(strlen(view));
	struct job *job;

	if (charge_lasting(j->core, CHARGE_JOB, peer->uid, bytes, "another job", err))
		return NULL;
	job = j->spare ? j->spare : malloc(sizeof *job);
	j->spare = NULL;
	if (!job) {
		uncharge(j->core, bytes);
		err_set(err, ERR_NOMEM, "no memory for a job");
		return NULL;
	}
	memset(job, 0, sizeof *job);
	job->charged = bytes;
	job->view = view;
	job->peer = rights_without_groups(peer);
	job->jobs = j;
	job->id = id;
	job->err = ERR_INIT;
	if (!history_add(job, err))
		return job;
	uncharge(j->core, bytes);
	free(job);
	return NULL;
}

static bool may_see(const struct job *job, const struct peer *peer)
{
	return !job->removed && !job->waiting_row && rights_acts_as(peer, job->peer.uid);
}

struct job *job_find(struct jobs *j, uint64_t id, const struct peer *peer)
{
	struct job *job = history_find(j, id);

	return job && may_see(job, peer) ? job : NULL;
}

struct job *job_after(struct jobs *j, uint64_t id, const struct peer *peer)
{
	struct job *job;

	while ((job = history_next(j, NULL, id)) && !may_see(job, peer))
		id = job->id;
	return job;
}

void job_info(const struct job *job, struct job_info *ret)
{
	*ret = (struct job_info){
		.id = job->id,
		.generation = job->generation,
		.dataset = job->dataset,
		.dataset_name = job->dataset ? job->dataset->name : "",
		.view = job->view,
		.state = job->state,
		.peer = job->peer,
		.bound = job->bound,
		.submitted_us = job->submitted_us,
		.finished_us = job->finished_us,
		.phase = job->run ? run_phase(job->run) : "mesh",
		.report = job->has_report ? &job->report : NULL,
		.err = job_state_final(job->state) && job->has_error ? &job->err : NULL,
	};
	if (job->run) {
		run_progress(job->run, &ret->points_done, &ret->points_total, &ret->domains_done, &ret->domains_total);
	} else if (job->has_report) {
		ret->points_done = ret->points_total = job->report.points;
		ret->domains_done = ret->domains_total = job->report.domains;
	}
	job_waiting(job, ret);
}

void job_cancel(struct job *job)
{
	THREAD_LOOP_ONLY();
	if (job_state_final(job->state) || job->stop)
		return;
	job->stop = true;
	job_step(job);
}

int job_remove(struct job *job, struct err *err)
{
	struct err ignored = ERR_INIT;

	if (!job_state_final(job->state)) {
		err_set(err, ERR_BUSY, "job %llu is %s", (unsigned long long)job->id, states[job->state].wire);
		return err_add_hint(err, "cancel it first");
	}
	job->removed = true;
	if (job->jobs->core->loading ?
		    deletions_add(job->jobs, job->id, &ignored) :
		    !job->bound && catalogue_drop_job(job->jobs->core->p.catalogue, job->id, NULL, NULL, &ignored))
		return err_set(err, ERR_NOMEM, "no memory to remove a job");
	if (job->guest)
		history_drop(job);
	return 0;
}

void job_leave(struct job *job)
{
	THREAD_LOOP_ONLY();
	job->left = true;
	job_cancel(job);
	job->removed = true;
}

int job_load(struct jobs *j, const struct catalogue_job *row, struct err *err)
{
	char *view = strdup(row->view);
	struct peer peer = rights_of_user(row->uid, row->pid);
	struct job *job = NULL;
	struct dataset *d = dataset_loaded(j->datasets, row->dataset);
	int s;

	peer.admin |= row->admin;
	if (view)
		job = job_add(j, row->id, view, &peer, err);
	if (!job) {
		s = view ? -(int)err->code : err_set(err, ERR_NOMEM, "no memory for a job");
		free(view);
		return s;
	}
	if (d)
		job->dataset = dataset_hold(d);
	job->generation = row->generation;
	job->priority = row->priority < JOB_PRIORITIES ? (enum job_priority)row->priority : JOB_PRIORITY_NORMAL;
	job_slot_init(job);
	job->submitted_us = row->submitted_us;
	job->finished_us = row->finished_us;
	for (s = 0; s < JOB_STATES && strcmp(states[s].wire, row->state); s++)
		;
	job->state = s < JOB_STATES ? (enum job_state)s : JOB_failed;
	s = job_state_final(job->state) ? 0 : job_plan_new(job, err);
	if (s)
		return s;
	job->has_report = *row->report != 0;
	if (job->has_report)
		report_parse(row->report, &job->report);
	if (*row->error_code) {
		job->has_error = true;
		err_set(&job->err, err_from_wire_name(row->error_code), "%s", row->error_message);
		err_add_file(&job->err, row->error_file);
		if (row->error_offset >= 0)
			err_add_place(&job->err, (uint64_t)row->error_offset, row->error_field);
		if (*row->error_hint)
			err_add_hint(&job->err, "%s", row->error_hint);
	}
	if (!job->dataset && !job_state_final(job->state)) {
		job->state = JOB_failed;
		job->has_error = true;
		err_set(&job->err, ERR_NOTFOUND, "its dataset is gone");
	}
	if (job_state_final(job->state))
		history_keep(job);
	return 0;
}
