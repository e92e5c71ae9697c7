/*
 * The phases sum, gather and finish: the domains that the tasks of the phase mesh have in their packs become outputs.
 *
 * The task sum writes down what all packs have, and divides the work.
 * A task of gather writes its outputs beside their places, under names that have its attempt. The task finish gives them their
 * names and writes the report. Neither changes a file of an earlier phase.
 */
#ifndef GATHER_H
#define GATHER_H

#include <stdbool.h>
#include <stdint.h>

#include "ctl_fetch.h"

struct err;
struct work;

struct gather_params {
	struct work *work;
	const struct ctl_fetch_options
		*outputs;    /* as the command line gave them; paths are absolute, or of the working directory */
	const char *scratch; /* a folder of this node for temporary files; NULL: they are in the work folder */
	uint64_t memory;     /* of the task, all in all */
	uint64_t block;      /* bytes of a file that one task writes alone, at least; 0: 4 MiB */
};

/* When a command is submitted: refuses by name what gather cannot write (-ERR_USAGE), and, by the points that the inputs claim,
 * one PLY of more than 2^31 vertices. */
int gather_check(const struct ctl_fetch_options *, uint64_t claimed_points, struct err *err);
/* Whether more than one task of gather can have something to do; if not, one is enough. */
bool gather_divides(const struct ctl_fetch_options *);

/* Before any task of a run, and before one is submitted. -ERR_VERSION: another version of acut began the run, which has no phase
 * sum, or may have another order of vertices and triangles. Runs without a mesh are of any version. */
int gather_check_run(const struct work *, struct err *err);

/* The one task of the phase sum, task `index` of the phase gather, and the one of the phase finish; each publishes its record. */
int gather_sum(const struct gather_params *, struct err *err);
int gather_task(const struct gather_params *, uint32_t index, struct err *err);
int gather_finish(const struct gather_params *, struct err *err);
/* Before tasks are submitted again: where one has failed, the records of those whose results are not there any more are removed,
 * so that these are made again: the manifest with its file of sources, plans, packs, sums, lists of outputs, and outputs that
 * have no name yet. *ret: how many. Tasks may run at the same time; such a task may fail, and is then to be submitted again. */
int gather_recover(const struct gather_params *, uint32_t *ret, struct err *err);
/* When no task of the run runs any more: removes what killed attempts left beside the outputs. Lists their folders. */
int gather_clean(const struct gather_params *, struct err *err);

#endif
