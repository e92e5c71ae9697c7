/* What is in a file of lines: all of its features counted, for `acutctl info`. */
#ifndef LINES_SURVEY_H
#define LINES_SURVEY_H

#include "lines.h"

enum { LINES_SURVEY_ROWS = 24, LINES_SURVEY_NAME = 64 };

struct lines_counts {
	uint64_t features, usable, refused;
	uint64_t lines, closed, rings, vertices; /* of usable ones; `closed` are lines that end where they begin */
};

/* Features by a word: a geometry, a kind, a reason. */
struct lines_survey_row {
	char name[LINES_SURVEY_NAME];
	uint64_t features;
	uint64_t first, place; /* number and place of the first one */
};

struct lines_survey_list {
	struct lines_survey_row row[LINES_SURVEY_ROWS];
	size_t n;
	uint64_t others; /* features with words beyond those rows */
};

struct lines_survey {
	struct lines_counts all;
	uint64_t empty;
	double min[3], max[3]; /* of usable vertices; not finite if there are none */
	struct lines_survey_list geometry, kinds, refused, left_out;
	uint64_t without_kind; /* usable features, if a kind field is asked for */
	struct lines_survey_layer {
		const struct lines_layer *layer;
		struct lines_counts counts;
	} * layer;
	size_t nlayers, room;
};

/* Reads all of it. On failure too *ret holds what was read before, and lines_survey_done frees it. */
int lines_survey(struct lines *, struct lines_survey *ret, struct err *err);
void lines_survey_done(struct lines_survey *);

#endif
