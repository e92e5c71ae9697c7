/* The insides of a stage, shared by grid_stage*.c and grid_seal*.c. */
#ifndef GRID_STAGE_PRIV_H
#define GRID_STAGE_PRIV_H

#include "err.h"
#include "grid.h"
#include "grid_merge.h"
#include "grid_run.h"

enum { STEM_MAX = GRID_NAME_MAX - 16 };

/* Where one thread at a time puts records: a part of the records' half, and the same part of the scratch. */
struct grid_lane {
	size_t first, n, cap;
	bool busy;
};

struct grid_stage {
	int dirfd;
	bool durable, passing, folder_later, failed, sealed;
	int (*ready)(void *ctx, struct err *err); /* as in the params */
	void *ready_ctx;
	bool litter; /* a run could not be removed when it was not needed any more */
	char stem[STEM_MAX];
	uint8_t *pages; /* of the segment's index; the start of all memory */
	size_t memory;
	bool huge;      /* it has large pages by now, if the kernel has any */
	uint8_t *lists; /* behind them: of runs, while sealing */
	size_t lists_bytes;
	struct point *pts, *scratch; /* the halves, one after the other */
	size_t cap;                  /* records of each */
	struct grid_lane lane[GRID_LANES];
	unsigned lanes;                /* 1: not split */
	struct grid_guard guard;       /* while it is split */
	struct err why;                /* failed while it was split: of who failed first */
	uint32_t table[POINT_SOURCES]; /* sources of the records in memory */
	uint32_t ntable, source;       /* source: index of the one that is being added */
	bool unsynced;                 /* run names that the folder's fsync has not covered */
	uint32_t *all;                 /* every source seen, ascending */
	uint32_t nall, allcap;
	uint32_t *runs; /* their numbers, oldest first */
	size_t nruns, runcap;
	uint32_t next_run;
	bool left;          /* there is a state file */
	uint32_t left_next; /* runs from this number on are not in it */
	uint32_t *dead;     /* dropped sources that may have points in runs, ascending */
	uint32_t ndead, deadcap;
};

/* grid_stage.c */
/* These bytes of its memory will be written: their pages at once, where they are small. One by one takes the kernel longer than
 * the rest of a small push. */
void grid_stage_touch(const struct grid_stage *, void *from, size_t bytes);
int grid_stage_usable(struct grid_stage *, struct err *err); /* and what was split is one again */
int grid_stage_fail(struct grid_stage *, int rc);            /* rc; if it is not 0 the stage is done for */
/* `id` into an ascending list of *n of *room entries, once. */
int grid_stage_insert(uint32_t **list, uint32_t *n, uint32_t *room, uint32_t id, struct err *err);
/* What is in memory becomes a run; the source that is being added stays. */
int grid_stage_spill(struct grid_stage *, struct err *err);
/* A name for another run, which is in the list from now on. */
int grid_stage_add_run(struct grid_stage *, char ret_name[GRID_NAME_MAX], struct err *err);
void grid_stage_run_name(const struct grid_stage *, uint32_t number, char name[GRID_NAME_MAX]);
void grid_stage_remove_run(struct grid_stage *, uint32_t number);
/* The n oldest runs are not needed any more. */
void grid_stage_drop_runs(struct grid_stage *, size_t n);
/* The indices in the tags are in the order of the sources from here on, so that sorting by tag sorts by source. */
void grid_stage_rank(struct grid_stage *);
struct grid_stage *grid_stage_release(struct grid_stage *); /* the memory alone */

/* grid_seal_runs.c: so few runs that a seal in `slots` at once, at best, can merge them. *ret: free memory. */
int grid_seal_prepare(struct grid_stage *, uint8_t **ret, size_t *ret_bytes, struct err *err);

/* grid_stage_leave.c */
/* The state without the `gone` oldest runs. */
int grid_stage_write_left(struct grid_stage *, size_t gone, struct err *err);
/* Of n merged records those that nobody dropped; ids may be NULL if nobody dropped any. */
size_t grid_stage_leave_out(const struct grid_stage *, struct point *pts, uint32_t *ids, size_t n);

#endif
