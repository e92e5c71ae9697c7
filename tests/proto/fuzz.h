/* The functions of a fuzz target; fuzz_driver.c or clang's fuzzer runs it. */
#ifndef FUZZ_H
#define FUZZ_H

#include <stddef.h>
#include <stdint.h>

/* Must return 0; the sanitizers find crashes and leaks. */
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);
/* The i-th valid input, into `bytes`; returns its size. */
size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room);

#endif
