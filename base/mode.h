/*
 * Modes as files have them: nine bits, of owner, group and others, each reading, writing and (without a meaning for a
 * dataset) running.
 */
#ifndef MODE_H
#define MODE_H

#include <stdint.h>

struct err;

enum { MODE_ALL = 0777, MODE_TEXT_SIZE = 10 };

/* "640", "0640", or as chmod takes it: "g+w,o=", "u=rwX". `old` is what a symbolic one changes. `mask`: bits of a
 * symbolic one that names nobody ("+w") do not touch those of it. -ERR_USAGE. */
int mode_parse(const char *text, uint32_t old, uint32_t mask, uint32_t *ret, struct err *err);
/* "rw-r-----". Returns buf, of MODE_TEXT_SIZE bytes. */
char *mode_text(uint32_t mode, char *buf);

#endif
