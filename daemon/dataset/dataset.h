/*
 * Datasets: generations of points, their rows in memory and in the catalogue, their folders, interrupted pushes into them, and
 * the rewriting of their segments (merge, prune). Loop, but where a function says otherwise.
 *
 * Other rooms read the fields of struct dataset; they change it by the functions here only.
 */
#ifndef DATASET_H
#define DATASET_H

#include <stdatomic.h>

#include "admission.h"
#include "core.h"
#include "grid.h"

enum { DATASET_NAME_MAX = 64 };

struct datasets;
struct push;

/* A push that was interrupted, until somebody takes it up. Holds its dataset. */
struct pending {
	struct pending *next;
	uint64_t id, points;
	uint32_t uid, files;
	int64_t left_us;
};

struct dataset {
	struct dataset *next; /* named: by id; one-step ones follow in no order */
	struct datasets *datasets;
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

/* ---- all of them ---- */

/* What datasets ask of jobs. */
struct datasets_calls {
	/* -ERR_BUSY names the unfinished jobs of generations before `oldest`. */
	int (*needed)(void *ctx, const struct dataset *, uint64_t oldest, struct err *err);
	/* Finished jobs forget it, by dataset_unhold: their meshes can then not be made again. */
	void (*forget)(void *ctx, struct dataset *);
};
int datasets_new(struct core *, struct admission *, struct datasets **ret, struct err *err);
struct datasets *datasets_free(struct datasets *); /* NULL is fine; returns NULL */
void datasets_set_calls(struct datasets *, const struct datasets_calls *, void *ctx);
struct dataset *datasets_first(const struct datasets *); /* ->next: named ones by number, then one-step ones */
/* The start, before the loop runs: rows of the catalogue, then datasets_loaded with the largest number that it has given. */
int datasets_load(void *datasets, const struct catalogue_dataset *, struct err *err);
int datasets_load_push(void *datasets, const struct catalogue_push *, struct err *err);
int datasets_loaded(struct datasets *, uint64_t last, struct err *err);
struct dataset *dataset_loaded(struct datasets *, uint64_t id); /* while rows are loaded; NULL: there is none */
void datasets_settle(struct datasets *);
void datasets_tick(struct datasets *);
void datasets_park(struct datasets *); /* merge and prune end soon */
/* What was removed too long ago goes. */
void datasets_expire(struct datasets *);
/* By which what was pushed may go: a clock that does not jump ahead. */
int64_t datasets_trusted_us(struct datasets *);
void datasets_count(struct datasets *); /* reports to the accounts of the disk what datasets and interrupted pushes have */
uint64_t datasets_points_bytes(uint64_t points); /* of a segment of so many points, with its index, at most */

/* ---- one of them ---- */

#define ABOUT_DATASET(d) (&(const struct log_about){.dataset = (d)->name, .generation = (d)->generation, ABOUT_USER((d)->uid)})

bool dataset_name_valid(const char *name);
/* -ERR_LIMIT: the user has as many as one user may have. */
int dataset_limit(struct datasets *, const struct peer *, struct err *err);
unsigned dataset_owned(const struct datasets *, uint32_t uid, unsigned *ret_removed); /* removed ones included */
/* Of this owner and his first group; its mode is DATASET_MODE. */
struct dataset *dataset_new(struct datasets *, const char *name, const struct peer *owner, bool onestep, struct err *err);
/* Its folder; balanced by dataset_close. Opens (and makes) it on a worker's or the starting thread. */
int dataset_open(struct dataset *, struct err *err);
void dataset_close(struct dataset *);
/* A dataset that has nothing yet is in the catalogue before its first push promises anything. */
int dataset_put_row(struct dataset *, struct err *err);
bool dataset_created(const struct dataset *); /* before its first push, by dataset_create */
void dataset_unhold(struct dataset *);        /* as dataset_release; the caller sees to it that it goes */
/* rights_allow, with a sentence. -ERR_PERM. */
int dataset_rights(const struct dataset *, const struct peer *, enum right, struct err *err);
/* From taking d->manifest until a worker has opened what it names, or has given up; runs that open count without it. No file of
 * the newest manifest of that time goes meanwhile. */
void dataset_read_begin(struct dataset *);
void dataset_read_end(struct dataset *);
bool dataset_is_read(const struct dataset *); /* somebody is about to open its newest manifest */

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
struct dataset *dataset_find(struct datasets *, const char *name, const struct peer *);
/* The one of that name, for who has that right on it. -ERR_NOTFOUND, -ERR_PERM. */
int dataset_ask(struct datasets *, const char *name, const struct peer *, enum right, struct dataset **ret, struct err *err);
/* Named datasets that this peer may read, by name: the first after `name`, at most `max`. Says how many. */
unsigned dataset_list(const struct datasets *, const char *name, const struct peer *, unsigned max, struct dataset **ret);
void dataset_info(const struct dataset *, struct dataset_info *ret);
/* A one-step dataset lives while it is held (a connection holds those that it pushed), pushed to or meshed.
 */
struct dataset *dataset_hold(struct dataset *);
void dataset_release(struct dataset *);

/* A dataset before its first push. Texts are "" where the inputs choose. */
struct dataset_wish {
	const char *name, *scale_xy, *scale_z;
	const char *crs; /* a coordinate system as text */
	bool has_mode;   /* else DATASET_MODE */
	uint32_t mode;
	struct peer peer;
};
/* Answered when the catalogue has it. -ERR_USAGE: there is one of that name. */
void dataset_create(struct datasets *, const struct dataset_wish *, void (*created)(void *token, const struct err *why),
		    void *token);

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
/* RIGHT_OWN, a new owner RIGHT_CHOWN; a new group is one that the owner is in. A removed dataset is hidden, its name free, and
 * kept for core_params.keep_removed; what is pinned can be neither removed nor pruned. -ERR_USAGE, -ERR_BUSY (a push is open),
 * -ERR_NOTFOUND. */
void dataset_verb(struct datasets *, const struct dataset_wanted *, dataset_verb_fn *answer, void *token);
/* Removed ones that this peer can restore, by number: the first after `id`; NULL at the end. */
struct dataset *dataset_removed_after(struct datasets *, uint64_t id, const struct peer *);

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

/* ---- the next generation, by a push or an import ---- */

/* What the next manifest makes of a dataset. */
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

/* A worker, with the folder open and before a manifest is made: once, what a crash left of others goes. */
void dataset_tidy(struct dataset *, const char *newest);
/* m->generations becomes the base's (NULL: there is none) and m->generation, as its sources have it; to be freed. Workers. */
int dataset_note_generation(struct grid_manifest *m, const struct grid_manifest *base, const struct peer *,
			    enum grid_generation_kind kind, uint64_t undoes, struct err *err);
/* One publishes the next manifest at a time. False: another one does. */
bool dataset_commit_begin(struct dataset *, const void *by);
void dataset_commit_end(struct dataset *, const void *by); /* nothing if it is another's turn */
void dataset_row_written(struct dataset *);                /* the answer to dataset_next_put has come */
/* One push plans the lattice of a dataset that has none. False: another one does. */
bool dataset_plan_begin(struct dataset *, struct push *);
void dataset_plan_end(struct dataset *, const struct push *);
void dataset_push_begin(struct dataset *); /* is open */
void dataset_push_end(struct dataset *);
void dataset_set_mode(struct dataset *, uint32_t mode);
void dataset_set_partial(struct dataset *, const double crop[4]);
void dataset_set_seconds(struct dataset *, double stage, double seal);
uint32_t dataset_next_source(struct dataset *);               /* a number for a source, given once */
void dataset_sources_from(struct dataset *, uint32_t number); /* none below it is given any more */

/* ---- interrupted pushes (dataset_pending.c) ---- */

#define ABOUT_PENDING(q, d) (&(const struct log_about){.push = (q)->id, .dataset = (d)->name, ABOUT_USER((q)->uid)})
struct pending *pending_new(struct datasets *, uint32_t uid, struct err *err); /* NULL: err says why */
struct pending *pending_free(struct datasets *, struct pending *);
void pending_add(struct dataset *, struct pending *);         /* holds the dataset */
struct pending *pending_take(struct dataset *, uint32_t uid); /* the newest of that user; still holds the dataset. NULL: none */
void pending_put_back(struct dataset *, struct pending *);
void pending_expire(struct dataset *);
int64_t pending_until_us(const struct pending *);
void pending_manifest_name(uint64_t id, char name[64]);
void pending_stage_name(uint64_t id, char name[48]);
/* Worker. What the push left goes, first what says that it is there. */
int pending_discard(struct dataset *, uint64_t id, struct err *err);
uint64_t pending_points(const struct grid_manifest *); /* of its sources; NULL: 0 */

#endif
