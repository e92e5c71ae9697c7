/*
 * Jobs: the mesh of a generation through a view; the stream of a job's mesh; plans without a job. Loop; a run calls `encode`,
 * `spool` and `refill` of an output on workers.
 */
#ifndef JOB_H
#define JOB_H

#include "core.h"
#include "run.h"
#include "view.h"

struct admission;
struct dataset;
struct datasets;
struct job;
struct jobs;

/* ---- jobs ---- */

enum job_state {
#define JOB_STATE(name, wire, next) JOB_##name,
#include "job_state.def"
#undef JOB_STATE
	JOB_STATES
};
const char *job_state_text(enum job_state);
bool job_state_final(enum job_state);

/* ---- all of them ---- */

struct jobs_params {
	struct core *core;
	struct admission *admission;
	struct datasets *datasets;
	struct runs *runs;
	/* A job came to be, went on, or ended. */
	void (*changed)(void *ctx, struct job *);
	void *ctx;
};
int jobs_new(const struct jobs_params *, struct jobs **ret, struct err *err);
struct jobs *jobs_free(struct jobs *); /* NULL is fine; returns NULL */
/* The start, before the loop runs: rows of the catalogue, then jobs_loaded with the largest number that it has given. */
int job_load(struct jobs *, const struct catalogue_job *, struct err *err);
void jobs_loaded(struct jobs *, uint64_t last);
void jobs_settle(struct jobs *); /* starts what can start */
void jobs_tidy(struct jobs *);   /* forgets what is too old or too much */
void jobs_tick(struct jobs *);
void jobs_park(struct jobs *);                    /* bound jobs end, unbound jobs stay queued for the next start */
bool jobs_busy(const struct jobs *, bool queued); /* a run, stream or plan is at work; queued: or a job is not over */
double jobs_longest(const struct jobs *);         /* seconds that the oldest run is at work; negative: none is */
void jobs_count(const struct jobs *, uint32_t *ret_running, uint32_t *ret_waiting);
struct jobs_stat {
	uint64_t states[JOB_STATES]; /* jobs that are not over */
	uint64_t kept;               /* jobs, over ones included */
	uint64_t waiting_space;
	double oldest_waiting;                /* seconds since the oldest job that has not begun was submitted; 0: none waits */
	uint64_t domains_done, domains_total; /* of those that run; total 0: not planned yet */
};
void jobs_stat(const struct jobs *, struct jobs_stat *ret);
unsigned jobs_owned(const struct jobs *, uint32_t uid); /* unfinished ones of that user */
void jobs_unfinished(const struct jobs *, void (*each)(void *ctx, uint32_t uid), void *ctx);
void jobs_held(const struct jobs *, void (*each)(void *ctx, const struct core_holder *), void *ctx);
size_t jobs_kept(const struct jobs *); /* jobs, over ones included */
/* Their numbers, first those whose dataset is there: gives how many these are. */
size_t jobs_list(const struct jobs *, uint64_t *ret);

/* ---- one of them ---- */

enum job_priority { JOB_PRIORITY_NORMAL, JOB_PRIORITY_LOW, JOB_PRIORITY_HIGH, JOB_PRIORITIES };
const char *job_priority_text(enum job_priority);

struct job_report {
	uint64_t points, used, vertices, triangles, hull, domains, halo;
	uint64_t domains_reused; /* of `domains`: not triangulated for this job */
	uint64_t removed[VIEW_RULES];
	char digest[DIGEST_HEX_SIZE], vertex_digest[DIGEST_HEX_SIZE];
	double seconds, stage_seconds, first_triangle_seconds; /* the last: 0 if there was none */
	uint64_t points_read, cells_read;                      /* records, by the plan and by domains; cells, for halos */
	uint64_t window;                                       /* 1: of a view with one; what is of a whole mesh means nothing */
	double worked_seconds;                                 /* in which a worker or the disk was at it */
	double seal_seconds, plan_seconds, domains_seconds;    /* of staging; up to the plan; from there to the end */
	uint64_t peak_rss;
	char most[96];  /* the position that most points of the view share: "POINTS X Y", in coordinates; "": each has one */
	char note[160]; /* "" or a sentence, as for a mesh without triangles */
};
struct job_info {
	uint64_t id, generation;
	struct dataset *dataset; /* NULL: it is gone */
	const char *dataset_name, *view;
	enum job_state state;
	struct peer peer;
	bool bound;
	int64_t submitted_us, finished_us;
	enum job_priority priority;
	char waiting[96];     /* for what, in words; "": it does not */
	uint64_t lacks_space; /* bytes of disk that it waits for; 0: it does not */
	unsigned position;    /* among those that wait for their turn, from 1; 0: it has had it */
	double seconds_left;  /* at the pace of late, without waiting; 0: not known */
	const char *phase;    /* "select" (of points, for a view that selects) or "mesh" */
	uint64_t points_done, points_total, domains_done, domains_total;
	const struct job_report *report; /* NULL unless done */
	const struct err *err;           /* NULL unless failed or cancelled */
};
struct job_params {
	struct dataset *dataset;
	uint64_t generation;  /* 0 = the newest */
	const char *view;     /* canonical text; "" = the default view */
	const char *priority; /* its text; NULL, "": normal, or that of the earlier job. Above normal: -ERR_PERM, but
			       * for root and the daemon's own user */
	bool bound, fresh;
	struct peer peer;
};
/* Unbound jobs: `accepted` comes when the catalogue has it. */
void job_submit(struct jobs *, const struct job_params *, void (*accepted)(void *token, const struct err *why, struct job *),
		void *token);
/* NULL: none that this peer may see. One that is over is there until the next jobs_settle: it is looked for again then. */
struct job *job_find(struct jobs *, uint64_t id, const struct peer *);
struct job *job_after(struct jobs *, uint64_t id, const struct peer *);
void job_info(const struct job *, struct job_info *ret);
void job_cancel(struct job *);
/* -ERR_BUSY: it is not over. */
int job_remove(struct job *, struct err *err);
/* The owner of a bound job is gone. */
void job_leave(struct job *);

/* ---- the mesh of a job ---- */

/* The view of the job with a window, to be freed: `area` as PROTOCOL.md has it. */
int job_window(const struct job *, const char *area, char **ret, struct err *err);
/* Streams the mesh of `job` into `output`: a bound one that has just begun as it is made; one that runs as far as
 * it is stored, and on as it gets there; else when the job has begun or is done. */
void job_fetch(struct job *, struct run_output *output);

/* ---- plans ---- */

struct job_plan {
	uint64_t points, domains, domains_reused, memory_bytes, disk_bytes;
	bool exact;
	uint32_t load, threads;
	double seconds; /* at the pace of the newest finished job; 0: there is none to go by */
};
void job_plan(struct jobs *, struct dataset *, uint64_t generation, const char *view, const struct peer *,
	      void (*planned)(void *token, const struct err *why, const struct job_plan *), void *token);

#endif
