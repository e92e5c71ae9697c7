/* The insides of a walk, shared by walk.c (the loop's side), walk_domain.c (tasks) and walk_output.c. */
#ifndef WALK_PRIV_H
#define WALK_PRIV_H

#include <stdatomic.h>

#include "crew.h"
#include "plan_file.h"
#include "walk.h"

enum walk_domain_state {
	DOMAIN_MAKING,   /* a task makes or loads it */
	DOMAIN_SPLIT,    /* waits to be split, or is */
	DOMAIN_READY,    /* in memory, not emitted */
	DOMAIN_STORING,  /* a task stores it, to free its memory */
	DOMAIN_EMITTING, /* a task emits it */
	DOMAIN_SENDING,  /* its block is being written */
};

/* One domain between its start and its last byte. Those before walk.next_start that are neither emitted nor
 * here are in the store (or lost, and then made again). */
struct walk_domain {
	struct sched_task task;
	struct walk *walk;
	struct walk_domain *next; /* by index */
	enum walk_domain_state state;
	size_t index;
	struct cut_region region;
	const struct cut_sites *sites; /* of the plan, if its halo is in them */
	uint64_t count;                /* positions that it owns at most, as the plan knows */
	struct mesh_domain domain;
	void *memory;
	size_t size; /* mapped, and charged to LEDGER_DOMAIN: for it, or as one of the walk's arenas while it is lent that */
	bool huge;   /* memory that it maps is to be in huge pages */
	bool lent, put, bare; /* walk_arena.c: has one that was there; gave it back; found none */
	size_t held;          /* of it, what the result needs */
	bool stored, unstorable;
	bool front; /* only what later blocks are numbered by is asked for: `domain.triangle` is NULL if it came from the store */
	bool made;  /* not from the store */
	bool looked, changed;  /* as its leaf's, when the plan was made */
	struct pipe_stored as; /* if `stored` */
	bool block;            /* its emission gave one */
	uint64_t need;
	int r;
	struct err err;
};

/* walk_change.c: what a walk with `since` leaves out, and what it says before the blocks. */
struct walk_change {
	struct job_changes told;
	struct job_region *region; /* gone */
	struct digest gone;        /* sum of theirs */
	struct digest id;          /* of all that decides which blocks come */
	uint8_t *skip;             /* by leaf: it holds in both meshes, or is empty */
	uint64_t charged;          /* of LEDGER_PLAN */
};

/* Any thread. What log_event is told. */
#define ABOUT_WALK(w)               \
	(&(const struct log_about){ \
		.job = (w)->job, .dataset = (w)->dataset->name, .generation = (w)->generation, ABOUT_USER((w)->owner.uid)})

struct walk {
	uint64_t job; /* 0: none */
	struct jobs *jobs;
	struct dataset *dataset;
	uint64_t generation;
	struct view view; /* as asked for */
	struct view rest; /* what of it applies to `grid`; shares its area */
	char *view_text;
	size_t charged; /* of LEDGER_JOBS */
	char manifest[64];
	bool keep, plan_only, lazy, client;
	struct sched_owner owner; /* of all its tasks */
	struct place *place;
	bool placed;            /* has its place, which is its share of the memory */
	bool giving;            /* stops to begin again later */
	uint64_t points_before; /* emitted before it gave way */
	double patience;
	const struct walk_since *since;
	struct walk_change *change;
	const struct walk_calls *calls;
	void *ctx;

	enum {
		WALK_NEW,
		WALK_OPENING,
		WALK_UNSELECTED,
		WALK_SELECTING,
		WALK_OPEN,
		WALK_PLANNING,
		WALK_RUNNING,
		WALK_FINISHING,
		WALK_OVER
	} state;
	struct sched_task task; /* of opening, selecting, planning, finishing */
	bool task_busy;
	int r;
	struct err err;

	bool opened;       /* the dataset's folder */
	struct grid *grid; /* of the generation; of a view that selects, then of its selection */
	struct walk_select {
		struct digest key;
		uint64_t number; /* of the temporary folder */
		uint64_t bytes;  /* that the task takes */
		bool open;       /* `grid` is of the selection */
		atomic_uint_fast64_t judged;
		uint64_t told, total; /* points of the generation */
		struct pipe_selected counts;
	} select;
	uint64_t ground, other; /* walk_classes */
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
	struct walk_planning {
		void *memory;
		uint64_t bytes; /* of LEDGER_DOMAIN */
		uint64_t held;  /* the same, for the loop, when its first task is done */
		bool ran;
		struct mesh_counts flat;
		struct pipe_refine *refine;
		unsigned members;            /* that share the memory */
		struct grid_reader **reader; /* theirs, as far as they have begun */
		struct crew *crew;
		unsigned damaged; /* with the next, and `there`, any thread's, under the lock of walk_plan.c */
		struct err err;   /* of whoever failed first */
	} planning;
	struct walk_domain *splitting;

	struct walk_domain *domains;
	unsigned ndomains, tasks; /* tasks: of domains and output, not over */
	size_t next_start, next_emit;
	/*
	 * Nobody will read what it emits: of each domain only the sums are asked for, as soon as they are known. Leaves that are
	 * `there` in the plan were emitted when it was made; what it makes goes to the store, and its memory to the next.
	 */
	bool sums;
	struct walk_there {
		struct plan_done *done; /* to be noted in the plan, by the task that makes it */
		size_t n, room;
		uint64_t points, charged;
		int64_t looked_ns; /* when, of the clock that files have */
		size_t leaves;
		bool triangles;
	} there;
	struct walk_arenas {
		struct arena *free; /* any thread, under the lock of walk_arena.c */
		unsigned owned;     /* that are there, or will be when who brings one runs */
		uint64_t charged;   /* of LEDGER_DOMAIN: for those that are no domain's own any more */
	} arenas;
	size_t made;     /* domains that were triangulated, some perhaps more than once */
	size_t reusable; /* of one that plans only: domains that are in the store */
	size_t plan_n;   /* plan.n, for whoever asks while a worker has the plan */
	struct walk_domain *emitting, *sending;

	struct job_output *output;
	struct sched_task output_task;
	bool output_head, output_busy, output_working; /* head sent; a block is not all written; a worker has it */
	bool output_refilling, output_buffer;
	bool output_spooling;
	void (*output_freed)(struct job_output *);
	uint64_t spool_failed_ns;
	uint64_t sending_ns; /* since when the block is sent */
	uint64_t blocks;     /* emitted */

	struct walk_pace {
		uint64_t looked_ns, seen; /* when last, and points then */
		double worked;            /* seconds */
		double points, seconds;   /* of late: what is long ago counts little */
	} pace;
	struct walk_space {       /* walk_space.c */
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

extern unsigned walk_domains_most; /* in the list of a walk at one time; only a test sets it */

void walk_fail(struct walk *, const struct err *why);
void walk_start(struct walk *);
void walk_shut(struct walk *); /* all that it holds for long goes back */
/* walk_place.c: its place goes back until `need` is there for its plan; no task of it may be busy. */
void walk_retreat(struct walk *, uint64_t need);
bool walk_can_give_way(const struct walk *);
void walk_give_way(struct walk *);
bool walk_gave_way(struct walk *); /* it stopped for that: it seeks a place again, and is not over */

/* walk_plan.c */
int walk_plan_read(struct walk *, struct err *err); /* worker */
void walk_plan_start(struct walk *);
void walk_plan_follow(struct walk *);   /* what the walk that it follows has split */
size_t walk_reach(const struct walk *); /* domains before this one may be started now */

/* walk_area.c */
void walk_area_id(const struct walk *, struct digest *id); /* what else the blocks of a window depend on */
/* walk_change.c. The first is a worker's; after walk_plan_read, does nothing without `since`. */
int walk_change_read(struct walk *, struct err *err);
bool walk_change_skips(const struct walk *, size_t index);
/* Its regions are about to be others than were compared: a walk of changes fails, and this is true. */
bool walk_change_torn(struct walk *);
struct walk_change *walk_change_free(struct walk *, struct walk_change *);

/* walk_domain.c */
/* NULL: no memory, the walk fails. */
struct walk_domain *walk_domain_start(struct walk *, size_t index, enum sched_priority);
void walk_domain_emit(struct walk_domain *);
void walk_domain_store(struct walk_domain *);
void walk_domain_split(struct walk_domain *);
void walk_domain_release(struct walk_domain *);                          /* takes it out of the list and frees it */
void walk_there_free(struct walk *);                                     /* walk_plan.c */
int walk_store(const struct walk *);                                     /* the folder of its domains */
bool walk_hint(void *walk, struct digest base, struct digest *ret_list); /* pipe_reuse_params.hint */
/* pipe_reuse_params.recall and .remember. A one-step dataset is not passed over again: nothing is noted of it. Nor of what
 * streams find, which may be of old generations. (What they make is: the domain of that region that was used last.) */
bool walk_recall(void *walk, struct digest base, struct pipe_summary *ret);
void walk_remember(void *walk, const struct pipe_summary *);
void walk_used(const struct walk *, const struct pipe_stored *, int64_t now_ns); /* it was found in the store */
/* The time of a file is its last use, to the hour; what is written now may have a time a little earlier. */
#define STORE_TOUCH_NS (INT64_C(3600) * 1000000000)
#define STORE_LOOK_NS INT64_C(1000000000)
size_t walk_page_round(size_t);
/* walk_arena.c, of walks with `sums`. Workers: one that is free, if there is; and free again, nothing of it is needed. */
bool walk_arena_take(struct walk_domain *);
void walk_arena_put(struct walk_domain *);
/* Loop. Before it is submitted: bytes that it is to take; `own`: it is lent none. When its task is over: what it still has then
 * is its own from here on, with the charge. */
uint64_t walk_arena_ask(struct walk_domain *, bool own);
void walk_arena_back(struct walk_domain *);
/* Unmaps those that nobody will need, and what is free while others lack memory. */
void walk_arenas_fit(struct walk *);
/* The leaf was emitted with the plan. Not while `splitting`. */
bool walk_is_there(const struct walk *, size_t index);
/* The selected grid of the walk's view takes the place of its generation's. WALK_E_ABSENT: it is not there.
 * -ERR_BUSY: from the start, later (no memory for the index now, or it was damaged and is removed). Worker. */
enum { WALK_E_ABSENT = 1 };
int walk_select_open(struct walk *, struct err *err);
/* Make it, if memory and others that make the same one allow it now. Loop. */
void walk_select_start(struct walk *);
bool walk_selecting(const struct walk *); /* it is about to be made, or is */
/* What the selection removed before any domain saw it goes into the totals. */
int walk_select_count(struct walk *, struct err *err);
/* What was read is damaged: the selection, if it was that, is removed, and made again by whoever needs it next. */
void walk_select_discard(struct walk *);
void walk_opened(struct walk *); /* the task that opened `grid` is done */
bool walk_backlog(const struct walk *);
/* What waits for a slow reader is to be written to a file. The mesh of one step needs that only where nothing more can
 * be made otherwise (or where others lack memory, walk_relieve): nobody will ask for its domains again. */
bool walk_crowded(const struct walk *);

/* walk_space.c */
bool walk_space_met(struct walk *, const struct err *why); /* it does not fail for that, but begins again later */
bool walk_space_waits(const struct walk *);
void walk_space_forget(struct walk *); /* it will not: whatever comes next ends it */
void walk_space_tick(struct walk *);
char *walk_space_text(const struct walk *, char *buf, size_t size); /* unchanged if it does not wait */
/* Workers. What the emitter has spilled, before it emits more. */
int walk_space_spill(struct walk *, struct err *err);
int walk_space_spool(struct walk *, uint64_t bytes, struct err *err);
void walk_space_unspool(struct walk *);
/* False: there is no room to store a finished domain. */
bool walk_space_domain(struct walk *, uint64_t bytes);
void walk_space_stored(struct walk *, uint64_t taken, uint64_t bytes); /* the file; 0: there is none */
int walk_space_select_begin(struct walk *, uint64_t memory, struct err *err);
int walk_space_select_grow(struct walk *, int parent, const char *name, bool sealed, struct err *err);
void walk_space_select_end(struct walk *, uint64_t bytes);
void walk_space_select_hold(struct walk *); /* until walk_shut */
void walk_space_shut(struct walk *);

/* walk_pace.c */
void walk_pace_tick(struct walk *);

/* walk_output.c */
/* All blocks are emitted. False: the output was to go on behind the last one; the walk fails. */
bool walk_output_enough(struct walk *);
void walk_output_relieve(struct walk *); /* a block that takes long is spooled */
void walk_output_tick(struct walk *);
void walk_output_head(struct walk *);
void walk_output_drop(struct walk *);

/* walk_domain.c: what the store had, and could not be used. Any thread. */
void walk_tell_damaged(const struct walk *, unsigned n);

#endif
