/*
 * Where idle workers wake. As many threads as there are processors are to run side by side, but the kernel puts a thread that wakes
 * behind another if all processors look busy at that instant (the one that wakes it runs somewhere, too), and may leave the two
 * there for tens of milliseconds beside an idle processor: as long as it takes to make several domains. So a worker sleeps with a
 * processor of its own, wakes there, and is free to go anywhere while it works.
 */
#ifndef SCHED_HOME_H
#define SCHED_HOME_H

#include <sched.h>
#include <stdbool.h>

struct sched_homes;

/* Of so many workers, the first of which is 0. NULL: no memory. */
struct sched_homes *sched_homes_new(unsigned workers);
struct sched_homes *sched_homes_free(struct sched_homes *); /* NULL is fine; returns NULL */

/* The processors of a worker while it sleeps. */
struct sched_home {
	cpu_set_t away, home;
	bool bound;
};

/*
 * The worker is about to sleep, or to work. Both by the thread itself, not under a lock: they may wait for the kernel. The processors that
 * it may use are those it had before, unless somebody gave it others meanwhile. Where there are fewer workers than processors,
 * or the kernel refuses, nothing is done. Thread-safe.
 */
void sched_home_go(struct sched_homes *, unsigned worker, struct sched_home *);
void sched_home_leave(struct sched_homes *, unsigned worker, struct sched_home *);
/* Of sched_home_go, without the kernel: the worker falls asleep where the processor has this rank; the rank of its home. */
unsigned sched_homes_settle(struct sched_homes *, unsigned worker, unsigned here);

#endif
