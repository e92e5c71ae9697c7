/*
 * Arenas: memory that passes from one domain to the next, so its pages need not be cleared again.
 *
 * The model where only sums are needed: as many domains as the run has threads bring an arena, with its charge. The other domains
 * borrow one, and take no memory from the scheduler. A domain usually finds a free arena, because every other domain in the
 * making has one. It finds none if an arena was unmapped because others lack memory, if the domain that brings one still waits
 * for memory, or if there are more workers than the run may have. Then it asks for an arena of its own, and surplus arenas are
 * unmapped later.
 *
 * So an arena stays where its pages are resident, and mostly in the cache of its worker. With two arenas a worker, they caused a
 * third of the page faults of a small job.
 *
 * Where a reader takes the triangles, a domain keeps its arena until its block is sent. Then the arena is free, with its charge,
 * and the next domain that is started gets both. So there are as many as there are domains in memory. While somebody lacks
 * memory, what is behind the result of a domain is unmapped, and no arena is kept. That is only for arenas in huge pages:
 * clearing these is a twelfth of the CPU time of a mesh that is read. The others have few pages that were touched.
 *
 * Any thread may take a free arena; the loop alone counts arenas and what is charged for them.
 */
#include <sys/mman.h>

#include "lock.h"
#include "run_priv.h"

/* A free arena; the link lies at its start. */
struct arena {
	struct arena *next;
};

static struct lock arenas_lock = LOCK_STATIC(ARENA);

static size_t arena_bytes(const struct run *w)
{
	return run_page_round(w->budget.domain_bytes);
}

/* ---- workers ---- */

bool run_arena_take(struct run_domain *d)
{
	struct run_arenas *all = &d->run->arenas;

	lock_take(&arenas_lock);
	d->memory = all->free;
	if (d->memory)
		all->free = all->free->next;
	lock_give(&arenas_lock);
	d->size = d->memory ? arena_bytes(d->run) : 0;
	return d->memory;
}

void run_arena_put(struct run_domain *d)
{
	struct run_arenas *all = &d->run->arenas;
	struct arena *a = d->memory;

	lock_take(&arenas_lock);
	a->next = all->free;
	all->free = a;
	lock_give(&arenas_lock);
	d->memory = NULL;
	d->size = 0;
	d->returned_arena = true;
}

/* ---- loop ---- */

uint64_t run_arena_ask(struct run_domain *d, bool own)
{
	struct run_arenas *all = &d->run->arenas;

	d->returned_arena = d->no_arena = false;
	d->borrows_arena = !own && all->owned >= d->run->budget.threads;
	all->owned += !d->borrows_arena;
	return d->borrows_arena ? 0 : arena_bytes(d->run);
}

void run_arena_settle(struct run_domain *d)
{
	struct run_arenas *all = &d->run->arenas;

	if (d->borrows_arena && d->memory) {
		all->owned--;
		all->charged -= d->size;
	} else if (!d->borrows_arena && d->returned_arena) {
		all->charged += d->task.bytes;
	} else if (!d->borrows_arena) {
		all->owned--;
	}
}

bool run_arena_is_scarce(const struct run *w)
{
	return sched_starved(w->runs->core->p.sched) || admission_user_limit(w->runs->admission, &w->owner) != UINT64_MAX;
}

static bool has_reader(const struct run *w)
{
	return !w->sums_only && w->output && w->state == RUN_RUNNING && !w->stopping;
}

bool run_arena_passes(const struct run_domain *d)
{
	const struct run *w = d->run;

	return has_reader(w) && d->huge && d->memory && d->size == arena_bytes(w) && w->next_start < run_reach(w) &&
	       !run_arena_is_scarce(w);
}

bool run_arena_inherit(struct run_domain *d)
{
	struct run *w = d->run;

	if (!has_reader(w) || !d->huge || !run_arena_take(d))
		return false;
	w->arenas.owned--;
	w->arenas.charged -= d->size;
	return true;
}

void run_arena_leave(struct run_domain *d)
{
	struct run *w = d->run;

	if (!run_arena_passes(d) || w->arenas.owned > w->budget.threads) {
		run_domain_unmap(d);
		return;
	}
	w->arenas.owned++;
	w->arenas.charged += d->size;
	run_arena_put(d);
}

void run_arenas_trim_results(struct run *w)
{
	for (struct run_domain *d = w->domains; d; d = d->next)
		if (d->state == DOMAIN_READY || d->state == DOMAIN_SENDING)
			run_domain_trim(d, d->held);
}

/* As many as can be in use at once. */
static unsigned arenas_most(const struct run *w)
{
	const struct run_domain *d;
	unsigned making = 0;

	if (!w->sums_only)
		return has_reader(w) && w->next_start < run_reach(w) && !run_arena_is_scarce(w) ? w->budget.threads + 1 : 0;
	for (d = w->domains; d; d = d->next)
		making += d->state == DOMAIN_MAKING;
	return making < w->budget.threads ? making : w->budget.threads;
}

void run_arenas_trim(struct run *w)
{
	struct run_domain one = {.run = w};
	unsigned most = arenas_most(w);

	if (has_reader(w) && run_arena_is_scarce(w))
		run_arenas_trim_results(w);
	while ((w->arenas.owned > most || sched_starved(w->runs->core->p.sched)) && run_arena_take(&one)) {
		munmap(one.memory, one.size);
		w->arenas.owned--;
		w->arenas.charged -= one.size;
		sched_give(w->runs->core->p.sched, LEDGER_DOMAIN, one.size);
	}
}
