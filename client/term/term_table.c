/*
 * Tables. On a terminal rows are kept until there are a thousand or the table ends; then widths are fixed, and later rows are
 * fitted to them. Elsewhere a cell is written when it comes.
 */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "term_table.h"
#include "term_text.h"
#include "parse.h"

enum { KEPT = 1000, GAP = 2, NARROW = 8 };

struct cell {
	char *text;
	enum term_tint tint;
};

struct term_table {
	FILE *out;
	struct term term;
	const struct term_column *column;
	unsigned n, at; /* columns; where the next cell goes */
	enum term_tint tint;
	struct cell *cell; /* of `rows` rows */
	size_t rows, room;
	unsigned width[TERM_TABLE_COLUMNS]; /* 0: left out */
	bool settled;
	bool lost; /* there was no memory for a cell: it and all later ones are left out (term_lose) */
};

struct term_table *term_table_new(FILE *out, const struct term_column *column, unsigned n)
{
	struct term_table *t = malloc(sizeof(*t));

	if (!t) {
		term_lose();
		return NULL;
	}
	*t = (struct term_table){.out = out, .term = term_of(out), .column = column, .n = n};
	return t;
}

/* ---- widths ---- */

static unsigned total(const struct term_table *t)
{
	unsigned sum = 0;

	for (unsigned i = 0; i < t->n; i++)
		sum += t->width[i] ? t->width[i] + (sum ? GAP : 0) : 0;
	return sum;
}

/* Takes what is too much off the widest columns that can be shortened, none below `least`. */
static void shrink(struct term_table *t, unsigned least)
{
	while (total(t) > t->term.width) {
		unsigned widest = t->n;

		for (unsigned i = 0; i < t->n; i++)
			if ((t->column[i].shrink || t->column[i].tail) && t->width[i] > least &&
			    (widest == t->n || t->width[i] > t->width[widest]))
				widest = i;
		if (widest == t->n)
			return;
		t->width[widest]--;
	}
}

static void settle(struct term_table *t)
{
	t->settled = true;
	for (unsigned i = 0; i < t->n; i++) {
		bool any = !t->rows;

		t->width[i] = term_columns(t->column[i].head);
		for (size_t r = 0; r < t->rows; r++) {
			const char *text = t->cell[r * t->n + i].text;
			unsigned w = term_columns(text);

			any |= strcmp(text, "-") != 0;
			t->width[i] = w > t->width[i] ? w : t->width[i];
		}
		if (!any && t->column[i].spare)
			t->width[i] = 0; /* there is nothing in it */
	}
	shrink(t, NARROW);
	for (unsigned i = t->n; i-- > 0 && total(t) > t->term.width;)
		if (t->column[i].spare)
			t->width[i] = 0;
	shrink(t, 1);
}

/* ---- printing ---- */

static void put(struct term_table *t, unsigned i, const char *text, enum term_tint tint, bool last)
{
	const struct term_column *c = &t->column[i];
	size_t room = strlen(text) + 8;
	char *fit = malloc(room);
	unsigned w, pad;

	t->lost |= !fit;
	if (!fit)
		return;
	memcpy(fit, text, strlen(text) + 1);
	if (c->shrink || c->tail)
		term_shorten(fit, t->width[i], c->tail);
	w = term_columns(fit);
	pad = w < t->width[i] ? t->width[i] - w : 0;
	if (c->right)
		fprintf(t->out, "%*s", (int)pad, "");
	if (tint && t->term.color)
		fprintf(t->out, "%s%s%s", term_tint(&t->term, tint), fit, term_tint(&t->term, TERM_PLAIN));
	else
		fputs(fit, t->out);
	if (!c->right && !last)
		fprintf(t->out, "%*s", (int)pad, "");
	free(fit);
}

static void print_row(struct term_table *t, const struct cell *row)
{
	unsigned last = t->n;
	bool any = false;

	while (last && !t->width[last - 1])
		last--;
	for (unsigned i = 0; i < last; i++) {
		if (!t->width[i])
			continue;
		if (any)
			fprintf(t->out, "%*s", GAP, "");
		any = true;
		put(t, i, row ? row[i].text : t->column[i].head, row ? row[i].tint : TERM_BOLD, i + 1 == last);
	}
	fputc('\n', t->out);
}

static void flush(struct term_table *t)
{
	if (!t->settled && t->rows) {
		settle(t);
		print_row(t, NULL);
	}
	for (size_t r = 0; r < t->rows; r++)
		print_row(t, &t->cell[r * t->n]);
	for (size_t i = 0; i < t->rows * t->n; i++)
		free(t->cell[i].text);
	t->rows = 0;
}

/* ---- cells ---- */

static void plain(struct term_table *t, const char *text)
{
	term_put(t->out, *text ? text : "-");
	fputc(++t->at == t->n ? '\n' : '\t', t->out);
	t->at %= t->n;
}

static void add(struct term_table *t, const char *text)
{
	struct cell *grown;
	char *safe;

	if (!t || t->lost)
		return;
	if (!t->term.on) {
		plain(t, text);
		return;
	}
	if (!t->at && t->rows == t->room) {
		grown = realloc(t->cell, (t->room ? 2 * t->room : 64) * t->n * sizeof(*grown));
		t->lost = !grown;
		if (!grown)
			return;
		t->cell = grown;
		t->room = t->room ? 2 * t->room : 64;
	}
	safe = term_safe(*text ? text : "-");
	t->lost = !safe;
	if (!safe)
		return;
	t->cell[t->rows * t->n + t->at] = (struct cell){.text = safe, .tint = t->tint};
	t->tint = TERM_PLAIN;
	if (++t->at < t->n)
		return;
	t->at = 0;
	t->rows++;
	if (t->rows == KEPT || t->settled)
		flush(t);
}

void term_table_text(struct term_table *t, const char *fmt, ...)
{
	char text[200], *more = NULL;
	va_list ap;
	int n;

	va_start(ap, fmt);
	n = vsnprintf(text, sizeof(text), fmt, ap);
	va_end(ap);
	if (n >= (int)sizeof(text)) {
		va_start(ap, fmt);
		more = term_format(fmt, ap);
		va_end(ap);
		if (t && !more)
			t->lost = true;
	}
	add(t, more ? more : n < 0 ? "?" : text);
	free(more);
}

void term_table_count(struct term_table *t, uint64_t n)
{
	char buf[32];

	if (t && t->term.on)
		add(t, term_count(n, buf));
	else
		term_table_text(t, "%llu", (unsigned long long)n);
}

void term_table_id(struct term_table *t, uint64_t n)
{
	if (n)
		term_table_text(t, "%llu", (unsigned long long)n);
	else
		add(t, "-");
}

void term_table_size(struct term_table *t, uint64_t bytes)
{
	char buf[32];

	if (t && t->term.on)
		add(t, parse_size_text(bytes, buf));
	else
		term_table_text(t, "%llu", (unsigned long long)bytes);
}

void term_table_time(struct term_table *t, int64_t us)
{
	char buf[32];

	add(t, term_time(us, buf));
}

void term_table_none(struct term_table *t)
{
	add(t, "-");
}

void term_table_tint(struct term_table *t, enum term_tint tint)
{
	if (t)
		t->tint = tint;
}

struct term_table *term_table_free(struct term_table *t)
{
	if (!t)
		return NULL;
	for (unsigned i = 0; t->cell && i < t->at; i++)
		free(t->cell[t->rows * t->n + i].text); /* of a row without its end */
	if (t->term.on)
		flush(t);
	if (t->lost)
		term_lose();
	free(t->cell);
	free(t);
	return NULL;
}
