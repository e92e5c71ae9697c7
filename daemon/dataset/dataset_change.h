/* A new manifest of a dataset that is made from its newest one. Changes take turns with the commits of pushes. */
#ifndef DATASET_CHANGE_H
#define DATASET_CHANGE_H

#include "dataset_priv.h"

/* The caller sets the first fields and leaves the rest zero. */
struct dataset_change {
	struct sched_task task;
	struct dataset_change *next; /* in datasets.changes */
	struct dataset *dataset;
	struct peer peer;
	/*
	 * Worker, with the dataset's folder open: changes `*m`, which is a copy of `base` with the same generation. Segments and
	 * sources are its own; texts and lives are those of `base`. m->spans is NULL and is freed afterwards. A function that
	 * raises m->generation needs `kind`. A negative result: nothing changes.
	 */
	int (*make)(struct dataset_change *, const struct grid_manifest *base, struct grid_manifest *m, struct err *err);
	/* Worker, with the folder open: the change failed, and nothing names what `make` wrote. NULL: it wrote nothing. */
	void (*undo)(struct dataset_change *);
	/* Loop, once: the dataset is changed, or `why` it is not. It may free the change. */
	void (*done)(struct dataset_change *, const struct err *why);
	enum grid_generation_kind kind;
	uint64_t undoes;
	bool lengthy;                           /* `make` may take long */
	struct grid_generation made_generation; /* set if a generation was made; its user is NULL */

	/* of dataset_change.c */
	struct datasets *datasets;
	char base_name[64], made_name[64];
	char sources_name[64];
	struct grid_apart apart; /* of what was made */
	struct grid_manifest *made;
	struct dataset_next new_state;
	bool opened;
	int r;
	struct err err;
};

/* `done` may be called before this returns. */
void dataset_change_start(struct dataset_change *);

#endif
