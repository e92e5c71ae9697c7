/*
 * The loop's side of a walk: which domain is made next, which is emitted next, and what gives way when memory
 * is short.
 *
 * The model: domains [0, next_emit) are emitted; of [next_emit, next_start) those in the list are in memory
 * or being made, the others are in the store, or were lost and are made again when their turn comes. Behind next_start
 * nothing is begun but what is in the list: the last ones of a mesh that nobody reads, largest first. At most
 * one emission, one split and one output task run at a time. A walk never waits while it holds memory that
 * others need: whatever is finished and not next can go to the store at any moment (walk_relieve), and the
 * block being written can be spooled. A reader who is slow for a quarter of a second turns run-ahead in
 * memory into run-ahead in the store.
 */
#include "walk.h"

#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "job_priv.h"
#include "log.h"
#include "walk_priv.h"

#define STALL_SECONDS 0.25
/* A failed walk lets a block that is half written be finished, so that the error can follow it. */
#define FAREWELL_SECONDS 2.0
/* Domains of a thread that are made by size. */
enum { LAST_EACH = 8 };

unsigned walk_domains_most = 64;

static struct walk *walk_of_task(struct sched_task *t)
{
	return (struct walk *)((char *)t - offsetof(struct walk, task));
}

int walk_new(const struct walk_params *p, struct walk **ret, struct err *err)
{
	struct walk *w = calloc(1, sizeof *w);
	int r;

	if (!w)
		return err_set(err, ERR_NOMEM, "no memory for a job");
	disk_mend(p->jobs);
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
	w->charged = sizeof *w + house_view_bytes(p->view_text, (w->view.area != NULL) + (w->view.window_area != NULL)) +
		     (p->jobs->p.threads + 4) * sizeof(struct walk_domain);
	r = house_take(p->jobs, w->charged, "the view of a job", err);
	if (r) {
		view_done(&w->view);
		free(w->view_text);
		free(w);
		return r;
	}
	w->jobs = p->jobs;
	w->plan.ledger = p->jobs->p.ledger;
	w->dataset = dataset_hold(p->dataset);
	w->generation = p->generation;
	w->keep = p->keep;
	w->client = p->client;
	w->plan_only = p->plan_only;
	w->job = p->job;
	w->owner = p->owner;
	w->place = p->place;
	w->owner.flow = ++p->jobs->last_flow;
	w->patience = p->patience;
	w->file = p->plan;
	w->lazy = p->lazy;
	w->since = p->since;
	w->calls = p->calls;
	w->ctx = p->ctx;
	w->why = ERR_INIT;
	w->err = ERR_INIT;
	*ret = w;
	return 0;
}

struct walk *walk_free(struct walk *w)
{
	if (!w)
		return NULL;
	walk_change_free(w, w->change);
	cut_plan_done(&w->plan);
	dataset_release(w->dataset);
	view_done(&w->view);
	house_give(w->jobs, w->charged);
	free(w->view_text);
	free(w);
	return NULL;
}

void walk_shut(struct walk *w)
{
	pipe_emitter_free(w->emitter);
	w->emitter = NULL;
	walk_there_free(w);
	walk_space_shut(w);
	w->grid = grid_close(w->grid);
	if (w->opened)
		dataset_close(w->dataset);
	w->opened = false;
	if (w->emitter_bytes)
		sched_give(w->jobs->p.sched, LEDGER_EMITTER, w->emitter_bytes);
	if (w->output_buffer)
		sched_give(w->jobs->p.sched, LEDGER_PIPE, JOB_OUTPUT_BUFFER);
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
static void count_classes(struct walk *w)
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
	struct walk *w = walk_of_task(t);
	struct jobs *j = w->jobs;

	w->err = ERR_INIT;
	w->r = dataset_open(w->dataset, &w->err);
	if (w->r)
		return;
	w->opened = true;
	w->r = grid_open(w->dataset->dirfd, w->manifest, w->generation, j->p.ledger, j->index_share, &w->grid, &w->err);
	if (w->r)
		return;
	view_bind(&w->view, &grid_manifest(w->grid)->lattice);
	w->rest = w->view;
	count_classes(w);
	w->r = pipe_emitter_new(&grid_manifest(w->grid)->lattice, j->emitter_share, j->tempfd, &w->emitter, &w->err);
	if (!w->r && w->view.window)
		pipe_emitter_part(w->emitter);
	if (!w->r)
		w->r = walk_plan_read(w, &w->err);
	if (!w->r)
		w->r = walk_change_read(w, &w->err);
	if (!w->r && view_selects(&w->view))
		w->r = walk_select_open(w, &w->err);
}

/* The job may be older than a prune: a user knows the dataset by its name, not by that of a manifest. */
static void name_generation(struct walk *w)
{
	struct err why = ERR_INIT;

	if (w->r == -ERR_NOTFOUND && dataset_check_generation(w->dataset, w->generation, &why))
		w->err = why;
}

void walk_opened(struct walk *w)
{
	name_generation(w);
	if (w->stopping || (w->r < 0 && w->r != -ERR_BUSY)) {
		if (w->r < 0)
			walk_fail(w, &w->err);
		walk_settle(w);
		return;
	}
	if (w->r == -ERR_BUSY) {
		/* The index has no memory now, or a selection is to be made again: from the start, at the next
		 * tick. */
		walk_shut(w);
		w->state = WALK_NEW;
		return;
	}
	w->state = w->r == WALK_E_ABSENT ? WALK_UNSELECTED : WALK_OPEN;
	if (w->state == WALK_OPEN)
		pipe_key_init(&w->key, w->grid, &w->rest);
	walk_settle(w);
}

static void open_done(struct sched_task *t)
{
	struct walk *w = walk_of_task(t);

	w->task_busy = false;
	if (!t->ran) {
		walk_settle(w);
		return;
	}
	w->emitter_bytes = t->bytes;
	walk_opened(w);
}

static void open_start(struct walk *w)
{
	w->state = WALK_OPENING;
	w->opened_ns = w->opened_ns ? w->opened_ns : clock_mono_ns();
	memcpy(w->manifest, w->dataset->manifest, sizeof w->manifest);
	w->task = (struct sched_task){
		.run = open_run,
		.done = open_done,
		.owner = w->owner,
		.priority = SCHED_FIRST,
		.name = LEDGER_EMITTER,
		.bytes = w->jobs->emitter_share,
	};
	w->task_busy = true;
	sched_submit(w->jobs->p.sched, &w->task);
}

/* ---- the end ---- */

static void finish_run(struct sched_task *t)
{
	struct walk *w = walk_of_task(t);

	w->err = ERR_INIT;
	w->r = pipe_emitter_finish(w->emitter, &w->totals, &w->err);
}

static void finish_done(struct sched_task *t)
{
	struct walk *w = walk_of_task(t);

	w->task_busy = false;
	if (t->ran && !w->r)
		w->r = walk_select_count(w, &w->err);
	if (t->ran && w->r)
		walk_fail(w, &w->err);
	walk_settle(w);
}

static void over(struct walk *w)
{
	w->state = WALK_OVER;
	place_leave(w->jobs, w->place);
	walk_shut(w);
	if (w->why.code == ERR_CORRUPT)
		walk_select_discard(w);
	w->calls->ended(w->ctx, w->why.code ? &w->why : NULL);
}

/* What would do for a region that does not fit. */
static void memory_hint(struct walk *w)
{
	uint64_t memory = jobs_memory_for(w->jobs, w->grid, w->why.need);

	if (limit_memory(w->jobs, &w->owner) != UINT64_MAX)
		err_add_hint(
			&w->why,
			"one user may have %u%% of the memory (user-memory): ask an administrator for more, or leave out points",
			w->jobs->p.user.memory);
	else if (memory)
		err_add_hint(&w->why, "run with memory=%lluM or more", (unsigned long long)(memory >> 20));
	else
		err_add_hint(&w->why, "a domain carries at most %u positions, whatever the memory: leave out points",
			     w->budget.cap);
}

void walk_fail(struct walk *w, const struct err *why)
{
	struct walk_domain *d;

	if (w->giving && walk_space_waits(w))
		return; /* what its tasks meet on their way out is nothing new */
	if (w->giving) {
		/* It ends for good now. */
		w->giving = false;
		w->why = *why;
		return;
	}
	if (w->stopping || w->state == WALK_OVER)
		return;
	w->giving = walk_space_met(w, why);
	w->stopping = true;
	w->stopped_ns = clock_mono_ns();
	w->why = *why;
	if (why->code == ERR_LIMIT && why->need && w->grid)
		memory_hint(w);
	if (w->task_busy)
		sched_cancel(w->jobs->p.sched, &w->task);
	for (d = w->domains; d; d = d->next)
		if (d->state != DOMAIN_READY && d->state != DOMAIN_SENDING)
			sched_cancel(w->jobs->p.sched, &d->task);
}

void walk_stop(struct walk *w, const struct err *why)
{
	walk_space_forget(w);
	walk_fail(w, why);
}

static void settle_stopping(struct walk *w)
{
	struct walk_domain *d, *next;

	walk_arenas_fit(w);
	bool farewell = w->sending && w->output && clock_since(w->stopped_ns) < FAREWELL_SECONDS;

	/* It goes on behind this block. */
	farewell |= w->output && w->output_busy && w->giving && walk_space_waits(w);

	for (d = w->domains; d; d = next) {
		next = d->next;
		if (d->state == DOMAIN_READY || (d->state == DOMAIN_SPLIT && w->splitting != d))
			walk_domain_release(d);
	}
	if (w->task_busy || w->tasks || farewell)
		return;
	while (w->domains)
		walk_domain_release(w->domains);
	w->sending = w->emitting = NULL;
	if (!walk_gave_way(w))
		over(w);
}

/* ---- running ---- */

static struct walk_domain *find(const struct walk *w, size_t index)
{
	struct walk_domain *d;

	for (d = w->domains; d && d->index != index; d = d->next)
		;
	return d;
}

/* Its reader is slow, or has not come yet: domains go to the store. */
bool walk_backlog(const struct walk *w)
{
	/* While a worker has the output, its block is being spooled or comes back from there. */
	return w->output && w->output_busy &&
	       (w->output_working || w->output->spooled || w->output->calls->stalled(w->output) > STALL_SECONDS);
}

/* A bound job's first block waits a while for its reader. */
static bool awaits_output(const struct walk *w)
{
	return !w->output && w->patience > 0 && !w->next_emit && clock_since(w->started_ns) < w->patience;
}

bool walk_stalled(const struct walk *w)
{
	if (w->state != WALK_RUNNING || w->ndomains)
		return false;
	/* For its reader, or for the walk that it follows. */
	return walk_backlog(w) ? w->lazy || w->next_start == w->plan_n :
				 w->next_start < w->plan_n && w->next_start >= walk_reach(w);
}

static void split_next(struct walk *w)
{
	struct walk_domain *d;

	for (d = w->domains; d && !w->splitting; d = d->next)
		if (d->state == DOMAIN_SPLIT && !walk_change_torn(w))
			walk_domain_split(d);
}

/* True if something was started that may make more possible at once. */
static bool emit_next(struct walk *w)
{
	struct walk_domain *d;

	if (w->stopping || w->emitting || w->output_busy || w->output_working || awaits_output(w))
		return false;
	if (w->next_emit >= w->next_start)
		return false;
	if (walk_change_skips(w, w->next_emit)) {
		w->next_emit++;
		return true;
	}
	if (w->splitting && w->sums)
		return false; /* the plan is a worker's */
	if (walk_is_there(w, w->next_emit)) {
		w->next_emit++;
		return true;
	}
	d = find(w, w->next_emit);
	if (!d) {
		/* It is in the store, or lost. */
		if (!w->splitting)
			walk_domain_start(w, w->next_emit, SCHED_FIRST);
		return false;
	}
	if (d->state != DOMAIN_READY)
		return false;
	walk_domain_emit(d);
	return !w->emitting;
}

/*
 * Whether one more domain may be started before those that are there. One being sent and one ready for when that is
 * done: so many always. More than these, so that a large domain holds nobody up whose own are small, as long as all
 * that is made and kept fits the memory that the plan counts on.
 */
static bool walk_window(const struct walk *w)
{
	uint64_t each = w->budget.domain_bytes, taken = 0;
	const struct walk_domain *d;
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
	if (w->ndomains >= walk_domains_most)
		return w->next_start == w->next_emit; /* which all of these wait for */
	/* Of those that are only waiting to be counted the memory is there for the next, at once. */
	if (w->sums && w->ndomains - idle < w->budget.threads + 2)
		return true;
	return making < w->budget.threads && taken + each <= (w->budget.threads + 1) * each;
}

bool walk_crowded(const struct walk *w)
{
	/* Who waits for a place gets none as long as a reader who has stopped keeps domains in memory. */
	return w->keep || w->jobs->places || (w->next_start < walk_reach(w) && !walk_window(w));
}

/* It is there, or being made, or nothing of it is to be made. */
static bool begun(const struct walk *w, size_t index)
{
	return walk_change_skips(w, index) || walk_is_there(w, index) || find(w, index);
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
static size_t make_which(const struct walk *w)
{
	size_t room = w->ndomains < walk_domains_most ? walk_domains_most - w->ndomains : 0, best = w->next_start;

	room = room < LAST_EACH * w->budget.threads ? room : LAST_EACH * w->budget.threads;
	for (size_t i = w->next_start; w->sums && i < walk_reach(w); i++) {
		if (begun(w, i))
			continue;
		if (!room--)
			return w->next_start;
		if (takes_longer(&w->plan.leaf[i], &w->plan.leaf[best]))
			best = i;
	}
	return best;
}

static void make_next(struct walk *w)
{
	while (!w->splitting && w->next_start < walk_reach(w)) {
		if (begun(w, w->next_start)) {
			w->next_start++;
			continue;
		}
		if (!walk_window(w) || !limit_domain(w) || !walk_domain_start(w, make_which(w), SCHED_NORMAL))
			return;
	}
}

/* What waits for a slow reader goes to the store, the next one too. */
static void store_backlog(struct walk *w)
{
	struct walk_domain *d, *next;

	for (d = w->domains; d; d = next) {
		next = d->next;
		if (d->state == DOMAIN_READY && !d->unstorable)
			walk_domain_store(d);
	}
}

static void settle_running(struct walk *w)
{
	walk_plan_follow(w);
	split_next(w);
	while (emit_next(w))
		;
	if (!w->stopping && walk_backlog(w) && walk_crowded(w))
		store_backlog(w);
	if (!w->stopping)
		make_next(w);
	walk_arenas_fit(w);
	if (w->stopping) {
		settle_stopping(w);
		return;
	}
	if (w->splitting || w->domains || w->tasks || w->output_busy || w->next_emit != w->plan_n)
		return;
	if (!walk_output_enough(w)) {
		settle_stopping(w);
		return;
	}
	w->state = WALK_FINISHING;
	w->task = (struct sched_task){.run = finish_run, .done = finish_done, .owner = w->owner, .priority = SCHED_FIRST};
	w->task_busy = true;
	sched_submit(w->jobs->p.sched, &w->task);
}

void walk_settle(struct walk *w)
{
	if (w->state == WALK_OVER)
		return;
	if (w->stopping) {
		settle_stopping(w);
		return;
	}
	if (w->state == WALK_UNSELECTED)
		walk_select_start(w);
	else if (w->state == WALK_OPEN)
		walk_plan_start(w);
	if (w->stopping) {
		settle_stopping(w);
		return;
	}
	if (w->state == WALK_RUNNING)
		settle_running(w);
	else if (w->state == WALK_FINISHING && !w->task_busy)
		over(w);
}

void walk_start(struct walk *w)
{
	open_start(w);
}

void walk_relieve(struct walk *w, bool urgent)
{
	struct walk_domain *d, *next;

	if (w->state != WALK_RUNNING || w->stopping)
		return;
	walk_arenas_fit(w);
	if (urgent)
		walk_output_relieve(w);
	/* What it has will be given back soon. */
	if (!urgent && (w->emitting || (w->output_busy && !walk_backlog(w))))
		return;
	for (d = w->domains; d; d = next) {
		next = d->next;
		/* The next one to be emitted is on its way already, unless its reader is slow. What has no memory gives none: it
		 * would only be made or read again. */
		if (d->state != DOMAIN_READY || !d->size || (d->index == w->next_emit && !w->output_busy && !awaits_output(w)))
			continue;
		if (d->stored || d->unstorable)
			walk_domain_release(d);
		else
			walk_domain_store(d);
	}
}

void walk_tick(struct walk *w)
{
	if (w->state == WALK_NEW) {
		if (w->stopping)
			over(w);
		else if (w->placed)
			open_start(w);
		else
			walk_space_tick(w);
		return;
	}
	if (w->state == WALK_SELECTING && w->calls->moved && atomic_load(&w->select.judged) != w->select.told) {
		w->select.told = atomic_load(&w->select.judged);
		w->calls->moved(w->ctx);
	}
	walk_pace_tick(w);
	walk_output_tick(w);
	walk_settle(w);
}
