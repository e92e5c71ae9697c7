/*
 * The order of the scheduler, without its threads. Not thread-safe: sched_pool.c holds its lock in all calls. A test drives it
 * step by step.
 */
#ifndef SCHED_QUEUE_H
#define SCHED_QUEUE_H

#include "sched_pool.h"

struct sched_queue;

struct sched_queue *sched_queue_new(struct ledger *);       /* borrowed; NULL: no memory */
struct sched_queue *sched_queue_free(struct sched_queue *); /* NULL is fine; returns NULL; tasks are the submitters' */

void sched_queue_add(struct sched_queue *, struct sched_task *);
/* False: it does not wait in this queue. */
bool sched_queue_remove(struct sched_queue *, struct sched_task *);
/* The next task that may start, with its memory taken; it runs until sched_queue_over. NULL: none may start. `spare`: for a spare
 * thread, which takes tasks that are not lengthy, and any task of a user without a running one. */
struct sched_task *sched_queue_take(struct sched_queue *, bool spare);
/* The task has ended and ran for so long. */
void sched_queue_over(struct sched_queue *, struct sched_task *, uint64_t ns);

/* NULL, except in a test of orders: chooses which of n tasks that may start now starts, 0 to n - 1. Called under the pool's
 * lock. */
extern unsigned (*sched_queue_choice)(unsigned n);

bool sched_queue_empty(const struct sched_queue *);                      /* nothing waits */
bool sched_queue_others_wait(const struct sched_queue *, uint64_t flow); /* a task of another flow waits */
struct sched_task *sched_queue_first(const struct sched_queue *);        /* any waiting task; NULL: none */
struct sched_task *sched_queue_running(const struct sched_queue *);      /* the first that runs; task->next */
/* Tasks of this flow are held, or of SCHED_HELD_EACH flows of this user. */
bool sched_queue_hangs(const struct sched_queue *, const struct sched_owner *);
unsigned sched_queue_hanging(const struct sched_queue *, const struct sched_owner *); /* its user's other flows that are held */
/* Bytes of the task that has the claim on memory; 0: none waits for memory. */
uint64_t sched_queue_starved(const struct sched_queue *);
int64_t sched_queue_service(const struct sched_queue *, uint32_t uid);
void sched_queue_flow(const struct sched_queue *, uint64_t flow, struct sched_flow *ret);

#endif
