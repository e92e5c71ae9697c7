/*
 * One job: its life in memory, its row, searches, and requests about it.
 *
 * The model: an unbound job has a row in the catalogue from its submission on, and continues after a restart. A bound job has no
 * row, and ends with its client. Its states: job_state.c.
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

void job_release(struct job *job)
{
	plan_file_free(job->plan);
	if (job->dataset)
		dataset_release(job->dataset);
	uncharge(job->jobs->core, job->charged);
	free(job->view);
}

struct job *job_free(struct job *job)
{
	THREAD_LOOP_ONLY();
	if (!job)
		return NULL;
	assert(!job->unpacked);
	slot_withdraw(job->jobs->admission, &job->slot);
	run_free(job->run);
	history_remove(job);
	job_release(job);
	free(job);
	return NULL;
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
		/* A job that is not finished is queued again after a restart. */
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

/* ---- making, searching, requests ---- */

/* With what its connection, its plan file and its dataset keep for it. */
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

static bool is_visible(const struct job *job, const struct peer *peer)
{
	return !job->removed && !job->waiting_row && rights_acts_as(peer, job->peer.uid);
}

struct job *job_find(struct jobs *j, uint64_t id, const struct peer *peer)
{
	struct job *job = history_find(j, id);

	THREAD_LOOP_ONLY();
	return job && is_visible(job, peer) ? job : NULL;
}

struct job *job_after(struct jobs *j, uint64_t id, const struct peer *peer)
{
	struct job *job;

	THREAD_LOOP_ONLY();
	while ((job = history_next(j, NULL, id)) && !is_visible(job, peer))
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
	if (job_state_final(job->state) || job->cancel)
		return;
	job->cancel = true;
	job_step(job);
}

int job_remove(struct job *job, struct err *err)
{
	struct err ignored = ERR_INIT;

	THREAD_LOOP_ONLY();
	if (!job_state_final(job->state)) {
		err_set(err, ERR_BUSY, "job %llu is %s", (unsigned long long)job->id, job_state_text(job->state));
		return err_add_hint(err, "cancel it first");
	}
	job->removed = true;
	if (job->jobs->core->loading ?
		    deletions_add(job->jobs, job->id, &ignored) :
		    !job->bound && catalogue_drop_job(job->jobs->core->p.catalogue, job->id, NULL, NULL, &ignored))
		return err_set(err, ERR_NOMEM, "no memory to remove a job");
	if (job->unpacked)
		history_delete(job);
	return 0;
}

void job_leave(struct job *job)
{
	THREAD_LOOP_ONLY();
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
	for (s = 0; s < JOB_STATES && strcmp(job_state_text((enum job_state)s), row->state); s++)
		;
	job->state = s < JOB_STATES ? (enum job_state)s : JOB_failed;
	s = job_state_final(job->state) ? 0 : job_plan_file_new(job, err);
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
		history_pack(job);
	return 0;
}
