/* The insides of a stage, shared by grid_stage.c and grid_stage_leave.c. */
#ifndef GRID_STAGE_PRIV_H
#define GRID_STAGE_PRIV_H

#include "grid.h"
#include "grid_merge.h"
#include "grid_run.h"

enum { STEM_MAX = GRID_NAME_MAX - 16 };

struct grid_stage {
	int dirfd;
	bool durable, failed, sealed;
	bool litter; /* a run could not be removed when it was not needed any more */
	char stem[STEM_MAX];
	uint8_t *memory;
	size_t buffer;     /* bytes of the file buffer, at the start of memory */
	uint8_t *halves;   /* both halves, one after the other */
	size_t half;       /* bytes of each */
	struct point *pts; /* the first half */
	size_t n, cap;
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
	struct grid_merge merge;
};

/* grid_stage.c */
int grid_stage_usable(const struct grid_stage *, struct err *err);
int grid_stage_fail(struct grid_stage *, int rc); /* rc; if it is not 0 the stage is done for */
/* `id` into an ascending list of *n of *room entries, once. */
int grid_stage_insert(uint32_t **list, uint32_t *n, uint32_t *room, uint32_t id, struct err *err);
/* What is in memory becomes a run; the source that is being added stays. */
int grid_stage_spill(struct grid_stage *, struct err *err);
void grid_stage_remove_run(struct grid_stage *, uint32_t number);
struct grid_stage *grid_stage_release(struct grid_stage *); /* the memory alone */

/* grid_stage_leave.c */
/* The state without the `gone` oldest runs. */
int grid_stage_write_left(struct grid_stage *, size_t gone, struct err *err);
/* Of n merged records those that nobody dropped; ids may be NULL if nobody dropped any. */
size_t grid_stage_leave_out(const struct grid_stage *, struct point *pts, uint32_t *ids, size_t n);

#endif
