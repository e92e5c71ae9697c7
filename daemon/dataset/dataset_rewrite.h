/* Segments of a dataset made anew in the background, and a manifest that names them in place of the old ones. */
#ifndef DATASET_REWRITE_H
#define DATASET_REWRITE_H

#include "dataset_change.h"

enum rewrite_state {
	REWRITE_LOOKING,  /* a worker chooses what is to be done */
	REWRITE_WAITING,  /* for memory */
	REWRITE_WORKING,  /* a worker makes segments, piece by piece; the row is put before the first */
	REWRITE_CHANGING, /* the manifest */
	REWRITE_TIDYING,  /* nothing came of it: a worker removes what was made */
};

struct dataset_rewrite {
	struct sched_task task;
	struct dataset_change change;
	struct dataset *dataset;
	struct peer peer;
	/* Worker, with the folder open: what is to be done, by rewrite_add. Nothing: over, as if done. */
	int (*choose)(struct dataset_rewrite *, const struct grid_manifest *, struct err *err);
	/* Worker: `m`, with the new segments in place, for what else changes; NULL: nothing does. */
	int (*alter)(struct dataset_rewrite *, const struct grid_manifest *base, struct grid_manifest *m, struct err *err);
	/* Loop, before the manifest changes: negative: it must not. NULL: it may. */
	int (*last_look)(struct dataset_rewrite *, struct err *err);
	/* Loop: done, or why not; the last that is heard of it, and who frees it (by dataset_rewrite_clear before). */
	void (*over)(struct dataset_rewrite *, const struct err *why);
	const char *what; /* it is, in messages */
	enum sched_priority priority;
	bool patient;         /* waits for memory; else -ERR_BUSY */
	bool always;          /* the manifest changes even where no segment does; it frees disk: it may go beyond the quota */
	uint64_t most;        /* memory that it may have; choose looks at it */
	const uint32_t *drop; /* sources whose records go, ascending; choose sets it, `over` frees it */
	size_t ndrop;

	/* What was chosen, and what was made of it. */
	struct grid_segment_info *old, *made; /* made: points == 0: nothing */
	size_t nold, room;
	size_t *unit; /* of each new segment: where its old ones end */
	bool *gone;   /* of each: it holds nothing that stays, and is not made */
	size_t nunits, nmade;
	size_t nsources;        /* of the manifest */
	uint64_t read, written; /* bytes of segments */

	/* of dataset_rewrite.c */
	enum rewrite_state state;
	struct datasets *datasets;
	struct grid_rewrite *rewrite;
	struct dataset_old *olds;
	uint64_t row, bytes, space;
	char base_name[64], new_name[64];
	bool opened, stop, has_row, busy, again; /* again: at the next tick */
	int r;
	struct err err;
};

/* All of it zero but the fields in front. `over` comes later. */
void dataset_rewrite_start(struct dataset_rewrite *);
/* Loop. Ends soon with -ERR_CANCELLED, if it is not too late. */
void dataset_rewrite_cancel(struct dataset_rewrite *);
/* It may wait for memory: asks again. */
void dataset_rewrite_settle(struct dataset_rewrite *);
void dataset_rewrite_tick(struct dataset_rewrite *);
void dataset_rewrite_clear(struct dataset_rewrite *);

/* In choose: n segments become one, without the dropped sources; gone: they hold nothing that stays. */
int rewrite_add(struct dataset_rewrite *, const struct grid_segment_info *const *segments, size_t n, bool gone, struct err *err);
/* In choose: all but the last segment of what was added last. */
void rewrite_drop_last(struct dataset_rewrite *);
/* In choose, after adding: the memory that it takes. */
uint64_t rewrite_bytes(const struct dataset_rewrite *);

#endif
