/*
 * Task groups: a task and its helpers work on the same steps (sched_group.h).
 *
 * The model: the task takes steps until none is left, then waits for the helpers that are in a step. Helpers are tasks of
 * priority SCHED_LAST without memory: they run on idle threads, and occasionally on others (sched_queue.c). After a step a helper
 * returns to the queue if a task of another flow waits, or if HELP_SECONDS have passed. A helper that finds no step left ends.
 */
#include "sched_group.h"

#include <assert.h>
#include <stddef.h>
#include <stdlib.h>

#include "clock.h"
#include "err.h"
#include "lock.h"
#include "thread.h"

/* Passing through the queue costs as much as a short step, so helpers do not do it after each step. They must do it at times:
 * only there the queue accounts for the time that a helper used, and a spare thread is released. */
#define HELP_SECONDS 0.02

struct helper {
	struct sched_task task;
	struct sched_group *group;
	unsigned member;
};

struct sched_group {
	struct sched_group_params p;
	struct lock lock;    /* guards working and closed */
	pthread_cond_t idle; /* `working` decreased */
	unsigned working;    /* members in a step */
	bool closed;         /* no further step begins */
	unsigned running;    /* members that have not ended; loop only */
	struct helper helper[];
};

_Static_assert(offsetof(struct helper, task) == 0, "a task is cast to its helper");

int sched_group_new(const struct sched_group_params *p, struct sched_group **ret, struct err *err)
{
	struct sched_group *g = calloc(1, sizeof *g + (p->members - 1) * sizeof *g->helper);

	if (!g)
		return err_set(err, ERR_NOMEM, "no memory for %u workers", p->members);
	g->p = *p;
	lock_init(&g->lock, LOCK_TASK_GROUP);
	pthread_cond_init(&g->idle, NULL);
	*ret = g;
	return 0;
}

struct sched_group *sched_group_free(struct sched_group *g)
{
	if (!g)
		return NULL;
	pthread_cond_destroy(&g->idle);
	lock_done(&g->lock);
	free(g);
	return NULL;
}

/* ---- workers ---- */

static bool take_step(struct sched_group *g, unsigned member)
{
	bool more;

	lock_take(&g->lock);
	more = !g->closed;
	g->working += more;
	lock_give(&g->lock);
	if (!more)
		return false;
	more = g->p.step(g->p.ctx, member);
	lock_take(&g->lock);
	g->working--;
	pthread_cond_broadcast(&g->idle);
	lock_give(&g->lock);
	return more;
}

void sched_group_run(struct sched_group *g)
{
	while (take_step(g, 0))
		;
	lock_take(&g->lock);
	g->closed = true;
	while (g->working)
		lock_wait(&g->lock, &g->idle);
	lock_give(&g->lock);
}

static void helper_run(struct sched_task *t)
{
	struct helper *h = (struct helper *)t;
	uint64_t begun_ns = clock_mono_ns();
	bool more;

	do
		more = take_step(h->group, h->member);
	while (more && !atomic_load(&t->cancel) && clock_since(begun_ns) < HELP_SECONDS &&
	       !sched_others_wait(h->group->p.sched, t->owner.flow));
	if (!more)
		atomic_store(&t->cancel, true);
}

/* ---- loop ---- */

static void end_member(struct sched_group *g)
{
	assert(g->running);
	if (!--g->running)
		g->p.over(g->p.ctx);
}

static void helper_done(struct sched_task *t)
{
	struct sched_group *g = ((struct helper *)t)->group;

	if (t->ran && !atomic_load(&t->cancel)) {
		t->ran = false;
		sched_submit(g->p.sched, t);
		return;
	}
	t->run = NULL;
	end_member(g);
}

void sched_group_start(struct sched_group *g)
{
	THREAD_LOOP_ONLY();
	g->running = g->p.members;
	for (unsigned i = 0; i + 1 < g->p.members; i++) {
		g->helper[i] = (struct helper){
			.task = {.run = helper_run, .done = helper_done, .owner = g->p.owner, .priority = SCHED_LAST},
			.group = g,
			.member = i + 1};
		sched_submit(g->p.sched, &g->helper[i].task);
	}
}

void sched_group_end(struct sched_group *g)
{
	THREAD_LOOP_ONLY();
	for (unsigned i = 0; i + 1 < g->p.members; i++)
		if (g->helper[i].task.run)
			sched_cancel(g->p.sched, &g->helper[i].task);
	end_member(g);
}
