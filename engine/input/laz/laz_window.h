/*
 * A window: the bytes [at, end) of a file, read forwards through a buffer of fixed size, as the entropy
 * decoder wants them.
 *
 * Between two calls of laz_window_ready a decoder may take up to LAZ_GUARD bytes without looking whether they
 * are there. Behind the last byte of the stream it gets zeros; that it went so far is noticed at the next
 * laz_window_ready or laz_window_check, and no record of a batch may be given away before laz_window_check.
 */
#ifndef LAZ_WINDOW_H
#define LAZ_WINDOW_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "laz.h"

/* LAZ_OPEN: the stream's end is not known; it ends where the source has no more bytes. */
enum { LAZ_GUARD = 256, LAZ_WINDOW_MIN = 4 * LAZ_GUARD };
#define LAZ_OPEN UINT64_MAX

#define laz_likely(x) __builtin_expect(!!(x), 1)
#define laz_unlikely(x) __builtin_expect(!!(x), 0)

/* The part of the decoder's state that each symbol changes; a loop over records keeps a copy in registers. */
struct laz_coder {
	const uint8_t *at;
	uint32_t value, length;
	uint32_t bad; /* not 0: no encoder writes such a stream */
};

/* A copy, number by number. What the last item of a record stored number by number is waited for if it is loaded in one piece. */
static inline __attribute__((always_inline)) struct laz_coder laz_coder_copy(const struct laz_coder *c)
{
	struct laz_coder copy = *c;

	__asm__("" : "+r"(copy.at), "+r"(copy.value), "+r"(copy.length), "+r"(copy.bad));
	return copy;
}

struct laz_window {
	struct laz_coder coder;
	const uint8_t *low;  /* coder.at beyond it: laz_window_ready has something to do */
	const uint8_t *stop; /* end of the stream's bytes in the buffer; LAZ_GUARD bytes can be read behind it */
	uint8_t *buffer;
	size_t size;        /* of the buffer, without the guard */
	uint64_t next, end; /* place in the file of *stop; where the stream ends */
	bool truncated;     /* the file ended before `end` */
	const struct laz_source *source;
	uint64_t *counter; /* bytes read */
	const char *field; /* what the stream holds, for messages */
};

/* Bytes of the buffer of a window of `size` bytes (at least LAZ_WINDOW_MIN). */
static inline size_t laz_window_bytes(size_t size)
{
	return size + LAZ_GUARD;
}
void laz_window_init(struct laz_window *, uint8_t *buffer, size_t size, const struct laz_source *, uint64_t *counter);
/* From now on the bytes [at, end); `field` is static text. Reads the first bytes. */
int laz_window_begin(struct laz_window *, uint64_t at, uint64_t end, const char *field, struct err *err);
/* Raw bytes, outside of the entropy coding; any number. */
int laz_window_take(struct laz_window *, void *buf, size_t n, struct err *err);
/* Place in the file of the next byte. */
uint64_t laz_window_place(const struct laz_window *);
/* Nothing was taken behind the end, and nothing is bad. */
int laz_window_check(const struct laz_window *, struct err *err);
/* The same, and all bytes up to the end of the stream were taken (not of LAZ_OPEN). */
int laz_window_finish(const struct laz_window *, struct err *err);

int laz_window_refill(struct laz_window *, struct err *err);

/* `c` is the caller's copy of w->coder. */
static inline __attribute__((always_inline)) int laz_window_ready(struct laz_window *w, struct laz_coder *c, struct err *err)
{
	int rc;

	if (laz_likely(c->at <= w->low))
		return 0;
	w->coder.at = c->at;
	rc = laz_window_refill(w, err);
	c->at = w->coder.at;
	return rc;
}

#endif
