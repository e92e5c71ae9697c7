/*
 * Lines of a pose file, from any offset, with one buffer. A line ends with LF or CRLF, or with the file.
 */
#include <stdbool.h>
#include <string.h>

#include "err.h"
#include "io.h"
#include "pose_parts.h"

void pose_lines_start(struct pose_lines *l, int fd, const char *name, uint64_t offset)
{
	l->fd = fd;
	l->name = name;
	l->at = offset;
	l->line = 0;
	l->i = l->n = 0;
	l->ended = false;
	l->hash = NULL;
}

static int fill_buffer(struct pose_lines *l, struct err *err)
{
	size_t got;
	int r;

	memmove(l->buf, l->buf + l->i, l->n - l->i);
	l->n -= l->i;
	l->i = 0;
	r = io_read_some(l->fd, l->buf + l->n, sizeof l->buf - 1 - l->n, l->at, l->name, &got, err);
	if (r)
		return r;
	if (l->hash)
		digest_stream_add(l->hash, l->buf + l->n, got);
	l->ended = got == 0;
	l->at += got;
	l->n += got;
	return 0;
}

/* 1: the next line, even if it is empty. */
static int next_line(struct pose_lines *l, char **ret, size_t *ret_size, uint64_t *ret_offset, struct err *err)
{
	char *end;
	int r;

	while (!(end = memchr(l->buf + l->i, '\n', l->n - l->i)) && !l->ended) {
		if (l->n - l->i > POSE_LINE_MAX)
			break;
		r = fill_buffer(l, err);
		if (r)
			return r;
	}
	if (!end && l->i == l->n)
		return 0;
	if (!end)
		end = l->buf + l->n;
	l->line++;
	*ret = l->buf + l->i;
	*ret_size = (size_t)(end - *ret);
	*ret_offset = l->at - (l->n - l->i);
	if (*ret_size > POSE_LINE_MAX) {
		err_set(err, ERR_INPUT, "line %llu is longer than %d bytes", (unsigned long long)l->line, POSE_LINE_MAX);
		err_add_hint(err, "it should be a text of one pose a line: acut-pose(5)");
		return err_add_place(err, l->line, "line");
	}
	l->i += *ret_size + (end < l->buf + l->n);
	return 1;
}

int pose_lines_next(struct pose_lines *l, char **ret, uint64_t *ret_offset, struct err *err)
{
	char *at = NULL;
	size_t n = 0;
	int r;

	while ((r = next_line(l, &at, &n, ret_offset, err)) > 0) {
		size_t used;

		if (*ret_offset == 0 && n >= 3 && !memcmp(at, "\xef\xbb\xbf", 3)) {
			at += 3; /* a byte order mark */
			n -= 3;
		}
		n -= n && at[n - 1] == '\r';
		for (used = n; used && (at[used - 1] == ' ' || at[used - 1] == '\t'); used--)
			; /* tabs at the end may be empty fields */
		if (!used || *at == '#')
			continue;
		if (memchr(at, 0, n) || memchr(at, '\r', n)) {
			bool zero = memchr(at, 0, n) != NULL;

			err_set(err, ERR_INPUT, "line %llu has a %s in it", (unsigned long long)l->line,
				zero ? "byte 0" : "carriage return");
			err_add_hint(err, zero ? "write the file as UTF-8, or ASCII, not as UTF-16" :
						 "lines end with a line feed, or carriage return and line feed");
			return err_add_place(err, l->line, "line");
		}
		at[n] = 0; /* the line end, or the byte after the last one read, for which there is space */
		*ret = at;
		return 1;
	}
	return r;
}
