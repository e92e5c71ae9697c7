/* Shared by the files of this room. */
#ifndef INPUT_TABLE_H
#define INPUT_TABLE_H

#include "input_reader.h"

struct input_row {
	const char *name, *title, *extensions; /* ".las .laz" */
	const struct input_reader *reader;
};

extern const struct input_row input_rows[];
extern const size_t input_n_rows;

/* Whether a name ends in one of ".las .laz", in any case. */
bool input_has_extension(const char *name, const char *extensions);
/* -ERR_INPUT if the first n bytes, in the buffer, are those of a format of other programs: names it, and what converts it. */
int input_foreign_check(struct input *in, size_t n, struct err *err);

#endif
