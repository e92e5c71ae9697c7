/* The line set of a generation that no push makes: as it was in an earlier generation, or made of the files of lines. */
#ifndef DATASET_LINES_H
#define DATASET_LINES_H

#include "breaklines.h"
#include "dataset_priv.h"

/* The caller sets the first fields and leaves the rest zero. It holds the dataset. */
struct dataset_lines {
	struct sched_task task;
	struct dataset_lines *next; /* in datasets.lines, while it waits for memory */
	struct dataset *dataset;
	struct peer peer;
	const char *what; /* its name in messages: "a revert" */
	/* Loop: all that dataset_lines_wait waits for is there, or `why` it is not. */
	void (*ready)(struct dataset_lines *, const struct err *why);

	/* of dataset_lines.c */
	uint64_t want, have; /* memory */
	bool lacks, exact;   /* exact: `want` is no estimate */
	bool taking;         /* a task waits for it */
	uint64_t vertices;   /* of the lines; -> disk */
	uint64_t disk;       /* bytes, taken for `uid` */
	uint32_t uid;
	uint64_t row_id;
	bool has_row, stays;  /* stays: files may be there that no manifest names */
	uint32_t id, free_id; /* of the source of line vertices; the first number that the manifest does not have */
	struct breaklines made;
	uint64_t added, removed; /* its generations */
	struct err err;
};

/*
 * Worker, in a change: puts the line set of the lines of generation m->generation into `m`, which has room for a source and a
 * segment more; `lives` has room for one life more than any source has. If the lines were together before, in a generation after
 * `pruned`, they get the line set of then. Else a new one is made, and that needs memory: a negative result, and
 * dataset_lines_lacks.
 */
int dataset_lines_put(struct dataset_lines *, struct grid_manifest *m, uint64_t pruned, struct grid_span *lives, struct err *err);
/* The same for an earlier generation, which has lines and no line set; `m` stays of its generation. */
int dataset_lines_put_at(struct dataset_lines *, struct grid_manifest *m, uint64_t generation, struct err *err);
/* Worker, with the folder open: the change failed, and the catalogue does not name what was made. */
void dataset_lines_undo(struct dataset_lines *);
/* Loop, when the change is over: it failed because there was too little memory. */
bool dataset_lines_lacks(const struct dataset_lines *);
/* Loop: waits for memory, disk space, and a row by which a start finds what will be made. `ready` may be called before this
 * returns. */
void dataset_lines_wait(struct dataset_lines *);
/* Loop: gives all of that back. */
void dataset_lines_end(struct dataset_lines *, bool committed);

#endif
