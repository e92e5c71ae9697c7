/*
 * The output of a program: results for people or as JSON, notes, warnings, errors, and one progress line, which is removed before
 * anything else is printed.
 */
#ifndef CONSOLE_H
#define CONSOLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include "term_error.h"
#include "term_json.h"
#include "term_table.h"
#include "term_text.h"

struct err;

struct console {
	const char *program;
	FILE *report;                  /* results and JSON: standard output, or standard error where an output is "-" */
	bool json, quiet, no_progress; /* options of every command */
	bool keeps_warnings;           /* in `warning`, for a report; each is printed once */
	bool list;                     /* results are rows of a list, which are flushed together */
	bool progress_shown;
	char line[256]; /* the progress line */
	char **warning;
	size_t nwarning;
};

enum { CONSOLE_PIPE = 141 /* exit status: the reader of standard output is gone */ };

/* "PROGRAM: FILE: ...", or {"error": ...} with --json. The exit status of the error. */
int console_error(struct console *, const struct err *);
/* "PROGRAM: warning: ..." on standard error; not with --quiet or --json. */
void console_warn(struct console *, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
/* Likewise "PROGRAM: note: ..."; nothing if the text is empty. */
void console_note(struct console *, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
/* A line of the results for people: not with --quiet or --json. */
void console_line(struct console *, const char *fmt, ...) __attribute__((format(printf, 2, 3)));

/* An object of the results, begun; term_json_end ends it. */
struct term_json console_json(const struct console *);
/* A table of the results; NULL with --json. */
struct term_table *console_table(const struct console *, const struct term_column *, unsigned n);
#define CONSOLE_TABLE(console, columns) console_table(console, columns, sizeof(columns) / sizeof(*(columns)))
/* For callbacks that print rows. */
struct console_list {
	struct console *console;
	struct term_table *table;
};
/* Before the first of many rows. */
void console_begin_list(struct console *);

/* Standard error is a terminal, and a progress line is wanted. */
bool console_progress_on(const struct console *);
/* Replaces the progress line; the caller asks console_progress_on first. */
void console_progress(struct console *, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
void console_progress_clear(struct console *);

/* It is a pipe or socket whose other end is closed, or is closed within `ms`; *ret_other: it is neither. */
bool console_is_gone(int fd, int ms, bool *ret_other);
/* Nobody reads standard output any more. */
bool console_reader_gone(void);
/* At the end of the program: results that cannot be written, or for which there was no memory, are an error. Exit status. */
int console_end(struct console *, int status);

#endif
