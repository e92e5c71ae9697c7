/* The domains of a run in the store of finished domains: searched, read, written, and recorded in the job's plan. */
#include "clock.h"
#include "log.h"
#include "recency.h"
#include "run_priv.h"
#include "store.h"

/* Domains of a one-step dataset are removed with it. */
int run_store(const struct run *w)
{
	return w->dataset->onestep ? w->dataset->dirfd : w->runs->core->domainsfd;
}

bool run_recent(void *run, struct digest base, struct digest *ret_list)
{
	struct store_id id;
	bool is = recency_find(((const struct run *)run)->runs->recency, base, &id);

	if (is)
		*ret_list = id.list;
	return is;
}

bool run_recall(void *run, struct digest base, struct pipe_summary *ret)
{
	return recency_find(((const struct run *)run)->runs->summaries, base, ret);
}

void run_remember(void *run, const struct pipe_summary *summary)
{
	const struct run *w = run;

	if (!w->dataset->onestep)
		recency_note(w->runs->summaries, summary);
}

void run_used(const struct run *w, const struct pipe_stored *as, int64_t now_ns)
{
	recency_note(w->runs->recency, &as->id);
	if (as->used_ns < now_ns - STORE_TOUCH_NS)
		store_touch(run_store(w), &as->id, now_ns - STORE_TOUCH_NS);
}

/* Only for the job's own run: later streams have the same domains. */
void run_domain_record(struct run_domain *d)
{
	struct run *w = d->run;
	struct plan_done done = {.region = d->region,
				 .base = d->as.id.base,
				 .list = d->as.id.list,
				 .digest = d->as.digest,
				 .payload = d->as.payload,
				 .triangles = d->as.triangles,
				 .bytes = d->as.bytes};
	struct err err = ERR_INIT;

	if (w->file && w->keep && !w->lazy && plan_file_done(w->file, &done, 1, &err))
		log_err(LOG_LEVEL_DEBUG, "a finished domain is not recorded in the plan", &err);
}

/* Each one is an event, so that they are counted. */
void run_event_damaged(const struct run *w, unsigned n)
{
	while (n--)
		log_event(LOG_EVENT_DAMAGE_DERIVED, ABOUT_RUN(w), "a stored domain of %s was damaged: it is made again",
			  w->dataset->name);
}

struct pipe_reuse_params run_domain_reuse(struct run_domain *d)
{
	struct run *w = d->run;

	return (struct pipe_reuse_params){.storefd = run_store(w),
					  .grid = w->grid,
					  .view = &w->grid_view,
					  .key = &w->key,
					  .region = &d->region,
					  .cap = w->budget.cap,
					  .memory = d->memory,
					  .size = d->size,
					  .light = d->numbering_only,
					  .sums = w->sums_only,
					  .after_ns = d->searched ? w->stored_leaves.searched_ns : 0,
					  .hint = run_recent,
					  .recall = run_recall,
					  .remember = w->sums_only ? run_remember : NULL,
					  .ctx = w};
}

bool run_domain_load(struct run_domain *d)
{
	struct run *w = d->run;
	unsigned damaged = 0;
	struct pipe_reuse_params p = run_domain_reuse(d);
	struct err err = ERR_INIT;
	int r;

	p.damaged = &damaged;
	r = pipe_reuse(&p, &d->domain, &d->as, &d->held, &err);

	run_event_damaged(w, damaged);

	if (r < 0)
		log_event_err(LOG_EVENT_STORE_FAILED, ABOUT_RUN(w), "a stored domain cannot be read, it is made again", &err);
	d->stored = !r;
	if (!r)
		run_used(w, &d->as, 1000 * clock_real_us());
	return !r;
}

void run_domain_keep(struct run_domain *d)
{
	struct run *w = d->run;
	struct pipe_summary summary;
	struct err err = ERR_INIT;
	int r;

	d->unstorable = !run_space_domain(w, d->held);
	if (d->unstorable)
		return;
	r = pipe_store(run_store(w), &w->key, &d->region, &d->domain, d->memory, &d->as, &summary, &err);

	d->stored = !r;
	d->unstorable = r != 0;
	run_space_stored(w, d->held, r ? 0 : d->as.bytes);
	if (!r) {
		recency_note(w->runs->recency, &d->as.id);
		run_remember(w, &summary);
		return;
	}
	log_event_err(LOG_EVENT_STORE_FAILED, ABOUT_RUN(w), "a finished domain cannot be stored", &err);
}

/* ---- storing ---- */

static void store_run(struct sched_task *t)
{
	struct run_domain *d = run_domain_of(t);

	if (!d->stored)
		run_domain_keep(d);
}

static void store_done(struct sched_task *t)
{
	struct run_domain *d = run_domain_of(t);
	struct run *w = d->run;

	w->tasks--;
	run_domain_set_state(d, DOMAIN_READY);
	if (d->stored || w->stopping)
		run_domain_release(d);
	run_settle(w);
}

void run_domain_store(struct run_domain *d)
{
	if (d->stored) {
		run_domain_release(d);
		return;
	}
	run_domain_set_state(d, DOMAIN_STORING);
	run_domain_submit(d, store_run, store_done, SCHED_FIRST, 0);
}
