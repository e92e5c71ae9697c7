/* What the files of this room share. Loop unless a function says otherwise. */
#ifndef JOB_PRIV_H
#define JOB_PRIV_H

#include "admission.h"
#include "core.h"
#include "dataset.h"
#include "history.h"
#include "job.h"
#include "run.h"

enum { JOBS_OPEN_MAX = 4096 };
/* Bytes of the texts of all jobs' views. Large areas make them large: one text has up to VIEW_TEXT_MAX. */
enum { JOBS_VIEWS_MAX = 4 << 20 };

struct job {
	struct job *next; /* in jobs.jobs, by id */
	struct jobs *jobs;
	bool unpacked; /* a copy of a packed job (history.h) */
	uint64_t id, generation;
	struct dataset *dataset; /* held; NULL: it was deleted */
	char *view;              /* canonical text */
	size_t charged;          /* bytes of LEDGER_JOBS */
	enum job_state state;
	struct peer peer;
	enum job_priority priority;
	bool bound;   /* it ends with its client, and has no row */
	bool planned; /* its run has a plan */
	bool has_report, has_error;
	bool cancel;      /* requested */
	bool waiting_row; /* its first row is on its way to the catalogue */
	bool removed;     /* nobody finds it; it is freed when nothing uses it */
	int64_t submitted_us, finished_us;
	uint64_t begun_ns; /* monotonic, in this daemon */
	struct slot slot;
	bool slot_granted; /* and the run not made yet */
	struct run *run;   /* NULL: none */
	bool run_ended;
	struct plan_file *plan;
	struct job_report report;
	struct err err;
	struct job_fetch *fetches;
	uint64_t reported_ns;        /* when `changed` was called last */
	uint64_t waiting_checked_ns; /* when waiting_text was compared last */
	char waiting_text[96];       /* what it waits for, as reported */
	bool progressed;             /* since reported_ns */
	void (*accepted)(void *token, const struct err *why, struct job *);
	void *token;
};

/* A stream of a mesh that is not the output of the job's own run. */
struct job_fetch {
	struct job_fetch *next;
	struct job *job;
	struct run_output *output; /* NULL: the run has it, or its client left */
	struct slot slot;
	bool slot_granted;
	struct run *run;
	bool run_ended;
	struct err why;
	char *window; /* the view, for a window of the job's mesh; otherwise NULL */
	uint64_t begun_ns;
	struct run_since since; /* for a stream of changes */
	char waiting_text[96];  /* what it waits for, as reported */
};

/* A plan that was asked for without a job. */
struct job_plan_request {
	struct job_plan_request *next;
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
	struct job *jobs; /* active ones; all jobs: history.h */
	struct history *history;
	int64_t aged_us;     /* when no job was too old; real time */
	uint64_t *deletions; /* deletions.c */
	size_t ndeletions, deletions_room;
	struct job *spare; /* memory for the next job, while jobs are loaded */
	struct job_plan_request *plans;
	uint64_t last_job;
};

#define ABOUT_JOB(j)                                                                    \
	(&(const struct log_about){.job = (j)->id,                                      \
				   .dataset = (j)->dataset ? (j)->dataset->name : NULL, \
				   .generation = (j)->generation,                       \
				   ABOUT_USER((j)->peer.uid),                           \
				   .pid = (j)->peer.pid})

/* jobs.c */
void jobs_pack_finished(struct jobs *); /* all active jobs that can be packed */
/* Removes the oldest finished job of the user who has most of `kind`, with `more` added for `uid`. False: there is none. */
bool jobs_forget_one(struct jobs *, enum history_kind, uint32_t uid, uint64_t more);

/* job.c */
/* A new, active job. It owns `view` from here on. NULL: err says why, and `view` stays the caller's. */
struct job *job_add(struct jobs *, uint64_t id, char *view, const struct peer *, struct err *err);
struct job *job_free(struct job *); /* NULL is fine; returns NULL */
void job_release(struct job *);     /* frees what it owns, but not itself */
size_t job_bytes(size_t view);      /* charged for an active job whose view's text has that many bytes */
int job_put_row(struct job *, catalogue_done_fn done, struct err *err);

/* job_state.c */
void job_step(struct job *); /* steps through the states until one waits */
void job_settle(struct job *);
void job_tick(struct job *);
void job_slot_init(struct job *);  /* when peer and priority are known */
void job_record_end(struct job *); /* writes the last row, and logs the end */

/* job_event.c */
void job_event_end(const struct job *);

/* job_view.c */
/* The canonical text of a view that was asked of this dataset, which has a generation. The caller frees it. */
int job_view(const char *text, const struct dataset *, char **ret, struct err *err);

/* job_waiting.c */
/* Reads the word of a priority; "" and NULL leave *ret. -ERR_USAGE, -ERR_PERM. */
int job_priority_read(const char *text, const struct peer *, enum job_priority *ret, struct err *err);
void job_set_priority(struct job *, enum job_priority);
void job_waiting(const struct job *, struct job_info *ret); /* sets the fields about waiting */

/* job_plan_file.c */
int job_plan_file_new(struct job *, struct err *err); /* sets job->plan; no file is touched */
void job_plan_file_drop(struct job *);                /* removes the file in the background */
void job_plan_file_sweep(struct jobs *);              /* removes, later, the plans of jobs that do not exist */

/* job_plan.c */
void job_plans_settle(struct jobs *);
void job_plans_park(struct jobs *);

/* deletions.c: rows to delete, of jobs that were dropped while the catalogue was loaded */
int deletions_add(struct jobs *, uint64_t id, struct err *err);
void deletions_settle(struct jobs *);
void deletions_free(struct jobs *);

/* report.c */
char *report_text(const struct job_report *, char *buf, size_t size);
void report_parse(const char *text, struct job_report *ret);
void report_make(const struct pipe_totals *, struct job_report *ret);
void report_window(struct job_report *); /* turns it into the report of a window */
/* What was chosen for a view with max-error or max-points; no effect on others. */
void report_simplified(struct job_report *, const struct run *);
/* It is of an older acutd that left positions without triangles out of the mesh, so the mesh cannot be made again. */
bool report_without_flat(const struct job_report *);

#endif
