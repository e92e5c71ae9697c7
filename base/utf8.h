/* UTF-8 characters, in bytes that may be invalid (Unicode 15, table 3-7: shortest form, no surrogates, up to U+10FFFF). */
#ifndef UTF8_H
#define UTF8_H

#include <stddef.h>
#include <stdint.h>

/* Length of the character at `s`, of which `left` bytes exist; 0: invalid. In a zero-terminated string `left` can be
 * SIZE_MAX: nothing after the zero is read. */
size_t utf8_length(const void *s, size_t left);
/* The same, but 0 also for a control character (C0, DEL, and C1, which some terminals obey). */
size_t utf8_printable(const void *s, size_t left);
/* The code of the character at `s`, whose utf8_length is `length`. */
uint32_t utf8_code(const void *s, size_t length);
/* The last characters of a valid text, in at most `most` bytes. */
const char *utf8_end(const char *text, size_t most);

#endif
