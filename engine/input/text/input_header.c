/*
 * Interprets a line of names: which columns are x, y, z, class and returns, and their units.
 *
 * Model: the names must be unambiguous. Otherwise the file is refused, with the letters of --columns that resolve it. A line may
 * have these pairs of coordinates:
 *
 *   easting and northing  clear in any order.
 *   X and Y               clear only if X comes first and the height is not a word of a language whose surveyors call the
 *                         northing X ("X,Y,Z", "x,y,elevation"), or if all three are reversed ("z,y,x"). Lists of "Y,X,H",
 *                         "Y X Z", "X;Y;H" come from programs of both kinds, and the wrong choice mirrors the mesh. The numbers
 *                         do not help: eastings of 5 500 000 beside northings of 5 600 000 are ordinary.
 *   longitude, latitude   clear in any order, but only used if the line has none of the others. They are degrees.
 *
 * A line with both of the first two names two planes, and is refused. A column Z is preferred to other heights; two others are
 * refused. Unknown names are not coordinates. With blanks as separators the end of a name of several words is not known; known
 * ones ("Point Number", "GPS Time") are joined if that makes as many names as there are columns. The return is only used together
 * with the number of returns, since a return alone does not tell whether it is the last.
 */
#include "input_text_parts.h"

#include <ctype.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "crs.h"

enum { NAMES_SHOWN = 60, SEVERAL = -2, PHRASE = 4 };

static bool is_coordinate(enum input_field f)
{
	return f >= INPUT_FIELD_X && f <= INPUT_FIELD_LAT;
}

static bool is_height(enum input_field f)
{
	return f == INPUT_FIELD_Z || f == INPUT_FIELD_HEIGHT || f == INPUT_FIELD_LOCAL_HEIGHT;
}

/* The column of a field; -1: there is none. */
static int only(const struct input_header *h, enum input_field field)
{
	int at = -1;

	for (unsigned i = 0; i < h->n; i++)
		if (h->name[i].field == field)
			at = at == -1 ? (int)i : SEVERAL;
	return at;
}

/* ---- reading ---- */

/* "E [m]" is one name, even if blanks separate columns. */
static bool name_next(const char **at, const char *end, char kind, struct input_line *ret)
{
	const char *next, *close;

	if (!input_word_next(at, end, kind, ret))
		return false;
	for (next = *at; kind == ' ' && next < end && (*next == ' ' || *next == '\t'); next++)
		;
	if (kind != ' ' || next == end || (*next != '(' && *next != '['))
		return true;
	close = memchr(next, *next == '(' ? ')' : ']', (size_t)(end - next));
	ret->end = close ? close + 1 : end;
	*at = ret->end;
	return true;
}

/* Joins words as long as they are one name. Single letters are separate names: "R G B". */
static void join(const char **at, const char *end, struct input_line *name)
{
	const char *next = *at;
	struct input_line word = *name;

	for (unsigned words = 2; word.end - word.at > 1 && words <= PHRASE && input_word_next(&next, end, ' ', &word); words++)
		if (word.end - word.at > 1 && input_name_is_phrase((struct input_line){name->at, word.end})) {
			name->end = word.end;
			*at = next;
		}
}

static int height_of(const struct input_header *h)
{
	int z = only(h, INPUT_FIELD_Z), a, b;

	if (z != -1)
		return z;
	a = only(h, INPUT_FIELD_HEIGHT);
	b = only(h, INPUT_FIELD_LOCAL_HEIGHT);
	return a == -1 ? b : b == -1 ? a : SEVERAL;
}

static bool pair(const struct input_header *h, enum input_field a, enum input_field b, int z, struct input_axes *ret)
{
	*ret = (struct input_axes){{only(h, a), only(h, b), z}};
	return ret->at[0] >= 0 && ret->at[1] >= 0;
}

static bool is_sure_order(const struct input_header *h, const struct input_axes *xy)
{
	int z = xy->at[2];

	if (xy->at[0] < xy->at[1])
		return z < 0 || h->name[z].field != INPUT_FIELD_LOCAL_HEIGHT;
	return z >= 0 && z < xy->at[1] && h->name[z].field == INPUT_FIELD_Z;
}

static bool other_angles(const struct input_header *h, const struct input_axes *a)
{
	for (int i = 0; i < 2; i++)
		if (a->at[i] >= 0 && h->name[a->at[i]].unit == INPUT_UNIT_OTHER_ANGLE)
			return true;
	return false;
}

static const char *lacking(const struct input_header *h)
{
	const struct input_axes *a = &h->reading[0];

	if (a->at[0] == SEVERAL || a->at[1] == SEVERAL || a->at[2] == SEVERAL)
		return "name a coordinate twice";
	if (a->at[0] < 0 || a->at[1] < 0)
		return a->at[2] < 0 ? "are not understood" : "do not say which columns are x and y";
	if (a->at[2] < 0)
		return "do not say which column is the height";
	if (only(h, INPUT_FIELD_CLASS) == SEVERAL)
		return "name the class twice";
	return other_angles(h, a) ? "tell angles that are not decimal degrees" : NULL;
}

static void understand(struct input_header *h)
{
	struct input_axes en, xy, degrees;
	int z = height_of(h);
	bool has_en = pair(h, INPUT_FIELD_EAST, INPUT_FIELD_NORTH, z, &en);
	bool has_xy = pair(h, INPUT_FIELD_X, INPUT_FIELD_Y, z, &xy);
	bool has_degrees = pair(h, INPUT_FIELD_LON, INPUT_FIELD_LAT, z, &degrees);

	h->state = INPUT_HEADER_SURE;
	h->reading[0] = has_en ? en : has_xy ? xy : has_degrees ? degrees : en.at[0] != -1 || en.at[1] != -1 ? en : xy;
	h->lacks = lacking(h);
	if (h->lacks) {
		h->state = INPUT_HEADER_LACKING;
	} else if (has_en && has_xy) {
		h->state = INPUT_HEADER_TWO;
		h->reading[1] = xy;
	} else if (has_xy && !is_sure_order(h, &xy)) {
		h->state = INPUT_HEADER_OPEN;
		h->reading[1] = (struct input_axes){{xy.at[1], xy.at[0], z}};
	}
}

static void read_names(struct input_line line, bool joined, struct input_header *ret)
{
	const char *p = line.at;
	struct input_line word;

	memset(ret, 0, sizeof *ret);
	ret->kind = input_word_kind(line);
	while (ret->n < INPUT_COLUMNS && name_next(&p, line.end, ret->kind, &word)) {
		if (joined && ret->kind == ' ')
			join(&p, line.end, &word);
		ret->name[ret->n] = input_name_of(word);
		ret->coordinates += is_coordinate(ret->name[ret->n++].field);
	}
	ret->n += ret->n < INPUT_COLUMNS && input_word_trails(line, ret->kind);
	understand(ret);
}

void input_header_read(struct input_line line, struct input_header *ret)
{
	read_names(line, false, ret);
}

void input_header_read_joined(struct input_line line, struct input_header *ret)
{
	read_names(line, true, ret);
}

void input_header_columns(const struct input_header *h, struct input_columns *ret)
{
	int returns[2] = {only(h, INPUT_FIELD_RETURN), only(h, INPUT_FIELD_RETURNS)}, cls = only(h, INPUT_FIELD_CLASS);

	memset(ret->role, INPUT_SKIPPED, sizeof ret->role);
	ret->named = true;
	for (int i = 0; i < 3; i++)
		ret->role[h->reading[0].at[i]] = (uint8_t)(INPUT_X + i);
	if (cls >= 0)
		ret->role[cls] = INPUT_CLASS;
	if (returns[0] >= 0 && returns[1] >= 0) {
		ret->role[returns[0]] = INPUT_RETURN;
		ret->role[returns[1]] = INPUT_RETURNS;
	}
}

/* ---- units ---- */

/* The word has no letter of any script: "-", or nothing. */
static bool says_nothing(struct input_line word)
{
	for (const char *p = word.at; p < word.end; p++)
		if (isalnum((unsigned char)*p) || (unsigned char)*p >= 0x80)
			return false;
	return true;
}

/* Returns the number of words if all of them are units, else 0. */
static unsigned read_units(struct input_line line, enum input_unit ret[INPUT_COLUMNS])
{
	char kind = input_word_kind(line);
	const char *p = line.at;
	struct input_line word;
	bool any = false;
	unsigned n = 0;

	for (; n < INPUT_COLUMNS && input_word_next(&p, line.end, kind, &word); n++) {
		struct input_name name = input_name_of(word);

		if (name.field != INPUT_FIELD_NONE || (name.unit == INPUT_UNIT_NONE && !says_nothing(word)))
			return 0;
		any |= name.unit != INPUT_UNIT_NONE;
		ret[n] = name.unit;
	}
	if (n < INPUT_COLUMNS && input_word_trails(line, kind))
		ret[n++] = INPUT_UNIT_NONE;
	return any ? n : 0;
}

bool input_header_read_units(struct input_line line, struct input_header *h, bool *ret_differ)
{
	enum input_unit units[INPUT_COLUMNS];

	if (!h->n || read_units(line, units) != h->n)
		return false;
	for (unsigned i = 0; i < h->n; i++) {
		*ret_differ |= units[i] != INPUT_UNIT_NONE && h->name[i].unit != INPUT_UNIT_NONE && units[i] != h->name[i].unit;
		if (h->name[i].unit == INPUT_UNIT_NONE)
			h->name[i].unit = units[i];
	}
	for (unsigned i = 0; *ret_differ && i < h->n; i++)
		h->name[i].unit = INPUT_UNIT_NONE;
	understand(h);
	return true;
}

static const char *unit_name(enum input_unit unit)
{
	return unit == INPUT_UNIT_METRE   ? "metre" :
	       unit == INPUT_UNIT_FOOT    ? "foot" :
	       unit == INPUT_UNIT_US_FOOT ? "us-survey-foot" :
					    NULL;
}

static struct input_name name_at(const struct input_header *h, const struct input_columns *c, enum input_role role)
{
	for (unsigned i = 0; i < h->n && i < INPUT_COLUMNS; i++)
		if (c->role[i] == role)
			return h->name[i];
	return (struct input_name){INPUT_FIELD_NONE, INPUT_UNIT_NONE};
}

static void take_unit(struct input *in, const char *what, enum input_unit unit, char ret[CRS_UNIT_SIZE])
{
	if (unit_name(unit))
		snprintf(ret, CRS_UNIT_SIZE, "%s", unit_name(unit));
	else if (unit == INPUT_UNIT_SOME_FOOT)
		input_warn(in, "%s in feet, but the names do not say in which: --assume-units ft or ftUS does", what);
	else if (unit != INPUT_UNIT_NONE)
		input_warn(in, "the names have a unit of %s that is not known", what);
}

void input_header_units(struct input *in, const struct input_header *h, const struct input_columns *c)
{
	struct input_name x = name_at(h, c, INPUT_X), y = name_at(h, c, INPUT_Y), z = name_at(h, c, INPUT_Z);
	struct crs_info *crs = &in->info.crs;

	if (x.field == INPUT_FIELD_LON && y.field == INPUT_FIELD_LAT && x.unit != INPUT_UNIT_OTHER_ANGLE &&
	    y.unit != INPUT_UNIT_OTHER_ANGLE) {
		crs->plane = CRS_PLANE_GEOGRAPHIC;
		snprintf(crs->unit_xy, sizeof crs->unit_xy, "degree");
	} else if (x.unit == y.unit) {
		take_unit(in, "x and y are", x.unit, crs->unit_xy);
	} else {
		input_warn(in, "the names of x and y have two units: neither is taken");
	}
	take_unit(in, "z is", z.unit, crs->unit_z);
	crs_info_settle(crs);
}

/* ---- refusing ---- */

void input_letters(const struct input_axes *at, unsigned width, const char *axes, char ret[INPUT_LETTERS])
{
	for (int i = 0; i < 3; i++)
		if (at->at[i] >= (int)width)
			width = (unsigned)at->at[i] + 1;
	width = width < INPUT_COLUMNS ? width : INPUT_COLUMNS;
	memset(ret, '_', width);
	ret[width] = 0;
	for (int i = 0; i < 3; i++)
		if (at->at[i] >= 0)
			ret[at->at[i]] = axes[i];
}

static void spell(const struct input_header *h, const struct input_axes *at, unsigned width, const char *axes,
		  char ret[INPUT_LETTERS])
{
	int cls = only(h, INPUT_FIELD_CLASS);

	input_letters(at, width, axes, ret);
	if (cls >= 0)
		ret[cls] = 'c';
}

/* The name has no meaning, or only this one. */
static bool may_be(enum input_field f, int axis)
{
	return f == INPUT_FIELD_NONE || (axis == 0 ? f == INPUT_FIELD_X || f == INPUT_FIELD_EAST || f == INPUT_FIELD_LON :
					 axis == 1 ? f == INPUT_FIELD_Y || f == INPUT_FIELD_NORTH || f == INPUT_FIELD_LAT :
						     is_height(f));
}

/* Chooses columns for the axes that no name identifies. `ret_lacks` has the axes that remain without one. */
static void fill(const struct input_header *h, struct input_axes *a, char ret_lacks[4])
{
	bool taken[INPUT_COLUMNS] = {false};
	unsigned n = 0;

	for (int i = 0; i < 3; i++)
		if (a->at[i] >= 0)
			taken[a->at[i]] = true;
	for (int i = 0; i < 3; i++) {
		for (unsigned k = 0; a->at[i] < 0 && k < h->n; k++)
			if (!taken[k] && may_be(h->name[k].field, i)) {
				a->at[i] = (int)k;
				taken[k] = true;
			}
		if (a->at[i] < 0)
			ret_lacks[n++] = "xyz"[i];
	}
	ret_lacks[n] = 0;
}

static void show(const char *names, char ret[NAMES_SHOWN + 4])
{
	size_t n = 0;

	for (; names[n] && n < NAMES_SHOWN; n++)
		ret[n] = names[n] >= 0x20 && names[n] < 0x7f && names[n] != '"' ? names[n] : '?';
	snprintf(ret + n, 4, "%s", names[n] ? "..." : "");
}

/* Letters for columns that are `by` to the right of those of the names. False: not all coordinates are within `width` then. */
static bool spell_shifted(const struct input_header *h, int by, unsigned width, char ret[INPUT_LETTERS])
{
	struct input_header moved = {.n = 0};
	int most = (int)(width < INPUT_COLUMNS ? width : INPUT_COLUMNS);

	for (int i = 0; i < (int)h->n; i++)
		if (i + by >= 0 && i + by < most)
			moved.name[i + by] = h->name[i];
	for (int i = 0; i < 3; i++) {
		moved.reading[0].at[i] = h->reading[0].at[i] + by;
		if (moved.reading[0].at[i] < 0 || moved.reading[0].at[i] >= most)
			return false;
	}
	moved.n = (unsigned)most;
	spell(&moved, &moved.reading[0], width, "xyz", ret);
	return true;
}

static int refuse_width(struct input *in, const struct input_header *h, struct input_words row, uint64_t line, const char *shown,
			struct err *err)
{
	char right[INPUT_LETTERS], left[INPUT_LETTERS];
	bool more = row.words > h->n, fits_right = spell_shifted(h, (int)row.words - (int)h->n, row.words, right),
	     fits_left = spell_shifted(h, 0, row.words, left);

	input_fail(in, err, ERR_INPUT, line, "line", "line %" PRIu64 " names %u columns (%s), but the points have %u", line, h->n,
		   shown, row.words);
	if (fits_right && fits_left && more)
		return err_add_hint(err,
				    "say which is which: --columns %s if the first column has no name, --columns %s if the last "
				    "has none",
				    right, left);
	if (fits_right && fits_left)
		return err_add_hint(
			err,
			"say which is which: --columns %s if a name before the coordinates has several words, --columns "
			"%s if one behind them has, or the last columns are missing",
			right, left);
	return err_add_hint(err, "say which is which by a letter for each column, as in --columns %s",
			    fits_right ? right :
			    fits_left  ? left :
					 "_xyz");
}

static int refuse_lacking(struct input *in, const struct input_header *h, unsigned width, uint64_t line, const char *shown,
			  struct err *err)
{
	struct input_axes a = h->reading[0];
	char letters[INPUT_LETTERS], lacks[4];

	input_fail(in, err, ERR_INPUT, line, "line", "line %" PRIu64 ": the names of the columns (%s) %s", line, shown, h->lacks);
	fill(h, &a, lacks);
	spell(h, &a, width, "xyz", letters);
	if (strlen(lacks) == 3)
		return err_add_hint(err, "say which is which by a letter for each column, as in --columns _xyz");
	if (*lacks)
		return err_add_hint(
			err,
			"say which is which by a letter for each column: --columns %s has no column for %s yet (x is the "
			"easting or longitude, z the height)",
			letters, lacks);
	return err_add_hint(err,
			    "say which is which by a letter for each column: --columns %s, or however it is (x is the easting "
			    "or longitude, z the height)",
			    letters);
}

int input_header_refuse(struct input *in, const struct input_header *h, struct input_words row, uint64_t line, const char *text,
			struct err *err)
{
	unsigned width = row.words > h->n ? row.words : h->n;
	char shown[NAMES_SHOWN + 4], letters[2][INPUT_LETTERS];

	show(text, shown);
	if (h->state == INPUT_HEADER_SURE)
		return refuse_width(in, h, row, line, shown, err);
	if (h->state == INPUT_HEADER_LACKING)
		return refuse_lacking(in, h, width, line, shown, err);
	for (int i = 0; i < 2; i++)
		spell(h, &h->reading[i], width, "enz", letters[i]);
	if (h->state == INPUT_HEADER_TWO) {
		input_fail(in, err, ERR_INPUT, line, "line",
			   "line %" PRIu64 " names an easting and a northing, and an X and a Y (%s)", line, shown);
		return err_add_hint(err, "say which are meant: --columns %s for easting and northing, --columns %s for X and Y",
				    letters[0], letters[1]);
	}
	input_fail(in, err, ERR_INPUT, line, "line",
		   "line %" PRIu64 ": the names of the columns (%s) leave open whether X is the "
		   "easting or the northing",
		   line, shown);
	return err_add_hint(err, "say it: --columns %s if X is the easting, --columns %s if X is the northing", letters[0],
			    letters[1]);
}

int input_header_refuse_two(struct input *in, const struct input_header *words, const struct input_header *joined,
			    struct input_words row, uint64_t line, const char *text, struct err *err)
{
	char shown[NAMES_SHOWN + 4], letters[2][INPUT_LETTERS];

	show(text, shown);
	spell(joined, &joined->reading[0], row.words, "xyz", letters[0]);
	spell(words, &words->reading[0], row.words, "xyz", letters[1]);
	input_fail(in, err, ERR_INPUT, line, "line", "line %" PRIu64 ": the names of the columns (%s) may be %u or %u", line,
		   shown, joined->n, words->n);
	return err_add_hint(
		err,
		"say which is which: --columns %s if names of several words are one column each, --columns %s if each "
		"word is a column",
		letters[0], letters[1]);
}
