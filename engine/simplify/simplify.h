/*
 * Simplification: of the points of a view, few that make a mesh from which no point of the view is farther than an error, up or
 * down. They become a grid of their own, as a selection does (selection.h), so that plans, halos, domains and windows work on it
 * as on any other. docs/design/simplify.md has the method and the proof.
 *
 * A simplification is a series of steps. A step has tasks, which any threads may do in any order; when all are done, one thread
 * calls simplify_next, which begins the next step. There are no threads and no clock in here. Everything is in files of one
 * folder: after a crash, or when the memory is needed by others, simplify_open continues behind the last finished task. The
 * result depends on the points, the lines and the error alone: not on memory, threads, order, or how often it was interrupted.
 *
 *	r = simplify_open(&params, &s, &err);
 *	do {
 *		for each i < simplify_tasks(s), in any thread, if !simplify_task_done(s, i):
 *			r = simplify_task(s, i, memory, &err);
 *		r = simplify_next(s, &err);
 *	} while (!r);
 *	r == SIMPLIFY_E_DONE: the folder has the manifest SIMPLIFY_MANIFEST, and the report
 *	simplify_free(s);
 */
#ifndef SIMPLIFY_H
#define SIMPLIFY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "digest.h"
#include "grid.h"
#include "view.h"

struct err;
struct ledger;

struct simplify_params {
	/* The points: a generation, or the selection of a view with crop, every or thin; and the view that applies to them (of a
	 * selection view_rest). The view is bound; its window is ignored. Borrowed until simplify_free. */
	const struct grid *grid;
	const struct view *view;
	int64_t max_error;   /* lattice numbers of z, at least 0; if max_points is 0 */
	uint64_t max_points; /* instead: the most points of the result; the error is found */
	/* Bytes of `memory` of each simplify_task, and what simplify_next allocates; at least simplify_memory_min. The caller
	 * has charged it. */
	size_t memory;
	/* For the index of the result, besides: charged to the ledger (LEDGER_INDEX; may be NULL) while it is open. */
	size_t index_memory;
	struct ledger *ledger;
	int dirfd; /* a folder of its own; borrowed until simplify_free */
	/* If the grid has lines: the line set file of the generation, as in struct grid_use. Else NULL. */
	const char *lines;
	int linesfd;
	/* Called by every thread at short intervals; non-zero cancels (-ERR_CANCELLED). May be NULL. */
	int (*progress)(void *ctx);
	void *ctx;
};

#define SIMPLIFY_MANIFEST "manifest" /* in the folder, written when the report is */

size_t simplify_memory_min(const struct grid *);
/* The identity of the result: the content, coordinate system and units of the grid, the rules of the view, the numbers. */
struct digest simplify_key(const struct grid *, const struct view *, int64_t max_error, uint64_t max_points);

struct simplify;
/* Begins, or continues what is in the folder. -ERR_CORRUPT: what is there cannot be continued; empty the folder. */
int simplify_open(const struct simplify_params *, struct simplify **ret, struct err *err);
struct simplify *simplify_free(struct simplify *); /* what was done stays; NULL is fine; returns NULL */

/* Of the present step. These do not fail, and any thread may ask. */
uint32_t simplify_tasks(const struct simplify *);
bool simplify_task_done(const struct simplify *, uint32_t task);
/*
 * Does a task of the present step. Several threads may do different tasks at once, each with memory of its own
 * (params.memory bytes, aligned to 64). Its result is in a file when it returns, and is not made again.
 * -ERR_LIMIT: the memory does not suffice; err.need bytes would. -ERR_NOSPACE, and any other: it may be tried again.
 */
int simplify_task(struct simplify *, uint32_t task, void *memory, struct err *err);
/*
 * When all tasks are done and no thread is in one: begins the next step. It may read and write much, so it belongs on a worker.
 * SIMPLIFY_E_DONE: there is none; the result is complete, and the folder has nothing else. A failure leaves the present step,
 * and it may be tried again. -ERR_LIMIT with max_points: the hull and the vertices of lines alone are more points; the message
 * has their number, err.need too.
 */
enum { SIMPLIFY_E_DONE = 1 };
int simplify_next(struct simplify *, struct err *err);

/* For progress; any thread may ask. */
struct simplify_state {
	enum simplify_step {
		SIMPLIFY_DIVIDE, /* finds the blocks: one task */
		SIMPLIFY_BLOCKS, /* chooses points block by block */
		SIMPLIFY_CHECK,  /* a round: tests all points against the mesh of those chosen */
		SIMPLIFY_DONE,
	} step;
	unsigned attempt;  /* with max_points: how many errors were tried before this one */
	unsigned round;    /* of SIMPLIFY_CHECK, the first is 0 */
	uint64_t chosen;   /* points so far, in SIMPLIFY_CHECK */
	uint64_t added;    /* of these, by the last round */
	int64_t max_error; /* lattice numbers; with max_points the one that is tried */
};
const char *simplify_step_text(enum simplify_step); /* "divide", "blocks", "check", "done" */
void simplify_state(const struct simplify *, struct simplify_state *ret);

/* What was done; in the folder of a finished simplification. The last round added no point, so it is the proof: every point of
 * the view that is in the mesh was tested in it or in an earlier round, against a triangle that is still there. */
struct simplify_report {
	uint64_t points;   /* positions of the view, duplicates reduced; that is what a mesh of the view would have */
	uint64_t kept;     /* of these, in the result */
	uint64_t lines;    /* of `kept`: vertices of lines */
	uint64_t hull;     /* of `kept`: corners of the hull of all */
	uint64_t seeds;    /* of `kept`: chosen in the blocks; hull and vertices of lines too */
	uint64_t rounds;   /* rounds that added points */
	uint64_t tested;   /* tests of a point against a triangle, in all rounds */
	uint64_t attempts; /* with max_points: errors that were tried; else 1 */
	int64_t max_error; /* lattice numbers: no point is farther */
	uint64_t largest;  /* thousandths of them: the greatest distance of a point, rounded up */
	/* The view removed or reduced these records of the grid, by rule; as counts of domains have them. */
	uint64_t records, removed[VIEW_RULES];
};
int simplify_report_read(int dirfd, struct simplify_report *ret, struct err *err);

#endif
