/*
 * Helpers for a task (crew.h): sealing what was staged, looking at what is stored of a plan.
 *
 * The model: the task goes on as long as there is anything to do. Helpers are SCHED_LAST: they start where a thread is idle, and
 * now and then elsewhere (sched_queue.c). After a step they queue up again if a task of another flow waits, and otherwise after
 * STAY_SECONDS; they take no memory of the scheduler's. Whoever comes when the last step was begun goes; the task waits for those
 * still at work.
 */
#include "crew.h"

#include <pthread.h>
#include <stddef.h>
#include <stdlib.h>

#include "clock.h"
#include "err.h"

/* The way through the queue costs what a short step does. But only there it is counted what a helper has had, which matters once
 * somebody else comes, and only there a spare thread is given back. */
#define STAY_SECONDS 0.02

struct helper {
	struct sched_task task;
	struct crew *crew;
	unsigned member;
};

struct crew {
	struct crew_params p;
	pthread_mutex_t lock; /* of the next two */
	pthread_cond_t idle;  /* `working` became less */
	unsigned working;
	bool closed;
	unsigned running; /* the task and helpers; the loop's */
	struct helper helper[];
};

_Static_assert(offsetof(struct helper, task) == 0, "a task is its helper");

int crew_new(const struct crew_params *p, struct crew **ret, struct err *err)
{
	struct crew *c = calloc(1, sizeof *c + (p->members - 1) * sizeof *c->helper);

	if (!c)
		return err_set(err, ERR_NOMEM, "no memory for %u workers", p->members);
	c->p = *p;
	pthread_mutex_init(&c->lock, NULL);
	pthread_cond_init(&c->idle, NULL);
	*ret = c;
	return 0;
}

struct crew *crew_free(struct crew *c)
{
	if (!c)
		return NULL;
	pthread_cond_destroy(&c->idle);
	pthread_mutex_destroy(&c->lock);
	free(c);
	return NULL;
}

/* ---- workers ---- */

static bool step(struct crew *c, unsigned member)
{
	bool more;

	pthread_mutex_lock(&c->lock);
	more = !c->closed;
	c->working += more;
	pthread_mutex_unlock(&c->lock);
	if (!more)
		return false;
	more = c->p.step(c->p.ctx, member);
	pthread_mutex_lock(&c->lock);
	c->working--;
	pthread_cond_broadcast(&c->idle);
	pthread_mutex_unlock(&c->lock);
	return more;
}

void crew_work(struct crew *c)
{
	while (step(c, 0))
		;
	pthread_mutex_lock(&c->lock);
	c->closed = true;
	while (c->working)
		pthread_cond_wait(&c->idle, &c->lock);
	pthread_mutex_unlock(&c->lock);
}

static void help(struct sched_task *t)
{
	struct helper *h = (struct helper *)t;
	uint64_t begun_ns = clock_mono_ns();
	bool more;

	do
		more = step(h->crew, h->member);
	while (more && !atomic_load(&t->cancel) && clock_since(begun_ns) < STAY_SECONDS &&
	       !sched_others_wait(h->crew->p.sched, t->owner.flow));
	if (!more)
		atomic_store(&t->cancel, true);
}

/* ---- loop ---- */

static void gone(struct crew *c)
{
	if (!--c->running)
		c->p.over(c->p.ctx);
}

static void helped(struct sched_task *t)
{
	struct crew *c = ((struct helper *)t)->crew;

	if (t->ran && !atomic_load(&t->cancel)) {
		t->ran = false;
		sched_submit(c->p.sched, t);
		return;
	}
	t->run = NULL;
	gone(c);
}

void crew_start(struct crew *c)
{
	c->running = c->p.members;
	for (unsigned i = 0; i + 1 < c->p.members; i++) {
		c->helper[i] = (struct helper){.task = {.run = help, .done = helped, .owner = c->p.owner, .priority = SCHED_LAST},
					       .crew = c,
					       .member = i + 1};
		sched_submit(c->p.sched, &c->helper[i].task);
	}
}

void crew_end(struct crew *c)
{
	for (unsigned i = 0; i + 1 < c->p.members; i++)
		if (c->helper[i].task.run)
			sched_cancel(c->p.sched, &c->helper[i].task);
	gone(c);
}
