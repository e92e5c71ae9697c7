/* The length and code of a UTF-8 character. What to do with invalid bytes is left to the caller. */
#include "utf8.h"

#include <string.h>

size_t utf8_length(const void *s, size_t left)
{
	const uint8_t *p = s;
	size_t n;

	if (!left)
		return 0;
	n = p[0] < 0x80 ? 1 : p[0] < 0xc2 ? 0 : p[0] < 0xe0 ? 2 : p[0] < 0xf0 ? 3 : p[0] < 0xf5 ? 4 : 0;
	if (n > left)
		return 0;
	for (size_t i = 1; i < n; i++)
		if ((p[i] & 0xc0) != 0x80)
			return 0;
	if ((p[0] == 0xe0 && p[1] < 0xa0) || (p[0] == 0xed && p[1] > 0x9f) || (p[0] == 0xf0 && p[1] < 0x90) ||
	    (p[0] == 0xf4 && p[1] > 0x8f))
		return 0; /* overlong, a surrogate, beyond U+10FFFF */
	return n;
}

size_t utf8_printable(const void *s, size_t left)
{
	const uint8_t *p = s;
	size_t n = utf8_length(s, left);

	if (n == 1 && (p[0] < 0x20 || p[0] == 0x7f))
		return 0;
	return n == 2 && p[0] == 0xc2 && p[1] < 0xa0 ? 0 : n;
}

uint32_t utf8_code(const void *s, size_t length)
{
	const uint8_t *p = s;
	uint32_t c = length == 1 ? p[0] : p[0] & (0xffu >> (length + 1));

	for (size_t i = 1; i < length; i++)
		c = c << 6 | (p[i] & 0x3fu);
	return c;
}

const char *utf8_end(const char *text, size_t most)
{
	size_t size = strlen(text);
	const char *end = size > most ? text + size - most : text;

	while ((*end & 0xC0) == 0x80) /* the middle of a character */
		end++;
	return end;
}
