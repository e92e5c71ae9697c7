/* Shared by the files that read text: lines (input_line.c), columns (input_columns.c), points (input_xyz.c). */
#ifndef INPUT_TEXT_PARTS_H
#define INPUT_TEXT_PARTS_H

#include "input_text.h"

/* The meaning of a column; roles below INPUT_ROLES are read. */
enum input_role { INPUT_X, INPUT_Y, INPUT_Z, INPUT_CLASS, INPUT_RETURN, INPUT_RETURNS, INPUT_ROLES, INPUT_SKIPPED = INPUT_ROLES };
enum { INPUT_COLUMNS = 64 };

struct input_columns {
	uint8_t role[INPUT_COLUMNS];
	unsigned n;        /* up to the last one that is read */
	bool cls, returns; /* there are columns of them */
	bool named;        /* the columns come from a line of names, not from --columns */
};

/* The unit of raw numbers, and the rounding of numbers that are no multiple of it (input_place.c). INPUT_EXACT: there are none.
 * INPUT_NEAREST: to the nearest, half upwards. INPUT_ODD: to the odd one of the two neighbours, so that a later rounding to a
 * hundred units or more gives the same result as rounding once. */
struct input_place {
	enum { INPUT_EXACT, INPUT_NEAREST, INPUT_ODD } rounding;
	struct decimal scale;
};

enum input_encoding { INPUT_UTF8, INPUT_UTF16_LE, INPUT_UTF16_BE, INPUT_UTF16_UNMARKED, INPUT_UTF32 };

struct input_xyz {
	struct input_columns columns;
	enum input_encoding encoding;
	uint8_t half[4]; /* of UTF-16: bytes read, but no whole character yet */
	size_t n_half;
	struct input_place place[2]; /* of x and y, of z */
	uint64_t at;                 /* file offset of the next byte to be read into the buffer */
	uint64_t line;               /* of the line handed out last, from 1 */
	uint64_t head;               /* lines before the points: up to this one they are not read again */
	size_t i_buffered, n_buffered;
	uint64_t points;  /* handed out so far */
	size_t line_most; /* bytes of a line; 0: 4096 */
	bool ended;
	bool head_only;  /* of a pipe that is being opened: only the bytes that are there already are read */
	bool counts;     /* .pts: a line of one number says how many points follow */
	unsigned commas; /* columns of the first point, if commas separate them; else 0 */
	uint64_t first;  /* line that should be the first point; 0: there is none */
	bool guesses;    /* the columns are guessed: there are neither names nor --columns */
	uint64_t names;  /* the line of names; 0: there is none */
	bool counting;   /* lines for warnings are counted: of a file while it is opened, of a pipe while it is read */
	bool begun;      /* a point was seen since counting began */
	uint64_t commented, commented_line; /* comments that may be points, and the first (input_comment.c) */
	uint64_t unread, unread_line;       /* lines whose class or return is not a number, and the first */
};

/* Also for PTX files: their state begins with it. */
static inline struct input_xyz *input_xyz_of(const struct input *in)
{
	return input_state(in);
}

/* ---- numbers (input_number.c) ---- */

/* value = mantissa * 10^exponent, no trailing zero in the mantissa; `written` is the place of the last
 * digit that stands in the text, zero or not, at most 0. */
struct input_number {
	int64_t mantissa;
	int exponent, written;
	bool deep;       /* there are more digits than that, or below 10^-15: all of them are in the text */
	uint16_t length; /* of a deep one: its text, */
	const char *at;  /* valid as long as its line */
};

/* TOO_LONG: 10^19 or more. */
enum input_number_state { INPUT_NUMBER_OK, INPUT_NUMBER_BAD, INPUT_NUMBER_NOT_FINITE, INPUT_NUMBER_TOO_LONG };

/* Whether a letter behind digits begins an exponent: e, or behind digits with a point the d of Fortran (1.0D+02); without one
 * "3D1" is more likely a name. */
static inline bool input_number_exponent_at(char c, bool point)
{
	return (c | 0x20) == 'e' || (point && (c | 0x20) == 'd');
}

/* One number at *at, up to `end`; *at moves behind it. Decimal point, optional exponent. */
enum input_number_state input_number_read(const char **at, const char *end, struct input_number *ret);

/* All digits that count: the value lies in [mantissa, mantissa + 1) * 10^exponent if there are more, else it is the lower
 * end, and has this sign. With more the mantissa has 36 digits. */
struct input_digits {
	unsigned __int128 mantissa;
	int exponent;
	bool negative, more;
};
struct input_digits input_number_digits(const struct input_number *);

struct input_line {
	const char *at, *end; /* without its line end */
};

/* ---- encodings (input_encoding.c) ---- */

/* Before the first byte is read. -ERR_INPUT: an encoding that is not read. */
int input_encoding_look(struct input *in, struct err *err);
typedef int input_fill_fn(struct input *in, void *to, size_t room, size_t *ret_n, struct err *err);
/* The next bytes of the file by `read`, as UTF-8 into the buffer behind those that were kept. *ret_raw: as read. */
int input_encoding_fill(struct input *in, size_t kept, input_fill_fn *read, size_t *ret_raw, size_t *ret_n, struct err *err);
/* A line with decimal commas: with points. And a byte of it as it was. */
void input_encoding_commas(char *at, char *end);
char input_encoding_shown(const struct input *in, char c);

/* ---- lines (input_line.c, input_wrong.c) ---- */

/* -code: what is wrong with the line that was read last, with its number and how it begins. */
int input_bad_line(struct input *in, struct err *err, enum err_code code, const char *what, struct input_line text);
/* From the first byte again. */
void input_line_rewind(struct input *in);
/* The next line; ret->at NULL at the end of the file, or when its pipe is dry. */
int input_line_next(struct input *in, struct input_line *ret, struct err *err);
/* The same, but neither blank lines nor comments nor what stands before the points. */
int input_line_next_point(struct input *in, struct input_line *ret, struct err *err);
/* The numbers of a line, each at the place of its column's role; ret[role] of roles without a column stays. INPUT_E_LEFT_OUT: a
 * coordinate has no value, as err says; the line is to be left out and counted. */
enum { INPUT_E_LEFT_OUT = 1 };
/* True if a class or return may be something else than a number: only a line of names says that it should be one. */
static inline bool input_line_may_lack(const struct input *in, unsigned role)
{
	return role > INPUT_Z && role < INPUT_ROLES && input_xyz_of(in)->columns.named && !in->strict;
}
int input_line_parse(struct input *in, struct input_line line, struct input_number ret[INPUT_ROLES], struct err *err);

/* True if the column at p, which is not a number, means a missing value: an empty field, `*` or `null`. */
bool input_line_no_value(struct input_line line, const char *p, char kind);
/* -ERR_INPUT: what is wrong with a line, or the number at p. */
int input_wrong_number(struct input *in, struct err *err, enum input_number_state state, struct input_line line, const char *p);
int input_wrong_separator(struct input *in, struct err *err, struct input_line line, const char *column);
int input_wrong_commas(struct input *in, struct err *err, struct input_line line);
int input_wrong_strict(struct err *err);
/* Adds the hint for a class or return that is not a number. */
int input_wrong_attribute(const struct input *in, struct err *err);

/* ---- comments (input_comment.c) ---- */

bool input_line_is_comment(struct input_line line);            /* or blank */
struct input_line input_comment_words(struct input_line line); /* without the mark */
/* The columns that are read as x, y and z are numbers. */
bool input_line_is_point(const struct input_columns *, struct input_line line);
/* The first line of the points was found: comments before it count only behind a line of names. */
void input_comment_points_begin(struct input *in);
/* Counts a comment that may be a point. -ERR_INPUT: it is one too many (--strict). */
int input_comment_look(struct input *in, struct input_line line, struct err *err);
/* At the end: a warning of those that were counted; -ERR_INPUT, if there are no points but them. */
int input_comment_judge(struct input *in, bool any_points, struct err *err);

/* ---- words (input_word.c) ---- */

char input_word_kind(struct input_line line); /* what separates its words: ; , tab or blank */
/* The next word of a line; false at its end. */
bool input_word_next(const char **at, const char *end, char kind, struct input_line *ret);
/* Behind the last separator of a line is one more column, with nothing in it. */
bool input_word_trails(struct input_line line, char kind);
/* All of the word is a number. */
bool input_word_number(struct input_line word, struct input_number *ret);

struct input_words {
	unsigned words, leading; /* numbers before anything else */
	char kind;               /* of their separators */
	uint64_t numbers, whole; /* bits of words that are numbers, and have no decimals */
};
struct input_words input_words_of(struct input_line line);

/* ---- names of columns (input_names.c, input_header.c) ---- */

enum input_field {
	INPUT_FIELD_NONE,
	INPUT_FIELD_X,
	INPUT_FIELD_Y,
	INPUT_FIELD_Z,
	INPUT_FIELD_EAST,
	INPUT_FIELD_NORTH,
	INPUT_FIELD_HEIGHT,
	INPUT_FIELD_LOCAL_HEIGHT, /* in a language whose surveyors may call the northing X */
	INPUT_FIELD_LON,
	INPUT_FIELD_LAT,
	INPUT_FIELD_CLASS,
	INPUT_FIELD_RETURN,
	INPUT_FIELD_RETURNS,
	INPUT_FIELD_OTHER, /* known, and not read: numbers of points, colours, times */
};

enum input_unit {
	INPUT_UNIT_NONE,
	INPUT_UNIT_METRE,
	INPUT_UNIT_FOOT,
	INPUT_UNIT_US_FOOT,
	INPUT_UNIT_SOME_FOOT,
	INPUT_UNIT_DEGREE,
	INPUT_UNIT_OTHER_ANGLE,
	INPUT_UNIT_OTHER,
};

struct input_name {
	enum input_field field;
	enum input_unit unit;
};
struct input_name input_name_of(struct input_line word);
/* Words that are one name together: "Point Number". */
bool input_name_is_phrase(struct input_line words);

struct input_axes {
	int at[3]; /* columns of x, y and z; -1: not known */
};

/* A line of names. It has as many readings as there are ways to understand it for sure: one, or none. */
enum input_header_state {
	INPUT_HEADER_SURE,
	INPUT_HEADER_OPEN,    /* X and Y may be either way round: readings 0 (X is the easting) and 1 */
	INPUT_HEADER_TWO,     /* two pairs of coordinates: readings 0 and 1 */
	INPUT_HEADER_LACKING, /* a coordinate is missing or stands twice: reading 0 is what is known */
};

struct input_header {
	struct input_name name[INPUT_COLUMNS];
	unsigned n;           /* names */
	char kind;            /* of their separators */
	unsigned coordinates; /* of them, those of coordinates */
	enum input_header_state state;
	struct input_axes reading[2];
	const char *lacks; /* LACKING: a static text */
};

void input_header_read(struct input_line line, struct input_header *ret);
/* The same, but of names between blanks those of several words are joined that are known. */
void input_header_read_joined(struct input_line line, struct input_header *ret);
/* A line of units behind the names. False: it is none. *ret_differ: the names have other units, and none counts. */
bool input_header_read_units(struct input_line line, struct input_header *, bool *ret_differ);
/* The columns of a header that is sure. */
void input_header_columns(const struct input_header *, struct input_columns *ret);
/* Units, and that coordinates are degrees, into in->info.crs; a warning where they are not known. */
void input_header_units(struct input *in, const struct input_header *, const struct input_columns *);
/* -ERR_INPUT for a header that is not sure, or does not fit the columns of the `row`: the letters of --columns for this file
 * are in the hint. `line` is its number, `text` its words. */
int input_header_refuse(struct input *in, const struct input_header *, struct input_words row, uint64_t line, const char *text,
			struct err *err);
/* -ERR_INPUT: names fit the row both word by word and joined. */
int input_header_refuse_two(struct input *in, const struct input_header *words, const struct input_header *joined,
			    struct input_words row, uint64_t line, const char *text, struct err *err);

enum { INPUT_LETTERS = INPUT_COLUMNS + 1 };
/* The letters of --columns: of `axes` ("xyz" or "enz") at their columns, else _; `width` columns in all. */
void input_letters(const struct input_axes *at, unsigned width, const char *axes, char ret[INPUT_LETTERS]);

/* ---- before the points (input_head.c) ---- */

enum { INPUT_HEAD_LINE = 4096 + 1 };

/* Texts are copies, since lines go with the window. Numbers of lines are 0 where there is none. */
struct input_head {
	char names[INPUT_HEAD_LINE], units[INPUT_HEAD_LINE], comment[INPUT_HEAD_LINE];
	uint64_t names_line, comment_line;
	uint64_t first_line;     /* of the points */
	uint64_t text_line;      /* the first line that is neither blank nor a comment nor a count */
	uint64_t before_line;    /* the last line before the points that is neither blank nor a comment */
	unsigned texts, numbers; /* lines before the points: of text, names among them; of numbers */
	bool has_coordinates;    /* the names tell some */
	struct input_words row;  /* of the first point */
};

/* Reads the first lines. */
int input_head_read(struct input *in, struct input_head *ret, struct err *err);
/* Words that name coordinates. */
bool input_head_is_names(struct input_line line);

/* Range and digits of the numbers of an axis that were read so far. */
struct input_extent {
	double min, max;
	int written, needed; /* places: of the last digit, of the last one that is not zero */
	uint64_t line;       /* of the first number that needs that place */
	bool deep;           /* some are */
};

/* No numbers yet. */
void input_extents_begin(struct input_extent axis[3]);
/* Takes x, y and z of a point. `line` is its number. */
void input_extents_add(struct input_extent axis[3], const struct input_number n[3], uint64_t line);

/* ---- columns without names (input_guess.c) ---- */

struct input_guess_column {
	double min, max, least, last;         /* `least` magnitude */
	uint64_t ones;                        /* steps of exactly 1 */
	bool decimals, rises, falls_or_stays; /* any; no value is less; one is no more than that before */
};

enum { INPUT_GUESS_FEW = 9 };
/* Statistics of the first columns over all rows so far. */
struct input_guess {
	bool on;
	uint64_t rows, line;     /* of the first one */
	unsigned words, columns; /* of the first row; numbers in all of them */
	bool described;          /* behind four numbers stands a word in the first row, and a number in none */
	unsigned few;            /* different values of the first column, as far as there is room: */
	double value[INPUT_GUESS_FEW];
	struct input_guess_column column[5];
};

void input_guess_begin(const struct input *in, struct input_guess *);
void input_guess_row(const struct input *in, struct input_guess *, struct input_line line);
/* -ERR_INPUT if the first three columns are no x y z for sure; where that is likely only, a warning. */
int input_guess_judge(struct input *in, const struct input_guess *, const struct input_extent axis[3], struct err *err);
/* Behind a word that is no number the line has the three numbers of a point, and nothing says what its columns are. */
bool input_guess_sees_numbers(const struct input *in, struct input_line line);
/* For a line that is no point: letters for --columns as a hint, where it has three numbers, and is the first one of its file or
 * begins with a word that is no number. */
int input_guess_hint(const struct input *in, struct input_line line, struct err *err);

/* ---- numbers as multiples (input_place.c) ---- */

/* Sets the units of the raw numbers: input_xyz.place and info.coords. -ERR_INPUT: the numbers are too large. */
int input_places_choose(struct input *in, const struct input_extent axis[3], struct err *err);
/* The same of a pipe, of which only the first numbers are known. */
int input_places_forward(struct input *in, const struct input_extent axis[3], struct err *err);
bool input_place_round(const struct input_place *, const struct input_number *, int64_t *ret);

/* A number as a multiple of the unit. False: it is none, or too large. */
static inline bool input_place_raw(const struct input_place *unit, const struct input_number *n, int64_t *ret)
{
	int64_t v = n->mantissa;
	int places = n->exponent - unit->scale.exponent;

	if (!v) {
		*ret = 0;
		return true;
	}
	if (unit->scale.mantissa != 1 || n->deep || places < 0 || places > 18)
		return unit->rounding != INPUT_EXACT && input_place_round(unit, n, ret);
	for (; places; places--)
		if (__builtin_mul_overflow(v, 10, &v))
			return false;
	*ret = v;
	return true;
}

/* Finds the meaning of the columns. Reads the first lines. */
int input_columns_look(struct input *in, struct err *err);
/* The line is one whole number and nothing else. */
bool input_line_is_count(struct input_line line, uint64_t *ret);

/* One number at *at, up to `end`, as a multiple of 10^-places, rounded half away from zero; *at moves behind it.
 * INPUT_NUMBER_TOO_LONG: beyond `most`, of either sign. */
enum input_number_state input_fixed_read(const char **at, const char *end, int places, int64_t most, int64_t *ret);

#endif
