/* JSON out: one object a line, keys in the order of the calls, texts made valid UTF-8. One thread
 * at a time writes to a stream: it is not locked for each character. */
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "ctl_json.h"
#include "utf8.h"

/* What stands in a JSON text as it is. */
static const bool plain[256] = {[' ' ... '!'] = true, ['#' ... '['] = true, [']' ... '~'] = true};

static void put_text(FILE *out, const char *text)
{
	putc_unlocked('"', out);
	for (const unsigned char *p = (const unsigned char *)text; *p;) {
		size_t n;

		/* Most are a few bytes. */
		for (; plain[*p]; p++)
			putc_unlocked(*p, out);
		if (!*p)
			break;
		n = utf8_length(p, SIZE_MAX);
		if (*p == '"' || *p == '\\')
			fprintf(out, "\\%c", *p);
		else if (*p < 0x20 || *p == 0x7f)
			fprintf(out, "\\u%04x", *p);
		else if (!n)
			fputs("\\ufffd", out);
		else
			fwrite(p, 1, n, out);
		p += n ? n : 1;
	}
	putc_unlocked('"', out);
}

static void put_key(struct ctl_json *j, const char *key)
{
	if (j->comma)
		putc_unlocked(',', j->out);
	j->comma = true;
	if (key) {
		put_text(j->out, key);
		putc_unlocked(':', j->out);
	}
}

void ctl_json_open(struct ctl_json *j, const char *key, char bracket)
{
	put_key(j, key);
	putc_unlocked(bracket, j->out);
	j->comma = false;
}

void ctl_json_close(struct ctl_json *j, char bracket)
{
	putc_unlocked(bracket, j->out);
	j->comma = true;
}

void ctl_json_text(struct ctl_json *j, const char *key, const char *text)
{
	put_key(j, key);
	if (text)
		put_text(j->out, text);
	else
		fputs_unlocked("null", j->out);
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
	for (; at < sizeof digits; at++)
		putc_unlocked(digits[at], out);
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
		putc_unlocked('.', out);
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
	fprintf(j->out, "%" PRId64, n);
}

void ctl_json_number(struct ctl_json *j, const char *key, double v)
{
	char buf[40];

	put_key(j, key);
	if (!isfinite(v)) {
		fputs("null", j->out);
		return;
	}
	if (put_millionths(j->out, v))
		return;
	for (int digits = 6; digits <= 17; digits++) {
		snprintf(buf, sizeof(buf), "%.*g", digits, v);
		if (strtod(buf, NULL) == v)
			break;
	}
	fputs(buf, j->out);
}

void ctl_json_literal(struct ctl_json *j, const char *key, const char *text)
{
	put_key(j, key);
	fputs_unlocked(text, j->out);
}

void ctl_json_bool(struct ctl_json *j, const char *key, bool v)
{
	ctl_json_literal(j, key, v ? "true" : "false");
}

void ctl_json_line(struct ctl_json *j)
{
	fputc('\n', j->out);
	if (!j->list)
		fflush(j->out);
	j->comma = false;
}
