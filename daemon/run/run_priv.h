/* The insides of a run, shared by run.c (the loop's side), run_domain.c (tasks) and run_output.c. */
#ifndef RUN_PRIV_H
#define RUN_PRIV_H

#include <stdatomic.h>

#include "admission.h"
#include "dataset.h"
#include "plan_file.h"
#include "run.h"
#include "sched_group.h"
#include "selection.h"

struct runs {
	struct core *core;
	struct admission *admission;
	struct recency *recency,
		*summaries; /* of stored domains: struct store_id, struct pipe_summary; any thread; NULL: no memory */
	uint64_t last_select;
};

enum run_domain_state {
	DOMAIN_MAKING,   /* a task makes or loads it */
	DOMAIN_SPLIT,    /* waits to be split, or is */
	DOMAIN_READY,    /* in memory, not emitted */
	DOMAIN_STORING,  /* a task stores it, to free its memory */
	DOMAIN_EMITTING, /* a task emits it */
	DOMAIN_SENDING,  /* its block is being written */
};

/* One domain between its start and its last byte. Those before run.next_start that are neither emitted nor
 * here are in the store (or lost, and then made again). */
struct run_domain {
	struct sched_task task;
	struct run *run;
	struct run_domain *next; /* by index */
	enum run_domain_state state;
	size_t index;
	struct cut_region region;
	const struct cut_sites *sites; /* of the plan, if its halo is in them */
	uint64_t count;                /* positions that it owns at most, as the plan knows */
	struct mesh_domain domain;
	void *memory;
	size_t size; /* mapped, and charged to LEDGER_DOMAIN: for it, or as one of the run's arenas while it is lent that */
	bool huge;   /* memory that it maps is to be in huge pages */
	bool lent, put, bare; /* run_arena.c: has one that was there; gave it back; found none */
	size_t held;          /* of it, what the result needs */
	bool stored, unstorable;
	bool front; /* only what later blocks are numbered by is asked for: `domain.triangle` is NULL if it came from the store */
	bool made;  /* not from the store */
	bool looked, changed, flat; /* as its leaf's, when the plan was made */
	struct pipe_stored as;      /* if `stored` */
	bool block;                 /* its emission gave one */
	uint64_t need;
	int r;
	struct err err;
};

/* run_change.c: what a run with `since` leaves out, and what it says before the blocks. */
struct run_change {
	struct run_changes told;
	struct run_region *region; /* gone */
	struct digest gone;        /* sum of theirs */
	struct digest id;          /* of all that decides which blocks come */
	uint8_t *skip;             /* by leaf: it holds in both meshes, or is empty */
	uint64_t charged;          /* of LEDGER_PLAN */
};

/* Any thread. What log_event is told. */
#define ABOUT_RUN(w)                \
	(&(const struct log_about){ \
		.job = (w)->job, .dataset = (w)->dataset->name, .generation = (w)->generation, ABOUT_USER((w)->owner.uid)})

struct run {
	struct admission_run admission;
	uint64_t job; /* 0: none */
	struct runs *runs;
	struct dataset *dataset;
	uint64_t generation;
	struct view view; /* as asked for */
	struct view rest; /* what of it applies to `grid`; shares its area */
	char *view_text;
	size_t charged; /* of LEDGER_JOBS */
	char manifest[64];
	bool keep, plan_only, lazy, client;
	struct sched_owner owner; /* of all its tasks */
	struct slot *slot;
	bool placed;            /* has its place, which is its share of the memory */
	bool giving;            /* stops to begin again later */
	uint64_t points_before; /* emitted before it yielded */
	double patience;
	const struct run_since *since;
	struct run_change *change;
	const struct run_calls *calls;
	void *ctx;

	enum {
		RUN_NEW,
		RUN_OPENING,
		RUN_UNSELECTED,
		RUN_SELECTING,
		RUN_OPEN,
		RUN_PLANNING,
		RUN_RUNNING,
		RUN_FINISHING,
		RUN_OVER
	} state;
	struct sched_task task; /* of opening, selecting, planning, finishing */
	bool task_busy;
	int r;
	struct err err;

	bool opened;       /* the dataset's folder */
	struct grid *grid; /* of the generation; of a view that selects, then of its selection */
	struct run_select {
		struct digest key;
		uint64_t number; /* of the temporary folder */
		uint64_t bytes;  /* that the task takes */
		bool open;       /* `grid` is of the selection */
		atomic_uint_fast64_t judged;
		uint64_t told, total; /* points of the generation */
		struct selection_counts counts;
	} select;
	uint64_t ground, other; /* run_classes */
	bool classes_exact;     /* of ground and other; else there are at least so many */
	bool unclassified;      /* no point of the generation is of a class of the ground */
	uint64_t emitter_bytes; /* charged */
	struct pipe_emitter *emitter;
	struct pipe_budget budget;
	struct pipe_key key;    /* of its domains; known with `grid` */
	struct cut_plan plan;   /* a worker's while `splitting` */
	struct plan_file *file; /* where it is kept; NULL: nowhere */
	struct plan_kept kept;
	bool planned; /* it was read from there */
	size_t splits_seen;
	/* While it is made: of its task, and then of several that look at what is stored of it. */
	struct run_planning {
		void *memory;
		uint64_t bytes; /* of LEDGER_DOMAIN */
		uint64_t held;  /* the same, for the loop, when its first task is done */
		bool ran;
		struct mesh_counts empty;
		struct pipe_refine *refine;
		unsigned members;            /* that share the memory */
		struct grid_reader **reader; /* theirs, as far as they have begun */
		struct sched_group *group;
		unsigned damaged; /* with the next, and `there`, any thread's, under the lock of run_plan.c */
		struct err err;   /* of whoever failed first */
	} planning;
	struct run_domain *splitting;

	struct run_domain *domains;
	unsigned ndomains, tasks; /* tasks: of domains and output, not over */
	size_t next_start, next_emit;
	/*
	 * Nobody will read what it emits: of each domain only the sums are asked for, as soon as they are known. Leaves that are
	 * `there` in the plan were emitted when it was made; what it makes goes to the store, and its memory to the next.
	 */
	bool sums;
	struct run_there {
		struct plan_done *done; /* to be noted in the plan, by the task that makes it */
		size_t n, room;
		uint64_t points, charged;
		int64_t looked_ns; /* when, of the clock that files have */
		size_t leaves;
		bool triangles;
	} there;
	struct run_arenas {
		struct arena *free; /* any thread, under the lock of run_arena.c */
		unsigned owned;     /* that are there, or will be when who brings one runs */
		uint64_t charged;   /* of LEDGER_DOMAIN: for those that are no domain's own any more */
	} arenas;
	size_t made;     /* domains that were triangulated, some perhaps more than once */
	size_t reusable; /* of one that plans only: domains that are in the store */
	size_t plan_n;   /* plan.n, for whoever asks while a worker has the plan */
	struct run_domain *emitting, *sending;

	struct run_output *output;
	struct sched_task output_task;
	bool output_head, output_busy, output_working; /* head sent; a block is not all written; a worker has it */
	bool output_refilling, output_buffer;
	bool output_spooling;
	void (*output_freed)(struct run_output *);
	uint64_t spool_failed_ns;
	uint64_t sending_ns; /* since when the block is sent */
	uint64_t blocks;     /* emitted */

	struct run_pace {
		uint64_t looked_ns, seen; /* when last, and points then */
		double worked;            /* seconds */
		double points, seconds;   /* of late: what is long ago counts little */
	} pace;
	struct run_space {        /* run_space.c */
		bool waits, over; /* gave its place back for want of space; will not again */
		bool holds;       /* its selection */
		atomic_bool told; /* that domains are not stored */
		unsigned vanished;
		uint64_t need, lacks; /* bytes that it asked for; of these, what is lacking: 0, it waits for the cache */
		double wait;          /* seconds to the next look */
		uint64_t since_ns, looked_ns, resumed_ns;
		atomic_uint_fast64_t asked;
		uint64_t spilled, spooled, selecting; /* taken */
		struct err why;
	} space;
	struct digest head_id; /* of the stream that its output was told */
	uint64_t opened_ns, started_ns, first_ns, stopped_ns;
	uint64_t points, grid_total; /* emitted; in the generation */
	bool stopping;
	struct err why;
	struct pipe_totals totals;
};

extern unsigned run_domains_most; /* in the list of a run at one time; only a test sets it */

void run_fail(struct run *, const struct err *why);
void run_start(struct run *);
void run_shut(struct run *); /* all that it holds for long goes back */
/* run_yield.c: its place goes back until `need` is there for its plan; no task of it may be busy. */
void run_retreat(struct run *, uint64_t need);
/* run_admission.c */
extern const struct admission_calls run_admission_calls;
bool run_may_start(const struct run *);          /* one more domain, beside those that it has: its user's share allows it */
bool run_selected_elsewhere(const struct run *); /* another run makes this one's selection */
bool run_stalled(const struct run *);            /* waits for its reader only */
/* Others lack memory: gives what can be given. Not urgent: unless it comes back by itself soon. */
void run_relieve(struct run *, bool urgent);
bool run_can_yield(const struct run *);
void run_yield(struct run *);
bool run_yielded(struct run *); /* it stopped for that: it seeks a place again, and is not over */

/* run_plan.c */
int run_plan_read(struct run *, struct err *err); /* worker */
void run_plan_start(struct run *);
void run_plan_follow(struct run *);   /* what the run that it follows has split */
size_t run_reach(const struct run *); /* domains before this one may be started now */

/* run_area.c */
void run_area_id(const struct run *, struct digest *id); /* what else the blocks of a window depend on */
/* run_change.c. The first is a worker's; after run_plan_read, does nothing without `since`. */
int run_change_read(struct run *, struct err *err);
bool run_change_skips(const struct run *, size_t index);
/* Its regions are about to be others than were compared: a run of changes fails, and this is true. */
bool run_change_torn(struct run *);
struct run_change *run_change_free(struct run *, struct run_change *);

/* run_domain.c */
/* NULL: no memory, the run fails. */
struct run_domain *run_domain_start(struct run *, size_t index, enum sched_priority);
void run_domain_emit(struct run_domain *);
void run_domain_store(struct run_domain *);
void run_domain_split(struct run_domain *);
void run_domain_release(struct run_domain *);                            /* takes it out of the list and frees it */
void run_there_free(struct run *);                                       /* run_plan.c */
int run_store(const struct run *);                                       /* the folder of its domains */
bool run_recent(void *run, struct digest base, struct digest *ret_list); /* pipe_reuse_params.hint */
/* pipe_reuse_params.recall and .remember. A one-step dataset is not passed over again: nothing is noted of it. Nor of what
 * streams find, which may be of old generations. (What they make is: the domain of that region that was used last.) */
bool run_recall(void *run, struct digest base, struct pipe_summary *ret);
void run_remember(void *run, const struct pipe_summary *);
void run_used(const struct run *, const struct pipe_stored *, int64_t now_ns); /* it was found in the store */
/* The time of a file is its last use, to the hour; what is written now may have a time a little earlier. */
#define STORE_TOUCH_NS (INT64_C(3600) * 1000000000)
#define STORE_LOOK_NS INT64_C(1000000000)
size_t run_page_round(size_t);
/* run_arena.c, of runs with `sums`. Workers: one that is free, if there is; and free again, nothing of it is needed. */
bool run_arena_take(struct run_domain *);
void run_arena_put(struct run_domain *);
/* Loop. Before it is submitted: bytes that it is to take; `own`: it is lent none. When its task is over: what it still has then
 * is its own from here on, with the charge. */
uint64_t run_arena_ask(struct run_domain *, bool own);
void run_arena_back(struct run_domain *);
/* Unmaps those that nobody will need, and what is free while others lack memory. */
void run_arenas_fit(struct run *);
/* The leaf was emitted with the plan. Not while `splitting`. */
bool run_is_there(const struct run *, size_t index);
/* The selected grid of the run's view takes the place of its generation's. RUN_E_ABSENT: it is not there.
 * -ERR_BUSY: from the start, later (no memory for the index now, or it was damaged and is removed). Worker. */
enum { RUN_E_ABSENT = 1 };
int run_select_open(struct run *, struct err *err);
/* Make it, if memory and others that make the same one allow it now. Loop. */
void run_select_start(struct run *);
bool run_selecting(const struct run *); /* it is about to be made, or is */
/* What the selection removed before any domain saw it goes into the totals. */
int run_select_count(struct run *, struct err *err);
/* What was read is damaged: the selection, if it was that, is removed, and made again by whoever needs it next. */
void run_select_discard(struct run *);
void run_opened(struct run *); /* the task that opened `grid` is done */
bool run_backlog(const struct run *);
/* What waits for a slow reader is to be written to a file. The mesh of one step needs that only where nothing more can
 * be made otherwise (or where others lack memory, run_relieve): nobody will ask for its domains again. */
bool run_crowded(const struct run *);

/* run_space.c */
bool run_space_met(struct run *, const struct err *why); /* it does not fail for that, but begins again later */
bool run_space_waits(const struct run *);
void run_space_forget(struct run *); /* it will not: whatever comes next ends it */
void run_space_tick(struct run *);
char *run_space_text(const struct run *, char *buf, size_t size); /* unchanged if it does not wait */
/* Workers. What the emitter has spilled, before it emits more. */
int run_space_spill(struct run *, struct err *err);
int run_space_spool(struct run *, uint64_t bytes, struct err *err);
void run_space_unspool(struct run *);
/* False: there is no room to store a finished domain. */
bool run_space_domain(struct run *, uint64_t bytes);
void run_space_stored(struct run *, uint64_t taken, uint64_t bytes); /* the file; 0: there is none */
int run_space_select_begin(struct run *, uint64_t memory, struct err *err);
int run_space_select_grow(struct run *, int parent, const char *name, bool sealed, struct err *err);
void run_space_select_end(struct run *, uint64_t bytes);
void run_space_select_hold(struct run *); /* until run_shut */
void run_space_shut(struct run *);

/* run_pace.c */
void run_pace_tick(struct run *);

/* run_output.c */
/* All blocks are emitted. False: the output was to go on behind the last one; the run fails. */
bool run_output_enough(struct run *);
void run_output_relieve(struct run *); /* a block that takes long is spooled */
void run_output_tick(struct run *);
void run_output_head(struct run *);
void run_output_drop(struct run *);

/* run_domain.c: what the store had, and could not be used. Any thread. */
void run_tell_damaged(const struct run *, unsigned n);

#endif
