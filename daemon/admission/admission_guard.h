/* Several workers share a stage: a lock, and a condition to wait for the others. Any thread. */
#ifndef ADMISSION_GUARD_H
#define ADMISSION_GUARD_H

#include "grid_stage.h"
#include "lock.h"

struct admission_guard {
	struct lock lock;
	pthread_cond_t woken;
};

void admission_guard_init(struct admission_guard *);
void admission_guard_free(struct admission_guard *); /* destroys lock and condition */
/* The calls that the engine makes; valid as long as the guard. */
struct grid_guard admission_guard_of(struct admission_guard *);

static inline void admission_guard_lock(struct admission_guard *g)
{
	lock_take(&g->lock);
}

static inline void admission_guard_unlock(struct admission_guard *g)
{
	lock_give(&g->lock);
}

static inline void admission_guard_wait(struct admission_guard *g)
{
	lock_wait(&g->lock, &g->woken);
}

static inline void admission_guard_wake(struct admission_guard *g)
{
	pthread_cond_broadcast(&g->woken);
}

#endif
