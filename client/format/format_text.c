/* See format_text.h. */
#include "format_text.h"

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "utf8.h"

static const char *escape(enum format_text kind, char c)
{
	if (kind == FORMAT_TEXT_JSON)
		return c == '"' ? "\\\"" : c == '\\' ? "\\\\" : NULL;
	if (kind != FORMAT_TEXT_XML)
		return NULL;
	return c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '>' ? "&gt;" : c == '"' ? "&quot;" : NULL;
}

/* Valid UTF-8 that is no character of XML. */
static bool no_character(const char *at, size_t length)
{
	return length == 3 && utf8_code(at, length) >= 0xfffe;
}

char *format_text(enum format_text kind, const char *from, char *to, size_t size)
{
	char *at = to, *end = to + size - 1;

	while (*from) {
		size_t whole = utf8_length(from, SIZE_MAX), n = utf8_printable(from, SIZE_MAX);
		const char *put = from, *other = NULL;

		if (!n)
			other = whole ? " " : "?";
		else if (n == 1)
			other = escape(kind, *from);
		else if (kind == FORMAT_TEXT_ASCII || no_character(from, n))
			other = "?";
		from += whole ? whole : 1;
		if (other) {
			put = other;
			n = strlen(other);
		}
		if ((size_t)(end - at) < n)
			break;
		memcpy(at, put, n);
		at += n;
	}
	*at = 0;
	return to;
}
