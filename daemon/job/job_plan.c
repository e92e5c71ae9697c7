/*
 * Plans: those that are asked for, which only tell, and the files that jobs keep theirs in.
 *
 * The plan of an unbound job lies in the state folder and goes with the job. That of a bound one, for later streams
 * of its connection, need not outlive the daemon and lies among the temporary files.
 */
#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <unistd.h>

#include "io.h"
#include "job_priv.h"
#include "log.h"
#include "history.h"
#include "plan_file.h"

/* ---- plans that are asked for ---- */

static void plan_ended(void *ctx, const struct err *why)
{
	struct job_asked_plan *p = ctx;

	p->run_ended = true;
	p->failed = why != NULL;
	if (why)
		p->err = *why;
}

static const struct run_calls plan_calls = {.ended = plan_ended};

/* Bytes of a stored domain a point: 2 triangles of 12, a vertex of 12, open links; triangles of 6, and vertices of 10 or less,
 * where it has no more vertices than two bytes can tell apart (store_format.c). */
enum { STORED_BYTES = 38, STORED_SMALL = 24, SMALL = 1 << 16 };

/* Seconds a point of the newest finished job that was large enough to tell; 0: none. */
static double pace(struct jobs *j)
{
	enum { TELLING = 100000 };
	const struct job *job;

	/* What a selection left out was not meshed. */
	for (uint64_t id = UINT64_MAX; (job = history_before(j, id)); id = job->id) {
		const uint64_t *removed = job->report.removed;
		uint64_t points = job->report.points - removed[VIEW_BY_CROP] - removed[VIEW_BY_EVERY] - removed[VIEW_BY_THIN];

		/* Waiting is not work, nor is what was found finished; reports of older versions do not tell them apart. */
		double took = job->report.worked_seconds > 0 ? job->report.worked_seconds : job->report.seconds;

		if (job->has_report && !job->report.domains_reused && points >= TELLING && took > 0)
			return took / (double)points;
	}
	return 0;
}

static void plan_answer(struct job_asked_plan *p)
{
	const struct cut_plan *plan = run_plan(p->run);
	const struct pipe_budget *budget = run_budget(p->run);
	bool window = run_view(p->run)->window;
	uint64_t points = run_grid_points(p->run);
	size_t i;

	/* A window is made of the points of its pieces, and of it nothing is stored. */
	for (i = 0, points = window ? 0 : points; window && i < plan->n; i++)
		points += plan->leaf[i].count;
	struct job_plan out = {
		.points = points,
		.domains = plan->n,
		.domains_reused = run_reused(p->run),
		.memory_bytes = (uint64_t)budget->domain_bytes * (budget->threads + 1) +
				admission_emitter_share(p->jobs->admission) + admission_index_share(p->jobs->admission),
		.disk_bytes = window ? 0 : points * (budget->load <= SMALL ? STORED_SMALL : STORED_BYTES),
		.exact = true,
		.load = budget->load,
		.threads = budget->threads,
		.seconds = pace(p->jobs) * (double)points,
	};

	if (plan->n)
		/* To take one from the store is not for nothing. */
		out.seconds *= 1 - 0.98 * (double)out.domains_reused / (double)plan->n;

	for (i = 0; i < plan->n; i++)
		out.exact &= plan->leaf[i].exact;
	p->planned(p->token, NULL, &out);
}

void job_plans_settle(struct jobs *j)
{
	struct job_asked_plan **at = &j->plans, *p;

	while ((p = *at)) {
		if (p->run && !p->run_ended)
			run_tick(p->run);
		if (!p->run_ended) {
			at = &p->next;
			continue;
		}
		*at = p->next;
		if (p->failed)
			p->planned(p->token, &p->err, NULL);
		else
			plan_answer(p);
		run_free(p->run);
		free(p);
	}
}

static void plan_granted(struct slot *slot)
{
	struct job_asked_plan *p = (struct job_asked_plan *)((char *)slot - offsetof(struct job_asked_plan, slot));

	run_begin(p->run);
}

/* Those that have not begun would never. */
void job_plans_park(struct jobs *j)
{
	struct job_asked_plan *p;
	struct err err = ERR_INIT;

	err_set(&err, ERR_BUSY, "the daemon is stopping");
	for (p = j->plans; p; p = p->next)
		if (p->run && !p->run_ended)
			run_stop(p->run, &err);
}

void job_plan(struct jobs *j, struct dataset *d, uint64_t generation, const char *view, const struct peer *peer,
	      void (*planned)(void *token, const struct err *why, const struct job_plan *), void *token)
{
	struct job_asked_plan *p = calloc(1, sizeof *p);
	struct run_params params = {
		.runs = j->runs,
		.dataset = d,
		.generation = generation ? generation : d->generation,
		.plan_only = true,
		.client = true,
		.owner = {.uid = peer->uid, .exempt = rights_admin(peer)},
		.slot = p ? &p->slot : NULL,
		.calls = &plan_calls,
		.ctx = p,
	};
	char *text = NULL;
	struct err err = ERR_INIT;

	THREAD_LOOP_ONLY();
	if (!p)
		err_set(&err, ERR_NOMEM, "no memory for a plan");
	else if (j->core->stopping)
		err_set(&err, ERR_BUSY, "the daemon is stopping");
	else if (!dataset_check_generation(d, generation, &err) && !job_view(view, d, &text, &err)) {
		params.view_text = text;
		run_new(&params, &p->run, &err);
		free(text);
	}
	if (err.code) {
		free(p);
		planned(token, &err, NULL);
		return;
	}
	p->jobs = j;
	p->peer = rights_without_groups(peer);
	p->slot.owner = params.owner;
	p->slot.granted = plan_granted;
	p->err = ERR_INIT;
	p->planned = planned;
	p->token = token;
	p->next = j->plans;
	j->plans = p;
	slot_request(j->admission, &p->slot, 0);
	slots_grant(j->admission);
}

/* ---- plans that are kept ---- */

int job_plan_new(struct job *job, struct err *err)
{
	const struct jobs *j = job->jobs;

	job->plan = plan_file_new(job->bound ? j->core->tempfd : j->core->plansfd, job->id, job->generation, !job->bound,
				  j->core->p.ledger);
	return job->plan ? 0 : err_set(err, ERR_NOMEM, "no memory for a job");
}

struct drop {
	struct sched_task task;
	struct jobs *jobs;
	struct plan_file *plan;
};

static void drop_run(struct sched_task *t)
{
	struct err err = ERR_INIT;

	if (plan_file_remove(((struct drop *)t)->plan, &err))
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "the plan of a job that is gone stays until the next start", &err);
}

static void drop_done(struct sched_task *t)
{
	struct drop *d = (struct drop *)t;

	core_background_done(d->jobs->core);
	plan_file_free(d->plan);
	free(d);
}

void job_plan_drop(struct job *job)
{
	struct drop *d = job->plan ? calloc(1, sizeof *d) : NULL;

	if (!d)
		return;
	d->task =
		(struct sched_task){.run = drop_run, .done = drop_done, .owner = {.uid = job->peer.uid}, .priority = SCHED_LAST};
	d->jobs = job->jobs;
	d->plan = job->plan;
	job->plan = NULL;
	core_background(d->jobs->core, &d->task);
}

/* ---- plans of jobs that are not there ---- */

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

static bool was_there(void *ctx, uint64_t job)
{
	const struct sweep *s = ctx;

	return s->n && bsearch(&job, s->job, s->n, sizeof job, by_number);
}

static bool is_there(void *ctx, uint64_t job)
{
	return history_has(ctx, job);
}

static void sweep_told(int r, const struct err *err)
{
	if (r)
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "plans of jobs that are not there stay until the next start", err);
}

static void sweep_run(struct sched_task *t)
{
	struct sweep *s = (struct sweep *)t;
	struct err err = ERR_INIT;

	sweep_told(plan_file_sweep(s->jobs->core->plansfd, s->last, was_there, s, &err), &err);
}

static void sweep_done(struct sched_task *t)
{
	struct sweep *s = (struct sweep *)t;

	core_background_done(s->jobs->core);
	uncharge(s->jobs->core, s->n * sizeof *s->job);
	free(s);
}

/* Also what a write left that a crash cut short. The folder has a file for each job: nobody waits until it is looked through,
 * unless there is no memory for the numbers of those that are there. */
void job_plan_sweep(struct jobs *j)
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
		sweep_told(plan_file_sweep(j->core->plansfd, j->last_job, is_there, j, &err), &err);
		return;
	}
	*s = (struct sweep){.jobs = j, .n = n, .last = j->last_job};
	s->task = (struct sched_task){.run = sweep_run, .done = sweep_done, .priority = SCHED_LAST};
	history_numbers(j, s->job);
	deferred_submit(j->core, &s->task);
}
