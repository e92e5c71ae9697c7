/* The seal, as grid_seal.c and grid_seal_slot.c share it. */
#ifndef GRID_SEAL_PRIV_H
#define GRID_SEAL_PRIV_H

#include "grid_segment_writer.h"
#include "grid_slices.h"
#include "grid_stage_priv.h"

enum { GRID_SEAL_SLOTS = GRID_LANES + 1 };

enum grid_slot_state { SLOT_FREE, SLOT_FILLING, SLOT_FILLED };

struct grid_slot {
	enum grid_slot_state state;
	struct grid_slice slice;
	uint64_t *seen; /* for each run: records read */
	struct point *window;
	uint32_t *ids;
	size_t cap; /* records of the window */
	void *merging;
	uint8_t *blocks; /* for each run: `ahead` blocks */
	unsigned ahead;
	uint8_t *memory; /* for cells */
	size_t size;
	struct grid_merge merge;
	struct grid_cells cells;
};

struct grid_seal {
	struct grid_stage *stage;
	struct grid_guard guard;
	struct grid_segment_writer seg;
	struct grid_slices slices;
	struct grid_slot slot[GRID_SEAL_SLOTS];
	unsigned nslots, workers;
	uint8_t *memory;
	size_t bytes;
	unsigned sorting, sorted; /* pieces: started, sorted */
	bool planned, punching, failed;
	struct err err;
	size_t placed;                       /* slices that were put completely */
	uint64_t *seen, *obsolete, *punched; /* for each run: records read; blocks not needed any more; blocks punched */
	uint64_t omitted;                    /* records of dropped sources */
};

static inline void grid_seal_lock(const struct grid_seal *z)
{
	if (z->guard.lock)
		z->guard.lock(z->guard.ctx);
}

static inline void grid_seal_unlock(const struct grid_seal *z)
{
	if (z->guard.unlock)
		z->guard.unlock(z->guard.ctx);
}

static inline void grid_seal_wait(const struct grid_seal *z)
{
	z->guard.wait(z->guard.ctx); /* a single thread never waits */
}

static inline void grid_seal_wake(const struct grid_seal *z)
{
	if (z->guard.wake)
		z->guard.wake(z->guard.ctx);
}

/* The smallest memory of a slot for n runs and these pieces of memory. */
size_t grid_slot_min_bytes(size_t n, unsigned pieces);
void grid_slot_init(struct grid_slot *, uint8_t *memory, size_t bytes, size_t n, unsigned pieces);
/* Makes the cells of the slot's slice. Called without the lock. */
int grid_slot_fill(struct grid_seal *, struct grid_slot *, uint64_t *ret_omitted, struct err *err);

#endif
