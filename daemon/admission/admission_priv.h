/* What the files of this room share. */
#ifndef ADMISSION_PRIV_H
#define ADMISSION_PRIV_H

#include "admission.h"

struct admission {
	struct core *core;
	struct admission_run *runs;
	struct admission_stage *stages; /* the youngest first */
	struct admission_stage *turn;   /* has the next stage; NULL: nobody waits for one */
	uint64_t emitter_share, index_share, stage_share, reserve, reserve_part;
	uint64_t rewriting; /* memory that merge and prune hold */
	unsigned runs_max;
	struct slot *slots; /* that are sought */
	unsigned nslots;
	bool granting;
	uint64_t last_slot, grants;
	uint64_t starved_ns; /* since when the first in the queue lacks memory; 0: it does not */
};

#endif
