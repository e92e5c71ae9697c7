/* Text and PTX. */
#ifndef INPUT_TEXT_H
#define INPUT_TEXT_H

#include "input_reader.h"

/* The letters of --columns; NULL is fine. -ERR_USAGE. */
int input_columns_check(const char *text, struct err *err);
/* The first bytes of a file: those of UTF-16 become UTF-8, which takes at most half as many more. Returns how many they are. */
size_t input_encoding_sniff(uint8_t *buffer, size_t n);
/* No byte is one that texts do not have. */
bool input_text_is(const uint8_t *bytes, size_t n);

#endif
