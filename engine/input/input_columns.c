/*
 * What the columns of a text are: --columns, else a line of names before the points, else x y z.
 *
 * Model: before the points may stand, each once: comments, one line of names (a comment or not), and for .pts
 * the number of points. Names count only if they say for sure which columns are x, y and z; a line of names
 * that does not is skipped, and the warning says so. A comment is prose until its words fit the columns of
 * the first point. Class and returns are taken from names too; returns only with their number, since a
 * return alone does not say which is the last.
 */
#include "input_text.h"

#include <ctype.h>
#include <stdio.h>
#include <string.h>

enum { WORD = 32, NAMES_SHOWN = 60 };

/* The letters of txt2las; a place each for what is read. */
static const char letters[] = "xyzcrn", skipped[] = "s_-itaupRGB";

static int bad_columns(const char *text, struct err *err, const char *why)
{
	err_set(err, ERR_USAGE, "columns \"%.80s\": %s", text, why);
	err_add_place(err, ERR_NO_OFFSET, "columns");
	return err_add_hint(err, "a letter each: x y z, c class, r return, n number of returns, _ to skip one");
}

static void settle(struct input_columns *c)
{
	for (c->n = INPUT_COLUMNS; c->n && c->role[c->n - 1] == INPUT_SKIPPED; c->n--)
		;
	c->cls = memchr(c->role, INPUT_CLASS, sizeof c->role);
	c->returns = memchr(c->role, INPUT_RETURN, sizeof c->role);
}

/* The letters of --columns. -ERR_USAGE. */
static int letters_read(const char *text, struct input_columns *ret, struct err *err)
{
	struct input_columns c = {.n = 0};
	unsigned seen[INPUT_ROLES + 1] = {0};
	size_t n = 0;

	memset(c.role, INPUT_SKIPPED, sizeof c.role);
	for (const char *p = text ? text : "xyz"; *p; p++, n++) {
		const char *letter = strchr(letters, *p);

		if (n == INPUT_COLUMNS)
			return bad_columns(text, err, "more than 64");
		if (!letter && !strchr(skipped, *p))
			return bad_columns(text, err, "there is no such letter");
		if (!letter)
			continue;
		c.role[n] = (uint8_t)(letter - letters);
		if (seen[c.role[n]]++)
			return bad_columns(text, err, "a letter stands twice");
	}
	if (!seen[INPUT_X] || !seen[INPUT_Y] || !seen[INPUT_Z])
		return bad_columns(text, err, "x, y and z are needed");
	if (seen[INPUT_RETURN] != seen[INPUT_RETURNS])
		return bad_columns(text, err, "r and n go together");
	settle(&c);
	*ret = c;
	return 0;
}

int input_columns_check(const char *text, struct err *err)
{
	struct input_columns c;

	return text ? letters_read(text, &c, err) : 0;
}

/* One word or number of a line; false at its end. `kind` as column_kind. */
static bool next_word(const char **at, const char *end, char kind, struct input_line *ret)
{
	const char *p = *at;

	while (p < end && (*p == ' ' || *p == '\t'))
		p++;
	if (p >= end)
		return false;
	ret->at = p;
	while (p < end && *p != kind && (kind != ' ' || *p != '\t'))
		p++;
	ret->end = p;
	*at = p < end ? p + 1 : p;
	return true;
}

static char column_kind(struct input_line line)
{
	static const char kinds[] = ";,\t";

	for (const char *k = kinds; *k; k++)
		if (memchr(line.at, *k, (size_t)(line.end - line.at)))
			return *k;
	return ' ';
}

/* A column's name without case, quotes, blanks, dashes and what stands in brackets. */
static void plain_word(struct input_line word, char ret[WORD])
{
	size_t n = 0;

	for (const char *p = word.at; p < word.end && n + 1 < WORD && !(n && (*p == '(' || *p == '[')); p++)
		if (isalnum((unsigned char)*p))
			ret[n++] = (char)tolower((unsigned char)*p);
	ret[n] = 0;
}

/* Single letters but x, y, z could mean several things: r g b, e n h. */
static unsigned role_of(const char *word)
{
	static const struct {
		enum input_role role;
		const char *words;
	} names[] = {
		{INPUT_X, " x xcoord xcoordinate easting east lon longitude "},
		{INPUT_Y, " y ycoord ycoordinate northing north lat latitude "},
		{INPUT_Z, " z zcoord zcoordinate height elevation elev altitude alt "},
		{INPUT_CLASS, " class classification "},
		{INPUT_RETURN, " return returnnumber returnno "},
		{INPUT_RETURNS, " returns numberofreturns numreturns nreturns "},
	};
	char padded[WORD + 2];

	snprintf(padded, sizeof padded, " %s ", word);
	for (size_t i = 0; *word && i < sizeof names / sizeof *names; i++)
		if (strstr(names[i].words, padded))
			return names[i].role;
	return INPUT_SKIPPED;
}

static unsigned count_words(struct input_line line)
{
	const char *p = line.at;
	char kind = column_kind(line);
	struct input_line word;
	unsigned n = 0;

	while (next_word(&p, line.end, kind, &word))
		n++;
	return n;
}

/* False if the names do not say for sure which columns are x, y and z. */
static bool names_to_columns(struct input_line line, struct input_columns *ret)
{
	const char *p = line.at;
	char kind = column_kind(line), plain[WORD];
	unsigned seen[INPUT_ROLES + 1] = {0}, n = 0;
	struct input_columns c = {.n = 0};
	struct input_line word;

	memset(c.role, INPUT_SKIPPED, sizeof c.role);
	for (; n < INPUT_COLUMNS && next_word(&p, line.end, kind, &word); n++) {
		plain_word(word, plain);
		c.role[n] = (uint8_t)role_of(plain);
		seen[c.role[n]]++;
	}
	for (unsigned i = 0; i < INPUT_ROLES; i++)
		if (seen[i] > 1 || (!seen[i] && i <= INPUT_Z))
			return false;
	for (unsigned i = 0; i < n && seen[INPUT_RETURN] != seen[INPUT_RETURNS]; i++)
		if (c.role[i] == INPUT_RETURN || c.role[i] == INPUT_RETURNS)
			c.role[i] = INPUT_SKIPPED;
	settle(&c);
	*ret = c;
	return true;
}

/* At least three words, none of them a number. */
static bool is_names(struct input_line line)
{
	const char *p = line.at, *at;
	char kind = column_kind(line);
	struct input_line word;
	struct input_number n;
	unsigned words = 0;

	for (; next_word(&p, line.end, kind, &word); words++) {
		at = word.at;
		if (input_number_read(&at, word.end, &n) != INPUT_NUMBER_BAD || strchr("0123456789.+-,;", *word.at))
			return false;
	}
	return words >= 3;
}

static struct input_line without_mark(struct input_line line)
{
	while (line.at < line.end && strchr("#%/ \t", *line.at))
		line.at++;
	return line;
}

static void warn_names(struct input *in, const char *names)
{
	input_warn(in,
		   "the line of column names (%s) does not say for sure which are x, y and z: the first three "
		   "are taken; --columns would say others",
		   names);
}

/* What was found before the points; texts are copies, since lines go with the window. */
struct head {
	char names[1024], comment[1024], shown[NAMES_SHOWN];
	uint64_t names_line;
};

static void keep(struct input_line line, char *ret, size_t size)
{
	size_t n = (size_t)(line.end - line.at);

	n = n < size ? n : size - 1;
	memcpy(ret, line.at, n);
	ret[n] = 0;
}

static struct input_line line_of(const char *text)
{
	return (struct input_line){text, text + strlen(text)};
}

/* Up to the first point, which is *ret, or ret->at NULL at the end. */
static int read_head(struct input *in, struct head *h, struct input_line *ret, struct err *err)
{
	uint64_t count;

	for (;;) {
		int rc = input_line_next(in, ret, err);

		if (rc || !ret->at)
			return rc;
		if (input_line_is_comment(*ret)) {
			struct input_line words = without_mark(*ret);
			struct input_columns c;

			if (words.at > ret->at && names_to_columns(words, &c))
				keep(words, h->comment, sizeof h->comment);
			continue;
		}
		if (in->as.xyz.counts && input_line_is_count(*ret, &count))
			continue;
		if (h->names_line || !is_names(*ret))
			return 0;
		h->names_line = in->as.xyz.line;
		keep(*ret, h->names, sizeof h->names);
	}
}

static void show_names(const char *names, char ret[NAMES_SHOWN])
{
	size_t n = 0;

	for (; names[n] && n + 1 < NAMES_SHOWN; n++)
		ret[n] = names[n] >= 0x20 && names[n] < 0x7f && names[n] != '"' ? names[n] : '?';
	ret[n] = 0;
}

static void apply_names(struct input *in, struct head *h, unsigned words)
{
	struct input_xyz *xyz = &in->as.xyz;
	struct input_columns c;

	if (*h->names) {
		struct input_line names = line_of(h->names);

		if (names_to_columns(names, &c) && count_words(names) >= words) {
			xyz->columns = c;
		} else {
			show_names(h->names, h->shown);
			warn_names(in, h->shown);
		}
	} else if (*h->comment && names_to_columns(line_of(h->comment), &c) && count_words(line_of(h->comment)) == words) {
		xyz->columns = c;
	}
}

int input_columns_look(struct input *in, struct err *err)
{
	struct input_xyz *xyz = &in->as.xyz;
	struct input_columns c;
	struct input_line first;
	struct head h = {.names_line = 0};
	unsigned words;
	int rc = letters_read(in->columns, &xyz->columns, err);

	if (!rc)
		rc = read_head(in, &h, &first, err);
	if (rc)
		return rc;
	words = first.at ? count_words(first) : 0;
	xyz->commas = first.at && column_kind(first) == ',' ? words : 0;
	/* words alone are a text, not points */
	if (*h.names && !first.at && !names_to_columns(line_of(h.names), &c))
		h = (struct head){.names_line = 0};
	xyz->head = h.names_line;
	if (!in->columns)
		apply_names(in, &h, words);
	input_line_rewind(in);
	return 0;
}
