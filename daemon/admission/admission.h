/*
 * Admission: which run or push may hold how much of the memory, and when.
 *
 * The model: runs and pushes register here. A run seeks a slot and is granted one, with its share of the memory; a push waits for
 * the memory of its stage. What admission must know of a run or stage, or ask of it, is in a table of calls that its room gives.
 * Loop.
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

/* What a run has and needs now. */
struct admission_view {
	uint32_t uid;
	bool placed;     /* it has a slot */
	bool stalled;    /* it waits for its reader only */
	bool yields;     /* it is about to give its slot back */
	bool can_yield;  /* it can, and nothing waits for it with a slot in hand */
	uint64_t task;   /* bytes of its largest task: a domain, the selection, what it came back for; 0: not known */
	uint64_t points; /* emitted */
};
struct admission_run {
	struct admission_run *next;
	const struct admission_calls *calls;
};
struct admission_calls {
	struct admission_view (*view)(const struct admission_run *);
	uint64_t (*held)(const struct admission_run *); /* of its user's share: what it has, or may take without asking */
	bool (*opens)(const struct admission_run *, const struct dataset *); /* it is about to open the newest manifest of it */
	void (*relieve)(struct admission_run *, bool urgent);                /* others lack memory: give what can be given */
	void (*yield)(struct admission_run *);
};
/* From its beginning until it has ended. */
void admission_add_run(struct admission *, struct admission_run *);
void admission_remove_run(struct admission *, struct admission_run *); /* nothing if it is not there */
void admission_each_run(struct admission *, void (*fn)(struct admission_run *, void *), void *ctx);

/* Of the runs, of those that have slots. */
struct admission_tally {
	unsigned runs, running;    /* running: not stalled */
	unsigned own, own_running; /* of one user */
	uint64_t largest;          /* task of any of them */
};
struct admission_tally admission_tally(struct admission *, uint32_t uid);
bool admission_opening(struct admission *, const struct dataset *); /* some run is about to open its manifest */

/* ---- slots (slot.c): a job, stream or plan seeks one before it runs ---- */

enum slot_wait { SLOT_READY, SLOT_TURN, SLOT_USER, SLOT_SHARE, SLOT_FULL, SLOT_MEMORY };
struct slot {
	struct slot *next; /* of those that are sought, by number */
	struct sched_owner owner;
	bool reader;                    /* its run waits for a client that reads its output */
	void (*granted)(struct slot *); /* it is no longer sought: the run begins now */
	/* of slot.c */
	bool seeks, skip, seen, keeps;
	enum slot_wait wait;
	uint64_t number, need, lacks, free;
	unsigned passed, held;
	int64_t service;
};
/* Seeks a slot for a run whose tasks need so many bytes; 0: not known. Nothing if it seeks already. */
void slot_seek(struct admission *, struct slot *, uint64_t need);
void slot_leave(struct admission *, struct slot *); /* it is sought no longer */
void slots_settle(struct admission *);              /* grants what can be granted */
unsigned slots_sought(const struct admission *);
unsigned slot_position(const struct admission *, const struct slot *);                  /* 1: next; 0: it is not sought */
char *slot_text(const struct admission *, const struct slot *, char *buf, size_t size); /* what it waits for */

/* ---- memory of runs (admission.c) ---- */

enum { ADMISSION_OUTPUT = 64 << 10 }; /* buffer of a slow reader, in the share of a run */
/* What each run at work holds beside its tasks: a table of unfinished vertices, index pages, the buffer of a slow reader. */
uint64_t admission_share(const struct admission *);
uint64_t admission_emitter_share(const struct admission *);
uint64_t admission_index_share(const struct admission *);
uint64_t admission_domain_memory(struct admission *);  /* that a plan may count on now */
uint64_t admission_domain_largest(struct admission *); /* task of the runs that have slots */
uint64_t admission_alone(const struct admission *);    /* what the tasks of the only run can have */
bool admission_only(struct admission *);               /* at most one run has a slot, and nothing is staged */
uint64_t admission_least(void);                        /* what the smallest plan needs */
/* The smallest `memory` whose domains carry that many positions; 0: none does. */
uint64_t admission_memory_for(struct admission *, const struct grid *, uint64_t positions);
/* -ERR_LIMIT if a task of so many bytes could never start, with the memory that would do. */
int admission_never(struct admission *, uint64_t bytes, const char *what, struct err *err);
void admission_relieve(struct admission *);       /* asks runs for memory if the first task in the queue lacks some */
bool admission_awaited(const struct admission *); /* somebody waits for memory: a run, a stage, the first task in the queue */

/* ---- stages of pushes (stage.c) ---- */

struct admission_stage {
	struct admission_stage *next;
	const struct admission_stage_calls *calls;
	uint32_t uid;
};
struct admission_stage_calls {
	uint64_t (*bytes)(const struct admission_stage *); /* of the stage, and of what the push keeps of its files */
	uint64_t (*held)(const struct admission_stage *);  /* of its user's share, with the stage; 0 without */
	bool (*wants)(const struct admission_stage *);     /* it waits for a stage */
	bool (*fits)(const struct admission_stage *);      /* into its user's share */
	void (*retry)(struct admission_stage *);           /* asks again; may remove it */
};
void admission_add_stage(struct admission *, struct admission_stage *);
void admission_remove_stage(struct admission *, struct admission_stage *);
uint64_t admission_staged(const struct admission *);               /* held by stages, merges and prunes */
uint64_t admission_stage_share(const struct admission *);          /* all that stages may hold */
uint64_t admission_stage_room(struct admission *, uint64_t least); /* what a stage may have now; 0: less than `least` */
void admission_rewriting(struct admission *, int64_t bytes);       /* merge and prune hold so much more (negative: less) */
void admission_stages(struct admission *);                         /* the next that waits for a stage asks again */
bool admission_stage_waits(const struct admission *);              /* somebody waits for a stage */
bool admission_stage_other(const struct admission *, const struct admission_stage *); /* somebody else is next for one */
bool admission_stage_awaited(const struct admission *, uint32_t uid);                 /* by another user who has none */

/* ---- the share of one user (user.c), user-memory ---- */

/* Memory that the jobs, pushes and plans of that user may hold; UINT64_MAX: no limit. */
uint64_t admission_user_limit(const struct admission *, const struct sched_owner *);
/* By runs and stages of that user, but for one run. */
uint64_t admission_user_held(struct admission *, uint32_t uid, const struct admission_run *but);
/* What is left of it; for tasks of a run that has its slot, `but` is that run. */
uint64_t admission_user_room(struct admission *, const struct sched_owner *, const struct admission_run *but);
/* -ERR_LIMIT if so much could never be had. */
int admission_user_never(struct admission *, const struct sched_owner *, uint64_t bytes, const char *what, struct err *err);

#endif
