/*
 * The phases of a cluster run that turn inputs into a dataset: head, stage, sort, commit (cluster.md, "Survey").
 *
 * Each is one task from beginning to end: it begins an attempt, does its work within the memory of a task, and publishes the
 * record. 0: the task has its record, from this attempt or from another. A failure is recorded (work_fail) before it is returned;
 * -ERR_CANCELLED is not. Any thread; one phase at a time in a work folder that was opened. Callbacks come from any thread, one at
 * a time.
 */
#ifndef SURVEY_H
#define SURVEY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "agree_set.h"
#include "work.h"

struct err;

struct survey_params {
	/* What the command says of the inputs, the same for all phases of a run. `says.geoid` is the path of a grid in a file
	 * (.pgm); NULL or "": heights stay. */
	struct agree_words says;
	const char *format;  /* of all inputs; NULL: by content */
	const char *columns; /* of texts, as input_options; NULL: by their own headers */
	bool decimal_comma, accept_truncated, strict;
	bool grows; /* the lattice leaves room for other inputs later, as in a push; else as in acutctl mesh INPUT */

	/* Of this node. */
	const char *scratch; /* a folder for temporary files of a stage; NULL: they are in the work folder */
	/* An input that is refused, by its path in err.file; what is odd about one that is read. May be NULL. */
	void (*refused)(void *ctx, const struct err *why);
	void (*warned)(void *ctx, const char *path, const char *text);
	void *ctx;
};

/* Memory of a head task, which needs more than a task is given where there are many inputs, and enough for a commit; and that of
 * the smallest stage or sort task. For what a scheduler is asked for. */
uint64_t survey_head_bytes(uint64_t inputs);
uint64_t survey_least_bytes(uint64_t inputs);

/*
 * What the records say (work_record_text, work_record_u64):
 *   head: inputs, bytes, points (as headers claim), crs, unit_xy, unit_z, lattice, zone and datum ("": nothing is projected),
 *         geoid, note (what the lattice rounds; ""), warnings
 *   stage: inputs, points, moved (rounded to the lattice), max_shift ("X Y Z"), left_out (lines of texts), bytes_read, warnings;
 *         "warning N": PATH: TEXT
 *   sort: points
 *   commit: inputs, points, moved, left_out, warnings, segments, bytes (of the dataset's files)
 */

/* The headers of all inputs. -ERR_INPUT and others: some are refused, each was told by `refused`; the error counts them. */
int survey_head(struct work *, const struct survey_params *, struct err *err);
/* The points of some of them, as one segment. -ERR_CHANGED: an input is not what it was. */
int survey_stage(struct work *, uint32_t task, const struct survey_params *, struct err *err);
/* All records of a range of keys, from all segments, as one. */
int survey_sort(struct work *, uint32_t task, const struct survey_params *, struct err *err);
/* The dataset: WORK_IN_DATASET "/manifest" and what it names. */
int survey_commit(struct work *, const struct survey_params *, struct err *err);

#endif
