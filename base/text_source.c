/* Bytes and lines of a text (text_source.h). */
#include "text_source.h"

#include "err.h"
#include "io.h"

static void begin(struct text_source *s, int fd, const char *name, struct err *err)
{
	s->fd = fd;
	s->name = name;
	s->interrupted = NULL;
	s->start = 0;
	s->line = 1;
	s->i = s->n = 0;
	s->ended = false;
	s->err = err;
	s->rc = 0;
	s->bytes = s->buffer;
}

void text_source_file(struct text_source *s, int fd, const char *name, struct err *err)
{
	begin(s, fd, name, err);
}

void text_source_memory(struct text_source *s, const char *text, size_t n, struct err *err)
{
	begin(s, -1, NULL, err);
	s->bytes = (const uint8_t *)text;
	s->n = n;
}

int text_source_fill(struct text_source *s)
{
	if (s->ended || s->rc || s->fd < 0)
		return -1;
	s->start += s->n;
	s->i = s->n = 0;
	if (s->interrupted && s->interrupted(s->ctx))
		s->rc = err_set(s->err, ERR_CANCELLED, "interrupted");
	else
		s->rc = io_read_some(s->fd, s->buffer, sizeof s->buffer, s->start, s->name, &s->n, s->err);
	if (s->rc)
		s->n = 0;
	s->ended = !s->rc && !s->n;
	return s->n ? s->buffer[0] : -1;
}

void text_source_seek(struct text_source *s, uint64_t at, uint64_t line)
{
	s->line = line;
	s->ended = false;
	if (at >= s->start && at <= s->start + s->n) {
		s->i = (size_t)(at - s->start);
		return;
	}
	s->start = at;
	s->i = s->n = 0;
}

void text_source_skip_mark(struct text_source *s)
{
	static const uint8_t mark[] = {0xef, 0xbb, 0xbf};
	uint64_t at = text_source_at(s), line = s->line;

	for (size_t i = 0; i < sizeof mark; i++)
		if (text_source_take(s) != mark[i]) {
			text_source_seek(s, at, line);
			return;
		}
}

int text_source_line(struct text_source *s, char *to, size_t room, size_t *ret_n, bool *ret_cut)
{
	size_t n = 0;
	int c = text_source_take(s);

	*ret_cut = false;
	*ret_n = SIZE_MAX;
	if (c < 0)
		return s->rc;
	for (; c >= 0 && c != '\n'; c = text_source_take(s)) {
		if (!c)
			continue;
		if (n + 1 < room)
			to[n++] = (char)c;
		else
			*ret_cut = true;
	}
	if (s->rc)
		return s->rc;
	while (n && to[n - 1] == '\r')
		n--;
	to[n] = 0;
	*ret_n = n;
	return 0;
}
