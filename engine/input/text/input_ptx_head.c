/*
 * The head of a scan of a PTX file: ten lines in front of its cells.
 *
 *   columns
 *   rows
 *   position of the scanner, and its axes: 4 lines of 3 numbers
 *   matrix from the scanner's system to that of the file: 4 lines of 4 numbers, for row vectors (the last row moves)
 *
 * Model: the matrix alone says where the points lie; position and axes repeat it, need to be numbers, and are not used. It has to
 * turn and move and nothing else: a scale of some per mille (grid scale factors) passes, a mirror or a plane does not. Its
 * numbers are kept as integers, so that cells are transformed exactly.
 */
#include "input_ptx.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { THREE = 4, FOUR = 4 };
static const int64_t turn_most = 2000000000000000;     /* 2 */
static const int64_t shift_most = 1000000000000000000; /* a million kilometres */
static const double rigid = 2e-3;
static const char last_column[] = "the last column of the matrix is not 0 0 0 1";

static const char *skip_blanks(const char *p, const char *end)
{
	while (p < end && (*p == ' ' || *p == '\t'))
		p++;
	return p;
}

int input_ptx_line(struct input *in, struct input_line *ret, bool *ret_cut, struct err *err)
{
	const struct input_xyz *text = &input_ptx_of(in)->text;
	int rc;

	do {
		rc = input_line_next(in, ret, err);
	} while (!rc && ret->at && skip_blanks(ret->at, ret->end) == ret->end);
	*ret_cut = !rc && ret->at && text->ended && ret->end == (const char *)in->buffer + text->n_buffered;
	return rc;
}

enum input_number_state input_ptx_number(const char **at, const char *end, int places, int64_t most, int64_t *ret)
{
	const char *p = skip_blanks(*at, end), *behind;
	enum input_number_state state = input_fixed_read(&p, end, places, most, ret);

	*at = p;
	if (state != INPUT_NUMBER_OK)
		return state;
	behind = skip_blanks(p, end);
	if (behind < end && *behind == ',')
		behind++;
	*at = behind;
	return behind == end || behind > p ? INPUT_NUMBER_OK : INPUT_NUMBER_BAD;
}

static int bad_head(struct input *in, struct err *err, struct input_line line, const char *what)
{
	char text[128];

	snprintf(text, sizeof text, "the head of scan %" PRIu64 ": %s", input_ptx_of(in)->scans, what);
	input_bad_line(in, err, ERR_INPUT, text, line);
	return err_add_hint(
		err, "the head of a scan is columns, rows, 4 lines of 3 numbers and 4 lines of 4 numbers; export it again");
}

/* All numbers of a line of `n` of them. The places of the matrix: `most` is what a number may have. */
static int read_row(struct input *in, struct input_line line, unsigned n, int places, int64_t most, int64_t *ret, struct err *err)
{
	const char *p = line.at;
	char what[48];

	snprintf(what, sizeof what, "%u numbers are wanted in this line", n);
	for (unsigned i = 0; i < n; i++) {
		enum input_number_state state = input_ptx_number(&p, line.end, places, most, &ret[i]);

		if (state == INPUT_NUMBER_NOT_FINITE)
			return bad_head(in, err, line, "a number that is not finite");
		if (state == INPUT_NUMBER_TOO_LONG)
			return bad_head(in, err, line, i < FOUR - 1 ? "a number that is too large" : last_column);
		if (state != INPUT_NUMBER_OK)
			return bad_head(in, err, line, what);
	}
	return p == line.end ? 0 : bad_head(in, err, line, what);
}

/* A row of the matrix: three numbers, then 0, or 1 in the last row. */
static int read_matrix_row(struct input *in, struct input_line line, unsigned row, struct err *err)
{
	static const int64_t one = 1000000000; /* nanometres */
	struct input_ptx *ptx = input_ptx_of(in);
	bool moves = row == FOUR - 1;
	int64_t number[FOUR];
	int rc = read_row(in, line, FOUR, moves ? INPUT_PTX_PLACES : INPUT_PTX_MATRIX_PLACES, moves ? shift_most : turn_most,
			  number, err);

	if (rc)
		return rc;
	if (number[3] != (moves ? one : 0))
		return bad_head(in, err, line, last_column);
	memcpy(moves ? ptx->shift : ptx->turn[row], number, sizeof ptx->shift);
	return 0;
}

static double dot(const double a[3], const double b[3])
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static int check_matrix(struct input *in, struct input_line line, struct err *err)
{
	double m[3][3], cross[3];

	for (int i = 0; i < 3; i++)
		for (int k = 0; k < 3; k++)
			m[i][k] = (double)input_ptx_of(in)->turn[i][k] / 1e15;
	for (int i = 0; i < 3; i++)
		for (int k = 0; k <= i; k++)
			if (fabs(dot(m[i], m[k]) - (i == k)) > rigid)
				return bad_head(in, err, line,
						"the matrix that ends here distorts, it does not only turn and move");
	for (int i = 0; i < 3; i++)
		cross[i] = m[1][(i + 1) % 3] * m[2][(i + 2) % 3] - m[1][(i + 2) % 3] * m[2][(i + 1) % 3];
	return dot(m[0], cross) > 0 ?
		       0 :
		       bad_head(in, err, line, "the matrix that ends here mirrors, it does not only turn and move");
}

/* The next line of a head. *ret_cut: the file ends in it. */
static int head_line(struct input *in, struct input_line *ret, bool *ret_cut, struct err *err)
{
	int rc = input_ptx_line(in, ret, ret_cut, err);

	*ret_cut |= !rc && !ret->at;
	return rc;
}

static int read_counts(struct input *in, bool *ret_more, bool *ret_cut, struct err *err)
{
	struct input_ptx *ptx = input_ptx_of(in);
	struct input_line line;
	int rc;

	if (!ptx->begun) {
		rc = input_ptx_line(in, &line, ret_cut, err);
		*ret_more = !rc && line.at;
		if (!*ret_more)
			return rc;
		ptx->begun_line = ptx->text.line;
	}
	*ret_more = true;
	ptx->scans++;
	if (!ptx->begun && !*ret_cut && !input_line_is_count(line, &ptx->begun_columns))
		return ptx->scans == 1 ?
			       bad_head(in, err, line, "the number of columns is wanted here") :
			       bad_head(in, err, line, "the scan before has all of its cells, and this is no number of columns");
	ptx->begun = false;
	ptx->scan_line = ptx->begun_line;
	ptx->columns = ptx->begun_columns;
	rc = *ret_cut ? 0 : head_line(in, &line, ret_cut, err);
	if (rc || *ret_cut)
		return rc;
	if (!input_line_is_count(line, &ptx->rows))
		return bad_head(in, err, line, "the number of rows is wanted here");
	if (__builtin_mul_overflow(ptx->columns, ptx->rows, &ptx->left) || ptx->left > INT64_MAX)
		return bad_head(in, err, line, "columns times rows is more than any file has");
	return 0;
}

int input_ptx_head(struct input *in, bool *ret_more, bool *ret_cut, struct err *err)
{
	struct input_line line;
	int64_t unused[3];
	int rc = read_counts(in, ret_more, ret_cut, err);

	for (unsigned i = 0; !rc && *ret_more && !*ret_cut && i < THREE + FOUR; i++) {
		rc = head_line(in, &line, ret_cut, err);
		if (!rc && !*ret_cut)
			rc = i < THREE ? read_row(in, line, 3, INPUT_PTX_PLACES, shift_most, unused, err) :
					 read_matrix_row(in, line, i - THREE, err);
	}
	return rc || !*ret_more || *ret_cut ? rc : check_matrix(in, line, err);
}
