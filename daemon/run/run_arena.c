/*
 * The memory of domains of which only sums are wanted: it goes from one to the next, among the workers that make them.
 *
 * The model: as many domains as the run has threads bring an arena, and its charge; the others are lent one, and ask the
 * scheduler for no memory. Who is made then mostly finds one free, as others that are made have one each. Not where one was given
 * up because others lack memory, where who is to bring one waits for his memory still, or where there are more workers than the
 * run is to have: a domain that finds none asks for one of its own, and what is too many then goes. So an arena stays where its
 * pages are in memory already, and mostly in the cache of that worker; with two for each worker a third of the page faults of a
 * small job were theirs.
 *
 * Which are free is for any thread; how many there are, and what is charged for them, is the loop's to know.
 */
#include <sys/mman.h>

#include "lock.h"
#include "run_priv.h"

/* A free one, at its own start. */
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
	d->put = true;
}

/* ---- loop ---- */

uint64_t run_arena_ask(struct run_domain *d, bool own)
{
	struct run_arenas *all = &d->run->arenas;

	d->put = d->bare = false;
	d->lent = !own && all->owned >= d->run->budget.threads;
	all->owned += !d->lent;
	return d->lent ? 0 : arena_bytes(d->run);
}

void run_arena_back(struct run_domain *d)
{
	struct run_arenas *all = &d->run->arenas;

	if (d->lent && d->memory) {
		all->owned--;
		all->charged -= d->size;
	} else if (!d->lent && d->put) {
		all->charged += d->task.bytes;
	} else if (!d->lent) {
		all->owned--;
	}
}

/* As many as can be made at once, of those that are to be. */
static unsigned arenas_most(const struct run *w)
{
	const struct run_domain *d;
	unsigned making = 0;

	for (d = w->domains; d; d = d->next)
		making += d->state == DOMAIN_MAKING;
	return making < w->budget.threads ? making : w->budget.threads;
}

void run_arenas_fit(struct run *w)
{
	struct run_domain one = {.run = w};
	unsigned most = arenas_most(w);

	while ((w->arenas.owned > most || sched_starved(w->runs->core->p.sched)) && run_arena_take(&one)) {
		munmap(one.memory, one.size);
		w->arenas.owned--;
		w->arenas.charged -= one.size;
		sched_give(w->runs->core->p.sched, LEDGER_DOMAIN, one.size);
	}
}
