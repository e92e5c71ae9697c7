/* A work folder with a dataset, as the phase commit leaves it, and what one process makes of the same points. */
#ifndef MESH_FIXTURE_H
#define MESH_FIXTURE_H

#include <sys/types.h>

#include "grid_fixture.h"
#include "mesh_phase.h"
#include "pipe.h"
#include "store_pack.h"

struct run {
	char folder[128];
	struct work *work;
	struct set set;
	uint32_t tasks;
	struct mesh_phase_params p;
};
/* On few places, lines and grids, or anywhere: at most 300 points. */
struct set small_set(uint64_t *seed);
extern uint32_t run_gathers; /* tasks of gather that runs get from now on; 0 at first */
/* The set becomes the run's. */
void run_make(struct run *, const char *folder, struct set set, unsigned segments, uint32_t tasks);
void run_remove(struct run *);

/* A mesh: its regions in order, and its totals. */
struct whole {
	struct whole_domain {
		char region[CUT_REGION_TEXT_SIZE];
		struct digest digest, own;
		uint64_t vertices;
	} * domain;
	size_t n, room, splits;
	struct pipe_totals totals;
};
void whole_free(struct whole *);
/* All domains of one plan, in this process. */
void whole_make(const struct run *, uint32_t load, uint32_t cap, struct whole *ret);
/* What the packs of the run have, and the sums of its records. */
void whole_gather(const struct run *, struct whole *ret, struct mesh_sums *ret_sums);
void whole_same(const struct whole *a, const struct whole *b);

extern char run_top[64], run_folder[128]; /* of the test; of the run that was made last */
void set_up(struct run *run, struct set set, unsigned segments, uint32_t tasks);
/* The plan and all tasks. */
void run_all(const struct run *run);
/* The packs against one process, and the records against both. */
void compare(const struct run *run, const struct whole *want);
/* The work folder opened anew, for another process, which is killed when it is asked so often for an interrupt (0: never). */
struct work *run_opened(const struct run *, unsigned killed);
int status_of(pid_t pid);

/* Make and remove run_top. */
int run_begin(void **state);
int run_end(void **state);

#endif
