/*
 * Terminals: width, colours, and texts that are safe to show. Widths of characters are those of the C library's
 * UTF-8 locale, whatever the user's: names are UTF-8 or shown byte by byte. It draws nothing by itself and never
 * moves the cursor; session_progress.c does.
 */
#include <locale.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>
#include <wchar.h>

#include "term.h"
#include "parse.h"
#include "utf8.h"

#define KEY 12 /* columns of a field's key */

struct term term_of(FILE *out)
{
	const char *no = getenv("NO_COLOR"), *term = getenv("TERM"), *columns = getenv("COLUMNS");
	struct term t = {.on = isatty(fileno(out)) == 1};
	struct winsize ws;
	uint64_t n;

	if (!t.on)
		return t;
	t.color = !(no && *no) && term && *term && strcmp(term, "dumb");
	t.width = 80;
	if (columns && parse_u64(columns, &n) && n >= 10 && n <= 10000)
		t.width = (unsigned)n;
	else if (!ioctl(fileno(out), TIOCGWINSZ, &ws) && ws.ws_col >= 10)
		t.width = ws.ws_col;
	return t;
}

const char *term_tint(const struct term *t, enum term_tint tint)
{
	static const char *const code[] = {"\033[0m", "\033[1m", "\033[32m", "\033[33m", "\033[31m"};

	return t->color ? code[tint] : "";
}

/* The character at p: its length, its code; 0 if there is none. */
static unsigned decode(const unsigned char *p, wchar_t *ret)
{
	size_t n = utf8_length(p, SIZE_MAX);

	if (n)
		*ret = (wchar_t)utf8_code(p, n);
	return (unsigned)n;
}

/* Controls of both sets, and what turns the direction of a line or ends it. */
static bool harmful(wchar_t c)
{
	return c < 0x20 || (c >= 0x7f && c < 0xa0) || (c >= 0x200e && c <= 0x200f) || (c >= 0x2028 && c <= 0x202e) ||
	       (c >= 0x2066 && c <= 0x2069) || c == 0xfeff;
}

static bool lost;

void term_lose(void)
{
	lost = true;
}

bool term_lost(void)
{
	return lost;
}

char *term_format(const char *fmt, va_list ap)
{
	char *text;

	return vasprintf(&text, fmt, ap) < 0 ? NULL : text;
}

char *term_safe(const char *text)
{
	const unsigned char *p = (const unsigned char *)text;
	char *safe = malloc(4 * strlen(text) + 4), *at = safe;

	while (safe && *p) {
		wchar_t c = 0;
		unsigned n = decode(p, &c);

		if (n && !harmful(c)) {
			memcpy(at, p, n);
			at += n;
		} else if (*p == '\n' || *p == '\t') {
			at += sprintf(at, "\\%c", *p == '\n' ? 'n' : 't');
		} else {
			n = n ? n : 1;
			for (unsigned i = 0; i < n; i++)
				at += sprintf(at, "\\x%02x", p[i]);
		}
		p += n ? n : 1;
	}
	if (safe)
		*at = 0;
	return safe;
}

/* What is printed of a safe copy. */
static const char *printed(const char *safe)
{
	if (!safe)
		term_lose();
	return safe ? safe : "?";
}

void term_put(FILE *out, const char *text)
{
	const char *p = text;
	char *safe;

	while (*p >= 0x20 && *p < 0x7f)
		p++;
	if (!*p) { /* nearly always */
		fputs(text, out);
		return;
	}
	safe = term_safe(text);
	fputs(printed(safe), out);
	free(safe);
}

static unsigned width_of(wchar_t c)
{
	static locale_t utf8;
	locale_t was;
	int w;

	if (c < 0x7f)
		return 1;
	if (!utf8)
		utf8 = newlocale(LC_CTYPE_MASK, "C.UTF-8", (locale_t)0);
	if (!utf8)
		return !(c >= 0x300 && c < 0x370);
	was = uselocale(utf8);
	w = wcwidth(c);
	uselocale(was);
	return w < 0 ? 1 : (unsigned)w;
}

size_t term_fit(const char *text, unsigned columns)
{
	const unsigned char *p = (const unsigned char *)text;

	while (*p) {
		wchar_t c = 0;
		unsigned n = decode(p, &c), w = n ? width_of(c) : 1;

		if (w > columns)
			break;
		columns -= w;
		p += n ? n : 1;
	}
	return (size_t)((const char *)p - text);
}

unsigned term_columns(const char *text)
{
	const unsigned char *p = (const unsigned char *)text;
	unsigned sum = 0;

	while (*p) {
		wchar_t c = 0;
		unsigned n = decode(p, &c);

		sum += n ? width_of(c) : 1;
		p += n ? n : 1;
	}
	return sum;
}

void term_shorten(char *text, unsigned columns, bool tail)
{
	static const char dots[] = "…";
	unsigned all = term_columns(text), behind;
	size_t front, skip;

	if (all <= columns || !columns)
		return;
	behind = tail ? 0 : (columns - 1) / 2;
	front = term_fit(text, columns - 1 - behind);
	/* so many columns off the front that what is left takes at most `behind` */
	for (skip = front; text[skip] && term_columns(text + skip) > behind;) {
		wchar_t c;
		unsigned n = decode((const unsigned char *)text + skip, &c);

		skip += n ? n : 1;
	}
	/* combining characters stay with what they belong to, and that is gone */
	while (text[skip]) {
		wchar_t c = 0;
		unsigned n = decode((const unsigned char *)text + skip, &c);

		if (!n || width_of(c))
			break;
		skip += n;
	}
	memmove(text + front + sizeof(dots) - 1, text + skip, strlen(text + skip) + 1);
	memcpy(text + front, dots, sizeof(dots) - 1);
}

/* One line of a value: up to the last blank that fits, else as much as does. */
static size_t one_line(const char *text, unsigned columns)
{
	size_t n = term_fit(text, columns), blank = n;

	if (!text[n])
		return n;
	while (blank && text[blank] != ' ')
		blank--;
	return blank ? blank : n ? n : 1;
}

static void wrapped(FILE *out, const char *text, unsigned indent, unsigned width)
{
	for (bool first = true; *text || first; first = false) {
		size_t n = width > indent + 8 ? one_line(text, width - indent) : strlen(text);

		fprintf(out, "%*s%.*s\n", first ? 0 : (int)indent, "", (int)n, text);
		text += n;
		while (*text == ' ')
			text++;
	}
}

void term_wrap(FILE *out, unsigned indent, const char *text)
{
	char *safe = term_safe(text);

	wrapped(out, printed(safe), indent, term_of(out).width);
	free(safe);
}

void term_field(FILE *out, const char *key, const char *fmt, ...)
{
	struct term term = term_of(out);
	char *text, *safe;
	va_list ap;

	va_start(ap, fmt);
	text = term_format(fmt, ap);
	va_end(ap);
	safe = text ? term_safe(text) : NULL;
	fprintf(out, "%s%-*s%s", term_tint(&term, TERM_BOLD), KEY - 1, key, term.color ? "\033[0m " : " ");
	wrapped(out, printed(safe), KEY, term.width);
	free(safe);
	free(text);
}

void term_line(FILE *out, const char *fmt, ...)
{
	char *text;
	va_list ap;

	va_start(ap, fmt);
	text = term_format(fmt, ap);
	va_end(ap);
	if (!text) {
		term_lose();
		return;
	}
	term_put(out, text);
	fputc('\n', out);
	free(text);
}
