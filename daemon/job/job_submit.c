/*
 * Submission of jobs: permissions and limits, earlier jobs with the same mesh, and the first row.
 *
 * An unbound job begins before its row is written. What it makes until then is derived data; after a crash at most a plan
 * remains, under a number that another job gets.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "job_priv.h"
#include "log.h"
#include "history.h"
#include "plan_file.h"

static void submit_answer(struct job *job, const struct err *why)
{
	void (*accepted)(void *token, const struct err *why, struct job *) = job->accepted;

	THREAD_LOOP_ONLY();
	job->waiting_row = false;
	job->accepted = NULL;
	if (accepted)
		accepted(job->token, why, why ? NULL : job);
}

/* The row failed: the job is refused, whatever it has made. */
static void submit_refuse(struct job *job, const struct err *why)
{
	char what[128];

	snprintf(what, sizeof what, "job %llu of %.60s is refused: its row cannot be written", (unsigned long long)job->id,
		 job->dataset->name);
	log_event_err(LOG_EVENT_JOB_FAILED, ABOUT_JOB(job), what, why);
	job->removed = true;
	submit_answer(job, why);
	job_cancel(job);
}

static void submit_row_done(void *ctx, int r, const struct err *why)
{
	struct job *job = ctx;

	if (r) {
		submit_refuse(job, why);
		return;
	}
	submit_answer(job, NULL);
	/* The job finished before its row was written. */
	if (job_state_final(job->state))
		job_record_end(job);
	else
		job_step(job);
}

/* An earlier job with the same generation and view, unless it failed, was cancelled, or made another mesh than today's version
 * would. */
static struct job *find_same(struct jobs *j, const struct job_params *p, uint64_t generation, const char *view)
{
	struct job *job;

	for (uint64_t id = 0; (job = history_next(j, p->dataset, id)); id = job->id)
		if (job->generation == generation && !job->bound && !job->removed && !job->cancel &&
		    job->peer.uid == p->peer.uid && job->state != JOB_failed && job->state != JOB_cancelled &&
		    !strcmp(job->view, view) && !report_without_flat(&job->report))
			return job;
	return NULL;
}

/*
 * Finished jobs keep the texts of their views for later streams. When room is needed, the oldest of the user who has most are
 * dropped. Unfinished jobs cannot be dropped, so a user may have at most half of what other users' unfinished jobs leave:
 * something is always left for the next user.
 */
static uint64_t views_limit(const struct peer *peer, const struct history_views *v)
{
	uint64_t others = v->busy - v->own_busy, left = others < JOBS_VIEWS_MAX ? JOBS_VIEWS_MAX - others : 0;

	return rights_admin(peer) ? left : left / 2;
}

static int reserve_view(struct jobs *j, const struct peer *peer, const char *view, struct err *err)
{
	uint64_t n = strlen(view);
	struct history_views v;

	history_views(j, peer->uid, &v);
	if (v.own_busy + n <= views_limit(peer, &v) && v.all + n <= JOBS_VIEWS_MAX)
		return 0;
	jobs_pack_finished(j); /* finished jobs count as unfinished until they are packed */
	history_views(j, peer->uid, &v);
	if (v.own_busy + n > views_limit(peer, &v)) {
		err_set(err, ERR_BUSY,
			"its area takes %llu KiB; the areas of this user's unfinished jobs take %llu of at most %llu KiB",
			(unsigned long long)(n + 1023) >> 10, (unsigned long long)(v.own_busy + 1023) >> 10,
			(unsigned long long)views_limit(peer, &v) >> 10);
		return err_add_hint(err, "submit it again when some of them are done, or crop to a simpler area");
	}
	while (v.all + n > JOBS_VIEWS_MAX && jobs_forget_one(j, HISTORY_VIEWS, peer->uid, n))
		history_views(j, peer->uid, &v);
	if (v.all + n <= JOBS_VIEWS_MAX)
		return 0;
	err_set(err, ERR_BUSY, "the areas of unfinished jobs take all of the %d MiB for areas", JOBS_VIEWS_MAX >> 20);
	return err_add_hint(err, "submit it again when some of them are done");
}

static int check_submit(struct jobs *j, const struct job_params *p, uint64_t generation, char **ret_view, struct err *err)
{
	const struct job *job;
	unsigned open = 0, own = 0;
	int r;

	if (j->core->stopping)
		return err_set(err, ERR_BUSY, "the daemon is stopping");
	for (job = j->jobs; job; job = job->next) {
		open += !job_state_final(job->state);
		own += !job_state_final(job->state) && job->peer.uid == p->peer.uid;
	}
	if (open >= JOBS_OPEN_MAX) {
		err_set(err, ERR_BUSY, "%u jobs wait or run already", open);
		return err_add_hint(err, "submit it again when some of them are done");
	}
	/* Something is left for the next user, and for administrators. */
	if (!rights_admin(&p->peer) && own >= (JOBS_OPEN_MAX - (open - own)) / 2) {
		err_set(err, ERR_BUSY, "%u jobs of this user wait or run already", own);
		return err_add_hint(err, "submit it again when some of them are done");
	}
	r = dataset_check_generation(p->dataset, generation, err);
	if (r)
		return r;
	return job_view(p->view, p->dataset, ret_view, err);
}

/* Submitting a job again with another priority changes it. */
static void change_priority(struct job *job, const struct job_params *p, enum job_priority priority)
{
	struct err err = ERR_INIT;

	if (!p->priority || !*p->priority || priority == job->priority || job_state_final(job->state))
		return;
	job_set_priority(job, priority);
	if (job_put_row(job, NULL, &err))
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, ABOUT_JOB(job), "a new priority is lost at the next start", &err);
}

/* The limit does not apply to administrators. */
static int limit_jobs(const struct jobs *j, const struct peer *peer, struct err *err)
{
	unsigned own;

	THREAD_LOOP_ONLY();
	if (!j->core->p.limits.user.jobs || rights_admin(peer))
		return 0;
	own = jobs_owned(j, peer->uid);
	if (own < j->core->p.limits.user.jobs)
		return 0;
	err_set(err, ERR_LIMIT, "%u jobs of this user wait or run; one user may have %u (user-jobs)", own,
		j->core->p.limits.user.jobs);
	err_add_hint(err, "submit it again when some of them are done, or cancel some");
	return err_add_place(err, ERR_NO_OFFSET, "user-jobs");
}

/* Takes `view` if it succeeds. */
static struct job *make_job(struct jobs *j, const struct job_params *p, char *view, enum job_priority priority, struct err *err)
{
	struct job *job = NULL;

	if (!limit_jobs(j, &p->peer, err) && !reserve_view(j, &p->peer, view, err))
		job = job_add(j, ++j->last_job, view, &p->peer, err);
	if (!job)
		return NULL;
	job->dataset = dataset_hold(p->dataset);
	job->generation = p->generation ? p->generation : p->dataset->generation;
	job->priority = priority;
	job->bound = p->bound;
	job_slot_init(job);
	job->submitted_us = clock_real_us();
	job->begun_ns = clock_mono_ns();
	return job;
}

/* An unbound job begins at once. It is answered, listed and reported when the catalogue has its row. */
static void start_job(struct job *job)
{
	struct err err = ERR_INIT;

	if (job->bound) {
		submit_answer(job, NULL);
	} else {
		job->waiting_row = true;
		if (job_put_row(job, submit_row_done, &err)) {
			submit_refuse(job, &err);
			return;
		}
	}
	job_step(job);
	slots_grant(job->jobs->admission);
}

void job_submit(struct jobs *j, const struct job_params *p, void (*accepted)(void *token, const struct err *why, struct job *),
		void *token)
{
	uint64_t generation = p->generation ? p->generation : p->dataset->generation;
	enum job_priority priority = JOB_PRIORITY_NORMAL;
	struct err err = ERR_INIT;
	struct job *job = NULL;
	char *view = NULL;
	int r = job_priority_read(p->priority, &p->peer, &priority, &err);

	THREAD_LOOP_ONLY();
	if (!r)
		r = check_submit(j, p, generation, &view, &err);
	if (!r && !p->bound && !p->fresh)
		job = find_same(j, p, generation, view);
	/* A job without a row may still be refused, so it is not reused. */
	if (job && !job->waiting_row) {
		free(view);
		change_priority(job, p, priority);
		accepted(token, NULL, job);
		return;
	}
	job = r ? NULL : make_job(j, p, view, priority, &err);
	if (!job) {
		free(view);
		accepted(token, &err, NULL);
		return;
	}
	if (job_plan_file_new(job, &err)) {
		accepted(token, &err, NULL);
		job->state = JOB_failed;
		job->removed = true;
		return;
	}
	plan_file_fresh(job->plan);
	job->accepted = accepted;
	job->token = token;
	start_job(job);
}
