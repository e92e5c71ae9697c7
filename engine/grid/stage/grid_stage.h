/*
 * Making a segment: a stage takes points in any order, sorts them into runs on disk, and a seal merges the runs into
 * one immutable segment. format.md describes the files.
 */
#ifndef GRID_STAGE_H
#define GRID_STAGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid_segment_info.h"
#include "point.h"

struct err;

/* Synchronization between the threads that work on one stage. All members are NULL if there is only one thread. */
struct grid_guard {
	void (*lock)(void *ctx), (*unlock)(void *ctx);
	void (*wait)(void *ctx); /* unlocks until a wake; may return spuriously */
	void (*wake)(void *ctx); /* wakes all waiters; called under the lock */
	void *ctx;
};

struct grid_stage;

struct grid_stage_params {
	int dirfd;         /* folder for runs, and for the segment (borrowed) */
	const char *name;  /* file name stem of its files, unique in the folder */
	size_t memory;     /* bytes for the stage's buffers; the caller has charged them */
	bool durable;      /* runs are fsynced; if not, grid_stage_sync does nothing */
	bool temporary;    /* the segment need not survive a crash, so it is not fsynced */
	bool folder_later; /* the caller fsyncs the folder after the seal, which makes the segment's name durable */
	/* Called before each run is created; it may block. If it fails, the stage fails with its result. May be NULL. */
	int (*ready)(void *ctx, struct err *err);
	void *ready_ctx;
	int segment_dirfd;   /* folder for the segment (borrowed); 0: dirfd, too */
	const char *segment; /* file name stem of the segment, likewise unique; NULL: `name` */
};

enum { GRID_STAGE_MIN = 1 << 20 }; /* the smallest `memory` */

int grid_stage_new(const struct grid_stage_params *, struct grid_stage **ret, struct err *err);
/* All points that are added from now on belong to source `id` (its number in the manifest, > 0). */
int grid_stage_source(struct grid_stage *, uint32_t id, struct err *err);
/* Adds points with lattice coordinates; their tags hold flags only. Sorts and writes a run when the memory is full. */
int grid_stage_add(struct grid_stage *, const struct point *pts, size_t n, struct err *err);

/*
 * Several threads can add the points of one source. After the split, as many threads as lanes may call
 * grid_stage_share at once. A thread that finds all lanes full sorts one and writes it to a run. When all threads are
 * done, the next call of any other function joins the lanes again. `guard` is copied.
 */
enum { GRID_LANES = 16 };
unsigned grid_stage_lanes(const struct grid_stage *); /* the most lanes that its memory allows, at least 1 */
int grid_stage_split(struct grid_stage *, unsigned lanes, const struct grid_guard *guard, struct err *err);
int grid_stage_share(struct grid_stage *, const struct point *pts, size_t n, struct err *err);
/* When this returns, everything added so far is in fsynced runs (durable stages only). */
int grid_stage_sync(struct grid_stage *, struct err *err);

/* Merges the runs and the points in memory into a segment, published durably. Removes the runs, unless the stage was
 * suspended: then they stay until grid_stage_free or grid_stage_discard. */
int grid_stage_seal(struct grid_stage *, struct grid_segment_info *ret, struct err *err);

/*
 * The same in steps, for several threads. The segment does not depend on the number of threads or on the order of
 * their steps. Between grid_seal_begin and grid_seal_finish the stage must not be used otherwise.
 */
struct grid_seal;
enum { GRID_SEAL_DONE = 1 };
/* `workers`: the most threads that will take steps. */
int grid_seal_begin(struct grid_stage *, unsigned workers, const struct grid_guard *guard, struct grid_seal **ret,
		    struct err *err);
unsigned grid_seal_workers(const struct grid_seal *); /* the most threads that its memory can keep busy, at least 1 */
/* Does a part of the work; any thread may call it. GRID_SEAL_DONE: no further step need begin. The first failure is
 * returned to all threads. */
int grid_seal_step(struct grid_seal *, struct err *err);
/* Records in the segment so far, and in all. Any thread may call it. */
void grid_seal_progress(struct grid_seal *, uint64_t *ret_done, uint64_t *ret_all);
/* Call it when no thread is in a step. Returns what grid_stage_seal returns, and frees the seal. */
int grid_seal_finish(struct grid_seal *, struct grid_segment_info *ret, struct err *err);
struct grid_seal *grid_seal_free(struct grid_seal *); /* abandons the seal; the stage has then failed */

/* Removes all files of the stage except a finished segment, also those of an earlier grid_stage_suspend. After a
 * failure only this and grid_stage_detach may be called. */
struct grid_stage *grid_stage_free(struct grid_stage *);
/* Drops the sources that `keeps` denies: the segment will have neither their records nor their numbers, and nothing can be added
 * to them any more. Their records in runs stay there: a stage that is resumed later has these sources again. `keeps` may be asked
 * twice. */
int grid_stage_keep(struct grid_stage *, bool (*keeps)(void *ctx, uint32_t id), void *ctx, struct err *err);

/* Writes everything added so far to runs, and a state file NAME.stage that lists them (both fsynced if durable). From
 * then on another stage of that name can resume from here, whatever happens to this one. */
int grid_stage_suspend(struct grid_stage *, struct err *err);
/* Frees the stage. What the last grid_stage_suspend wrote stays on disk, later runs are removed. */
struct grid_stage *grid_stage_detach(struct grid_stage *);
/* Resumes the suspended stage params->name. -ERR_CORRUPT, -ERR_IO: that is not possible. */
int grid_stage_resume(const struct grid_stage_params *, struct grid_stage **ret, struct err *err);
/* 0 if a suspended stage of that name looks intact. *ret_last: the largest number of a source that has points in it,
 * or 0. *ret_bytes: of its runs. */
int grid_stage_check(int dirfd, const char *name, uint32_t *ret_last, uint64_t *ret_bytes, struct err *err);
/* Removes the files of a suspended stage; succeeds if there are none. */
int grid_stage_discard(int dirfd, const char *name, struct err *err);

#endif
