/* What the files of this room share: the service and what lives in it. */
#ifndef JOB_PRIV_H
#define JOB_PRIV_H

#include <stdatomic.h>

#include "admission.h"
#include "core.h"
#include "history.h"
#include "job.h"
#include "run.h"

enum { DATASET_NAME_MAX = 64, JOBS_OPEN_MAX = 4096, PUSHES_MAX = 1024 };
/* But for the texts of views with large areas, which are counted: of all jobs, and one text has up to VIEW_TEXT_MAX. */
enum { JOBS_VIEWS_MAX = 4 << 20 };

/* A push that was interrupted, until somebody takes it up. Holds its dataset. */
struct pending {
	struct pending *next;
	uint64_t id, points;
	uint32_t uid, files;
	int64_t left_us;
};
enum { PENDING_BYTES = 64 }; /* charged; with its place in the heap */

struct dataset {
	struct dataset *next; /* named: by id; one-step ones follow in no order */
	struct jobs *jobs;
	uint64_t id;
	char name[DATASET_NAME_MAX + 1];
	uint32_t uid, gid, mode, files;
	int64_t created_us, pushed_us;
	char manifest[64]; /* "": no generation yet */
	uint64_t generation, points, bytes;
	uint64_t oldest;    /* generation that can be read; 0: there is none */
	uint32_t segments;  /* of the newest manifest; 0: not known yet */
	bool merge_due;     /* there may be something to merge */
	uint64_t prune_to;  /* a prune is at work: what is before that will go; 0: none is */
	unsigned reverting; /* reverts that were asked for and are not over: no prune begins */
	unsigned rows;      /* that name another manifest, on their way to the catalogue: no other row of it may follow them */
	int64_t removed_us; /* 0: it is there */
	bool pinned;
	char *lattice, *crs, *unit_xy, *unit_z;
	int32_t box[4];
	bool onestep;
	bool partial; /* only views inside of this box can be served: more was not read */
	double crop[4];
	unsigned users;  /* pushes, runs, jobs and holders; a one-step dataset goes with the last */
	unsigned opened; /* users of dirfd */
	int dirfd;
	bool named; /* its folder's name is on the disk */
	unsigned pushes;
	struct push *planner;  /* fixes the lattice */
	const void *committer; /* publishes the next manifest: a push, or a rewriting (merge, prune) */
	unsigned readers;      /* of its newest manifest by name: dataset_read_begin */
	uint32_t next_source;
	struct pending *pending;
	bool tidied;                        /* by dataset_tidy */
	bool row;                           /* the catalogue has one */
	bool sweep;                         /* at the start: pushes left something */
	bool swept_once;                    /* and the row that says so goes */
	bool unswept;                       /* what they left cannot be read: it stays */
	double stage_seconds, seal_seconds; /* of the last push; the second is a part of the first */
	size_t charged;                     /* of LEDGER_JOBS */
	atomic_uint_fast64_t derived;       /* of a one-step one: domains and selections in its folder, bytes */
};

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
	struct job_output *output;
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
	void (*changed)(void *ctx, struct job *);
	void *changed_ctx;
	struct verified verified;
	struct recency *recency,
		*summaries; /* of stored domains: struct store_id, struct pipe_summary; any thread; NULL: no memory */
	int geoidsfd;       /* state/geoids */
	uint64_t counted_ns;
	struct dataset *datasets;
	struct push *pushes;
	struct job *jobs; /* at work: not over, or read, or about to go. All: history.h */
	struct history *history;
	int64_t aged_us;       /* when jobs that are too old were looked for */
	struct loaded *loaded; /* datasets by id, while the catalogue is loaded */
	struct dataset *last_loaded;
	uint64_t *deletions; /* deletions.c */
	size_t ndeletions, deletions_room;
	struct job *spare; /* while jobs are loaded: what the one before was made in */
	size_t nloaded;
	struct job_asked_plan *plans;
	uint64_t expired_ns; /* when removed datasets were looked at */
	struct {
		int64_t us;
		uint64_t at_ns, ahead_ns; /* when it was told; since when the clock is ahead of it, 0: it is not */
	} trusted;                        /* the time that removed datasets and interrupted pushes go by (dataset_remove.c) */
	struct dataset_rewrite *merge;    /* that is at work */
	struct prune *prunes;             /* the first is at work, if no merge is */
	struct dataset_old *olds;         /* that wait until nobody opens them */
	bool merges_due;                  /* a dataset may have something to merge */
	uint64_t merge_after_ns;          /* none begins before */
	double merge_wait;                /* seconds that the last one was put off for want of space; 0: it was not */
	struct dataset_change *changes;   /* that wait for their turn */
	struct verb *verbs;               /* dataset_remove.c: likewise */
	uint64_t last_dataset, last_job, last_onestep, last_select;
	struct looks {                  /* health.c */
		struct looking *now;    /* is under way; NULL: none is */
		struct look_wait *next; /* wait for another one */
		struct health last;
		uint64_t last_ns; /* when that look began; 0: there is none that still holds */
	} looks;
	struct cache_verify *verify; /* that goes on; NULL: none */
	struct backup *backups;      /* and exports, that are open */
	uint64_t last_backup, last_import;
};

/* What log_event is told. */
#define ABOUT_DATASET(d) (&(const struct log_about){.dataset = (d)->name, .generation = (d)->generation, ABOUT_USER((d)->uid)})
#define ABOUT_JOB(j)                                                                    \
	(&(const struct log_about){.job = (j)->id,                                      \
				   .dataset = (j)->dataset ? (j)->dataset->name : NULL, \
				   .generation = (j)->generation,                       \
				   ABOUT_USER((j)->peer.uid),                           \
				   .pid = (j)->peer.pid})

/* tell.c: what the log hears of ends, and what is counted since the start. Loop. */
/* verified.c: the last verification that came to its end, beyond a restart */
void verified_load(struct jobs *); /* reads the disk */
void verified_note(struct jobs *, const struct cache_verified *);

void job_tell_end(const struct job *);
/* What was pushed is damaged, if `why` says so. */
void event_damage(const struct log_about *, const struct err *why);

/* disk_points.c */
void disk_count(struct jobs *);              /* what the lists of datasets and pushes say */
uint64_t disk_points_bytes(uint64_t points); /* of a segment of so many points, with its index, at most */

/* cache_verify.c */
void cache_verify_tick(struct jobs *);
/* cache_gc.c */
int cache_may(const struct peer *, const char *what, struct err *err); /* admins */

struct pending *pending_new(struct jobs *, uint32_t uid, struct err *err); /* NULL: err says why */
struct pending *pending_free(struct jobs *, struct pending *);

/* health.c: something changed, and a look that began before it says nothing any more */
void health_changed(struct jobs *);

/* dataset_old.c: what a newer manifest does not name any more */
/* Loop: from taking d->manifest until a worker has opened what it names, or has given up; runs that open count
 * without it. No file of the newest manifest of that time goes meanwhile. */
void dataset_read_begin(struct dataset *);
void dataset_read_end(struct dataset *);
/* Names of files that go; room for so many. Any thread. */
struct dataset_old *dataset_old_new(size_t names);
struct dataset_old *dataset_old_free(struct dataset_old *);
void dataset_old_add(struct dataset_old *, const char *name);
/* Loop: they go when they can, and then that row of a push (0: none). `old` is not the caller's any more. */
void dataset_old_goes(struct dataset_old *old, struct dataset *, uint64_t row);
void dataset_old_settle(struct jobs *);
void dataset_old_forget(struct jobs *); /* at the end: the next start finds them */

/* dataset_merge.c */
bool merge_due(const struct grid_manifest *);
bool merge_due_likely(uint32_t segments); /* where only their number is known */
void dataset_merge_settle(struct jobs *);
bool merge_at_work(const struct dataset *);

/* dataset_rewrite.c: the row is not of a push, but of a merge or prune; what it made is to be swept away */
bool rewrite_row(const struct catalogue_push *);

/* dataset_prune.c */
void dataset_prune_settle(struct jobs *);
void dataset_prune_tick(struct jobs *);
void dataset_prunes_park(struct jobs *);

/* dataset.c */
/* Of this owner and his first group; its mode is DATASET_MODE. */
struct dataset *dataset_new(struct jobs *, const char *name, const struct peer *owner, bool onestep, struct err *err);
struct dataset *dataset_free(struct dataset *);
bool dataset_name_valid(const char *name);
/* Its folder; balanced by dataset_close. Opens (and makes) it on a worker's or the starting thread. */
int dataset_open(struct dataset *, struct err *err);
void dataset_close(struct dataset *);
void dataset_row(const struct dataset *, struct catalogue_dataset *ret);
/* A dataset that has nothing yet is in the catalogue before its first push promises anything. */
int dataset_put_row(struct dataset *, struct err *err);
bool dataset_created(const struct dataset *); /* before its first push, by dataset_create */
int dataset_load(struct jobs *, const struct catalogue_dataset *, struct err *err);
/* Removes what no manifest of the dataset names. Reads the disk. */
int dataset_sweep(struct dataset *, bool again, struct err *err); /* again: the next start does it, too */

/* dataset_change.c: its committer, with the folder open and before a manifest is made: once, what a crash left of others goes.
 * Worker. */
void dataset_tidy(struct dataset *, const char *newest);
void dataset_drop(struct dataset *); /* nobody uses it: out of list and catalogue, its folder goes in the background */

/* dataset_remove.c */
int64_t dataset_until_us(const struct dataset *); /* it can be restored; 0: it is there */
int64_t jobs_trusted_us(struct jobs *);           /* by which what was pushed may go: no clock that jumps ahead */
void datasets_expire(struct jobs *);              /* what was removed so long ago that it goes */
void datasets_tick(struct jobs *);

/* dataset_change.c (dataset_change.h): what is no push */
void dataset_changes_settle(struct jobs *);
void dataset_verbs_settle(struct jobs *);

/* dataset_next.c: what the next manifest makes of a dataset. */
struct dataset_next {
	char *lattice, *crs, *unit_xy, *unit_z, manifest[64];
	uint64_t generation, oldest, points, bytes;
	uint32_t files, segments, next_source;
	int64_t pushed_us;
	int32_t box[4];
	bool merge_due;
	struct dataset_old *old; /* names the manifest that was the newest until then */
};
/* All that can fail, before the catalogue is asked. */
int dataset_next_make(const struct dataset *, const struct grid_manifest *, const char *manifest, int64_t pushed_us,
		      struct dataset_next *ret, struct err *err);
void dataset_next_clear(struct dataset_next *);
/* Queues the row; with it goes the row of `push` (0: of none). */
int dataset_next_put(struct dataset *, const struct dataset_next *, uint64_t push, catalogue_done_fn done, void *ctx,
		     struct err *err);
/* The row is durable. Clears `next`. old_is_read: somebody opens the manifest before it, which goes later. */
void dataset_become(struct dataset *, struct dataset_next *next, bool old_is_read);

/* dataset_generation.c */
/* m->generations becomes the base's (NULL: there is none) and m->generation, as its sources have it; to be freed.
 * Workers. */
int generation_note(struct grid_manifest *m, const struct grid_manifest *base, const struct peer *, enum grid_generation_kind,
		    uint64_t undoes, struct err *err);

/* push_pending.c */
int pending_load(struct dataset *, const struct catalogue_push *, bool *ret_stays, struct err *err);
void pending_expire(struct dataset *);
void pending_forget(struct dataset *); /* all of them; their files go with the dataset's folder */
int64_t pending_until_us(const struct pending *);

/* push.c */
void push_tick(struct push *);
struct push *push_next(const struct push *);
void push_retry(struct push *);
void push_remove_files(struct push *);

/* dataset_rights.c: rights_allow, with a sentence. -ERR_PERM */
int rights_dataset(const struct dataset *, const struct peer *, enum right, struct err *err);

/* job.c */
void job_step(struct job *);
void job_tick(struct job *);
/* `view` becomes the job's, unless there is no memory: then NULL. */
struct job *job_add(struct jobs *, uint64_t id, char *view, const struct peer *, struct err *err);
int job_put_row(struct job *, catalogue_done_fn done, struct err *err);
void job_over(struct job *); /* its last row, and the log */
int job_load(struct jobs *, const struct catalogue_job *, struct err *err);
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

/* jobs.c, admit.c */
struct dataset *dataset_loaded(struct jobs *, uint64_t id); /* at the start; NULL: there is none */
void jobs_put_away(struct jobs *);                          /* those that are over and that nobody looks at: history_keep */
/* A job that is over and that nobody looks at goes: the oldest of the user who has most of that (`more` counted with
 * those of `uid`). False: there is none. */
bool jobs_forget_one(struct jobs *, enum history_kind, uint32_t uid, uint64_t more);
/* job_limit.c: what one user may have; none of it holds admins. -ERR_LIMIT, with the setting's name as field. */
int limit_jobs(const struct jobs *, const struct peer *, struct err *err);     /* one more */
int limit_datasets(const struct jobs *, const struct peer *, struct err *err); /* likewise */

#endif
