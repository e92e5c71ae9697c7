/*
 * Selections: a grid of exactly the points that a view with crop, every or thin keeps, so that plan, halos and domains
 * have exact counts and need not apply these rules. If the view has a metric, its positions are the mapped ones.
 */
#ifndef SELECTION_H
#define SELECTION_H

#include <stddef.h>
#include <stdint.h>

#include "digest.h"
#include "grid.h"
#include "view.h"

struct err;

/* `points` is the sum of `kept` and all of `removed`. */
struct selection_counts {
	uint64_t points;              /* of the generation */
	uint64_t removed[VIEW_RULES]; /* never as duplicates: that rule applies to the selected grid */
	uint64_t kept;                /* points of the selected grid */
	/* Of a view with a metric. For view_bind_map, after which the view (or its view_rest) fits the selected grid; the lattice
	 * stays that of the positions. */
	bool mapped;
	int64_t origin[2];
	int32_t box[4]; /* of the kept points before they were mapped */
};

struct selection_params {
	const struct grid *grid;
	const struct view *view; /* bound to the grid's lattice */
	size_t memory;           /* all the memory that it uses, at least selection_memory_min; charged by the caller */
	int dirfd;               /* a folder of its own, for the segment, the counts and, last, the manifest */
	/* May be NULL. Called at intervals with the points judged so far; non-zero cancels (-ERR_CANCELLED). */
	int (*progress)(void *ctx, uint64_t points);
	void *ctx;
};

#define SELECTION_MANIFEST "manifest" /* in the folder, written last */
#define SELECTION_LINES "lineset-2"   /* in the folder: the mapped pieces of a view with a metric */
/* Records with a slot are sources of their own in it: open it with these slots if the view has some. */
extern const struct slots selection_slots;
size_t selection_memory_min(const struct grid *grid, const struct view *view);
/* Makes a grid of the points that all rules except that of duplicates keep, on the same lattice. Vertices of lines are a source
 * of their own in it: open it with the line set file of the generation (struct grid_use); of a view with a metric
 * SELECTION_LINES. What a mesh of the result is depends only on the points and lines of the generation. -ERR_LIMIT: the
 * mapped points do not fit int32. After a failure the folder may hold files. */
int selection_make(const struct selection_params *, struct selection_counts *ret, struct err *err);
/* The counts of a selection, in its folder: selection_make leaves them there. -ERR_CORRUPT: they are damaged. */
int selection_counts_write(int dirfd, const struct selection_counts *, struct err *err);
int selection_counts_read(int dirfd, struct selection_counts *ret, struct err *err);
/* The identity of a selection: content, lattice, coordinate system and units of the generation, and the rules that
 * select. Views that differ only in the rule of duplicates share it. */
struct digest selection_key(const struct grid *grid, const struct view *view);

#endif
