/* Several workers at one piece of work: the task that it is the work of, and helpers where threads are idle. */
#ifndef CREW_H
#define CREW_H

#include <stdbool.h>

#include "sched_pool.h"

struct crew;
struct err;

/* The task must be one that takes no bytes of the scheduler's: helpers may be at work before it, and wait for nobody. */
struct crew_params {
	struct sched *sched;
	struct sched_owner owner;
	unsigned members; /* with the task, number 0 */
	/* Worker, several at once: some of it. False: there is nothing left to begin. */
	bool (*step)(void *ctx, unsigned member);
	/* Loop, once, after crew_end: nobody is at it any more, and the crew may be freed. */
	void (*over)(void *ctx);
	void *ctx;
};

/* Any thread. */
int crew_new(const struct crew_params *, struct crew **ret, struct err *err);
struct crew *crew_free(struct crew *); /* NULL is fine; returns NULL */
/* Loop: helpers may come from now on, whether the task has begun or not. */
void crew_start(struct crew *);
/* Worker, once, in the task: all steps. When it returns no step runs, and none will. */
void crew_work(struct crew *);
/* Loop: the task is done, whether it ran or not. */
void crew_end(struct crew *);

#endif
