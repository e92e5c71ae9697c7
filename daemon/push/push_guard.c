/*
 * The lock under which workers share a stage (push_guard.h). It is held only while lists and offsets change, never while points
 * are read, sorted or merged.
 */
#include "push_guard.h"

void push_guard_init(struct push_guard *g)
{
	lock_init(&g->lock, LOCK_STAGE);
	pthread_cond_init(&g->woken, NULL);
}

void push_guard_free(struct push_guard *g)
{
	lock_done(&g->lock);
	pthread_cond_destroy(&g->woken);
}

static void lock(void *g)
{
	push_guard_lock(g);
}

static void unlock(void *g)
{
	push_guard_unlock(g);
}

static void wait(void *g)
{
	push_guard_wait(g);
}

static void wake(void *g)
{
	push_guard_wake(g);
}

struct grid_guard push_guard_of(struct push_guard *g)
{
	return (struct grid_guard){.lock = lock, .unlock = unlock, .wait = wait, .wake = wake, .ctx = g};
}
