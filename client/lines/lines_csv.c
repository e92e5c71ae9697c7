/*
 * CSV with a line's name in each row: consecutive rows of one name are the vertices of one line, in their order.
 *
 * Model: the first line that is neither blank nor a comment (#) has the names of the columns. What separates them there (tab, ;
 * or ,) separates all rows. x is the easting. A row without a name belongs to no line: it is a feature that is refused. A field
 * may be quoted ("a ""b"" c"), not over the end of a line. It has no signature, so it is read only where it is asked for: a text
 * of x, y and z is a point cloud otherwise.
 */
#include "lines_priv.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum { COLUMNS = 256, LINE = 1 << 15, LINE_COLUMN = 3, KIND = 4, ROLES = 5 };

/* More names of points are known to the daemon's reader of texts (engine/input/text); these are those of its first languages. */
static const char *const role_names[LINE_COLUMN + 1] = {
	" x e east easting rechtswert ostwert lon longitude ",
	" y n north northing hochwert nordwert lat latitude ",
	" z h height elevation elev altitude hoehe höhe ",
	" name line lineid linename lineno polyline polylineid breakline string stringid feature featureid ",
};

struct csv {
	struct text_source source;
	struct lines_layer *layer;
	int at[ROLES]; /* columns; -1: there is none */
	char separator;
	bool of_lines; /* the column of names says that they are of lines; else it may have names of points */
	bool pending;  /* a row of the next line was read: */
	uint64_t number, pending_line;
	char text[LINE]; /* fields point into it */
	char name[LINES_NAME_SIZE], next_name[LINES_NAME_SIZE];
	const char *field[COLUMNS];
	size_t n;
};

static bool matches(const uint8_t *head, size_t n)
{
	return n && !memchr(head, 0, n);
}

/* Splits the line in place. -ERR_INPUT: a quote is not closed, or there are too many fields. */
static int split(struct lines *l, struct csv *c, size_t n, uint64_t line, struct err *err)
{
	char *p = c->text, *end = c->text + n;

	for (c->n = 0;; c->n++) {
		char *to;

		if (c->n == COLUMNS)
			return lines_bad(l, err, line, "a row has more than %d fields", COLUMNS);
		while (p < end && (*p == ' ' || (*p == '\t' && c->separator != '\t')))
			p++;
		c->field[c->n] = to = p;
		if (*p != '"') {
			p += strcspn(p, (char[]){c->separator, 0});
			to = p;
		} else {
			for (p++; p < end && (*p != '"' || p[1] == '"'); *to++ = *p++)
				p += *p == '"';
			if (p == end)
				return lines_bad(l, err, line, "a quoted field is not closed");
			p++;
			p += strspn(p, " ");
			if (*p && *p != c->separator)
				return lines_bad(l, err, line, "something follows a quoted field");
		}
		if (!*p) {
			*to = 0;
			c->n++;
			return 0;
		}
		*to = 0;
		p++;
	}
}

/* The next row that is neither blank nor a comment; *ret_more false: there is none. */
static int read_row(struct lines *l, struct csv *c, bool *ret_more, uint64_t *ret_line, struct err *err)
{
	const char *text;
	bool cut;
	size_t n;
	int rc;

	do {
		*ret_line = c->source.line;
		rc = text_source_line(&c->source, c->text, sizeof c->text, &n, &cut);
		if (rc || n == SIZE_MAX) {
			*ret_more = false;
			return rc;
		}
		if (cut)
			return lines_bad(l, err, *ret_line, "a line has more than %d bytes", LINE - 1);
		if (*ret_line == 1 && n >= 3 && !memcmp(c->text, "\xef\xbb\xbf", 3))
			memmove(c->text, c->text + 3, (n -= 3) + 1);
		text = c->text + strspn(c->text, " \t");
	} while (!*text || *text == '#');
	*ret_more = true;
	if (!c->separator)
		c->separator = strchr(text, '\t') ? '\t' : strchr(text, ';') ? ';' : ',';
	return split(l, c, n, *ret_line, err);
}

/* ---- the names of the columns ---- */

/* A name in lower case without what is neither letter nor digit, and without a unit in brackets, between blanks. */
static void plain_name(const char *name, char ret[64])
{
	size_t n = 1;

	ret[0] = ' ';
	for (; *name && !strchr("([", *name) && n < 60; name++)
		if (isalnum((unsigned char)*name) || (unsigned char)*name >= 0x80)
			ret[n++] = (char)tolower((unsigned char)*name);
	ret[n++] = ' ';
	ret[n] = 0;
}

static int bad_names(struct lines *l, uint64_t line, const char *how, const char *what, struct err *err)
{
	lines_bad(l, err, line, "%s %s", how, what);
	*err->hint = 0;
	return err_add_hint(err, "the first line names the columns: x,y,z,name");
}

static int read_names(struct lines *l, struct csv *c, struct err *err)
{
	static const char *const what[ROLES] = {"x (the easting)", "y (the northing)", "z", "the name of a line", NULL};
	uint64_t line;
	bool more;
	int rc = read_row(l, c, &more, &line, err);

	for (size_t i = 0; i < ROLES; i++)
		c->at[i] = -1;
	for (size_t i = 0; !rc && more && i < c->n; i++) {
		char name[64];

		plain_name(c->field[i], name);
		if (l->has_kind_field && !strcasecmp(c->field[i], l->kind_field))
			c->at[KIND] = (int)i;
		for (size_t k = 0; k <= LINE_COLUMN; k++) {
			if (!name[2] || !strstr(role_names[k], name))
				continue;
			if (c->at[k] >= 0)
				return bad_names(l, line, "two columns can be", what[k], err);
			c->at[k] = (int)i;
			if (k == LINE_COLUMN)
				c->of_lines = !strstr(" name feature featureid ", name);
			if (k == 0 && strstr(" lon longitude ", name))
				c->layer->crs.degrees = true;
		}
	}
	for (size_t k = 0; !rc && k <= LINE_COLUMN; k++)
		if (c->at[k] < 0)
			return bad_names(l, line, "there is no column for", what[k], err);
	if (!rc && l->has_kind_field && c->at[KIND] < 0) {
		err_set(err, ERR_INPUT, "it has no column \"%s\"", l->kind_field);
		return err_add_hint(err, "the first line has the names of the columns");
	}
	return rc;
}

static int open_csv(struct lines *l, struct err *err)
{
	struct csv *c = l->state = calloc(1, sizeof *c);
	char stem[LINES_NAME_SIZE];
	int rc;

	if (!c)
		return err_set(err, ERR_NOMEM, "no memory to read lines");
	lines_source_begin(&c->source, l, err);
	lines_stem(l, stem);
	rc = lines_layer(l, stem, &c->layer, err);
	return rc ? rc : read_names(l, c, err);
}

/* ---- rows ---- */

static int take_row(struct lines *l, struct csv *c, uint64_t line, struct err *err)
{
	static const char *const axis[3] = {"x", "y", "z"};
	struct decimal d[3];

	for (size_t k = 0; k < 3; k++) {
		const char *text = (size_t)c->at[k] < c->n ? c->field[c->at[k]] : "";
		size_t n = strlen(text);

		while (n && lines_is_blank(text[n - 1]))
			n--;
		if (!n && k == 2) {
			lines_refuse(l, lines_no_z);
			return 0;
		}
		if (!lines_number(text, n, &d[k])) {
			lines_bad(l, err, line, "%s is no number: \"%.40s\"", axis[k], text);
			*err->hint = 0;
			return err_add_hint(err, "numbers have a decimal point; a comma only separates");
		}
	}
	if (c->at[KIND] >= 0) {
		const char *kind = (size_t)c->at[KIND] < c->n ? c->field[c->at[KIND]] : "";
		char before[LINES_NAME_SIZE];

		strcpy(before, l->kind);
		if (l->f.kind) {
			lines_kind(l, kind, strlen(kind));
			if (strcmp(before, l->kind))
				lines_refuse(l, "its rows have different kinds");
		} else {
			lines_kind(l, kind, strlen(kind));
		}
	}
	return lines_vertex_exact(l, d, err);
}

static void row_name(struct csv *c, char ret[LINES_NAME_SIZE])
{
	const char *text = (size_t)c->at[LINE_COLUMN] < c->n ? c->field[c->at[LINE_COLUMN]] : "";
	size_t n = strlen(text);

	while (n && lines_is_blank(text[n - 1]))
		n--;
	snprintf(ret, LINES_NAME_SIZE, "%.*s", (int)(n < LINES_NAME_SIZE ? n : LINES_NAME_SIZE - 1), text);
}

static int next_csv(struct lines *l, bool *ret_more, struct err *err)
{
	struct csv *c = l->state;
	uint64_t line = c->pending_line;
	bool more = true;
	int rc = 0;

	c->source.err = err;
	if (!c->pending)
		rc = read_row(l, c, &more, &line, err);
	*ret_more = more;
	if (rc || !more)
		return rc;
	c->pending = false;
	row_name(c, c->name);
	lines_begin(l, c->layer, ++c->number, line);
	lines_geometry(l, "rows");
	if (!*c->name)
		lines_refuse(l, lines_no_name);
	rc = lines_part(l, false, err);
	do {
		if (!rc)
			rc = take_row(l, c, line, err);
		if (!rc)
			rc = read_row(l, c, &more, &line, err);
		if (!rc && more) {
			row_name(c, c->next_name);
			c->pending = !*c->name || strcmp(c->name, c->next_name);
		}
	} while (!rc && more && !c->pending);
	c->pending_line = line;
	if (!rc)
		lines_end(l);
	return rc;
}

/* ---- whether a text of points is one of lines ---- */

enum { NAMES = 4096 };

/* The names of lines so far. */
struct names {
	uint32_t hash[NAMES];
	size_t n;
	size_t rows;  /* of the last one */
	bool strange; /* a name has one row, or returns: so they are of points */
};

static void add_name(struct names *t, const char *name, bool same)
{
	uint32_t hash = lines_hash(name);

	if (same) {
		t->rows++;
		return;
	}
	t->strange = !*name || t->n == NAMES || (t->n && t->rows < 2);
	for (size_t i = 0; i < t->n && !t->strange; i++)
		t->strange = t->hash[i] == hash;
	if (!t->strange)
		t->hash[t->n++] = hash;
	t->rows = 1;
}

static bool read_all_names(struct lines *l, struct csv *c, struct names *t, struct err *err)
{
	uint64_t line;
	bool more = true;

	while (!t->strange) {
		strcpy(c->name, c->next_name);
		if (read_row(l, c, &more, &line, err))
			return false;
		if (!more)
			return true;
		row_name(c, c->next_name);
		add_name(t, c->next_name, t->n && !strcmp(c->name, c->next_name));
	}
	return false;
}

/* Of a text that goes on, the last name may have one row. One name in all rows says something if it is that of a line. */
bool lines_csv_may_be(const char *text, size_t n, bool whole)
{
	struct lines *l = calloc(1, sizeof *l);
	struct csv *c = calloc(1, sizeof *c);
	struct names *names = calloc(1, sizeof *names);
	struct lines_layer layer = {.index = 0};
	struct err err = ERR_INIT;
	bool may = false;

	for (; !whole && n && text[n - 1] != '\n'; n--)
		;
	if (l && c && names) {
		c->layer = &layer;
		l->reader = &lines_csv_reader;
		text_source_memory(&c->source, text, n, &err);
		may = !read_names(l, c, &err) && read_all_names(l, c, names, &err) && names->n > (whole && c->of_lines ? 0 : 1) &&
		      (names->rows > 1 || !whole);
	}
	free(names);
	free(c);
	free(l);
	return may;
}

const struct lines_reader lines_csv_reader = {
	.name = "csv",
	.title = "CSV",
	.place = "line",
	.exact = true,
	.matches = matches,
	.open = open_csv,
	.next = next_csv,
	.close = lines_free_state,
};
