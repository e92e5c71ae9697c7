/*
 * Mutexes with a rank in one order (lock.def), so that threads cannot wait for each other in a circle. Each take asserts the
 * order against what the thread holds; functions that want a lock held say so with lock_held.
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
void lock_done(struct lock *); /* nobody holds it */

void lock_take(struct lock *);
bool lock_try(struct lock *); /* whatever is held: who does not wait is in no circle */
void lock_give(struct lock *);
/* Gives the lock, waits, takes it again. No other lock is held. */
void lock_wait(struct lock *, pthread_cond_t *);
/* Likewise, at most until then (clock_mono_ns). False: that time has come. */
bool lock_wait_until(struct lock *, pthread_cond_t *, uint64_t until_ns);
/* Whether this thread holds a lock of the rank. */
bool lock_held(enum lock_rank);

/* For locks that are no mutexes: the thread takes, or gives back, one of that rank. */
void lock_enter(enum lock_rank);
void lock_leave(enum lock_rank);

#endif
