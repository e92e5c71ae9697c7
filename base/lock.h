/*
 * Mutexes with ranks in one order (lock.def), so that threads cannot deadlock. Each lock_take asserts the order against
 * the locks that the thread holds. Functions that require a lock assert lock_held.
 */
#ifndef LOCK_H
#define LOCK_H

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

enum lock_rank {
#define LOCK_ROW(name, guards) LOCK_##name,
#include "lock.def"
#undef LOCK_ROW
	LOCK_RANKS
};

struct lock {
	pthread_mutex_t mutex;
	enum lock_rank rank;
};

/* For file scope. */
#define LOCK_STATIC(name)                                               \
	{                                                               \
		.mutex = PTHREAD_MUTEX_INITIALIZER, .rank = LOCK_##name \
	}
void lock_init(struct lock *, enum lock_rank);
void lock_done(struct lock *); /* asserts that nobody holds it */

void lock_take(struct lock *);
bool lock_try(struct lock *); /* whatever the thread holds: a thread that does not wait cannot deadlock */
void lock_give(struct lock *);
/* Releases the lock, waits, takes it again. The thread holds no other lock. */
void lock_wait(struct lock *, pthread_cond_t *);
/* The same, at most until then (clock_mono_ns). False: that time was reached. */
bool lock_wait_until(struct lock *, pthread_cond_t *, uint64_t until_ns);
/* Whether this thread holds a lock of the rank. */
bool lock_held(enum lock_rank);

/* For locks that are not mutexes: records that the thread takes or releases one of that rank. */
void lock_enter(enum lock_rank);
void lock_leave(enum lock_rank);

#endif
