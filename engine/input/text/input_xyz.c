/*
 * Points as text: one for each line, with x y z in the first three columns, or in those of --columns or of a line of names.
 *
 * Model: the file is read twice. Opening reads all of it, for the digits, the extent and the number of points, and finds every
 * bad line before a point is returned. Reading converts each number to a multiple of the unit that all numbers share
 * (input_place.c). Units and coordinate system are not known.
 *
 * .pts is the same with lines of one whole number, each saying how many points follow it.
 */
#include "input_text_parts.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

enum { RETURNS_MAX = 15, CLASS_MAX = 255 };

bool input_text_is(const uint8_t *bytes, size_t n)
{
	for (size_t i = 0; i < n; i++)
		if (bytes[i] == 0x7f || (bytes[i] < 0x20 && bytes[i] != '\t' && bytes[i] != '\n' && bytes[i] != '\r'))
			return false;
	return true;
}

/* The first line that is neither blank nor comment nor words is one whole number. */
static bool matches_pts(const uint8_t *bytes, size_t n)
{
	const char *at = (const char *)bytes, *end = at + n, *stop;
	uint64_t count;

	if (!input_text_is(bytes, n))
		return false;
	if (n >= 3 && !memcmp(at, "\xef\xbb\xbf", 3))
		at += 3;
	for (; at < end && (stop = memchr(at, '\n', (size_t)(end - at))); at = stop + 1) {
		struct input_line line = {at, stop > at && stop[-1] == '\r' ? stop - 1 : stop};

		if (!input_line_is_comment(line))
			return input_line_is_count(line, &count);
	}
	return false;
}

/* A whole number up to `most`. */
static bool is_small(struct input_number n, int most, uint8_t *ret)
{
	int64_t v = n.mantissa;

	for (int i = 0; i < n.exponent && v >= 0 && v <= most; i++)
		v *= 10;
	if (n.deep || n.exponent < 0 || v < 0 || v > most)
		return false;
	*ret = (uint8_t)v;
	return true;
}

/* If the value may be missing and is, *ret is not changed, and *lacks is set. */
static int attribute(struct input *in, struct input_line line, enum input_role role, const struct input_number *n, uint8_t *ret,
		     bool *lacks, struct err *err)
{
	static const struct {
		const char *what;
		int most;
	} roles[] = {
		[INPUT_CLASS] = {"class", CLASS_MAX},
		[INPUT_RETURN] = {"return", RETURNS_MAX},
		[INPUT_RETURNS] = {"number of returns", RETURNS_MAX},
	};
	char text[64];

	if (is_small(n[role], roles[role].most, ret))
		return 0;
	*lacks = true;
	if (input_line_may_lack(in, role))
		return 0;
	snprintf(text, sizeof text, "a %s that is no whole number from 0 to %d", roles[role].what, roles[role].most);
	input_bad_line(in, err, ERR_INPUT, text, line);
	return input_wrong_attribute(in, err);
}

/* Class and returns. Without columns for them: never classified, and the only return. */
static int attributes(struct input *in, struct input_line line, const struct input_number n[INPUT_ROLES], uint8_t *ret_class,
		      uint8_t *ret_return, struct err *err)
{
	struct input_xyz *xyz = input_xyz_of(in);
	uint8_t r = 1, count = 1;
	bool no_class = false, no_return = false;
	int rc = 0;

	*ret_class = 0;
	if (xyz->columns.cls)
		rc = attribute(in, line, INPUT_CLASS, n, ret_class, &no_class, err);
	if (!rc && xyz->columns.returns)
		rc = attribute(in, line, INPUT_RETURN, n, &r, &no_return, err);
	if (!rc && xyz->columns.returns)
		rc = attribute(in, line, INPUT_RETURNS, n, &count, &no_return, err);
	*ret_return = no_return ? 0x11 : (uint8_t)(r | count << 4);
	if (xyz->counting && (no_class || no_return) && !xyz->unread++)
		xyz->unread_line = xyz->line;
	return rc;
}

struct probe {
	uint64_t points;
	uint64_t count, count_line; /* .pts: points that the last such line says, and are yet to come */
	uint64_t more;              /* points that no such line counts */
	struct input_guess guess;
	struct err left_out; /* why the first line was, that was */
	struct input_extent axis[3];
};

static void probe_point(struct input *in, struct probe *probe, const struct input_number *n)
{
	input_extents_add(probe->axis, n, input_xyz_of(in)->line);
	probe->points++;
}

/* Points that a .pts file announces but does not have. */
static int check_count(struct input *in, const struct probe *probe, struct err *err)
{
	if (!probe->count)
		return 0;
	if (in->accept_truncated) {
		input_warn(in, "%" PRIu64 " %s fewer than line %" PRIu64 " says", probe->count,
			   probe->count == 1 ? "point" : "points", probe->count_line);
		return 0;
	}
	input_fail(in, err, ERR_TRUNCATED, probe->count_line, "line",
		   "line %" PRIu64 " says how many points follow, but %" PRIu64 " of them are missing", probe->count_line,
		   probe->count);
	return err_add_hint(err, "copy it again, or take what is there with --accept-truncated");
}

/* A line of .pts with one number; false: it is none. */
static bool take_count(struct input *in, struct input_line line, struct probe *probe, int *rc, struct err *err)
{
	uint64_t count;

	if (!input_xyz_of(in)->counts || !input_line_is_count(line, &count))
		return false;
	*rc = check_count(in, probe, err);
	probe->count = count;
	probe->count_line = input_xyz_of(in)->line;
	return true;
}

/* Counts a line without a value for a coordinate. Takes `why`. */
static void leave_out(struct input *in, struct err *why)
{
	if (!in->info.left_out++)
		in->info.left_out_line = input_xyz_of(in)->line;
	err_clear(why);
}

enum { MANY_PERCENT = 5 };

/* Called when all was read. If no point is left, the first skipped line is the error. For a pipe it is not kept (NULL). */
static int check_left_out(struct input *in, uint64_t points, const struct err *first, struct err *err)
{
	uint64_t n = in->info.left_out;
	unsigned percent = n ? (unsigned)(100.0 * (double)n / (double)(n + points)) : 0;

	if (n && !points && first) {
		*err = *first;
		return -(int)err->code;
	}
	if (n && !points) {
		input_fail(in, err, ERR_INPUT, in->info.left_out_line, "line",
			   "no line has a value for each coordinate, from line %" PRIu64 " on", in->info.left_out_line);
		return err_add_hint(err, "say with --columns which columns are x, y and z");
	}
	if (percent >= MANY_PERCENT)
		input_warn(in,
			   "%u %% of its lines, %" PRIu64
			   ", have no value for a coordinate and are left out, the first is line %" PRIu64
			   ": are x, y and z other columns (--columns)?",
			   percent, n, in->info.left_out_line);
	else if (n)
		input_warn(in, "%" PRIu64 " %s no value for a coordinate and %s left out, the first is line %" PRIu64, n,
			   n == 1 ? "line has" : "lines have", n == 1 ? "is" : "are", in->info.left_out_line);
	return 0;
}

/* Warnings and errors by the counts, after all was read. `first_left_out`: as for check_left_out. */
static int check_odd(struct input *in, uint64_t points, const struct err *first_left_out, struct err *err)
{
	const struct input_xyz *xyz = input_xyz_of(in);
	int rc = check_left_out(in, points, first_left_out, err);

	if (!rc)
		rc = input_comment_judge(in, points, err);
	if (!rc && xyz->unread)
		input_warn(in,
			   "%" PRIu64 " %s no whole number as class or return, the first is line %" PRIu64
			   ": never classified, the only return",
			   xyz->unread, xyz->unread == 1 ? "line has" : "lines have", xyz->unread_line);
	return rc;
}

static void probe_begin(struct input *in, struct probe *probe)
{
	input_guess_begin(in, &probe->guess);
	input_extents_begin(probe->axis);
}

static int probe_text(struct input *in, struct probe *probe, struct err *err)
{
	struct input_xyz *xyz = input_xyz_of(in);
	struct input_number n[INPUT_ROLES];
	uint8_t cls, ret;
	struct input_line line;
	int rc;

	probe_begin(in, probe);
	xyz->counting = true;
	for (;;) {
		rc = input_line_next_point(in, &line, err);
		if (rc)
			return rc;
		if (!line.at) {
			xyz->counting = false;
			rc = check_odd(in, probe->points, &probe->left_out, err);
			if (!rc)
				rc = check_count(in, probe, err);
			return rc ? rc : input_guess_judge(in, &probe->guess, probe->axis, err);
		}
		if (take_count(in, line, probe, &rc, err)) {
			if (rc)
				return rc;
			continue;
		}
		rc = input_line_parse(in, line, n, err);
		if (!rc)
			rc = attributes(in, line, n, &cls, &ret, err);
		if (rc < 0)
			return rc;
		if (rc) {
			if (!in->info.left_out)
				probe->left_out = *err;
			leave_out(in, err);
		} else {
			probe_point(in, probe, n);
			input_guess_row(in, &probe->guess, line);
		}
		if (probe->count)
			probe->count--;
		else
			probe->more++;
	}
}

/* The number of decimals: the significant ones, or, if they are rounded, all that are written. */
static unsigned decimals(const struct input *in, const struct probe *probe, unsigned from, unsigned to)
{
	const struct input_place *unit = &input_xyz_of(in)->place[from / 2];
	int place = 0;

	if (unit->rounding == INPUT_EXACT)
		return (unsigned)-unit->scale.exponent;
	for (unsigned i = from; i <= to; i++)
		place = probe->axis[i].written < place ? probe->axis[i].written : place;
	return (unsigned)-place;
}

static void describe(struct input *in, const struct probe *probe)
{
	struct input_xyz *xyz = input_xyz_of(in);
	char columns[INPUT_COLUMNS + 1];
	size_t n = 0;

	for (; n < xyz->columns.n; n++)
		columns[n] = "xyzcrn_"[xyz->columns.role[n]];
	columns[n] = 0;
	in->info.no_classes = !xyz->columns.cls;
	snprintf(in->info.variant, sizeof in->info.variant, "text%s%.16s, %u and %u decimals",
		 strcmp(columns, "xyz") ? ", columns " : "", strcmp(columns, "xyz") ? columns : "", decimals(in, probe, 0, 1),
		 decimals(in, probe, 2, 2));
	if (xyz->counts && probe->more)
		input_warn(in, "%" PRIu64 " %s more than its lines of numbers say", probe->more,
			   probe->more == 1 ? "point" : "points");
	if (xyz->commas >= 6 && !probe->axis[0].written && !probe->axis[1].written && !probe->axis[2].written &&
	    !strcmp(columns, "xyz"))
		input_warn(
			in,
			"whole numbers between commas, %u columns: with decimal commas it would be read wrongly (--decimal-comma)",
			xyz->commas);
}

/* The box of the first points of a pipe. Later points outside of it can only lead to an error. The last line may be incomplete,
 * so it is not used. */
static int probe_head(struct input *in, struct probe *probe, struct err *err)
{
	struct input_xyz *xyz = input_xyz_of(in);
	struct input_number n[INPUT_ROLES];
	struct input_line line;
	int rc;

	probe_begin(in, probe);
	for (;;) {
		rc = input_line_next_point(in, &line, err);
		if (rc)
			return rc;
		if (!line.at || line.end == (const char *)in->buffer + xyz->n_buffered)
			return input_guess_judge(in, &probe->guess, probe->axis, err);
		rc = input_line_parse(in, line, n, err);
		if (rc < 0)
			return rc;
		if (rc) { /* counted when it is read */
			err_clear(err);
			continue;
		}
		probe_point(in, probe, n);
		input_guess_row(in, &probe->guess, line);
	}
}

/* A text that comes through a pipe is read once, so its digits are not known. The lattice must be known otherwise. */
static int open_forward(struct input *in, struct err *err)
{
	struct input_xyz *xyz = input_xyz_of(in);
	struct probe probe = {0};
	int rc;

	xyz->head_only = true;
	rc = input_columns_look(in, err);
	if (!rc)
		rc = probe_head(in, &probe, err);
	xyz->head_only = false;
	xyz->begun = false;
	xyz->counting = true;
	if (!rc)
		rc = input_places_forward(in, probe.axis, err);
	if (rc)
		return rc;
	describe(in, &probe);
	snprintf(in->info.variant, sizeof in->info.variant, "text, from a pipe");
	input_line_rewind(in);
	return 0;
}

static int open_text(struct input *in, struct err *err)
{
	struct probe probe = {0};
	int rc;

	if (in->has_pipe)
		return open_forward(in, err);
	rc = input_columns_look(in, err);
	if (!rc)
		rc = probe_text(in, &probe, err);
	if (!rc)
		rc = input_places_choose(in, probe.axis, err);
	if (rc)
		return rc;
	in->info.claimed = probe.points;
	describe(in, &probe);
	input_line_rewind(in);
	return 0;
}

static int open_pts(struct input *in, struct err *err)
{
	input_xyz_of(in)->counts = true;
	return open_text(in, err);
}

/* The error for a line that does not fit the probe: the file has changed. */
static int changed(struct input *in, struct err *err)
{
	if (in->has_pipe) {
		input_fail(in, err, ERR_INPUT, input_xyz_of(in)->line, "line",
			   "line %" PRIu64
			   " has a number that is too large, or more than nine decimals and no lattice to round it to",
			   input_xyz_of(in)->line);
		return err_add_hint(err,
				    "mend the line, or write it to a file first: its digits are looked at before it is read");
	}
	input_fail(in, err, ERR_CHANGED, input_xyz_of(in)->line, "line", "the file changed while it was read");
	return err_add_hint(err, "wait until it is completely written, then push it again");
}

/* The kind of the next line. LINE_OTHER: the number of points of a .pts file, or a line that is skipped. LINE_NONE: a pipe has
 * ended, or has no bytes now. */
enum line_kind { LINE_POINT, LINE_OTHER, LINE_NONE };

static int read_point(struct input *in, struct input_points *pts, enum line_kind *ret, struct err *err)
{
	struct input_xyz *xyz = input_xyz_of(in);
	struct input_number n[INPUT_ROLES];
	struct input_line line = {.at = ""};
	uint64_t count;
	int rc = input_line_next_point(in, &line, err);

	*ret = LINE_NONE;
	if (!rc && !line.at && in->has_pipe)
		return 0;
	if (!rc && !line.at)
		return changed(in, err);
	*ret = LINE_OTHER;
	if (rc || (xyz->counts && input_line_is_count(line, &count)))
		return rc;
	rc = input_line_parse(in, line, n, err);
	if (rc == INPUT_E_LEFT_OUT && in->has_pipe)
		leave_out(in, err);
	else if (rc > 0)
		err_clear(err); /* counted when it was opened */
	if (rc)
		return rc < 0 ? rc : 0;
	rc = attributes(in, line, n, &pts->cls[pts->n], &pts->ret[pts->n], err);
	if (rc)
		return rc;
	for (int i = 0; i < 3; i++)
		if (!input_place_raw(&xyz->place[i / 2], &n[i], &pts->raw[pts->n][i]))
			return changed(in, err);
	pts->flags[pts->n] = 0;
	*ret = LINE_POINT;
	return 0;
}

/* The most lines without a value in one call, so that a pipe that sends only such lines can be cancelled. */
enum { LINES_A_TURN = 1 << 16 };

static int read_forward(struct input *in, struct input_points *pts, struct err *err)
{
	unsigned left_out = 0;

	while (pts->n < pts->cap && !in->checked) {
		enum line_kind kind;
		int rc = read_point(in, pts, &kind, err);

		if (rc)
			return rc;
		pts->n += kind == LINE_POINT;
		input_xyz_of(in)->points += kind == LINE_POINT;
		if (kind == LINE_NONE && in->dry)
			return 0;
		if (kind == LINE_OTHER && ++left_out == LINES_A_TURN) {
			in->dry = true;
			return 0;
		}
		in->checked = kind == LINE_NONE;
	}
	return in->checked && !pts->n ? check_odd(in, input_xyz_of(in)->points, NULL, err) : 0;
}

static int read_points(struct input *in, struct input_points *pts, struct err *err)
{
	struct input_xyz *xyz = input_xyz_of(in);

	if (in->has_pipe)
		return read_forward(in, pts, err);

	while (pts->n < pts->cap && xyz->points < in->info.claimed) {
		enum line_kind kind;
		int rc = read_point(in, pts, &kind, err);

		if (rc)
			return rc;
		pts->n += kind == LINE_POINT;
		xyz->points += kind == LINE_POINT;
	}
	if (xyz->points == in->info.claimed && !in->checked) {
		int rc = input_check_unchanged(in, err);

		if (rc)
			return rc;
		in->checked = true;
	}
	return 0;
}

const struct input_reader input_xyz_reader = {
	.state_bytes = sizeof(struct input_xyz),
	.forwards = true,
	.plain_text = true,
	.matches = input_text_is,
	.open = open_text,
	.read = read_points,
};

const struct input_reader input_pts_reader = {
	.state_bytes = sizeof(struct input_xyz),
	.plain_text = true,
	.matches = matches_pts,
	.open = open_pts,
	.read = read_points,
};
