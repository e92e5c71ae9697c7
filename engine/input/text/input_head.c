/*
 * The head of a text, before its points: a line of names, a line of units after it, comments, lines of any text, and lines of
 * numbers that are not points.
 *
 * Model: the first line whose columns are numbers is a point, with two exceptions. The next hundred lines are examined for
 * them:
 *
 *   a line of names follows   The lines of numbers before it belong to the head if they differ from the point after it: in the
 *                             number of columns, or if they are whole numbers and the point has decimals. Otherwise they are
 *                             points, and the line of names fails as a point.
 *   longer rows follow        At most three lines belong to the head if two or more rows follow them, and all of these have
 *                             more columns: numbers, or anything if the lines are whole numbers and the rows have decimals
 *                             ("2024 05 13"). With --columns or a line of names this does not apply: they define a point.
 *
 * Lines of numbers that are skipped lead to a warning (input_columns.c).
 */
#include "input_text_parts.h"

#include <ctype.h>
#include <inttypes.h>
#include <string.h>
#include <strings.h>

enum { TEXTS = 100, ROWS = 100, FEW = 3, ROWS_ENOUGH = 2, ROWS_ODD = 3, COORDINATES = 7 /* bits of three columns */ };

static void keep(struct input_line line, char ret[INPUT_HEAD_LINE])
{
	size_t n = (size_t)(line.end - line.at);

	n = n < INPUT_HEAD_LINE ? n : INPUT_HEAD_LINE - 1;
	memcpy(ret, line.at, n);
	ret[n] = 0;
}

static bool looks_like_number(struct input_line word)
{
	const char *p = word.at;

	p += p < word.end && *p == '"';
	p += p < word.end && (*p == '+' || *p == '-');
	p += p < word.end && *p == '.';
	return (p < word.end && (isdigit((unsigned char)*p) || *p == '*')) ||
	       (word.end - p == 3 && (!strncasecmp(p, "nan", 3) || !strncasecmp(p, "inf", 3))) ||
	       (word.end - p == 8 && !strncasecmp(p, "infinity", 8));
}

/* At least three words, none of them a number. */
static bool is_words(struct input_line line)
{
	const char *p = line.at;
	char kind = input_word_kind(line);
	struct input_line word;
	unsigned words = 0;

	for (; input_word_next(&p, line.end, kind, &word); words++)
		if (looks_like_number(word))
			return false;
	return words >= 3;
}

bool input_head_is_names(struct input_line line)
{
	struct input_header header;

	if (!is_words(line))
		return false;
	input_header_read(line, &header);
	return header.coordinates >= 2;
}

/* ---- lines of text ---- */

static void take_comment(struct input_head *h, struct input_line line, uint64_t number)
{
	struct input_line words = input_comment_words(line);
	struct input_header header;

	if (words.at == line.at)
		return;
	input_header_read(words, &header);
	if (header.state == INPUT_HEADER_LACKING)
		return;
	keep(words, h->comment);
	h->comment_line = number;
}

/* Handles a line that is neither a comment nor a count. False: it is the first point. */
static bool take_text(struct input *in, struct input_head *h, struct input_line line)
{
	bool words = is_words(line), names = words && input_head_is_names(line);

	if (h->has_coordinates ? !words || names : !words && input_line_is_point(&input_xyz_of(in)->columns, line))
		return false;
	if (words && !h->has_coordinates) {
		keep(line, h->names);
		h->names_line = input_xyz_of(in)->line;
		h->has_coordinates = names;
	} else if (words && h->before_line == h->names_line) {
		keep(line, h->units);
	}
	h->before_line = input_xyz_of(in)->line;
	h->texts++;
	return true;
}

/* Reads up to the first point, or up to the largest number of lines before it. */
static int read_texts(struct input *in, struct input_head *h, struct err *err)
{
	struct input_line line;
	uint64_t count;

	while (h->texts <= TEXTS) {
		int rc = input_line_next(in, &line, err);

		if (rc || !line.at)
			return rc;
		if (input_line_is_comment(line)) {
			take_comment(h, line, input_xyz_of(in)->line);
			continue;
		}
		if (input_xyz_of(in)->counts && input_line_is_count(line, &count))
			continue;
		if (!h->text_line)
			h->text_line = input_xyz_of(in)->line;
		if (!take_text(in, h, line)) {
			h->first_line = input_xyz_of(in)->line;
			h->row = input_words_of(line);
			return 0;
		}
	}
	return 0;
}

/* ---- lines of numbers ---- */

struct rows {
	unsigned n;
	struct row {
		uint64_t line;
		struct input_words words;
	} row[ROWS];
};

/* The numbers at the start of a line, and the rest of it as one word. */
static unsigned width(const struct row *r)
{
	return r->words.leading + (r->words.words > r->words.leading);
}

static bool is_whole(struct input_words words)
{
	return (words.whole & COORDINATES) == COORDINATES;
}

static bool has_decimals(struct input_words words)
{
	return words.numbers & ~words.whole & COORDINATES;
}

/* The number of first rows that have fewer columns than all others. */
static unsigned count_short(const struct rows *r)
{
	unsigned n = 0, most = width(&r->row[r->n - 1]);

	while (width(&r->row[n]) < most)
		n++;
	for (unsigned i = n; i < r->n; i++)
		if (width(&r->row[i]) < most)
			return 0;
	return n <= FEW && r->n - n >= ROWS_ENOUGH ? n : 0;
}

static unsigned count_no_points(const struct rows *r)
{
	unsigned n = count_short(r), numbers = INPUT_COLUMNS;
	bool decimals = false;

	for (unsigned i = n; i < r->n; i++) {
		numbers = r->row[i].words.leading < numbers ? r->row[i].words.leading : numbers;
		decimals |= has_decimals(r->row[i].words);
	}
	for (unsigned i = 0; i < n; i++)
		if (r->row[i].words.leading >= numbers && !(decimals && is_whole(r->row[i].words)))
			return 0;
	return n;
}

/* Only the first point has whole numbers. */
static bool is_odd(const struct rows *r)
{
	for (unsigned i = 1; i < r->n; i++)
		if ((r->row[i].words.numbers & ~r->row[i].words.whole & COORDINATES) != COORDINATES)
			return false;
	return r->n > ROWS_ODD && is_whole(r->row[0].words);
}

static void leave_numbers_out(struct input *in, struct input_head *h, const struct rows *r)
{
	unsigned n = count_no_points(r);

	if (n) {
		h->numbers = n;
		h->before_line = r->row[n - 1].line;
		h->first_line = r->row[n].line;
		h->row = r->row[n].words;
	} else if (is_odd(r)) {
		input_warn(in, "line %" PRIu64 " is read as a point, but has whole numbers only, unlike those behind it",
			   h->first_line);
	}
}

/* The line is a line of names that follows the rows. */
static int take_names_behind(struct input *in, struct input_head *h, const struct rows *r, struct input_line line,
			     struct err *err)
{
	struct input_head behind = *h;
	int rc;

	behind.first_line = 0;
	behind.numbers = r->n;
	take_text(in, &behind, line);
	rc = read_texts(in, &behind, err);
	if (rc || !behind.first_line)
		return rc;
	for (unsigned i = 0; i < r->n; i++)
		if (r->row[i].words.words == behind.row.words && !(is_whole(r->row[i].words) && has_decimals(behind.row)))
			return 0;
	*h = behind;
	return 0;
}

/* Whether the supposed first point is a point. */
static int look_behind(struct input *in, struct input_head *h, struct err *err)
{
	const struct input_xyz *xyz = input_xyz_of(in);
	struct rows r = {.n = 1, .row = {{h->first_line, h->row}}};
	struct input_line line;

	while (r.n < ROWS) {
		int rc = input_line_next(in, &line, err);

		if (rc)
			return rc;
		/* the last line of a pipe's head may be incomplete */
		if (!line.at || (in->has_pipe && line.end == (const char *)in->buffer + xyz->n_buffered))
			break;
		if (input_line_is_comment(line))
			continue;
		if (input_head_is_names(line))
			return take_names_behind(in, h, &r, line, err);
		r.row[r.n++] = (struct row){xyz->line, input_words_of(line)};
	}
	if (!in->columns)
		leave_numbers_out(in, h, &r);
	return 0;
}

int input_head_read(struct input *in, struct input_head *ret, struct err *err)
{
	int rc;

	*ret = (struct input_head){.names_line = 0};
	rc = read_texts(in, ret, err);
	if (rc || !ret->first_line || ret->has_coordinates || input_xyz_of(in)->counts)
		return rc;
	return look_behind(in, ret, err);
}
