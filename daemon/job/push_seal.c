/*
 * Sealing what was staged, by several workers at once.
 *
 * The model: the commit's task goes on as long as there is anything to do. Helpers start only where a thread is
 * idle, take one step each and queue up again behind everybody else; they need no memory but the stage's. Whoever
 * comes when the last step was begun goes; the commit's task waits for those still at work and finishes.
 */
#include <stdlib.h>

#include "push_priv.h"

struct sealer {
	struct sched_task task;
	struct push_sealing *all;
};

struct push_sealing {
	struct push *push;
	struct grid_seal *seal;
	struct push_guard guard, door; /* the engine's; ours, around the next two */
	unsigned working;
	bool closed;
	unsigned members, running; /* helpers; the loop's */
	struct sealer member[GRID_LANES];
};

struct push_sealing *push_sealing_new(struct push *p, struct err *err)
{
	unsigned threads = sched_threads(p->jobs->p.sched);
	struct push_sealing *s = calloc(1, sizeof *s);
	struct grid_guard guard;

	if (!s) {
		err_set(err, ERR_NOMEM, "no memory to seal a push");
		return NULL;
	}
	push_guard_init(&s->guard);
	push_guard_init(&s->door);
	guard = push_guard_of(&s->guard);
	s->push = p;
	threads = threads < GRID_LANES ? threads : GRID_LANES;
	if (grid_seal_begin(p->stage, threads, &guard, &s->seal, err))
		return push_sealing_free(s);
	s->members = grid_seal_workers(s->seal);
	s->members = (s->members < threads ? s->members : threads) - 1;
	return s;
}

struct push_sealing *push_sealing_free(struct push_sealing *s)
{
	if (!s)
		return NULL;
	grid_seal_free(s->seal);
	push_guard_free(&s->guard);
	push_guard_free(&s->door);
	free(s);
	return NULL;
}

/* One step; false: there is no other. */
static bool step(struct push_sealing *s)
{
	struct err err = ERR_INIT; /* of whoever comes first, which the seal keeps */
	uint64_t done, all;
	int r;

	push_guard_lock(&s->door);
	r = s->closed ? GRID_SEAL_OVER : 0;
	s->working += !r;
	push_guard_unlock(&s->door);
	if (r)
		return false;
	r = grid_seal_step(s->seal, &err);
	grid_seal_progress(s->seal, &done, &all);
	atomic_store(&s->push->progress, done);
	atomic_store(&s->push->claimed, all);
	push_guard_lock(&s->door);
	s->working--;
	push_guard_wake(&s->door);
	push_guard_unlock(&s->door);
	return r == 0;
}

int push_sealing_finish(struct push_sealing *s, struct grid_segment_info *ret, struct err *err)
{
	int r;

	while (step(s))
		;
	push_guard_lock(&s->door);
	s->closed = true;
	while (s->working)
		push_guard_wait(&s->door);
	push_guard_unlock(&s->door);
	r = grid_seal_finish(s->seal, ret, err);
	s->seal = NULL;
	return r;
}

/* ---- helpers ---- */

static void over(struct push_sealing *s)
{
	if (!s->running)
		push_task_over(s->push);
}

static void help(struct sched_task *t)
{
	struct sealer *m = (struct sealer *)t;

	if (!step(m->all))
		atomic_store(&t->cancel, true);
}

static void helped(struct sched_task *t)
{
	struct sealer *m = (struct sealer *)t;
	struct push_sealing *s = m->all;

	if (t->ran && !atomic_load(&t->cancel)) {
		t->ran = false;
		sched_submit(s->push->jobs->p.sched, t);
		return;
	}
	t->run = NULL;
	s->running--;
	over(s);
}

_Static_assert(offsetof(struct sealer, task) == 0, "a task is its sealer");

void push_sealing_start(struct push_sealing *s)
{
	s->running = s->members + 1;
	for (unsigned i = 0; i < s->members; i++) {
		s->member[i].all = s;
		s->member[i].task = (struct sched_task){.run = help, .done = helped, .owner = s->push->owner,
							.priority = SCHED_LAST};
		sched_submit(s->push->jobs->p.sched, &s->member[i].task);
	}
}

void push_sealing_end(struct push_sealing *s)
{
	for (unsigned i = 0; i < s->members; i++)
		if (s->member[i].task.run)
			sched_cancel(s->push->jobs->p.sched, &s->member[i].task);
	s->running--;
	over(s);
}
