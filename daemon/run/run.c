/*
 * The loop's side of a run: which domain is made next, which is emitted next, and what yields when memory
 * is short.
 *
 * The model: domains [0, next_emit) are emitted; of [next_emit, next_start) those in the list are in memory
 * or being made, the others are in the store, or were lost and are made again when their turn comes. Behind next_start
 * nothing is begun but what is in the list: the last ones of a mesh that nobody reads, largest first. At most
 * one emission, one split and one output task run at a time. A run never waits while it holds memory that
 * others need: whatever is finished and not next can go to the store at any moment (run_relieve), and the
 * block being written can be spooled. A reader who is slow for a quarter of a second turns run-ahead in
 * memory into run-ahead in the store.
 */
#include "run.h"

#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "log.h"
#include "recency.h"
#include "run_priv.h"
#include "store.h"

#define STALL_SECONDS 0.25
/* A failed run lets a block that is half written be finished, so that the error can follow it. */
#define FAREWELL_SECONDS 2.0
/* Domains of a thread that are made by size. */
enum { LAST_EACH = 8 };

unsigned run_domains_most = 64;

static struct run *run_of_task(struct sched_task *t)
{
	return (struct run *)((char *)t - offsetof(struct run, task));
}

/* Fractions of the memory: 1/n. */
enum { RECENCY_PART = 1024, SUMMARIES_PART = 256 };

int runs_new(struct core *core, struct admission *admission, struct runs **ret, struct err *err)
{
	struct runs *runs = calloc(1, sizeof *runs);

	if (!runs)
		return err_set(err, ERR_NOMEM, "no memory for the daemon");
	runs->core = core;
	runs->admission = admission;
	runs->recency = recency_new(core->p.ledger, sizeof(struct store_id), RECENCY_PART);
	runs->summaries = recency_new(core->p.ledger, sizeof(struct pipe_summary), SUMMARIES_PART);
	*ret = runs;
	return 0;
}

struct runs *runs_free(struct runs *runs)
{
	if (!runs)
		return NULL;
	recency_free(runs->recency);
	recency_free(runs->summaries);
	free(runs);
	return NULL;
}

int run_new(const struct run_params *p, struct run **ret, struct err *err)
{
	struct run *w = calloc(1, sizeof *w);
	int r;

	THREAD_LOOP_ONLY();
	if (!w)
		return err_set(err, ERR_NOMEM, "no memory for a job");
	disk_restore_folders(p->runs->core);
	w->view_text = strdup(p->view_text);
	if (!w->view_text) {
		free(w);
		return err_set(err, ERR_NOMEM, "no memory for a job");
	}
	r = view_parse(p->view_text, &w->view, err);
	if (r) {
		free(w->view_text);
		free(w);
		return r;
	}
	/* With the domains that it has in its window. */
	w->charged = sizeof *w + charge_view_bytes(p->view_text, (w->view.area != NULL) + (w->view.window_area != NULL)) +
		     (p->runs->core->p.threads + 4) * sizeof(struct run_domain);
	r = charge(p->runs->core, w->charged, "the view of a job", err);
	if (r) {
		view_done(&w->view);
		free(w->view_text);
		free(w);
		return r;
	}
	w->runs = p->runs;
	w->plan.ledger = p->runs->core->p.ledger;
	w->dataset = dataset_hold(p->dataset);
	w->generation = p->generation;
	w->keep = p->keep;
	w->client = p->client;
	w->plan_only = p->plan_only;
	w->job = p->job;
	w->owner = p->owner;
	w->slot = p->slot;
	w->owner.flow = ++p->runs->core->last_flow;
	w->patience = p->patience;
	w->file = p->plan;
	w->lazy = p->lazy;
	w->since = p->since;
	w->calls = p->calls;
	w->ctx = p->ctx;
	w->why = ERR_INIT;
	w->err = ERR_INIT;
	w->admission.calls = &run_admission_calls;
	admission_add_run(w->runs->admission, &w->admission);
	*ret = w;
	return 0;
}

struct run *run_free(struct run *w)
{
	THREAD_LOOP_ONLY();
	if (!w)
		return NULL;
	admission_remove_run(w->runs->admission, &w->admission);
	run_change_free(w, w->change);
	cut_plan_done(&w->plan);
	dataset_release(w->dataset);
	view_done(&w->view);
	uncharge(w->runs->core, w->charged);
	free(w->view_text);
	free(w);
	return NULL;
}

void run_shut(struct run *w)
{
	pipe_emitter_free(w->emitter);
	w->emitter = NULL;
	run_there_free(w);
	run_space_shut(w);
	w->grid = grid_close(w->grid);
	if (w->opened)
		dataset_close(w->dataset);
	w->opened = false;
	if (w->emitter_bytes)
		sched_give(w->runs->core->p.sched, LEDGER_EMITTER, w->emitter_bytes);
	if (w->output_buffer)
		sched_give(w->runs->core->p.sched, LEDGER_PIPE, RUN_OUTPUT_BUFFER);
	w->emitter_bytes = 0;
	w->output_buffer = false;
}

/* ---- opening ---- */

/* So many of them count whichever of the segment's records do not. */
static uint64_t surely(uint64_t points, uint64_t dead)
{
	return points > dead ? points - dead : 0;
}

/* Segments have their points by class, sources have not: of a segment with records that are not of this generation it is known
 * how many points of a class there are at least. */
static void count_classes(struct run *w)
{
	const struct grid_manifest *m = grid_manifest(w->grid);

	w->ground = w->other = 0;
	w->unclassified = w->classes_exact = true;
	for (size_t i = 0; i < m->nsegments; i++) {
		const uint64_t *points = m->segments[i].classes;
		uint64_t live = grid_segment_points(w->grid, i), dead = m->segments[i].points - live, other = 0;

		if (!live)
			continue;
		for (unsigned c = 0; c < 256; c++)
			other += c == 2 || ((c == 7 || c == 18) && !w->view.keep_noise) ? 0 : points[c];
		w->classes_exact = w->classes_exact && !dead;
		w->ground += surely(points[2], dead);
		w->other += surely(other, dead);
		w->unclassified &= !points[2] && !points[8];
	}
}

static void open_run(struct sched_task *t)
{
	struct run *w = run_of_task(t);
	struct runs *runs = w->runs;

	w->err = ERR_INIT;
	w->r = dataset_open(w->dataset, &w->err);
	if (w->r)
		return;
	w->opened = true;
	w->r = grid_open(w->dataset->dirfd, w->manifest, w->generation, runs->core->p.ledger,
			 admission_index_share(runs->admission), &w->grid, &w->err);
	if (w->r)
		return;
	view_bind(&w->view, &grid_manifest(w->grid)->lattice);
	w->rest = w->view;
	count_classes(w);
	w->r = pipe_emitter_new(&grid_manifest(w->grid)->lattice, admission_emitter_share(runs->admission), runs->core->tempfd,
				&w->emitter, &w->err);
	if (!w->r && w->view.window)
		pipe_emitter_part(w->emitter);
	if (!w->r)
		w->r = run_plan_read(w, &w->err);
	if (!w->r)
		w->r = run_change_read(w, &w->err);
	if (!w->r && view_selects(&w->view))
		w->r = run_select_open(w, &w->err);
}

/* The job may be older than a prune: a user knows the dataset by its name, not by that of a manifest. */
static void name_generation(struct run *w)
{
	struct err why = ERR_INIT;

	if (w->r == -ERR_NOTFOUND && dataset_check_generation(w->dataset, w->generation, &why))
		w->err = why;
}

void run_opened(struct run *w)
{
	name_generation(w);
	if (w->stopping || (w->r < 0 && w->r != -ERR_BUSY)) {
		if (w->r < 0)
			run_fail(w, &w->err);
		run_settle(w);
		return;
	}
	if (w->r == -ERR_BUSY) {
		/* The index has no memory now, or a selection is to be made again: from the start, at the next
		 * tick. */
		run_shut(w);
		w->state = RUN_NEW;
		return;
	}
	w->state = w->r == RUN_E_ABSENT ? RUN_UNSELECTED : RUN_OPEN;
	if (w->state == RUN_OPEN)
		pipe_key_init(&w->key, w->grid, &w->rest);
	run_settle(w);
}

static void open_done(struct sched_task *t)
{
	struct run *w = run_of_task(t);

	w->task_busy = false;
	if (!t->ran) {
		run_settle(w);
		return;
	}
	w->emitter_bytes = t->bytes;
	run_opened(w);
}

static void open_start(struct run *w)
{
	w->state = RUN_OPENING;
	w->opened_ns = w->opened_ns ? w->opened_ns : clock_mono_ns();
	memcpy(w->manifest, w->dataset->manifest, sizeof w->manifest);
	w->task = (struct sched_task){
		.run = open_run,
		.done = open_done,
		.owner = w->owner,
		.priority = SCHED_FIRST,
		.name = LEDGER_EMITTER,
		.bytes = admission_emitter_share(w->runs->admission),
	};
	w->task_busy = true;
	sched_submit(w->runs->core->p.sched, &w->task);
}

/* ---- the end ---- */

static void finish_run(struct sched_task *t)
{
	struct run *w = run_of_task(t);

	w->err = ERR_INIT;
	w->r = pipe_emitter_finish(w->emitter, &w->totals, &w->err);
}

static void finish_done(struct sched_task *t)
{
	struct run *w = run_of_task(t);

	w->task_busy = false;
	if (t->ran && !w->r)
		w->r = run_select_count(w, &w->err);
	if (t->ran && w->r)
		run_fail(w, &w->err);
	run_settle(w);
}

static void over(struct run *w)
{
	w->state = RUN_OVER;
	slot_withdraw(w->runs->admission, w->slot);
	run_shut(w);
	if (w->why.code == ERR_CORRUPT)
		run_select_discard(w);
	admission_remove_run(w->runs->admission, &w->admission);
	w->calls->ended(w->ctx, w->why.code ? &w->why : NULL);
}

/* What would do for a region that does not fit. */
static void memory_hint(struct run *w)
{
	uint64_t memory = admission_memory_for(w->runs->admission, w->grid, w->why.need);

	if (admission_user_limit(w->runs->admission, &w->owner) != UINT64_MAX)
		err_add_hint(
			&w->why,
			"one user may have %u%% of the memory (user-memory): ask an administrator for more, or leave out points",
			w->runs->core->p.user.memory);
	else if (memory)
		err_add_hint(&w->why, "run with memory=%lluM or more", (unsigned long long)(memory >> 20));
	else
		err_add_hint(&w->why, "a domain carries at most %u positions, whatever the memory: leave out points",
			     w->budget.cap);
}

void run_fail(struct run *w, const struct err *why)
{
	struct run_domain *d;

	if (w->giving && run_space_waits(w))
		return; /* what its tasks meet on their way out is nothing new */
	if (w->giving) {
		/* It ends for good now. */
		w->giving = false;
		w->why = *why;
		return;
	}
	if (w->stopping || w->state == RUN_OVER)
		return;
	w->giving = run_space_met(w, why);
	w->stopping = true;
	w->stopped_ns = clock_mono_ns();
	w->why = *why;
	if (why->code == ERR_LIMIT && why->need && w->grid)
		memory_hint(w);
	if (w->task_busy)
		sched_cancel(w->runs->core->p.sched, &w->task);
	for (d = w->domains; d; d = d->next)
		if (d->state != DOMAIN_READY && d->state != DOMAIN_SENDING)
			sched_cancel(w->runs->core->p.sched, &d->task);
}

void run_stop(struct run *w, const struct err *why)
{
	THREAD_LOOP_ONLY();
	run_space_forget(w);
	run_fail(w, why);
}

static void settle_stopping(struct run *w)
{
	struct run_domain *d, *next;

	run_arenas_fit(w);
	bool farewell = w->sending && w->output && clock_since(w->stopped_ns) < FAREWELL_SECONDS;

	/* It goes on behind this block. */
	farewell |= w->output && w->output_busy && w->giving && run_space_waits(w);

	for (d = w->domains; d; d = next) {
		next = d->next;
		if (d->state == DOMAIN_READY || (d->state == DOMAIN_SPLIT && w->splitting != d))
			run_domain_release(d);
	}
	if (w->task_busy || w->tasks || farewell)
		return;
	while (w->domains)
		run_domain_release(w->domains);
	w->sending = w->emitting = NULL;
	if (!run_yielded(w))
		over(w);
}

/* ---- running ---- */

static struct run_domain *find(const struct run *w, size_t index)
{
	struct run_domain *d;

	for (d = w->domains; d && d->index != index; d = d->next)
		;
	return d;
}

/* Its reader is slow, or has not come yet: domains go to the store. */
bool run_backlog(const struct run *w)
{
	/* While a worker has the output, its block is being spooled or comes back from there. */
	return w->output && w->output_busy &&
	       (w->output_working || w->output->spooled || w->output->calls->stalled(w->output) > STALL_SECONDS);
}

/* A bound job's first block waits a while for its reader. */
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
		if (d->state == DOMAIN_SPLIT && !run_change_torn(w))
			run_domain_split(d);
}

/* True if something was started that may make more possible at once. */
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
	if (w->splitting && w->sums)
		return false; /* the plan is a worker's */
	if (run_is_there(w, w->next_emit)) {
		w->next_emit++;
		return true;
	}
	d = find(w, w->next_emit);
	if (!d) {
		/* It is in the store, or lost. */
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
 * Whether one more domain may be started before those that are there. One being sent and one ready for when that is
 * done: so many always. More than these, so that a large domain holds nobody up whose own are small, as long as all
 * that is made and kept fits the memory that the plan counts on.
 */
static bool run_window(const struct run *w)
{
	uint64_t each = w->budget.domain_bytes, taken = 0;
	const struct run_domain *d;
	unsigned making = 0, idle = 0;

	if (w->ndomains < w->budget.threads + 2)
		return true;
	for (d = w->domains; d; d = d->next) {
		bool whole = d->state == DOMAIN_MAKING || d->state == DOMAIN_SPLIT;

		idle += !whole && !d->size;

		/* What is mapped of one that is being made is its worker's to know. */
		taken += whole ? each : d->size;
		making += whole;
	}
	if (w->ndomains >= run_domains_most)
		return w->next_start == w->next_emit; /* which all of these wait for */
	/* Of those that are only waiting to be counted the memory is there for the next, at once. */
	if (w->sums && w->ndomains - idle < w->budget.threads + 2)
		return true;
	return making < w->budget.threads && taken + each <= (w->budget.threads + 1) * each;
}

bool run_crowded(const struct run *w)
{
	/* Who waits for a place gets none as long as a reader who has stopped keeps domains in memory. */
	return w->keep || slots_requested(w->runs->admission) || (w->next_start < run_reach(w) && !run_window(w));
}

/* It is there, or being made, or nothing of it is to be made. */
static bool begun(const struct run *w, size_t index)
{
	return run_change_skips(w, index) || run_is_there(w, index) || find(w, index);
}

/* What a region beside the survey reads for its halo is not known before. */
static bool takes_longer(const struct cut_leaf *a, const struct cut_leaf *b)
{
	return a->changed != b->changed ? a->changed : a->count > b->count;
}

/*
 * As they lie in the plan, since neighbours read the same cells. But of a mesh that nobody reads the last ones, a few for each
 * thread, by size: then what is done last is small, and no worker is idle for long beside it (longest processing time
 * first: Graham, Bounds on multiprocessing timing anomalies, 1969). Domains are still counted in the order of the plan; of more
 * than a few nobody would see for long how far it is.
 */
static size_t make_which(const struct run *w)
{
	size_t room = w->ndomains < run_domains_most ? run_domains_most - w->ndomains : 0, best = w->next_start;

	room = room < LAST_EACH * w->budget.threads ? room : LAST_EACH * w->budget.threads;
	for (size_t i = w->next_start; w->sums && i < run_reach(w); i++) {
		if (begun(w, i))
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
		if (begun(w, w->next_start)) {
			w->next_start++;
			continue;
		}
		if (!run_window(w) || !run_may_start(w) || !run_domain_start(w, make_which(w), SCHED_NORMAL))
			return;
	}
}

/* What waits for a slow reader goes to the store, the next one too. */
static void store_backlog(struct run *w)
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
	if (!w->stopping && run_backlog(w) && run_crowded(w))
		store_backlog(w);
	if (!w->stopping)
		make_next(w);
	run_arenas_fit(w);
	if (w->stopping) {
		settle_stopping(w);
		return;
	}
	if (w->splitting || w->domains || w->tasks || w->output_busy || w->next_emit != w->plan_n)
		return;
	if (!run_output_enough(w)) {
		settle_stopping(w);
		return;
	}
	w->state = RUN_FINISHING;
	w->task = (struct sched_task){.run = finish_run, .done = finish_done, .owner = w->owner, .priority = SCHED_FIRST};
	w->task_busy = true;
	sched_submit(w->runs->core->p.sched, &w->task);
}

void run_settle(struct run *w)
{
	if (w->state == RUN_OVER)
		return;
	if (w->stopping) {
		settle_stopping(w);
		return;
	}
	if (w->state == RUN_UNSELECTED)
		run_select_start(w);
	else if (w->state == RUN_OPEN)
		run_plan_start(w);
	if (w->stopping) {
		settle_stopping(w);
		return;
	}
	if (w->state == RUN_RUNNING)
		settle_running(w);
	else if (w->state == RUN_FINISHING && !w->task_busy)
		over(w);
}

void run_start(struct run *w)
{
	open_start(w);
}

void run_relieve(struct run *w, bool urgent)
{
	struct run_domain *d, *next;

	if (w->state != RUN_RUNNING || w->stopping)
		return;
	run_arenas_fit(w);
	if (urgent)
		run_output_relieve(w);
	/* What it has will be given back soon. */
	if (!urgent && (w->emitting || (w->output_busy && !run_backlog(w))))
		return;
	for (d = w->domains; d; d = next) {
		next = d->next;
		/* The next one to be emitted is on its way already, unless its reader is slow. What has no memory gives none: it
		 * would only be made or read again. */
		if (d->state != DOMAIN_READY || !d->size || (d->index == w->next_emit && !w->output_busy && !awaits_output(w)))
			continue;
		if (d->stored || d->unstorable)
			run_domain_release(d);
		else
			run_domain_store(d);
	}
}

void run_tick(struct run *w)
{
	if (w->state == RUN_NEW) {
		if (w->stopping)
			over(w);
		else if (w->placed)
			open_start(w);
		else
			run_space_tick(w);
		return;
	}
	if (w->state == RUN_SELECTING && w->calls->moved && atomic_load(&w->select.judged) != w->select.told) {
		w->select.told = atomic_load(&w->select.judged);
		w->calls->moved(w->ctx);
	}
	run_pace_tick(w);
	run_output_tick(w);
	run_settle(w);
}
