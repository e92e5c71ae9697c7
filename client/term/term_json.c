/* JSON out: one object a line, keys in the order of the calls, texts made valid UTF-8. One thread
 * writes: what is not yet in its stream is kept here until the line ends. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "term_json.h"
#include "term_text.h"
#include "utf8.h"

/* Bytes that need no escape in a JSON text. */
static const bool plain[256] = {[' ' ... '!'] = true, ['#' ... '['] = true, [']' ... '~'] = true};

/* Bytes that are tested together, each true or false. As signed numbers, bytes that are not ASCII are below all others. */
typedef signed char several __attribute__((vector_size(16)));
enum { HELD = 8192, SEVERAL = sizeof(several) };

/*
 * The buffer of the current line. A list is ten thousand lines of seventy keys, and a call of stdio for each key would be
 * slow. Everything of a line goes through here, in order, and is in the stream when the line ends.
 */
static struct {
	FILE *out;
	size_t n;
	char bytes[HELD + SEVERAL];
} held;

static void flush_held(void)
{
	if (held.n)
		fwrite_unlocked(held.bytes, 1, held.n, held.out);
	held.n = 0;
}

/* A place for n bytes, n <= HELD; the caller then passes the end of what it wrote to advance(). */
static inline char *reserve(FILE *out, size_t n)
{
	if (held.out != out || n > HELD - held.n)
		flush_held();
	held.out = out;
	return held.bytes + held.n;
}

static inline void advance(const char *end)
{
	held.n = (size_t)(end - held.bytes);
}

/*
 * memcpy, of bytes that are few nearly always, as those of a key are: by two pieces that may overlap, and without a call. Gives
 * the end.
 */
static inline char *copy_few(char *to, const char *from, size_t n)
{
	if (n > 16 || n < 2) {
		memcpy(to, from, n);
	} else if (n >= 8) {
		memcpy(to, from, 8);
		memcpy(to + n - 8, from + n - 8, 8);
	} else if (n >= 4) {
		memcpy(to, from, 4);
		memcpy(to + n - 4, from + n - 4, 4);
	} else {
		memcpy(to, from, 2);
		memcpy(to + n - 2, from + n - 2, 2);
	}
	return to + n;
}

static inline void put_byte(FILE *out, char c)
{
	*reserve(out, 1) = c;
	held.n++;
}

static void put_bytes(FILE *out, const char *bytes, size_t n)
{
	while (n) {
		size_t part = n < HELD ? n : HELD;

		memcpy(reserve(out, part), bytes, part);
		held.n += part;
		bytes += part;
		n -= part;
	}
}

static void put_string(FILE *out, const char *text)
{
	put_bytes(out, text, strlen(text));
}

/* ---- texts ---- */

static void put_escaped(FILE *out, const char *text)
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

static inline several not_plain(const char *at)
{
	several c;

	memcpy(&c, at, sizeof c);
	return (c < ' ') | (c == '"') | (c == '\\') | (c == 0x7f);
}

static inline bool any(several truths)
{
	uint64_t half[2];

	memcpy(half, &truths, sizeof half);
	return half[0] | half[1];
}

/* Most texts need no escape: they are copied into the buffer and checked there. */
static void put_text(FILE *out, const char *text)
{
	size_t n = strlen(text);
	several odd = {0};
	char *at;

	if (n > HELD - 2) {
		put_escaped(out, text);
		return;
	}
	at = reserve(out, n + 2);
	*at++ = '"';
	copy_few(at, text, n);
	memset(at + n, ' ', SEVERAL);
	for (size_t i = 0; i < n; i += SEVERAL)
		odd |= not_plain(at + i);
	if (any(odd)) {
		put_escaped(out, text);
		return;
	}
	at += n;
	*at++ = '"';
	advance(at);
}

/* ---- keys ---- */

/* One that may have what is to be escaped, and need not be there. */
static char *put_any_key(struct term_json *j, const char *key, size_t more)
{
	if (j->comma)
		put_byte(j->out, ',');
	if (key) {
		put_text(j->out, key);
		put_byte(j->out, ':');
	}
	j->comma = true;
	return reserve(j->out, more);
}

/* The length of a key that is short and needs no escape; else TERM_JSON_UNKNOWN. */
static inline size_t plain_length(const char *key)
{
	size_t n = 0;

	while (n < 32 && plain[(unsigned char)key[n]])
		n++;
	return key[n] ? TERM_JSON_UNKNOWN : n;
}

/* Writes the key, of n bytes or TERM_JSON_UNKNOWN, and returns a place for `more` bytes after it. */
static inline char *put_key(struct term_json *j, const char *key, size_t n, size_t more)
{
	char *at;

	if (n == TERM_JSON_UNKNOWN && key)
		n = plain_length(key);
	if (n == TERM_JSON_UNKNOWN)
		return put_any_key(j, key, more);
	at = reserve(j->out, n + 4 + more);
	if (j->comma)
		*at++ = ',';
	j->comma = true;
	*at++ = '"';
	at = copy_few(at, key, n);
	*at++ = '"';
	*at++ = ':';
	advance(at);
	return at;
}

void term_json_put_open(struct term_json *j, const char *key, size_t n, char bracket)
{
	char *at = put_key(j, key, n, 1);

	*at = bracket;
	held.n++;
	j->comma = false;
}

void term_json_close(struct term_json *j, char bracket)
{
	put_byte(j->out, bracket);
	j->comma = true;
}

void term_json_put_null(struct term_json *j, const char *key, size_t n)
{
	advance(mempcpy(put_key(j, key, n, 4), "null", 4));
}

void term_json_put_text(struct term_json *j, const char *key, size_t n, const char *text)
{
	if (!text) {
		term_json_put_null(j, key, n);
		return;
	}
	put_key(j, key, n, 0);
	put_text(j->out, text);
}

void term_json_put_known(struct term_json *j, const char *key, size_t n, const char *text)
{
	term_json_put_text(j, key, n, text && *text && strcmp(text, "unknown") ? text : NULL);
}

/* ---- numbers ---- */

enum { DIGITS = 20 }; /* of 64 bits */

/* In decimal; gives the end. */
static inline char *put_digits(char *at, uint64_t n)
{
	char digits[DIGITS];
	unsigned from = DIGITS;

	if (n < 10) {
		*at = (char)('0' + n);
		return at + 1;
	}
	for (; n; n /= 10)
		digits[--from] = (char)('0' + n % 10);
	return copy_few(at, digits + from, DIGITS - from);
}

/*
 * Millionths, as seconds are, without trying how many digits they need: no other decimal of up to 15 digits is read as
 * the same number, so this is the shortest. NULL: it is none, or so large or small that %g has another form for it.
 */
static char *put_millionths(char *at, double v)
{
	uint64_t n;
	unsigned fraction;

	if (!(v >= 1e-4 && v < 1e6))
		return NULL;
	n = (uint64_t)(v * 1e6 + 0.5);
	if ((double)n / 1e6 != v)
		return NULL;
	at = put_digits(at, n / 1000000);
	fraction = (unsigned)(n % 1000000);
	if (!fraction)
		return at;
	*at++ = '.';
	for (unsigned i = 6; i-- > 0; fraction /= 10)
		at[i] = (char)('0' + fraction % 10);
	for (at += 6; at[-1] == '0';)
		at--;
	return at;
}

void term_json_put_u64(struct term_json *j, const char *key, size_t n, uint64_t v)
{
	advance(put_digits(put_key(j, key, n, DIGITS), v));
}

void term_json_put_known_u64(struct term_json *j, const char *key, size_t n, uint64_t v)
{
	if (v)
		term_json_put_u64(j, key, n, v);
	else
		term_json_put_null(j, key, n);
}

void term_json_put_i64(struct term_json *j, const char *key, size_t n, int64_t v)
{
	char *at = put_key(j, key, n, 1 + DIGITS);

	if (v < 0)
		*at++ = '-';
	advance(put_digits(at, v < 0 ? 0 - (uint64_t)v : (uint64_t)v));
}

void term_json_put_number(struct term_json *j, const char *key, size_t n, double v)
{
	char buf[40], *at, *end;

	if (!isfinite(v)) {
		term_json_put_null(j, key, n);
		return;
	}
	at = put_key(j, key, n, DIGITS + 7);
	end = v == 0 && !signbit(v) ? put_digits(at, 0) : put_millionths(at, v);
	if (end) {
		advance(end);
		return;
	}
	for (int digits = 6; digits <= 17; digits++) {
		snprintf(buf, sizeof(buf), "%.*g", digits, v);
		if (strtod(buf, NULL) == v)
			break;
	}
	put_string(j->out, buf);
}

void term_json_put_numbers(struct term_json *j, const char *key, size_t n, const double *v, size_t count)
{
	term_json_put_open(j, key, n, '[');
	for (size_t i = 0; i < count; i++)
		term_json_number(j, NULL, v[i]);
	term_json_close(j, ']');
}

void term_json_put_time(struct term_json *j, const char *key, size_t n, int64_t us)
{
	char buf[32];

	term_json_put_text(j, key, n, us ? term_time(us, buf) : NULL);
}

void term_json_put_literal(struct term_json *j, const char *key, size_t n, const char *text)
{
	put_key(j, key, n, 0);
	put_string(j->out, text);
}

void term_json_line(struct term_json *j)
{
	put_byte(j->out, '\n');
	flush_held();
	if (!j->list)
		fflush(j->out);
	j->comma = false;
}

struct term_json term_json_begin(FILE *out, bool list)
{
	struct term_json j = {.out = out, .list = list};

	term_json_open(&j, NULL, '{');
	return j;
}

void term_json_end(struct term_json *j)
{
	term_json_close(j, '}');
	term_json_line(j);
}
