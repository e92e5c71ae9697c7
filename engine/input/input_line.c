/*
 * Lines of text files, and the numbers of a line.
 *
 * Model: lines are seen through one window of the input's buffer. A line has one kind of separator: blanks
 * and tabs, or commas, or semicolons. What breaks that rule is refused, so that decimal commas are never
 * taken for columns; where commas separate whole numbers, but not all in the same way, it is refused too.
 * Behind the last column that is read, a line may go on as it likes.
 */
#include "input_text.h"

#include <ctype.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "io.h"

enum { LINE_MAX_BYTES = 4096, EXCERPT = 40, LINES_A_TURN = 1 << 16 };

int input_bad_line(struct input *in, struct err *err, enum err_code code, const char *what, struct input_line text)
{
	char excerpt[EXCERPT + 1];
	size_t n = 0;

	for (const char *p = text.at; p < text.end && n < EXCERPT; p++)
		excerpt[n++] = *p >= 0x20 && *p < 0x7f && *p != '"' ? *p : '?';
	excerpt[n] = 0;
	err_set(err, code, "line %" PRIu64 ": %s: \"%s\"%s", in->as.xyz.line, what, excerpt,
		text.at + n < text.end ? " ..." : "");
	err_add_place(err, in->as.xyz.line, "line");
	return err_add_file(err, in->name);
}

void input_line_rewind(struct input *in)
{
	struct input_xyz *xyz = &in->as.xyz;

	xyz->at = xyz->line = xyz->points = 0;
	xyz->i_buffered = xyz->n_buffered = 0;
	xyz->ended = false;
}

/* Moves what is left of the window to its front and reads on behind it. */
static int fill(struct input *in, struct err *err)
{
	struct input_xyz *xyz = &in->as.xyz;
	size_t kept = xyz->n_buffered - xyz->i_buffered, got;
	int rc;

	memmove(in->buffer, in->buffer + xyz->i_buffered, kept);
	if (in->has_pipe && xyz->head_only && xyz->at >= in->head) {
		got = 0;
		rc = 0;
	} else if (in->has_pipe) {
		rc = input_forward_read(in, xyz->at, in->buffer + kept, sizeof in->buffer - kept, &got, err);
	} else {
		rc = io_read_some(in->fd, in->buffer + kept, sizeof in->buffer - kept, xyz->at, in->name, &got, err);
	}
	if (rc)
		return rc;
	xyz->ended = in->has_pipe ? !got && !in->dry : got < sizeof in->buffer - kept;
	xyz->at += got;
	in->bytes_read += got;
	xyz->i_buffered = 0;
	xyz->n_buffered = kept + got;
	return 0;
}

int input_line_next(struct input *in, struct input_line *ret, struct err *err)
{
	struct input_xyz *xyz = &in->as.xyz;

	for (;;) {
		char *at = (char *)in->buffer + xyz->i_buffered;
		size_t left = xyz->n_buffered - xyz->i_buffered;
		char *end = left ? memchr(at, '\n', left) : NULL;

		if (!end && !xyz->ended && left <= LINE_MAX_BYTES) {
			int rc = fill(in, err);

			if (rc)
				return rc;
			if (!input_dry(in))
				continue;
			ret->at = NULL;
			return 0;
		}
		if (!end && !left) {
			ret->at = NULL;
			return 0;
		}
		xyz->line++;
		xyz->i_buffered += end ? (size_t)(end - at) + 1 : left;
		ret->at = at;
		ret->end = end ? end : at + left;
		if (ret->end - at > LINE_MAX_BYTES)
			return input_bad_line(in, err, ERR_INPUT, "longer than 4096 bytes", *ret);
		if (ret->end > at && ret->end[-1] == '\r')
			ret->end--;
		if (xyz->line == 1 && ret->end - at >= 3 && !memcmp(at, "\xef\xbb\xbf", 3))
			ret->at += 3; /* byte order mark */
		return 0;
	}
}

static inline const char *skip_blanks(const char *p, const char *end)
{
	while (p < end && (*p == ' ' || *p == '\t'))
		p++;
	return p;
}

bool input_line_is_comment(struct input_line line)
{
	const char *p = skip_blanks(line.at, line.end);

	return p == line.end || *p == '#' || *p == '%' || (*p == '/' && p + 1 < line.end && p[1] == '/');
}

/* Of a pipe, a turn is over after so many lines without a point, as if the pipe were dry: one that sends nothing else, for
 * ever, can be ended. */
int input_line_next_point(struct input *in, struct input_line *ret, struct err *err)
{
	unsigned lines = 0;

	do {
		int rc;

		if (in->has_pipe && !in->as.xyz.head_only && lines++ == LINES_A_TURN) {
			in->dry = true;
			ret->at = NULL;
			return 0;
		}
		rc = input_line_next(in, ret, err);

		if (rc)
			return rc;
		/* a line end of old Macs would hide every point but the first */
		if (ret->at && memchr(ret->at, '\r', (size_t)(ret->end - ret->at)))
			return input_bad_line(in, err, ERR_INPUT, "a carriage return inside of a line", *ret);
	} while (ret->at && (in->as.xyz.line <= in->as.xyz.head || input_line_is_comment(*ret)));
	return 0;
}

bool input_line_is_count(struct input_line line, uint64_t *ret)
{
	const char *p = skip_blanks(line.at, line.end);
	struct input_number n;

	if (input_number_read(&p, line.end, &n) != INPUT_NUMBER_OK || skip_blanks(p, line.end) != line.end || n.mantissa < 0 ||
	    n.exponent < 0 || n.written)
		return false;
	*ret = (uint64_t)n.mantissa;
	for (int i = 0; i < n.exponent; i++)
		*ret *= 10; /* at most 19 digits: input_number_read */
	return true;
}

/* Steps over one separator; *kind is that of the line, 0 before the first. NULL if it is another one.
 * Behind the last column a blank is enough in any line. */
static inline const char *separator(const char *p, const char *end, bool last, char *kind)
{
	const char *after = skip_blanks(p, end);
	char found = after < end && (*after == ',' || *after == ';') ? *after : ' ';

	if (after == end || (last && found == ' ' && after > p))
		return after;
	if ((found == ' ' && after == p) || (*kind && *kind != found))
		return NULL;
	*kind = found;
	return found == ' ' ? after : skip_blanks(after + 1, end);
}

/* A column that is not read: up to a separator, quotes holding what is between them together. */
static const char *skip_column(const char *p, const char *end, char kind)
{
	const char *quote;

	if (p < end && *p == '"') {
		quote = memchr(p + 1, '"', (size_t)(end - p - 1));
		return quote ? quote + 1 : end;
	}
	while (p < end && *p != ',' && *p != ';' && ((*p != ' ' && *p != '\t') || (kind && kind != ' ')))
		p++;
	return p;
}

static bool has_decimal_comma(struct input_line line)
{
	for (const char *p = line.at + 1; p + 1 < line.end; p++)
		if (*p == ',' && isdigit((unsigned char)p[-1]) && isdigit((unsigned char)p[1]))
			return true;
	return false;
}

static int decimal_comma(struct input *in, struct err *err, struct input_line line)
{
	input_bad_line(in, err, ERR_INPUT, "decimal commas, it seems, and these are not read", line);
	return err_add_hint(err, "write decimal points (123.45, not 123,45), and one kind of separator a line");
}

static int no_separator(struct input *in, struct err *err, struct input_line line)
{
	if (has_decimal_comma(line))
		return decimal_comma(in, err, line);
	input_bad_line(in, err, ERR_INPUT, "numbers that run together, or two kinds of separators", line);
	return err_add_hint(err, "one separator a line: blanks, commas or semicolons; decimal points");
}

static int no_number(struct input *in, struct err *err, enum input_number_state state, struct input_line line, const char *p)
{
	const struct input_line rest = {p, line.end};
	char what[48];

	if (state == INPUT_NUMBER_NOT_FINITE)
		return input_bad_line(in, err, ERR_INPUT, "not a finite number", rest);
	if (state == INPUT_NUMBER_TOO_LONG) {
		input_bad_line(in, err, ERR_INPUT, "more digits than can be kept exactly (18, down to 1e-15)", rest);
		return err_add_hint(err, "write the coordinates with the digits that were measured");
	}
	if (p != line.end)
		return input_bad_line(in, err, ERR_INPUT, "not a number", rest);
	if (in->as.xyz.columns.n == 3)
		snprintf(what, sizeof what, "fewer than three columns");
	else
		snprintf(what, sizeof what, "fewer than %u columns", in->as.xyz.columns.n);
	input_bad_line(in, err, ERR_INPUT, what, line);
	return err_add_hint(err, in->as.xyz.columns.n == 3 ?
					 "every line needs x y z; comments begin with #, // or %%" :
					 "every line needs all columns that --columns or the line of names tells");
}

/* Commas between whole numbers, some with a blank behind them and some without: "1,5, 2,5, 3,5". */
static bool uneven_commas(struct input_line line)
{
	bool blank = false, tight = false;

	if (memchr(line.at, '.', (size_t)(line.end - line.at)))
		return false;
	for (const char *p = line.at; p + 1 < line.end; p++)
		if (*p == ',' && p > line.at && isdigit((unsigned char)p[-1])) {
			blank |= p[1] == ' ' || p[1] == '\t';
			tight |= isdigit((unsigned char)p[1]) != 0;
		}
	return blank && tight;
}

int input_line_parse(struct input *in, struct input_line line, struct input_number ret[INPUT_ROLES], struct err *err)
{
	const struct input_columns *columns = &in->as.xyz.columns;
	const char *p = skip_blanks(line.at, line.end);
	unsigned n = columns->n;
	char kind = 0;

	for (unsigned i = 0; i < n; i++) {
		const char *column = p;

		if (columns->role[i] == INPUT_SKIPPED) {
			p = skip_column(p, line.end, kind);
		} else {
			enum input_number_state state = input_number_read(&p, line.end, &ret[columns->role[i]]);

			if (state != INPUT_NUMBER_OK)
				return no_number(in, err, state, line, column);
		}
		if (p == line.end)
			continue;
		p = separator(p, line.end, i + 1 == n, &kind);
		if (!p)
			return no_separator(in, err, line);
	}
	return kind == ',' && uneven_commas(line) ? decimal_comma(in, err, line) : 0;
}
