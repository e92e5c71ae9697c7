/* The state file of a suspended stage: the runs and sources from which another process can resume it. */
#ifndef GRID_STATE_H
#define GRID_STATE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid_file.h"

struct err;

struct grid_state {
	uint32_t next_run;
	const uint32_t *runs; /* numbers, oldest first, all less than next_run */
	size_t nruns;
	const uint32_t *sources; /* of all records, ascending */
	size_t nsources;
	/* Only of a state that was read. */
	uint64_t bytes; /* of the runs */
	bool older;     /* some runs are of an older version */
	uint32_t *memory;
};

void grid_run_name(const char *stem, uint32_t number, char name[GRID_NAME_MAX]);
void grid_state_name(const char *stem, char name[GRID_NAME_MAX]);
int grid_state_write(int dirfd, const char *stem, const struct grid_state *, bool durable, struct err *err);
/* -ERR_CORRUPT: the file is damaged, or a run that it names. */
int grid_state_read(int dirfd, const char *stem, struct grid_state *ret, struct err *err);
void grid_state_free(struct grid_state *);
/* Removes the runs that the state does not name: runs that were merged into others, and runs written later, complete or
 * not. */
int grid_state_trim(int dirfd, const char *stem, const struct grid_state *, struct err *err);

#endif
