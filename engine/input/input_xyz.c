/*
 * Points as text: one a line, x y z in the first three columns.
 *
 * Model: the file is read twice. Opening reads all of it once, for the digits, the extent and the number
 * of points, and finds every bad line before a point is handed out; reading then turns each number into
 * a multiple of the unit that all numbers share. Both passes see lines through one window of the buffer.
 *
 * The unit is a power of ten, one for x and y, one for z: the last place written anywhere, zeros
 * included ("77.890" says millimetres); where that does not leave the extent within 2^31 units, the last
 * place that is not zero. A line has one kind of separator: spaces and tabs, or commas, or semicolons,
 * so that decimal commas are noticed. No units and no coordinate system are known.
 */
#include "input_parts.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "io.h"

enum { LINE_MAX_BYTES = 4096, EXCERPT = 40 };

struct line {
	const char *at, *end; /* without its line end */
};

static int bad_line(struct input *in, struct err *err, enum err_code code, const char *what, struct line text)
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

bool input_xyz_matches(const uint8_t *bytes, size_t n)
{
	for (size_t i = 0; i < n; i++)
		if (bytes[i] == 0x7f ||
		    (bytes[i] < 0x20 && bytes[i] != '\t' && bytes[i] != '\n' && bytes[i] != '\r'))
			return false;
	return true;
}

/* Moves what is left of the window to its front and reads on behind it. */
static int fill(struct input *in, struct err *err)
{
	struct input_xyz *xyz = &in->as.xyz;
	size_t kept = xyz->n_buffered - xyz->i_buffered, got;
	int rc;

	memmove(in->buffer, in->buffer + xyz->i_buffered, kept);
	rc = io_read_some(in->fd, in->buffer + kept, sizeof in->buffer - kept, xyz->at, in->name, &got, err);
	if (rc)
		return rc;
	xyz->ended = got < sizeof in->buffer - kept;
	xyz->at += got;
	in->bytes_read += got;
	xyz->i_buffered = 0;
	xyz->n_buffered = kept + got;
	return 0;
}

/* The next line; ret->at NULL at the end of the file. */
static int next_line(struct input *in, struct line *ret, struct err *err)
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
			continue;
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
			return bad_line(in, err, ERR_INPUT, "longer than 4096 bytes", *ret);
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

/* Steps over one separator; *kind is that of the line, 0 before the first. NULL if it is another one.
 * Behind the third number a blank is enough in any line. */
static const char *separator(const char *p, const char *end, bool third, char *kind)
{
	const char *after = skip_blanks(p, end);
	char found = after < end && (*after == ',' || *after == ';') ? *after : ' ';

	if (after == end || (third && found == ' ' && after > p))
		return after;
	if ((found == ' ' && after == p) || (*kind && *kind != found))
		return NULL;
	*kind = found;
	return found == ' ' ? after : skip_blanks(after + 1, end);
}

static int no_number(struct input *in, struct err *err, enum input_number_state state, struct line line,
		     const char *p, bool first)
{
	const struct line rest = { p, line.end };
	bool word = p < line.end && (((*p | 0x20) >= 'a' && (*p | 0x20) <= 'z') || *p == '"' || *p == '_');
	bool header = first && word &&
		      input_xyz_matches((const uint8_t *)line.at, (size_t)(line.end - line.at));

	if (state == INPUT_NUMBER_NOT_FINITE)
		return bad_line(in, err, ERR_INPUT, "not a finite number", rest);
	if (state == INPUT_NUMBER_TOO_LONG) {
		bad_line(in, err, ERR_INPUT, "more digits than can be kept exactly (18, down to 1e-15)", rest);
		return err_add_hint(err, "write the coordinates with the digits that were measured");
	}
	if (header) {
		bad_line(in, err, ERR_UNSUPPORTED, "a line of column names is not in this version", line);
		return err_add_hint(err, "put # before it, or take it out");
	}
	if (p == line.end) {
		bad_line(in, err, ERR_INPUT, "fewer than three columns", line);
		return err_add_hint(err, "every line needs x y z; comments begin with #, // or %%");
	}
	return bad_line(in, err, ERR_INPUT, "not a number", rest);
}

/* Three numbers. `first`: no point came before, so that words may be column names. */
static int parse_line(struct input *in, struct line line, bool first, struct input_number ret[3],
		      struct err *err)
{
	const char *p = skip_blanks(line.at, line.end);
	char kind = 0;

	for (int i = 0; i < 3; i++) {
		const char *number = p;
		enum input_number_state state = input_number_read(&p, line.end, &ret[i]);

		if (state != INPUT_NUMBER_OK)
			return no_number(in, err, state, line, number, first && i == 0);
		if (p == line.end)
			continue;
		p = separator(p, line.end, i == 2, &kind);
		if (!p) {
			bad_line(in, err, ERR_INPUT, "numbers that run together, or two kinds of separators",
				 line);
			return err_add_hint(err, "one separator a line; decimal points, not decimal commas");
		}
	}
	return 0;
}

static bool is_comment(struct line line)
{
	const char *p = skip_blanks(line.at, line.end);

	return p == line.end || *p == '#' || *p == '%' || (*p == '/' && p + 1 < line.end && p[1] == '/');
}

/* The next line with a point; ret->at NULL at the end of the file. */
static int next_point_line(struct input *in, struct line *ret, struct err *err)
{
	do {
		int rc = next_line(in, ret, err);

		if (rc)
			return rc;
		/* a line end of old Macs would hide every point but the first */
		if (ret->at && memchr(ret->at, '\r', (size_t)(ret->end - ret->at)))
			return bad_line(in, err, ERR_INPUT, "a carriage return inside of a line", *ret);
	} while (ret->at && is_comment(*ret));
	return 0;
}

struct probe {
	uint64_t points;
	struct {
		int written, needed;     /* places */
		uint64_t line;           /* of the first number that needs that place */
		double min, max;
	} axis[3];
};

static double number_double(struct input_number n)
{
	struct decimal d = { n.mantissa, n.exponent };

	return decimal_double(d);
}

/* Places from -15 to 0 and at most 18 digits: doubles below 2^53 divide exactly rounded; the rest, rare,
 * goes the exact way. */
static double coordinate(struct input_number n)
{
	static const double power[] = { 1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12,
					1e13, 1e14, 1e15 };
	int64_t m = n.mantissa;

	if (n.exponent <= 0 && m < (int64_t)1 << 53 && m > -((int64_t)1 << 53))
		return (double)m / power[-n.exponent];
	return number_double(n);
}

static int probe_text(struct input *in, struct probe *probe, struct err *err)
{
	struct input_number n[3];
	struct line line;
	int rc;

	for (int i = 0; i < 3; i++) {
		probe->axis[i].min = INFINITY;
		probe->axis[i].max = -INFINITY;
	}
	for (;;) {
		rc = next_point_line(in, &line, err);
		if (rc || !line.at)
			return rc;
		rc = parse_line(in, line, !probe->points, n, err);
		if (rc)
			return rc;
		for (int i = 0; i < 3; i++) {
			double v = coordinate(n[i]);

			if (n[i].written < probe->axis[i].written)
				probe->axis[i].written = n[i].written;
			if (n[i].exponent < probe->axis[i].needed) {
				probe->axis[i].needed = n[i].exponent;
				probe->axis[i].line = in->as.xyz.line;
			}
			if (v < probe->axis[i].min)
				probe->axis[i].min = v;
			if (v > probe->axis[i].max)
				probe->axis[i].max = v;
		}
		probe->points++;
	}
}

static double largest(const struct probe *probe, int axis)
{
	return fmax(fabs(probe->axis[axis].min), fabs(probe->axis[axis].max));
}

/* Raw numbers are int64; a margin for the division. */
static bool holds(const struct probe *probe, int axis, int place)
{
	return !probe->points || largest(probe, axis) / pow(10, place) < 4e18;
}

static bool comfortable(const struct probe *probe, int axis, int place)
{
	return place >= -15 && holds(probe, axis, place) &&
	       (!probe->points || (probe->axis[axis].max - probe->axis[axis].min) / pow(10, place) < 0x1p31);
}

static int choose_place(struct input *in, const struct probe *probe, int from, int to, int *ret,
			struct err *err)
{
	int written = 0, needed = 0, finest = from;
	bool fits = true;

	for (int i = from; i <= to; i++) {
		written = probe->axis[i].written < written ? probe->axis[i].written : written;
		if (probe->axis[i].needed < needed) {
			needed = probe->axis[i].needed;
			finest = i;
		}
	}
	for (int i = from; i <= to; i++) {
		fits &= comfortable(probe, i, written);
		if (holds(probe, i, needed))
			continue;
		input_fail(in, err, ERR_INPUT, probe->axis[finest].line, "line",
			   "line %" PRIu64 " has digits down to 1e%d, too fine for coordinates up to %g",
			   probe->axis[finest].line, needed, largest(probe, i));
		return err_add_hint(err, "write the coordinates with the digits that were measured");
	}
	*ret = fits ? written : needed;
	return 0;
}

static void rewind_text(struct input *in)
{
	struct input_xyz *xyz = &in->as.xyz;

	xyz->at = xyz->line = xyz->points = 0;
	xyz->i_buffered = xyz->n_buffered = 0;
	xyz->ended = false;
}

int input_xyz_open(struct input *in, struct err *err)
{
	struct input_xyz *xyz = &in->as.xyz;
	struct lattice_input *coords = &in->info.coords;
	struct probe probe = { 0 };
	int rc = probe_text(in, &probe, err);

	if (!rc)
		rc = choose_place(in, &probe, 0, 1, &xyz->exponent_xy, err);
	if (!rc)
		rc = choose_place(in, &probe, 2, 2, &xyz->exponent_z, err);
	if (rc)
		return rc;
	in->info.claimed = probe.points;
	crs_info_clear(&in->info.crs);
	snprintf(in->info.variant, sizeof in->info.variant, "text, %d and %d decimals", -xyz->exponent_xy,
		 -xyz->exponent_z);
	coords->has_offset = false;
	for (int i = 0; i < 3; i++) {
		coords->scale[i] = (struct decimal){ 1, i < 2 ? xyz->exponent_xy : xyz->exponent_z };
		coords->offset[i] = (struct decimal){ 0, 0 };
		coords->min[i] = probe.axis[i].min;
		coords->max[i] = probe.axis[i].max;
	}
	rewind_text(in);
	return 0;
}

/* False if the number is none of this unit: then the file is not the one that was probed. */
static bool raw_of(struct input_number n, int exponent, int64_t *ret)
{
	int64_t v = n.mantissa;

	if (!v) {
		*ret = 0;
		return true;
	}
	if (n.exponent < exponent || n.exponent - exponent > 18)
		return false;
	for (int i = exponent; i < n.exponent; i++)
		if (__builtin_mul_overflow(v, 10, &v))
			return false;
	*ret = v;
	return true;
}

static int changed(struct input *in, struct err *err)
{
	input_fail(in, err, ERR_CHANGED, in->as.xyz.line, "line", "the file changed while it was read");
	return err_add_hint(err, "wait until whoever writes it is done, then push it again");
}

int input_xyz_read(struct input *in, struct input_points *pts, struct err *err)
{
	struct input_xyz *xyz = &in->as.xyz;
	struct input_number n[3];
	struct line line = { .at = "" };
	int rc;

	while (pts->n < pts->cap && xyz->points < in->info.claimed) {
		rc = next_point_line(in, &line, err);
		if (!rc && !line.at)
			return changed(in, err);
		if (!rc)
			rc = parse_line(in, line, false, n, err);
		if (rc)
			return rc;
		for (int i = 0; i < 3; i++)
			if (!raw_of(n[i], i < 2 ? xyz->exponent_xy : xyz->exponent_z, &pts->raw[pts->n][i]))
				return changed(in, err);
		pts->cls[pts->n] = 0;
		pts->ret[pts->n] = 1 | 1 << 4; /* the only return */
		pts->flags[pts->n] = 0;
		pts->n++;
		xyz->points++;
	}
	if (xyz->points == in->info.claimed && !in->checked) {
		rc = input_check_unchanged(in, err);
		if (rc)
			return rc;
		in->checked = true;
	}
	return 0;
}
