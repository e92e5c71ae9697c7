/*
 * Lines of numbers. It says only whether a line is one of points: numbers where the columns x, y and z are. What they mean,
 * to the last digit, is said by acut's reader of texts, to which the line goes as it is.
 */
#include <ctype.h>
#include <string.h>
#include <strings.h>

#include "decoder_parts.h"
#include "err.h"
#include "parse.h"
#include "profile.h"

enum { NUMBER_MAX = 64 };

static bool is_separator(uint8_t c) { return c == ' ' || c == '\t' || c == ',' || c == ';'; }

/* [+-]digits[.digits], digits on one side of the point at least; what else may be a number goes the long way. */
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

static bool is_number(const uint8_t *at, size_t size)
{
	char text[NUMBER_MAX + 1];
	double v;

	if (!size || size > NUMBER_MAX || memchr(at, 0, size))
		return false;
	if (is_plain(at, size))
		return true;
	memcpy(text, at, size);
	text[size] = '\0';
	return parse_double(text, &v);
}

/* "nan" and "inf" are no words: whoever sends them means a point, which has no place. */
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

/* Words in place of numbers: names of columns, a message of the device. */
static int words(const uint8_t *at, size_t from, size_t size, struct err *err)
{
	for (size_t i = from; i < size; i++)
		if (at[i] < ' ' && at[i] != '\t')
			return decoder_bad(err, i, "a control character in a line");
	return DECODER_NOT_DATA;
}

int decoder_xyz(const uint8_t *at, size_t size, const struct profile *p, struct sweep *ret, struct err *err)
{
	size_t pos = 0, numbers = 0;
	bool word;

	while (pos < size && is_separator(at[pos]) && at[pos] != ',' && at[pos] != ';')
		pos++;
	/* Blank lines and comments. */
	if (pos == size || at[pos] == '#' || (at[pos] == '/' && pos + 1 < size && at[pos + 1] == '/'))
		return DECODER_NOT_DATA;
	word = is_word(at + pos, size - pos) && size < 1024;
	for (const char *c = p->columns; *c; c++) {
		size_t start = pos;

		while (pos < size && !is_separator(at[pos]))
			pos++;
		if (*c != '_' && *c != 's' && *c != '-' && !is_number(at + start, pos - start)) {
			if (word && !numbers) /* a column that is skipped may be a word, with numbers behind it */
				return words(at, start, size, err);
			if (pos > start)
				return decoder_bad(err, start, "column %c is no number", *c);
		} else if (pos > start) {
			numbers += *c != '_' && *c != 's' && *c != '-';
		}
		if (pos == start)
			return decoder_bad(err, start, "ends before column %c", *c);
		while (pos < size && (at[pos] == ' ' || at[pos] == '\t'))
			pos++;
		if (pos < size && (at[pos] == ',' || at[pos] == ';'))
			pos++;
		while (pos < size && (at[pos] == ' ' || at[pos] == '\t'))
			pos++;
	}
	return 0;
}

int decoder_xyz_check(const struct profile *p, struct err *err)
{
	static const char letters[] = "xyzcrns_-itaupRGB"; /* as acutctl --columns has them */
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
