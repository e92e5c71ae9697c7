/*
 * A run over the plan of one mesh: opens the generation, plans, makes the domains (or takes them from the store), emits them in
 * plan order, and passes their blocks to an output, if there is one. A job makes its mesh by a run; each later stream of the mesh
 * is another run.
 *
 * Loop thread unless a call says "worker". `why` and texts are valid during a call only. Functions that return int give 0 or
 * -ERR_X.
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
struct simplify_report;

/* What runs share: which domains were stored last, and the number of the next selection. */
int runs_new(struct core *, struct admission *, struct runs **ret, struct err *err);
struct runs *runs_free(struct runs *); /* NULL is fine; returns NULL */

/* ---- outputs ---- */

/* A region of an older mesh that differs now. */
struct run_region {
	int64_t box[4]; /* as that of a block */
	uint64_t triangles;
	struct digest digest;
};
/* The difference between an older mesh and the job's. Only regions with triangles count. */
struct run_changes {
	uint64_t generation, job;                                           /* of the older mesh */
	struct digest old_digest, old_vertex_digest, digest, vertex_digest; /* of both meshes, whole */
	uint64_t removed, removed_triangles, kept, kept_triangles;
	const struct run_region *region; /* the removed ones */
};
struct run_head {
	const struct grid_manifest *manifest;
	const char *wkt, *geoid; /* of the dataset, as its manifest has them; "": none */
	const char *view;
	struct digest id;                  /* of the stream: generation, view, plan, version of the kernel */
	bool lines, bounded;               /* blocks may have edges; the mesh ends at boundaries or holes */
	bool window;                       /* the triangles of the view's window, not the whole mesh */
	const struct run_changes *changes; /* NULL: the whole mesh */
	int32_t box[6];                    /* of all vertices; heights are not known yet: all of int32 */
};
struct run_output;
/* What a run asks of its output. */
struct run_output_calls {
	void (*head)(struct run_output *, const struct run_head *);
	void (*send)(struct run_output *);      /* write what was encoded, then call run_output_sent */
	void (*pause)(struct run_output *);     /* stop writing: a worker uses it until the next `send` */
	double (*stalled)(struct run_output *); /* seconds since bytes were written last; 0: none wait */
	/* Once: the mesh is complete (`why` NULL), or ended. The run is detached. `totals` and `report` are NULL with `why`. */
	void (*end)(struct run_output *, const struct err *why, const struct pipe_totals *, const struct job_report *);
	/* Worker, one at a time, while the loop writes nothing. The arrays of the block are valid until it is sent or spooled. */
	void (*encode)(struct run_output *, const struct mesh_block *);
	int (*spool)(struct run_output *, int dirfd, struct err *err); /* writes the rest of the block into a file */
	int (*refill)(struct run_output *, struct err *err);           /* reads the next bytes of that file */
	/* What its own stream waits for has changed; "": nothing. May be NULL. */
	void (*waits)(struct run_output *, const char *text);
};
struct run_output {
	const struct run_output_calls *calls;
	struct run *run;                     /* the run that it is attached to; of this room */
	void *waiting;                       /* a stream that waits for a run, of the caller's room; NULL: none */
	void (*forget)(struct run_output *); /* that stream drops the output */
	bool spooled;                        /* set by spool: the block is not needed any more; encode clears it */
	/* Set before job_fetch. A stream that cannot be resumed ends with -ERR_GONE. */
	char *window;       /* a view of job_window: the triangles of its window; NULL: the mesh. Freed by the room of jobs */
	uint64_t since;     /* only what differs from the mesh of this generation; 0: the whole mesh */
	uint64_t from;      /* the block to resume at */
	bool wants;         /* resume this stream only: */
	struct digest want; /* run_head.id */
};
enum { RUN_OUTPUT_BUFFER = ADMISSION_OUTPUT }; /* bytes that refill may hold; the run charges them */
void run_output_sent(struct run_output *);     /* all that was encoded is written */
void run_output_drained(struct run_output *);  /* the refilled bytes are written, and there are more */
/* Nobody reads any more. No call comes after this one; `freed` comes when no worker uses the output any more, perhaps at once. */
void run_output_close(struct run_output *, void (*freed)(struct run_output *));

/* ---- runs ---- */

/* What a run reports to its caller. NULL: not wanted, but for `ended`. */
struct run_calls {
	void (*planned)(void *ctx);
	void (*progressed)(void *ctx);
	void (*abandoned)(void *ctx, const struct err *why); /* the output closed; may call run_stop */
	void (*ended)(void *ctx, const struct err *why);     /* once; then run_free */
	/* It follows another run of the same plan, and may take only domains before this one. */
	size_t (*reach)(void *ctx);
	bool (*followed)(void *ctx); /* another run follows it */
};

/* The older mesh of a run that gives changes only. */
struct run_since {
	uint64_t generation;                 /* of the older mesh */
	uint64_t job;                        /* of the run */
	struct digest digest, vertex_digest; /* of the run's job */
	/* for messages: */
	const char *dataset;
	uint64_t oldest, newest; /* generations of the dataset */
	uint64_t near;           /* the closest generation of which a job has made such a mesh; 0: none */
	unsigned n;              /* jobs that made the older mesh, the newest first: */
	struct run_base {
		uint64_t job;
		struct digest digest, vertex_digest;
	} base[4];
};

/* Pointers are borrowed until run_free; view_text is copied. */
struct run_params {
	uint64_t job; /* for the log; 0: none */
	struct runs *runs;
	struct dataset *dataset;
	uint64_t generation;
	const char *view_text;         /* canonical */
	bool client;                   /* a client waits for it, so it does not wait for disk space for ever */
	bool keep;                     /* every finished domain goes to the store */
	bool plan_only;                /* ends after the plan */
	struct sched_owner owner;      /* whose tasks; the run has a flow of its own */
	struct slot *slot;             /* the caller calls run_begin when it is granted */
	bool lazy;                     /* takes no domain while its reader is slow: they are in the store */
	struct plan_file *plan;        /* holds the plan, or takes it; NULL: the run has a plan of its own */
	double patience;               /* seconds to wait for an output before the first domains go to the store */
	const struct run_since *since; /* NULL: the whole mesh */
	const struct run_calls *calls;
	void *ctx;
};

/* Holds the dataset. -ERR_BUSY: no memory for the view now; -ERR_PROTO: the view. */
int run_new(const struct run_params *, struct run **ret, struct err *err);
struct run *run_free(struct run *); /* only after `ended`, or before run_begin. NULL is fine; returns NULL */
/* Its slot was granted. Again, if the run has released its slot and sought another. */
void run_begin(struct run *);
void run_stop(struct run *, const struct err *why); /* `ended` comes with `why` as soon as no worker is busy with it */
void run_settle(struct run *);                      /* each round of the loop: starts what can start */
void run_tick(struct run *);                        /* each timer tick */
void run_set_rank(struct run *, enum sched_rank);   /* of its next tasks */

/* False: the run has an output, or is too far for one. */
bool run_attach(struct run *, struct run_output *);
struct run_output *run_output(const struct run *); /* NULL: none is attached */
struct run_output *run_detach(struct run *);       /* the output is the caller's again; NULL: there was none */

/* ---- its progress ---- */

/* Why it makes no progress, for example "memory: needs 134M, 20M are free"; "": it does. Returns buf. */
char *run_waiting(const struct run *, char *buf, size_t size);
uint64_t run_space_missing(const struct run *); /* bytes of disk that it waits for; 0: it does not wait for disk */
double run_seconds_left(const struct run *);    /* estimate, without waiting; 0: unknown */
double run_worked(const struct run *);          /* seconds in which a task of it ran */
const char *run_phase(const struct run *);      /* "select", "simplify", "check" or "mesh" */
void run_progress(const struct run *, uint64_t *ret_points, uint64_t *ret_total, uint64_t *ret_domains,
		  uint64_t *ret_domains_total);
size_t run_emitted(const struct run *);                                      /* domains, from the first */
void run_seconds(const struct run *, double *ret_plan, double *ret_domains); /* up to the plan; from there on */
uint64_t run_first_ns(const struct run *);                                   /* when the first triangles were there; 0: not yet */
void run_held(const struct run *, uint64_t held[LEDGER_NAMES]);              /* adds the bytes that it holds */

/* ---- its plan and its result ---- */

const struct cut_plan *run_plan(const struct run *);
const struct pipe_budget *run_budget(const struct run *);
const struct dataset *run_dataset(const struct run *);
const struct view *run_view(const struct run *);
/* Of a view with max-error or max-points, when its points are chosen; otherwise NULL. */
const struct simplify_report *run_simplified(const struct run *);
const struct pipe_totals *run_totals(const struct run *); /* after `ended` without why */
/* Domains that were not triangulated for it; of one that only plans, domains that need not be. */
uint64_t run_reused(const struct run *);
uint64_t run_grid_points(const struct run *);
/* Points of class 2 (ground), and of others that the view does not take for noise, in the generation. False: lower bounds, since
 * segments also have records of other generations, not all of which were looked at. After `ended` without why. */
bool run_classes(const struct run *, uint64_t *ret_ground, uint64_t *ret_other);
uint64_t run_cropped(const struct run *);  /* pieces of lines that have an end outside of the crop, and are not in the mesh */
bool run_unclassified(const struct run *); /* no point of the generation has class 2 or 8 */
/* Weights are by class, and the view takes points of class 0 or 1, which have none: most of its points, or no other has one. */
bool run_unweighted(const struct run *);
/* After `ended` without why, of a run with `since`: -ERR_DIGEST unless the older mesh with the changes is the job's mesh. */
int run_change_agrees(const struct run *, struct err *err);

#endif
