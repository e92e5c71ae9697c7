/*
 * The lines of a dataset: files of lines, line sets and places, in the dataset's folder (grid_manifest.h names them). Workers.
 */
#ifndef BREAKLINES_H
#define BREAKLINES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "breakline.h"
#include "grid_manifest.h"

struct err;
struct lattice;

/* ---- staged lines, before a commit ---- */

/* The file of a source of lines that push `push` has staged. It begins with "push-ID." as its runs do. */
void breaklines_staged_name(uint64_t push, uint32_t source, char ret[64]);
/* Removes all of them. The folder is not synchronised. */
int breaklines_discard(int dirfd, uint64_t push, struct err *err);
/* What the manifest has of a file that was written. */
int breaklines_described(int dirfd, const char *name, const struct breakline_totals *, struct grid_lines *ret, struct err *err);
/* Gives a staged file its final name, too. */
int breaklines_publish(int dirfd, uint64_t push, const struct grid_source *, struct err *err);

/* ---- the line set of a generation ---- */

/* Bytes that a build most likely needs: params.memory. */
uint64_t breaklines_memory(uint64_t vertices);

struct breaklines_params {
	int dirfd;
	const struct grid_source *const *lines; /* live sources of lines; their files have the final names */
	size_t nlines;
	uint32_t id;     /* number of the source of line vertices */
	uint64_t memory; /* as breaklines_memory(0) at least. -ERR_LIMIT: err->need bytes may suffice */
	const struct lattice *lattice;
	bool strict; /* lines that cross, or vertices at one position, of different heights are -ERR_INPUT */
};

struct breaklines {
	struct breakline_counts counts;
	struct grid_lines lines;          /* of the source of line vertices */
	uint64_t points;                  /* its records, all of which are in the segment */
	struct grid_segment_info segment; /* points 0: there is none */
};

/* Makes "lineset-ID", "places-ID" and the segment of line vertices, durable but for the folder. They are removed if it fails. */
int breaklines_build(const struct breaklines_params *, struct breaklines *ret, struct err *err);
/* Puts the source of line vertices and its segment into a manifest that has room for them. `made` stays as long as that. */
void breaklines_put(const struct breaklines *made, uint32_t id, uint64_t added, uint64_t removed, struct grid_manifest *);
/* Removes the files of a source, with the segment of line vertices; what is not there is fine. */
int breaklines_remove(int dirfd, const struct grid_source *, struct err *err);

/* ---- reading ---- */

/* -ERR_CORRUPT, -ERR_TRUNCATED: a file of the source is damaged, or not what the manifest says. staged: the name that its file of
 * lines has before the commit, else NULL. */
int breaklines_verify(int dirfd, const struct grid_source *, const char *staged, struct err *err);

struct breaklines_place {
	enum breakline_event event;
	int32_t x, y, lower, upper;
};
/* Up to `most` places of a source of line vertices, from number `first` on. */
int breaklines_places(int dirfd, const struct grid_source *, uint64_t first, size_t most, struct breaklines_place *ret,
		      size_t *ret_n, struct err *err);

#endif
