#include "lines_case.h"

#include <assert.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "repeat.h"

static char folder[256];

void lines_case_u8(struct lines_case_bytes *b, unsigned v)
{
	assert(b->n < sizeof b->at);
	b->at[b->n++] = (uint8_t)v;
}

void lines_case_u32(struct lines_case_bytes *b, uint32_t v, int big)
{
	for (int i = 0; i < 4; i++)
		lines_case_u8(b, v >> (big ? 24 - 8 * i : 8 * i) & 255);
}

void lines_case_double(struct lines_case_bytes *b, double v, int big)
{
	uint64_t bits;

	memcpy(&bits, &v, sizeof bits);
	for (int i = 0; i < 8; i++)
		lines_case_u8(b, bits >> (big ? 56 - 8 * i : 8 * i) & 255);
}

void lines_case_set32(struct lines_case_bytes *b, size_t at, uint32_t v, int big)
{
	size_t n = b->n;

	b->n = at;
	lines_case_u32(b, v, big);
	b->n = n;
}

const char *lines_case_path(const char *name)
{
	static char path[512];

	if (!*folder)
		repeat_folder(folder, sizeof folder, "lines");
	snprintf(path, sizeof path, "%s/%s", folder, name);
	return path;
}

const char *lines_case_file(const char *name, const void *bytes, size_t n)
{
	const char *path = lines_case_path(name);
	FILE *f;

	unlink(path); /* a file that is overwritten is written to the disk at once by some file systems */
	f = fopen(path, "wb");
	assert(f && fwrite(bytes, 1, n, f) == n && !fclose(f));
	return path;
}

void lines_case_remove_all(void)
{
	if (*folder)
		repeat_remove(folder);
}

struct out {
	char *text;
	size_t n;
};

static void put(struct out *o, const char *fmt, ...)
{
	va_list ap;

	va_start(ap, fmt);
	o->n += (size_t)vsnprintf(o->text + o->n, LINES_CASE_TEXT - o->n, fmt, ap);
	va_end(ap);
	assert(o->n < LINES_CASE_TEXT);
}

static void put_parts(struct out *o, const struct lines_feature *f)
{
	char buf[DECIMAL_TEXT_SIZE];

	for (size_t p = 0; p < f->nparts; p++) {
		put(o, "%s %s", p ? ";" : ":", f->part[p].ring ? "ring" : "open");
		for (size_t i = 0; i < f->part[p].n; i++)
			for (unsigned k = 0; k < 3; k++) {
				put(o, "%s ", !k && i ? "," : "");
				if (f->exact)
					put(o, "%s", decimal_text(f->exact[f->part[p].first + i][k], buf));
				else
					put(o, "%.17g", f->number_of[f->part[p].first + i][k]);
			}
	}
}

static void put_error(struct out *o, struct err *err)
{
	char buf[2048];

	assert(err->code && *err->file && *err->message);
	*err->file = 0;
	put(o, "error: %s\n", err_format(err, buf, sizeof buf));
}

const char *lines_case_read(const char *path, const struct lines_options *opt, char text[LINES_CASE_TEXT])
{
	static const struct lines_options none;
	struct out o = {text, 0};
	struct err err = ERR_INIT;
	const struct lines_feature *f = NULL;
	struct lines *l;
	int rc = lines_open(path, opt ? opt : &none, &l, &err);

	*text = 0;
	if (rc) {
		put_error(&o, &err);
		return text;
	}
	while (!(rc = lines_next(l, &f, &err)) && f) {
		put(&o, "#%llu %s %s", (unsigned long long)f->number, f->layer->name, f->geometry);
		if (f->kind)
			put(&o, " [%s]", f->kind);
		if (f->state == LINES_USABLE)
			put_parts(&o, f);
		else if (f->state != LINES_EMPTY)
			put(&o, " %s %s", f->state == LINES_REFUSED ? "!" : "=", f->why);
		put(&o, "\n");
	}
	if (rc)
		put_error(&o, &err);
	lines_close(l);
	return text;
}

const char *lines_case_read_text(const char *name, const char *text, const struct lines_options *opt, char ret[LINES_CASE_TEXT])
{
	return lines_case_read(lines_case_file(name, text, strlen(text)), opt, ret);
}
