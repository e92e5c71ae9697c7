/* JSON out, a line an object: keys in the order of the calls, texts made valid UTF-8. */
#ifndef CTL_JSON_H
#define CTL_JSON_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

/* list: its lines go out together, not each at once. */
struct ctl_json { FILE *out; bool comma, list; };
/* Keys are NULL inside lists. NULL texts become null. */
void ctl_json_open(struct ctl_json *, const char *key, char bracket);
void ctl_json_close(struct ctl_json *, char bracket);
void ctl_json_text(struct ctl_json *, const char *key, const char *text);
void ctl_json_known(struct ctl_json *, const char *key, const char *text); /* "" and "unknown" are null too */
void ctl_json_u64(struct ctl_json *, const char *key, uint64_t n);
void ctl_json_i64(struct ctl_json *, const char *key, int64_t n);
void ctl_json_number(struct ctl_json *, const char *key, double v); /* not finite: null */
void ctl_json_literal(struct ctl_json *, const char *key, const char *text);
void ctl_json_bool(struct ctl_json *, const char *key, bool v);
void ctl_json_line(struct ctl_json *); /* ends the object's line */

#endif
