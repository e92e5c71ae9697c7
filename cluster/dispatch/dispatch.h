/*
 * Where the tasks of a run are executed: a table of schedulers with one interface.
 *
 * A run is a chain of phases, each with a fixed number of tasks that do not depend on each other. A task may begin when all tasks
 * of the phase before it are done. Only its record says that a task is done (`done`): a scheduler forgets, and a node that was
 * declared dead may still run. So a turn is always the same: ask the scheduler what it has (dispatch_look), and submit what has
 * no record and is not there (dispatch_submit). The first submission, one after a lost reply and a resume are all this turn.
 */
#ifndef DISPATCH_H
#define DISPATCH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;

enum { DISPATCH_REASONS = 6, DISPATCH_PHASES = 12 };
enum { DISPATCH_E_STOPPED = 1 }; /* dispatch_wait: options.stop */

struct dispatch_phase {
	const char *name; /* letters */
	uint32_t tasks;
	uint64_t memory; /* a task, bytes */
	double time;     /* a task, seconds: the scheduler ends it then; 0: an hour */
};

struct dispatch_options {
	const char *id;   /* of the run: its jobs are named acut-ID-PHASE */
	const char *work; /* the work folder, absolute; it has a folder log */
	const char *task; /* the program that an element runs, absolute: TASK WORK PHASE INDEX */
	const struct dispatch_phase *phase;
	unsigned nphase;
	unsigned most;                         /* tasks at once; 0: local: one a processor, if they fit into memory; slurm: any */
	unsigned attempts;                     /* of a task; 0: 3 */
	double poll;                           /* seconds between two questions to a scheduler; 0: 10 */
	double patience;                       /* seconds that a record may take to become visible here; 0: 120 */
	unsigned user;                         /* whose the run is: its tasks are looked for under this uid */
	const char *partition, *account, *qos; /* NULL: the scheduler's */
	const char *const *extra;              /* more options of the scheduler's command, a NULL ends them; NULL: none */
	const char *script;                    /* of "script": the file to write, absolute */

	void *ctx;
	bool (*done)(void *ctx, unsigned phase, uint32_t index); /* the task has a record */
	bool (*stop)(void *ctx);                                 /* a signal came; NULL: never */
	void (*changed)(void *ctx);                              /* after each look of dispatch_wait; NULL: nothing */
	void (*note)(void *ctx, const char *text);               /* NULL: nothing */
};

enum dispatch_state {
	DISPATCH_ABSENT,  /* the scheduler does not know it (any more) */
	DISPATCH_WAITING, /* for its turn, or for the phase before */
	DISPATCH_RUNNING,
	DISPATCH_ENDED, /* without a record, as far as can be seen */
};

/* Why an attempt of a task ended without a record. */
enum dispatch_why {
	DISPATCH_WHY_NONE, /* nothing failed that is known of */
	DISPATCH_WHY_NODE,
	DISPATCH_WHY_MEMORY,
	DISPATCH_WHY_TIME,
	DISPATCH_WHY_SIGNAL,
	DISPATCH_WHY_STATUS,
	DISPATCH_WHY_CANCELLED,
	DISPATCH_WHY_PREEMPTED,
	DISPATCH_WHY_DEPENDENCY, /* it has not begun: the scheduler dropped it with the phase before */
};
const char *dispatch_why_text(enum dispatch_why);

struct dispatch_task {
	uint8_t state, why;   /* enum dispatch_state, dispatch_why */
	uint8_t tries;        /* submissions by this process of attempts that could begin, or have begun */
	uint8_t memory, time; /* attempts of this process that had too little of it */
	bool hangs;           /* submitted to wait for the phase before, and not known to have begun */
	bool done, seen;      /* seen: submitted by this process, or once in the scheduler's list */
	int status;           /* with DISPATCH_WHY_STATUS and _SIGNAL: the exit status or signal; 0: unknown */
	uint32_t job;
	uint32_t begun, logged; /* attempts in its log before the last submission, and when it was read last */
	uint32_t missing_s;     /* second of this process in which it was found to be missing; 0: it was not */
};

struct dispatch;

/* The row of that name exists. */
bool dispatch_is_scheduler(const char *name);
/* Whether it can be used on this machine, for a work folder of that name. `script`: the file that "script" will write; NULL: one
 * in the folder. -ERR_NODAEMON, -ERR_USAGE, -ERR_CONFLICT. */
int dispatch_check(const char *scheduler, const char *work, const char *script, struct err *err);
/* "slurm", "local", "script". The texts of options are borrowed, phases are copied. -ERR_USAGE, -ERR_NOMEM. */
int dispatch_new(const char *scheduler, const struct dispatch_options *, struct dispatch **ret, struct err *err);
struct dispatch *dispatch_free(struct dispatch *); /* local: ends its tasks */

/* Reads records, and asks the scheduler what it has. -ERR_BUSY: it does not answer; the records were read all the same. */
int dispatch_look(struct dispatch *, struct err *err);
/* Submits what has no record and is not there, after a look. `patient`: not yet what may have a record that is not visible here.
 * A task that has failed too often, or in a way that repeats itself, fails this; so does, with `patient`, one that somebody has
 * cancelled: -ERR_CANCELLED. -ERR_BUSY: the scheduler takes no more now; the rest is for a later turn. */
int dispatch_submit(struct dispatch *, bool patient, struct err *err);
/* Until all tasks are done. DISPATCH_E_STOPPED. */
int dispatch_wait(struct dispatch *, struct err *err);
/* Removes all tasks that wait or run from the scheduler. */
int dispatch_cancel(struct dispatch *, uint32_t *ret_n, struct err *err);

const struct dispatch_task *dispatch_task(const struct dispatch *, unsigned phase, uint32_t index);
bool dispatch_all_done(const struct dispatch *);

struct dispatch_counts {
	uint32_t done, running, waiting, absent; /* absent: also those that ended */
};
struct dispatch_counts dispatch_counts(const struct dispatch *, unsigned phase);

/* What the scheduler says of waiting tasks, most frequent first. */
struct dispatch_reason {
	char text[48];
	uint32_t n;
};
const struct dispatch_reason *dispatch_reasons(const struct dispatch *, size_t *ret_n);
/* Numbers of the jobs that have waiting or running tasks, of all phases; sorted. To be freed by the caller. */
uint32_t *dispatch_jobs(const struct dispatch *, size_t *ret_n);
/* What holds the run up although nothing is wrong with it, and what mends it: a line each. `each` may not be NULL. */
void dispatch_troubles(struct dispatch *, void (*each)(void *ctx, const char *what, const char *command), void *ctx);

/* ---- logs ---- */

/* The log of a task: what its attempts have said. */
struct dispatch_log {
	unsigned begun;           /* attempts */
	bool ended;               /* the last of them */
	int status;               /* with which it ended; above 128: 128 and a signal */
	enum dispatch_why why;    /* of the last attempt that ended without a record, as far as the log tells */
	char host[64];            /* of that attempt; "" */
	enum dispatch_why before; /* of the attempt before the last one, and where */
	char host_before[64];
	int driver;     /* process that started the last one, of "local"; 0 */
	char tail[400]; /* its last lines; "": none */
};
/* False: there is none, or it cannot be read. */
bool dispatch_log_read(const struct dispatch *, unsigned phase, uint32_t index, struct dispatch_log *ret);

#endif
