/*
 * All jobs: those at work in a list, the others in history.h; which are forgotten, and when.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "history.h"
#include "job_fetch.h"
#include "job_priv.h"

/* Of jobs that are over: so many, for so long. */
enum { JOBS_KEPT = 20000, JOBS_DAYS = 30, AGED_MAX = 64 };
/* Of jobs that are over so many stay as they are. */
enum { JOBS_WARM = 64 };
enum { JOBS_NAMED = 8 }; /* in a message */
#define DAY_US INT64_C(86400000000)
#define AGE_US INT64_C(3600000000) /* how often the oldest are looked for */

/* ---- what the core asks ---- */

static uint64_t history_held(void *ctx)
{
	return history_bytes(ctx);
}

static bool forget_finished(void *ctx, uint32_t uid, uint64_t more)
{
	return jobs_forget_one(ctx, HISTORY_BYTES, uid, more);
}

/* ---- what datasets ask ---- */

static int jobs_need(void *ctx, const struct dataset *d, uint64_t oldest, struct err *err)
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

static const struct datasets_calls dataset_calls = {.needed = jobs_need, .forget = jobs_forget_dataset};

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
	job_plan_sweep(j);
}

struct jobs *jobs_free(struct jobs *j)
{
	struct job *job;

	if (!j)
		return NULL;
	while ((job = j->jobs)) {
		/* The datasets go next, whoever uses them. */
		job->dataset = NULL;
		job_free(job);
	}
	history_free(j);
	deletions_free(j);
	free(j->spare);
	free(j);
	return NULL;
}

/* ---- forgetting ---- */

/* Removes it for good. Not of those at work. */
static bool forget(struct jobs *j, struct job *job)
{
	struct err err = ERR_INIT;

	return job && job->guest && !job_remove(job, &err);
}

static bool idle(const struct job *job)
{
	return !job->run && !job->fetches && !job->waiting_row;
}

static bool over(const struct job *job)
{
	return job_state_final(job->state) && idle(job) && !job->removed && !job->bound;
}

void jobs_put_away(struct jobs *j)
{
	struct job *job, *next;

	for (job = j->jobs; job; job = next) {
		next = job->next;
		if (over(job))
			history_keep(job);
	}
}

bool jobs_forget_one(struct jobs *j, enum history_kind kind, uint32_t uid, uint64_t more)
{
	struct err err = ERR_INIT;
	struct job *job;

	for (job = j->jobs; job && !(job->removed && idle(job) && job_state_final(job->state)); job = job->next)
		;
	/* Whose they are counts, not where they lie: those that are warm as well. */
	if (!job)
		jobs_put_away(j);
	if (!job && forget(j, history_of_most(j, kind, uid, more)))
		return true;
	for (job = job ? job : j->jobs; job; job = job->next)
		if (job_state_final(job->state) && idle(job) && !job->bound && (job->removed || !job_remove(job, &err)))
			break;
	if (!job)
		return false;
	job_plan_drop(job);
	job_free(job);
	return true;
}

/* Jobs that are over are listed for so long, and so many of them. */
static void forget_old(struct jobs *j)
{
	int64_t now = clock_real_us();
	unsigned n = 0;

	while (history_count(j) > JOBS_KEPT && forget(j, history_of_most(j, HISTORY_JOBS, 0, 0)))
		;
	if (now - j->aged_us < AGE_US && now >= j->aged_us)
		return;
	/* Some at a time, and no more until these are written: each is a change of the catalogue, which has room for so many,
	 * and whoever comes then would wait for the disk, with all others behind him. */
	if (catalogue_busy(j->core->p.catalogue))
		return;
	while (n < AGED_MAX && forget(j, history_oldest(j, now - JOBS_DAYS * DAY_US)))
		n++;
	if (n < AGED_MAX)
		j->aged_us = now;
}

/* Removed jobs go when nothing of theirs is left; the oldest that are over leave the ones at work. */
static void put_away(struct jobs *j)
{
	struct job *job, *next;
	unsigned warm = 0;

	for (job = j->jobs; job; job = next) {
		next = job->next;
		if (job->removed && idle(job) && (job_state_final(job->state) || !job->dataset || job->state == JOB_queued)) {
			job_plan_drop(job);
			job_free(job);
		} else if (over(job)) {
			warm++;
		}
	}
	for (job = j->jobs; warm > JOBS_WARM && job; job = next) {
		next = job->next;
		if (over(job) && history_keep(job))
			warm--;
	}
	forget_old(j);
	history_round(j);
}

void jobs_settle(struct jobs *j)
{
	for (struct job *job = j->jobs; job; job = job->next)
		job_settle(job);
	job_plans_settle(j);
}

void jobs_tidy(struct jobs *j)
{
	put_away(j);
	deletions_settle(j);
}

void jobs_tick(struct jobs *j)
{
	for (struct job *job = j->jobs; job; job = job->next)
		job_tick(job);
}

void jobs_park(struct jobs *j)
{
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
		ret->waiting_space += job->run && run_space_lacks(job->run) > 0;
	}
	ret->oldest_waiting = (double)(now - oldest) / 1e6;
}

static void held_by(const struct run *w, struct core_holder h, void (*each)(void *ctx, const struct core_holder *), void *ctx)
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
		held_by(job->run, (struct core_holder){.kind = "job", .id = job->id, .peer = job->peer}, each, ctx);
		for (const struct job_fetch *f = job->fetches; f; f = f->next)
			held_by(f->run, (struct core_holder){.kind = "fetch", .id = job->id, .peer = job->peer}, each, ctx);
	}
	for (const struct job_asked_plan *plan = j->plans; plan; plan = plan->next)
		held_by(plan->run, (struct core_holder){.kind = "plan", .peer = plan->peer}, each, ctx);
}
