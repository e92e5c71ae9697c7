/* What the files of this room share. Loop unless a function says "worker" or "any thread". */
#ifndef RUN_PRIV_H
#define RUN_PRIV_H

#include <stdatomic.h>

#include "admission.h"
#include "dataset.h"
#include "plan_file.h"
#include "run.h"
#include "sched_group.h"
#include "selection.h"
#include "simplify.h"

struct runs {
	struct core *core;
	struct admission *admission;
	struct recency *recency;   /* of stored domains: struct store_id. Any thread. NULL: no memory */
	struct recency *summaries; /* likewise: struct pipe_summary */
	uint64_t last_select;
};

enum run_domain_state {
	DOMAIN_MAKING,   /* a task makes it, or reads it from the store */
	DOMAIN_SPLIT,    /* its region has to be split, or a task splits it */
	DOMAIN_READY,    /* in memory, not emitted */
	DOMAIN_STORING,  /* a task stores it, to free its memory */
	DOMAIN_EMITTING, /* a task emits it */
	DOMAIN_SENDING,  /* its block is being written to the output */
};

/* One domain, from its start until its last byte is sent. Domains before run.next_start that are neither emitted nor in this list
 * are in the store (or lost, and then made again). */
struct run_domain {
	struct sched_task task;
	struct run *run;
	struct run_domain *next; /* by index */
	enum run_domain_state state;
	size_t index; /* in the plan */
	struct cut_region region;
	const struct cut_sites *sites; /* those of the plan, if they include its halo; otherwise NULL */
	uint64_t count;                /* largest number of positions that it owns, by the plan */
	struct mesh_domain domain;
	void *memory;
	size_t size; /* mapped and charged to LEDGER_DOMAIN; while it borrows an arena, the run has the charge */
	bool huge;   /* `memory` is to be mapped in huge pages */
	bool borrows_arena, returned_arena, no_arena; /* run_arena.c; no_arena: none was free */
	size_t held;                                  /* bytes of `memory` that the result needs */
	bool stored;                                  /* it is in the store, as `as` */
	bool unstorable;
	bool numbering_only;          /* only what numbers later blocks is needed: no triangles, if it comes from the store */
	bool made;                    /* it was triangulated, not read */
	bool searched, changed, flat; /* as those of its leaf, when the plan was made */
	struct pipe_stored as;
	bool block; /* its emission made a block */
	uint64_t need;
	int r;
	struct err err;
};

/* A run with `since`: which regions are omitted, and what its head says (run_change.c). */
struct run_change {
	struct run_changes summary;
	struct run_region *region; /* removed ones */
	struct digest removed;     /* sum of their digests */
	struct digest id;          /* of all that decides which blocks are sent */
	uint8_t *skip;             /* by leaf: it is in both meshes, or is empty */
	uint64_t charged;          /* bytes of LEDGER_PLAN */
};

#define ABOUT_RUN(w)                \
	(&(const struct log_about){ \
		.job = (w)->job, .dataset = (w)->dataset->name, .generation = (w)->generation, ABOUT_USER((w)->owner.uid)})

enum run_state {
	RUN_NEW,        /* waits for a slot, or for disk space */
	RUN_OPENING,    /* a task opens the generation */
	RUN_UNSELECTED, /* its selection has to be made */
	RUN_SELECTING,  /* a task makes the selection */
	RUN_OPEN,       /* `grid` is open; the plan is next */
	RUN_PLANNING,
	RUN_RUNNING,   /* domains are made and emitted */
	RUN_FINISHING, /* a task computes the sums */
	RUN_OVER,
};

struct run {
	struct admission_run admission;
	uint64_t job; /* 0: none */
	struct runs *runs;
	struct dataset *dataset;
	uint64_t generation;
	struct view view;      /* as asked for */
	struct view grid_view; /* what of it remains to be applied to `grid`; shares its area */
	char *view_text;
	size_t charged;                     /* bytes of LEDGER_JOBS */
	char manifest[64];                  /* file name */
	bool keep, plan_only, lazy, client; /* as run_params */
	struct sched_owner owner;           /* of all its tasks */
	struct slot *slot;
	bool has_slot;          /* and with it its share of the memory */
	bool yielding;          /* it stops to begin again later */
	uint64_t points_before; /* points emitted before it began again */
	double patience;
	const struct run_since *since;
	struct run_change *change;
	const struct run_calls *calls;
	void *ctx;

	enum run_state state;
	struct sched_task task; /* opens, selects, plans, finishes */
	bool task_busy;
	int r; /* of `task`, with err */
	struct err err;

	struct dataset_lines_wait lines_wait; /* for the line set of its generation */
	bool opened;                          /* the dataset's folder */
	bool reading;                         /* until the end, because the grid opens its segments again (dataset_read_begin) */
	struct grid *grid;                    /* of the generation, or of its selection */
	struct grid *origin;                  /* of a selection whose hidden positions are asked for: the generation; else NULL */
	char *wkt;                            /* of the dataset, which a selection does not have; NULL: none */
	uint64_t wkt_bytes;
	char geoid[GRID_GEOID];
	struct run_select {
		struct digest key;
		struct digest base;          /* of a view with a bound: the selection without it */
		struct digest making;        /* RUN_SELECTING: what its task makes */
		uint64_t number;             /* of the temporary folder */
		uint64_t bytes;              /* of LEDGER_STAGE, for the task */
		bool open;                   /* `grid` is that of the selection */
		atomic_uint_fast64_t judged; /* points read so far */
		uint64_t reported;           /* of `judged` */
		uint64_t total;              /* points of the generation */
		struct selection_counts counts;
		struct simplify_report simplified; /* of a view with a bound */
	} select;
	struct run_simplify { /* run_simplify.c, while it works */
		bool working;
		struct simplify *s;
		struct view view;                          /* of the points that it chooses from; shares the area */
		char name[64];                             /* of its folder, in `parent` */
		struct grid_named file[GRID_SOURCE_FILES]; /* of the lines */
		int parent, dirfd;                         /* -1: not open */
		unsigned members;                          /* the most threads */
		size_t each;                               /* bytes of a task */
		uint64_t need, held;                       /* bytes that a task was found to need; of LEDGER_DOMAIN */
		uint64_t lacks;                            /* as `need`, of the task that failed */
		void *memory;
		struct sched_group *group; /* NULL: the task is alone */
		unsigned tasks, left;      /* of the step; not done when it began */
		atomic_uint next;          /* of these, to be looked at */
		atomic_flag failed;        /* with `err` */
		struct err err;
		bool counted;                   /* the folder's space is reserved */
		bool emptied;                   /* it began again with an empty folder */
		bool done;                      /* complete, and opened */
		atomic_uint step, finished, of; /* for progress: enum simplify_step; tasks */
	} simplify;
	uint64_t ground, other; /* run_classes */
	uint64_t cropped;       /* run_cropped */
	bool classes_exact;
	bool unclassified;      /* run_unclassified */
	bool unweighted;        /* run_unweighted */
	uint64_t emitter_bytes; /* charged */
	struct pipe_emitter *emitter;
	struct pipe_budget budget;
	uint64_t wide;        /* positions that a region was found to need, more than a usual budget has (retry_wider); else 0 */
	struct pipe_key key;  /* of its domains; known with `grid` */
	struct cut_plan plan; /* a worker's while `splitting` */
	struct plan_file *file; /* where the plan is kept; NULL: nowhere */
	struct plan_kept kept;
	bool planned; /* the plan was read from `file` */
	size_t splits_seen;
	/* While the plan is made: by a task, and then by several that search the store for its leaves. */
	struct run_planning {
		void *memory;
		uint64_t bytes; /* of LEDGER_DOMAIN */
		uint64_t held;  /* the same, for the loop, when the first task is done */
		bool ran;
		struct mesh_counts empty;
		struct pipe_refine *refine;
		unsigned members;            /* they share the memory */
		struct grid_reader **reader; /* one a member; NULL: not begun */
		struct sched_group *group;
		unsigned damaged; /* with `err` and run.stored_leaves under LOCK_LEAVES */
		struct err err;   /* of the first member that failed */
	} planning;
	struct run_domain *splitting;

	struct run_domain *domains;
	unsigned ndomains;
	unsigned tasks; /* of domains and output, not finished */
	size_t next_start, next_emit;
	/*
	 * Nobody reads its blocks: only the sums of each domain are needed. Leaves that the store has are counted when the plan
	 * is made (leaf.there). The others are stored when they are made, and their memory goes to the next one.
	 */
	bool sums_only;
	struct run_stored_leaves {
		struct plan_done *done; /* their records, for the task that makes the plan to write */
		size_t n, room;
		uint64_t points, charged;
		int64_t searched_ns; /* when the search began, by the clock of files */
		size_t leaves;
		bool triangles;
	} stored_leaves;
	struct run_arenas {
		struct arena *free; /* under LOCK_ARENA */
		unsigned owned;     /* arenas that exist, or will when the task runs that brings one; with a reader: free ones */
		uint64_t charged;   /* bytes of LEDGER_DOMAIN, for arenas that no domain owns */
	} arenas;
	size_t made;     /* domains triangulated, some perhaps more than once */
	size_t reusable; /* plan_only: domains that are in the store */
	size_t plan_n;   /* plan.n, also while a worker has the plan */
	struct run_domain *emitting, *sending;

	struct run_output *output;
	struct sched_task output_task;
	bool output_head;                          /* the head was sent */
	bool output_busy;                          /* a block is encoded and not all written */
	bool output_working;                       /* a worker is in a call of the output */
	bool output_buffer;                        /* the buffer for a spooled block is charged */
	void (*output_freed)(struct run_output *); /* the output closes; NULL: it does not */
	uint64_t spool_failed_ns;
	uint64_t sending_ns; /* since when the block is sent */
	uint64_t blocks;     /* emitted */

	struct run_pace {                  /* run_pace.c */
		uint64_t checked_ns, seen; /* the last time, and the points then */
		double worked;             /* seconds */
		double points, seconds;    /* faded: what is long ago counts little */
	} pace;
	struct run_space {            /* run_space.c */
		bool waits;           /* it released its slot for lack of disk space */
		bool given_up;        /* it will not wait again */
		bool holds;           /* the selection, against eviction */
		atomic_bool reported; /* that domains are not stored */
		unsigned vanished;    /* how often the cache was removed */
		uint64_t need;        /* bytes that it asked for */
		uint64_t missing;     /* bytes of these; 0: it waits for the cache to be made again */
		double wait;          /* seconds to the next check */
		uint64_t since_ns, checked_ns, resumed_ns;
		atomic_uint_fast64_t asked;
		uint64_t spilled, spooled, selecting; /* bytes reserved */
		struct err why;
	} space;
	struct digest head_id; /* of the stream, as its output knows it */
	uint64_t opened_ns, started_ns, first_ns, stopped_ns;
	uint64_t points;     /* emitted */
	uint64_t grid_total; /* points of the generation */
	bool stopping;
	struct err why; /* of the end */
	struct pipe_totals totals;
};

/* A reader that takes nothing for so long is slow. */
#define RUN_STALL_SECONDS 0.25
/* Only a test changes these: */
extern unsigned run_domains_most; /* in the list of a run at one time */
extern uint64_t run_huge_count;   /* positions of a domain that has huge pages */

static inline struct run *run_of_task(struct sched_task *t)
{
	return (struct run *)((char *)t - offsetof(struct run, task));
}

static inline struct run_domain *run_domain_of(struct sched_task *t)
{
	return (struct run_domain *)((char *)t - offsetof(struct run_domain, task));
}

/* run.c */
void run_set_state(struct run *, enum run_state); /* asserts that the transition is allowed */
void run_open(struct run *);                      /* it has its slot: opens the generation */
void run_opened(struct run *);                    /* the task that opened `grid` is done */
void run_finish(struct run *);                    /* all is emitted: computes the sums */
void run_fail(struct run *, const struct err *why);
void run_settle_stopping(struct run *);
void run_over(struct run *);
void run_close(struct run *); /* releases all that a run without a slot may not hold */

/* run_loop.c */
bool run_backlog(const struct run *); /* its reader is slow: domains go to the store */
bool run_stalled(const struct run *); /* it waits for its reader only */
/* What waits for a slow reader has to be written to a file. First unmaps what no result needs. */
bool run_must_store(struct run *);
/* Others lack memory: releases what it can. Not urgent: unless memory comes back soon anyway. */
void run_relieve(struct run *, bool urgent);

/* run_yield.c */
void run_reset(struct run *); /* as it was before it began; no task of it may be busy */
/* Releases its slot, and seeks one whose tasks have `need` bytes. Likewise. */
void run_requeue(struct run *, uint64_t need);
bool run_can_yield(const struct run *);
void run_yield(struct run *);
bool run_finish_yield(struct run *); /* it stopped in order to yield: it seeks a slot again, and is not over */

/* run_admission.c */
extern const struct admission_calls run_admission_calls;
bool run_may_start(const struct run *);          /* its user's share has room for one more domain */
bool run_selected_elsewhere(const struct run *); /* another run makes the same selection */

/* run_plan.c */
int run_plan_read(struct run *, struct err *err); /* worker */
void run_plan_start(struct run *);
void run_plan_follow(struct run *);   /* applies splits that the run it follows has made */
size_t run_reach(const struct run *); /* domains before this one may be started now */
void run_stored_leaves_free(struct run *);

/* run_area.c */
void run_area_id(const struct run *, struct digest *id); /* adds what else the blocks of a window depend on */

/* run_change.c */
/* Worker, after run_plan_read. Nothing without `since`. RUN_E_ABSENT never leaves it. */
int run_change_read(struct run *, struct err *err);
bool run_change_skips(const struct run *, size_t index);
/* A region is about to be split, which was compared whole: a run of changes fails, and this is true. */
bool run_change_fails_split(struct run *);
struct run_change *run_change_free(struct run *, struct run_change *);

/* run_domain.c */
struct run_domain *run_domain_start(struct run *, size_t index, enum sched_priority); /* NULL: no memory, the run fails */
void run_domain_restart(struct run_domain *, enum sched_priority);                    /* makes or reads it again */
void run_domain_split(struct run_domain *);
void run_domain_release(struct run_domain *);                          /* takes it out of the list and frees it */
void run_domain_set_state(struct run_domain *, enum run_domain_state); /* asserts that the transition is allowed */
void run_domain_submit(struct run_domain *, void (*run)(struct sched_task *), void (*done)(struct sched_task *),
		       enum sched_priority, uint64_t bytes);

/* run_emit.c */
void run_domain_emit(struct run_domain *);
bool run_leaf_is_stored(const struct run *, size_t index); /* it was counted with the plan. Not while `splitting` */

/* run_memory.c */
size_t run_page_round(size_t);                            /* any thread */
void run_domain_map(struct run_domain *, uint64_t bytes); /* worker; sets d->r */
void run_domain_trim(struct run_domain *, size_t held);   /* keeps the first `held` bytes */
void run_domain_unmap(struct run_domain *);

/* run_arena.c. Loop: of a run whose triangles are read */
bool run_arena_is_scarce(const struct run *);     /* others lack memory, or may soon: no arena passes */
bool run_arena_passes(const struct run_domain *); /* its memory goes to the next domain as a whole, so it is not trimmed */
bool run_arena_inherit(struct run_domain *);      /* before it is submitted; false: its task takes the memory */
void run_arena_leave(struct run_domain *);        /* its memory becomes a free arena, or is unmapped */
void run_arenas_trim_results(struct run *);       /* unmaps what is behind the results of domains that wait for their reader */
/* Of a run with `sums_only` */
bool run_arena_take(struct run_domain *); /* worker; false: none is free */
void run_arena_put(struct run_domain *);  /* worker: its memory becomes a free arena */
/* Before its task is submitted: bytes that the task takes. `own`: it borrows no arena. */
uint64_t run_arena_ask(struct run_domain *, bool own);
void run_arena_settle(struct run_domain *); /* its task is over: what it still has is its own, with the charge */
void run_arenas_trim(struct run *);         /* unmaps free arenas that are not needed, or all while others lack memory */

/* run_store.c. Worker unless noted. */
int run_store(const struct run *); /* descriptor of the folder of its domains. Any thread */
struct pipe_reuse_params run_domain_reuse(struct run_domain *);
bool run_domain_load(struct run_domain *);   /* from the store */
void run_domain_keep(struct run_domain *);   /* into the store */
void run_domain_record(struct run_domain *); /* in the plan of its job */
void run_domain_store(struct run_domain *);  /* loop: stores it, and frees it then */
/* For pipe_reuse_params: hint, recall, remember. Nothing is remembered of one-step datasets, which are read once, nor of what
 * streams find, which may belong to old generations. */
bool run_recent(void *run, struct digest base, struct digest *ret_list);
bool run_recall(void *run, struct digest base, struct pipe_summary *ret);
void run_remember(void *run, const struct pipe_summary *);
void run_used(const struct run *, const struct pipe_stored *, int64_t now_ns); /* notes the use of a stored domain */
void run_event_damaged(const struct run *, unsigned n);                        /* n stored domains were damaged. Any thread */
/* The time of a stored file is that of its last use, to the hour. What is written now may have a time a little earlier. */
#define STORE_TOUCH_NS (INT64_C(3600) * 1000000000)
#define STORE_LOOK_NS INT64_C(1000000000)

/* run_classes.c */
void run_count_classes(struct run *); /* sets ground, other and so on of the open grid. Worker */

/* Memory of the index of one grid of the run. */
uint64_t run_index_share(const struct run *);

/* run_select.c */
/* Opens the selection in place of the generation's grid. RUN_E_ABSENT: there is none. -ERR_BUSY: no memory for the index now, or
 * it was damaged and is removed; begin again later. Worker. */
enum { RUN_E_ABSENT = 1, RUN_E_NO_LINES };
int run_select_open(struct run *, struct err *err);
int run_select_parent(struct run *, int *ret_fd, struct err *err); /* the folder of its selections */
int run_select_open_in(struct run *, int parent, struct err *err); /* run_select_open, in that folder, with its key known */
void run_select_start(struct run *);                               /* makes it, when memory allows and no other run does */
bool run_selecting(const struct run *);                            /* it is made, or will be */
int run_select_count(struct run *, struct err *err);               /* adds what the selection removed to the totals */
/* Read data was damaged: if that was the selection, it is removed, and made again when it is needed next. */
void run_select_discard(struct run *);

/* run_simplify.c */
void run_simplify_start(struct run *);                          /* `grid` is what it chooses from */
uint64_t run_simplify_done(const struct run *, uint64_t total); /* of the present step: as much of `total` */
const char *run_simplify_phase(const struct run *);

/* run_space.c */
/* True: `why` is a lack of disk space, or a cache that was removed, and the run begins again later instead of failing. */
bool run_space_suspend(struct run *, const struct err *why);
bool run_space_waits(const struct run *);
void run_space_give_up(struct run *); /* whatever comes next ends the run */
void run_space_tick(struct run *);
char *run_space_text(const struct run *, char *buf, size_t size); /* unchanged if it does not wait */
void run_space_release(struct run *);
/* Worker: reserves disk space ... */
int run_space_spill(struct run *, struct err *err); /* for the emitter's table, before it emits */
int run_space_spool(struct run *, uint64_t bytes, struct err *err);
void run_space_unspool(struct run *);                                /* loop */
bool run_space_domain(struct run *, uint64_t bytes);                 /* false: there is no room to store a domain */
void run_space_stored(struct run *, uint64_t taken, uint64_t bytes); /* the file's bytes; 0: no file */
int run_space_select_begin(struct run *, uint64_t memory, struct err *err);
/* Of a simplification, which may be there in part. */
int run_space_part_begin(struct run *, int parent, const char *name, struct err *err);
int run_space_select_grow(struct run *, int parent, const char *name, bool sealed, struct err *err);
void run_space_select_end(struct run *, uint64_t bytes); /* the selection's bytes; 0: none */
void run_space_select_hold(struct run *);                /* until run_close */

/* run_pace.c */
void run_pace_tick(struct run *);

/* run_output.c */
/* All blocks are emitted. False: the output was to resume behind the last one, and the run fails. */
bool run_output_check_end(struct run *);
void run_output_relieve(struct run *); /* spools a block that takes long */
void run_output_tick(struct run *);
void run_output_head(struct run *);
void run_output_drop(struct run *);

#endif
