/* What the files of this room share. */
#ifndef JOB_PRIV_H
#define JOB_PRIV_H

#include "admission.h"
#include "core.h"
#include "dataset.h"
#include "history.h"
#include "job.h"
#include "run.h"

enum { JOBS_OPEN_MAX = 4096 };
/* But for the texts of views with large areas, which are counted: of all jobs, and one text has up to VIEW_TEXT_MAX. */
enum { JOBS_VIEWS_MAX = 4 << 20 };

struct job {
	struct job *next; /* of those at work, by id */
	struct jobs *jobs;
	bool guest; /* history.c: to be read, until the next round of the loop */
	uint64_t id, generation;
	struct dataset *dataset;
	char *view;
	size_t charged; /* of LEDGER_JOBS */
	enum job_state state;
	struct peer peer;
	enum job_priority priority;
	bool bound, planned, has_report, has_error, left, stop, waiting_row, removed;
	int64_t submitted_us, finished_us;
	uint64_t begun_ns; /* monotonic, of this run of the daemon */
	struct slot slot;
	bool placed; /* granted, and not begun */
	struct run *run;
	bool run_ended;
	struct plan_file *plan;
	struct job_report report;
	struct err err;
	struct job_fetch *fetches;
	uint64_t told_ns;   /* when `changed` last told progress */
	uint64_t looked_ns; /* when it was last seen what it waits for */
	char waited[96];    /* as told */
	bool moved;
	void (*accepted)(void *token, const struct err *why, struct job *);
	void *token;
};

/* A stream of a mesh that is not the job's own run. */
struct job_fetch {
	struct job_fetch *next;
	struct job *job;
	struct run_output *output;
	struct slot slot;
	bool placed;
	struct run *run;
	bool run_ended;
	struct err why;
	char *window; /* the view, of a window of the job's mesh; else NULL */
	uint64_t begun_ns;
	struct run_since since; /* of a stream of changes */
	char waited[96];        /* for what, as its client was told */
};

struct job_asked_plan {
	struct job_asked_plan *next;
	struct jobs *jobs;
	struct slot slot;
	struct run *run;
	struct peer peer;
	bool run_ended;
	struct err err;
	bool failed;
	void (*planned)(void *token, const struct err *why, const struct job_plan *);
	void *token;
};

struct jobs {
	struct core *core;
	struct admission *admission;
	struct datasets *datasets;
	void (*changed)(void *ctx, struct job *);
	void *changed_ctx;
	struct runs *runs;
	struct job *jobs; /* at work: not over, or read, or about to go. All: history.h */
	struct history *history;
	int64_t aged_us;     /* when jobs that are too old were looked for */
	uint64_t *deletions; /* deletions.c */
	size_t ndeletions, deletions_room;
	struct job *spare; /* while jobs are loaded: what the one before was made in */
	struct job_asked_plan *plans;
	uint64_t last_job;
};

/* What log_event is told. */
#define ABOUT_JOB(j)                                                                    \
	(&(const struct log_about){.job = (j)->id,                                      \
				   .dataset = (j)->dataset ? (j)->dataset->name : NULL, \
				   .generation = (j)->generation,                       \
				   ABOUT_USER((j)->peer.uid),                           \
				   .pid = (j)->peer.pid})

/* job_event.c */
void job_tell_end(const struct job *);

/* job.c */
void job_step(struct job *);
void job_tick(struct job *);
/* `view` becomes the job's, unless there is no memory: then NULL. */
struct job *job_add(struct jobs *, uint64_t id, char *view, const struct peer *, struct err *err);
int job_put_row(struct job *, catalogue_done_fn done, struct err *err);
void job_over(struct job *); /* its last row, and the log */
struct job *job_free(struct job *);
void job_done_with(struct job *); /* all of it but itself goes */
size_t job_bytes(size_t view);    /* charged for one at work */
/* Where its plan is kept. */
int job_plan_new(struct job *, struct err *err);
/* Its plan's file goes, later. */
void job_plan_drop(struct job *);
/* Plans of jobs that are not there any more go, later. */
void job_plan_sweep(struct jobs *);
/* deletions.c: rows of jobs that gave way while the catalogue was loaded. */
int deletions_add(struct jobs *, uint64_t id, struct err *err);
void deletions_settle(struct jobs *);
void deletions_free(struct jobs *);
void job_settle(struct job *);
void job_slot_init(struct job *); /* when its peer and priority are known */
void job_plans_settle(struct jobs *);
void job_plans_park(struct jobs *);
/* The canonical text, to be freed, of a view asked of this dataset, which has a generation. */
int job_view(const char *text, const struct dataset *, char **ret, struct err *err);

/* job_waiting.c: what a job waits for, and what it asks to go before */
/* -ERR_USAGE: no such word; -ERR_PERM. "" leaves *ret. */
int job_priority_read(const char *text, const struct peer *, enum job_priority *ret, struct err *err);
void job_set_priority(struct job *, enum job_priority);
void job_waiting(const struct job *, struct job_info *ret); /* its fields about that */

/* report.c */
char *report_text(const struct job_report *, char *buf, size_t size);
void report_parse(const char *text, struct job_report *ret);
void report_make(const struct pipe_totals *, struct job_report *ret);
void report_window(struct job_report *); /* made so, but it is that of a window */
/* By an acutd that left positions without triangles out of the mesh: it says nothing of the mesh as it is made now. */
bool report_without_flat(const struct job_report *);

/* jobs.c */
void jobs_put_away(struct jobs *); /* those that are over and that nobody looks at: history_keep */
/* A job that is over and that nobody looks at goes: the oldest of the user who has most of that (`more` counted with
 * those of `uid`). False: there is none. */
bool jobs_forget_one(struct jobs *, enum history_kind, uint32_t uid, uint64_t more);

#endif
