/*
 * Admission: which run or push may hold how much of the memory, and when.
 *
 * The model: runs and pushes register here. A run requests a slot, which includes its share of the memory. A push waits for the
 * memory of its stage. A run or push gives a table of calls, by which admission reads its state and asks it to release memory.
 * All functions belong to the loop thread. Amounts are bytes.
 */
#ifndef ADMISSION_H
#define ADMISSION_H

#include "core.h"

struct admission;
struct dataset;
struct grid;

int admission_new(struct core *, struct admission **ret, struct err *err);
struct admission *admission_free(struct admission *); /* NULL is fine; returns NULL */

/* ---- runs ---- */

/* State of a run, as admission sees it. */
struct admission_view {
	uint32_t uid;
	bool has_slot;
	bool stalled;        /* it waits for its reader only */
	bool yielding;       /* it is about to release its slot */
	bool can_yield;      /* it can, and nothing that holds a slot waits for it */
	uint64_t task_bytes; /* of its largest task: a domain or a selection, or what it needs to start again; 0: not known */
	uint64_t points;     /* emitted */
};
struct admission_run {
	struct admission_run *next;
	const struct admission_calls *calls;
};
struct admission_calls {
	struct admission_view (*view)(const struct admission_run *);
	uint64_t (*held)(const struct admission_run *); /* of its user's share: what it has, or may take without asking */
	/* True: it is about to open the newest manifest of that dataset. */
	bool (*opens)(const struct admission_run *, const struct dataset *);
	void (*relieve)(struct admission_run *, bool urgent); /* others lack memory: release what it can */
	void (*yield)(struct admission_run *);                /* release the slot, and start again later */
};
/* Adds a run when it begins, and removes it at its end. Borrowed in between. */
void admission_add_run(struct admission *, struct admission_run *);
void admission_remove_run(struct admission *, struct admission_run *); /* no effect if it was not added */
/* `fn` may remove the run that it is called with. */
void admission_each_run(struct admission *, void (*fn)(struct admission_run *, void *), void *ctx);

/* Counts of the runs with slots. */
struct admission_tally {
	unsigned runs, running;    /* running: not stalled */
	unsigned own, own_running; /* of one user */
	uint64_t largest;          /* task_bytes of any of them */
};
struct admission_tally admission_tally(struct admission *, uint32_t uid);
bool admission_opens(struct admission *, const struct dataset *); /* `opens` of any run */

/* ---- slots (slot.c) ---- */

/* What a requested slot waits for. */
enum slot_wait {
	SLOT_READY,
	SLOT_QUEUED,      /* for its place in the queue */
	SLOT_USER,        /* its user has as many runs as one user may have */
	SLOT_USER_MEMORY, /* its user's share of the memory is used up */
	SLOT_FULL,        /* all slots are in use */
	SLOT_MEMORY,      /* for free memory */
};
/* Embedded in a job, stream or plan, which fills in the first part. */
struct slot {
	struct sched_owner owner;
	bool reader;                    /* its run waits for a client that reads its output */
	void (*granted)(struct slot *); /* the request is fulfilled: begin the run now */
	/* of slot.c */
	struct slot *next; /* of the requests, by number */
	bool requested, skip, seen;
	bool keeps; /* memory is kept free beside it */
	enum slot_wait wait;
	uint64_t number;       /* age of the request */
	uint64_t need;         /* of its largest task */
	uint64_t needed, free; /* of the last attempt, for slot_wait_text */
	unsigned passed;       /* grants to others while it waited for memory */
	unsigned held;         /* running runs of its user */
	int64_t service;       /* of its user (sched_service) */
};
/* Requests a slot for a run whose largest task takes `need`; 0: not known. No effect if it is requested already. A slot that was
 * granted and is requested again keeps its age. */
void slot_request(struct admission *, struct slot *, uint64_t need);
void slot_withdraw(struct admission *, struct slot *); /* no effect if it is not requested */
void slots_grant(struct admission *);                  /* grants what can be granted */
unsigned slots_requested(const struct admission *);
/* 1: next; 0: it is not requested. */
unsigned slot_position(const struct admission *, const struct slot *);
/* What it waits for, as a phrase. Returns buf. */
char *slot_wait_text(const struct admission *, const struct slot *, char *buf, size_t size);

/* ---- memory of runs (admission.c) ---- */

enum { ADMISSION_OUTPUT = 64 << 10 }; /* buffer of a slow reader; part of the share of a run */
/* What each run with a slot holds beside its tasks: a table of unfinished vertices, index pages, the buffer of a slow reader. */
uint64_t admission_share(const struct admission *);
uint64_t admission_emitter_share(const struct admission *);
uint64_t admission_index_share(const struct admission *);
uint64_t admission_domain_memory(struct admission *);     /* for the tasks of runs, as it is now */
uint64_t admission_domain_largest(struct admission *);    /* the largest task of the runs with slots */
uint64_t admission_alone_bytes(const struct admission *); /* for the tasks of a run that is the only one */
bool admission_is_alone(struct admission *);              /* at most one run has a slot, and nothing is staged */
uint64_t admission_plan_min(void);                        /* for the smallest plan */
/* The smallest setting `memory` whose domains hold that many positions; 0: none does. */
uint64_t admission_memory_for(struct admission *, const struct grid *, uint64_t positions);
/* -ERR_LIMIT, with the sufficient setting, if a task of that size could never start. `what` is a noun for the message. */
int admission_check_size(struct admission *, uint64_t bytes, const char *what, struct err *err);
void admission_relieve(struct admission *); /* asks runs for memory if the first task in the queue lacks some */
/* True: a run, a stage, or the first task in the queue waits for memory. */
bool admission_memory_is_awaited(const struct admission *);

/* ---- stages of pushes (stage.c) ---- */

struct admission_stage {
	struct admission_stage *next;
	const struct admission_stage_calls *calls;
	uint32_t uid;
};
struct admission_stage_calls {
	uint64_t (*bytes)(const struct admission_stage *); /* of the stage, and of what the push keeps of its files */
	uint64_t (*held)(const struct admission_stage *);  /* of its user's share, if it has a stage; otherwise 0 */
	bool (*wants)(const struct admission_stage *);     /* it waits for a stage */
	bool (*fits)(const struct admission_stage *);      /* its stage fits its user's share */
	void (*retry)(struct admission_stage *);           /* it may take a stage now; may remove it */
};
void admission_add_stage(struct admission *, struct admission_stage *);
void admission_remove_stage(struct admission *, struct admission_stage *);
uint64_t admission_staged_bytes(const struct admission *);              /* of all stages, merges and prunes */
uint64_t admission_stage_share(const struct admission *);               /* the most that all stages together may have */
uint64_t admission_stage_available(struct admission *, uint64_t least); /* for one stage now; 0: less than `least` */
void admission_add_rewrite(struct admission *, int64_t bytes);          /* of a merge or prune; negative: released */
void admission_grant_stages(struct admission *);                        /* lets the next one that waits try again */
bool admission_stage_is_awaited(const struct admission *);
/* A push other than this one is next for a stage. */
bool admission_stage_other_is_next(const struct admission *, const struct admission_stage *);
/* The next one is of another user, who has no stage. */
bool admission_stage_other_needs(const struct admission *, uint32_t uid);

/* ---- the share of one user (user.c), user-memory ---- */

/* For the jobs, pushes and plans of that user; UINT64_MAX: no limit. */
uint64_t admission_user_limit(const struct admission *, const struct sched_owner *);
/* By runs and stages of that user, except one run. */
uint64_t admission_user_held(struct admission *, uint32_t uid, const struct admission_run *except);
/* What is left of the limit. For tasks of a run that has its slot, `except` is that run. */
uint64_t admission_user_available(struct admission *, const struct sched_owner *, const struct admission_run *except);
/* -ERR_LIMIT, with the sufficient setting, if so much is beyond the limit. `what` is a noun for the message. */
int admission_user_check_size(struct admission *, const struct sched_owner *, uint64_t bytes, const char *what, struct err *err);
/* A run with a slot needs a task of `least` bytes, and `left` are left, which is less: 0 if waiting may help; else -ERR_LIMIT,
 * because it is beyond what domains or the user may ever have, or because the service itself holds the rest. */
int admission_lacks(struct admission *, const struct sched_owner *, uint64_t least, uint64_t left, const char *what,
		    struct err *err);

#endif
