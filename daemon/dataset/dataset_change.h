/* A new manifest of a dataset that is made of its newest one, in turn with the commits of pushes. */
#ifndef DATASET_CHANGE_H
#define DATASET_CHANGE_H

#include "dataset_priv.h"

struct dataset_change {
	struct sched_task task;
	struct dataset_change *next; /* of those that wait for their turn */
	struct dataset *dataset;
	struct peer peer;
	/*
	 * Worker, with the dataset's folder open: what becomes of `base`. `*m` comes as a copy of it (segments and
	 * sources are its own, texts and lists of lives the base's; m->spans is NULL, and freed afterwards) and of its
	 * generation; whoever counts that up has named `kind`. Negative: nothing changes.
	 */
	int (*make)(struct dataset_change *, const struct grid_manifest *base, struct grid_manifest *m, struct err *err);
	/* Loop: the dataset is changed, or why not; the last that is heard of it, and who frees it. */
	void (*over)(struct dataset_change *, const struct err *why);
	enum grid_generation_kind kind;
	uint64_t undoes;
	struct grid_generation did; /* what the new generation did; its user is NULL */

	/* of dataset_change.c */
	struct datasets *datasets;
	char base_name[64], made_name[64];
	struct grid_manifest *made;
	struct dataset_next becomes;
	bool opened;
	int r;
	struct err err;
};

/* All of it zero but `dataset`, `peer`, `make`, `over`. `over` may come at once. */
void dataset_change_start(struct dataset_change *);

#endif
