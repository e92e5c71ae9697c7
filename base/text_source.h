/* Bytes of a text forwards, with a place to return to: of a file of any size, of which one buffer is held, or of memory. */
#ifndef TEXT_SOURCE_H
#define TEXT_SOURCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;

enum { TEXT_SOURCE_BUFFER = 1 << 16 };

struct text_source {
	int fd; /* -1: all of it is in `bytes` */
	const char *name;
	int (*interrupted)(void *ctx); /* NULL, or asked now and then: not 0 ends the reading, -ERR_CANCELLED */
	void *ctx;
	uint64_t start, line; /* of `bytes` in the text; the line of the next byte, from 1 */
	size_t i, n;
	bool ended;
	struct err *err; /* of the call that reads */
	int rc;          /* 0, or why there are no more bytes */
	const uint8_t *bytes;
	uint8_t buffer[TEXT_SOURCE_BUFFER];
};

/* The file, and its name for errors, stay the caller's. */
void text_source_file(struct text_source *, int fd, const char *name, struct err *err);
void text_source_memory(struct text_source *, const char *text, size_t n, struct err *err);
int text_source_fill(struct text_source *); /* the next byte, -1 at the end or after a failure */
/* The byte order mark of UTF-8, if it is next. */
void text_source_skip_mark(struct text_source *);
void text_source_seek(struct text_source *, uint64_t at, uint64_t line);

static inline uint64_t text_source_at(const struct text_source *s)
{
	return s->start + s->i;
}

/* The next byte, not taken; -1 at the end or after a failure (s->rc). */
static inline int text_source_peek(struct text_source *s)
{
	return s->i < s->n ? s->bytes[s->i] : text_source_fill(s);
}

static inline int text_source_take(struct text_source *s)
{
	int c = text_source_peek(s);

	s->i += c >= 0;
	s->line += c == '\n';
	return c;
}

/* The next line without its end, and without zero bytes. *ret_n SIZE_MAX: there is none. What does not fit into `room` is left
 * out, as *ret_cut says. */
int text_source_line(struct text_source *, char *to, size_t room, size_t *ret_n, bool *ret_cut);

#endif
