/*
 * Lists for people and for scripts.
 *
 * On a terminal: a line of heads, aligned columns, numbers to the right with thousands separated, sizes as "1.2 GB". The
 * table fits the width of the terminal: names are shortened in the middle, and spare columns are left out. Elsewhere: a row a
 * line, columns separated by tabs, always all of them in the same order, no heads, whole numbers, sizes in bytes, "-" for
 * unknown or empty cells. No text contains a tab or the end of a line.
 *
 * 	static const struct term_column columns[] = {{"NAME", .shrink = true}, {"POINTS", .right = true}};
 * 	struct term_table *t = term_table_new(stdout, columns, 2);
 * 	term_table_text(t, "%s", name);
 * 	term_table_count(t, points);        the last cell of a row ends it
 * 	term_table_free(t);                 prints the rows that are kept
 *
 * The first thousand rows determine the widths.
 */
#ifndef TERM_TABLE_H
#define TERM_TABLE_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "term.h"

#define TERM_TABLE_COLUMNS 16

struct term_column {
	const char *head;
	bool right;  /* numbers */
	bool shrink; /* names: may be shortened in the middle */
	bool tail;   /* sentences: may be cut at the end */
	bool spare;  /* may be left out on a narrow terminal; the last such column first */
};

struct term_table;

/* NULL: no memory (term_lose); all calls take that, and print nothing. At most TERM_TABLE_COLUMNS columns. */
struct term_table *term_table_new(FILE *, const struct term_column *, unsigned n);
void term_table_text(struct term_table *, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
void term_table_count(struct term_table *, uint64_t n); /* 1,234,567 */
void term_table_id(struct term_table *, uint64_t n);    /* 1234567; 0 is none */
void term_table_size(struct term_table *, uint64_t bytes);
void term_table_time(struct term_table *, int64_t us);     /* since 1970; 0 is none */
void term_table_none(struct term_table *);                 /* not known: "-" */
void term_table_tint(struct term_table *, enum term_tint); /* of the next cell */
/* Prints the rows that are kept back; term_lose if there was no memory for all. Returns NULL; takes NULL. */
struct term_table *term_table_free(struct term_table *);

#endif
