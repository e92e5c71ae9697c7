/* JSON (RFC 8259) piece by piece from a file of any size: no tree is built, and numbers keep their digits. */
#ifndef LINES_JSON_H
#define LINES_JSON_H

#include "lines_priv.h"

enum { LINES_JSON_TOKEN = 512 };

struct lines_json {
	struct lines *l;
	struct lines_source source;
};

/* -ERR_INPUT at the next byte. */
__attribute__((format(printf, 2, 3))) int lines_json_bad(struct lines_json *, const char *fmt, ...);
/* The next byte that is no blank, not taken; -1: there is none, which may be a failure (source.rc). */
int lines_json_peek(struct lines_json *);
/* Takes this byte. */
int lines_json_take(struct lines_json *, char c);
/* Inside [] or {}, before a member: *ret_more false: it was the end, which is taken. *first is true before the first one. */
int lines_json_more(struct lines_json *, char end, bool *first, bool *ret_more);
/* A text, as UTF-8; what does not fit is left out. */
int lines_json_string(struct lines_json *, char *ret, size_t size);
/* A key and its colon. */
int lines_json_key(struct lines_json *, char *ret, size_t size);
/* A number or a bare word. */
int lines_json_token(struct lines_json *, char ret[LINES_JSON_TOKEN]);
/* A value of any kind. */
int lines_json_skip(struct lines_json *);

#endif
