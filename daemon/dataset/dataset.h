/*
 * Datasets: generations of points, their rows in memory and in the catalogue, their folders, pending pushes into them, and
 * background changes of their segments (merge, prune).
 *
 * All functions belong to the loop thread unless they say "worker" or "any thread". A function that takes `answer` and `token`
 * calls answer(token, ...) exactly once, perhaps before it returns; `why` is NULL on success and is valid during the call only.
 * Functions that return int give 0 or -ERR_X. Other rooms may read the fields of struct dataset; only the functions below change
 * them.
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

/* A pending push: it was interrupted, and waits until its user pushes one of its files again. It holds its dataset. */
struct pending {
	struct pending *next;
	uint64_t id, points;
	uint64_t bytes; /* of the disk, at most */
	uint64_t stamp; /* another one whenever it comes into the list of its dataset */
	uint32_t uid, files;
	int64_t interrupted_us; /* real time */
};

struct dataset {
	struct dataset *next; /* named datasets in the order of their ids, then one-step datasets in any order */
	struct datasets *datasets;
	uint64_t id;
	char name[DATASET_NAME_MAX + 1];
	uint32_t uid, gid, mode, files;
	int64_t created_us, pushed_us; /* real time */
	char manifest[64];             /* file name of the newest manifest; "": no generation yet */
	uint64_t generation, points, bytes;
	uint64_t oldest;      /* oldest generation that can be read; 0: there is no generation */
	uint32_t segments;    /* of the newest manifest; 0: not known yet */
	bool merge_due;       /* some segments may have to be merged */
	uint64_t prune_to;    /* a prune removes the generations before this one; 0: no prune runs */
	unsigned reverts;     /* requested and not finished; no prune starts before they are */
	bool sets_due;        /* the newest generation has other lines than the one before it */
	bool drops_sets;      /* line sets of earlier generations are being removed */
	unsigned asks;        /* dataset_ask_lines, until they are answered */
	unsigned rows_queued; /* rows with a new manifest on their way to the catalogue; no other row is queued meanwhile */
	int64_t removed_us;   /* when it was removed; 0: it was not */
	bool pinned;
	char *lattice, *crs, *unit_xy, *unit_z; /* texts; "" without a generation */
	int32_t box[4];
	bool onestep;
	bool partial; /* only the points in `crop` were read, so only views inside of it are served */
	double crop[4];
	unsigned users;        /* pushes, runs, jobs and other holders; a one-step dataset is removed with the last one */
	unsigned dirfd_users;  /* under the lock of dataset_folder.c, as dirfd and folder_durable */
	int dirfd;             /* -1: closed */
	bool folder_durable;   /* the name of the folder survives a power cut */
	unsigned pushes;       /* open */
	struct push *planner;  /* the push that chooses the lattice; NULL: none */
	const void *committer; /* who writes the next manifest: a push, an import or a change; NULL: nobody */
	unsigned readers;      /* between dataset_read_begin and dataset_read_end */
	uint32_t next_source;
	struct pending *pending; /* the one that was interrupted last first */
	bool tidied;             /* by dataset_tidy */
	bool has_row;            /* the catalogue has its row */
	atomic_bool left;        /* files that nothing names could not be removed */
	/* At the start: */
	bool needs_sweep;                   /* interrupted pushes left files */
	bool sweep_ends;                    /* the rows of these pushes are dropped, so no later start sweeps again */
	bool keeps_leftovers;               /* what a push left cannot be read; it stays as it is */
	double stage_seconds, seal_seconds; /* of the last push; the first includes the second */
	size_t charged;                     /* bytes of LEDGER_JOBS */
	atomic_uint_fast64_t derived;       /* bytes of domains and selections in the folder of a one-step dataset */
};

/* ---- all datasets ---- */

/* What this room asks of jobs. */
struct datasets_calls {
	/* -ERR_BUSY, with their numbers: unfinished jobs need generations before `oldest`. */
	int (*needed)(void *ctx, const struct dataset *, uint64_t oldest, struct err *err);
	/* Finished jobs drop their reference to the dataset (dataset_unhold); their meshes cannot be made again. */
	void (*forget)(void *ctx, struct dataset *);
};
int datasets_new(struct core *, struct admission *, struct datasets **ret, struct err *err);
struct datasets *datasets_free(struct datasets *);                                    /* NULL is fine; returns NULL */
void datasets_set_calls(struct datasets *, const struct datasets_calls *, void *ctx); /* `calls` is borrowed */
struct dataset *datasets_first(const struct datasets *);                              /* NULL: none; continue with ->next */

/* The start, before the loop runs: all rows of the catalogue, then datasets_loaded with the largest id that the catalogue has
 * given out. Reads the disk. */
int datasets_load(void *datasets, const struct catalogue_dataset *, struct err *err);
int datasets_load_push(void *datasets, const struct catalogue_push *, struct err *err);
int datasets_loaded(struct datasets *, uint64_t last, struct err *err);
struct dataset *dataset_loaded(struct datasets *, uint64_t id); /* until datasets_loaded; NULL: none has that id */

void datasets_settle(struct datasets *); /* each round of the loop: starts the changes that can start now */
void datasets_tick(struct datasets *);   /* each timer tick */
void datasets_park(struct datasets *);   /* the daemon stops: cancels merge and prunes */
void datasets_expire(struct datasets *); /* removes for good what was removed longer ago than core_limits.keep_removed */
void datasets_count(struct datasets *);  /* updates the disk accounts of datasets and pending pushes */
/* Largest size in bytes of a segment of that many points, with its index. */
uint64_t datasets_points_bytes(uint64_t points);
/* Drops the row of a push, merge or prune from the catalogue, or logs that it could not. It stays if files were left behind
 * (dataset_left): the next start sweeps the folder then. */
void dataset_drop_row(struct dataset *, uint64_t push);

/* ---- one dataset ---- */

#define ABOUT_DATASET(d) (&(const struct log_about){.dataset = (d)->name, .generation = (d)->generation, ABOUT_USER((d)->uid)})

bool dataset_name_valid(const char *name);                 /* any thread */
int dataset_name_check(const char *name, struct err *err); /* the same; -ERR_USAGE. Any thread */
/* -ERR_LIMIT: the user owns as many datasets as one user may (user-datasets). */
int dataset_limit(struct datasets *, const struct peer *, struct err *err);
unsigned dataset_owned(const struct datasets *, uint32_t uid, unsigned *ret_removed); /* removed ones included */

enum { DATASET_MODE = 0640 }; /* the default mode */
/* A dataset in memory only, with no users; its group is the owner's first one. NULL: err says why. */
struct dataset *dataset_new(struct datasets *, const char *name, const struct peer *owner, bool onestep, struct err *err);
/* Puts the row of a dataset without a generation into the catalogue, once; queued, so before any later row of a push. */
int dataset_put_row(struct dataset *, struct err *err);
bool dataset_created(const struct dataset *); /* it was made by dataset_create and has no generation yet */

/* Holds a reference. The last release removes a one-step dataset, and a named one that never got a generation. */
struct dataset *dataset_hold(struct dataset *);
void dataset_release(struct dataset *);
void dataset_unhold(struct dataset *); /* releases without removing: for the removal itself */

/* Opens the folder as d->dirfd, and makes it if it is missing. Worker, or the start. Balanced by dataset_close (any thread). */
int dataset_open(struct dataset *, struct err *err);
void dataset_close(struct dataset *);
/* Files that nothing names stay in the folder, since `why`. Any thread. */
void dataset_left(struct dataset *, const struct err *why);
/* Between these two the files of what is now the newest manifest stay: from reading d->manifest until a worker has opened the
 * manifest and its segments, or has failed. Runs that open a dataset need not call them. */
void dataset_read_begin(struct dataset *);
void dataset_read_end(struct dataset *);
bool dataset_is_read(const struct dataset *); /* somebody is about to open the newest manifest */

/* NULL: no dataset of that name. Only their owners find one-step datasets. Checks no permission. */
struct dataset *dataset_find(struct datasets *, const char *name, const struct peer *);
/* -ERR_PERM, with a message that names the missing permission. */
int dataset_rights(const struct dataset *, const struct peer *, enum right, struct err *err);
/* dataset_find and dataset_rights. -ERR_NOTFOUND, -ERR_PERM. */
int dataset_access(struct datasets *, const char *name, const struct peer *, enum right, struct dataset **ret, struct err *err);
/* Named datasets that the peer may read, sorted by name: at most `max` of those after `name`. Returns their number. */
unsigned dataset_list(const struct datasets *, const char *name, const struct peer *, unsigned max, struct dataset **ret);
/* Removed datasets that the peer may restore: the one with the smallest id above `id`; NULL: there are no more. */
struct dataset *dataset_removed_after(struct datasets *, uint64_t id, const struct peer *);

/* Texts are borrowed from the dataset. */
struct dataset_info {
	const char *name;
	uint64_t id, generation, points, bytes;
	uint32_t files, uid, gid, mode;               /* gid RIGHTS_NOBODY: no group */
	const char *lattice, *crs, *unit_xy, *unit_z; /* "" without a generation */
	int64_t created_us, pushed_us;
	int32_t box[4];
	uint64_t oldest;              /* oldest generation that can be read */
	uint32_t segments;            /* 0: not known */
	bool merging;                 /* a merge works on it */
	int64_t removed_us, until_us; /* removed then, and restorable until then; 0: not removed */
	bool pinned;
	unsigned pushes;  /* open */
	unsigned pending; /* number of pending pushes, with so many files and points */
	uint64_t pending_files, pending_points;
	uint32_t pending_uid;     /* whose the newest one is */
	int64_t pending_until_us; /* the first of them is dropped then */
};
void dataset_info(const struct dataset *, struct dataset_info *ret);

/* The oldest generation that can be read, or that will be after the prune that runs. */
uint64_t dataset_oldest(const struct dataset *);
/* -ERR_NOTFOUND, with the range of generations. 0 means the newest. */
int dataset_check_generation(const struct dataset *, uint64_t generation, struct err *err);

/* ---- requests ---- */

/* A dataset before its first push. A text "" leaves the choice to the first inputs. */
struct dataset_create_params {
	const char *name, *scale_xy, *scale_z;
	const char *crs; /* a coordinate system as text */
	bool has_mode;   /* otherwise DATASET_MODE */
	uint32_t mode;
	struct peer peer;
};
/* Answers when the catalogue has the row. -ERR_USAGE; -ERR_CONFLICT: the name is in use. */
void dataset_create(struct datasets *, const struct dataset_create_params *, void (*created)(void *token, const struct err *why),
		    void *token);

enum dataset_action { DATASET_REMOVE, DATASET_RESTORE, DATASET_PIN, DATASET_UNPIN, DATASET_CHMOD, DATASET_CHGRP, DATASET_CHOWN };
struct dataset_action_params {
	enum dataset_action action;
	const char *name;
	const char *as;    /* RESTORE: the new name; "": the old one */
	uint64_t id;       /* RESTORE: used if no removed dataset has the name; 0: none */
	const char *mode;  /* CHMOD: as mode_parse takes it; otherwise NULL */
	uint32_t gid, uid; /* CHGRP: the new group, which the owner must be in; CHOWN: the new owner */
	struct peer peer;
};
typedef void dataset_action_fn(void *token, const struct err *why, struct dataset *);
/*
 * Changes what the row of a dataset says. Needs RIGHT_OWN, DATASET_CHOWN needs RIGHT_CHOWN. A removed dataset is hidden and its
 * name is free; it can be restored for core_limits.keep_removed. A pinned dataset can be neither removed nor pruned. -ERR_USAGE,
 * -ERR_PERM, -ERR_NOTFOUND, -ERR_CONFLICT, -ERR_BUSY: a push is open, or a revert or other change is not over.
 */
void dataset_act(struct datasets *, const struct dataset_action_params *, dataset_action_fn *answer, void *token);

struct reverted {
	struct dataset *dataset;
	uint64_t generation;                /* the new one */
	uint64_t undone;                    /* the generation that it undoes */
	uint64_t points;                    /* of the dataset now */
	const struct grid_generation *made; /* what the new generation changed; valid during the call; its user is NULL */
};
typedef void revert_answer_fn(void *token, const struct err *why, const struct reverted *);
/* Makes a generation that undoes `generation` (0: the newest). -ERR_CONFLICT: a later generation changed the same files.
 * -ERR_PERM, -ERR_NOTFOUND, -ERR_BUSY, -ERR_USAGE: a one-step dataset. */
void dataset_revert(struct dataset *, uint64_t generation, const struct peer *, revert_answer_fn *answer, void *token);

/* Makes the line set of an earlier generation again, whose grid lacks it (GRID_E_NO_LINE_SET). It stays until the dataset gets
 * another generation with other lines. `wait` is embedded in whoever waits. */
struct dataset_lines_wait {
	struct dataset_lines_wait *next;
	struct asked *of; /* NULL: it does not wait */
	/* Once, perhaps before dataset_ask_lines returns. `why` NULL: the grid can be opened. */
	void (*done)(struct dataset_lines_wait *, const struct err *why);
};
int dataset_ask_lines(struct dataset *, uint64_t generation, const struct peer *, struct dataset_lines_wait *, struct err *err);
void dataset_ask_end(struct dataset_lines_wait *); /* waits no longer; no effect if it does not */

/* Reads the newest manifest. The manifest is NULL if there is no generation, and is freed after the call of `answer`. */
typedef void dataset_read_fn(void *token, const struct err *why, const struct dataset *, const struct grid_manifest *);
void dataset_read(struct dataset *, const struct peer *, dataset_read_fn *answer, void *token);
/* The same; before that a worker calls `look` with the manifest and the folder of its files. */
typedef int dataset_look_fn(void *token, int dirfd, const struct grid_manifest *, struct err *err);
void dataset_look(struct dataset *, const struct peer *, dataset_look_fn *look, dataset_read_fn *answer, void *token);

struct pruned {
	struct dataset *dataset;
	uint64_t oldest;                            /* oldest generation that can be read now */
	uint64_t generations, files, points, bytes; /* removed; points of the files, bytes on the disk */
	uint64_t segments;                          /* rewritten or removed */
};
typedef void prune_answer_fn(void *token, const struct err *why, const struct pruned *);
struct prune;
/*
 * Removes all generations but the newest `keep`, or all before generation `before`; the other argument is 0. Answers when the
 * catalogue has the change. -ERR_BUSY: unfinished jobs need them. -ERR_CONFLICT: the dataset is pinned. Returns a handle that is
 * valid until the answer, or NULL if it has answered already.
 */
struct prune *dataset_prune(struct dataset *, uint64_t keep, uint64_t before, const struct peer *, prune_answer_fn *answer,
			    void *token);
void dataset_prune_cancel(struct prune *); /* answers soon with -ERR_CANCELLED, unless the change is committed already */

/* ---- the next generation, made by a push or an import ---- */

/*
 * The state of a dataset after its next manifest. dataset_next_make does all that can fail; dataset_next_put queues the row;
 * dataset_next_install, which cannot fail, is called when the row is durable.
 */
struct dataset_next {
	char *lattice, *crs, *unit_xy, *unit_z, manifest[64];
	uint64_t generation, oldest, points, bytes;
	uint32_t files, segments, next_source;
	int64_t pushed_us;
	int32_t box[4];
	bool merge_due, sets_due;
	struct dataset_obsolete
		*obsolete; /* names the manifest that is replaced, and its files of sources that are not used any more */
};
/* `apart`: what writing the manifest did; NULL: no file of sources is obsolete. */
int dataset_next_make(const struct dataset *, const struct grid_manifest *, const struct grid_apart *apart, const char *manifest,
		      int64_t pushed_us, struct dataset_next *ret, struct err *err);
void dataset_next_clear(struct dataset_next *); /* frees what it has; an empty one is fine */
/* Also drops the row of `push` in the same transaction; 0: of no push. `done` must call dataset_row_written. */
int dataset_next_put(struct dataset *, const struct dataset_next *, uint64_t push, catalogue_done_fn done, void *ctx,
		     struct err *err);
void dataset_row_written(struct dataset *);
/* Clears `next`. old_in_use: somebody is about to open the manifest that is replaced; its file is removed later. Otherwise the
 * caller removes it. */
void dataset_next_install(struct dataset *, struct dataset_next *next, bool old_in_use);

/* Removes manifests and files of sources that an earlier daemon left, once a start; `newest` is that of the dataset, `m` what is
 * in it. Worker, with the folder open, before a manifest is written. */
void dataset_tidy(struct dataset *, const char *newest, const struct grid_manifest *m);
/* The name of a file of sources that is written with a manifest of that name. */
void dataset_sources_name(const char *manifest, char ret[64]);
/* Removes a manifest that nothing names, and the file of sources that was made with it. */
void dataset_remove_made(int dirfd, const char *manifest, const struct grid_apart *);
/* Sets m->generations to those of `base` (NULL: none) and one for m->generation, with the sums of its sources; the caller frees
 * it. Worker. */
int dataset_note_generation(struct grid_manifest *m, const struct grid_manifest *base, const struct peer *,
			    enum grid_generation_kind kind, uint64_t undoes, struct err *err);
/* Only one `by` at a time writes the next manifest. False: another one does. The end does nothing for others than the committer.
 */
bool dataset_commit_begin(struct dataset *, const void *by);
void dataset_commit_end(struct dataset *, const void *by);
/* Only one push at a time chooses the lattice of a dataset that has none. Likewise. */
bool dataset_plan_begin(struct dataset *, struct push *);
void dataset_plan_end(struct dataset *, const struct push *);
/* Counts open pushes. */
void dataset_push_begin(struct dataset *);
void dataset_push_end(struct dataset *);
void dataset_set_mode(struct dataset *, uint32_t mode);
void dataset_set_partial(struct dataset *, const double crop[4]);
void dataset_set_seconds(struct dataset *, double stage, double seal);
uint32_t dataset_next_source(struct dataset *);               /* the next number of a source; each is given once */
void dataset_sources_from(struct dataset *, uint32_t number); /* numbers below this one are not given any more */

/* ---- pending pushes (dataset_pending.c) ---- */

#define ABOUT_PENDING(q, d) (&(const struct log_about){.push = (q)->id, .dataset = (d)->name, ABOUT_USER((q)->uid)})
struct pending *pending_new(struct datasets *, uint32_t uid, struct err *err); /* NULL: err says why */
struct pending *pending_free(struct datasets *, struct pending *);             /* NULL is fine; returns NULL */
/* Into the list; holds the dataset. */
void pending_add(struct dataset *, struct pending *);
/* Takes it out of the list, if it has been there since it had that stamp; the caller has the reference to the dataset then. NULL:
 * it is another one by now, or somebody has taken it. */
struct pending *pending_take(struct dataset *, uint64_t id, uint64_t stamp);
/* Takes one that was taken, and the reference: removes its files in the background. */
void pending_drop(struct dataset *, struct pending *, const char *why);
struct discarded {
	uint64_t pushes, files, bytes; /* bytes of the disk, at most */
};
typedef void discard_answer_fn(void *token, const struct err *why, const struct discarded *);
/* Removes the pending pushes of the peer into the dataset of that name and into removed ones that had it; with `all` those of all
 * users, where the peer has RIGHT_OWN. Answers when their files are removed for good, whatever happens to the daemon; the dataset
 * may be gone by then. -ERR_NOTFOUND: nothing is pending, and there is no dataset of that name. -ERR_PERM: likewise, and the peer
 * may not read the dataset; with `all`, the peer has no RIGHT_OWN in it, and nothing was removed. With another error some of
 * them, which cannot be removed, are pending as before: -ERR_IO, -ERR_NOMEM, -ERR_CANCELLED. */
void dataset_discard(struct datasets *, const char *name, const struct peer *, bool all, discard_answer_fn *answer, void *token);
/* A user may have so many in a dataset. */
enum { PENDING_MOST = 32 };
void pending_expire(struct dataset *);                           /* drops those that are older than 7 days, or too many */
int64_t pending_until_us(const struct pending *);                /* it can be continued until then */
uint64_t pending_source_points(const struct grid_source *);      /* as they count for the disk. Any thread */
uint64_t pending_points(const struct grid_manifest *);           /* of all sources; NULL: 0. Any thread */
uint64_t pending_bytes(int dirfd, uint64_t id, uint64_t points); /* of its files, at most. Any thread */
/* File names in the dataset's folder. Any thread. */
void pending_manifest_name(uint64_t id, char name[64]);
void pending_stage_name(uint64_t id, char name[48]);
/* Removes sources that are in the dataset's manifest, too (NULL: none), from that of a pending push. Any thread. */
void pending_leave_out(struct grid_manifest *, const struct grid_manifest *base);
/* Removes the files of a pending push: first the manifest by which a start finds them. Worker, with the folder open. */
int pending_discard(struct dataset *, uint64_t id, struct err *err);

#endif
