/* Errors, for people and for scripts: the same texts in every program. */
#ifndef TERM_ERROR_H
#define TERM_ERROR_H

#include "term_json.h"
#include "err.h"

/* {"code", "file", "offset", "field", "message", "hint"} under `key`; null without an error. */
void term_error_json(struct term_json *, const char *key, const struct err *);
/* On stderr: "PROGRAM: FILE: byte N, FIELD: MESSAGE", then "hint: ..." if there is one. */
void term_error_text(const char *program, const struct err *);

#endif
