/* What the files of this room share. */
#ifndef DATASET_PRIV_H
#define DATASET_PRIV_H

#include "dataset.h"

struct dataset_change;
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
	uint64_t last_dataset, last_onestep;
	uint64_t expired_ns; /* when removed datasets were looked at */
	struct {
		int64_t us;
		uint64_t at_ns, ahead_ns; /* when it was asked; since when the clock is ahead of it, 0: it is not */
	} trusted;                        /* the time that removed datasets and interrupted pushes go by (dataset_remove.c) */
	struct dataset_rewrite *merge;    /* that is at work */
	struct prune *prunes;             /* the first is at work, if no merge is */
	struct dataset_old *olds;         /* that wait until nobody opens them */
	bool merges_due;                  /* a dataset may have something to merge */
	uint64_t merge_after_ns;          /* none begins before */
	double merge_wait;                /* seconds that the last one was put off for want of space; 0: it was not */
	struct dataset_change *changes;   /* that wait for their turn */
	struct verb *verbs;               /* dataset_remove.c: likewise */
};

/* dataset_old.c: names of files that go; room for so many. Any thread. */
struct dataset_old *dataset_old_new(size_t names);
struct dataset_old *dataset_old_free(struct dataset_old *);
void dataset_old_add(struct dataset_old *, const char *name);
/* Loop: they go when they can, and then that row of a push (0: none). `old` is not the caller's any more. */
void dataset_old_goes(struct dataset_old *old, struct dataset *, uint64_t row);
void dataset_old_settle(struct datasets *);
void dataset_old_forget(struct datasets *); /* at the end: the next start finds them */

/* dataset_merge.c */
bool merge_due(const struct grid_manifest *);
bool merge_due_likely(uint32_t segments); /* where only their number is known */
void dataset_merge_settle(struct datasets *);
bool merge_at_work(const struct dataset *);

/* dataset_rewrite.c: the row is not of a push, but of a merge or prune; what it made is to be swept away */
bool rewrite_row(const struct catalogue_push *);

/* dataset_prune.c */
void dataset_prune_settle(struct datasets *);
void dataset_prune_tick(struct datasets *);
void dataset_prunes_park(struct datasets *);

/* dataset.c */
struct dataset *dataset_free(struct dataset *);
void dataset_row(const struct dataset *, struct catalogue_dataset *ret);
/* Removes what no manifest of the dataset names. Reads the disk. */
int dataset_sweep(struct dataset *, bool again, struct err *err); /* again: the next start does it, too */
void dataset_drop(struct dataset *); /* nobody uses it: out of list and catalogue, its folder goes in the background */

/* dataset_remove.c */
int64_t dataset_until_us(const struct dataset *); /* it can be restored; 0: it is there */

/* dataset_change.c (dataset_change.h): what is no push */
void dataset_changes_settle(struct datasets *);
void dataset_verbs_settle(struct datasets *);

/* dataset_pending.c */
enum { PENDING_BYTES = 64 }; /* charged; with its place in the heap */
int pending_load(struct dataset *, const struct catalogue_push *, bool *ret_stays, struct err *err);
void pending_forget(struct dataset *); /* all of them; their files go with the dataset's folder */

#endif
