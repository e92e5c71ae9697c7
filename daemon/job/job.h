/*
 * When each step of a mesh runs: datasets, pushes into them, jobs on them, and the mesh of a job as a stream.
 *
 * Everything here belongs to one thread, the loop: it calls these functions, and all callbacks come on it
 * (except job_output's `encode`, `spool` and `refill`, which workers call). Disks are read and written by
 * workers and by the catalogue's thread only. Who asks is a peer; how it was asked is not known here.
 */
#ifndef JOB_H
#define JOB_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "crs_geo.h"
#include "admission.h"
#include "core.h"
#include "err.h"
#include "pipe.h"

struct jobs; /* the service */
struct dataset;
struct push;
struct push_stream;
struct job;

/* Who holds how much of the budget, by name. */
struct job_holder {
	const char *kind; /* "job", "fetch", "plan", "push" */
	uint64_t id;      /* of the job or push; 0: none */
	struct peer peer;
	const char *dataset; /* "": none */
	uint64_t held[LEDGER_NAMES];
};

/* ---- the service ---- */

struct jobs_params {
	struct core_params core;
	/* A job came to be, went on, or ended. */
	void (*changed)(void *ctx, struct job *);
	void *ctx;
};
/* Loads the catalogue, removes what uncommitted pushes and dead one-step datasets left, queues the jobs that
 * were not done. Reads the disk: call it before the loop runs. */
int jobs_new(const struct jobs_params *, struct jobs **ret, struct err *err);
/* What may change while jobs run; as in jobs_params. What is there already is held to it from the next look on: what can
 * be made again is evicted, who waits goes on. */
struct jobs_limits {
	struct space_limit disk, keep_free;
	double keep_removed, space_wait;
};
void jobs_set_limits(struct jobs *, const struct jobs_limits *);
/* For what is asked from now on. */
void jobs_set_user_limits(struct jobs *, const struct user_limits *);
/* Only when jobs_parked. NULL is fine; returns NULL. */
struct jobs *jobs_free(struct jobs *);
/* After sched_dispatch and catalogue_dispatch: gives memory to who starves, starts what can start. */
void jobs_settle(struct jobs *);
/* About ten times a second while jobs_active or jobs_resting. */
void jobs_tick(struct jobs *);
bool jobs_active(const struct jobs *);  /* a push is open, or a job or stream is not over */
bool jobs_resting(const struct jobs *); /* what a start has to sweep and measure has not begun; nobody waits for that */
/* Work stops as soon as it can: pushes end, bound jobs end, unbound jobs stay queued for the next start. */
void jobs_park(struct jobs *);
bool jobs_parked(const struct jobs *);
/* The last resort of a stop that takes too long: removes temporary files at once. Workers still run: exit
 * next. */
void jobs_abandon(struct jobs *);
void jobs_count(const struct jobs *, uint32_t *ret_running, uint32_t *ret_waiting);
/* What goes on, for a line about it: open pushes, jobs, and the domains of those that run (total 0: not planned yet). */
struct jobs_work {
	uint32_t pushes, running, waiting;
	uint64_t domains_done, domains_total;
};
void jobs_work(const struct jobs *, struct jobs_work *ret);
/* All that hold something. What is held beside them is of the service, or of tasks that look at a single file. */
void jobs_holders(struct jobs *, void (*each)(void *ctx, const struct job_holder *), void *ctx);
uint64_t jobs_peak_rss(void); /* VmHWM of this process, bytes */
uint64_t jobs_rss(void);      /* VmRSS */

struct verified {
	int64_t at_us;                                  /* real time; 0: never */
	uint64_t files, bytes, damaged, derived, newer; /* newer: of what was pushed */
};
struct jobs_numbers {
	struct tally tally;
	struct verified verified;
	uint64_t states[7];     /* by enum job_state: of jobs that are not over */
	uint64_t kept;          /* jobs, over ones included */
	double oldest_waiting;  /* seconds since the oldest job that has not begun was submitted; 0: none waits */
	uint64_t pushes;        /* open */
	uint64_t pending;       /* interrupted ones that wait */
	double pending_left;    /* seconds until the first of these is dropped */
	uint64_t waiting_space; /* jobs */
	uint64_t datasets, removed;
	bool unsure; /* the catalogue cannot be written, and nobody knows what of the last change it has */
};
void jobs_numbers(struct jobs *, struct jobs_numbers *ret);
struct jobs_user {
	uint32_t uid, datasets, jobs; /* jobs: unfinished */
	uint64_t bytes, points;       /* of named datasets, removed ones included */
	uint64_t pending_bytes;       /* at most, of interrupted pushes */
};
/* Those who have something, by uid, from `from` on; their number, up to n. */
size_t jobs_users(struct jobs *, uint64_t from, struct jobs_user *ret, size_t n);

/* How much one user has of what he may; a limit of 0: there is none. */
struct jobs_own {
	bool exempt;                                                /* no limit holds for him */
	unsigned jobs, jobs_most, datasets, removed, datasets_most; /* jobs: unfinished; of the datasets so many are removed */
	uint64_t disk, disk_most;
};
void jobs_own(struct jobs *, const struct peer *, uint64_t state_bytes, struct jobs_own *ret); /* size of that file system */

/* What a worker sees of disks and grids when it looks. */
struct health_side {
	int sys;                                 /* errno: it cannot be looked at */
	uint64_t free, total, files_free, files; /* bytes; inodes, files 0: it does not count them */
	bool read_only;
};
struct health {
	struct health_side state, cache;
	unsigned geoids, geoids_bad;
	char geoid_why[512];          /* of the first that is bad */
	unsigned open_files, threads; /* of this process */
};
/* What was seen within the last second, or what a worker sees now: one look serves all who ask meanwhile. */
void health_check(struct jobs *, const struct peer *, void (*answer)(void *token, const struct err *why, const struct health *),
		  void *token);

/* ---- datasets ---- */

enum { DATASET_MODE = 0640 }; /* of one that nobody gave a mode */

struct dataset_info {
	const char *name;
	uint64_t id, generation, points, bytes;
	uint32_t files, uid, gid, mode;               /* of its owner, its group (RIGHTS_NOBODY: none), as of a file */
	const char *lattice, *crs, *unit_xy, *unit_z; /* "" while there is no generation */
	int64_t created_us, pushed_us;
	int32_t box[4];
	uint64_t oldest;              /* generation that can be read */
	uint32_t segments;            /* 0: not known */
	bool merging;                 /* some of them become one now */
	int64_t removed_us, until_us; /* 0: it is there; else until when it can be restored */
	bool pinned;
	unsigned pushes;  /* open now */
	unsigned pending; /* interrupted; the next five are of the newest */
	uint32_t pending_files, pending_uid;
	uint64_t pending_points;
	int64_t pending_until_us;
};
/* NULL: none. One-step datasets are seen by their owner only. That it is there says nothing about what one may do. */
struct dataset *dataset_find(struct jobs *, const char *name, const struct peer *);
/* The one of that name, for who has that right on it. -ERR_NOTFOUND, -ERR_PERM. */
int dataset_ask(struct jobs *, const char *name, const struct peer *, enum right, struct dataset **ret, struct err *err);
/* Named datasets that this peer may read, by name: the first after `name`, at most `max`. Says how many. */
unsigned dataset_list(const struct jobs *, const char *name, const struct peer *, unsigned max, struct dataset **ret);
void dataset_info(const struct dataset *, struct dataset_info *ret);
/* A one-step dataset lives while it is held (a connection holds those that it pushed), pushed to or meshed.
 */
struct dataset *dataset_hold(struct dataset *);
void dataset_release(struct dataset *);

/* A dataset before its first push. Texts are "" where the inputs choose. */
struct dataset_wish {
	const char *name, *scale_xy, *scale_z;
	const char *crs; /* as push_params.assume_crs */
	bool has_mode;   /* else DATASET_MODE */
	uint32_t mode;
	struct peer peer;
};
/* Answered when the catalogue has it. -ERR_USAGE: there is one of that name. */
void dataset_create(struct jobs *, const struct dataset_wish *, void (*created)(void *token, const struct err *why), void *token);

/* The oldest generation that can be read, also while others are being pruned. */
uint64_t dataset_oldest(const struct dataset *);
/* -ERR_NOTFOUND, with the range that there is; 0 is the newest. */
int dataset_check_generation(const struct dataset *, uint64_t generation, struct err *err);
enum dataset_verb { DATASET_REMOVE, DATASET_RESTORE, DATASET_PIN, DATASET_UNPIN, DATASET_CHMOD, DATASET_CHGRP, DATASET_CHOWN };
struct dataset_wanted {
	enum dataset_verb verb;
	const char *name, *as; /* to restore under another name; "": its own */
	uint64_t id;           /* to restore, where no removed dataset has the name; 0: none */
	const char *mode;      /* as mode_parse takes it; NULL: none */
	uint32_t gid, uid;     /* the new group, the new owner */
	struct peer peer;
};
typedef void dataset_verb_fn(void *token, const struct err *why, struct dataset *);
/* RIGHT_OWN, a new owner RIGHT_GIVE; a new group is one that the owner is in. A removed dataset is hidden, its name free, and
 * kept for jobs_params.keep_removed; what is pinned can be neither removed nor pruned. -ERR_USAGE, -ERR_BUSY (a push is open),
 * -ERR_NOTFOUND. */
void dataset_verb(struct jobs *, const struct dataset_wanted *, dataset_verb_fn *answer, void *token);
/* Removed ones that this peer can restore, by number: the first after `id`; NULL at the end. */
struct dataset *dataset_removed_after(struct jobs *, uint64_t id, const struct peer *);

struct reverted {
	struct dataset *dataset;
	uint64_t generation, undone, points; /* the new one; the one that it undoes; of the dataset now */
	const struct grid_generation *did;   /* without the user */
};
typedef void revert_answer_fn(void *token, const struct err *why, const struct reverted *);
/* A new generation that undoes another one; 0: the newest. -ERR_USAGE: what it did was changed since. */
void dataset_revert(struct dataset *, uint64_t generation, const struct peer *, revert_answer_fn *answer, void *token);

/* The newest manifest of a dataset (NULL: there is none yet), which is the service's, and the callback's while it is
 * called. */
typedef void dataset_read_fn(void *token, const struct err *why, const struct dataset *, const struct grid_manifest *);
void dataset_read(struct dataset *, const struct peer *, dataset_read_fn *answer, void *token);

struct pruned {
	struct dataset *dataset;
	uint64_t oldest;                            /* generation that can be read now */
	uint64_t generations, files, points, bytes; /* that went; of files: points and what they took on the disk */
	uint64_t segments;                          /* that were made anew, or went */
};
typedef void prune_answer_fn(void *token, const struct err *why, const struct pruned *);
struct prune;
/*
 * Generations go: all but the newest `keep`, or all before generation `before`; the other one is 0. -ERR_BUSY: jobs
 * of these are not done. Answered when the catalogue has it; NULL: answered already. The handle is good until then.
 */
struct prune *dataset_prune(struct dataset *, uint64_t keep, uint64_t before, const struct peer *, prune_answer_fn *answer,
			    void *token);
void dataset_prune_cancel(struct prune *); /* answered with -ERR_CANCELLED, if it is not too late */

/* ---- pushes ---- */

struct push_begun {
	struct push *push;
	uint64_t id;
	const char *lattice;
	const char *note; /* "", or what became of an interrupted push */
};
struct push_file {
	const char *name;
	struct pipe_ingested in;
	const char *geoid;      /* that shifted its heights: as in the manifest; "": none */
	uint32_t replaced;      /* files of the dataset, by this one */
	const char *crs_of;     /* of the file itself, where it was projected; "": it was not */
	const char *overridden; /* what its records say, where the push overrides that; "": it does not */
};
struct push_planned {
	const char *lattice, *crs;
	const char *zone, *datum; /* that degrees go to, and theirs; "": none are projected */
	const char *geoid;        /* "": heights stay */
	const char *note;         /* which scale was chosen for inputs that have more digits; "" */
};
struct push_committed {
	struct dataset *dataset;
	uint64_t generation, points;
	bool unchanged; /* it made no generation */
};

enum push_known_as {
	PUSH_NEW,
	PUSH_KNOWN,   /* the dataset has it, or this push has it twice: no File for it */
	PUSH_ADOPTED, /* of the interrupted push that this one takes up: no File for it, it counts as staged */
};
struct push_probe_result {
	const char *name;
	const struct input_info *info; /* NULL if it is known: it was not read */
	enum push_known_as known;
	uint64_t points;   /* of one that is known */
	uint32_t replaced; /* files of the dataset, by one that is taken up */
};
struct push_input {
	const char *name, *format;
	const char *columns; /* of a text, as input_options; "": as it says itself */
	bool decimal_comma;
	const char *path;     /* absolute; "": it has none */
	bool checksum;        /* judged by its content, not by path, size and time */
	bool add;             /* taken beside another one of its path */
	bool replace;         /* taken in place of those of its path */
	const char *replaces; /* and of this one, by path or name; "": none */
	bool told;            /* of a stream: what will come has this content; else nothing is known of it */
	struct digest hash;
	uint64_t size;
};

/* Each request is answered once, with `why` (NULL: done) and its own token. */
struct push_calls {
	void (*begun)(void *token, const struct err *why, const struct push_begun *);
	void (*probed)(void *token, const struct err *why, const struct push_probe_result *);
	void (*planned)(void *token, const struct err *why, const struct push_planned *);
	void (*staged)(void *token, const struct err *why, const struct push_file *);
	void (*committed)(void *token, const struct err *why, const struct push_committed *);
	void (*aborted)(void *token);
	/* Unasked. `progress` comes with the token of the request that it is about. */
	void (*durable)(void *ctx, uint64_t files);
	void (*progress)(void *token, const char *phase, uint64_t points, uint64_t total);
	/* Tell push_stream_ready once when `fd` has bytes or has ended. *watch (NULL at first) is for whoever
	 * watches; `unwatch` ends it for good. */
	int (*watch)(void *ctx, struct push_stream *, int fd, void **watch, struct err *err);
	void (*unwatch)(void *watch);
};
struct push_params {
	const char *dataset; /* "" = one-step */
	const char *scale_xy, *scale_z, *format;
	const char *assume_crs, *assume_unit_xy, *assume_unit_z;       /* for inputs that say nothing; NULL, "": nothing */
	const char *override_crs, *override_unit_xy, *override_unit_z; /* in place of what they say; not beside assume_* */
	const char *utm;                                               /* zone that degrees go to; "": of the middle of all */
	const char *geoid;                                             /* grid that shifts the heights; "": none */
	const char *geoid_way;                                         /* "orthometric" or "ellipsoidal"; "": orthometric */
	bool has_mode;                                                 /* for a dataset that comes to be; else DATASET_MODE */
	uint32_t mode;
	bool planar, accept_truncated, strict;
	const double *crop; /* x1, y1, x2, y2, in the dataset's coordinates, or ncrop is 0; of one-step ones only */
	size_t ncrop;
	struct peer peer;
	const struct push_calls *calls;
	void *ctx; /* of calls->durable; until push_leave */
};
void push_begin(struct jobs *, const struct push_params *, void *token);
/* `fd` becomes the push's in any case. */
void push_probe(struct push *, int fd, const struct push_input *, void *token);
/* An input that comes through a pipe: `fd`, its non-blocking reading end, becomes the push's in any case. Probe
 * and File of that name, with fd -1, mean it. LAS is read forwards; all else is kept in a file first. */
int push_stream(struct push *, int fd, const char *name, struct err *err);
void push_stream_ready(struct push_stream *);
void push_plan(struct push *, void *token);
void push_file(struct push *, int fd, const struct push_input *, void *token);
void push_commit(struct push *, void *token);
void push_abort(struct push *, void *token);
/* Nobody will call any more: what is unanswered is still answered. What was staged whole into a named dataset and
 * neither committed nor aborted stays as a pending push. The push is void. */
void push_leave(struct push *);
/* A probe of its own, for `acutctl info`. */
void push_info(struct jobs *, int fd, const char *name, const char *format, const char *columns, bool decimal_comma,
	       const struct peer *,
	       void (*probed)(void *token, const struct err *why, const char *name, const struct input_info *), void *token);

/* ---- inspection: what is in the records of one file ---- */

enum { INSPECT_DIFFERENCES = 8 };
struct inspect_result {
	const char *name;
	struct input_info info;
	struct lattice lattice;
	struct pipe_inspected in;
	bool has_place;                            /* on the earth: */
	char no_place[256];                        /* why not */
	double area, perimeter;                    /* of the hull, by geodesics: square metres, metres */
	double south, west, north, east;           /* of the hull, degrees */
	char mgrs[16];                             /* of the middle of the box, a square of 1 km; "": none there */
	char difference[INSPECT_DIFFERENCES][192]; /* between header and records, in words */
	unsigned ndifferences;
};
typedef void inspect_answer_fn(void *token, const struct err *why, const struct inspect_result *);
/* Reads all of the file. `fd` becomes the service's in any case. */
void inspect_file(struct jobs *, int fd, const char *name, const char *format, const char *columns, bool decimal_comma,
		  const struct peer *, inspect_answer_fn *answer, void *token);

/* ---- geoid grids that the daemon keeps ---- */

struct geoid_info {
	char name[72], hash[DIGEST_HEX_SIZE];
	uint32_t uid; /* who added it */
	struct crs_geoid_info grid;
};
typedef void geoid_answer_fn(void *token, const struct err *why, const struct geoid_info *list, size_t n);
/* A checked copy of the file under that name; answers with it alone. `fd` becomes the service's in any case;
 * `file` is what messages call it. */
void geoid_add(struct jobs *, int fd, const char *name, const char *file, const struct peer *, geoid_answer_fn *answer,
	       void *token);
void geoid_list(struct jobs *, const struct peer *, geoid_answer_fn *answer, void *token); /* by name */
void geoid_remove(struct jobs *, const char *name, const struct peer *, geoid_answer_fn *answer, void *token);

/* ---- jobs ---- */

enum job_state {
#define JOB_STATE(name, wire, next) JOB_##name,
#include "job_state.def"
#undef JOB_STATE
	JOB_STATES
};
const char *job_state_text(enum job_state);
bool job_state_final(enum job_state);

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

/* A region of an older mesh that no longer holds. */
struct job_region {
	int64_t box[4]; /* as of a block */
	uint64_t triangles;
	struct digest digest;
};
/* What a stream of changes is against. Regions count where they have triangles. */
struct job_changes {
	uint64_t generation, job;
	struct digest old_digest, old_vertex_digest, digest, vertex_digest; /* of both meshes, whole */
	uint64_t gone, gone_triangles, kept, kept_triangles;
	const struct job_region *region; /* those that are gone */
};
struct job_stream_head {
	const struct grid_manifest *manifest;
	const char *view;
	struct digest id;                  /* generation, view, plan, kernel version */
	bool window;                       /* the triangles of the view's window, not the whole mesh */
	const struct job_changes *changes; /* NULL: the whole mesh; valid during the call */
	int32_t box[6];                    /* holds all vertices; heights are not known yet: all of int32 */
};
struct job_output;
struct job_output_calls {
	/* Loop. */
	void (*head)(struct job_output *, const struct job_stream_head *);
	void (*send)(struct job_output *);      /* what was encoded; job_output_sent when all of it is written */
	void (*pause)(struct job_output *);     /* a worker gets it next; `send` comes when it is back */
	double (*stalled)(struct job_output *); /* seconds since bytes last moved, 0 if none wait */
	/* The mesh is whole (why NULL), or will never be. The output is on its own from here. */
	void (*end)(struct job_output *, const struct err *why, const struct pipe_totals *, const struct job_report *);
	/* Workers, never two at once, and the loop sends nothing meanwhile. The block's arrays stay until
	 * sent or spooled. */
	void (*encode)(struct job_output *, const struct mesh_block *);
	int (*spool)(struct job_output *, int dirfd, struct err *err); /* the rest of the block into a file */
	int (*refill)(struct job_output *, struct err *err);           /* the next bytes of that file */
	/* Loop. What a stream of its own waits for, in words, has changed; "": nothing. May be NULL. */
	void (*waits)(struct job_output *, const char *text);
};
struct job_output {
	const struct job_output_calls *calls;
	struct run *run; /* these two are of job/ only */
	struct job_fetch *fetch;
	bool spooled; /* set by spool: the block's memory is not needed any more; encode takes it back */
	/* Set before job_fetch: go on at this block, of the stream `want`. What cannot be is -ERR_GONE. */
	char *window;   /* a view of job_window: the triangles of its window; NULL: those of the job. Freed by job/ */
	uint64_t since; /* what differs from the mesh of this generation; 0: the whole mesh */
	uint64_t from;
	bool wants;
	struct digest want;
};
/* The view of the job with a window, to be freed: `area` as PROTOCOL.md has it. */
int job_window(const struct job *, const char *area, char **ret, struct err *err);
enum { JOB_OUTPUT_BUFFER = ADMISSION_OUTPUT }; /* what refill may hold; charged by job/ */
/* Streams the mesh of `job` into `output`: a bound one that has just begun as it is made; one that runs as far as
 * it is stored, and on as it gets there; else when the job has begun or is done. */
void job_fetch(struct job *, struct job_output *output);
void job_output_sent(struct job_output *);
void job_output_dry(struct job_output *); /* the refilled bytes are written, and there are more */
/* Nobody reads any more. No call comes for this output after this; a worker may still be in one, so `freed`
 * is called when none is. */
void job_output_gone(struct job_output *, void (*freed)(struct job_output *));

/* ---- plans ---- */

struct job_plan {
	uint64_t points, domains, domains_reused, memory_bytes, disk_bytes;
	bool exact;
	uint32_t load, threads;
	double seconds; /* at the pace of the newest finished job; 0: there is none to go by */
};
void job_plan(struct jobs *, struct dataset *, uint64_t generation, const char *view, const struct peer *,
	      void (*planned)(void *token, const struct err *why, const struct job_plan *), void *token);

/* ---- the disk ---- */

struct cache_stat {
	struct space_stat space;      /* with the numbers of datasets, pending pushes, one-step ones */
	char disk[32], keep_free[32]; /* the limits as they were given; "none" */
};
void cache_stat(struct jobs *, struct cache_stat *ret);

/* One damaged thing; or one of a newer version (err.code is ERR_VERSION), which stays as it is. */
struct cache_damage {
	const char *what;     /* "manifest", "segment", "push", "plan", "domain", "selection", "catalogue" */
	char dataset[64 + 1]; /* "": of none */
	struct err err;       /* file, place, reason */
	bool derived;         /* and removed, if that could be done: it is made again */
	bool removed;
};
struct cache_verified {
	uint64_t files, bytes, damaged, derived;
	uint64_t newer, derived_newer; /* of a newer version; not counted as damaged */
};
struct cache_verify_calls {
	void (*damage)(void *token, const struct cache_damage *);
	void (*progress)(void *token, const char *phase, uint64_t bytes, uint64_t total); /* total: as far as it is known */
	/* Once. `why`: it was ended, or could not read on. */
	void (*over)(void *token, const struct err *why, const struct cache_verified *);
};
struct cache_verify;
/* Reads all of state and cache, at the lowest priority. -ERR_PERM: not root nor the daemon's user; -ERR_BUSY: it is
 * being done already. */
int cache_verify(struct jobs *, const struct peer *, const struct cache_verify_calls *, void *token, struct cache_verify **ret,
		 struct err *err);
void cache_verify_end(struct cache_verify *); /* soon; `over` comes all the same */
/* Removes what is not needed; all: everything derived. -ERR_PERM as above. */
void cache_gc(struct jobs *, const struct peer *, bool all,
	      void (*freed)(void *token, const struct err *why, uint64_t bytes, uint64_t entries), void *token);

#endif
