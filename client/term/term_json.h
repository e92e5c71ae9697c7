/* JSON out, a line an object: keys in the order of the calls, texts made valid UTF-8. */
#ifndef TERM_JSON_H
#define TERM_JSON_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

/* list: its lines go out together, not each at once. */
struct term_json {
	FILE *out;
	bool comma, list;
};

/*
 * A list has a million keys, and nearly all are literals: the compiler knows their lengths and that they need no escape. The
 * length of others is TERM_JSON_UNKNOWN.
 */
#define TERM_JSON_UNKNOWN SIZE_MAX
static inline __attribute__((always_inline)) size_t term_json_length(const char *key)
{
	if (!key || !__builtin_constant_p(strlen(key)) || strlen(key) > 64 || strpbrk(key, "\"\\"))
		return TERM_JSON_UNKNOWN;
	return strlen(key);
}
#define TERM_JSON_KEY(key) (key), term_json_length(key)

/* Keys are NULL inside lists. NULL texts become null. */
void term_json_put_open(struct term_json *, const char *key, size_t n, char bracket);
void term_json_close(struct term_json *, char bracket);
void term_json_put_text(struct term_json *, const char *key, size_t n, const char *text);
void term_json_put_known(struct term_json *, const char *key, size_t n, const char *text); /* "" and "unknown" are null too */
void term_json_put_u64(struct term_json *, const char *key, size_t n, uint64_t v);
void term_json_put_i64(struct term_json *, const char *key, size_t n, int64_t v);
void term_json_put_known_u64(struct term_json *, const char *key, size_t n, uint64_t v); /* 0 is null */
void term_json_put_number(struct term_json *, const char *key, size_t n, double v);      /* not finite: null */
void term_json_put_time(struct term_json *, const char *key, size_t n, int64_t us);      /* ISO 8601; 0: null */
void term_json_put_literal(struct term_json *, const char *key, size_t n, const char *text);
void term_json_put_numbers(struct term_json *, const char *key, size_t n, const double *v, size_t count); /* a list */
void term_json_put_null(struct term_json *, const char *key, size_t n);
void term_json_line(struct term_json *); /* ends the object's line */
/* An object that is a line: begins it, and ends it. */
struct term_json term_json_begin(FILE *, bool list);
void term_json_end(struct term_json *);

#define term_json_open(j, key, bracket) term_json_put_open(j, TERM_JSON_KEY(key), bracket)
#define term_json_text(j, key, text) term_json_put_text(j, TERM_JSON_KEY(key), text)
#define term_json_known(j, key, text) term_json_put_known(j, TERM_JSON_KEY(key), text)
#define term_json_u64(j, key, v) term_json_put_u64(j, TERM_JSON_KEY(key), v)
#define term_json_known_u64(j, key, v) term_json_put_known_u64(j, TERM_JSON_KEY(key), v)
#define term_json_i64(j, key, v) term_json_put_i64(j, TERM_JSON_KEY(key), v)
#define term_json_number(j, key, v) term_json_put_number(j, TERM_JSON_KEY(key), v)
#define term_json_numbers(j, key, v, count) term_json_put_numbers(j, TERM_JSON_KEY(key), v, count)
#define term_json_null(j, key) term_json_put_null(j, TERM_JSON_KEY(key))
#define term_json_time(j, key, us) term_json_put_time(j, TERM_JSON_KEY(key), us)
#define term_json_literal(j, key, text) term_json_put_literal(j, TERM_JSON_KEY(key), text)
#define term_json_bool(j, key, v) term_json_literal(j, key, (v) ? "true" : "false")

#endif
