/* The stage, as grid_stage*.c and grid_seal*.c share it. */
#ifndef GRID_STAGE_PRIV_H
#define GRID_STAGE_PRIV_H

#include "err.h"
#include "grid_merge.h"
#include "grid_run.h"
#include "grid_stage.h"

enum { STEM_MAX = GRID_NAME_MAX - 16 };

/* Memory for one thread: a part of `pts`, and the same part of `scratch`. */
struct grid_lane {
	size_t first, n, cap;
	bool busy;
};

struct grid_stage {
	int dirfd, segment_dirfd;
	bool durable, temporary, folder_later, failed, sealed;
	int (*ready)(void *ctx, struct err *err); /* as in the params */
	void *ready_ctx;
	bool leftovers; /* a run that is not needed any more could not be removed */
	char stem[STEM_MAX], segment[STEM_MAX];
	uint8_t *pages; /* index pages of the segment; the beginning of all memory */
	size_t memory;
	bool huge;      /* huge pages were requested */
	uint8_t *lists; /* tables of runs, for the seal */
	size_t lists_bytes;
	struct point *pts, *scratch; /* two halves, one after the other */
	size_t cap;                  /* records in each half */
	struct grid_lane lane[GRID_LANES];
	unsigned lanes;                /* 1: not split */
	struct grid_guard guard;       /* while it is split */
	struct err why;                /* the first failure of a thread while it was split */
	uint32_t table[POINT_SOURCES]; /* sources of the records in memory */
	uint32_t ntable, source;       /* source: index of the current source */
	bool unsynced;                 /* there are run names since the last fsync of the folder */
	uint32_t *all;                 /* every source of the stage, ascending */
	uint32_t nall, allcap;
	uint32_t *runs; /* numbers of the runs, oldest first */
	size_t nruns, runcap;
	uint32_t next_run;
	bool suspended;      /* there is a state file */
	uint32_t state_next; /* runs from this number on are not in it */
	uint32_t *dropped;   /* dropped sources that may have points in runs, ascending */
	uint32_t ndropped, droppedcap;
};

/* grid_stage.c */
/* Populates the pages of memory that will be written next, unless they are huge pages. Page faults one by one would cost more
 * than all other work of a small push. */
void grid_stage_touch(const struct grid_stage *, void *from, size_t bytes);
/* Joins the lanes. Fails if the stage has failed or is sealed. */
int grid_stage_usable(struct grid_stage *, struct err *err);
int grid_stage_fail(struct grid_stage *, int rc); /* returns rc; marks the stage as failed unless it is 0 */
/* Inserts `id` into an ascending list of *n entries (capacity *cap), unless it is there. */
int grid_stage_insert(uint32_t **list, uint32_t *n, uint32_t *cap, uint32_t id, struct err *err);
/* Writes the points in memory to a run; the current source stays. */
int grid_stage_spill(struct grid_stage *, struct err *err);
/* Adds a run to the list and returns its name. */
int grid_stage_add_run(struct grid_stage *, char ret_name[GRID_NAME_MAX], struct err *err);
void grid_stage_run_name(const struct grid_stage *, uint32_t number, char name[GRID_NAME_MAX]);
void grid_stage_remove_run(struct grid_stage *, uint32_t number);
/* Removes the n oldest runs. */
void grid_stage_drop_runs(struct grid_stage *, size_t n);
/* Renumbers the source indices in the tags so that sorting by tag sorts by source. */
void grid_stage_rank(struct grid_stage *);
struct grid_stage *grid_stage_release(struct grid_stage *); /* frees the memory only */

/* grid_seal_premerge.c: merges runs until the seal can merge the rest at once. *ret: free memory for the seal. */
int grid_seal_premerge(struct grid_stage *, uint8_t **ret, size_t *ret_bytes, struct err *err);

/* grid_stage_suspend.c */
/* Writes the state without the `gone` oldest runs. */
int grid_stage_write_state(struct grid_stage *, size_t gone, struct err *err);
/* Removes the records of dropped sources; returns how many of n remain. ids may be NULL if none was dropped. */
size_t grid_stage_filter_dropped(const struct grid_stage *, struct point *pts, uint32_t *ids, size_t n);

#endif
