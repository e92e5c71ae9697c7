/*
 * All jobs: what is done with each in a round of the loop, how many finished jobs are kept, and for how long.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "history.h"
#include "job_fetch.h"
#include "job_priv.h"

/* Finished jobs: how many are kept, and for how long. */
enum { JOBS_KEPT = 20000, JOBS_DAYS = 30, OLD_AT_ONCE = 64 };
/* Number of finished jobs kept unpacked. */
enum { JOBS_UNPACKED_MAX = 64 };
enum { JOBS_NAMED = 8 }; /* in a message */
#define DAY_US INT64_C(86400000000)
#define AGE_US INT64_C(3600000000) /* how often jobs that are too old are searched for */

/* ---- called by the core ---- */

static uint64_t history_held(void *ctx)
{
	return history_bytes(ctx);
}

static bool forget_finished(void *ctx, uint32_t uid, uint64_t more)
{
	return jobs_forget_one(ctx, HISTORY_BYTES, uid, more);
}

/* ---- called by datasets ---- */

static int jobs_needed(void *ctx, const struct dataset *d, uint64_t oldest, struct err *err)
{
	const struct jobs *j = ctx;
	char list[160] = "";
	size_t n = 0, at = 0;

	for (const struct job *job = j->jobs; job; job = job->next) {
		if (job->dataset != d || job->removed || job_state_final(job->state) || job->generation >= oldest)
			continue;
		if (n++ < JOBS_NAMED)
			at += (size_t)snprintf(list + at, sizeof list - at, "%s%llu", at ? ", " : "",
					       (unsigned long long)job->id);
	}
	if (!n)
		return 0;
	err_set(err, ERR_BUSY, "%zu job%s of generations before %llu of %s %s not done: %s%s", n, n == 1 ? "" : "s",
		(unsigned long long)oldest, d->name, n == 1 ? "is" : "are", list, n > JOBS_NAMED ? ", ..." : "");
	return err_add_hint(err, "wait for %s, or cancel %s", n == 1 ? "it" : "them", n == 1 ? "it" : "them");
}

static void jobs_forget_dataset(void *ctx, struct dataset *d)
{
	struct jobs *j = ctx;

	for (struct job *job = j->jobs; job; job = job->next)
		if (job->dataset == d && job_state_final(job->state) && !job->run && !job->fetches && !job->waiting_row) {
			job->dataset = NULL;
			dataset_unhold(d);
		}
	history_forget_dataset(j, d);
}

static const struct datasets_calls dataset_calls = {.needed = jobs_needed, .forget = jobs_forget_dataset};

int jobs_new(const struct jobs_params *p, struct jobs **ret, struct err *err)
{
	struct jobs *j = calloc(1, sizeof *j);

	if (!j)
		return err_set(err, ERR_NOMEM, "no memory for the daemon");
	j->core = p->core;
	j->admission = p->admission;
	j->datasets = p->datasets;
	j->runs = p->runs;
	j->changed = p->changed;
	j->changed_ctx = p->ctx;
	j->core->history = (struct core_history){j, history_held, forget_finished};
	datasets_set_calls(j->datasets, &dataset_calls, j);
	*ret = j;
	return 0;
}

void jobs_loaded(struct jobs *j, uint64_t last)
{
	free(j->spare);
	j->spare = NULL;
	j->last_job = last;
	job_plan_file_sweep(j);
}

struct jobs *jobs_free(struct jobs *j)
{
	struct job *job;

	if (!j)
		return NULL;
	while ((job = j->jobs)) {
		/* The datasets are freed next, with or without users. */
		job->dataset = NULL;
		job_free(job);
	}
	history_free(j);
	deletions_free(j);
	free(j->spare);
	free(j);
	return NULL;
}

/* ---- forgetting finished jobs ---- */

/* Removes a packed job for good. */
static bool forget_job(struct jobs *j, struct job *job)
{
	struct err err = ERR_INIT;

	return job && job->unpacked && !job_remove(job, &err);
}

static bool is_idle(const struct job *job)
{
	return !job->run && !job->fetches && !job->waiting_row;
}

static bool can_be_packed(const struct job *job)
{
	return job_state_final(job->state) && is_idle(job) && !job->removed && !job->bound;
}

void jobs_pack_finished(struct jobs *j)
{
	struct job *job, *next;

	for (job = j->jobs; job; job = next) {
		next = job->next;
		if (can_be_packed(job))
			history_pack(job);
	}
}

bool jobs_forget_one(struct jobs *j, enum history_kind kind, uint32_t uid, uint64_t more)
{
	struct err err = ERR_INIT;
	struct job *job;

	THREAD_LOOP_ONLY();
	for (job = j->jobs; job && !(job->removed && is_idle(job) && job_state_final(job->state)); job = job->next)
		;
	/* Count jobs by owner, including those still unpacked. */
	if (!job)
		jobs_pack_finished(j);
	if (!job && forget_job(j, history_oldest_of_largest(j, kind, uid, more)))
		return true;
	for (job = job ? job : j->jobs; job; job = job->next)
		if (job_state_final(job->state) && is_idle(job) && !job->bound && (job->removed || !job_remove(job, &err)))
			break;
	if (!job)
		return false;
	job_plan_file_drop(job);
	job_free(job);
	return true;
}

/* By number and by age. */
static void forget_old_jobs(struct jobs *j)
{
	int64_t now = clock_real_us();
	unsigned n = 0;

	while (history_count(j) > JOBS_KEPT && forget_job(j, history_oldest_of_largest(j, HISTORY_JOBS, 0, 0)))
		;
	if (now - j->aged_us < AGE_US && now >= j->aged_us)
		return;
	/* A few at a time, and no more until they are written: each is a change of the catalogue, whose queue is short. A client
	 * whose change finds the queue full waits for the disk. */
	if (catalogue_busy(j->core->p.catalogue))
		return;
	while (n < OLD_AT_ONCE && forget_job(j, history_oldest(j, now - JOBS_DAYS * DAY_US)))
		n++;
	if (n < OLD_AT_ONCE)
		j->aged_us = now;
}

/* Frees removed jobs that nothing uses, and packs the oldest finished ones. */
static void tidy_jobs(struct jobs *j)
{
	struct job *job, *next;
	unsigned unpacked = 0;

	for (job = j->jobs; job; job = next) {
		next = job->next;
		if (job->removed && is_idle(job) && (job_state_final(job->state) || !job->dataset || job->state == JOB_queued)) {
			job_plan_file_drop(job);
			job_free(job);
		} else if (can_be_packed(job)) {
			unpacked++;
		}
	}
	for (job = j->jobs; unpacked > JOBS_UNPACKED_MAX && job; job = next) {
		next = job->next;
		if (can_be_packed(job) && history_pack(job))
			unpacked--;
	}
	forget_old_jobs(j);
	history_round(j);
}

void jobs_settle(struct jobs *j)
{
	THREAD_LOOP_ONLY();
	for (struct job *job = j->jobs; job; job = job->next)
		job_settle(job);
	job_plans_settle(j);
}

void jobs_tidy(struct jobs *j)
{
	THREAD_LOOP_ONLY();
	tidy_jobs(j);
	deletions_settle(j);
}

void jobs_tick(struct jobs *j)
{
	THREAD_LOOP_ONLY();
	for (struct job *job = j->jobs; job; job = job->next)
		job_tick(job);
}

void jobs_park(struct jobs *j)
{
	THREAD_LOOP_ONLY();
	job_plans_park(j);
	for (struct job *job = j->jobs; job; job = job->next) {
		if (job->bound)
			job_cancel(job);
		job_fetch_park(job);
	}
}

bool jobs_busy(const struct jobs *j, bool queued)
{
	if (j->plans)
		return true;
	for (const struct job *job = j->jobs; job; job = job->next)
		if (job->run || job->fetches || (queued && !job_state_final(job->state)))
			return true;
	return false;
}

double jobs_longest(const struct jobs *j)
{
	double longest = -1;

	for (const struct job *job = j->jobs; job; job = job->next)
		if (job->run && job->begun_ns && clock_since(job->begun_ns) > longest)
			longest = clock_since(job->begun_ns);
	return longest;
}

void jobs_unfinished(const struct jobs *j, void (*each)(void *ctx, uint32_t uid), void *ctx)
{
	for (const struct job *job = j->jobs; job; job = job->next)
		if (!job_state_final(job->state))
			each(ctx, job->peer.uid);
}

unsigned jobs_owned(const struct jobs *j, uint32_t uid)
{
	unsigned n = 0;

	for (const struct job *job = j->jobs; job; job = job->next)
		n += !job->removed && !job_state_final(job->state) && job->peer.uid == uid;
	return n;
}

void jobs_count(const struct jobs *j, uint32_t *ret_running, uint32_t *ret_waiting)
{
	uint32_t running = 0, waiting = 0;
	struct job *job;

	for (job = j->jobs; job; job = job->next) {
		if (job->run)
			running++;
		else if (!job_state_final(job->state))
			waiting++;
	}
	*ret_running = running;
	*ret_waiting = waiting;
}

size_t jobs_kept(const struct jobs *j)
{
	return history_count(j);
}

size_t jobs_list(const struct jobs *j, uint64_t *ret)
{
	return history_list(j, ret);
}

void jobs_stat(const struct jobs *j, struct jobs_stat *ret)
{
	int64_t now = clock_real_us(), oldest = now;

	*ret = (struct jobs_stat){.kept = history_count(j)};
	for (const struct job *job = j->jobs; job; job = job->next) {
		uint64_t points, all, done, total;

		if (job->run) {
			run_progress(job->run, &points, &all, &done, &total);
			ret->domains_done += done;
			ret->domains_total += total;
		}
		if (job_state_final(job->state))
			continue;
		ret->states[job->state]++;
		if (job->state == JOB_queued && job->submitted_us < oldest)
			oldest = job->submitted_us;
		ret->waiting_space += job->run && run_space_missing(job->run) > 0;
	}
	ret->oldest_waiting = (double)(now - oldest) / 1e6;
}

static void each_holder(const struct run *w, struct core_holder h, void (*each)(void *ctx, const struct core_holder *), void *ctx)
{
	if (!w)
		return;
	h.dataset = run_dataset(w)->name;
	run_held(w, h.held);
	each(ctx, &h);
}

void jobs_held(const struct jobs *j, void (*each)(void *ctx, const struct core_holder *), void *ctx)
{
	for (const struct job *job = j->jobs; job; job = job->next) {
		each_holder(job->run, (struct core_holder){.kind = "job", .id = job->id, .peer = job->peer}, each, ctx);
		for (const struct job_fetch *f = job->fetches; f; f = f->next)
			each_holder(f->run, (struct core_holder){.kind = "fetch", .id = job->id, .peer = job->peer}, each, ctx);
	}
	for (const struct job_plan_request *plan = j->plans; plan; plan = plan->next)
		each_holder(plan->run, (struct core_holder){.kind = "plan", .peer = plan->peer}, each, ctx);
}
