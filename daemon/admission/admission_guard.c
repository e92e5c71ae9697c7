/*
 * The lock under which workers share a stage (admission_guard.h). It is held only while lists and offsets change, never while
 * points are read, sorted or merged.
 */
#include "admission_guard.h"

void admission_guard_init(struct admission_guard *g)
{
	lock_init(&g->lock, LOCK_STAGE);
	pthread_cond_init(&g->woken, NULL);
}

void admission_guard_free(struct admission_guard *g)
{
	lock_done(&g->lock);
	pthread_cond_destroy(&g->woken);
}

static void lock(void *g)
{
	admission_guard_lock(g);
}

static void unlock(void *g)
{
	admission_guard_unlock(g);
}

static void wait(void *g)
{
	admission_guard_wait(g);
}

static void wake(void *g)
{
	admission_guard_wake(g);
}

struct grid_guard admission_guard_of(struct admission_guard *g)
{
	return (struct grid_guard){.lock = lock, .unlock = unlock, .wait = wait, .wake = wake, .ctx = g};
}
