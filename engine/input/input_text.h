/* Shared by the files that read text: lines (input_line.c), what the columns are (input_columns.c), points
 * (input_xyz.c). */
#ifndef INPUT_TEXT_H
#define INPUT_TEXT_H

#include "input_parts.h"

struct input_line {
	const char *at, *end; /* without its line end */
};

/* -code: what is wrong with the line that was read last, with its number and how it begins. */
int input_bad_line(struct input *in, struct err *err, enum err_code code, const char *what, struct input_line text);
/* From the first byte again. */
void input_line_rewind(struct input *in);
/* The next line; ret->at NULL at the end of the file, or when its pipe is dry. */
int input_line_next(struct input *in, struct input_line *ret, struct err *err);
/* The same, but neither blank lines nor comments nor what stands before the points. */
int input_line_next_point(struct input *in, struct input_line *ret, struct err *err);
bool input_line_is_comment(struct input_line line); /* or blank */
/* The numbers of a line, each at the place of its column's role; ret[role] of roles without a column stays. */
int input_line_parse(struct input *in, struct input_line line, struct input_number ret[INPUT_ROLES], struct err *err);

/* What stands before the points: names of columns, the number of points (.pts). Reads the first lines. */
int input_columns_look(struct input *in, struct err *err);
/* The line is one whole number and nothing else. */
bool input_line_is_count(struct input_line line, uint64_t *ret);

#endif
