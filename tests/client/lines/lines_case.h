/* Shared by the tests of files of lines: files in a folder of their own, and what is read from them as a text. */
#ifndef LINES_CASE_H
#define LINES_CASE_H

#include <stddef.h>
#include <stdint.h>

#include "err.h"
#include "lines.h"

enum { LINES_CASE_TEXT = 1 << 14 };

/* Bytes that grow. */
struct lines_case_bytes {
	uint8_t at[1 << 16];
	size_t n;
};
void lines_case_u8(struct lines_case_bytes *, unsigned);
void lines_case_u32(struct lines_case_bytes *, uint32_t, int big);
void lines_case_double(struct lines_case_bytes *, double, int big);
void lines_case_set32(struct lines_case_bytes *, size_t at, uint32_t, int big);

/* A path in the folder of the test, valid until the next call; the folder is made at the first one. */
const char *lines_case_path(const char *name);
/* Writes a file; its path. */
const char *lines_case_file(const char *name, const void *bytes, size_t n);
void lines_case_remove_all(void);

/*
 * All features of a file, one after the other, as
 *	#1 layer PolyLineZ: open 1 2 3, 4 5 6; ring ...
 *	#2 layer Point = points		left out
 *	#3 layer Arc ! it is an arc	refused
 * with " [kind]" behind the geometry, if there is one. A failure ends it with "error: " and the error as people read it without
 * the file's name.
 */
const char *lines_case_read(const char *path, const struct lines_options *, char text[LINES_CASE_TEXT]);
/* The same of a text as the file of this name. */
const char *lines_case_read_text(const char *name, const char *text, const struct lines_options *, char ret[LINES_CASE_TEXT]);

#endif
