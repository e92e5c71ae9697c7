/*
 * Jobs: the mesh of a generation through a view; streams of such meshes; plans without a job.
 *
 * Loop thread; only the calls encode, spool and refill of an output (run.h) come from workers. A function that takes `token`
 * answers exactly once, perhaps before it returns; `why` is NULL on success and valid during the call only. Functions that return
 * int give 0 or -ERR_X.
 */
#ifndef JOB_H
#define JOB_H

#include <stdatomic.h>

#include "core.h"
#include "decimal.h"
#include "run.h"
#include "view.h"

struct admission;
struct dataset;
struct datasets;
struct job;
struct jobs;

enum job_state {
#define JOB_STATE(name, wire, next) JOB_##name,
#include "job_state.def"
#undef JOB_STATE
	JOB_STATES
};
const char *job_state_text(enum job_state); /* its name on the wire */
bool job_state_final(enum job_state);       /* the job is finished */

/* ---- all jobs ---- */

struct jobs_params {
	struct core *core;
	struct admission *admission;
	struct datasets *datasets;
	struct runs *runs;
	/* A job was accepted, has progressed, or ended. */
	void (*changed)(void *ctx, struct job *);
	void *ctx;
};
int jobs_new(const struct jobs_params *, struct jobs **ret, struct err *err);
struct jobs *jobs_free(struct jobs *); /* NULL is fine; returns NULL */
/* The start, before the loop runs: all rows of the catalogue, then jobs_loaded with the largest number that it has given out. */
int job_load(struct jobs *, const struct catalogue_job *, struct err *err);
void jobs_loaded(struct jobs *, uint64_t last);

void jobs_settle(struct jobs *); /* each round of the loop: starts what can start */
void jobs_tidy(struct jobs *);   /* each round, last: packs and forgets finished jobs. Ends what job_find gave */
void jobs_tick(struct jobs *);   /* each timer tick */
void jobs_park(struct jobs *);   /* the daemon stops: bound jobs end, unbound ones stay queued for the next start */

bool jobs_busy(const struct jobs *, bool queued); /* a run, stream or plan is active; `queued`: or a job is unfinished */
double jobs_longest(const struct jobs *);         /* seconds since the oldest active run began; negative: there is none */
void jobs_count(const struct jobs *, uint32_t *ret_running, uint32_t *ret_waiting);          /* unfinished jobs */
unsigned jobs_owned(const struct jobs *, uint32_t uid);                                      /* unfinished jobs of that user */
void jobs_unfinished(const struct jobs *, void (*each)(void *ctx, uint32_t uid), void *ctx); /* the user of each */
struct jobs_stat {
	uint64_t states[JOB_STATES];          /* unfinished jobs */
	uint64_t kept;                        /* all jobs */
	uint64_t waiting_space;               /* jobs that wait for disk space */
	double oldest_waiting;                /* seconds since the oldest queued job was submitted; 0: none is queued */
	uint64_t domains_done, domains_total; /* of running jobs; total 0: not planned yet */
};
void jobs_stat(const struct jobs *, struct jobs_stat *ret);
void jobs_held(const struct jobs *, void (*each)(void *ctx, const struct core_holder *), void *ctx);
size_t jobs_kept(const struct jobs *); /* number of all jobs */
/* Numbers of all jobs (room for jobs_kept), those with a dataset first. Returns how many have one. */
size_t jobs_list(const struct jobs *, uint64_t *ret);

/* ---- one job ---- */

enum job_priority { JOB_PRIORITY_NORMAL, JOB_PRIORITY_LOW, JOB_PRIORITY_HIGH, JOB_PRIORITIES };
const char *job_priority_text(enum job_priority);

struct job_report {
	uint64_t points, used, vertices, triangles, hull, domains, halo;
	uint64_t domains_reused;      /* of `domains`: not triangulated for this job */
	uint64_t removed[VIEW_RULES]; /* points that each rule of the view removed */
	char digest[DIGEST_HEX_SIZE], vertex_digest[DIGEST_HEX_SIZE];
	double seconds, stage_seconds, first_triangle_seconds; /* the last: 0 without triangles */
	uint64_t points_read, cells_read;                      /* records read for plan and domains; cells read for halos */
	uint64_t window;                                       /* 1: of a window; sums of a whole mesh mean nothing then */
	uint64_t all_out;                                      /* 1: no vertices, as all triangles are out of its areas */
	double worked_seconds;                                 /* in which a task of it ran */
	double seal_seconds, plan_seconds, domains_seconds;    /* of the staging; up to the plan; from there to the end */
	uint64_t peak_rss;                                     /* bytes, of the daemon */
	char most[96]; /* the position that most points of the view share: "POINTS X Y", in coordinates; "": none is shared */
	/* Of a view with max-error or max-points: positions of all its points; those kept; rounds that added some; bounds that
	 * were tried; the bound that holds, in units of the heights ("": another view); the greatest distance of a point. */
	uint64_t positions, kept, rounds, attempts;
	char max_error[DECIMAL_TEXT_SIZE], largest_error[DECIMAL_TEXT_SIZE];
	char note[160]; /* a sentence, for example about a mesh without triangles; "": none */
};
/* Texts and pointers are borrowed from the job. */
struct job_info {
	uint64_t id, generation;
	struct dataset *dataset; /* NULL: it was deleted */
	const char *dataset_name, *view;
	enum job_state state;
	struct peer peer;
	bool bound;
	int64_t submitted_us, finished_us;
	enum job_priority priority;
	char waiting[96];       /* what it waits for, in words; "": nothing */
	uint64_t space_missing; /* bytes of disk that it waits for; 0: it does not wait for disk */
	unsigned position;      /* in the queue for a slot, from 1; 0: it is not in the queue */
	double seconds_left;    /* estimate, without waiting; 0: unknown */
	const char *phase;      /* run_phase */
	uint64_t points_done, points_total, domains_done, domains_total;
	const struct job_report *report; /* NULL unless done */
	const struct err *err;           /* NULL unless failed or cancelled */
};
struct job_params {
	struct dataset *dataset;
	uint64_t generation;  /* 0: the newest */
	const char *view;     /* canonical text; "": the default view */
	const char *priority; /* its word; NULL or "": normal, or that of the earlier job. "high": administrators only */
	bool bound;           /* the job belongs to its client: job_leave ends it, and no restart continues it */
	bool fresh;           /* a new job even if there is one with the same generation and view */
	struct peer peer;
};
/* Answers with a new job, or with an earlier one of the same mesh. An unbound job is accepted when the catalogue has it.
 * -ERR_USAGE, -ERR_PERM, -ERR_NOTFOUND, -ERR_LIMIT, -ERR_BUSY. */
void job_submit(struct jobs *, const struct job_params *, void (*accepted)(void *token, const struct err *why, struct job *),
		void *token);
/* Whether weights in the request of a view name files: then job_sources makes it one that job_submit takes, in that generation.
 * `paths`: names are compared with the paths of files, too. -ERR_NOTFOUND: a name means no file; -ERR_LIMIT: there are too many
 * names, or numbers. It may take a second; -ERR_CANCELLED: `left` was set meanwhile (NULL: never). The bytes are those that it
 * needs meanwhile, which the caller charges. */
bool job_names_files(const char *text);
size_t job_sources_bytes(const struct grid_manifest *);
int job_sources(const char *text, const struct grid_manifest *, uint64_t generation, bool paths, const atomic_bool *left,
		char **ret, struct err *err);
/* NULL: no job that this peer may see. A finished job is valid until the next jobs_tidy; search for it again then. */
struct job *job_find(struct jobs *, uint64_t id, const struct peer *);
struct job *job_after(struct jobs *, uint64_t id, const struct peer *); /* the next number above `id` */
void job_info(const struct job *, struct job_info *ret);
void job_cancel(struct job *);                 /* nothing if it is finished */
int job_remove(struct job *, struct err *err); /* -ERR_BUSY: it is not finished */
void job_leave(struct job *);                  /* the client of a bound job has left: cancels and removes it */

/* ---- the mesh of a job ---- */

/* The text of the job's view with a window; the caller frees it. `area`: as in protocol.md. -ERR_USAGE, -ERR_GONE. */
int job_window(const struct job *, const char *area, char **ret, struct err *err);
/* Streams the mesh of the job into `output`; output->calls->end comes once. A new bound job sends its own blocks as it makes
 * them. A running unbound job is followed through the store. Otherwise the stream waits until the job is done. */
void job_fetch(struct job *, struct run_output *output);

/* ---- plans ---- */

struct job_plan {
	uint64_t points, domains, domains_reused, memory_bytes, disk_bytes;
	bool exact; /* numbers of points are exact */
	uint32_t load, threads;
	double seconds; /* estimate, from the newest suitable job; 0: there is none */
};
/* Plans a mesh without making it. The errors of job_submit. */
void job_plan(struct jobs *, struct dataset *, uint64_t generation, const char *view, const struct peer *,
	      void (*planned)(void *token, const struct err *why, const struct job_plan *), void *token);

#endif
