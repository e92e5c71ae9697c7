/*
 * A selection under way: what its walk (pipe_select.c) and the rule of thin cells (pipe_thin.c) share. Inner
 * door of pipe/.
 */
#ifndef PIPE_SELECT_H
#define PIPE_SELECT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "pipe.h"

enum { SELECT_BATCH = 512, SELECT_TABLE_MIN = 16 << 10 };

struct select {
	const struct pipe_select_params *p;
	struct grid_reader *reader;
	struct grid_stage *stage;
	void *table; /* of the thin rule: table_bytes */
	size_t table_bytes;
	struct pipe_selected out;
	uint64_t judged;     /* records that were read and judged, each once */
	uint64_t seen, told; /* records that were read, some more than once; when progress was last told */
	struct err *err;
	struct point batch[SELECT_BATCH];
	size_t nbatch;
};

/* Progress, and whether to go on: -ERR_CANCELLED. */
int select_tell(struct select *);
int select_keep(struct select *, const struct point *);

/* All points of the grid through view_judge and the thin rule. */
int select_thin(struct select *);

#endif
