/* The state file of a stage that another process may go on with: which runs hold what was added. Internal. */
#ifndef GRID_LEFT_H
#define GRID_LEFT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid_file.h"

struct err;

struct grid_left {
	uint32_t next_run;
	const uint32_t *runs; /* their numbers, oldest first, all less than next_run */
	size_t nruns;
	const uint32_t *sources; /* of all their records, ascending */
	size_t nsources;
	uint32_t *memory; /* of one that was read */
};

void grid_left_run_name(const char *stem, uint32_t number, char name[GRID_NAME_MAX]);
void grid_left_name(const char *stem, char name[GRID_NAME_MAX]);
int grid_left_write(int dirfd, const char *stem, const struct grid_left *, bool durable, struct err *err);
/* -ERR_CORRUPT: it is not one, or a run that it names is not. */
int grid_left_read(int dirfd, const char *stem, struct grid_left *ret, struct err *err);
void grid_left_free(struct grid_left *);
/* Removes the runs that the state does not name: merged into others before, or written after it, whole or not. */
int grid_left_trim(int dirfd, const char *stem, const struct grid_left *, struct err *err);

#endif
