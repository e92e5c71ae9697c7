/* Texts of files that prescribe their characters. */
#ifndef FORMAT_TEXT_H
#define FORMAT_TEXT_H

#include <stddef.h>

enum format_text {
	FORMAT_TEXT_XML,   /* of an attribute */
	FORMAT_TEXT_JSON,  /* of a string, without its quotes */
	FORMAT_TEXT_ASCII, /* a line */
};
#define FORMAT_TEXT_GROWTH 6 /* bytes of one at most */

/* `from` as one line of valid characters: what cannot be written becomes '?', control characters become spaces. At most size - 1
 * bytes, and no part of a character. Returns `to`. */
char *format_text(enum format_text, const char *from, char *to, size_t size);

#endif
