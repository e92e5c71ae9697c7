/* A selection in progress, shared by the walk over the index (selection.c) and the thin rule (selection_thin.c). */
#ifndef SELECTION_PRIV_H
#define SELECTION_PRIV_H

#include <stddef.h>
#include <stdint.h>

#include "selection.h"

enum { SELECTION_BATCH = 512, SELECTION_TABLE_MIN = 16 << 10 };

struct selection {
	const struct selection_params *p;
	struct grid_reader *reader;
	struct grid_stage *stage;
	void *table; /* of the thin rule: table_bytes */
	size_t table_bytes;
	struct selection_counts out;
	struct view_map map;     /* is.k 0: positions stay */
	bool any_box;            /* out.box has a point */
	uint64_t judged;         /* records read and judged, each counted once */
	uint64_t seen, reported; /* records read, some several times; `seen` at the last call of progress */
	struct err *err;
	struct point batch[SELECTION_BATCH], line[SELECTION_BATCH]; /* line: vertices of lines */
	struct point part[SELECTION_BATCH];                         /* of a batch, with one slot */
	size_t nbatch, nline;
	uint64_t lines; /* vertices of lines that are kept */
	uint64_t of_slot[SLOTS_MOST + 1];
};

/* Calls progress at intervals. -ERR_CANCELLED: the caller cancelled. */
int selection_progress(struct selection *);
/* Vertices of lines (POINT_LINE) become a source of their own. */
int selection_keep(struct selection *, const struct point *);

/* Applies view_judge and the thin rule to all points of the grid. */
int selection_thin(struct selection *);
/* Keeps the vertices of lines that view_judge keeps. */
int selection_lines(struct selection *);

/* Of a view with a metric, first of all: sets `map`, and writes the mapped pieces of lines. */
int selection_map(struct selection *);
/* A kept record before it goes into the stage. */
void selection_map_point(struct selection *, struct point *);
size_t selection_map_bytes(const struct grid *, const struct view *); /* of memory that selection_map takes for itself */

#endif
