/*
 * The locks of a thread are a bit set, with one bit for each rank. A lock may be taken if no bit of its rank or of a
 * later one is set.
 *
 * Release builds keep the assertions (acut is built without NDEBUG): they cost a few instructions, and a daemon that
 * hangs is worse than one that restarts.
 */
#include "lock.h"

#include <assert.h>
#include <errno.h>

static _Thread_local uint32_t held;
_Static_assert(LOCK_RANKS <= 32, "a bit a rank");

void lock_enter(enum lock_rank rank)
{
	assert(held >> rank == 0);
	held |= UINT32_C(1) << rank;
}

void lock_leave(enum lock_rank rank)
{
	assert(lock_held(rank));
	held &= ~(UINT32_C(1) << rank);
}

bool lock_held(enum lock_rank rank)
{
	return held >> rank & 1;
}

void lock_init(struct lock *l, enum lock_rank rank)
{
	l->rank = rank;
	pthread_mutex_init(&l->mutex, NULL);
}

void lock_done(struct lock *l)
{
	pthread_mutex_destroy(&l->mutex);
}

void lock_take(struct lock *l)
{
	lock_enter(l->rank); /* before waiting: a wrong order is found even if there is only one thread */
	pthread_mutex_lock(&l->mutex);
}

bool lock_try(struct lock *l)
{
	assert(!lock_held(l->rank));
	if (pthread_mutex_trylock(&l->mutex))
		return false;
	held |= UINT32_C(1) << l->rank;
	return true;
}

void lock_give(struct lock *l)
{
	lock_leave(l->rank);
	pthread_mutex_unlock(&l->mutex);
}

void lock_wait(struct lock *l, pthread_cond_t *cond)
{
	assert(held == UINT32_C(1) << l->rank);
	pthread_cond_wait(cond, &l->mutex);
}

bool lock_wait_until(struct lock *l, pthread_cond_t *cond, uint64_t until_ns)
{
	struct timespec until = {(time_t)(until_ns / 1000000000), (long)(until_ns % 1000000000)};

	assert(held == UINT32_C(1) << l->rank);
	return pthread_cond_clockwait(cond, &l->mutex, CLOCK_MONOTONIC, &until) != ETIMEDOUT;
}
