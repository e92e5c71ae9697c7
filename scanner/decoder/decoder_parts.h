/* The functions of the families, for the table. Internal. */
#ifndef DECODER_PARTS_H
#define DECODER_PARTS_H

#include "decoder.h"

int decoder_cola(const uint8_t *at, size_t size, const struct profile *, struct sweep *ret, struct err *);
int decoder_cola_check(const struct profile *, struct err *);
int decoder_ranges(const uint8_t *at, size_t size, const struct profile *, struct sweep *ret, struct err *);
int decoder_ranges_check(const struct profile *, struct err *);
int decoder_xyz(const uint8_t *at, size_t size, const struct profile *, struct sweep *ret, struct err *);
int decoder_xyz_check(const struct profile *, struct err *);

/* Sets -ERR_INPUT at this byte of the telegram. */
int decoder_bad(struct err *, size_t at, const char *fmt, ...) __attribute__((format(printf, 3, 4)));

#endif
