/* JSON out, a line an object: keys in the order of the calls, texts made valid UTF-8. */
#ifndef CTL_JSON_H
#define CTL_JSON_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

/* list: its lines go out together, not each at once. */
struct ctl_json {
	FILE *out;
	bool comma, list;
};

/*
 * A list has a million keys, and nearly all stand in the source: the compiler knows how long these are and that nothing in them
 * is to be escaped. Of others, CTL_JSON_LOOK.
 */
#define CTL_JSON_LOOK SIZE_MAX
static inline __attribute__((always_inline)) size_t ctl_json_length(const char *key)
{
	if (!key || !__builtin_constant_p(strlen(key)) || strlen(key) > 64 || strpbrk(key, "\"\\"))
		return CTL_JSON_LOOK;
	return strlen(key);
}
#define CTL_JSON_KEY(key) (key), ctl_json_length(key)

/* Keys are NULL inside lists. NULL texts become null. */
void ctl_json_put_open(struct ctl_json *, const char *key, size_t n, char bracket);
void ctl_json_close(struct ctl_json *, char bracket);
void ctl_json_put_text(struct ctl_json *, const char *key, size_t n, const char *text);
void ctl_json_put_known(struct ctl_json *, const char *key, size_t n, const char *text); /* "" and "unknown" are null too */
void ctl_json_put_u64(struct ctl_json *, const char *key, size_t n, uint64_t v);
void ctl_json_put_i64(struct ctl_json *, const char *key, size_t n, int64_t v);
void ctl_json_put_number(struct ctl_json *, const char *key, size_t n, double v); /* not finite: null */
void ctl_json_put_literal(struct ctl_json *, const char *key, size_t n, const char *text);
void ctl_json_line(struct ctl_json *); /* ends the object's line */

#define ctl_json_open(j, key, bracket) ctl_json_put_open(j, CTL_JSON_KEY(key), bracket)
#define ctl_json_text(j, key, text) ctl_json_put_text(j, CTL_JSON_KEY(key), text)
#define ctl_json_known(j, key, text) ctl_json_put_known(j, CTL_JSON_KEY(key), text)
#define ctl_json_u64(j, key, v) ctl_json_put_u64(j, CTL_JSON_KEY(key), v)
#define ctl_json_i64(j, key, v) ctl_json_put_i64(j, CTL_JSON_KEY(key), v)
#define ctl_json_number(j, key, v) ctl_json_put_number(j, CTL_JSON_KEY(key), v)
#define ctl_json_literal(j, key, text) ctl_json_put_literal(j, CTL_JSON_KEY(key), text)
#define ctl_json_bool(j, key, v) ctl_json_literal(j, key, (v) ? "true" : "false")

#endif
