/*
 * The tokens of JSON (json_reader.h).
 *
 * A library as json-c holds the whole document at once, with some 400 bytes for each position of a geometry, ten times what the
 * position takes. Here only one token is held. It is as strict as a reader must be that does not lose its place: brackets, commas
 * and quotes.
 */
#include "json_reader.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "err.h"

enum { NEST_MOST = 64 };

int json_reader_bad(struct json_reader *j, const char *fmt, ...)
{
	char text[256], where[32];
	struct err *err = j->source.err;
	va_list ap;

	if (j->source.rc)
		return j->source.rc;
	va_start(ap, fmt);
	vsnprintf(text, sizeof text, fmt, ap);
	va_end(ap);
	snprintf(where, sizeof where, "byte %" PRIu64, text_source_at(&j->source));
	err_set(err, ERR_INPUT, "%s", text);
	err_add_hint(err, "%s", j->hint);
	return err_add_place(err, ERR_NO_OFFSET, where);
}

int json_reader_peek(struct json_reader *j)
{
	int c;

	while ((c = text_source_peek(&j->source)) == ' ' || c == '\t' || c == '\n' || c == '\r')
		text_source_take(&j->source);
	return c;
}

int json_reader_take(struct json_reader *j, char c)
{
	int got = json_reader_peek(j);

	if (got == c) {
		text_source_take(&j->source);
		return 0;
	}
	return got < 0 ? json_reader_bad(j, "it ends where a %c should stand", c) :
			 json_reader_bad(j, "a %c should stand here", c);
}

int json_reader_more(struct json_reader *j, char end, bool *first, bool *ret_more)
{
	int c = json_reader_peek(j);

	*ret_more = c != end;
	if (c == end) {
		text_source_take(&j->source);
		return 0;
	}
	if (c < 0)
		return json_reader_bad(j, "it ends where a %c should stand", end);
	if (!*first)
		return json_reader_take(j, ',');
	*first = false;
	return 0;
}

static int hex(struct json_reader *j, uint32_t *ret)
{
	*ret = 0;
	for (int i = 0; i < 4; i++) {
		int c = text_source_take(&j->source), digit = c >= '0' && c <= '9'                   ? c - '0' :
							      (c | 0x20) >= 'a' && (c | 0x20) <= 'f' ? (c | 0x20) - 'a' + 10 :
												       -1;

		if (digit < 0)
			return json_reader_bad(j, "an escape has no four hexadecimal digits");
		*ret = *ret << 4 | (uint32_t)digit;
	}
	return 0;
}

/* Behind a backslash and a u: one character, of two escapes if it is beyond U+FFFF. A half alone becomes U+FFFD. */
static int escaped(struct json_reader *j, char ret[4], size_t *ret_n)
{
	uint32_t c, low = 0;
	int rc = hex(j, &c);

	if (!rc && c >= 0xd800 && c < 0xdc00 && text_source_peek(&j->source) == '\\') {
		text_source_take(&j->source);
		if (text_source_take(&j->source) != 'u')
			return json_reader_bad(j, "half of a character has no other half");
		rc = hex(j, &low);
		c = low >= 0xdc00 && low < 0xe000 ? 0x10000 + ((c & 0x3ff) << 10) + (low & 0x3ff) : 0xfffd;
	}
	if ((c >= 0xd800 && c < 0xe000) || !c) /* a zero would end the text */
		c = 0xfffd;
	if (c < 0x80) {
		ret[0] = (char)c;
		*ret_n = 1;
	} else if (c < 0x800) {
		ret[0] = (char)(0xc0 | c >> 6);
		*ret_n = 2;
	} else if (c < 0x10000) {
		ret[0] = (char)(0xe0 | c >> 12);
		*ret_n = 3;
	} else {
		ret[0] = (char)(0xf0 | c >> 18);
		*ret_n = 4;
	}
	for (size_t i = 1; i < *ret_n; i++)
		ret[i] = (char)(0x80 | (c >> 6 * (*ret_n - 1 - i) & 0x3f));
	return rc;
}

int json_reader_string(struct json_reader *j, char *ret, size_t size)
{
	static const char plain[] = "\"\"\\\\//b\bf\fn\nr\rt\t";
	int rc = json_reader_take(j, '"'), c;
	size_t out = 0;

	*ret = 0;
	while (!rc && (c = text_source_take(&j->source)) != '"') {
		char one[4] = {(char)c};
		size_t n = 1;

		if (c < 0)
			return json_reader_bad(j, "it ends within a text");
		if (c == '\\') {
			c = text_source_take(&j->source);
			if (c == 'u') {
				rc = escaped(j, one, &n);
			} else {
				const char *p = plain;

				while (*p && *p != c)
					p += 2;
				if (!*p)
					return json_reader_bad(j, "an escape is none of JSON");
				one[0] = p[1];
			}
		}
		if (out + n < size) {
			memcpy(ret + out, one, n);
			out += n;
		} else {
			size = out + 1; /* no later piece either */
		}
	}
	ret[out] = 0;
	return rc;
}

int json_reader_key(struct json_reader *j, char *ret, size_t size)
{
	int rc = json_reader_string(j, ret, size);

	return rc ? rc : json_reader_take(j, ':');
}

static bool is_word(int c)
{
	return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '-' || c == '+' || c == '.';
}

int json_reader_token(struct json_reader *j, char ret[JSON_READER_TOKEN])
{
	size_t n = 0;

	json_reader_peek(j);
	while (is_word(text_source_peek(&j->source))) {
		if (n + 1 == JSON_READER_TOKEN)
			return json_reader_bad(j, "a number has more than %d bytes", JSON_READER_TOKEN - 1);
		ret[n++] = (char)text_source_take(&j->source);
	}
	ret[n] = 0;
	return n ? 0 :
		   json_reader_bad(j, text_source_peek(&j->source) < 0 ? "it ends where a value should stand" :
									 "a value should stand here");
}

static int skip(struct json_reader *j, int nest)
{
	char word[JSON_READER_TOKEN];
	int c = json_reader_peek(j), rc = 0;
	bool first = true, more;
	char end = c == '{' ? '}' : ']';

	if (c == '"')
		return json_reader_string(j, word, 1);
	if (c != '{' && c != '[')
		return json_reader_token(j, word);
	if (nest == NEST_MOST)
		return json_reader_bad(j, "lists and objects lie in each other more than %d deep", NEST_MOST);
	text_source_take(&j->source);
	while (!(rc = json_reader_more(j, end, &first, &more)) && more) {
		if (end == '}')
			rc = json_reader_key(j, word, 1);
		if (!rc)
			rc = skip(j, nest + 1);
		if (rc)
			break;
	}
	return rc;
}

int json_reader_skip(struct json_reader *j)
{
	return skip(j, 0);
}
