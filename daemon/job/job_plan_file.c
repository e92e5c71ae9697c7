/*
 * The files in which jobs keep their plans.
 *
 * The plan of an unbound job lies in the state folder and is removed with the job. That of a bound job serves later streams of
 * its client only; it lies among the temporary files, and no restart needs it.
 */
#include <stdlib.h>

#include "history.h"
#include "job_priv.h"
#include "log.h"
#include "plan_file.h"

/* ---- the file of one job ---- */

int job_plan_file_new(struct job *job, struct err *err)
{
	const struct jobs *j = job->jobs;

	job->plan = plan_file_new(job->bound ? j->core->tempfd : j->core->plansfd, job->id, job->generation, !job->bound,
				  j->core->p.ledger);
	return job->plan ? 0 : err_set(err, ERR_NOMEM, "no memory for a job");
}

struct plan_removal {
	struct sched_task task;
	struct jobs *jobs;
	struct plan_file *plan;
};

static void removal_run(struct sched_task *t)
{
	struct err err = ERR_INIT;

	if (plan_file_remove(((struct plan_removal *)t)->plan, &err))
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "the plan of a removed job stays until the next start", &err);
}

static void removal_done(struct sched_task *t)
{
	struct plan_removal *d = (struct plan_removal *)t;

	core_background_done(d->jobs->core);
	plan_file_free(d->plan);
	free(d);
}

void job_plan_file_drop(struct job *job)
{
	struct plan_removal *d = job->plan ? calloc(1, sizeof *d) : NULL;

	if (!d)
		return;
	d->task = (struct sched_task){
		.run = removal_run, .done = removal_done, .owner = {.uid = job->peer.uid}, .priority = SCHED_LAST};
	d->jobs = job->jobs;
	d->plan = job->plan;
	job->plan = NULL;
	core_background(d->jobs->core, &d->task);
}

/* ---- files of jobs that do not exist ---- */

struct sweep {
	struct sched_task task;
	struct jobs *jobs;
	uint64_t last;
	size_t n;
	uint64_t job[];
};

static int by_number(const void *a, const void *b)
{
	uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;

	return x < y ? -1 : x > y;
}

static bool sweep_keeps(void *ctx, uint64_t job)
{
	const struct sweep *s = ctx;

	return s->n && bsearch(&job, s->job, s->n, sizeof job, by_number);
}

static bool jobs_keep(void *ctx, uint64_t job)
{
	return history_has(ctx, job);
}

static void sweep_log(int r, const struct err *err)
{
	if (r && r != -ERR_CANCELLED)
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "plans of removed jobs stay until the next start", err);
}

static void sweep_run(struct sched_task *t)
{
	struct sweep *s = (struct sweep *)t;
	struct err err = ERR_INIT;

	sweep_log(plan_file_sweep(s->jobs->core->plansfd, s->last, sweep_keeps, s, &t->cancel, &err), &err);
}

static void sweep_done(struct sched_task *t)
{
	struct sweep *s = (struct sweep *)t;

	deferred_done(s->jobs->core, t);
	uncharge(s->jobs->core, s->n * sizeof *s->job);
	free(s);
}

/* Also removes temporary files of interrupted writes. The folder has a file for each job, so a worker reads it later, unless
 * there is no memory for the list of numbers. */
void job_plan_file_sweep(struct jobs *j)
{
	size_t n = history_count(j);
	struct err err = ERR_INIT;
	struct sweep *s = NULL;

	if (!charge(j->core, n * sizeof *s->job, "the numbers of jobs", &err)) {
		s = malloc(sizeof *s + n * sizeof *s->job);
		if (!s)
			uncharge(j->core, n * sizeof *s->job);
	}
	err_clear(&err);
	if (!s) {
		sweep_log(plan_file_sweep(j->core->plansfd, j->last_job, jobs_keep, j, NULL, &err), &err);
		return;
	}
	*s = (struct sweep){.jobs = j, .n = n, .last = j->last_job};
	s->task = (struct sched_task){.run = sweep_run, .done = sweep_done, .priority = SCHED_LAST};
	history_numbers(j, s->job);
	deferred_submit(j->core, &s->task);
}
