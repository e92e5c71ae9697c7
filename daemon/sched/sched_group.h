/* A task group: one task, and helpers that take steps of the same work on idle threads. */
#ifndef SCHED_GROUP_H
#define SCHED_GROUP_H

#include <stdbool.h>

#include "sched_pool.h"

struct err;
struct sched_group;

/* The task must have no `bytes`: helpers may run before it starts, and do not wait for memory. */
struct sched_group_params {
	struct sched *sched;
	struct sched_owner owner;
	unsigned members; /* the task, which is member 0, and its helpers */
	/* Workers, concurrently: takes one step of the work. False: no step is left to begin. */
	bool (*step)(void *ctx, unsigned member);
	/* Loop, once, after sched_group_end: no member runs any more, and the group may be freed. */
	void (*over)(void *ctx);
	void *ctx;
};

/* Any thread. */
int sched_group_new(const struct sched_group_params *, struct sched_group **ret, struct err *err);
struct sched_group *sched_group_free(struct sched_group *); /* NULL is fine; returns NULL */
/* Loop: submits the helpers. The task need not have started. */
void sched_group_start(struct sched_group *);
/* Worker, once, in the task: takes all steps. No step runs after it returns. */
void sched_group_run(struct sched_group *);
/* Loop: in `done` of the task, whether the task ran or not. */
void sched_group_end(struct sched_group *);

#endif
