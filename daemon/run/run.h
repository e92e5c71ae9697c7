/*
 * A run over the plan of one mesh: opens the grid, plans, makes the domains (or takes them from the store),
 * emits them in plan order, and hands their blocks to an output if there is one. A job is such a run, and so
 * is each later stream of its mesh. Loop only.
 */
#ifndef RUN_H
#define RUN_H

#include "admission.h"
#include "core.h"
#include "digest.h"
#include "mesh.h"
#include "pipe.h"

struct dataset;
struct grid_manifest;
struct job_report;
struct plan_file;
struct run;
struct runs;

/* What runs share: recency of stored domains, and a number for each selection. */
int runs_new(struct core *, struct admission *, struct runs **ret, struct err *err);
struct runs *runs_free(struct runs *); /* NULL is fine; returns NULL */

/* ---- outputs ---- */

/* A region of an older mesh that no longer holds. */
struct run_region {
	int64_t box[4]; /* as of a block */
	uint64_t triangles;
	struct digest digest;
};
/* What a stream of changes is against. Regions count where they have triangles. */
struct run_changes {
	uint64_t generation, job;
	struct digest old_digest, old_vertex_digest, digest, vertex_digest; /* of both meshes, whole */
	uint64_t gone, gone_triangles, kept, kept_triangles;
	const struct run_region *region; /* those that are gone */
};
struct run_head {
	const struct grid_manifest *manifest;
	const char *view;
	struct digest id;                  /* generation, view, plan, kernel version */
	bool window;                       /* the triangles of the view's window, not the whole mesh */
	const struct run_changes *changes; /* NULL: the whole mesh; valid during the call */
	int32_t box[6];                    /* holds all vertices; heights are not known yet: all of int32 */
};
struct run_output;
struct run_output_calls {
	/* Loop. */
	void (*head)(struct run_output *, const struct run_head *);
	void (*send)(struct run_output *);      /* what was encoded; run_output_sent when all of it is written */
	void (*pause)(struct run_output *);     /* a worker gets it next; `send` comes when it is back */
	double (*stalled)(struct run_output *); /* seconds since bytes last moved, 0 if none wait */
	/* The mesh is whole (why NULL), or will never be. The output is on its own from here. */
	void (*end)(struct run_output *, const struct err *why, const struct pipe_totals *, const struct job_report *);
	/* Workers, never two at once, and the loop sends nothing meanwhile. The block's arrays stay until
	 * sent or spooled. */
	void (*encode)(struct run_output *, const struct mesh_block *);
	int (*spool)(struct run_output *, int dirfd, struct err *err); /* the rest of the block into a file */
	int (*refill)(struct run_output *, struct err *err);           /* the next bytes of that file */
	/* Loop. What a stream of its own waits for, in words, has changed; "": nothing. May be NULL. */
	void (*waits)(struct run_output *, const char *text);
};
struct run_output {
	const struct run_output_calls *calls;
	struct run *run;                     /* that it is attached to; of this room */
	void *waiting;                       /* who waits with it for a run; NULL: nobody */
	void (*forget)(struct run_output *); /* whoever waits forgets it */
	bool spooled;                        /* set by spool: the block's memory is not needed any more; encode takes it back */
	/* Set before job_fetch: go on at this block, of the stream `want`. What cannot be is -ERR_GONE. */
	char *window;   /* a view of job_window: the triangles of its window; NULL: those of the job. Freed by the room of jobs */
	uint64_t since; /* what differs from the mesh of this generation; 0: the whole mesh */
	uint64_t from;
	bool wants;
	struct digest want;
};
enum { RUN_OUTPUT_BUFFER = ADMISSION_OUTPUT }; /* what refill may hold; charged by the run */
void run_output_sent(struct run_output *);
void run_output_dry(struct run_output *); /* the refilled bytes are written, and there are more */
/* Nobody reads any more. No call comes for this output after this; a worker may still be in one, so `freed`
 * is called when none is. */
void run_output_gone(struct run_output *, void (*freed)(struct run_output *));

/* ---- runs ---- */

struct run_calls {
	void (*planned)(void *ctx);
	void (*moved)(void *ctx);                         /* progress */
	void (*unread)(void *ctx, const struct err *why); /* the output is gone; may call run_stop */
	void (*ended)(void *ctx, const struct err *why);  /* once; then run_free */
	/* It follows another run of the same plan: only domains before this one may be taken; NULL: all. */
	size_t (*reach)(void *ctx);
	bool (*followed)(void *ctx); /* another run follows it; NULL: none */
};

/* The run is to give what its job's mesh has and an older one has not. */
struct run_since {
	uint64_t generation, job;            /* of the old mesh; of the run */
	struct digest digest, vertex_digest; /* of the run's job */
	const char *dataset;                 /* for messages, and so are */
	uint64_t oldest, newest;             /* the generations that it has */
	uint64_t near;                       /* the one next to `generation` of which a job has made such a mesh; 0: none */
	unsigned n;                          /* jobs that made the old mesh, the newest first */
	struct run_base {
		uint64_t job;
		struct digest digest, vertex_digest;
	} base[4];
};

struct run_params {
	uint64_t job; /* for the log; 0: none */
	struct runs *runs;
	struct dataset *dataset;
	uint64_t generation;
	const char *view_text;
	bool client;                   /* who asked waits for it: it does not lack disk space for ever */
	bool keep;                     /* every finished domain goes to the store */
	bool plan_only;                /* ends after the plan */
	struct sched_owner owner;      /* for whom it runs; its flow is the run's own */
	struct slot *slot;             /* of its caller, who calls run_begin when it is granted */
	bool lazy;                     /* takes no domain as long as its reader is slow: they are in the store */
	struct plan_file *plan;        /* that it goes by, and keeps; borrowed; NULL: its own, of now */
	double patience;               /* seconds to wait for an output before the domains go to the store */
	const struct run_since *since; /* borrowed; NULL: the whole mesh */
	const struct run_calls *calls;
	void *ctx;
};

/* `ended` comes in any case, later. -ERR_PROTO: the view. */
int run_new(const struct run_params *, struct run **ret, struct err *err);
/* Only after `ended`, or before run_begin. NULL is fine; returns NULL. */
struct run *run_free(struct run *);
/* It has its place. May come again: a run that gives its slot back seeks it by itself. */
void run_begin(struct run *);
/* `ended` comes with `why` as soon as no worker is busy with it. */
void run_stop(struct run *, const struct err *why);
/* True if the run has emitted nothing and has no output: it is its output then. */
bool run_attach(struct run *, struct run_output *);
/* The output is the caller's again. */
struct run_output *run_output(const struct run *); /* NULL: none is attached */
struct run_output *run_detach(struct run *);
void run_settle(struct run *); /* start what can start */
void run_tick(struct run *);
/* What keeps it from getting on, in words: "memory: needs 134M, 20M are free"; "": nothing. */
char *run_waiting(const struct run *, char *buf, size_t size);
uint64_t run_space_missing(const struct run *);   /* bytes of disk that it waits for; 0: it does not */
double run_seconds_left(const struct run *);      /* at the pace of late, without waiting; 0: not known */
double run_worked(const struct run *);            /* seconds in which a task of it ran */
void run_set_rank(struct run *, enum sched_rank); /* of its tasks from now on */

/* After `ended` without why, of a run with `since`: the old mesh with its changes is the new one, or -ERR_DIGEST. */
int run_change_agrees(const struct run *, struct err *err);

const char *run_phase(const struct run *);                /* "select" or "mesh" */
const struct pipe_totals *run_totals(const struct run *); /* after `ended` without why */
/* Of its domains, how many were not triangulated for it; of one that plans only, how many need not be. */
uint64_t run_reused(const struct run *);
size_t run_emitted(const struct run *); /* domains, from the first */
const struct cut_plan *run_plan(const struct run *);
const struct pipe_budget *run_budget(const struct run *);
const struct dataset *run_dataset(const struct run *);
const struct view *run_view(const struct run *);
/* Points of the ground (class 2) and of other classes that are no noise to the view, in the segments of the
 * generation. False: there are at least so many, since segments have records of other generations too. After `ended`
 * without why. */
bool run_classes(const struct run *, uint64_t *ret_ground, uint64_t *ret_other);
/* None of them is of class 2 or 8. */
bool run_unclassified(const struct run *);
uint64_t run_grid_points(const struct run *);
void run_progress(const struct run *, uint64_t *ret_points, uint64_t *ret_total, uint64_t *ret_domains,
		  uint64_t *ret_domains_total);
/* Up to the plan, and from there on. */
void run_seconds(const struct run *, double *ret_plan, double *ret_domains);
/* What it holds of the budget, by name: adds to `held`. */
void run_held(const struct run *, uint64_t held[LEDGER_NAMES]);
uint64_t run_first_ns(const struct run *); /* when the first triangles were there, 0: not yet */

#endif
