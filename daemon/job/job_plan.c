/*
 * Plans that are asked for without a job.
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

static void plan_ended(void *ctx, const struct err *why)
{
	struct job_plan_request *p = ctx;

	p->run_ended = true;
	p->failed = why != NULL;
	if (why)
		p->err = *why;
}

static const struct run_calls plan_calls = {.ended = plan_ended};

/* Bytes of a stored domain a point: two triangles of 12 bytes, a vertex of 12, open links. Domains whose vertices have two-byte
 * numbers: triangles of 6 bytes, vertices of 10 or less (store_format.c). */
enum { STORED_BYTES = 38, STORED_SMALL = 24, SMALL = 1 << 16 };

/* From the newest finished job that is large enough; 0: there is none. */
static double seconds_a_point(struct jobs *j)
{
	enum { TELLING = 100000 };
	const struct job *job;

	/* Points that a selection left out were not meshed. */
	for (uint64_t id = UINT64_MAX; (job = history_before(j, id)); id = job->id) {
		uint64_t points = job->report.points;

		for (unsigned i = 0; i < VIEW_RULES; i++)
			points -= view_rule_selects((enum view_rule)i) ? job->report.removed[i] : 0;
		/* Without waiting, and only of jobs that reused no domains. Reports of older versions do not have
		 * worked_seconds. */
		double took = job->report.worked_seconds > 0 ? job->report.worked_seconds : job->report.seconds;

		if (job->has_report && !job->report.domains_reused && points >= TELLING && took > 0)
			return took / (double)points;
	}
	return 0;
}

static void plan_answer(struct job_plan_request *p)
{
	const struct cut_plan *plan = run_plan(p->run);
	const struct pipe_budget *budget = run_budget(p->run);
	bool window = run_view(p->run)->window;
	uint64_t points = run_grid_points(p->run);
	size_t i;

	/* A window has the points of its pieces, and its domains are not stored. */
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
		.seconds = seconds_a_point(p->jobs) * (double)points,
	};

	if (plan->n)
		/* Reading a stored domain costs something, too. */
		out.seconds *= 1 - 0.98 * (double)out.domains_reused / (double)plan->n;

	for (i = 0; i < plan->n; i++)
		out.exact &= plan->leaf[i].exact;
	p->planned(p->token, NULL, &out);
}

void job_plans_settle(struct jobs *j)
{
	struct job_plan_request **at = &j->plans, *p;

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
	struct job_plan_request *p = (struct job_plan_request *)((char *)slot - offsetof(struct job_plan_request, slot));

	run_begin(p->run);
}

/* Plans that wait for a slot would never get one. */
void job_plans_park(struct jobs *j)
{
	struct job_plan_request *p;
	struct err err = ERR_INIT;

	err_set(&err, ERR_BUSY, "the daemon is stopping");
	for (p = j->plans; p; p = p->next)
		if (p->run && !p->run_ended)
			run_stop(p->run, &err);
}

void job_plan(struct jobs *j, struct dataset *d, uint64_t generation, const char *view, const struct peer *peer,
	      void (*planned)(void *token, const struct err *why, const struct job_plan *), void *token)
{
	struct job_plan_request *p = calloc(1, sizeof *p);
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
