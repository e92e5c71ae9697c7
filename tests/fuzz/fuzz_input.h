/* What the fuzz targets share beside tests/proto/fuzz.h. */
#ifndef FUZZ_INPUT_H
#define FUZZ_INPUT_H

#include "err.h"
#include "fuzz.h"
#include "input.h"

/* Opens the bytes as an input and reads all of its points, then its parts one by one: as many points, or the
 * same error. Aborts on what no bytes may do: a failure without a sentence or a file's name, more points than
 * claimed, memory that does not fit. */
void fuzz_input_read(const uint8_t *bytes, size_t size, const char *name, const struct input_options *options);
/* A file of these bytes; the same one at each call. */
int fuzz_input_fd(const void *bytes, size_t size);
/* Aborts if a failure says nothing. */
void fuzz_input_check(int rc, const struct err *err);
/* For fuzz_seed: the i-th of n texts. */
size_t fuzz_input_text(const char *const *texts, size_t n, unsigned i, uint8_t *bytes, size_t room);

#endif
