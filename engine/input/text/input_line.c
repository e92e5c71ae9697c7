/*
 * Lines of text files, and the numbers of a line.
 *
 * Model: lines are read through one window, the input's buffer. A line has one kind of separator: blanks and tabs, or commas,
 * or semicolons. A line with two kinds is refused, so that decimal commas are never taken for separators. A line whose commas
 * separate whole numbers, some with a blank and some without, is refused too. After the last column that is read, a line may
 * contain anything.
 */
#include "input_text_parts.h"

#include <ctype.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "io.h"

enum { LINE_MAX_BYTES = 4096, LINES_A_TURN = 1 << 16 };

void input_line_rewind(struct input *in)
{
	struct input_xyz *xyz = input_xyz_of(in);

	xyz->at = xyz->line = xyz->points = 0;
	xyz->i_buffered = xyz->n_buffered = 0;
	xyz->ended = false;
	xyz->n_half = 0;
}

/* The next bytes of the file. */
static int read_bytes(struct input *in, void *to, size_t room, size_t *ret_n, struct err *err)
{
	struct input_xyz *xyz = input_xyz_of(in);
	int rc = 0;

	*ret_n = 0;
	if (!in->has_pipe)
		rc = io_read_some(in->fd, to, room, xyz->at, in->name, ret_n, err);
	else if (!xyz->head_only || xyz->at < in->head)
		rc = input_pipe_read(in, xyz->at, to, room, ret_n, err);
	if (!rc)
		xyz->ended = in->has_pipe ? !*ret_n && !in->dry : *ret_n < room;
	return rc;
}

/* Moves the unread bytes to the front of the window and reads more after them. */
static int fill(struct input *in, struct err *err)
{
	struct input_xyz *xyz = input_xyz_of(in);
	size_t kept = xyz->n_buffered - xyz->i_buffered, raw, got;
	int rc = xyz->at ? 0 : input_encoding_look(in, err);

	memmove(in->buffer, in->buffer + xyz->i_buffered, kept);
	if (!rc)
		rc = input_encoding_fill(in, kept, read_bytes, &raw, &got, err);
	if (rc)
		return rc;
	xyz->at += raw;
	in->bytes_read += raw;
	xyz->i_buffered = 0;
	xyz->n_buffered = kept + got;
	return 0;
}

int input_line_next(struct input *in, struct input_line *ret, struct err *err)
{
	struct input_xyz *xyz = input_xyz_of(in);
	const size_t most = xyz->line_most ? xyz->line_most : LINE_MAX_BYTES;

	for (;;) {
		char *at = (char *)in->buffer + xyz->i_buffered;
		size_t left = xyz->n_buffered - xyz->i_buffered;
		char *end = left ? memchr(at, '\n', left) : NULL;

		if (!end && !xyz->ended && left <= most) {
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
		if ((size_t)(ret->end - at) > most) {
			char what[48];

			snprintf(what, sizeof what, "longer than %zu bytes", most);
			return input_bad_line(in, err, ERR_INPUT, what, *ret);
		}
		if (ret->end > at && ret->end[-1] == '\r')
			ret->end--;
		if (xyz->line == 1 && ret->end - at >= 3 && !memcmp(at, "\xef\xbb\xbf", 3))
			ret->at += 3; /* byte order mark */
		if (in->decimal_comma)
			input_encoding_commas((char *)ret->at, (char *)ret->end);
		return 0;
	}
}

static inline const char *skip_blanks(const char *p, const char *end)
{
	while (p < end && (*p == ' ' || *p == '\t'))
		p++;
	return p;
}

/* The next line after the head, a comment or not. Reading a pipe stops after a number of lines without a point, as if the pipe
 * had no bytes, so that a pipe that sends no points can be cancelled. */
static int next_of_turn(struct input *in, unsigned *lines, struct input_line *ret, struct err *err)
{
	int rc;

	if (in->has_pipe && !input_xyz_of(in)->head_only && (*lines)++ == LINES_A_TURN) {
		in->dry = true;
		ret->at = NULL;
		return 0;
	}
	rc = input_line_next(in, ret, err);
	if (rc)
		return rc;
	/* with line ends of old Macs all points but the first would be missed */
	if (ret->at && memchr(ret->at, '\r', (size_t)(ret->end - ret->at)))
		return input_bad_line(in, err, ERR_INPUT, "a carriage return inside of a line", *ret);
	return 0;
}

int input_line_next_point(struct input *in, struct input_line *ret, struct err *err)
{
	unsigned lines = 0;

	for (;;) {
		int rc = next_of_turn(in, &lines, ret, err);

		if (rc || !ret->at)
			return rc;
		if (input_xyz_of(in)->line <= input_xyz_of(in)->head)
			continue;
		if (!input_line_is_comment(*ret)) {
			if (!input_xyz_of(in)->begun)
				input_comment_points_begin(in);
			return 0;
		}
		rc = input_comment_look(in, *ret, err);
		if (rc)
			return rc;
	}
}

bool input_line_is_count(struct input_line line, uint64_t *ret)
{
	const char *p = skip_blanks(line.at, line.end);
	struct input_number n;

	if (input_number_read(&p, line.end, &n) != INPUT_NUMBER_OK || n.deep || skip_blanks(p, line.end) != line.end ||
	    n.mantissa < 0 || n.exponent < 0 || n.written)
		return false;
	*ret = (uint64_t)n.mantissa;
	for (int i = 0; i < n.exponent; i++)
		*ret *= 10; /* at most 19 digits: input_number_read */
	return true;
}

/* Skips one separator. *kind is the separator of the line, 0 before the first one. NULL: it is of another kind. After the last
 * column a blank is accepted in any line. */
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

/* Skips a column that is not read, up to a separator. Separators within quotes do not count. */
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

/* Commas between whole numbers, some followed by a blank and some not: "1,5, 2,5, 3,5". */
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

/* Stands for a missing class or return: a number that neither can be. */
static const struct input_number no_number = {.mantissa = -1};

/* A column that does not begin with a number. A number in quotes is read. If there is no value, the line may be skipped. */
__attribute__((noinline, cold)) static int odd_column(struct input *in, struct input_line line, char kind, unsigned role,
						      enum input_number_state state, const char **at, struct input_number *ret,
						      struct err *err)
{
	const char *p = *at;

	if (p < line.end && *p == '"') {
		p = skip_blanks(p + 1, line.end);
		if (input_number_read(&p, line.end, ret) == INPUT_NUMBER_OK) {
			p = skip_blanks(p, line.end);
			if (p < line.end && *p == '"') {
				*at = p + 1;
				return 0;
			}
		}
	}
	if (input_line_may_lack(in, role)) {
		*at = skip_column(*at, line.end, kind);
		*ret = no_number;
		return 0;
	}
	input_wrong_number(in, err, state, line, *at);
	if (role > INPUT_Z)
		return input_wrong_attribute(in, err);
	if (state != INPUT_NUMBER_NOT_FINITE && !input_line_no_value(line, *at, kind))
		return -(int)err->code;
	return in->strict ? input_wrong_strict(err) : INPUT_E_LEFT_OUT;
}

/* A column that continues after its number without a separator: 1.#QNAN, or a class that is a text. *ret_next: the place after
 * the separator. */
__attribute__((noinline, cold)) static int odd_end(struct input *in, struct input_line line, char *kind, bool last, unsigned role,
						   const char *column, const char **ret_next, struct input_number *ret,
						   struct err *err)
{
	if (input_line_may_lack(in, role)) {
		*ret = no_number;
		*ret_next = separator(skip_column(column, line.end, *kind), line.end, last, kind);
		return *ret_next ? 0 : input_wrong_separator(in, err, line, column);
	}
	if (role < INPUT_ROLES && input_line_no_value(line, column, *kind))
		return odd_column(in, line, *kind, role, INPUT_NUMBER_NOT_FINITE, &column, ret, err);
	return input_wrong_separator(in, err, line, column);
}

int input_line_parse(struct input *in, struct input_line line, struct input_number ret[INPUT_ROLES], struct err *err)
{
	const struct input_columns *columns = &input_xyz_of(in)->columns;
	const char *p = skip_blanks(line.at, line.end);
	unsigned n = columns->n;
	char kind = 0;

	for (unsigned i = 0; i < n; i++) {
		const char *column = p;
		unsigned role = columns->role[i];

		if (role == INPUT_SKIPPED) {
			p = skip_column(p, line.end, kind);
		} else {
			enum input_number_state state = input_number_read(&p, line.end, &ret[role]);

			if (state != INPUT_NUMBER_OK) {
				int rc = odd_column(in, line, kind, role, state, &p, &ret[role], err);

				if (rc)
					return rc;
			}
		}
		if (p == line.end)
			continue;
		p = separator(p, line.end, i + 1 == n, &kind);
		if (!p) {
			int rc = odd_end(in, line, &kind, i + 1 == n, role, column, &p, &ret[role], err);

			if (rc)
				return rc;
		}
	}
	return kind == ',' && uneven_commas(line) ? input_wrong_commas(in, err, line) : 0;
}
