/*
 * Who holds memory: runs, pushes.
 *
 * The model: the ledger knows sums by name; who of several holds what is told from what each of them would give
 * back. A task's bytes are its own until the loop hears of its end, then they are where the loop keeps them. What a
 * worker is about to change is left out: it is of its task.
 */
#include "job_priv.h"
#include "push_priv.h"
#include "run_priv.h"

static void task_held(struct sched *s, const struct sched_task *t, uint64_t held[LEDGER_NAMES])
{
	uint64_t bytes = sched_taken(s, t);

	if (bytes)
		held[t->name] += bytes;
}

static void run_held(const struct run *w, uint64_t held[LEDGER_NAMES])
{
	struct sched *s = w->jobs->core->p.sched;
	const struct run_domain *d;

	task_held(s, &w->task, held);
	task_held(s, &w->output_task, held);
	held[LEDGER_DOMAIN] += w->planning.held;
	held[LEDGER_EMITTER] += w->emitter_bytes;
	held[LEDGER_PIPE] += w->output_buffer ? JOB_OUTPUT_BUFFER : 0;
	for (d = w->domains; d; d = d->next) {
		uint64_t taken = sched_taken(s, &d->task);

		/* A lent arena is the run's. */
		held[LEDGER_DOMAIN] += taken ? taken : d->lent && d->state == DOMAIN_MAKING ? 0 : d->size;
	}
	held[LEDGER_DOMAIN] += w->arenas.charged;
	/* Workers have it in these states. */
	if (!w->splitting && w->state >= RUN_RUNNING)
		held[LEDGER_PLAN] += w->plan.cap * sizeof *w->plan.leaf + cut_sites_bytes(w->plan.sites);
	held[LEDGER_JOBS] += w->charged;
	/* Workers open and close it in these states. */
	if (w->grid && w->state != RUN_OPENING && w->state != RUN_SELECTING) {
		held[LEDGER_INDEX] += grid_charged(w->grid);
		held[LEDGER_MANIFEST] += grid_manifest(w->grid)->charged;
	}
}

static void push_held(const struct push *p, uint64_t held[LEDGER_NAMES])
{
	const struct push_stream *s;

	held[LEDGER_JOBS] += p->charged;
	task_held(p->jobs->core->p.sched, &p->task, held);
	/* A stage that is about to be made is known to plans, but taken only by its task. */
	if (p->stage_bytes && !(p->busy && p->asks && p->asks->kind == PUSH_STAGE))
		held[LEDGER_STAGE] += p->stage_bytes;
	held[LEDGER_FILES] += p->table_bytes;
	/* Workers read and free these in some asks. */
	if (!p->busy || p->lacks) {
		held[LEDGER_MANIFEST] += p->base ? p->base->charged : 0;
		held[LEDGER_MANIFEST] += p->adopt ? p->adopt->charged : 0;
	}
	if (p->asks && p->asks->crew)
		held[LEDGER_INPUT] += push_helpers_held(p->asks->crew);
	for (s = p->streams; s; s = s->next)
		task_held(p->jobs->core->p.sched, &s->task, held);
}

static void tell(const struct job_holder *h, void (*each)(void *, const struct job_holder *), void *ctx)
{
	for (int i = 0; i < LEDGER_NAMES; i++)
		if (h->held[i]) {
			each(ctx, h);
			return;
		}
}

static void tell_run(const struct run *w, struct job_holder h, void (*each)(void *, const struct job_holder *), void *ctx)
{
	if (!w)
		return;
	h.dataset = w->dataset->name;
	run_held(w, h.held);
	tell(&h, each, ctx);
}

void jobs_holders(struct jobs *j, void (*each)(void *ctx, const struct job_holder *), void *ctx)
{
	const struct job_asked_plan *plan;
	const struct job_fetch *f;
	const struct job *job;
	const struct push *p;

	for (job = j->jobs; job; job = job->next) {
		tell_run(job->run, (struct job_holder){.kind = "job", .id = job->id, .peer = job->peer}, each, ctx);
		for (f = job->fetches; f; f = f->next)
			tell_run(f->run, (struct job_holder){.kind = "fetch", .id = job->id, .peer = job->peer}, each, ctx);
	}
	for (plan = j->plans; plan; plan = plan->next)
		tell_run(plan->run, (struct job_holder){.kind = "plan", .peer = plan->peer}, each, ctx);
	for (p = j->pushes; p; p = push_next(p)) {
		struct job_holder h = {.kind = "push", .id = p->id, .peer = p->peer, .dataset = p->dataset->name};

		push_held(p, h.held);
		tell(&h, each, ctx);
	}
}
