/* Characters of UTF-8, in bytes that may be none (Unicode 15, table 3-7: shortest form, no surrogates, up to U+10FFFF). */
#ifndef UTF8_H
#define UTF8_H

#include <stddef.h>
#include <stdint.h>

/* Bytes of the character at `s`, where `left` bytes are; 0: there is none. In what ends with a zero byte, SIZE_MAX will do:
 * nothing behind that byte is read. */
size_t utf8_length(const void *s, size_t left);
/* The same, but 0 for a control character too (C0, DEL, and C1, which some terminals obey). */
size_t utf8_printable(const void *s, size_t left);
/* The number of the character at `s`, whose utf8_length is `length`. */
uint32_t utf8_code(const void *s, size_t length);

#endif
