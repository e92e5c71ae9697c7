/* JSON (RFC 8259) piece by piece from a file of any size: no tree is built, and numbers keep their digits. */
#ifndef JSON_READER_H
#define JSON_READER_H

#include "text_source.h"

enum { JSON_READER_TOKEN = 512 };

struct json_reader {
	const char *hint; /* of its errors; a static text */
	struct text_source source;
};

/* -ERR_INPUT at the next byte, or why it could not be read. */
__attribute__((format(printf, 2, 3))) int json_reader_bad(struct json_reader *, const char *fmt, ...);
/* The next byte that is no blank, not taken; -1: there is none, which may be a failure (source.rc). */
int json_reader_peek(struct json_reader *);
/* Takes this byte. */
int json_reader_take(struct json_reader *, char c);
/* Inside [] or {}, before a member: *ret_more false: it was the end, which is taken. *first is true before the first one. */
int json_reader_more(struct json_reader *, char end, bool *first, bool *ret_more);
/* A text, as UTF-8; what does not fit is left out. */
int json_reader_string(struct json_reader *, char *ret, size_t size);
/* A key and its colon. */
int json_reader_key(struct json_reader *, char *ret, size_t size);
/* A number or a bare word. */
int json_reader_token(struct json_reader *, char ret[JSON_READER_TOKEN]);
/* A value of any kind. */
int json_reader_skip(struct json_reader *);

#endif
