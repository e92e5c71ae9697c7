/* Shared by the files of this room, and by its tests. Amounts are bytes. */
#ifndef ADMISSION_PRIV_H
#define ADMISSION_PRIV_H

#include "admission.h"

struct admission {
	struct core *core;
	struct admission_run *runs;         /* the oldest first */
	struct admission_stage *stages;     /* the youngest first */
	struct admission_stage *next_stage; /* has the next memory for a stage; NULL: none waits */
	uint64_t emitter_share, index_share, stage_share;
	uint64_t fixed;              /* service_bytes */
	uint64_t fixed_proportional; /* the part of it that grows with the total */
	uint64_t rewrite_bytes;      /* held by merges and prunes */
	unsigned runs_max;
	struct slot *slots; /* that are requested, by number */
	unsigned nslots;
	bool granting;
	uint64_t last_slot, grants;
	uint64_t starved_ns; /* since when the first task in the queue lacks memory; 0: it does not */
};

#endif
