/* What the files of this room share. Loop unless a function says otherwise. */
#ifndef DATASET_PRIV_H
#define DATASET_PRIV_H

#include "dataset.h"

struct action;
struct dataset_change;
struct dataset_lines;
struct dataset_rewrite;

struct datasets {
	struct core *core;
	struct admission *admission;
	const struct datasets_calls *calls;
	void *ctx;
	struct dataset *first;
	struct loaded *loaded; /* datasets by id, while the catalogue is loaded */
	size_t nloaded;
	struct dataset *last_loaded;
	uint64_t last_dataset, last_onestep; /* ids */
	uint64_t pending_stamp;              /* the last that was given */
	uint64_t expiry_checked_ns;
	struct {
		int64_t us;                /* the trusted time when it was last asked for */
		uint64_t at_ns;            /* when that was; 0: never */
		uint64_t ahead_ns;         /* since when the clock is ahead of the trusted time; 0: it is not */
	} trusted;                         /* dataset_expire.c */
	struct dataset_rewrite *merge;     /* the one that runs; NULL: none */
	struct prune *prunes;              /* a queue; the first one runs, unless a merge does */
	struct dataset_obsolete *obsolete; /* files that wait until nobody opens them */
	bool merges_due;                   /* a dataset may have something to merge */
	bool sets_due;                     /* a dataset may have line sets that nobody needs */
	struct asked *asked;               /* line sets that are being made for runs */
	uint64_t merge_after_ns;           /* no merge starts before */
	double merge_delay;                /* seconds that the last merge was postponed for lack of space; 0: it was not */
	struct dataset_change *changes;    /* a queue: changes whose dataset has another committer */
	struct dataset_lines *lines;       /* changes that wait for memory to make a line set */
	struct action *actions;            /* a queue: actions that wait for a row of their dataset, or a merge's manifest */
};

/* dataset.c */
struct dataset *dataset_free(struct dataset *);
bool dataset_set_text(char **to, const char *text); /* a copy of the text; false: no memory. Any thread */
void dataset_row(const struct dataset *, struct catalogue_dataset *ret);

/* dataset_folder.c */
/* Removes files that no manifest of the dataset and no pending push names. `again`: the next start does it, too. Reads the disk.
 */
int dataset_sweep(struct dataset *, bool again, struct err *err);
/* Nobody uses the dataset: takes it out of the list, drops its row, and then removes its folder in the background. */
void dataset_drop(struct dataset *);

/* dataset_find.c */
int dataset_not_found(const char *name, bool removed, struct err *err);
bool dataset_restorable(const struct dataset *, const struct peer *); /* it is removed, and the peer may restore it */

/* dataset_expire.c */
int64_t dataset_until_us(const struct dataset *); /* it can be restored until then; 0: it is not removed */
int64_t datasets_trusted_us(struct datasets *);   /* the time that decides what expires: a clock that does not jump ahead */
void datasets_expire_tick(struct datasets *);

/* dataset_obsolete.c */
/* A list of file names that a newer manifest does not name. It has room for `names`. Any thread. NULL: no memory. */
struct dataset_obsolete *dataset_obsolete_new(size_t names);
struct dataset_obsolete *dataset_obsolete_free(struct dataset_obsolete *);
void dataset_obsolete_add(struct dataset_obsolete *, const char *name);
/* Takes the list: removes the files when nobody opens them any more, and then drops the row of `push` (0: of none). */
void dataset_obsolete_queue(struct dataset_obsolete *, struct dataset *, uint64_t push);
void dataset_obsolete_settle(struct datasets *);
void dataset_obsolete_free_all(struct datasets *); /* the daemon ends; the next start removes the files */

/* dataset_merge.c */
bool merge_due(const struct grid_manifest *);
bool merge_due_likely(uint32_t segments); /* without the manifest */
bool merge_at_work(const struct dataset *);
bool merge_commits(const struct dataset *); /* it writes the next manifest, which takes no longer than a push's */
void dataset_merge_settle(struct datasets *);

/* dataset_rewrite.c */
bool rewrite_owns_row(const struct catalogue_push *); /* the row is that of a merge or prune, not of a push */

/* dataset_prune.c */
void dataset_prune_settle(struct datasets *);
void dataset_prune_tick(struct datasets *);
void dataset_prunes_park(struct datasets *);
void dataset_sets_settle(struct datasets *); /* begins to remove line sets of earlier generations */

/* dataset_change.c, dataset_lines.c, dataset_action.c: start what had to wait */
void dataset_changes_settle(struct datasets *);
void dataset_lines_settle(struct datasets *);
void dataset_actions_settle(struct datasets *);

/* dataset_pending.c */
enum { PENDING_BYTES = 64 }; /* charged for each, with its share of the heap */
/* A row of the catalogue, before the loop runs. *ret_stays: the push is pending; otherwise its row goes. */
int pending_load(struct dataset *, const struct catalogue_push *, bool *ret_stays, struct err *err);
void pending_forget(struct dataset *); /* all of them; their files go with the dataset's folder */

#endif
