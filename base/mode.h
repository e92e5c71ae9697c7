/*
 * Modes like those of files: nine bits, for owner, group and others: read, write and (meaningless for a dataset)
 * execute.
 */
#ifndef MODE_H
#define MODE_H

#include <stdint.h>

struct err;

enum { MODE_ALL = 0777, MODE_TEXT_SIZE = 10 };

/* "640", "0640", or as for chmod: "g+w,o=", "u=rwX". `old`: the mode that a symbolic one changes. `mask`: bits that a
 * symbolic mode without u, g, o ("+w") does not change. -ERR_USAGE. */
int mode_parse(const char *text, uint32_t old, uint32_t mask, uint32_t *ret, struct err *err);
/* "rw-r-----". Returns buf, of MODE_TEXT_SIZE bytes. */
char *mode_text(uint32_t mode, char *buf);

#endif
