/*
 * Comments: which lines are comments, and which of them may be points that were meant to be read.
 *
 * Model: the first characters make a line a comment, but a `!` or `;` there may also be the name of a point. A comment after the
 * line of names, or after the first point, is suspicious if it has numbers in the columns of the coordinates. Suspicious comments
 * are counted and reported. They are an error with --strict, or if the file has no other points. They are counted once: when a
 * file is opened, or while a pipe is read.
 */
#include "input_text_parts.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

enum { LINE = 4096 };

static const char *skip_blanks(const char *p, const char *end)
{
	while (p < end && (*p == ' ' || *p == '\t'))
		p++;
	return p;
}

/* The text after a semicolon at the start of a line is not a row whose first column is empty. */
static bool is_remark(const char *p, const char *end)
{
	p = skip_blanks(p, end);
	return p == end || !strchr("0123456789+-.,;\"", *p) || !memchr(p, ';', (size_t)(end - p));
}

static bool begins_comment(const char *p, const char *end)
{
	switch (*p) {
	case '#':
	case '%':
	case '!':
		return true;
	case '/':
		return p + 1 < end && p[1] == '/';
	case ';':
		return is_remark(p + 1, end);
	default:
		return false;
	}
}

bool input_line_is_comment(struct input_line line)
{
	const char *p = skip_blanks(line.at, line.end);

	if (p < line.end && (unsigned char)(*p - '0') < 10)
		return false;
	if (p < line.end && *p == '"') { /* a comment in the first field of a table */
		p = skip_blanks(p + 1, line.end);
		return p < line.end && begins_comment(p, line.end);
	}
	return p == line.end || begins_comment(p, line.end);
}

struct input_line input_comment_words(struct input_line line)
{
	while (line.at < line.end && strchr("#%/!;\" \t", *line.at))
		line.at++;
	return line;
}

/* The columns that are read as x, y and z are numbers. */
bool input_line_is_point(const struct input_columns *c, struct input_line line)
{
	uint64_t needed = 0;

	for (unsigned i = 0; i < c->n; i++)
		if (c->role[i] <= INPUT_Z)
			needed |= (uint64_t)1 << i;
	return (input_words_of(line).numbers & needed) == needed;
}

/* Tests the line with and without its mark. If a quote precedes the mark, another one follows the first word. */
static bool could_be_point(const struct input_columns *c, struct input_line line)
{
	struct input_line words = input_comment_words(line);
	char copy[LINE];
	size_t n = 0;

	for (const char *p = words.at; p < words.end && n < sizeof copy; p++)
		if (*p != '"')
			copy[n++] = *p;
	return input_line_is_point(c, line) || input_line_is_point(c, words) ||
	       input_line_is_point(c, (struct input_line){copy, copy + n});
}

void input_comment_points_begin(struct input *in)
{
	struct input_xyz *xyz = input_xyz_of(in);

	if (!xyz->begun && !xyz->names)
		xyz->commented = 0;
	xyz->begun = true;
}

int input_comment_look(struct input *in, struct input_line line, struct err *err)
{
	struct input_xyz *xyz = input_xyz_of(in);

	if (!xyz->counting || xyz->line <= xyz->names || !could_be_point(&xyz->columns, line))
		return 0;
	if (in->strict && (xyz->begun || xyz->names)) {
		input_bad_line(in, err, ERR_INPUT, "a comment that has the numbers of a point", line);
		return err_add_hint(
			err, "comments begin with #, //, %%, ! or ;: take the mark away, or without --strict they are counted");
	}
	if (!xyz->commented++)
		xyz->commented_line = xyz->line;
	return 0;
}

int input_comment_judge(struct input *in, bool any_points, struct err *err)
{
	const struct input_xyz *xyz = input_xyz_of(in);

	if (!xyz->commented)
		return 0;
	if (!any_points) {
		input_fail(in, err, ERR_INPUT, xyz->commented_line, "line",
			   "no points, but %" PRIu64 " %s the numbers of one, the first is line %" PRIu64, xyz->commented,
			   xyz->commented == 1 ? "comment has" : "comments have", xyz->commented_line);
		return err_add_hint(err, "comments begin with #, //, %%, ! or ;: take the marks away if these are points");
	}
	input_warn(in, "%" PRIu64 " %s the numbers of a point and %s not read, the first is line %" PRIu64, xyz->commented,
		   xyz->commented == 1 ? "comment has" : "comments have", xyz->commented == 1 ? "is" : "are",
		   xyz->commented_line);
	return 0;
}
