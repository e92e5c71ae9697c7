/*
 * Errors (err.h). A struct err is filled once, where the error is detected. Callers add the file, the place and a hint.
 * Nothing here allocates, so out-of-memory errors can be reported, too.
 */
#include "err.h"

#include <assert.h>
#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

static const struct {
	const char *wire;
	int status;
	const char *text;
} table[ERR_COUNT] = {
	[ERR_NONE] = {"none", 0, "no error"},
#define ERR(name, wire, status, text) [ERR_##name] = {wire, status, text},
#include "err.def"
#undef ERR
};

/* Texts may be truncated, but not within a UTF-8 character. */
static void text_close(char *buf, size_t size)
{
	size_t n = strnlen(buf, size), lead = n;

	if (n + 1 < size)
		return;
	while (lead > 0 && ((unsigned char)buf[lead - 1] & 0xc0) == 0x80)
		lead--;
	if (lead > 0 && ((unsigned char)buf[lead - 1] & 0xc0) == 0xc0)
		buf[lead - 1] = '\0';
}

static void text_print(char *buf, size_t size, const char *fmt, va_list ap)
{
	assert(fmt); /* without it, gcc warns about the path on which the undefined-behaviour sanitizer has reported NULL */
	vsnprintf(buf, size, fmt, ap);
	text_close(buf, size);
}

static void text_copy(char *buf, size_t size, const char *from)
{
	size_t n = strnlen(from, size - 1);

	memcpy(buf, from, n);
	buf[n] = '\0';
	if (n == size - 1)
		text_close(buf, size);
}

static int raise_list(struct err *err, enum err_code code, int sys, const char *src_file, int src_line, const char *fmt,
		      va_list ap)
{
	if (err->code)
		return -(int)err->code;
	err->code = code;
	err->sys = sys;
	err->src_file = src_file;
	err->src_line = src_line;
	text_print(err->message, sizeof err->message, fmt, ap);
	return -(int)code;
}

int err_raise(struct err *err, enum err_code code, int sys, const char *src_file, int src_line, const char *fmt, ...)
{
	va_list ap;

	va_start(ap, fmt);
	int rc = raise_list(err, code, sys, src_file, src_line, fmt, ap);
	va_end(ap);
	return rc;
}

static enum err_code code_from_errno(int sys)
{
	switch (sys) {
	case ENOSPC:
	case EDQUOT:
		return ERR_NOSPACE;
	case ENOMEM:
		return ERR_NOMEM;
	case EACCES:
	case EPERM:
		return ERR_PERM;
	default:
		return ERR_IO;
	}
}

int err_raise_sys(struct err *err, int sys, const char *src_file, int src_line, const char *fmt, ...)
{
	char reason[128];
	va_list ap;

	if (err->code)
		return -(int)err->code;
	va_start(ap, fmt);
	raise_list(err, code_from_errno(sys), sys, src_file, src_line, fmt, ap);
	va_end(ap);
	size_t n = strlen(err->message);

	snprintf(err->message + n, sizeof err->message - n, ": %s", strerror_r(sys, reason, sizeof reason));
	text_close(err->message, sizeof err->message);
	return -(int)err->code;
}

int err_add_file(struct err *err, const char *file)
{
	if (err->code && !err->file[0])
		text_copy(err->file, sizeof err->file, file);
	return -(int)err->code;
}

int err_add_place(struct err *err, uint64_t offset, const char *field)
{
	if (err->code && err->offset == ERR_NO_OFFSET)
		err->offset = offset;
	if (err->code && field && !err->field[0])
		text_copy(err->field, sizeof err->field, field);
	return -(int)err->code;
}

int err_add_hint(struct err *err, const char *fmt, ...)
{
	if (err->code && !err->hint[0]) {
		va_list ap;

		va_start(ap, fmt);
		text_print(err->hint, sizeof err->hint, fmt, ap);
		va_end(ap);
	}
	return -(int)err->code;
}

void err_clear(struct err *err)
{
	*err = ERR_INIT;
}

const char *err_wire_name(enum err_code code)
{
	return (unsigned)code < ERR_COUNT ? table[code].wire : table[ERR_INTERNAL].wire;
}

enum err_code err_from_wire_name(const char *name)
{
	for (unsigned i = 0; i < ERR_COUNT; i++)
		if (strcmp(name, table[i].wire) == 0)
			return (enum err_code)i;
	return ERR_INTERNAL;
}

int err_exit_status(enum err_code code)
{
	return (unsigned)code < ERR_COUNT ? table[code].status : table[ERR_INTERNAL].status;
}

char *err_format(const struct err *err, char *buf, unsigned long size)
{
	char place[96] = "";
	enum err_code code = (unsigned)err->code < ERR_COUNT ? err->code : ERR_INTERNAL;
	const char *message = err->message[0] ? err->message : table[code].text;

	if (err->offset != ERR_NO_OFFSET)
		snprintf(place, sizeof place, "byte %llu", (unsigned long long)err->offset);
	snprintf(buf, size, "%s%s%s%s%s%s%s%s%s%s", err->file, err->file[0] ? ": " : "", place,
		 place[0] && err->field[0] ? ", " : "", err->field, place[0] || err->field[0] ? ": " : "", message,
		 err->hint[0] ? " (" : "", err->hint, err->hint[0] ? ")" : "");
	return buf;
}
