/* A file of lines as the text that acutd takes (docs/formats/lines.md). */
#ifndef LINES_EXPORT_H
#define LINES_EXPORT_H

#include <stdio.h>

#include "lines.h"

enum lines_kind { LINES_HARD, LINES_LAKE, LINES_BOUNDARY, LINES_HOLE, LINES_KINDS };
extern const char *const lines_kind_text[LINES_KINDS]; /* "hard", "lake", "boundary", "hole" */

struct lines_export_options {
	const char *kind;       /* of features without a kind of their own: one of these words, or soft; NULL: there are none */
	const char *densify;    /* the longest segment, "5", "5m", "5ft", "5ftUS"; NULL: as they are */
	const char *lake_level; /* min, max, mean; NULL: lakes have one level */
};

struct lines_exported {
	uint64_t features[LINES_KINDS], lines, vertices;
	uint64_t soft;     /* of the hard features */
	uint64_t left_out; /* features that are no lines, or have no geometry */
};

/* -ERR_USAGE: a word that is none. */
int lines_export_check(const struct lines_export_options *, struct err *);
/* Writes all features. A feature that cannot be used is an error, and so are a lake, a boundary or a hole that is no ring, and
 * layers of different coordinate systems. The caller flushes `out`. */
int lines_export(struct lines *, const struct lines_export_options *, FILE *out, struct lines_exported *ret, struct err *);

#endif
