/*
 * The window over a stream of a LAZ file.
 *
 * Model: the buffer holds the bytes from coder.at to `stop`; a refill moves what is left to the front and
 * reads behind it. As long as the stream goes on in the file, `low` lies LAZ_GUARD bytes before `stop`; at
 * the stream's end it is `stop` itself, followed by zeros, so that one comparison finds both the need for a
 * refill and a decoder that ran over the end.
 *
 * Not here: who decides where a stream ends.
 */
#include "laz_window.h"

#include <inttypes.h>
#include <string.h>

#include "err.h"

void laz_window_init(struct laz_window *w, uint8_t *buffer, size_t size, const struct laz_source *source, uint64_t *counter)
{
	memset(w, 0, sizeof *w);
	w->buffer = buffer;
	w->size = size;
	w->source = source;
	w->counter = counter;
	w->coder.at = w->low = w->stop = buffer;
}

static int over(const struct laz_window *w, struct err *err)
{
	if (w->truncated)
		err_set(err, ERR_TRUNCATED, "the file ends in the middle of its compressed points");
	else
		err_set(err, ERR_INPUT, "the compressed bytes end before the points that they should hold");
	return err_add_place(err, w->end, w->field);
}

int laz_window_refill(struct laz_window *w, struct err *err)
{
	size_t left, want;

	if (w->coder.at > w->stop)
		return over(w, err);
	left = (size_t)(w->stop - w->coder.at);
	memmove(w->buffer, w->coder.at, left);
	w->coder.at = w->buffer;
	w->stop = w->low = w->buffer + left;
	want = w->size - left;
	while (want && w->next < w->end) {
		size_t n = want < w->end - w->next ? want : (size_t)(w->end - w->next), got = 0;
		int rc = w->source->read(w->source->ctx, w->next, w->buffer + left, n, &got, err);

		if (rc)
			return rc;
		if (!got) {
			w->truncated = true;
			w->end = w->next;
			break;
		}
		w->next += got;
		*w->counter += got;
		left += got;
		want -= got;
	}
	memset(w->buffer + left, 0, LAZ_GUARD);
	w->stop = w->buffer + left;
	w->low = w->next < w->end ? w->stop - LAZ_GUARD : w->stop;
	return 0;
}

int laz_window_begin(struct laz_window *w, uint64_t at, uint64_t end, const char *field, struct err *err)
{
	w->coder = (struct laz_coder){.at = w->buffer};
	w->low = w->stop = w->buffer;
	w->next = at;
	w->end = end;
	w->truncated = false;
	w->field = field;
	return laz_window_refill(w, err);
}

int laz_window_take(struct laz_window *w, void *buf, size_t n, struct err *err)
{
	uint8_t *to = buf;

	while (n) {
		size_t left = (size_t)(w->stop - w->coder.at), step = n < left ? n : left;

		memcpy(to, w->coder.at, step);
		w->coder.at += step;
		to += step;
		n -= step;
		if (n) {
			int rc;

			if (w->next == w->end)
				return over(w, err);
			rc = laz_window_refill(w, err);
			if (rc)
				return rc;
		}
	}
	return 0;
}

uint64_t laz_window_place(const struct laz_window *w)
{
	return w->coder.at > w->stop ? w->next + (uint64_t)(w->coder.at - w->stop) : w->next - (uint64_t)(w->stop - w->coder.at);
}

int laz_window_check(const struct laz_window *w, struct err *err)
{
	if (w->coder.at > w->stop)
		return over(w, err);
	if (w->coder.bad) {
		err_set(err, ERR_INPUT, "the compressed bytes are damaged: nothing was ever compressed to them");
		return err_add_place(err, laz_window_place(w), w->field);
	}
	return 0;
}

int laz_window_finish(const struct laz_window *w, struct err *err)
{
	int rc = laz_window_check(w, err);

	if (rc)
		return rc;
	if (laz_window_place(w) != w->end) {
		err_set(err, ERR_INPUT, "the compressed bytes are damaged: their points end %" PRIu64 " bytes before they do",
			w->end - laz_window_place(w));
		return err_add_place(err, laz_window_place(w), w->field);
	}
	return 0;
}
