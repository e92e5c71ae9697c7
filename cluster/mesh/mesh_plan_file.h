/*
 * The file of a plan in two levels (format.md, "Plans of a cluster"): what all tasks have in common, then for each task its range
 * of top leaves. A reader reads and checks the parts that it needs.
 */
#ifndef MESH_PLAN_FILE_H
#define MESH_PLAN_FILE_H

#include "cut.h"
#include "digest.h"

struct err;

enum { MESH_PLAN_HEAD = 320, MESH_PLAN_TASK = 32, MESH_PLAN_LEAF = 16 };

struct mesh_plan {
	uint64_t leaves;
	uint32_t tasks, load, cap, top; /* top: the load of the top leaves */
	bool flat;
	struct digest content; /* of the generation */
	struct mesh_counts empty;
	char *view;       /* canonical text */
	struct digest of; /* of the whole file */
	/* Of a file that was read. */
	int fd;
	const char *name;  /* borrowed */
	uint64_t at, size; /* of the tasks; of the file */
};
/* `leaf`: all of them. `first`: for each task the number of its first leaf, ascending, and p->leaves behind the last. Sets p->of.
 */
int mesh_plan_write(int fd, const char *name, struct mesh_plan *p, const struct cut_leaf *leaf, const uint64_t *first,
		    struct err *err);
/* Reads what the tasks have in common. fd stays the caller's. mesh_plan_done frees the view. */
int mesh_plan_read(int fd, const char *name, struct mesh_plan *ret, struct err *err);
void mesh_plan_done(struct mesh_plan *);
/* The leaves of a task, to be freed; NULL if there are none. */
int mesh_plan_leaves(const struct mesh_plan *, uint32_t task, struct cut_region **ret, uint64_t *ret_n, struct err *err);

#endif
