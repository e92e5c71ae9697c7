/*
 * Lines of numbers. This only tests whether a line is one of points: the columns x, y and z must be numbers by the
 * rules of acut's text reader (one kind of separator in a line), because the reader rejects a whole text for one
 * invalid line. The line itself is passed to the reader unchanged, which converts it.
 */
#include <ctype.h>
#include <string.h>
#include <strings.h>

#include "decoder_parts.h"
#include "err.h"
#include "parse.h"
#include "profile.h"

enum { NUMBER_MAX = 64 };

/* [+-]digits[.digits], with digits on at least one side of the point. Other numbers take the slow path. */
static bool is_plain(const uint8_t *at, size_t size)
{
	size_t i = at[0] == '-' || at[0] == '+', points = 0, start = i;

	for (; i < size; i++) {
		if (at[i] == '.')
			points++;
		else if (at[i] < '0' || at[i] > '9')
			return false;
	}
	return points < 2 && size - start > points;
}

/* At most 18 digits between the first and the last that is not 0, at places from 10^18 to 10^-15: what the reader keeps
 * exactly. */
static bool is_kept(const uint8_t *at, size_t size)
{
	int n = 0, whole = -1, first = -1, last = -1, exponent = 0;
	size_t i;

	for (i = 0; i < size && (at[i] | 0x20) != 'e'; i++) {
		if (at[i] == '.')
			whole = n;
		if (!isdigit(at[i]))
			continue;
		if (at[i] != '0') {
			first = first < 0 ? n : first;
			last = n;
		}
		n++;
	}
	if (first < 0)
		return true;
	for (size_t k = i + 1; k < size && exponent < 1000; k++)
		if (isdigit(at[k]))
			exponent = 10 * exponent + at[k] - '0';
	if (i + 1 < size && at[i + 1] == '-')
		exponent = -exponent;
	whole = (whole < 0 ? n : whole) + exponent;
	return last - first < 18 && whole - 1 - last >= -15 && whole - 1 - first <= 18;
}

static bool is_number(const uint8_t *at, size_t size)
{
	char text[NUMBER_MAX + 1];
	double v;

	if (!size || size > NUMBER_MAX || memchr(at, 0, size))
		return false;
	if (is_plain(at, size))
		return size <= 15 || is_kept(at, size);
	memcpy(text, at, size);
	text[size] = '\0';
	return parse_double(text, &v) && is_kept(at, size);
}

/* "nan" and "inf" are not words: they mean a point without a position. */
static bool is_word(const uint8_t *at, size_t size)
{
	static const char *const numbers[] = {"nan", "inf", "infinity"};
	size_t n = 0;

	while (n < size && isalpha(at[n]))
		n++;
	for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
		if (n == strlen(numbers[i]) && !strncasecmp((const char *)at, numbers[i], n))
			return false;
	return n > 0;
}

/* Words instead of numbers: names of columns, or a message of the device. */
static int reject_words(const uint8_t *at, size_t from, size_t size, struct err *err)
{
	for (size_t i = from; i < size; i++)
		if (at[i] < ' ' && at[i] != '\t')
			return decoder_bad(err, i, "a control character in a line");
	return DECODER_NOT_DATA;
}

static size_t skip_blanks(const uint8_t *at, size_t pos, size_t size)
{
	while (pos < size && (at[pos] == ' ' || at[pos] == '\t'))
		pos++;
	return pos;
}

/* After a column: one separator, of the line's kind (0: none yet). false: another kind. */
static bool skip_separator(const uint8_t *at, size_t size, bool last, char *kind, size_t *pos)
{
	size_t after = skip_blanks(at, *pos, size);
	char found = after < size && (at[after] == ',' || at[after] == ';') ? (char)at[after] : ' ';
	bool good = after == size || (last && found == ' ') || !*kind || *kind == found;

	if (good && after < size && !(last && found == ' '))
		*kind = found;
	*pos = found == ' ' ? after : skip_blanks(at, after + 1, size);
	return good;
}

static size_t column_end(const uint8_t *at, size_t pos, size_t size, bool skipped, char kind)
{
	const uint8_t *quote = skipped && at[pos] == '"' ? memchr(at + pos + 1, '"', size - pos - 1) : NULL;

	if (quote)
		return (size_t)(quote - at) + 1;
	while (pos < size && at[pos] != ',' && at[pos] != ';' &&
	       ((at[pos] != ' ' && at[pos] != '\t') || (skipped && kind && kind != ' ')))
		pos++;
	return pos;
}

/* "1,5, 2,5, 3,5": whole numbers, and only some commas have a blank after them. */
static bool uneven_commas(const uint8_t *at, size_t size)
{
	bool blank = false, tight = false;

	for (size_t i = 1; i + 1 < size; i++)
		if (at[i] == ',' && isdigit(at[i - 1])) {
			blank |= at[i + 1] == ' ' || at[i + 1] == '\t';
			tight |= isdigit(at[i + 1]) != 0;
		}
	return blank && tight && !memchr(at, '.', size);
}

static bool is_skipped(char c)
{
	return c == '_' || c == 's' || c == '-';
}

int decoder_xyz(const uint8_t *at, size_t size, const struct profile *p, struct sweep *ret, struct err *err)
{
	size_t pos = skip_blanks(at, 0, size), numbers = 0;
	char kind = 0;
	bool word;

	/* Blank lines and comments. */
	if (pos == size || at[pos] == '#' || at[pos] == '%' || (at[pos] == '/' && pos + 1 < size && at[pos + 1] == '/'))
		return DECODER_NOT_DATA;
	word = is_word(at + pos, size - pos) && size < 1024;
	for (const char *c = p->columns; *c; c++) {
		size_t start = pos;

		if (pos == size)
			return word && !numbers ? reject_words(at, 0, size, err) :
						  decoder_bad(err, start, "ends before column %c", *c);
		pos = column_end(at, pos, size, is_skipped(*c), kind);
		if (!is_skipped(*c) && !is_number(at + start, pos - start)) {
			if (word && !numbers) /* a skipped column may be a word, with numbers after it */
				return reject_words(at, start, size, err);
			return decoder_bad(err, start, "column %c is no number", *c);
		}
		numbers += !is_skipped(*c);
		if (!skip_separator(at, size, !c[1], &kind, &pos))
			return decoder_bad(err, pos, "two kinds of separators, or decimal commas");
	}
	if (memchr(at, '\r', size) || (kind == ',' && uneven_commas(at, size)))
		return decoder_bad(err, 0, kind == ',' ? "decimal commas, it seems" : "a carriage return in a line");
	return 0;
}

int decoder_xyz_check(const struct profile *p, struct err *err)
{
	static const char letters[] = "xyzcrns_-itaupRGB"; /* as in acutctl --columns, except e */
	const char *text = NULL;

	if (p->framer != PROFILE_FRAMER_LINE)
		text = "decoder xyz needs [framer] kind = line";
	else if (!strchr(p->columns, 'x') || !strchr(p->columns, 'y') || !strchr(p->columns, 'z'))
		text = "columns: x, y and z are needed";
	else if (strspn(p->columns, letters) != strlen(p->columns))
		text = "columns: there is no such letter";
	for (const char *c = p->columns; !text && *c; c++)
		if (strchr("xyzcrn", *c) && strchr(c + 1, *c))
			text = "columns: a letter stands twice";
	if (!text && !strchr(p->columns, 'r') != !strchr(p->columns, 'n'))
		text = "columns: r and n go together";
	if (!text)
		return 0;
	err_set(err, ERR_INPUT, "%s", text);
	return err_add_place(err, ERR_NO_OFFSET, p->framer == PROFILE_FRAMER_LINE ? "columns" : "kind");
}
