/*
 * A walk over the plan of one mesh: opens the grid, plans, makes the domains (or takes them from the store),
 * emits them in plan order, and hands their blocks to an output if there is one. A job is such a walk, and so
 * is each later stream of its mesh. Loop only.
 */
#ifndef WALK_H
#define WALK_H

#include "job.h"
#include "sched_pool.h"

struct plan_file;
struct walk;

/* Names of folders in which a selection is made begin so. */
#define WALK_SELECT_TEMP "tmp-"

struct walk_calls {
	void (*planned)(void *ctx);
	void (*moved)(void *ctx);                         /* progress */
	void (*unread)(void *ctx, const struct err *why); /* the output is gone; may call walk_stop */
	void (*ended)(void *ctx, const struct err *why);  /* once; then walk_free */
	/* It follows another walk of the same plan: only domains before this one may be taken; NULL: all. */
	size_t (*reach)(void *ctx);
};

/* The walk is to give what its job's mesh has and an older one has not. */
struct walk_since {
	uint64_t generation, job;            /* of the old mesh; of the walk */
	struct digest digest, vertex_digest; /* of the walk's job */
	const char *dataset;                 /* for messages, and so are */
	uint64_t oldest, newest;             /* the generations that it has */
	uint64_t near;                       /* the one next to `generation` of which a job has made such a mesh; 0: none */
	unsigned n;                          /* jobs that made the old mesh, the newest first */
	struct walk_base {
		uint64_t job;
		struct digest digest, vertex_digest;
	} base[4];
};

struct walk_params {
	uint64_t job; /* for the log; 0: none */
	struct jobs *jobs;
	struct dataset *dataset;
	uint64_t generation;
	const char *view_text;
	bool client;                    /* who asked waits for it: it does not lack disk space for ever */
	bool keep;                      /* every finished domain goes to the store */
	bool plan_only;                 /* ends after the plan */
	struct sched_owner owner;       /* for whom it runs; its flow is the walk's own */
	struct place *place;            /* of its caller, who calls walk_begin when it is granted */
	bool lazy;                      /* takes no domain as long as its reader is slow: they are in the store */
	struct plan_file *plan;         /* that it goes by, and keeps; borrowed; NULL: its own, of now */
	double patience;                /* seconds to wait for an output before the domains go to the store */
	const struct walk_since *since; /* borrowed; NULL: the whole mesh */
	const struct walk_calls *calls;
	void *ctx;
};

/* `ended` comes in any case, later. -ERR_PROTO: the view. */
int walk_new(const struct walk_params *, struct walk **ret, struct err *err);
/* Only after `ended`, or before walk_begin. NULL is fine; returns NULL. */
struct walk *walk_free(struct walk *);
/* It has its place. May come again: a walk that gives its place back seeks it by itself. */
void walk_begin(struct walk *);
/* `ended` comes with `why` as soon as no worker is busy with it. */
void walk_stop(struct walk *, const struct err *why);
/* True if the walk has emitted nothing and has no output: it is its output then. */
bool walk_attach(struct walk *, struct job_output *);
/* The output is the caller's again. */
struct job_output *walk_output(const struct walk *); /* NULL: none is attached */
struct job_output *walk_detach(struct walk *);
void walk_settle(struct walk *); /* start what can start */
/* Somebody lacks memory: give what can be given. Not urgent: unless it comes back by itself soon. */
void walk_relieve(struct walk *, bool urgent);
void walk_tick(struct walk *);
/* What keeps it from getting on, in words: "memory: needs 134M, 20M are free"; "": nothing. */
char *walk_waiting(const struct walk *, char *buf, size_t size);
uint64_t walk_space_lacks(const struct walk *);     /* bytes of disk that it waits for; 0: it does not */
double walk_seconds_left(const struct walk *);      /* at the pace of late, without waiting; 0: not known */
double walk_worked(const struct walk *);            /* seconds in which a task of it ran */
void walk_set_rank(struct walk *, enum sched_rank); /* of its tasks from now on */

/* After `ended` without why, of a walk with `since`: the old mesh with its changes is the new one, or -ERR_DIGEST. */
int walk_change_agrees(const struct walk *, struct err *err);

bool walk_stalled(const struct walk *);                       /* waits for its reader only */
bool walk_opens(const struct walk *, const struct dataset *); /* is about to open its manifest */
/* What one task of it takes: a domain, or the selection. 0: not known yet. */
size_t walk_domain_bytes(const struct walk *);
/* Makes the same selection as the other walk right now. */
bool walk_selects_same(const struct walk *, const struct walk *other);
const char *walk_phase(const struct walk *);                /* "select" or "mesh" */
const struct pipe_totals *walk_totals(const struct walk *); /* after `ended` without why */
/* Of its domains, how many were not triangulated for it; of one that plans only, how many need not be. */
uint64_t walk_reused(const struct walk *);
size_t walk_emitted(const struct walk *); /* domains, from the first */
const struct cut_plan *walk_plan(const struct walk *);
const struct pipe_budget *walk_budget(const struct walk *);
const struct view *walk_view(const struct walk *);
/* Points of the ground (class 2) and of other classes that are no noise to the view, in the segments of the
 * generation. False: there are at least so many, since segments have records of other generations too. After `ended`
 * without why. */
bool walk_classes(const struct walk *, uint64_t *ret_ground, uint64_t *ret_other);
/* None of them is of class 2 or 8. */
bool walk_unclassified(const struct walk *);
uint64_t walk_grid_points(const struct walk *);
void walk_progress(const struct walk *, uint64_t *ret_points, uint64_t *ret_total, uint64_t *ret_domains,
		   uint64_t *ret_domains_total);
/* Up to the plan, and from there on. */
void walk_seconds(const struct walk *, double *ret_plan, double *ret_domains);
uint64_t walk_first_ns(const struct walk *); /* when the first triangles were there, 0: not yet */

#endif
