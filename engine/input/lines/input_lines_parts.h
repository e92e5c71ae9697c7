/* Shared by the files of this room: rows (input_lines.c), what stands before the features (input_lines_head.c). */
#ifndef INPUT_LINES_PARTS_H
#define INPUT_LINES_PARTS_H

#include "input_text_parts.h"

/* State of a text of lines; see input_lines.c. */
struct input_lines_state {
	struct input_xyz text; /* first: the reader of lines of text keeps its place there */
	bool probing;
	bool begun;           /* the signature was read */
	bool has_crs, has_xy; /* rows of the head that were there, beside what info has */
	bool has_z;
	bool in_feature, in_line; /* a row began one */
	struct input_vertex next; /* of the next vertex */
	uint64_t lines;           /* of the feature so far */
	uint64_t vertices;        /* of the line so far */
	uint64_t feature_row;     /* where the feature begins, */
	uint64_t line_row;        /* and the line */
	char crs[CRS_TEXT_SIZE];  /* what the row said, for messages */
};

static inline struct input_lines_state *input_lines_of(const struct input *in)
{
	return input_state(in);
}

/* The word in front of a row, and what follows it, without blanks around either. */
struct input_lines_row {
	struct input_line line, word, rest;
};

static inline bool input_lines_is(struct input_line text, const char *word)
{
	const char *p = text.at;

	for (; *word && p < text.end && *p == *word; word++)
		p++;
	return !*word && p == text.end;
}

/* -ERR_INPUT: what is wrong with the row that was read last. `hint` may be NULL. */
int input_lines_bad(struct input *in, const struct input_lines_row *, const char *what, const char *hint, struct err *err);
/* A row of the head. *ret_known false: its word is none. */
int input_lines_head(struct input *in, const struct input_lines_row *, bool *ret_known, struct err *err);
/* After all of them. */
void input_lines_head_end(struct input *in);

#endif
