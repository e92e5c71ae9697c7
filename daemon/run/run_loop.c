/*
 * The scheduling of a run on the loop: which domain is made next, which is emitted next, and what goes to the store.
 *
 * The model: domains [0, next_emit) are emitted. Those of [next_emit, next_start) in the list are in memory or in the making; the
 * others are in the store, or were lost and are made again when it is their turn. Behind next_start only domains in the list have
 * begun: the last ones of a mesh that nobody reads, largest first. At most one emission, one split and one output task run at a
 * time.
 *
 * A run never waits while it holds memory that others need: what is finished and not next can be stored at any moment
 * (run_relieve), and the block being sent can be spooled. When a reader is slow for RUN_STALL_SECONDS, domains are made ahead
 * into the store instead of memory.
 */
#include "clock.h"
#include "run_priv.h"

/* Domains a thread that are made in the order of their size. */
enum { LAST_EACH = 8 };

unsigned run_domains_most = 64;

static struct run_domain *find_domain(const struct run *w, size_t index)
{
	struct run_domain *d;

	for (d = w->domains; d && d->index != index; d = d->next)
		;
	return d;
}

bool run_backlog(const struct run *w)
{
	/* A worker has the output: its block is being spooled or read back. */
	return w->output && w->output_busy &&
	       (w->output_working || w->output->spooled || w->output->calls->stalled(w->output) > RUN_STALL_SECONDS);
}

/* The first block of a bound job waits for its reader. */
static bool awaits_output(const struct run *w)
{
	return !w->output && w->patience > 0 && !w->next_emit && clock_since(w->started_ns) < w->patience;
}

bool run_stalled(const struct run *w)
{
	if (w->state != RUN_RUNNING || w->ndomains)
		return false;
	/* For its reader, or for the run that it follows. */
	return run_backlog(w) ? w->lazy || w->next_start == w->plan_n :
				w->next_start < w->plan_n && w->next_start >= run_reach(w);
}

static void split_next(struct run *w)
{
	struct run_domain *d;

	for (d = w->domains; d && !w->splitting; d = d->next)
		if (d->state == DOMAIN_SPLIT && !run_change_fails_split(w))
			run_domain_split(d);
}

/* True if it has changed something, and more may be possible at once. */
static bool emit_next(struct run *w)
{
	struct run_domain *d;

	if (w->stopping || w->emitting || w->output_busy || w->output_working || awaits_output(w))
		return false;
	if (w->next_emit >= w->next_start)
		return false;
	if (run_change_skips(w, w->next_emit)) {
		w->next_emit++;
		return true;
	}
	if (w->splitting && w->sums_only)
		return false; /* a worker has the plan */
	if (run_leaf_is_stored(w, w->next_emit)) {
		w->next_emit++;
		return true;
	}
	d = find_domain(w, w->next_emit);
	if (!d) {
		/* It is in the store, or was lost. */
		if (!w->splitting)
			run_domain_start(w, w->next_emit, SCHED_FIRST);
		return false;
	}
	if (d->state != DOMAIN_READY)
		return false;
	run_domain_emit(d);
	return !w->emitting;
}

/*
 * One more domain may be started before those that are there. Some are always allowed: those of all threads, one being sent, and
 * one that is ready. More are allowed as long as all of them fit the memory that the plan counts on, so that one large domain
 * does not stop the small ones around it.
 */
static bool window_is_open(const struct run *w)
{
	uint64_t each = w->budget.domain_bytes, taken = 0;
	const struct run_domain *d;
	unsigned making = 0, idle = 0;

	if (w->ndomains < w->budget.threads + 2)
		return true;
	for (d = w->domains; d; d = d->next) {
		bool whole = d->state == DOMAIN_MAKING || d->state == DOMAIN_SPLIT;

		idle += !whole && !d->size;

		/* Only the worker knows how much of a domain in the making is mapped. */
		taken += whole ? each : d->size;
		making += whole;
	}
	if (w->ndomains >= run_domains_most)
		return w->next_start == w->next_emit; /* all of these wait for it */
	/* Domains that only wait to be counted have no memory: the next one can have it. */
	if (w->sums_only && w->ndomains - idle < w->budget.threads + 2)
		return true;
	return making < w->budget.threads && taken + each <= (w->budget.threads + 1) * each;
}

bool run_must_store(struct run *w)
{
	/* Domains in memory would keep a slot from others as long as a reader takes nothing. */
	if (w->keep || slots_requested(w->runs->admission))
		return true;
	if (w->next_start >= run_reach(w) || window_is_open(w))
		return false;
	/* Arenas that pass to other domains count as a whole. */
	run_arenas_trim_results(w);
	return !window_is_open(w);
}

/* It has begun, or there is nothing to make. */
static bool is_started(const struct run *w, size_t index)
{
	return run_change_skips(w, index) || run_leaf_is_stored(w, index) || find_domain(w, index);
}

/* How much a changed region beside the survey reads for its halo is not known before. */
static bool takes_longer(const struct cut_leaf *a, const struct cut_leaf *b)
{
	return a->changed != b->changed ? a->changed : a->count > b->count;
}

/*
 * In the order of the plan, because neighbours read the same cells. The last few domains a thread of a mesh that nobody reads are
 * made in the order of their size: then no worker is idle for long at the end (longest processing time first: Graham, Bounds on
 * multiprocessing timing anomalies, 1969). It is limited to a few because progress is counted in the order of the plan.
 */
static size_t next_to_make(const struct run *w)
{
	size_t room = w->ndomains < run_domains_most ? run_domains_most - w->ndomains : 0, best = w->next_start;

	room = room < LAST_EACH * w->budget.threads ? room : LAST_EACH * w->budget.threads;
	for (size_t i = w->next_start; w->sums_only && i < run_reach(w); i++) {
		if (is_started(w, i))
			continue;
		if (!room--)
			return w->next_start;
		if (takes_longer(&w->plan.leaf[i], &w->plan.leaf[best]))
			best = i;
	}
	return best;
}

static void make_next(struct run *w)
{
	while (!w->splitting && w->next_start < run_reach(w)) {
		if (is_started(w, w->next_start)) {
			w->next_start++;
			continue;
		}
		if (!window_is_open(w) || !run_may_start(w) || !run_domain_start(w, next_to_make(w), SCHED_NORMAL))
			return;
	}
}

/* Stores all that waits for a slow reader. */
static void store_ready(struct run *w)
{
	struct run_domain *d, *next;

	for (d = w->domains; d; d = next) {
		next = d->next;
		if (d->state == DOMAIN_READY && !d->unstorable)
			run_domain_store(d);
	}
}

static void settle_running(struct run *w)
{
	run_plan_follow(w);
	split_next(w);
	while (emit_next(w))
		;
	if (!w->stopping && run_backlog(w) && run_must_store(w))
		store_ready(w);
	if (!w->stopping)
		make_next(w);
	run_arenas_trim(w);
	if (w->stopping) {
		run_settle_stopping(w);
		return;
	}
	if (w->splitting || w->domains || w->tasks || w->output_busy || w->next_emit != w->plan_n)
		return;
	if (!run_output_check_end(w)) {
		run_settle_stopping(w);
		return;
	}
	run_finish(w);
}

void run_settle(struct run *w)
{
	THREAD_LOOP_ONLY();
	if (w->state == RUN_OVER)
		return;
	if (w->stopping) {
		run_settle_stopping(w);
		return;
	}
	if (w->state == RUN_UNSELECTED)
		run_select_start(w);
	else if (w->state == RUN_OPEN)
		run_plan_start(w);
	if (w->stopping) {
		run_settle_stopping(w);
		return;
	}
	if (w->state == RUN_RUNNING)
		settle_running(w);
	else if (w->state == RUN_FINISHING && !w->task_busy)
		run_over(w);
}

void run_relieve(struct run *w, bool urgent)
{
	struct run_domain *d, *next;

	THREAD_LOOP_ONLY();
	if (w->state != RUN_RUNNING || w->stopping)
		return;
	run_arenas_trim(w);
	if (urgent)
		run_output_relieve(w);
	/* Its memory comes back soon. */
	if (!urgent && (w->emitting || (w->output_busy && !run_backlog(w))))
		return;
	for (d = w->domains; d; d = next) {
		next = d->next;
		/* The next domain is about to be emitted, unless its reader is slow. One without memory releases none, and would
		 * only have to be made or read again. */
		if (d->state != DOMAIN_READY || !d->size || (d->index == w->next_emit && !w->output_busy && !awaits_output(w)))
			continue;
		if (d->stored || d->unstorable)
			run_domain_release(d);
		else
			run_domain_store(d);
	}
}

/* Changes with the progress of the selection. */
static uint64_t selecting_at(const struct run *w)
{
	const struct run_simplify *x = &w->simplify;

	return x->working ? (uint64_t)atomic_load(&x->step) << 32 | atomic_load(&x->finished) : atomic_load(&w->select.judged);
}

void run_tick(struct run *w)
{
	THREAD_LOOP_ONLY();
	if (w->state == RUN_NEW) {
		if (w->stopping)
			run_over(w);
		else if (w->has_slot)
			run_open(w);
		else
			run_space_tick(w);
		return;
	}
	if (w->state == RUN_SELECTING && w->calls->progressed && selecting_at(w) != w->select.reported) {
		w->select.reported = selecting_at(w);
		w->calls->progressed(w->ctx);
	}
	run_pace_tick(w);
	run_output_tick(w);
	run_settle(w);
}
