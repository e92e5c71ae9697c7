/* What the files of this room share: the house and what lives in it. */
#ifndef JOB_PRIV_H
#define JOB_PRIV_H

#include <pthread.h>
#include <stdatomic.h>

#include "catalogue.h"
#include "job.h"
#include "ledger.h"
#include "log.h"
#include "past.h"
#include "plan_file.h"
#include "rights.h"
#include "sched_pool.h"
#include "walk.h"

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

/* places.c: the turn of a job, stream or plan to be at work */
enum place_wait { PLACE_READY, PLACE_TURN, PLACE_USER, PLACE_SHARE, PLACE_FULL, PLACE_MEMORY };
struct place {
	struct place *next; /* of those that seek, by number */
	struct sched_owner owner;
	bool reader;                     /* its walk waits for whoever reads its output */
	void (*granted)(struct place *); /* no longer among those that seek: walk_begin now */
	/* of places.c */
	bool seeks, skip, seen, keeps;
	enum place_wait wait;
	uint64_t number, need, lacks, free;
	unsigned passed, held;
	int64_t service;
};

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
	unsigned users;  /* pushes, walks, jobs and holders; a one-step dataset goes with the last */
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
	bool guest; /* past.c: to be read, until the next round of the loop */
	uint64_t id, generation;
	struct dataset *dataset;
	char *view;
	size_t charged; /* of LEDGER_JOBS */
	enum job_state state;
	struct job_peer peer;
	enum job_priority priority;
	bool bound, planned, has_report, has_error, left, stop, waiting_row, removed;
	int64_t submitted_us, finished_us;
	uint64_t begun_ns; /* monotonic, of this run of the daemon */
	struct place place;
	bool placed; /* granted, and not begun */
	struct walk *walk;
	bool walk_ended;
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

/* A stream of a mesh that is not the job's own walk. */
struct job_fetch {
	struct job_fetch *next;
	struct job *job;
	struct job_output *output;
	struct place place;
	bool placed;
	struct walk *walk;
	bool walk_ended;
	struct err why;
	char *window; /* the view, of a window of the job's mesh; else NULL */
	uint64_t begun_ns;
	struct walk_since since; /* of a stream of changes */
	char waited[96];         /* for what, as its client was told */
};

struct job_asked_plan {
	struct job_asked_plan *next;
	struct jobs *jobs;
	struct place place;
	struct walk *walk;
	struct job_peer peer;
	bool walk_ended;
	struct err err;
	bool failed;
	void (*planned)(void *token, const struct err *why, const struct job_plan *);
	void *token;
};

struct jobs {
	struct jobs_params p;
	struct tally tally;
	struct verified verified;
	struct space *space;             /* accounts of the disk; any thread */
	struct hints *hints, *summaries; /* what the store has: which did last, and pipe_summary; any thread; NULL: no memory was
					    left for them */
	int datafd, onestepfd, domainsfd, tempfd, /* state/datasets, cache/one-step, cache/domains, cache/tmp */
		plansfd, geoidsfd;                /* state/plans, state/geoids */
	struct dataset *datasets;
	struct push *pushes;
	struct job *jobs; /* at work: not over, or read, or about to go. All: past.h */
	struct past *past;
	int64_t aged_us;       /* when jobs that are too old were looked for */
	struct loaded *loaded; /* datasets by id, while the catalogue is loaded */
	struct dataset *last_loaded;
	bool loading;
	uint64_t *drops; /* drops.c */
	size_t ndrops, drops_room;
	struct job *spare; /* while jobs are loaded: what the one before was made in */
	size_t nloaded;
	struct job_asked_plan *plans;
	uint64_t expired_ns; /* when removed datasets were looked at */
	struct {
		int64_t us;
		uint64_t at_ns, ahead_ns; /* when it was told; since when the clock is ahead of it, 0: it is not */
	} sure;                           /* the time that removed datasets and interrupted pushes go by (dataset_remove.c) */
	uint64_t lacks;                   /* bytes that house_take did not have, the most at a time (house_make_room) */
	struct dataset_rewrite *merge;    /* that is at work */
	struct prune *prunes;             /* the first is at work, if no merge is */
	struct dataset_old *olds;         /* that wait until nobody opens them */
	uint64_t rewriting;               /* memory that merge and prune hold */
	bool merges_due;                  /* a dataset may have something to merge */
	uint64_t merge_after_ns;          /* none begins before */
	double merge_wait;                /* seconds that the last one was put off for want of space; 0: it was not */
	struct dataset_change *changes;   /* that wait for their turn */
	struct verb *verbs;               /* dataset_remove.c: likewise */
	uint64_t last_dataset, last_job, last_push, last_onestep, last_select, last_flow;
	uint64_t emitter_share, index_share, stage_share, reserve, reserve_part;
	unsigned walks_max;
	struct rest { /* rest.c */
		uint64_t from_ns;
		bool over;
		struct sched_task *task[2];
		unsigned n;
	} rest;
	struct disk {
		uint64_t counted_ns, looked_ns;
		bool begun, busy;
	} disk;
	struct limits { /* limit.c */
		pthread_mutex_t lock;
		struct limit_row *row;
		size_t n, cap;
	} limits;
	struct looks {                  /* looked.c */
		struct looking *now;    /* is under way; NULL: none is */
		struct look_wait *next; /* wait for another one */
		struct house_looked last;
		uint64_t last_ns; /* when that look began; 0: there is none that still holds */
	} looks;
	struct cache_verify *verify; /* that goes on; NULL: none */
	unsigned background;         /* tasks of the house itself: removal of folders, probes for info */
	struct backup *backups;      /* and exports, that are open */
	uint64_t last_backup, last_import;
	bool parking;
	struct place *places; /* that are sought */
	unsigned nplaces;
	bool placing;
	uint64_t last_place, grants;
	struct push *stage_turn; /* has the next stage; NULL: nobody waits for one */
	uint64_t starved_ns;     /* since when the first in the queue lacks memory */
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

void tally_domain(struct jobs *, uint32_t triangles); /* that was triangulated */
void job_tell_end(const struct job *);
/* What was pushed is damaged, if `why` says so. */
void tell_damage(struct jobs *, const struct log_about *, const struct err *why);

/* disk.c: the house's side of the disk */
void disk_look(struct jobs *); /* folders that are gone, and what there is to measure or evict */
void disk_tick(struct jobs *);
/* The rest after a start. rest_submit counts the task in `background`, now or when the rest is over. */
void rest_begin(struct jobs *);
void rest_submit(struct jobs *, struct sched_task *);
bool rest_over(struct jobs *);
void rest_end(struct jobs *);
void rest_drop(struct jobs *);
void disk_mend(struct jobs *);               /* folders of the cache that somebody has removed */
void disk_count(struct jobs *);              /* what the lists of datasets and pushes say */
uint64_t disk_points_bytes(uint64_t points); /* of a segment of so many points, with its index, at most */

/* cache_verify.c */
void cache_verify_tick(struct jobs *);
/* cache_gc.c */
int cache_may(const struct job_peer *, const char *what, struct err *err); /* admins */

/* house.c: what is kept of datasets, jobs and pushes, taken of LEDGER_JOBS. -ERR_BUSY. */
int house_take(struct jobs *, uint64_t bytes, const char *what, struct err *err); /* for what ends by itself */
/* For what stays, of that user: leaves that part of all to what is below, and to the above. Old jobs that are over give way, of
 * the user first who has most of them: not to be called where one of them is in hand, or the next in a loop over them. */
enum house_lasting { HOUSE_DATASET = 8, HOUSE_JOB = 16 };
int house_take_lasting(struct jobs *, enum house_lasting, uint32_t uid, uint64_t bytes, const char *what, struct err *err);
/* For what found none since the last time, likewise; true: who waits for it may try again. */
bool house_make_room(struct jobs *);
void house_give(struct jobs *, uint64_t bytes);
uint64_t house_view_bytes(const char *text, unsigned areas); /* what a view of that text takes where points are judged by it */
struct pending *pending_new(struct jobs *, uint32_t uid, struct err *err); /* NULL: err says why */
struct pending *pending_free(struct jobs *, struct pending *);

/* looked.c: something changed, and a look that began before it says nothing any more */
void house_changed(struct jobs *);

/* dataset_old.c: what a newer manifest does not name any more */
/* Loop: from taking d->manifest until a worker has opened what it names, or has given up; walks that open count
 * without it. No file of the newest manifest of that time goes meanwhile. */
void dataset_read_begin(struct dataset *);
void dataset_read_end(struct dataset *);
/* Names of files that go; room for so many. Any thread. */
struct dataset_old *dataset_old_new(size_t names);
struct dataset_old *dataset_old_free(struct dataset_old *);
void dataset_old_add(struct dataset_old *, const char *name);
/* Loop: they go when they can, and then that row of a push (0: none). `old` is not the caller's any more. */
void dataset_old_goes(struct dataset_old *old, struct dataset *, uint64_t row);
/* A manifest that somebody opens now; without memory for that it stays until a sweep. */
void dataset_old_manifest(struct dataset *, const char *name);
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
struct dataset *dataset_new(struct jobs *, const char *name, const struct job_peer *owner, bool onestep, struct err *err);
struct dataset *dataset_free(struct dataset *);
bool dataset_name_valid(const char *name);
/* Its folder; balanced by dataset_close. Opens (and makes) it on a worker's or the starting thread. */
int dataset_open(struct dataset *, struct err *err);
void dataset_close(struct dataset *);
/* What it says of itself, while workers open and close its folder, which the copy has not. Texts are shared. */
void dataset_copy(struct dataset *, struct dataset *ret);
int dataset_set(struct dataset *, const struct grid_manifest *, const char *manifest, struct err *err);
void dataset_row(const struct dataset *, struct catalogue_dataset *ret);
/* A dataset that has nothing yet is in the catalogue before its first push promises anything. */
int dataset_put_row(struct dataset *, struct err *err);
bool dataset_created(const struct dataset *); /* before its first push, by dataset_create */
int dataset_load(struct jobs *, const struct catalogue_dataset *, struct err *err);
/* Removes what no manifest of the dataset names. Reads the disk. */
int dataset_sweep(struct dataset *, bool again, struct err *err); /* again: the next start does it, too */
int folder_empty(int dirfd, struct err *err);                     /* removes everything in it */
int folder_remove(int dirfd, const char *name, struct err *err);  /* with everything in it; absent is success */
/* Removes the entries whose names begin so. */
int folder_sweep(int dirfd, const char *prefix, struct err *err);

/* dataset_change.c: its committer, with the folder open and before a manifest is made: once, what a crash left of others goes.
 * Worker. */
void dataset_tidy(struct dataset *, const char *newest);
void dataset_drop(struct dataset *); /* nobody uses it: out of list and catalogue, its folder goes in the background */

/* dataset_remove.c */
int64_t dataset_until_us(const struct dataset *); /* it can be restored; 0: it is there */
int64_t jobs_sure_us(struct jobs *);              /* by which what was pushed may go: no clock that jumps ahead */
void datasets_expire(struct jobs *);              /* what was removed so long ago that it goes */
void datasets_tick(struct jobs *);

/* dataset_change.c (dataset_change.h): what is no push */
void dataset_changes_settle(struct jobs *);
void dataset_verbs_settle(struct jobs *);
/* The dataset's row as it will be with that manifest; the dataset itself is changed (dataset_set) when `done` says so. */
int dataset_commit_row(struct dataset *, const struct grid_manifest *made, const char *name, int64_t pushed_us,
		       catalogue_done_fn done, void *ctx, struct err *err);

/* dataset_generation.c */
/* m->generations becomes the base's (NULL: there is none) and m->generation, as its sources have it; to be freed.
 * Workers. */
int generation_note(struct grid_manifest *m, const struct grid_manifest *base, const struct job_peer *, enum grid_generation_kind,
		    uint64_t undoes, struct err *err);

/* push_pending.c */
int pending_load(struct dataset *, const struct catalogue_push *, bool *ret_stays, struct err *err);
void pending_expire(struct dataset *);
void pending_forget(struct dataset *); /* all of them; their files go with the dataset's folder */
int64_t pending_until_us(const struct pending *);

/* push.c */
void push_tick(struct push *);
uint64_t push_stage_bytes(const struct push *);
uint32_t push_uid(const struct push *);
bool push_has_stage(const struct push *);
bool push_wants_stage(const struct push *); /* and waits for it */
bool push_stage_fits(const struct push *);  /* into its user's share of the memory */
struct push *push_next(const struct push *);
void push_retry(struct push *);
void push_remove_files(struct push *);

/* job.c */
void job_step(struct job *);
void job_tick(struct job *);
/* `view` becomes the job's, unless there is no memory: then NULL. */
struct job *job_add(struct jobs *, uint64_t id, char *view, const struct job_peer *, struct err *err);
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
/* drops.c: rows of jobs that gave way while the catalogue was loaded. */
int drops_add(struct jobs *, uint64_t id, struct err *err);
void drops_settle(struct jobs *);
void drops_free(struct jobs *);
void job_settle(struct job *);
void job_place_init(struct job *); /* when its peer and priority are known */
void job_plans_settle(struct jobs *);
void job_plans_park(struct jobs *);
/* The canonical text, to be freed, of a view asked of this dataset, which has a generation. */
int job_view(const char *text, const struct dataset *, char **ret, struct err *err);

/* job_waiting.c: what a job waits for, and what it asks to go before */
/* -ERR_USAGE: no such word; -ERR_PERM. "" leaves *ret. */
int job_priority_read(const char *text, const struct job_peer *, enum job_priority *ret, struct err *err);
void job_set_priority(struct job *, enum job_priority);
void job_waiting(const struct job *, struct job_info *ret); /* its fields about that */

/* report.c */
char *report_text(const struct job_report *, char *buf, size_t size);
void report_parse(const char *text, struct job_report *ret);
void report_make(const struct pipe_totals *, struct job_report *ret);
void report_window(struct job_report *); /* made so, but it is that of a window */

/* jobs.c, admit.c */
struct dataset *dataset_loaded(struct jobs *, uint64_t id); /* at the start; NULL: there is none */
void jobs_put_away(struct jobs *);                          /* those that are over and that nobody looks at: past_keep */
/* A job that is over and that nobody looks at goes: the oldest of the user who has most of that (`more` counted with
 * those of `uid`). False: there is none. */
bool jobs_forget_one(struct jobs *, enum past_kind, uint32_t uid, uint64_t more);
uint64_t jobs_domain_memory(struct jobs *);              /* that a plan may count on now */
bool jobs_selecting(struct jobs *, const struct walk *); /* another walk makes this one's selection */
/* cache/selected; opened (and made) each time, since a cache may be emptied. Any thread. */
int jobs_selected_folder(struct jobs *, int *ret_fd, struct err *err);
/* The smallest `memory` whose domains carry that many positions; 0: none does. */
uint64_t jobs_memory_for(struct jobs *, const struct grid *, uint64_t positions);
uint64_t jobs_domain_largest(struct jobs *);                                      /* of the walks that run */
uint64_t jobs_staged(const struct jobs *);                                        /* held by stages */
bool jobs_opening(struct jobs *, const struct dataset *);                         /* a walk is about to open its manifest */
void jobs_each_walk(struct jobs *, void (*fn)(struct walk *, void *), void *ctx); /* that has not ended */

struct admit_tally {
	unsigned walks, running, opening; /* that have places; of these not stalled; of one dataset */
	unsigned own, own_running;        /* of one user */
	uint64_t largest;                 /* task of any of them */
};
void admit_init(struct jobs *);
struct admit_tally admit_tally(struct jobs *, uint32_t uid);
uint64_t admit_share(const struct jobs *); /* what each walk at work holds */
uint64_t admit_alone(const struct jobs *); /* what the tasks of the only walk can have */
bool admit_only(struct jobs *);            /* no more than one walk is at work, and no push */
uint64_t admit_least(void);                /* what the smallest plan needs */
/* -ERR_LIMIT if a task of so many bytes could never start, with the memory that would do. */
int admit_never(struct jobs *, uint64_t bytes, const char *what, struct err *err);
uint64_t admit_stage(struct jobs *, uint64_t least); /* what a stage may have now; 0: less than `least` */
void admit_stages(struct jobs *);
bool admit_stage_awaited(const struct jobs *, uint32_t uid); /* by another user who has none */
void admit_relieve(struct jobs *);

/* limit.c: what one user may have; none of it holds admins. -ERR_LIMIT, with the setting's name as field. */
void limit_init(struct jobs *);
void limit_done(struct jobs *);
int limit_jobs(const struct jobs *, const struct job_peer *, struct err *err);     /* one more */
int limit_datasets(const struct jobs *, const struct job_peer *, struct err *err); /* likewise */
/* Bytes more of that user on the disk, beside those of the lists; any thread. Balanced. */
int limit_disk_take(struct jobs *, uint32_t uid, bool admin, uint64_t bytes, const char *what, struct err *err);
void limit_disk_give(struct jobs *, uint32_t uid, uint64_t bytes);
struct limit_geoid {
	uint32_t uid;
	uint64_t bytes;
};
void limit_geoids(struct jobs *, const struct limit_geoid *all, size_t n); /* all that are kept; any thread */
void limit_count(struct jobs *);                                           /* what the lists say */
/* The same, and two users give back what they took (negative: take it, whatever the limit), in one step. */
void limit_count_given(struct jobs *, uint32_t uid, int64_t bytes, uint32_t other, int64_t others);
/* Memory that the jobs, pushes and plans of that user may hold; UINT64_MAX: no limit. */
uint64_t limit_memory(const struct jobs *, const struct sched_owner *);
/* What is left of it; for domains and the like of a walk that has its place. */
uint64_t limit_room(struct jobs *, const struct sched_owner *, const struct walk *but);
bool limit_alone(struct jobs *, const struct sched_owner *, const struct walk *but); /* nothing else holds any */
bool limit_domain(const struct walk *); /* it may start one more beside those that it has */
/* -ERR_LIMIT if so much could never be had. */
int limit_never(struct jobs *, const struct sched_owner *, uint64_t bytes, const char *what, struct err *err);

/* Seeks a place whose walk needs so many bytes for a task; 0: not known. Nothing if it seeks already. */
void place_seek(struct jobs *, struct place *, uint64_t need);
void place_leave(struct jobs *, struct place *); /* seeks no longer */
void places_settle(struct jobs *);
unsigned place_position(const struct jobs *, const struct place *); /* 1: next; 0: it does not seek */
char *place_text(const struct jobs *, const struct place *, char *buf, size_t size);

#endif
