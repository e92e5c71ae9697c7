/* An error as it is told: to a person, and to a script. The same words whichever program says them. */
#ifndef CTL_TOLD_H
#define CTL_TOLD_H

#include "ctl_json.h"
#include "err.h"

/* {"code", "file", "offset", "field", "message", "hint"} under `key`. */
void ctl_error_json(struct ctl_json *, const char *key, const struct err *);
/* On stderr: "PROGRAM: FILE: byte N, FIELD: MESSAGE", then "hint: ..." if there is one. */
void ctl_error_text(const char *program, const struct err *);

#endif
