/*
 * The plan of a run: read from the job's file, or made and kept there before the first domain is.
 *
 * The model: the same plan and cap give the same blocks, whatever the memory and the threads, since they decide
 * every split. So a run of a plan that was kept takes its cap, and the memory decides only how many domains run at
 * once. Where not even one of them would fit if nothing else ran, the plan gets a smaller cap, in the file first:
 * then it stands for another stream, and what was promised of the old one is gone. A run that follows another
 * takes over the splits of that one.
 */
#include <stdlib.h>

#include "clock.h"
#include "ledger.h"
#include "lock.h"
#include "log.h"
#include "store.h"
#include "run_priv.h"

/* Positions of a leaf of a dataset that is kept: so little is made again after a push, and all of it for a tenth more.
 * What its arena carries stays that of the rung. */
enum { KEPT_LOAD = 1 << 16 };
/* Leaves from which on a plan is worth a second worker. */
enum { LOOK_TOGETHER = 32 };
#define LOOK_SECONDS 0.005

static struct lock leaves_lock = LOCK_STATIC(LEAVES); /* of those who look at leaves */

static void plan_over(void *run);

static struct run *run_of_task(struct sched_task *t)
{
	return (struct run *)((char *)t - offsetof(struct run, task));
}

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

static int keep(struct run *w)
{
	w->kept = (struct plan_kept){.load = w->budget.load, .cap = w->budget.cap};
	if (!w->file)
		return 0;
	/* Nobody has a block of it: no domain waits for the disk. */
	return (w->sums && !w->planned ? plan_file_write_later : plan_file_write)(w->file, &w->plan, &w->kept, &w->err);
}

static struct pipe_reuse_params reuse_params(const struct run *w, void *memory, size_t size)
{
	return (struct pipe_reuse_params){
		.storefd = run_store(w),
		.grid = w->grid,
		.view = &w->rest,
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

/* A leaf that is there: its sums at once; its place among the finished ones when there is a plan to note it in. Any of those who
 * look. */
static void take_there(void *ctx, const struct cut_region *region, const struct mesh_domain *domain, const struct pipe_stored *as)
{
	struct run *w = ctx;
	struct run_there *t = &w->there;
	struct mesh_domain d = *domain;
	struct err err = ERR_INIT;

	lock_take(&leaves_lock);
	if (pipe_emit(w->emitter, &d, region, NULL, &err))
		log_err(LOG_LEVEL_ERROR, "the sums of a stored domain are not taken", &err); /* the mesh will not be whole */
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
	run_used(w, as, t->looked_ns + STORE_LOOK_NS);
}

/* Those that no memory is left for are missed by comparisons only. */
static void there_room(struct run *w)
{
	struct run_there *t = &w->there;
	uint64_t bytes = (uint64_t)w->plan.n * sizeof *t->done;

	run_there_free(w);
	*t = (struct run_there){.looked_ns = 1000 * clock_real_us() - STORE_LOOK_NS};
	if (!ledger_take(w->runs->core->p.ledger, LEDGER_PLAN, bytes))
		return;
	t->charged = bytes;
	t->done = malloc(bytes);
	t->room = t->done ? w->plan.n : 0;
}

void run_there_free(struct run *w)
{
	struct run_there *t = &w->there;

	free(t->done);
	if (t->charged)
		ledger_give(w->runs->core->p.ledger, LEDGER_PLAN, t->charged);
	t->done = NULL;
	t->n = t->room = 0;
	t->charged = 0;
}

static void tell_there(struct run *w)
{
	struct err err = ERR_INIT;

	if (w->file && plan_file_done(w->file, w->there.done, w->there.n, &err))
		log_err(LOG_LEVEL_DEBUG, "a finished domain is not noted in the plan", &err);
	run_there_free(w);
}

/* ---- what the store has of earlier generations ---- */

/* One of so many that share the memory. */
static struct pipe_reuse_params look_params(struct run *w, unsigned member, unsigned members)
{
	size_t each = w->planning.bytes / members & ~(size_t)63;
	struct pipe_reuse_params p = reuse_params(w, (uint8_t *)w->planning.memory + member * each, each);

	if (w->sums)
		p.there = take_there;
	return p;
}

static void looked(struct run *w, unsigned damaged, int r, const struct err *err)
{
	struct run_planning *m = &w->planning;

	lock_take(&leaves_lock);
	m->damaged += damaged;
	if (r < 0 && !m->err.code)
		m->err = *err;
	lock_give(&leaves_lock);
}

/* Some leaves, for as long as others may wait for a helper's thread; false: there are no others, or it failed. */
static bool look(void *ctx, unsigned member)
{
	struct run *w = ctx;
	struct pipe_reuse_params p = look_params(w, member, w->planning.members);
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
	while (!r && clock_since(begun_ns) < LOOK_SECONDS && !atomic_load(&w->task.cancel));
	looked(w, damaged, r, &err);
	return !r && !atomic_load(&w->task.cancel);
}

/* Without it the plan is as good. */
static int cut(struct run *w)
{
	struct run_planning *m = &w->planning;
	struct pipe_reuse_params p = look_params(w, 0, 1);
	struct err err = ERR_INIT;
	int r;

	p.damaged = &m->damaged; /* nobody else is at it */
	p.reader = m->reader[0];
	if (!m->err.code) {
		r = pipe_refine_split(m->refine, &p, &err);
		looked(w, 0, r, &err);
	}
	run_tell_damaged(w, m->damaged);
	if (m->err.code == ERR_BUSY || m->err.code == ERR_NOMEM) {
		w->err = m->err;
		return -(int)m->err.code;
	}
	if (m->err.code)
		log_event_err(LOG_EVENT_STORE_FAILED, ABOUT_RUN(w), "the store of finished domains cannot be looked at", &m->err);
	return 0;
}

/* As many as have something to do, and memory. */
static unsigned look_members(const struct run *w)
{
	size_t most = w->planning.bytes / pipe_refine_bytes(w->grid), threads = sched_threads(w->runs->core->p.sched);

	threads = threads < most ? threads : most;
	return threads > 1 && w->plan.n >= LOOK_TOGETHER ? (unsigned)threads : 1;
}

static int look_begin(struct run *w)
{
	struct run_planning *m = &w->planning;
	struct sched_group_params group = {
		.sched = w->runs->core->p.sched, .owner = w->owner, .step = look, .over = plan_over, .ctx = w};
	int r;

	if (w->sums)
		there_room(w);
	group.members = m->members = look_members(w);
	m->reader = calloc(m->members, sizeof *m->reader);
	if (!m->reader)
		return err_set(&w->err, ERR_NOMEM, "no memory for %u workers", m->members);
	r = pipe_refine_new(&w->plan, &m->refine, &w->err);
	return r || m->members < 2 ? r : sched_group_new(&group, &m->group, &w->err);
}

/* Only told: what cannot be read counts as not there. */
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
		run_tell_damaged(w, damaged);
	}
}

/* Nobody looks at a leaf any more. */
static void plan_rest(struct run *w)
{
	struct run_planning *m = &w->planning;

	if (!w->r && m->refine)
		w->r = cut(w);
	if (!w->r)
		w->r = pipe_plan_probe(w->grid, &w->rest, &w->budget, m->memory, &w->plan, &w->err);
	if (!w->r && w->plan_only)
		count_reusable(w, m->memory, m->bytes);
	free(m->memory);
	m->memory = NULL;
	if (!w->r)
		w->r = keep(w);
	if (!w->r)
		tell_there(w);
	if (w->r == PIPE_E_EMPTY) {
		/* No domains, but the counts of what was read. */
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
	w->r = pipe_plan_make(w->grid, &w->rest, &w->budget, m->memory, &w->plan, &m->empty, &w->err);
	m->bytes = t->bytes;
	if (!w->r && (w->keep || w->plan_only) && pipe_refine_applies(&w->rest, &w->plan))
		w->r = look_begin(w);
	if (!w->r && m->group)
		return;
	while (!w->r && m->refine && look(w, 0))
		;
	plan_rest(w);
}

/* The rest of it, with helpers. */
static void look_run(struct sched_task *t)
{
	struct run *w = run_of_task(t);

	sched_group_run(w->planning.group);
	/* Else the run has stopped. */
	if (!atomic_load(&t->cancel))
		plan_rest(w);
}

/* The memory is less than that of the plan: the regions stay, the cap does not. */
static void narrow_run(struct sched_task *t)
{
	struct run *w = run_of_task(t);

	w->err = ERR_INIT;
	w->r = keep(w);
}

static void run(struct run *w)
{
	w->plan_n = w->plan.n;
	w->points += w->there.points;
	w->blocks += w->there.triangles;
	w->runs->core->tally.domains_reused += w->there.leaves;
	if (w->there.triangles && !w->first_ns)
		w->first_ns = clock_mono_ns();
	w->grid_total = grid_points(w->grid);
	w->state = RUN_RUNNING;
	w->started_ns = clock_mono_ns();
	if (w->calls->planned)
		w->calls->planned(w->ctx);
	if (w->plan_only)
		w->state = RUN_FINISHING;
	else
		run_output_head(w);
}

/* Other plans hold what this one needs: from the start, at the next tick. Where none does, waiting would not mend it. */
static bool waits_for_plans(struct run *w)
{
	struct runs *runs = w->runs;

	if (w->r != -ERR_BUSY || w->stopping)
		return false;
	cut_plan_done(&w->plan);
	run_there_free(w);
	w->there = (struct run_there){0};
	if (!ledger_held(runs->core->p.ledger, LEDGER_PLAN)) {
		w->err.code = ERR_LIMIT;
		w->err.hint[0] = 0; /* which speaks of other jobs */
		err_add_hint(&w->err, "start the daemon with more memory");
		return false;
	}
	run_shut(w);
	w->select.open = false;
	w->state = RUN_NEW;
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
		if (waits_for_plans(w))
			return;
		if (w->r)
			run_fail(w, &w->err);
	}
	if (!w->stopping)
		run(w);
	run_settle(w);
}

static void look_done(struct sched_task *t)
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
		.run = look_run, .done = look_done, .owner = w->owner, .lengthy = true, .priority = SCHED_FIRST};
	sched_submit(w->runs->core->p.sched, &w->task);
	sched_group_start(m->group);
}

static void start(struct run *w, void (*task)(struct sched_task *), uint64_t bytes)
{
	w->state = RUN_PLANNING;
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

/* Of a job that is nobody's stream: who fetches it has a run of his own. */
static void sums_choose(struct run *w)
{
	w->sums = w->keep && !w->plan_only && !w->lazy && !w->output && !w->since && !w->view.window;
	if (w->sums)
		pipe_emitter_sums(w->emitter, true);
}

/* Within its budget. */
static void begin(struct run *w)
{
	sums_choose(w);
	if (w->planned && run_change_torn(w))
		return;
	if (w->planned)
		start(w, narrow_run, 0);
	else if (grid_points(w->grid))
		start(w, plan_run, w->budget.domain_bytes);
	else
		/* No points, no domains. */
		run(w);
}

/* What of it is made again later follows the size of what changed. */
static void narrow_leaves(struct run *w)
{
	if (!w->dataset->onestep && w->budget.load > KEPT_LOAD)
		w->budget.load = KEPT_LOAD;
}

/* With what is left beside stages that are held now; where that is too little, later, and its place goes back.
 * Called by run_settle, which goes on with what came of it. */
void run_plan_start(struct run *w)
{
	struct runs *runs = w->runs;
	uint64_t all = admission_domain_memory(runs->admission),
		 room = admission_user_available(runs->admission, &w->owner, &w->admission),
		 limit = admission_user_limit(runs->admission, &w->owner), alone = admission_alone_bytes(runs->admission),
		 least = pipe_budget_min(w->grid);
	struct err err = ERR_INIT;

	all = all < room ? all : room;
	if (limit != UINT64_MAX)
		limit = limit > admission_share(runs->admission) ? limit - admission_share(runs->admission) : 0;
	alone = alone < limit ? alone : limit;
	if (w->planned) {
		if (!pipe_budget_kept(all, runs->core->p.threads, w->grid, w->kept.load, w->kept.cap, &w->budget, &err)) {
			sums_choose(w);
			run(w);
			return;
		}
		if (!pipe_budget_kept(alone, 1, w->grid, w->kept.load, w->kept.cap, &w->budget, &err)) {
			run_retreat(w, 2 * w->budget.domain_bytes);
			return;
		}
	}
	if (admission_check_size(runs->admission, least, "meshing", &err) ||
	    admission_user_check_size(runs->admission, &w->owner, least + admission_share(runs->admission), "meshing", &err)) {
		run_fail(w, &err);
	} else if (!pipe_budget(all, runs->core->p.threads, w->grid, &w->budget, &err)) {
		narrow_leaves(w);
		begin(w);
	} else if (admission_is_alone(runs->admission)) {
		/* What the service keeps in mind takes the rest: waiting would not mend it. */
		run_fail(w, &err);
	} else {
		run_retreat(w, least);
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
