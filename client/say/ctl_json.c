/* JSON out: one object a line, keys in the order of the calls, texts made valid UTF-8. One thread
 * writes: what is not yet in its stream is kept here until the line ends. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "ctl_json.h"
#include "utf8.h"

/* What stands in a JSON text as it is. */
static const bool plain[256] = {[' ' ... '!'] = true, ['#' ... '['] = true, [']' ... '~'] = true};

/*
 * What is not yet in its stream: a list is ten thousand lines of seventy keys, and a call of stdio for each shows. All that
 * is written in one line goes through here, in order, and is in the stream when the line ends.
 */
static struct {
	FILE *out;
	size_t n;
	char bytes[8192];
} held;

static void let_go(void)
{
	if (held.n)
		fwrite_unlocked(held.bytes, 1, held.n, held.out);
	held.n = 0;
}

/* A place for n bytes, n <= sizeof held.bytes; the caller says by `held.n +=` how many it took. */
static char *room_for(FILE *out, size_t n)
{
	if (held.out != out || n > sizeof held.bytes - held.n)
		let_go();
	held.out = out;
	return held.bytes + held.n;
}

static void put_byte(FILE *out, char c)
{
	*room_for(out, 1) = c;
	held.n++;
}

static void put_bytes(FILE *out, const char *bytes, size_t n)
{
	while (n) {
		size_t part = n < sizeof held.bytes ? n : sizeof held.bytes;

		memcpy(room_for(out, part), bytes, part);
		held.n += part;
		bytes += part;
		n -= part;
	}
}

static void put_string(FILE *out, const char *text)
{
	put_bytes(out, text, strlen(text));
}

static void put_text(FILE *out, const char *text)
{
	char code[8];

	put_byte(out, '"');
	for (const unsigned char *p = (const unsigned char *)text; *p;) {
		size_t run = 0, n;

		while (plain[p[run]])
			run++;
		put_bytes(out, (const char *)p, run);
		p += run;
		if (!*p)
			break;
		n = utf8_length(p, SIZE_MAX);
		if (*p == '"' || *p == '\\')
			put_bytes(out, (const char[]){'\\', (char)*p}, 2);
		else if (*p < 0x20 || *p == 0x7f)
			put_bytes(out, code, (size_t)snprintf(code, sizeof(code), "\\u%04x", *p));
		else if (!n)
			put_string(out, "\\ufffd");
		else
			put_bytes(out, (const char *)p, n);
		p += n ? n : 1;
	}
	put_byte(out, '"');
}

enum { KEY_MOST = 256 };

static void put_key(struct ctl_json *j, const char *key)
{
	char *at = room_for(j->out, KEY_MOST + 4);
	size_t n = 0;

	if (j->comma)
		*at++ = ',';
	j->comma = true;
	if (key) {
		*at = '"';
		for (; n < KEY_MOST && plain[(unsigned char)key[n]]; n++)
			at[1 + n] = key[n];
	}
	if (key && !key[n]) {
		at += 1 + n;
		*at++ = '"';
		*at++ = ':';
		key = NULL;
	}
	held.n = (size_t)(at - held.bytes);
	if (!key)
		return;
	/* Not only letters. */
	put_text(j->out, key);
	put_byte(j->out, ':');
}

void ctl_json_open(struct ctl_json *j, const char *key, char bracket)
{
	put_key(j, key);
	put_byte(j->out, bracket);
	j->comma = false;
}

void ctl_json_close(struct ctl_json *j, char bracket)
{
	put_byte(j->out, bracket);
	j->comma = true;
}

void ctl_json_text(struct ctl_json *j, const char *key, const char *text)
{
	put_key(j, key);
	if (text)
		put_text(j->out, text);
	else
		put_bytes(j->out, "null", 4);
}

void ctl_json_known(struct ctl_json *j, const char *key, const char *text)
{
	ctl_json_text(j, key, text && *text && strcmp(text, "unknown") ? text : NULL);
}

/* In decimal, with leading zeros up to `least` digits. */
static void put_digits(FILE *out, uint64_t n, unsigned least)
{
	char digits[24];
	unsigned at = sizeof digits;

	while (n || sizeof digits - at < least) {
		digits[--at] = (char)('0' + n % 10);
		n /= 10;
	}
	put_bytes(out, digits + at, sizeof digits - at);
}

/*
 * Millionths, as seconds are, without trying how many digits they need: no other decimal of up to 15 digits is read as
 * the same number, so this is the shortest. False: it is none, or so large or small that %g has another form for it.
 */
static bool put_millionths(FILE *out, double v)
{
	uint64_t n, fraction;
	unsigned digits = 6;

	if (!(v >= 1e-4 && v < 1e6))
		return false;
	n = (uint64_t)(v * 1e6 + 0.5);
	if ((double)n / 1e6 != v)
		return false;
	put_digits(out, n / 1000000, 1);
	for (fraction = n % 1000000; fraction && fraction % 10 == 0; fraction /= 10)
		digits--;
	if (fraction) {
		put_byte(out, '.');
		put_digits(out, fraction, digits);
	}
	return true;
}

void ctl_json_u64(struct ctl_json *j, const char *key, uint64_t n)
{
	put_key(j, key);
	put_digits(j->out, n, 1);
}

void ctl_json_i64(struct ctl_json *j, const char *key, int64_t n)
{
	put_key(j, key);
	if (n < 0)
		put_byte(j->out, '-');
	put_digits(j->out, n < 0 ? 0 - (uint64_t)n : (uint64_t)n, 1);
}

void ctl_json_number(struct ctl_json *j, const char *key, double v)
{
	char buf[40];

	put_key(j, key);
	if (!isfinite(v)) {
		put_bytes(j->out, "null", 4);
		return;
	}
	if (put_millionths(j->out, v))
		return;
	for (int digits = 6; digits <= 17; digits++) {
		snprintf(buf, sizeof(buf), "%.*g", digits, v);
		if (strtod(buf, NULL) == v)
			break;
	}
	put_string(j->out, buf);
}

void ctl_json_literal(struct ctl_json *j, const char *key, const char *text)
{
	put_key(j, key);
	put_string(j->out, text);
}

void ctl_json_bool(struct ctl_json *j, const char *key, bool v)
{
	ctl_json_literal(j, key, v ? "true" : "false");
}

void ctl_json_line(struct ctl_json *j)
{
	put_byte(j->out, '\n');
	let_go();
	if (!j->list)
		fflush(j->out);
	j->comma = false;
}
