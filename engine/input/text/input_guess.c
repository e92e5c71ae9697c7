/*
 * Checks texts without column names: are the first three columns certainly not x y z?
 *
 * Model: all rows of a file, or those of a pipe's head, are examined, by their digits only. A file is refused if its first
 * column is an index and the columns after it look more like coordinates than the first three do. All other files are x y z,
 * because refusing a valid survey does more harm than reading a strange list. Nothing is checked with --columns, with names that
 * are understood, and in .pts files.
 *
 * Two things may be said of columns P Q R in a row:
 *
 *   far       in all rows |P| and |Q| are at least 30 000, within a factor of 100 of each other, and |R| is less than
 *             30 000. Then Q is no height (no summit has 30 000 feet) and R is one. This holds for x y z in millimetres, too, if
 *             the heights are above 30 m and a small fourth column follows; hence the second condition below.
 *   written   all three have decimals in some row, while the index before them has none in any, and neither P nor Q is the same
 *             in all rows. Programs write x and y alike, so whole x beside y with decimals is no survey; a line along x has
 *             one y.
 *
 * The first column A is an index under these conditions:
 *
 *   numbers   A is whole and rises at every row, at least half of the steps by one, three rows or more: far or written
 *   classes   A is whole, from 0 to 255: far; any whole: far and written
 *   times     A has decimals and never falls, three rows or more, and R has decimals: far
 *   cells     A and B are whole, from 0 to 29 999, and the three behind them are far
 *   labels    A is whole, P, Q and R have decimals each in some row, and a word that is no number follows, as in PNEZD lists that
 *             are not sorted
 *
 * So at least four columns are needed, five for cells: three have no room for an index, but for numbers before two columns
 * alone that are both beyond 30 000 as above, where no height is left. Grids in either order, lines and strips
 * along an axis and whole numbers of all kinds pass: in a grid x comes again, in a line along x y is one, and small
 * numbers are not far.
 *
 * If an index is only likely, there is a warning. It is likely in ten rows or more if the first column goes up by exactly one
 * and the next two vary; or if the first column has a few whole values and the next three vary, with decimals. The latter may be
 * classes before local coordinates, or a grid of few columns, which looks the same. Extents of the first three columns lead to a
 * warning, too:
 *
 *   no height     the third has decimals and is beyond 30 000 everywhere, one of the others too, and the last one is not: "x z y"
 *   degrees       the first two are written with five decimals, lie within 180 and 90 either way, and the third spans fifty times
 *                 what they do
 */
#include "input_text_parts.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { FAR = 30000, RATIO = 100, ROWS_ENOUGH = 3, ROWS_LIKELY = 10, CLASSES = 255, LOOKED_AT = 5 };
enum { DEGREE_PLACE = -5, DEGREE_SPAN = 50 };

void input_guess_begin(const struct input *in, struct input_guess *g)
{
	*g = (struct input_guess){.on = input_xyz_of(in)->guesses};
}

/* ---- rows ---- */

static double value(struct input_number n)
{
	struct decimal d = {n.mantissa, n.exponent};

	return decimal_double(d);
}

static void take(struct input_guess_column *c, bool first, struct input_number n)
{
	double v = value(n);

	if (first) {
		*c = (struct input_guess_column){v, v, fabs(v), v, 0, n.written < 0, true, false};
		return;
	}
	c->min = fmin(c->min, v);
	c->max = fmax(c->max, v);
	c->least = fmin(c->least, fabs(v));
	c->ones += v == c->last + 1;
	c->decimals |= n.written < 0;
	c->rises &= v >= c->last;
	c->falls_or_stays |= v <= c->last;
	c->last = v;
}

static bool are_both_far(double a, double b)
{
	return a >= FAR && b >= FAR && a <= RATIO * b && b <= RATIO * a;
}

static bool is_far(const struct input_guess *g, unsigned at)
{
	const struct input_guess_column *c = g->column + at;

	return at + 2 < g->columns && are_both_far(c[0].least, c[1].least) && fmax(fabs(c[2].min), fabs(c[2].max)) < FAR;
}

static bool is_flat(const struct input_guess *g)
{
	return g->columns == 3 && are_both_far(g->column[1].least, g->column[2].least);
}

static bool is_labelled(const struct input_guess *g)
{
	const struct input_guess_column *c = g->column;

	return g->described && !c[0].decimals && c[1].decimals && c[2].decimals && c[3].decimals;
}

/* No more than a few. */
static bool has_few(const struct input_guess *g)
{
	return !g->column[0].decimals && g->few < INPUT_GUESS_FEW;
}

static bool within(const struct input_guess_column *c, double most)
{
	return !c->decimals && c->min >= 0 && c->max <= most;
}

static bool counts(const struct input_guess_column *c)
{
	return !c->decimals && !c->falls_or_stays;
}

/* Whether the rest of the rows can matter. Reading more than three columns takes time, and a few rows settle most files. */
static bool is_open(const struct input_guess *g)
{
	const struct input_guess_column *a = g->column;

	return is_flat(g) ? counts(a) :
			    g->columns >= 4 && (counts(a) || (is_far(g, 1) && (!a->decimals || a->rises)) ||
						(is_far(g, 2) && within(a, FAR - 1) && within(a + 1, FAR - 1)) ||
						(g->described && !a->decimals) || has_few(g));
}

static void count_value(struct input_guess *g, double v)
{
	for (unsigned i = 0; i < g->few; i++)
		if (g->value[i] == v)
			return;
	if (g->few < INPUT_GUESS_FEW)
		g->value[g->few++] = v;
}

void input_guess_row(const struct input *in, struct input_guess *g, struct input_line line)
{
	const char *p = line.at;
	char kind;
	unsigned i = 0;
	struct input_line word;
	struct input_number n;

	if (!g->on)
		return;
	if (!g->rows) {
		struct input_words row = input_words_of(line);

		g->words = row.words;
		g->columns = row.leading < LOOKED_AT ? row.leading : LOOKED_AT;
		g->described = row.leading == 4 && row.words > 4;
		g->line = input_xyz_of(in)->line;
	}
	kind = input_word_kind(line);
	while (i < g->columns && input_word_next(&p, line.end, kind, &word) && input_word_number(word, &n))
		take(&g->column[i++], !g->rows, n);
	g->columns = i;
	if (g->described && input_word_next(&p, line.end, kind, &word) && input_word_number(word, &n))
		g->described = false;
	if (i)
		count_value(g, g->column[0].last);
	g->rows++;
	g->on = is_open(g);
}

/* ---- the result ---- */

static bool is_written(const struct input_guess *g)
{
	const struct input_guess_column *c = g->column;

	return !c[0].decimals && c[1].decimals && c[2].decimals && c[3].decimals && c[1].min < c[1].max && c[2].min < c[2].max;
}

static bool are_numbers(const struct input_guess *g)
{
	return g->rows >= ROWS_ENOUGH && counts(g->column) && 2 * g->column[0].ones >= g->rows - 1 &&
	       (is_flat(g) || is_far(g, 1) || is_written(g));
}

static bool are_classes(const struct input_guess *g)
{
	return is_far(g, 1) && (within(g->column, CLASSES) || is_written(g));
}

static bool are_times(const struct input_guess *g)
{
	return g->rows >= ROWS_ENOUGH && g->column[0].decimals && g->column[0].rises && g->column[3].decimals && is_far(g, 1);
}

static bool are_cells(const struct input_guess *g)
{
	return within(g->column, FAR - 1) && within(g->column + 1, FAR - 1) && is_far(g, 2);
}

static const struct {
	bool (*are)(const struct input_guess *);
	int first; /* column of the coordinates */
	const char *what;
} kinds[] = {
	{are_cells, 2, "the first two columns are whole numbers as of the rows and columns of a grid"},
	{are_numbers, 1, "the first column counts up, as numbers of points do"},
	{are_classes, 1, "the first column has whole numbers, as classes and numbers of points do"},
	{is_labelled, 1,
	 "the first column has whole numbers, the next three have decimals, and a word follows, as in lists of points"},
	{are_times, 1, "the first column only rises, as times do"},
};

static void letters_from(int first, unsigned width, char en[INPUT_LETTERS], char ne[INPUT_LETTERS])
{
	input_letters(&(struct input_axes){{first, first + 1, first + 2}}, width, "enz", en);
	input_letters(&(struct input_axes){{first + 1, first, first + 2}}, width, "enz", ne);
}

static int refuse(struct input *in, const struct input_guess *g, int first, const char *what, struct err *err)
{
	char en[INPUT_LETTERS], ne[INPUT_LETTERS];

	letters_from(first, g->words, en, ne);
	input_fail(in, err, ERR_INPUT, g->line, "line", "%s, and those behind look like coordinates: not x y z, it seems", what);
	return err_add_hint(err,
			    "say what they are: --columns %s if the northing comes first (PNEZD), --columns %s if the "
			    "easting does; --columns xyz takes the first three",
			    ne, en);
}

static int refuse_flat(struct input *in, const struct input_guess *g, struct err *err)
{
	input_fail(in, err, ERR_INPUT, g->line, "line",
		   "the first column counts up, as numbers of points do, and of the two behind neither is a height, it seems");
	return err_add_hint(err, "a mesh needs heights; --columns xyz takes the first three columns as they are");
}

static bool vary_with_decimals(const struct input_guess_column *c)
{
	for (int i = 0; i < 3; i++)
		if (!c[i].decimals || c[i].min >= c[i].max)
			return false;
	return true;
}

static void warn(struct input *in, const struct input_guess *g)
{
	const struct input_guess_column *c = g->column;
	bool one_by_one = counts(c) && c->ones == g->rows - 1 && c[1].min < c[1].max && c[2].min < c[2].max;

	if (g->rows < ROWS_LIKELY)
		return;
	if (one_by_one)
		input_warn(in, "the first column is taken for x, but counts up by one: --columns says what it is");
	else if (has_few(g) && vary_with_decimals(c + 1))
		input_warn(
			in,
			"the first column is taken for x, but has only whole numbers, %u of them, before others with decimals: "
			"--columns says what it is",
			g->few);
}

/* How far the numbers of an axis are from zero, at least and at most. */
static double least(const struct input_extent *e)
{
	return e->min > 0 ? e->min : e->max < 0 ? -e->max : 0;
}

static double most(const struct input_extent *e)
{
	return fmax(fabs(e->min), fabs(e->max));
}

/* The column, first or second, that may be a height if the third cannot be one. -1: the third may be a height. */
static int height_elsewhere(const struct input_extent axis[3])
{
	for (int i = 0; i < 2; i++)
		if (most(&axis[i]) < FAR && are_both_far(least(&axis[1 - i]), least(&axis[2])))
			return i;
	return -1;
}

static bool are_degrees(const struct input_extent axis[3])
{
	double x = most(&axis[0]), y = most(&axis[1]);
	double span = fmax(axis[0].max - axis[0].min, axis[1].max - axis[1].min);

	return fmin(x, y) <= 90 && fmax(x, y) <= 180 && axis[0].written <= DEGREE_PLACE && axis[1].written <= DEGREE_PLACE &&
	       span > 0 && axis[2].max - axis[2].min >= DEGREE_SPAN * span;
}

static void warn_of_extents(struct input *in, const struct input_extent axis[3])
{
	int height = axis[2].written < 0 ? height_elsewhere(axis) : -1; /* whole numbers may be millimetres */

	if (height >= 0)
		input_warn(
			in,
			"the third column is taken for the height, but no height is as large, and the %s may be one: --columns "
			"says what they are",
			height ? "second" : "first");
	else if (are_degrees(axis))
		input_warn(in, "x and y look like degrees: --assume-crs (as EPSG:4326) projects them, with --columns yxz if the "
			       "latitude comes first");
}

int input_guess_judge(struct input *in, const struct input_guess *g, const struct input_extent axis[3], struct err *err)
{
	if (input_xyz_of(in)->guesses)
		warn_of_extents(in, axis);
	if (!g->on || !g->rows)
		return 0;
	if (is_flat(g))
		return are_numbers(g) ? refuse_flat(in, g, err) : 0;
	for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
		if (kinds[i].are(g))
			return refuse(in, g, kinds[i].first, kinds[i].what, err);
	warn(in, g);
	return 0;
}

/* The first three consecutive numbers that may be coordinates. If a whole number precedes three with decimals, these three.
 * -1: there are no three. */
static int first_of_three(struct input_words row)
{
	uint64_t three = row.numbers & row.numbers >> 1 & row.numbers >> 2;
	int first = three ? __builtin_ctzll(three) : -1;

	if (!three || row.words > INPUT_COLUMNS)
		return -1;
	return first + (three >> first & 2 && (row.whole >> first & 15) == 1);
}

bool input_guess_sees_numbers(const struct input *in, struct input_line line)
{
	struct input_words row = input_words_of(line);

	return input_xyz_of(in)->guesses && !(row.numbers & 1) && first_of_three(row) > 0;
}

int input_guess_hint(const struct input *in, struct input_line line, struct err *err)
{
	char en[INPUT_LETTERS], ne[INPUT_LETTERS];
	struct input_words row = input_words_of(line);
	int first = first_of_three(row);

	if (!input_xyz_of(in)->guesses ||
	    (input_xyz_of(in)->line != input_xyz_of(in)->first && !input_guess_sees_numbers(in, line)))
		return -(int)err->code;
	if (first < 0)
		return err_add_hint(err,
				    "comments begin with !, ;, #, %% or //; other text may stand before the points where a line "
				    "of names follows it");
	letters_from(first, row.words, en, ne);
	return err_add_hint(
		err,
		"comments begin with !, ;, #, %% or //; if the coordinates stand in other columns, say which: --columns %s, "
		"or --columns %s if the northing comes first",
		en, ne);
}
