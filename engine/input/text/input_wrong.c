/*
 * Lines that are not points. Lines without a value for a coordinate are skipped and counted; the others are errors, and this file
 * finds what is wrong with them.
 */
#include "input_text_parts.h"

#include <ctype.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

enum { EXCERPT = 40 };

int input_bad_line(struct input *in, struct err *err, enum err_code code, const char *what, struct input_line text)
{
	char excerpt[EXCERPT + 1];
	size_t n = 0;

	for (const char *p = text.at; p < text.end && n < EXCERPT; p++) {
		char c = input_encoding_shown(in, *p);

		excerpt[n++] = c >= 0x20 && c < 0x7f && c != '"' ? c : '?';
	}
	excerpt[n] = 0;
	err_set(err, code, "line %" PRIu64 ": %s: \"%s\"%s", input_xyz_of(in)->line, what, excerpt,
		text.at + n < text.end ? " ..." : "");
	err_add_place(err, input_xyz_of(in)->line, "line");
	return err_add_file(err, in->name);
}

/* ---- no value ---- */

static bool is_blank(char c)
{
	return c == ' ' || c == '\t';
}

/* The field that begins at p, without blanks and quotes around it. */
static struct input_line field_at(struct input_line line, const char *p, char kind)
{
	struct input_line f = {p, p};

	while (f.end < line.end && *f.end != ',' && *f.end != ';' && (!is_blank(*f.end) || (kind && kind != ' ')))
		f.end++;
	while (f.end > f.at && is_blank(f.end[-1]))
		f.end--;
	if (f.end - f.at >= 2 && *f.at == '"' && f.end[-1] == '"') {
		f.at++;
		f.end--;
	}
	return f;
}

/* Whether a line that ends here has one more column, with nothing in it. */
static bool ends_with_separator(struct input_line line)
{
	const char *p = line.end;

	if (p > line.at && p[-1] == '\t')
		return true;
	while (p > line.at && is_blank(p[-1]))
		p--;
	return p > line.at && (p[-1] == ',' || p[-1] == ';');
}

bool input_line_no_value(struct input_line line, const char *p, char kind)
{
	static const char *const words[] = {"nan", "inf", "null", "na", "n/a", "none", "nodata", "-"};
	struct input_line f = field_at(line, p, kind);
	size_t n = (size_t)(f.end - f.at), sign = n && *f.at == '-', stars = 0;

	if (p == line.end)
		return ends_with_separator(line);
	while (stars < n && f.at[stars] == '*')
		stars++;
	if (stars == n) /* or empty */
		return true;
	for (size_t i = 0; i < sizeof words / sizeof *words; i++)
		if (strlen(words[i]) == n && !strncasecmp(f.at, words[i], n))
			return true;
	/* 1.#QNAN, -1.#IND and 1.#INF of some C libraries */
	return n > sign + 3 && !memcmp(f.at + sign, "1.#", 3) && isalpha((unsigned char)f.at[sign + 3]);
}

/* ---- errors ---- */

static bool is_digit(const char *p, struct input_line line)
{
	return p >= line.at && p < line.end && isdigit((unsigned char)*p);
}

/* The length in bytes of a mark between thousands: ' , . _ and the blanks and quotes of UTF-8 for that. 0: there is none. */
static size_t mark_at(const char *p, struct input_line line)
{
	static const char *const marks[] = {"'",           ",", ".", "_", " ", "\1", "\xc2\xa0", "\xe2\x80\xaf", "\xe2\x80\x89",
					    "\xe2\x80\x99"};

	for (size_t i = 0; i < sizeof marks / sizeof *marks; i++) {
		size_t n = strlen(marks[i]);

		if ((size_t)(line.end - p) > n && !memcmp(p, marks[i], n))
			return n;
	}
	return 0;
}

/* The columns of the line are separated by something else. */
static bool has_separator_beside(struct input_line line, char mark)
{
	static const char separators[] = " ,;\t";

	for (const char *s = separators; *s; s++)
		if (*s != mark && memchr(line.at, *s, (size_t)(line.end - line.at)))
			return true;
	return false;
}

/* Groups of three digits with the same mark between them. The first digit must not follow a decimal point. Commas and blanks
 * separate columns, too, and a point may be a decimal point. So there must be two groups, or a decimal point after a group that
 * a comma or blank separates. *ret_n: bytes. */
static bool thousands_at(struct input_line line, const char *p, size_t *ret_n)
{
	const char *first = p;
	size_t mark, groups = 0;
	char kind;

	while (is_digit(p, line))
		p++;
	if (p - first > 3 || (first > line.at && (is_digit(first - 1, line) || first[-1] == '.')) || !(mark = mark_at(p, line)))
		return false;
	kind = *p;
	while ((size_t)(line.end - p) >= mark + 3 && mark_at(p, line) == mark && *p == kind && is_digit(p + mark, line) &&
	       is_digit(p + mark + 1, line) && is_digit(p + mark + 2, line) && !is_digit(p + mark + 3, line)) {
		p += mark + 3;
		groups++;
	}
	*ret_n = (size_t)(p - first);
	if (kind == '.')
		return groups >= 2;
	if (kind != ',' && kind != ' ')
		return groups;
	return groups &&
	       ((p < line.end && *p == '.' && is_digit(p + 1, line)) || (groups >= 2 && has_separator_beside(line, kind)));
}

/* -code, or 0: it has none. */
static int thousands(struct input *in, struct err *err, struct input_line line)
{
	size_t n;

	for (const char *p = line.at; p < line.end; p++) {
		if (!is_digit(p, line) || !thousands_at(line, p, &n))
			continue;
		input_bad_line(in, err, ERR_INPUT, "separators of thousands, it seems, and these are not read",
			       (struct input_line){p, line.end});
		return err_add_hint(err, "write numbers without them: 1234567.8, not 1,234,567.8 or 1'234'567.8");
	}
	return 0;
}

/* Finds decimal points that contradict --decimal-comma: a point after a comma in the same run of digits, where the comma
 * separates columns; or one point in a number, in a line without a comma. Other points separate thousands. */
static bool has_decimal_points(const struct input *in, struct input_line line)
{
	bool comma = false, any = false, several = false, comma_before = false, point_before = false;

	for (const char *p = line.at; p < line.end; p++) {
		if (input_encoding_shown(in, *p) == '.') {
			if (comma_before)
				return true;
			several |= point_before;
			any = point_before = true;
		} else if (*p == '.') {
			comma = comma_before = true;
		} else if (!is_digit(p, line)) {
			comma_before = point_before = false;
		}
	}
	return any && !comma && !several;
}

/* -code, or 0: it has none. */
static int decimal_points(struct input *in, struct err *err, struct input_line line)
{
	if (!in->decimal_comma || !has_decimal_points(in, line))
		return 0;
	input_bad_line(in, err, ERR_INPUT, "decimal points, but --decimal-comma says that there are none", line);
	return err_add_hint(err, "leave --decimal-comma out; it is for files of 123,45");
}

static bool has_decimal_comma(struct input_line line)
{
	for (const char *p = line.at + 1; p + 1 < line.end; p++)
		if (*p == ',' && is_digit(p - 1, line) && is_digit(p + 1, line))
			return true;
	return false;
}

int input_wrong_commas(struct input *in, struct err *err, struct input_line line)
{
	input_bad_line(in, err, ERR_INPUT, "decimal commas, it seems", line);
	return err_add_hint(
		err,
		"read them with --decimal-comma, or write decimal points (123.45, not 123,45); one kind of separator a line");
}

int input_wrong_separator(struct input *in, struct err *err, struct input_line line, const char *column)
{
	int rc = decimal_points(in, err, line);

	if (!rc)
		rc = thousands(in, err, line);
	if (rc)
		return rc;
	if (column == line.at && input_guess_sees_numbers(in, line)) { /* 12A, 2024-05-13 */
		input_bad_line(in, err, ERR_INPUT, "not a number", line);
		return input_guess_hint(in, line, err);
	}
	if (has_decimal_comma(line))
		return input_wrong_commas(in, err, line);
	input_bad_line(in, err, ERR_INPUT, "numbers that run together, or two kinds of separators", line);
	return err_add_hint(err, in->decimal_comma ? "one separator a line, blanks or semicolons; decimal commas, and no points" :
						     "one separator a line: blanks, commas or semicolons; decimal points");
}

int input_wrong_strict(struct err *err)
{
	err->hint[0] = 0;
	return err_add_hint(err, "without --strict lines that have no value for a coordinate are left out and counted");
}

int input_wrong_attribute(const struct input *in, struct err *err)
{
	err->hint[0] = 0;
	return err_add_hint(err, input_xyz_of(in)->columns.named ?
					 "without --strict such points are never classified, and the only return" :
					 "with _ in --columns in place of its letter the column is not read");
}

int input_wrong_number(struct input *in, struct err *err, enum input_number_state state, struct input_line line, const char *p)
{
	const struct input_line rest = {p, line.end};
	char what[48];
	int rc;

	if (state == INPUT_NUMBER_NOT_FINITE)
		return input_bad_line(in, err, ERR_INPUT, "not a finite number", rest);
	if (state == INPUT_NUMBER_TOO_LONG) {
		input_bad_line(in, err, ERR_INPUT, "a number of more than 19 digits before its point", rest);
		return err_add_hint(err, "mend the line: it is no coordinate");
	}
	if (p != line.end) {
		rc = *p == '"' || input_encoding_shown(in, *p) == '.' ? decimal_points(in, err, line) : 0;
		if (!rc && *p == '"')
			rc = thousands(in, err, rest);
		if (rc)
			return rc;
		input_bad_line(in, err, ERR_INPUT, "not a number", rest);
		if (input_head_is_names(line))
			return err_add_hint(err,
					    "names of columns stand once, before all points: take this line away, or what stands "
					    "before it");
		return input_guess_hint(in, line, err);
	}
	if (input_xyz_of(in)->columns.n == 3)
		snprintf(what, sizeof what, "fewer than three columns");
	else
		snprintf(what, sizeof what, "fewer than %u columns", input_xyz_of(in)->columns.n);
	input_bad_line(in, err, ERR_INPUT, what, line);
	return err_add_hint(err, input_xyz_of(in)->columns.n == 3 ?
					 "every line needs x y z; comments begin with #, //, %%, ! or ;" :
					 "every line needs all columns that --columns or the line of names tells");
}
