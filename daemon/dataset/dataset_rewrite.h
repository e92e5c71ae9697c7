/* Rewrites segments of a dataset in the background, and makes a manifest that names the new ones in place of the old ones. */
#ifndef DATASET_REWRITE_H
#define DATASET_REWRITE_H

#include "dataset_change.h"

/*
 * CHOOSING --> WAITING --> WRITING --> COMMITTING --> done       each of these --> UNDOING --> done
 *
 * CHOOSING and COMMITTING start again when there was no memory for a manifest. CHOOSING is followed by COMMITTING where nothing
 * has to be rewritten or removed.
 */
enum rewrite_state {
	REWRITE_CHOOSING,   /* a worker chooses segments */
	REWRITE_WAITING,    /* for memory */
	REWRITE_WRITING,    /* a worker makes segments, piece by piece; the row is put before the first one */
	REWRITE_COMMITTING, /* the manifest changes */
	REWRITE_UNDOING,    /* it failed: a worker removes what was made */
};

/* The caller sets the first fields and leaves the rest zero. */
struct dataset_rewrite {
	struct sched_task task;
	struct dataset_change change;
	struct dataset *dataset;
	struct peer peer;
	/* Worker, with the folder open: calls rewrite_add for what is to be rewritten. */
	int (*choose)(struct dataset_rewrite *, const struct grid_manifest *, struct err *err);
	/* Worker: further changes of `m`, which has the new segments already. NULL: none. */
	int (*alter)(struct dataset_rewrite *, const struct grid_manifest *base, struct grid_manifest *m, struct err *err);
	/* Loop, before the manifest changes: negative forbids it. NULL: allowed. */
	int (*check)(struct dataset_rewrite *, struct err *err);
	/* Loop, once: it succeeded, or `why` it did not. The caller's memory again; dataset_rewrite_clear before it is freed. */
	void (*done)(struct dataset_rewrite *, const struct err *why);
	const char *what; /* its name in messages */
	enum sched_priority priority;
	bool patient;         /* waits for memory; otherwise -ERR_BUSY */
	bool always;          /* the manifest changes even if no segment does. It frees disk, so it may exceed the quota */
	uint64_t memory_max;  /* for `choose`: rewrite_bytes may not exceed it */
	const uint32_t *drop; /* sources whose records are dropped, ascending; `choose` sets it, `done` frees it */
	size_t ndrop;

	/* What was chosen, and what was made of it. A unit is a row of old segments that become one new segment. */
	struct grid_segment_info *old, *made; /* made: points == 0: no segment */
	size_t nold, cap;                     /* cap: of all arrays */
	size_t *unit_end;                     /* of each unit: the index behind its last segment in `old` */
	bool *unit_empty;                     /* of each unit: nothing of it stays, so no segment is made */
	size_t nunits, nmade;
	char (*gone)[64]; /* other files that nothing names after that; `choose` sets it */
	size_t ngone;
	size_t nsources;        /* of the manifest */
	uint64_t read, written; /* bytes of segments */

	/* of dataset_rewrite.c */
	enum rewrite_state state;
	struct datasets *datasets;
	struct grid_rewrite *rewrite;
	struct dataset_obsolete *obsolete;
	uint64_t row_id, bytes, space;
	char base_name[64], new_name[64];
	bool opened, cancelled, has_row, busy;
	bool retry; /* the state starts again at the next tick */
	int r;
	struct err err;
};

/* `done` is called later. */
void dataset_rewrite_start(struct dataset_rewrite *);
/* `done` comes soon with -ERR_CANCELLED, unless the manifest is being committed already. */
void dataset_rewrite_cancel(struct dataset_rewrite *);
void dataset_rewrite_settle(struct dataset_rewrite *); /* asks again for memory, if it waits for some */
void dataset_rewrite_tick(struct dataset_rewrite *);
void dataset_rewrite_clear(struct dataset_rewrite *);

/* ---- for `choose` ---- */

/* Adds a unit of n segments. They become one without the dropped sources; empty: all of their records are dropped. */
int rewrite_add(struct dataset_rewrite *, const struct grid_segment_info *const *segments, size_t n, bool empty, struct err *err);
void rewrite_drop_last(struct dataset_rewrite *);       /* takes the last segment out of the last unit */
uint64_t rewrite_bytes(const struct dataset_rewrite *); /* memory that the rewrite needs, after adding */

#endif
