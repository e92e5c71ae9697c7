/*
 * Points as text: one a line, x y z in the first three columns or where --columns or a line of names says.
 *
 * Model: the file is read twice. Opening reads all of it once, for the digits, the extent and the number
 * of points, and finds every bad line before a point is handed out; reading then turns each number into
 * a multiple of the unit that all numbers share.
 *
 * The unit is a power of ten, one for x and y, one for z: the last place written anywhere, zeros
 * included ("77.890" says millimetres); where that does not leave the extent within 2^31 units, the last
 * place that is not zero. No units and no coordinate system are known.
 *
 * .pts is the same with lines of one whole number, each saying how many points follow it.
 */
#include "input_text.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { RETURNS_MAX = 15, CLASS_MAX = 255, FORWARD_PLACE = -9 };

bool input_xyz_matches(const uint8_t *bytes, size_t n)
{
	for (size_t i = 0; i < n; i++)
		if (bytes[i] == 0x7f || (bytes[i] < 0x20 && bytes[i] != '\t' && bytes[i] != '\n' && bytes[i] != '\r'))
			return false;
	return true;
}

/* The first line that is neither blank nor comment nor words is one whole number. */
bool input_pts_matches(const uint8_t *bytes, size_t n)
{
	const char *at = (const char *)bytes, *end = at + n, *stop;
	uint64_t count;

	if (!input_xyz_matches(bytes, n))
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

/* One small whole number of a column. */
static int small(struct input *in, struct input_line line, const char *what, struct input_number n, int most, uint8_t *ret,
		 struct err *err)
{
	int64_t v = n.mantissa;
	char text[64];

	for (int i = 0; i < n.exponent && v >= 0 && v <= most; i++)
		v *= 10;
	if (n.exponent < 0 || v < 0 || v > most) {
		snprintf(text, sizeof text, "a %s that is no whole number from 0 to %d", what, most);
		return input_bad_line(in, err, ERR_INPUT, text, line);
	}
	*ret = (uint8_t)v;
	return 0;
}

/* Class and returns, where there are columns of them; else never classified, the only return. */
static int attributes(struct input *in, struct input_line line, const struct input_number n[INPUT_ROLES], uint8_t *ret_class,
		      uint8_t *ret_return, struct err *err)
{
	const struct input_columns *c = &in->as.xyz.columns;
	uint8_t r = 1, count = 1;
	int rc = 0;

	*ret_class = 0;
	if (c->cls)
		rc = small(in, line, "class", n[INPUT_CLASS], CLASS_MAX, ret_class, err);
	if (!rc && c->returns)
		rc = small(in, line, "return", n[INPUT_RETURN], RETURNS_MAX, &r, err);
	if (!rc && c->returns)
		rc = small(in, line, "number of returns", n[INPUT_RETURNS], RETURNS_MAX, &count, err);
	*ret_return = (uint8_t)(r | count << 4);
	return rc;
}

struct probe {
	uint64_t points;
	uint64_t count, count_line; /* .pts: points that the last such line says, and are yet to come */
	uint64_t more;              /* points that none says */
	struct {
		int written, needed; /* places */
		uint64_t line;       /* of the first number that needs that place */
		double min, max;
	} axis[3];
};

static double number_double(struct input_number n)
{
	struct decimal d = {n.mantissa, n.exponent};

	return decimal_double(d);
}

/* Places from -15 to 0 and at most 18 digits: doubles below 2^53 divide exactly rounded; the rest, rare,
 * goes the exact way. */
static double coordinate(struct input_number n)
{
	static const double power[] = {1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15};
	int64_t m = n.mantissa;

	if (n.exponent <= 0 && m < (int64_t)1 << 53 && m > -((int64_t)1 << 53))
		return (double)m / power[-n.exponent];
	return number_double(n);
}

static void probe_point(struct input *in, struct probe *probe, const struct input_number *n)
{
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

/* Points that a .pts file promised and that are not there. */
static int check_count(struct input *in, const struct probe *probe, struct err *err)
{
	if (!probe->count)
		return 0;
	if (in->accept_truncated) {
		input_warn(in, "%" PRIu64 " points fewer than line %" PRIu64 " says", probe->count, probe->count_line);
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

	if (!in->as.xyz.counts || !input_line_is_count(line, &count))
		return false;
	*rc = check_count(in, probe, err);
	probe->count = count;
	probe->count_line = in->as.xyz.line;
	return true;
}

static int probe_text(struct input *in, struct probe *probe, struct err *err)
{
	struct input_number n[INPUT_ROLES];
	uint8_t cls, ret;
	struct input_line line;
	int rc;

	for (int i = 0; i < 3; i++) {
		probe->axis[i].min = INFINITY;
		probe->axis[i].max = -INFINITY;
	}
	for (;;) {
		rc = input_line_next_point(in, &line, err);
		if (rc)
			return rc;
		if (!line.at)
			return check_count(in, probe, err);
		if (take_count(in, line, probe, &rc, err)) {
			if (rc)
				return rc;
			continue;
		}
		rc = input_line_parse(in, line, n, err);
		if (!rc)
			rc = attributes(in, line, n, &cls, &ret, err);
		if (rc)
			return rc;
		probe_point(in, probe, n);
		if (probe->count)
			probe->count--;
		else
			probe->more++;
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

static int choose_place(struct input *in, const struct probe *probe, int from, int to, int *ret, struct err *err)
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

static void describe(struct input *in, const struct probe *probe)
{
	struct input_xyz *xyz = &in->as.xyz;
	char columns[INPUT_COLUMNS + 1];
	size_t n = 0;

	for (; n < xyz->columns.n; n++)
		columns[n] = "xyzcrn_"[xyz->columns.role[n]];
	columns[n] = 0;
	snprintf(in->info.variant, sizeof in->info.variant, "text%s%.16s, %u and %u decimals",
		 strcmp(columns, "xyz") ? ", columns " : "", strcmp(columns, "xyz") ? columns : "", (uint8_t)-xyz->exponent_xy,
		 (uint8_t)-xyz->exponent_z);
	if (xyz->counts && probe->more)
		input_warn(in, "%" PRIu64 " points more than its lines of numbers say", probe->more);
	if (xyz->commas >= 6 && !probe->axis[0].written && !probe->axis[1].written && !probe->axis[2].written &&
	    !strcmp(columns, "xyz"))
		input_warn(in, "whole numbers between commas, %u columns: with decimal commas it would be read wrongly",
			   xyz->commas);
}

/* The first points of a pipe, for the box: what is not known of the rest can only lead to a refusal. The last
 * line may be cut, so it does not count. */
static int probe_head(struct input *in, struct probe *probe, struct err *err)
{
	struct input_xyz *xyz = &in->as.xyz;
	struct input_number n[INPUT_ROLES];
	struct input_line line;
	int rc;

	for (int i = 0; i < 3; i++) {
		probe->axis[i].min = INFINITY;
		probe->axis[i].max = -INFINITY;
	}
	for (;;) {
		rc = input_line_next_point(in, &line, err);
		if (rc || !line.at || line.end == (const char *)in->buffer + xyz->n_buffered)
			return rc;
		rc = input_line_parse(in, line, n, err);
		if (rc)
			return rc;
		probe_point(in, probe, n);
	}
}

/* A text that comes through a pipe is read once, so its digits are not known: nine decimals, for all. The
 * lattice must be known otherwise. */
static int open_forward(struct input *in, struct err *err)
{
	struct input_xyz *xyz = &in->as.xyz;
	struct lattice_input *coords = &in->info.coords;
	struct probe probe = {0};
	int rc;

	xyz->head_only = true;
	rc = input_columns_look(in, err);
	if (!rc)
		rc = probe_head(in, &probe, err);
	xyz->head_only = false;
	if (rc)
		return rc;
	xyz->exponent_xy = xyz->exponent_z = FORWARD_PLACE;
	crs_info_clear(&in->info.crs);
	for (int i = 0; i < 3; i++) {
		coords->scale[i] = (struct decimal){1, FORWARD_PLACE};
		coords->offset[i] = (struct decimal){0, 0};
		coords->min[i] = probe.axis[i].min;
		coords->max[i] = probe.axis[i].max;
	}
	describe(in, &probe);
	snprintf(in->info.variant, sizeof in->info.variant, "text, from a pipe");
	input_line_rewind(in);
	return 0;
}

int input_xyz_open(struct input *in, struct err *err)
{
	struct input_xyz *xyz = &in->as.xyz;
	struct lattice_input *coords = &in->info.coords;
	struct probe probe = {0};
	int rc;

	xyz->counts = in->row->matches == input_pts_matches;
	if (in->has_pipe)
		return open_forward(in, err);
	rc = input_columns_look(in, err);
	if (!rc)
		rc = probe_text(in, &probe, err);
	if (!rc)
		rc = choose_place(in, &probe, 0, 1, &xyz->exponent_xy, err);
	if (!rc)
		rc = choose_place(in, &probe, 2, 2, &xyz->exponent_z, err);
	if (rc)
		return rc;
	in->info.claimed = probe.points;
	crs_info_clear(&in->info.crs);
	coords->has_offset = false;
	for (int i = 0; i < 3; i++) {
		coords->scale[i] = (struct decimal){1, i < 2 ? xyz->exponent_xy : xyz->exponent_z};
		coords->offset[i] = (struct decimal){0, 0};
		coords->min[i] = probe.axis[i].min;
		coords->max[i] = probe.axis[i].max;
	}
	describe(in, &probe);
	input_line_rewind(in);
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

/* Of a file: it is not the one that was probed. */
static int changed(struct input *in, struct err *err)
{
	if (in->has_pipe) {
		input_fail(in, err, ERR_INPUT, in->as.xyz.line, "line",
			   "line %" PRIu64 " has more than nine decimals, or a number too large for them", in->as.xyz.line);
		return err_add_hint(err, "write it to a file first: its digits are looked at before it is read");
	}
	input_fail(in, err, ERR_CHANGED, in->as.xyz.line, "line", "the file changed while it was read");
	return err_add_hint(err, "wait until whoever writes it is done, then push it again");
}

/* One point; *ret_counted: it was no point but a line of .pts with their number, or of a pipe its end, or there
 * is nothing now. */
static int read_point(struct input *in, struct input_points *pts, bool *ret_counted, struct err *err)
{
	struct input_xyz *xyz = &in->as.xyz;
	struct input_number n[INPUT_ROLES];
	struct input_line line = {.at = ""};
	uint64_t count;
	int rc = input_line_next_point(in, &line, err);

	if (!rc && !line.at && in->has_pipe) {
		*ret_counted = true;
		in->checked = !in->dry;
		return 0;
	}
	if (!rc && !line.at)
		return changed(in, err);
	*ret_counted = !rc && xyz->counts && input_line_is_count(line, &count);
	if (rc || *ret_counted)
		return rc;
	rc = input_line_parse(in, line, n, err);
	if (!rc)
		rc = attributes(in, line, n, &pts->cls[pts->n], &pts->ret[pts->n], err);
	if (rc)
		return rc;
	for (int i = 0; i < 3; i++)
		if (!raw_of(n[i], i < 2 ? xyz->exponent_xy : xyz->exponent_z, &pts->raw[pts->n][i]))
			return changed(in, err);
	pts->flags[pts->n] = 0;
	return 0;
}

static int read_forward(struct input *in, struct input_points *pts, struct err *err)
{
	bool none = false;

	while (pts->n < pts->cap && !in->checked && !none) {
		int rc = read_point(in, pts, &none, err);

		if (rc)
			return rc;
		pts->n += !none;
	}
	return 0;
}

int input_xyz_read(struct input *in, struct input_points *pts, struct err *err)
{
	struct input_xyz *xyz = &in->as.xyz;
	bool counted = false;

	if (in->has_pipe)
		return read_forward(in, pts, err);

	while (pts->n < pts->cap && xyz->points < in->info.claimed) {
		int rc = read_point(in, pts, &counted, err);

		if (rc)
			return rc;
		pts->n += !counted;
		xyz->points += !counted;
	}
	if (xyz->points == in->info.claimed && !in->checked) {
		int rc = input_check_unchanged(in, err);

		if (rc)
			return rc;
		in->checked = true;
	}
	return 0;
}
