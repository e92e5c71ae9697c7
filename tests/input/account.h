/*
 * Counts the bytes that a test program allocates: malloc and similar functions are wrapped by the linker (see meson.build), so
 * that it works under the address sanitizer too. Freed bytes are not subtracted: account_taken is an upper bound of the
 * memory that was held at any time since account_begin.
 */
#ifndef ACCOUNT_H
#define ACCOUNT_H

#include <stddef.h>
#include <stdint.h>

void account_begin(void);
size_t account_taken(void);
/* Bytes read through the table of file calls since account_begin: work that a file makes, without a clock. */
uint64_t account_read(void);

#endif
