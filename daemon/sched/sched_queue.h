/*
 * Which task is next: the order of the scheduler, without its threads. Not thread-safe; sched_pool.c holds its
 * lock over all of it, and a test drives it step by step.
 */
#ifndef SCHED_QUEUE_H
#define SCHED_QUEUE_H

#include "sched_pool.h"

struct sched_queue;

struct sched_queue *sched_queue_new(struct ledger *);       /* borrowed; NULL: no memory */
struct sched_queue *sched_queue_free(struct sched_queue *); /* NULL is fine; tasks are the submitters' */

void sched_queue_add(struct sched_queue *, struct sched_task *);
/* False: it does not wait here. */
bool sched_queue_remove(struct sched_queue *, struct sched_task *);
/* The next task that may start, with its memory; it runs until sched_queue_over. NULL: none may. `spare`: for
 * a thread beside those that only lengthy tasks keep busy; it takes what is not lengthy, and anything of a
 * user for whom nothing runs. */
struct sched_task *sched_queue_take(struct sched_queue *, bool spare);
/* It has run for so long. */
void sched_queue_over(struct sched_queue *, struct sched_task *, uint64_t ns);

/* NULL. A test of orders sets it: which of n tasks that may start now does, 0 to n - 1. Under the pool's lock. */
extern unsigned (*sched_queue_choice)(unsigned n);

bool sched_queue_empty(const struct sched_queue *);                      /* nothing waits */
bool sched_queue_others_wait(const struct sched_queue *, uint64_t flow); /* a task of another flow waits */
struct sched_task *sched_queue_first(const struct sched_queue *);        /* any that waits, NULL: none */
struct sched_task *sched_queue_running(const struct sched_queue *);      /* the first that runs; task->next */
/* Bytes of the task that has the next memory that comes free; 0: none waits for memory. */
uint64_t sched_queue_starved(const struct sched_queue *);
int64_t sched_queue_service(const struct sched_queue *, uint32_t uid);
void sched_queue_flow(const struct sched_queue *, uint64_t flow, struct sched_flow *ret);

#endif
