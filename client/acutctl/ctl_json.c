/* JSON out: one object a line, keys in the order of the calls, texts made valid UTF-8. */
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "ctl.h"

/* Length of the UTF-8 character at p, 0 if it is not one. */
static unsigned utf8(const unsigned char *p)
{
	unsigned n = *p < 0x80                 ? 1
		     : *p >= 0xc2 && *p < 0xe0 ? 2
		     : (*p & 0xf0) == 0xe0     ? 3
		     : *p >= 0xf0 && *p < 0xf5 ? 4
					       : 0;

	for (unsigned i = 1; i < n; i++)
		if ((p[i] & 0xc0) != 0x80)
			return 0;
	if ((*p == 0xe0 && p[1] < 0xa0) || (*p == 0xed && p[1] >= 0xa0) || (*p == 0xf0 && p[1] < 0x90) ||
	    (*p == 0xf4 && p[1] >= 0x90))
		return 0;
	return n;
}

static void put_text(FILE *out, const char *text)
{
	fputc('"', out);
	for (const unsigned char *p = (const unsigned char *)text; *p;) {
		size_t plain = 0;
		unsigned n;

		while (p[plain] >= 0x20 && p[plain] < 0x7f && p[plain] != '"' && p[plain] != '\\')
			plain++;
		if (plain)
			fwrite(p, 1, plain, out);
		p += plain;
		if (!*p)
			break;
		n = utf8(p);
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
	fputc('"', out);
}

static void put_key(struct ctl_json *j, const char *key)
{
	if (j->comma)
		fputs(",", j->out);
	j->comma = true;
	if (key) {
		put_text(j->out, key);
		fputc(':', j->out);
	}
}

void ctl_json_open(struct ctl_json *j, const char *key, char bracket)
{
	put_key(j, key);
	fputc(bracket, j->out);
	j->comma = false;
}

void ctl_json_close(struct ctl_json *j, char bracket)
{
	fputc(bracket, j->out);
	j->comma = true;
}

void ctl_json_text(struct ctl_json *j, const char *key, const char *text)
{
	put_key(j, key);
	if (text)
		put_text(j->out, text);
	else
		fputs("null", j->out);
}

void ctl_json_known(struct ctl_json *j, const char *key, const char *text)
{
	ctl_json_text(j, key, text && *text && strcmp(text, "unknown") ? text : NULL);
}

void ctl_json_u64(struct ctl_json *j, const char *key, uint64_t n)
{
	put_key(j, key);
	fprintf(j->out, "%" PRIu64, n);
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
	fputs(text, j->out);
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
