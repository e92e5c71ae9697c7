/* What the files of the phases plan and mesh share. Internal. */
#ifndef MESH_PRIV_H
#define MESH_PRIV_H

#include "grid.h"
#include "ledger.h"
#include "mesh_phase.h"
#include "mesh_plan_file.h"
#include "pipe.h"
#include "view.h"

/* A phase that runs. */
struct phase;
typedef int (*phase_fn)(struct phase *, uint32_t task, struct err *err);
struct phase {
	phase_fn run;
	struct work *work;
	const struct mesh_phase_params *p;
	struct work_attempt *attempt;
	struct ledger *ledger;
	struct grid *grid; /* the dataset, once it is open */
	struct view view;
};

/* Runs a task (work_run). 0: it has its record. */
int phase_run(struct work *, enum work_phase, uint32_t task, const struct mesh_phase_params *, phase_fn, struct err *err);
/* The dataset of the run. Its files are waited for. */
int phase_open(struct phase *, struct err *err);
/* What a view asks for that no run of a cluster makes; NULL: nothing. */
const char *phase_refuses(const struct view *);
/* Memory of a task for the arena, once the dataset is open. The rest is for lists, which grow with its regions. */
uint64_t phase_arena(const struct phase *);
/* What a task has to have for an arena of so many bytes. */
uint64_t phase_arena_needs(const struct phase *, uint64_t bytes);
/* -ERR_LIMIT with what would suffice. */
int phase_needs(const struct phase *, uint64_t bytes, struct err *err);

/* The plan that the record of its phase names; fd: closed by the caller. name: its name. */
int phase_plan_open(const struct work *, struct mesh_plan *ret, char name[WORK_NAME], int *ret_fd, struct err *err);

void sums_add_domain(struct mesh_sums *, const struct mesh_domain *);

/* mesh_extent.c: of the index of a complete pack; the values of a record. */
int extent_of_pack(int fd, const char *name, struct mesh_extent *ret, struct err *err);
int extent_record(struct work_attempt *, const struct mesh_extent *, struct err *err);
int extent_read(const struct work_record *, const struct mesh_sums *, struct mesh_extent *ret, struct err *err);

#endif
