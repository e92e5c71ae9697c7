/*
 * The domains of a run: the list, and the tasks that make and split them.
 *
 * The model: a table of states (enum run_domain_state). The worker that makes a domain maps its memory, of the size that was
 * charged; afterwards the part that the result does not need is unmapped and returned. A task owns its run_domain from its
 * submission until `done`. While `splitting` is set, the plan belongs to a worker.
 */
#include <assert.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "clock.h"
#include "log.h"
#include "recency.h"
#include "store.h"
#include "run_priv.h"

/* ---- the list ---- */

/* An arena that passes to other domains (run_arena.c) fills its huge pages if they have that many positions ... */
uint64_t run_huge_count = 1 << 15;
/* ... one that does not, with that many ... */
#define HUGE_COUNT ((uint64_t)1 << 17)
/* ... and one for sums alone with that load, or if this many domains use it in turn. */
#define HUGE_LOAD ((uint32_t)1 << 17)
#define HUGE_DOMAINS 64

void run_domain_set_state(struct run_domain *d, enum run_domain_state next)
{
	static const unsigned allowed[] = {
		[DOMAIN_MAKING] = 1 << DOMAIN_MAKING | 1 << DOMAIN_SPLIT | 1 << DOMAIN_READY,
		[DOMAIN_SPLIT] = 1 << DOMAIN_MAKING,
		[DOMAIN_READY] = 1 << DOMAIN_MAKING | 1 << DOMAIN_STORING | 1 << DOMAIN_EMITTING,
		[DOMAIN_STORING] = 1 << DOMAIN_READY,
		[DOMAIN_EMITTING] = 1 << DOMAIN_SENDING,
		[DOMAIN_SENDING] = 0,
	};

	THREAD_LOOP_ONLY();
	assert(allowed[d->state] >> next & 1);
	d->state = next;
}

static struct run_domain *domain_add(struct run *w, size_t index)
{
	struct run_domain *d = calloc(1, sizeof *d), **at;
	struct err err = ERR_INIT;

	if (!d) {
		err_set(&err, ERR_NOMEM, "no memory for a domain");
		run_fail(w, &err);
		return NULL;
	}
	d->run = w;
	d->index = index;
	d->err = ERR_INIT;
	for (at = &w->domains; *at && (*at)->index < index; at = &(*at)->next)
		;
	d->next = *at;
	*at = d;
	w->ndomains++;
	return d;
}

void run_domain_release(struct run_domain *d)
{
	struct run *w = d->run;
	struct run_domain **at;

	for (at = &w->domains; *at != d; at = &(*at)->next)
		;
	*at = d->next;
	w->ndomains--;
	run_arena_leave(d);
	free(d);
}

void run_domain_submit(struct run_domain *d, void (*run)(struct sched_task *), void (*done)(struct sched_task *),
		       enum sched_priority priority, uint64_t bytes)
{
	d->task = (struct sched_task){
		.run = run,
		.done = done,
		.owner = d->run->owner,
		.priority = priority,
		.name = LEDGER_DOMAIN,
		.bytes = bytes,
	};
	d->run->tasks++;
	sched_submit(d->run->runs->core->p.sched, &d->task);
}

/* ---- making ---- */

/* Only the sums are needed. */
static void drop_result(struct run_domain *d)
{
	d->domain.triangle = NULL;
	d->domain.link = NULL;
	d->domain.vertex = NULL;
	d->domain.final = NULL;
	d->domain.edges = NULL;
	d->held = 0;
}

static int is_cancelled(void *task)
{
	return atomic_load(&((struct sched_task *)task)->cancel);
}

/* A region beside the survey, far from its points, has few of them, and reads many others for its halo. */
static int triangulate(struct run_domain *d)
{
	struct run *w = d->run;
	const struct pipe_reuse_params p = run_domain_reuse(d);
	const struct pipe_origin origin = {w->origin, &w->view};
	struct pipe_known known = {.sites = d->sites,
				   .flat = d->flat,
				   .origin = w->origin ? &origin : NULL,
				   .progress = is_cancelled,
				   .ctx = &d->task};
	struct pipe_before before;

	if (d->changed && !w->grid_view.window && pipe_before(&p, &before))
		known.before = &before;
	return pipe_domain(w->grid, &w->grid_view, &d->region, &known, &w->budget, d->memory, &d->domain, &d->need, &d->err);
}

static void make_or_load(struct run_domain *d)
{
	struct run *w = d->run;

	d->made = false;
	if (!w->grid_view.window && !w->grid_view.hidden && !d->flat && run_domain_load(d)) {
		run_domain_record(d);
		return;
	}
	d->made = true;
	d->r = triangulate(d);
	if (d->r)
		return;
	d->held = pipe_domain_held(&d->domain, d->memory);
	d->unstorable = w->grid_view.window || w->grid_view.hidden || d->flat;
	if (!d->unstorable && w->keep && !atomic_load(&d->task.cancel))
		run_domain_keep(d);
	if (d->stored)
		run_domain_record(d);
}

static void make_run(struct sched_task *t)
{
	struct run_domain *d = run_domain_of(t);
	struct run *w = d->run;

	d->err = ERR_INIT;
	d->r = 0;
	if (!d->borrows_arena && !d->memory)
		run_domain_map(d, t->bytes);
	else if (d->borrows_arena)
		d->no_arena = !run_arena_take(d);
	if (d->r || d->no_arena)
		return;
	make_or_load(d);
	if (d->r || !w->sums_only)
		return;
	drop_result(d);
	/* If others wait for memory, it is unmapped instead. */
	if (!sched_starved(w->runs->core->p.sched))
		run_arena_put(d);
}

static void make_done(struct sched_task *);

static void make_submit(struct run_domain *d, enum sched_priority priority, bool own)
{
	const struct run *w = d->run;
	uint64_t bytes;

	/* An arena is used by many domains, of which some may be larger than this one. */
	if (w->sums_only)
		d->huge = w->budget.load >= HUGE_LOAD || w->plan_n > w->stored_leaves.leaves + HUGE_DOMAINS;
	else
		d->huge = d->count >= (run_arena_is_scarce(w) ? HUGE_COUNT : run_huge_count);
	if (w->sums_only)
		bytes = run_arena_ask(d, own);
	else
		bytes = run_arena_inherit(d) ? 0 : run_page_round(w->budget.domain_bytes);
	run_domain_submit(d, make_run, make_done, priority, bytes);
}

static void make_done(struct sched_task *t)
{
	struct run_domain *d = run_domain_of(t);
	struct run *w = d->run;

	w->tasks--;
	if (w->sums_only)
		run_arena_settle(d);
	if (t->ran && !d->memory && !d->returned_arena)
		sched_give(w->runs->core->p.sched, t->name, t->bytes);
	if (d->no_arena && t->ran && !w->stopping) {
		make_submit(d, t->priority, true);
		return;
	}
	if (!t->ran || w->stopping) {
		run_domain_release(d);
		return;
	}
	if (d->r == PIPE_E_SPLIT) {
		run_domain_unmap(d);
		run_domain_set_state(d, DOMAIN_SPLIT);
	} else if (d->r) {
		run_fail(w, &d->err);
		run_domain_release(d);
	} else {
		if (!run_arena_passes(d))
			run_domain_trim(d, d->held);
		w->made += d->made;
		if (d->made)
			tally_domain(w->runs->core, d->domain.ntriangle);
		else
			w->runs->core->tally.domains_reused++;
		run_domain_set_state(d, DOMAIN_READY);
	}
	run_settle(w);
}

/* Its block will not be asked for. */
static bool is_numbering_only(const struct run_domain *d)
{
	const struct run *w = d->run;

	/* The number of a block is at most the index of its domain in the plan. */
	return w->output ? d->index < w->output->from : w->keep;
}

void run_domain_restart(struct run_domain *d, enum sched_priority priority)
{
	run_domain_unmap(d);
	run_domain_set_state(d, DOMAIN_MAKING);
	d->stored = false;
	d->numbering_only = is_numbering_only(d);
	make_submit(d, priority, false);
}

struct run_domain *run_domain_start(struct run *w, size_t index, enum sched_priority priority)
{
	struct run_domain *d = domain_add(w, index);

	if (!d)
		return NULL;
	d->region = w->plan.leaf[index].region;
	d->sites = w->plan.leaf[index].known ? w->plan.sites : NULL;
	d->count = w->plan.leaf[index].count;
	d->searched = w->plan.leaf[index].checked && !w->plan.leaf[index].there;
	d->changed = w->plan.leaf[index].changed;
	d->flat = w->plan.leaf[index].flat;
	run_domain_restart(d, priority);
	return d;
}

/* ---- splitting ---- */

static void split_run(struct sched_task *t)
{
	struct run_domain *d = run_domain_of(t);
	struct run *w = d->run;
	struct grid_reader *reader = NULL;
	size_t size = grid_reader_bytes(w->grid);
	void *memory = aligned_alloc(64, (size + 63) & ~(size_t)63);

	d->err = ERR_INIT;
	if (!memory) {
		d->r = err_set(&d->err, ERR_NOMEM, "no memory to read the grid");
		return;
	}
	d->r = grid_reader_new(w->grid, memory, size, &reader, &d->err);
	if (!d->r)
		d->r = pipe_plan_split(&w->plan, d->index, reader, &w->grid_view, d->need, w->budget.cap, &d->err);
	/* Durable before a half of it is made. */
	if (!d->r && w->file)
		d->r = plan_file_split(w->file, &d->region, &w->plan.leaf[d->index], &d->err);
	grid_reader_free(reader);
	free(memory);
}

static void split_done(struct sched_task *t)
{
	struct run_domain *d = run_domain_of(t), *other;
	struct run *w = d->run;
	size_t at = d->index;

	w->tasks--;
	w->splitting = NULL;
	w->plan_n = w->plan.n;
	if (t->ran)
		sched_give(w->runs->core->p.sched, t->name, t->bytes);
	if (!t->ran || w->stopping || d->r) {
		if (t->ran && d->r)
			run_fail(w, &d->err);
		run_domain_release(d);
		run_settle(w);
		return;
	}
	for (other = w->domains; other; other = other->next)
		if (other->index > at)
			other->index++;
	w->next_start += at < w->next_start;
	d->region = w->plan.leaf[at].region;
	d->sites = NULL;
	d->searched = d->changed = false;
	d->count = w->plan.leaf[at].count;
	run_domain_restart(d, SCHED_FIRST);
	run_domain_start(w, at + 1, SCHED_FIRST);
	run_settle(w);
}

void run_domain_split(struct run_domain *d)
{
	d->run->splitting = d;
	run_domain_submit(d, split_run, split_done, SCHED_FIRST, grid_reader_bytes(d->run->grid));
}

bool run_leaf_is_stored(const struct run *w, size_t index)
{
	return w->sums_only && w->plan.leaf[index].there;
}
