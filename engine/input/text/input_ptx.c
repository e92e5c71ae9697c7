/*
 * PTX: one scan after the other. A scan is a head (input_ptx_head.c), then one line for each cell: x y z intensity and perhaps a
 * colour.
 *
 * Model: the file is read twice, as other texts are. Opening finds every bad line, the number of points, their box and the number
 * of cells without a return; reading returns the points. A cell of 0 0 0, or of nan, has no return. Cells are in nanometres and
 * matrices have 15 decimals; further digits are rounded. So a cell times its matrix is a sum of integers, rounded to the raw unit
 * of 0.1 mm, which is the same on every machine. PTX is in metres by its specification; its plane is not known.
 *
 * Not here: intensities, colours, the order of cells, reading from a pipe.
 */
#include "input_ptx.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "crs.h"

enum { RAW_PLACE = -4 };
static const int64_t cell_most = 1000000000000000; /* nanometres: a thousand kilometres from the scanner */

/* The next line of a text in memory that is not blank; false: there is none that is whole. */
static bool next_of(const char **at, const char *end, struct input_line *ret)
{
	const char *stop;

	for (; *at < end && (stop = memchr(*at, '\n', (size_t)(end - *at))); *at = stop + 1) {
		const char *p = *at;

		while (p < stop && (*p == ' ' || *p == '\t' || *p == '\r'))
			p++;
		if (p == stop)
			continue;
		*ret = (struct input_line){*at, stop[-1] == '\r' ? stop - 1 : stop};
		*at = stop + 1;
		return true;
	}
	return false;
}

/* The line has exactly that many numbers. */
static bool has_numbers(struct input_line line, unsigned n)
{
	const char *p = line.at;
	int64_t number;

	for (unsigned i = 0; i < n; i++)
		if (input_ptx_number(&p, line.end, 0, INT64_MAX / 16, &number) != INPUT_NUMBER_OK)
			return false;
	return p == line.end;
}

/* Two lines with one number each. In a .pts file points follow the first line, unless its number is 0; then the rest of the head
 * decides. */
static bool matches(const uint8_t *bytes, size_t n)
{
	const char *at = (const char *)bytes, *end = at + n;
	struct input_line line;
	uint64_t columns, rows;

	if (!input_text_is(bytes, n))
		return false;
	if (n >= 3 && !memcmp(at, "\xef\xbb\xbf", 3))
		at += 3;
	if (!next_of(&at, end, &line) || !input_line_is_count(line, &columns) || !next_of(&at, end, &line) ||
	    !input_line_is_count(line, &rows))
		return false;
	for (unsigned i = 0; !columns && i < 8; i++)
		if (!next_of(&at, end, &line) || !has_numbers(line, i < 4 ? 3 : 4))
			return false;
	return true;
}

/* The file, or a scan, ends before its cells do. With --accept-truncated the scan ends here. */
static int truncated(struct input *in, const char *where, struct err *err)
{
	struct input_ptx *ptx = input_ptx_of(in);
	uint64_t missing = ptx->left;

	ptx->left = 0;
	if (in->accept_truncated) {
		if (ptx->probing)
			input_warn(in,
				   "scan %" PRIu64 ", which begins in line %" PRIu64 ", has %" PRIu64
				   " cells fewer than its %" PRIu64 " times %" PRIu64,
				   ptx->scans, ptx->scan_line, missing, ptx->columns, ptx->rows);
		return 0;
	}
	input_fail(in, err, ERR_TRUNCATED, ptx->scan_line, "line",
		   "scan %" PRIu64 ", which begins in line %" PRIu64 ", says that it has %" PRIu64 " times %" PRIu64
		   " cells, but %" PRIu64 " of them are missing: %s",
		   ptx->scans, ptx->scan_line, ptx->columns, ptx->rows, missing, where);
	return err_add_hint(err, "copy it again, or take what is there with --accept-truncated");
}

/* *ret_more false: the file ends. */
static int next_scan(struct input *in, bool *ret_more, struct err *err)
{
	struct input_ptx *ptx = input_ptx_of(in);
	bool cut = false;
	int rc = input_ptx_head(in, ret_more, &cut, err);

	if (rc || !*ret_more || !cut)
		return rc;
	*ret_more = false;
	ptx->left = 0;
	if (in->accept_truncated && ptx->scans > 1) {
		ptx->scans--;
		if (ptx->probing)
			input_warn(in, "it ends within the head of a scan, which begins in line %" PRIu64, ptx->scan_line);
		return 0;
	}
	input_fail(in, err, ERR_TRUNCATED, ptx->text.line, "line",
		   "it ends within the head of scan %" PRIu64 ", which begins in line %" PRIu64, ptx->scans, ptx->scan_line);
	return err_add_hint(err,
			    ptx->scans > 1 ? "copy it again, or take what is there with --accept-truncated" : "copy it again");
}

static int bad_cell(struct input *in, enum input_number_state state, unsigned column, struct input_line line, struct err *err)
{
	if (state == INPUT_NUMBER_TOO_LONG) {
		input_bad_line(in, err, ERR_INPUT, "more than a thousand kilometres from the scanner", line);
		return err_add_hint(err, "PTX is in metres; export the scan again");
	}
	input_bad_line(in, err, ERR_INPUT, column < 3 ? "a cell needs x y z" : "not a number", line);
	return err_add_hint(err, "a line for each cell: x y z intensity, perhaps a colour");
}

/* x y z of a cell. *ret_cut: its line is not whole, so what stands last may be a part of a number. */
static int read_cell(struct input *in, struct input_line line, bool last, int64_t cell[3], bool *ret_empty, bool *ret_cut,
		     struct err *err)
{
	const char *p = line.at;

	*ret_empty = false;
	*ret_cut = false;
	for (unsigned i = 0; i < 3; i++) {
		enum input_number_state state = input_ptx_number(&p, line.end, INPUT_PTX_PLACES, cell_most, &cell[i]);

		*ret_cut = last && (p == line.end || state == INPUT_NUMBER_BAD);
		if (state == INPUT_NUMBER_NOT_FINITE) {
			*ret_empty = true;
			return 0;
		}
		if (state != INPUT_NUMBER_OK && !*ret_cut)
			return bad_cell(in, state, i, line, err);
		if (*ret_cut)
			return 0;
	}
	*ret_empty = !cell[0] && !cell[1] && !cell[2];
	return 0;
}

/* floor(v / 10^20 + 1/2): from 1e-24 m to 0.1 mm, as the lattice rounds. */
static int64_t to_raw(__int128 v)
{
	static const int64_t ten10 = 10000000000;
	__int128 d = (__int128)ten10 * ten10, up = v + d / 2, q = up / d;

	return (int64_t)(q - (up % d < 0));
}

static void transform(const struct input_ptx *ptx, const int64_t cell[3], int64_t raw[3])
{
	static const int64_t one = 1000000000000000; /* of the matrix */

	for (int i = 0; i < 3; i++) {
		__int128 sum = (__int128)ptx->shift[i] * one;

		for (int k = 0; k < 3; k++)
			sum += (__int128)cell[k] * ptx->turn[k][i];
		raw[i] = to_raw(sum);
	}
}

/* The next cell of the scan. *ret_point: it has a return, at `raw`. */
static int next_cell(struct input *in, int64_t raw[3], bool *ret_point, struct err *err)
{
	struct input_ptx *ptx = input_ptx_of(in);
	struct input_line line;
	bool last, empty, cut;
	int64_t cell[3];
	int rc = input_ptx_line(in, &line, &last, err);

	*ret_point = false;
	if (rc)
		return rc;
	if (!line.at)
		return truncated(in, "the file ends", err);
	if (input_line_is_count(line, &ptx->begun_columns) && !last) {
		char where[64];

		ptx->begun = true;
		ptx->begun_line = ptx->text.line;
		snprintf(where, sizeof where, "line %" PRIu64 " begins another scan", ptx->begun_line);
		return truncated(in, where, err);
	}
	rc = read_cell(in, line, last, cell, &empty, &cut, err);
	if (!rc && cut)
		return truncated(in, "the last line is not whole", err);
	if (rc)
		return rc;
	ptx->left--;
	ptx->cells++;
	ptx->empty += empty;
	*ret_point = !empty;
	if (!empty)
		transform(ptx, cell, raw);
	return 0;
}

/* The next point; *ret_point false: the file ends. */
static int next_point(struct input *in, int64_t raw[3], bool *ret_point, struct err *err)
{
	bool more = true;
	int rc = 0;

	*ret_point = false;
	while (!rc && more && !*ret_point) {
		if (input_ptx_of(in)->left)
			rc = next_cell(in, raw, ret_point, err);
		else
			rc = next_scan(in, &more, err);
	}
	return rc;
}

static void probe_begin(struct lattice_input *coords)
{
	coords->has_offset = false;
	for (int i = 0; i < 3; i++) {
		coords->scale[i] = (struct decimal){1, RAW_PLACE};
		coords->offset[i] = (struct decimal){0, 0};
		coords->min[i] = INFINITY;
		coords->max[i] = -INFINITY;
	}
}

static int probe(struct input *in, struct err *err)
{
	struct lattice_input *coords = &in->info.coords;
	bool point = true;
	int64_t raw[3];
	int rc;

	probe_begin(coords);
	for (;;) {
		rc = next_point(in, raw, &point, err);
		if (rc || !point)
			return rc;
		in->info.claimed++;
		for (int i = 0; i < 3; i++) {
			coords->min[i] = fmin(coords->min[i], (double)raw[i] / 1e4);
			coords->max[i] = fmax(coords->max[i], (double)raw[i] / 1e4);
		}
	}
}

/* Units are known, the plane is not. */
static void describe(struct input *in)
{
	const struct input_ptx *ptx = input_ptx_of(in);
	struct crs_info *crs = &in->info.crs;

	crs_info_clear(crs);
	snprintf(crs->unit_xy, sizeof crs->unit_xy, "metre");
	snprintf(crs->unit_z, sizeof crs->unit_z, "metre");
	crs_info_settle(crs);
	snprintf(in->info.variant, sizeof in->info.variant,
		 "PTX, %" PRIu64 " scan%s, %" PRIu64 " cells, %" PRIu64 " empty, to 0.1 mm", ptx->scans,
		 ptx->scans == 1 ? "" : "s", ptx->cells, ptx->empty);
}

static void rewind_scans(struct input *in)
{
	memset(input_ptx_of(in), 0, sizeof *input_ptx_of(in));
	input_line_rewind(in);
}

static int open_scans(struct input *in, struct err *err)
{
	int rc;

	rewind_scans(in);
	input_ptx_of(in)->probing = true;
	rc = probe(in, err);
	if (rc)
		return rc;
	if (!input_ptx_of(in)->scans) {
		input_fail(in, err, ERR_TRUNCATED, 0, NULL, "it is empty: a PTX file has the head of a scan at least");
		return err_add_hint(err, "copy it again");
	}
	describe(in);
	rewind_scans(in);
	return 0;
}

static int read_points(struct input *in, struct input_points *pts, struct err *err)
{
	struct input_xyz *text = &input_ptx_of(in)->text;
	bool point;

	while (pts->n < pts->cap && text->points < in->info.claimed) {
		int rc = next_point(in, pts->raw[pts->n], &point, err);

		if (rc)
			return rc;
		if (!point) {
			input_fail(in, err, ERR_CHANGED, text->line, "line", "the file changed while it was read");
			return err_add_hint(err, "wait until it is completely written, then push it again");
		}
		pts->cls[pts->n] = pts->flags[pts->n] = 0;
		pts->ret[pts->n++] = 0x11;
		text->points++;
	}
	if (text->points < in->info.claimed || in->checked)
		return 0;
	in->checked = true;
	return input_check_unchanged(in, err);
}

const struct input_reader input_ptx_reader = {
	.state_bytes = sizeof(struct input_ptx),
	.matches = matches,
	.open = open_scans,
	.read = read_points,
};
