/* Several workers share a stage: a lock, and a condition to wait for the others. Any thread. */
#ifndef PUSH_GUARD_H
#define PUSH_GUARD_H

#include "grid.h"
#include "grid_stage.h"
#include "lock.h"

struct push_guard {
	struct lock lock;
	pthread_cond_t woken;
};

void push_guard_init(struct push_guard *);
void push_guard_free(struct push_guard *); /* destroys lock and condition */
/* The calls that the engine makes; valid as long as the guard. */
struct grid_guard push_guard_of(struct push_guard *);

static inline void push_guard_lock(struct push_guard *g)
{
	lock_take(&g->lock);
}

static inline void push_guard_unlock(struct push_guard *g)
{
	lock_give(&g->lock);
}

static inline void push_guard_wait(struct push_guard *g)
{
	lock_wait(&g->lock, &g->woken);
}

static inline void push_guard_wake(struct push_guard *g)
{
	pthread_cond_broadcast(&g->woken);
}

#endif
