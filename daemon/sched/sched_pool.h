/*
 * Tasks on worker threads, admitted under the budget. Knows no geometry and no jobs.
 * (Not called sched.h: that is a header of the C library.)
 *
 * A task says which ledger name it takes and how many bytes; they are taken when it starts and belong to
 * whoever submitted it from then on (given back with sched_give). Workers are shared by rank, then fairly by
 * users, then by the flows of a user; in a flow by priority, then in the order of submission (sched_queue.c).
 * Where the first task that needs memory cannot have it, no later one that needs memory overtakes it; tasks
 * that need none do. All calls are for the loop thread, except those said to be for workers.
 */
#ifndef SCHED_POOL_H
#define SCHED_POOL_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "ledger.h"

struct err;
struct sched;

/* In a flow: small numbers first. SCHED_LAST: after everything of everybody, on what is left over. */
enum sched_priority { SCHED_FIRST, SCHED_NORMAL, SCHED_LAST };
enum sched_rank { SCHED_RANK_NORMAL, SCHED_RANK_LOW, SCHED_RANK_HIGH };

/* For whom a task runs. */
struct sched_owner {
	uint32_t uid;
	enum sched_rank rank;
	uint64_t flow; /* one job, stream or push */
	bool exempt;   /* an admin: no limit of users holds it (daemon/admission; the scheduler serves all alike) */
};

/* What a flow does now. */
struct sched_flow {
	unsigned running, waiting; /* tasks */
	uint64_t bytes;            /* that one of them waits for; 0: not for memory */
};

struct sched_task {
	void (*run)(struct sched_task *);  /* on a worker; not called for a task cancelled before it started */
	void (*done)(struct sched_task *); /* on the loop, once, from sched_dispatch; may free the task */
	struct sched_owner owner;
	enum sched_priority priority;
	bool lengthy; /* may take longer than a domain: while only such run, others get a thread beside them */
	bool reads;   /* a client's file: one worker a user while others wait */
	enum ledger_name name;
	uint64_t bytes;     /* taken before run; 0: none */
	atomic_bool cancel; /* workers look at it; set by sched_cancel */
	bool ran;           /* in done: run was called, and `bytes` are the submitter's */
	/* of sched only */
	bool took; /* its bytes, and done was not called */
	uint64_t order;
	int64_t charged;
	struct sched_account *account;
	struct sched_task *next;
};

/* What so many threads have beside what their tasks take: stacks, and small buffers of a task (64 KiB to read through).
 * For whoever makes the ledger to charge. */
uint64_t sched_thread_bytes(unsigned threads);
/* `ledger` is borrowed. Starts `threads` threads. */
int sched_new(struct ledger *ledger, unsigned threads, struct sched **ret, struct err *err);
/* Cancels what has not started, waits for what runs, calls every done. NULL is fine; returns NULL. */
struct sched *sched_free(struct sched *);

void sched_submit(struct sched *, struct sched_task *);
/* A waiting task will not run; a running one finds task->cancel set. done comes in any case. */
void sched_cancel(struct sched *, struct sched_task *);

/* Readable when something is to be dispatched. */
int sched_fd(const struct sched *);
/* Calls the done of every task that is over; returns how many. */
unsigned sched_dispatch(struct sched *);

/* Bytes that the task has taken and that its `done` has not heard of yet. */
uint64_t sched_taken(struct sched *, const struct sched_task *);
/* Gives bytes back to the ledger and starts what fits now. Any thread. */
void sched_give(struct sched *, enum ledger_name, uint64_t bytes);
/* The bytes that the first waiting task lacks memory for; 0 if none waits for memory. Any thread. Any change of the
 * answer to non-zero makes sched_fd readable. */
uint64_t sched_starved(struct sched *);
/* What the user was served beyond who was served least, in nanoseconds of workers. */
int64_t sched_service(struct sched *, uint32_t uid);
void sched_flow(struct sched *, uint64_t flow, struct sched_flow *ret);
unsigned sched_threads(const struct sched *);
/* Some task of another flow is not begun, for whatever reason. Any thread. */
bool sched_others_wait(struct sched *, uint64_t flow);
/* Tasks submitted whose done has not been called. */
unsigned sched_busy(struct sched *);

#endif
