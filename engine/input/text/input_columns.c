/*
 * Determines the columns of a text: from --columns, else from a line of names before the points, else x y z.
 *
 * Model: these lines may come before the points: comments; a line of names (a comment or not), with lines of any text before it
 * and a line of units after it; lines of numbers that are not points; in .pts files the number of points. input_head.c finds
 * them, input_header.c interprets the names. With --columns, names are only used for their units.
 *
 * A line of words is a line of names if it names two coordinates or has as many words as there are columns. Otherwise it is a
 * title, which may stand alone. A comment counts as a line of names only if its words fit the columns of the first point. The
 * line of names is looked for in the first hundred lines of text. If there is none, the first of these lines is read as a
 * point, and fails.
 */
#include "input_text_parts.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "crs.h"

enum { NAMES_SHOWN = 60 };

/* The letters of txt2las, and the place of each column that is read. */
static const char letters[] = "xyzcrn", skipped[] = "s_-itaupRGB";

static int bad_columns(const char *text, struct err *err, const char *why)
{
	err_set(err, ERR_USAGE, "columns \"%.80s\": %s", text, why);
	err_add_place(err, ERR_NO_OFFSET, "columns");
	return err_add_hint(err, "a letter each: x y z (or e n z: easting, northing), c class, r return, n number of returns, "
				 "_ to skip one");
}

static void settle(struct input_columns *c)
{
	for (c->n = INPUT_COLUMNS; c->n && c->role[c->n - 1] == INPUT_SKIPPED; c->n--)
		;
	c->cls = memchr(c->role, INPUT_CLASS, sizeof c->role);
	c->returns = memchr(c->role, INPUT_RETURN, sizeof c->role);
}

/* e is x, and beside it n is y, unless y stands too. */
static char letter_of(const char *text, char c)
{
	if (c == 'e')
		return 'x';
	return c == 'n' && strchr(text, 'e') && !strchr(text, 'y') ? 'y' : c;
}

/* The letters of --columns. -ERR_USAGE. */
static int letters_read(const char *text, struct input_columns *ret, struct err *err)
{
	struct input_columns c = {.n = 0};
	unsigned seen[INPUT_ROLES + 1] = {0};
	size_t n = 0;

	memset(c.role, INPUT_SKIPPED, sizeof c.role);
	text = text ? text : "xyz";
	for (const char *p = text; *p; p++, n++) {
		const char *letter = strchr(letters, letter_of(text, *p));

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

static struct input_line line_of(const char *text)
{
	return (struct input_line){text, text + strlen(text)};
}

static void show_names(const char *names, char ret[NAMES_SHOWN])
{
	size_t n = 0;

	for (; names[n] && n + 1 < NAMES_SHOWN; n++)
		ret[n] = names[n] >= 0x20 && names[n] < 0x7f && names[n] != '"' ? names[n] : '?';
	ret[n] = 0;
}

/* A title: its words name no coordinates, and it does not have as many words as there are columns. */
static bool is_prose(const struct input_head *h, const struct input_header *header)
{
	return header->coordinates < 2 && header->n != h->row.words;
}

/* Columns without a name must not have numbers: a description may have more words than the names. Names without a column belong
 * to empty columns at the end of a row. With blanks as separators neither empty columns nor names of several words are seen. */
static bool fits(const struct input_header *header, struct input_words row)
{
	if (!row.words) /* there is no point */
		return true;
	if (row.words >= header->n)
		return header->n >= INPUT_COLUMNS || !(row.numbers >> header->n);
	for (int i = 0; i < 3; i++)
		if (header->reading[0].at[i] >= (int)row.words)
			return false;
	return header->kind != ' ' && row.kind != ' ';
}

/* The names fit the columns, and the coordinates are numbers. */
static bool reads(const struct input_header *header, struct input_words row)
{
	for (int i = 0; i < 3; i++)
		if (header->reading[0].at[i] < 0 || !(row.numbers >> header->reading[0].at[i] & 1))
			return false;
	return fits(header, row);
}

/* Skips to the first point. Warns about skipped lines other than the line of names. */
static void skip_head(struct input *in, const struct input_head *h)
{
	unsigned texts = h->texts ? h->texts - 1 : 0;

	input_xyz_of(in)->head = h->before_line;
	if (texts)
		input_warn(in, "%u %s before the points, beside that of names, %s skipped", texts, texts == 1 ? "line" : "lines",
			   texts == 1 ? "is" : "are");
	if (h->numbers)
		input_warn(in,
			   "%u %s before the points, up to line %" PRIu64 ", %s skipped: the columns are not those of the points",
			   h->numbers, h->numbers == 1 ? "line" : "lines", h->before_line, h->numbers == 1 ? "is" : "are");
}

/* Uses the names. If they are not clear, they are an error, unless --columns is given. */
static int apply(struct input *in, struct input_head *h, struct input_header *header, uint64_t line, const char *text,
		 struct err *err)
{
	struct input_xyz *xyz = input_xyz_of(in);
	struct input_header joined;
	bool differ = false;

	xyz->names = line;
	input_header_read_joined(line_of(text), &joined);
	if (joined.n < header->n && reads(&joined, h->row)) {
		if (!in->columns && reads(header, h->row))
			return input_header_refuse_two(in, header, &joined, h->row, line, text, err);
		*header = joined;
	}
	if (input_header_read_units(line_of(h->units), header, &differ))
		h->texts--; /* read, not skipped */
	if (differ)
		input_warn(in, "line %" PRIu64 " and the one behind it have other units: none is taken", line);
	if (!in->columns && (header->state != INPUT_HEADER_SURE || !fits(header, h->row)))
		return input_header_refuse(in, header, h->row, line, text, err);
	if (!in->columns) {
		input_header_columns(header, &xyz->columns);
		settle(&xyz->columns);
		xyz->guesses = false;
	}
	if (fits(header, h->row))
		input_header_units(in, header, &xyz->columns);
	return 0;
}

static int apply_names(struct input *in, struct input_head *h, struct err *err)
{
	struct input_header header;
	char shown[NAMES_SHOWN];
	int rc = 0;

	input_header_read(line_of(h->names), &header);
	/* a file of words only has no points; and without a line of names, only one line of words may come before the points */
	if ((!h->first_line && header.state == INPUT_HEADER_LACKING) || (is_prose(h, &header) && h->texts > 1))
		return 0;
	if (is_prose(h, &header)) {
		show_names(h->names, shown);
		input_warn(in, "line %" PRIu64 " names no columns and is skipped (%s)", h->names_line, shown);
	} else {
		rc = apply(in, h, &header, h->names_line, h->names, err);
	}
	skip_head(in, h);
	return rc;
}

/* A comment is prose until its words fit the columns. */
static int apply_comment(struct input *in, struct input_head *h, struct err *err)
{
	struct input_header header;

	input_header_read(line_of(h->comment), &header);
	if (header.n > h->row.words)
		input_header_read_joined(line_of(h->comment), &header);
	return header.n == h->row.words ? apply(in, h, &header, h->comment_line, h->comment, err) : 0;
}

int input_columns_look(struct input *in, struct err *err)
{
	struct input_xyz *xyz = input_xyz_of(in);
	struct input_head h;
	int rc = letters_read(in->columns, &xyz->columns, err);

	crs_info_clear(&in->info.crs);
	if (!rc)
		rc = input_head_read(in, &h, err);
	if (rc)
		return rc;
	xyz->commas = h.row.kind == ',' ? h.row.words : 0;
	xyz->guesses = !in->columns && !xyz->counts;
	if (h.numbers && !h.texts)
		skip_head(in, &h);
	if (h.names_line)
		rc = apply_names(in, &h, err);
	else if (h.comment_line && h.first_line)
		rc = apply_comment(in, &h, err);
	if (!rc)
		rc = input_check_plane(in, err);
	xyz->first = xyz->head ? h.first_line : h.text_line;
	input_line_rewind(in);
	return rc;
}
