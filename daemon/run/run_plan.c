/*
 * The plan of a run: read from the job's file, or made and written there before the first domain.
 *
 * The model: the same plan and cap give the same blocks with any memory and any number of threads, because they decide every
 * split. So a run with a kept plan uses its cap, and the memory decides only how many domains are made at once. If not even one
 * domain would fit an idle daemon, the plan gets a smaller cap, first in the file: then it stands for another stream, and the old
 * one cannot be resumed. A run that follows another applies its splits.
 */
#include <stdlib.h>

#include "clock.h"
#include "ledger.h"
#include "lock.h"
#include "log.h"
#include "store.h"
#include "run_priv.h"

/* Leaves that make a second worker worthwhile for the search. */
enum { SEARCH_TOGETHER = 32 };
#define SEARCH_SECONDS 0.005

static struct lock leaves_lock = LOCK_STATIC(LEAVES); /* guards run_planning.damaged and .err, and run.stored_leaves */

static void plan_over(void *run);

int run_plan_read(struct run *w, struct err *err)
{
	int r;

	cut_plan_done(&w->plan);
	w->planned = false;
	if (!w->file)
		return 0;
	r = plan_file_read(w->file, &w->plan, &w->kept, &w->splits_seen, err);
	w->planned = r == 0;
	return r == PLAN_FILE_ABSENT ? 0 : r;
}

/* Does not wait for the disk: the first block that leaves does (run_emit.c). */
static int plan_keep(struct run *w)
{
	w->kept = (struct plan_kept){.load = w->budget.load, .cap = w->budget.cap};
	return w->file ? plan_file_write(w->file, &w->plan, &w->kept, &w->err) : 0;
}

static struct pipe_reuse_params reuse_params(const struct run *w, void *memory, size_t size)
{
	return (struct pipe_reuse_params){
		.storefd = run_store(w),
		.grid = w->grid,
		.view = &w->grid_view,
		.key = &w->key,
		.load = w->budget.load,
		.cap = w->budget.cap,
		.memory = memory,
		.size = size,
		.hint = run_recent,
		.recall = run_recall,
		.remember = run_remember,
		.ctx = (void *)w,
		.sums = true,
	};
}

/* A leaf that the store has: adds its sums at once, and keeps its record until there is a plan to write it to. Any member of the
 * search. */
static void take_stored_leaf(void *ctx, const struct cut_region *region, const struct mesh_domain *domain,
			     const struct pipe_stored *as)
{
	struct run *w = ctx;
	struct run_stored_leaves *t = &w->stored_leaves;
	struct mesh_domain d = *domain;
	struct err err = ERR_INIT;

	lock_take(&leaves_lock);
	if (pipe_emit(w->emitter, &d, region, NULL, &err))
		log_err(LOG_LEVEL_ERROR, "the sums of a stored domain cannot be added",
			&err); /* the totals will not agree, and the run fails */
	t->leaves++;
	t->points += domain->counts.points;
	t->triangles |= domain->ntriangle > 0;
	if (t->n < t->room)
		t->done[t->n++] = (struct plan_done){.region = *region,
						     .base = as->id.base,
						     .list = as->id.list,
						     .digest = as->digest,
						     .payload = as->payload,
						     .triangles = as->triangles,
						     .bytes = as->bytes};
	lock_give(&leaves_lock);
	run_used(w, as, t->searched_ns + STORE_LOOK_NS);
}

/* Without memory for the records, later comparisons find these regions changed. */
static void stored_leaves_init(struct run *w)
{
	struct run_stored_leaves *t = &w->stored_leaves;
	uint64_t bytes = (uint64_t)w->plan.n * sizeof *t->done;

	run_stored_leaves_free(w);
	*t = (struct run_stored_leaves){.searched_ns = 1000 * clock_real_us() - STORE_LOOK_NS};
	if (!ledger_take(w->runs->core->p.ledger, LEDGER_PLAN, bytes))
		return;
	t->charged = bytes;
	t->done = malloc(bytes);
	t->room = t->done ? w->plan.n : 0;
}

void run_stored_leaves_free(struct run *w)
{
	struct run_stored_leaves *t = &w->stored_leaves;

	free(t->done);
	if (t->charged)
		ledger_give(w->runs->core->p.ledger, LEDGER_PLAN, t->charged);
	t->done = NULL;
	t->n = t->room = 0;
	t->charged = 0;
}

static void record_stored_leaves(struct run *w)
{
	struct err err = ERR_INIT;

	if (w->file && plan_file_done(w->file, w->stored_leaves.done, w->stored_leaves.n, &err))
		log_err(LOG_LEVEL_DEBUG, "a finished domain is not recorded in the plan", &err);
	run_stored_leaves_free(w);
}

/* ---- the search for stored leaves ---- */

/* The members share the memory. */
static struct pipe_reuse_params search_params(struct run *w, unsigned member, unsigned members)
{
	size_t each = w->planning.bytes / members & ~(size_t)63;
	struct pipe_reuse_params p = reuse_params(w, (uint8_t *)w->planning.memory + member * each, each);

	if (w->sums_only)
		p.there = take_stored_leaf;
	return p;
}

static void search_result(struct run *w, unsigned damaged, int r, const struct err *err)
{
	struct run_planning *m = &w->planning;

	lock_take(&leaves_lock);
	m->damaged += damaged;
	if (r < 0 && !m->err.code)
		m->err = *err;
	lock_give(&leaves_lock);
}

/* Searches for some leaves, no longer than others may wait for a thread. False: all leaves are done, or it failed. */
static bool search_step(void *ctx, unsigned member)
{
	struct run *w = ctx;
	struct pipe_reuse_params p = search_params(w, member, w->planning.members);
	uint64_t begun_ns = clock_mono_ns();
	struct err err = ERR_INIT;
	unsigned damaged = 0;
	int r;

	p.damaged = &damaged;
	p.reader = w->planning.reader[member];
	r = p.reader ? 0 : pipe_refine_reader(&p, &err);
	w->planning.reader[member] = p.reader;
	do
		r = r ? r : pipe_refine_step(w->planning.refine, &p, &err);
	while (!r && clock_since(begun_ns) < SEARCH_SECONDS && !atomic_load(&w->task.cancel));
	search_result(w, damaged, r, &err);
	return !r && !atomic_load(&w->task.cancel);
}

/* A failure only makes the plan less good. */
static int refine_cut(struct run *w)
{
	struct run_planning *m = &w->planning;
	struct pipe_reuse_params p = search_params(w, 0, 1);
	struct err err = ERR_INIT;
	int r;

	p.damaged = &m->damaged; /* no other member runs */
	p.reader = m->reader[0];
	if (!m->err.code) {
		r = pipe_refine_split(m->refine, &p, &err);
		search_result(w, 0, r, &err);
	}
	run_event_damaged(w, m->damaged);
	if (m->err.code == ERR_BUSY || m->err.code == ERR_NOMEM) {
		w->err = m->err;
		return -(int)m->err.code;
	}
	if (m->err.code)
		log_event_err(LOG_EVENT_STORE_FAILED, ABOUT_RUN(w), "the store of finished domains cannot be searched", &m->err);
	return 0;
}

/* As many as have work and memory. */
static unsigned search_members(const struct run *w)
{
	size_t most = w->planning.bytes / pipe_refine_bytes(w->grid), threads = sched_threads(w->runs->core->p.sched);

	threads = threads < most ? threads : most;
	return threads > 1 && w->plan.n >= SEARCH_TOGETHER ? (unsigned)threads : 1;
}

static int search_begin(struct run *w)
{
	struct run_planning *m = &w->planning;
	struct sched_group_params group = {
		.sched = w->runs->core->p.sched, .owner = w->owner, .step = search_step, .over = plan_over, .ctx = w};
	int r;

	if (w->sums_only)
		stored_leaves_init(w);
	group.members = m->members = search_members(w);
	m->reader = calloc(m->members, sizeof *m->reader);
	if (!m->reader)
		return err_set(&w->err, ERR_NOMEM, "no memory for %u workers", m->members);
	r = pipe_refine_new(&w->plan, &m->refine, &w->err);
	return r || m->members < 2 ? r : sched_group_new(&group, &m->group, &w->err);
}

/* Only a number: what cannot be read counts as absent. */
static void count_reusable(struct run *w, void *memory, size_t size)
{
	w->reusable = 0;
	for (size_t i = 0; i < w->plan.n && !cut_plan_flat(&w->plan); i++) {
		struct pipe_reuse_params p = reuse_params(w, memory, size);
		struct err err = ERR_INIT;
		struct pipe_stored as;
		struct mesh_domain d;
		unsigned damaged = 0;
		size_t held;

		p.region = &w->plan.leaf[i].region;
		p.damaged = &damaged;
		w->reusable += w->plan.leaf[i].there || pipe_reuse(&p, &d, &as, &held, &err) == 0;
		run_event_damaged(w, damaged);
	}
}

/* No member of the search runs any more. */
static void plan_finish(struct run *w)
{
	struct run_planning *m = &w->planning;

	if (!w->r && m->refine)
		w->r = refine_cut(w);
	if (!w->r)
		w->r = pipe_plan_probe(w->grid, &w->grid_view, &w->budget, m->memory, &w->task.cancel, &w->plan, &w->err);
	if (!w->r && w->plan_only)
		count_reusable(w, m->memory, m->bytes);
	free(m->memory);
	m->memory = NULL;
	if (!w->r)
		w->r = plan_keep(w);
	if (!w->r)
		record_stored_leaves(w);
	if (w->r == PIPE_E_EMPTY) {
		/* No points, so no domains; only the counts of what was read. */
		pipe_emit_empty(w->emitter, &m->empty);
		w->r = 0;
	}
}

static void plan_run(struct sched_task *t)
{
	struct run *w = run_of_task(t);
	struct run_planning *m = &w->planning;

	w->err = ERR_INIT;
	m->memory = aligned_alloc(64, (t->bytes + 63) & ~(size_t)63);
	if (!m->memory) {
		w->r = err_set(&w->err, ERR_NOMEM, "no memory to plan a mesh");
		return;
	}
	w->r = pipe_plan_make(w->grid, &w->grid_view, &w->budget, m->memory, &w->plan, &m->empty, &w->err);
	m->bytes = t->bytes;
	if (!w->r && (w->keep || w->plan_only) && pipe_refine_applies(&w->grid_view, &w->plan))
		w->r = search_begin(w);
	if (!w->r && m->group)
		return;
	while (!w->r && m->refine && search_step(w, 0))
		;
	plan_finish(w);
}

/* The rest of the search, with helpers. */
static void search_run(struct sched_task *t)
{
	struct run *w = run_of_task(t);

	sched_group_run(w->planning.group);
	/* Otherwise the run has stopped. */
	if (!atomic_load(&t->cancel))
		plan_finish(w);
}

/* The memory is smaller than that of the plan: its regions stay, its cap does not. */
static void narrow_run(struct sched_task *t)
{
	struct run *w = run_of_task(t);

	w->err = ERR_INIT;
	w->r = plan_keep(w);
}

static void run_domains_begin(struct run *w)
{
	w->plan_n = w->plan.n;
	w->points += w->stored_leaves.points;
	w->blocks += w->stored_leaves.triangles;
	w->runs->core->tally.domains_reused += w->stored_leaves.leaves;
	if (w->stored_leaves.triangles && !w->first_ns)
		w->first_ns = clock_mono_ns();
	w->grid_total = grid_points(w->grid);
	run_set_state(w, RUN_RUNNING);
	w->started_ns = clock_mono_ns();
	if (w->calls->planned)
		w->calls->planned(w->ctx);
	if (w->plan_only)
		run_set_state(w, RUN_FINISHING);
	else
		run_output_head(w);
}

/* What a run that is the only one, of this user, can have for its domains. */
static uint64_t alone_memory(const struct run *w)
{
	const struct admission *a = w->runs->admission;
	uint64_t limit = admission_user_limit(w->runs->admission, &w->owner), alone = admission_alone_bytes(a);

	if (limit != UINT64_MAX)
		limit = limit > admission_share(a) ? limit - admission_share(a) : 0;
	return alone < limit ? alone : limit;
}

static void plan_forget(struct run *w)
{
	cut_plan_done(&w->plan);
	run_stored_leaves_free(w);
	w->stored_leaves = (struct run_stored_leaves){0};
}

static int wide_budget(struct run *w, uint64_t memory, uint64_t positions, struct pipe_budget *ret, uint64_t *ret_need,
		       struct err *err)
{
	const struct pipe_wide wide = {memory, PIPE_MADE_AND_SENT, positions, 0};

	return pipe_budget_wide(&wide, w->grid, ret, ret_need, err);
}

/* A region needs more positions than the domains have room for, however small it is: points in convex position. It begins again
 * with fewer, larger domains, as long as the memory suffices for one. */
static bool retry_wider(struct run *w)
{
	struct pipe_budget wide;
	struct err err = ERR_INIT;
	uint64_t bytes;

	if (w->stopping || w->planned || !pipe_budget_narrow(&w->budget, w->grid, w->r, &w->err) ||
	    wide_budget(w, alone_memory(w), w->err.need, &wide, &bytes, &err))
		return false;
	w->wide = w->err.need;
	plan_forget(w);
	run_requeue(w, bytes);
	return true;
}

/* Other plans hold the memory that this one needs: it begins again at the next tick. If none does, waiting is no use, and it
 * fails. */
static bool retry_later(struct run *w)
{
	struct runs *runs = w->runs;

	if (w->r != -ERR_BUSY || w->stopping)
		return false;
	plan_forget(w);
	if (!ledger_held(runs->core->p.ledger, LEDGER_PLAN)) {
		w->err.code = ERR_LIMIT;
		w->err.hint[0] = 0; /* the hint is about other jobs */
		err_add_hint(&w->err, "start the daemon with more memory");
		return false;
	}
	run_close(w);
	w->select.open = false;
	run_set_state(w, RUN_NEW);
	return true;
}

static void plan_over(void *ctx)
{
	struct run *w = ctx;
	struct run_planning m = w->planning;

	w->task_busy = false;
	w->planning = (struct run_planning){.err = ERR_INIT};
	sched_group_free(m.group);
	pipe_refine_free(m.refine);
	free(m.reader);
	free(m.memory);
	if (m.ran) {
		sched_give(w->runs->core->p.sched, LEDGER_DOMAIN, m.bytes);
		if (retry_later(w) || retry_wider(w))
			return;
		if (w->r)
			run_fail(w, &w->err);
	}
	if (!w->stopping)
		run_domains_begin(w);
	run_settle(w);
}

static void search_done(struct sched_task *t)
{
	sched_group_end(run_of_task(t)->planning.group);
}

static void plan_done(struct sched_task *t)
{
	struct run *w = run_of_task(t);
	struct run_planning *m = &w->planning;

	m->ran = t->ran;
	m->held = m->bytes = t->bytes;
	if (!m->group || w->r || w->stopping) {
		plan_over(w);
		return;
	}
	w->task = (struct sched_task){
		.run = search_run, .done = search_done, .owner = w->owner, .lengthy = true, .priority = SCHED_FIRST};
	sched_submit(w->runs->core->p.sched, &w->task);
	sched_group_start(m->group);
}

static void plan_submit(struct run *w, void (*task)(struct sched_task *), uint64_t bytes)
{
	run_set_state(w, RUN_PLANNING);
	w->task = (struct sched_task){
		.run = task,
		.done = plan_done,
		.owner = w->owner,
		.lengthy = true,
		.priority = SCHED_FIRST,
		.name = LEDGER_DOMAIN,
		.bytes = bytes,
	};
	w->task_busy = true;
	sched_submit(w->runs->core->p.sched, &w->task);
}

/* For a job without a reader. A later fetch has a run of its own. Where parts are out, not all positions are vertices. */
static void sums_choose(struct run *w)
{
	w->sums_only =
		w->keep && !w->plan_only && !w->lazy && !w->output && !w->since && !w->view.window && !pipe_has_out(w->grid);
	if (w->sums_only)
		pipe_emitter_sums(w->emitter, true);
}

/* The budget is set. */
static void plan_begin(struct run *w)
{
	sums_choose(w);
	if (w->planned && run_change_fails_split(w))
		return;
	if (w->planned)
		plan_submit(w, narrow_run, 0);
	else if (grid_points(w->grid))
		plan_submit(w, plan_run, w->budget.domain_bytes);
	else
		/* No points, no domains. */
		run_domains_begin(w);
}

/* Small leaves keep what is made again after a push in proportion to the change, and other domains in the cache. */
static void narrow_leaves(struct run *w)
{
	uint32_t most = w->dataset->onestep ? PIPE_ONCE_LOAD : PIPE_KEPT_LOAD;

	if (!w->wide && w->budget.load > most)
		w->budget.load = most;
}

/* Plans with the memory that stages leave now. If that is too little, it releases its slot and tries again later. Called by
 * run_settle, which continues in the new state. */
void run_plan_start(struct run *w)
{
	struct runs *runs = w->runs;
	uint64_t all = admission_domain_memory(runs->admission),
		 room = admission_user_available(runs->admission, &w->owner, &w->admission), least = pipe_budget_min(w->grid);
	struct err err = ERR_INIT;

	all = all < room ? all : room;
	if (w->planned) {
		if (!pipe_budget_kept(all, runs->core->p.threads, w->grid, w->kept.load, w->kept.cap, &w->budget, &err)) {
			sums_choose(w);
			run_domains_begin(w);
			return;
		}
		if (!pipe_budget_kept(alone_memory(w), 1, w->grid, w->kept.load, w->kept.cap, &w->budget, &err)) {
			run_requeue(w, 2 * w->budget.domain_bytes);
			return;
		}
	}
	if (admission_check_size(runs->admission, least, "meshing", &err) ||
	    admission_user_check_size(runs->admission, &w->owner, least + admission_share(runs->admission), "meshing", &err)) {
		run_fail(w, &err);
	} else if (!(w->wide ? wide_budget(w, all, w->wide, &w->budget, &least, &err) :
			       pipe_budget(all, runs->core->p.threads, w->grid, &w->budget, &err))) {
		narrow_leaves(w);
		plan_begin(w);
	} else if (admission_is_alone(runs->admission)) {
		/* The service itself holds the rest, so waiting is no use. */
		run_fail(w, &err);
	} else {
		run_requeue(w, least);
	}
}

void run_plan_follow(struct run *w)
{
	struct err err = ERR_INIT;

	if (!w->calls->reach || !w->file || w->splitting)
		return;
	if (plan_file_follow(w->file, &w->splits_seen, w->next_start, &w->plan, &err))
		run_fail(w, &err);
	else
		w->plan_n = w->plan.n;
}

size_t run_reach(const struct run *w)
{
	size_t reach = w->calls->reach ? w->calls->reach(w->ctx) : SIZE_MAX;

	if (w->lazy && run_backlog(w))
		return 0;
	return reach < w->plan.n ? reach : w->plan.n;
}
