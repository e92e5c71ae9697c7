/*
 * The terminal: its width, its colours, and texts that are safe to show on it.
 *
 * Texts that come from files, users or the daemon may contain any bytes. All output for people goes through these functions:
 * control characters (escape sequences too) and bytes that are not UTF-8 are shown as \n, \t, \x1b, on a terminal or not.
 */
#ifndef TERM_H
#define TERM_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

struct term {
	bool on;        /* it is a terminal */
	bool color;     /* and colours are wanted: not with NO_COLOR, not with TERM=dumb */
	unsigned width; /* in columns: $COLUMNS, else the terminal's width, else 80; 0: not a terminal */
};
struct term term_of(FILE *);

enum term_tint { TERM_PLAIN, TERM_BOLD, TERM_GOOD, TERM_WARN, TERM_BAD };
/* The sequences that begin and end a tint; "" where there are no colours. */
const char *term_tint(const struct term *, enum term_tint);

/* The text that printf would write, to be freed; NULL: no memory. */
char *term_format(const char *fmt, va_list) __attribute__((format(printf, 1, 0)));
/* A safe copy of text, to be freed; NULL: no memory. */
char *term_safe(const char *text);
/* Something that was to be printed is left out, or is "?", since there is no memory for it: the program fails at its end
 * (console_end). */
void term_lose(void);
bool term_lost(void);
/* Writes text, made safe. */
void term_put(FILE *, const char *text);
/* Columns that a safe text takes: 2 of wide characters, 0 of combining ones. */
unsigned term_columns(const char *text);
/* Bytes of the longest beginning of a safe text that takes at most so many columns. */
size_t term_fit(const char *text, unsigned columns);
/* Shortens a safe text in place to so many columns, by … in the middle, or (tail) at its end. It must have room for 3
 * bytes more than it has, or be longer than it becomes. */
void term_shorten(char *text, unsigned columns, bool tail);

/* "key         value" as a line; on a terminal, values that are wider go on below the first. */
void term_field(FILE *, const char *key, const char *fmt, ...) __attribute__((format(printf, 3, 4)));
/* Prints the rest of a line of which so many columns are used; text that does not fit continues below. */
void term_wrap(FILE *, unsigned indent, const char *text);
/* A line of text. */
void term_line(FILE *, const char *fmt, ...) __attribute__((format(printf, 2, 3)));

#endif
