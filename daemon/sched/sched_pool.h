/*
 * Tasks on worker threads, admitted under the memory budget. Knows no geometry and no jobs. (Not called sched.h: that is a header
 * of the C library.)
 *
 * A task names an account of the ledger and a number of bytes. They are taken when it starts, and then belong to its submitter,
 * who returns them by sched_give. Workers are shared by rank, then fairly between users, then between the flows of a user; within
 * a flow by priority, then in the order of submission (sched_queue.c). If the first task that needs memory cannot have it, no
 * later task that needs memory overtakes it; tasks without memory do. Functions belong to the loop thread unless they say "any
 * thread".
 */
#ifndef SCHED_POOL_H
#define SCHED_POOL_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "ledger.h"

struct err;
struct sched;

/* Order within a flow. SCHED_LAST: after all other tasks of all users, with idle memory only. */
enum sched_priority { SCHED_FIRST, SCHED_NORMAL, SCHED_LAST };
enum sched_rank { SCHED_RANK_NORMAL, SCHED_RANK_LOW, SCHED_RANK_HIGH };

/* The user and the flow that a task belongs to. */
struct sched_owner {
	uint32_t uid;
	enum sched_rank rank;
	uint64_t flow; /* one job, stream or push */
	bool exempt;   /* an administrator: has no quota (daemon/admission; the scheduler treats all users alike) */
};

/* State of a flow. */
struct sched_flow {
	unsigned running, waiting; /* tasks */
	uint64_t bytes;            /* that one of its tasks waits for; 0: none waits for memory */
};

/* A task is idle before sched_submit and from the call of its `done` on. */
enum sched_task_state { SCHED_TASK_IDLE, SCHED_TASK_WAITING, SCHED_TASK_RUNNING, SCHED_TASK_ENDED };

struct sched_task {
	void (*run)(struct sched_task *);  /* on a worker; not called for a task cancelled before it started */
	void (*done)(struct sched_task *); /* on the loop, once, in sched_dispatch; may free the task */
	struct sched_owner owner;
	enum sched_priority priority;
	bool lengthy; /* may take longer than a domain: if only such tasks run, spare threads run others */
	bool reads;   /* reads a client's file: while tasks of other users wait, one such task a user runs */
	enum ledger_name name;
	uint64_t bytes;     /* taken before run; 0: none */
	bool watched;       /* sched_watch: it counts `beats` */
	atomic_bool cancel; /* set by sched_cancel; long tasks poll it */
	atomic_uint beats;  /* calls that read its file and have returned */
	bool ran;           /* in done: run was called, and `bytes` are the submitter's */
	/* of the scheduler only */
	enum sched_task_state state;
	bool took;  /* its bytes, and done was not called */
	bool spare; /* it runs on a spare thread */
	bool held;  /* sched_hold */
	unsigned beats_seen;
	uint64_t seen_ns;             /* since when it has that many beats */
	uint64_t held_ns, nobodys_ns; /* since when it is held; how long it was held before */
	uint64_t order;
	int64_t charged;
	struct sched_account *account;
	struct sched_task *next;
};

/* Bytes that so many threads use beside the memory of their tasks: stacks, and small buffers of a task (64 KiB to read through).
 * The owner of the ledger charges them. */
uint64_t sched_thread_bytes(unsigned threads);
/* The ledger is borrowed. Starts the threads, and some spare ones. */
int sched_new(struct ledger *ledger, unsigned threads, struct sched **ret, struct err *err);
/* Cancels waiting tasks, waits for running ones, calls every `done`. NULL is fine; returns NULL. */
struct sched *sched_free(struct sched *);

void sched_submit(struct sched *, struct sched_task *); /* any thread */
/* A waiting task does not run; a running one finds task->cancel set. `done` is called in either case. */
void sched_cancel(struct sched *, struct sched_task *);

/* Readable if sched_dispatch has something to call. */
int sched_fd(const struct sched *);
/* Calls `done` of every task that has ended; returns how many. */
unsigned sched_dispatch(struct sched *);

/* The running tasks of the flow that read a file hang in a call that nothing can end. Other threads take the places of theirs, as
 * memory allows, for SCHED_HELD_EACH flows of a user and SCHED_HELD_MAX tasks in all. A thread whose place is taken ends with its
 * task. Meanwhile no further task that reads a file starts of such a flow, nor of a user with SCHED_HELD_EACH of them. Returns
 * how many of the flow have lost their place. */
enum { SCHED_HELD_EACH = 4, SCHED_HELD_MAX = 64 };
unsigned sched_hold(struct sched *, uint64_t flow);
/* The calls have returned: the tasks have their places again. A thread more than there are places ends when it has no task. */
void sched_release(struct sched *, uint64_t flow);
/* The same for all tasks that are watched, by their beats. */
#define SCHED_HOLD_SECONDS 5.0
void sched_watch(struct sched *, double seconds);
/* How many other flows of its user have lost a place. From SCHED_HELD_EACH on, a task that reads a file waits for them. */
unsigned sched_hanging(struct sched *, const struct sched_owner *);
/* Threads more than there are places. */
unsigned sched_extra_threads(struct sched *);

/* Bytes that the task has taken, until its `done` is called. */
uint64_t sched_taken(struct sched *, const struct sched_task *);
/* Returns bytes to the ledger, and starts what fits now. Any thread. */
void sched_give(struct sched *, enum ledger_name, uint64_t bytes);
/* The bytes that the first waiting task lacks; 0: none waits for memory. sched_fd becomes readable when this changes to another
 * value that is not 0. Any thread. */
uint64_t sched_starved(struct sched *);
/* Worker time that the user got, beyond that of the user who got the least; in nanoseconds. */
int64_t sched_service(struct sched *, uint32_t uid);
void sched_flow(struct sched *, uint64_t flow, struct sched_flow *ret);
unsigned sched_threads(const struct sched *);
/* A task of another flow waits, for whatever reason. Any thread. */
bool sched_others_wait(struct sched *, uint64_t flow);
/* Number of submitted tasks whose `done` was not called. */
unsigned sched_busy(struct sched *);

#endif
