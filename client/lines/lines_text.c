/* Bytes and lines of a file for the readers of texts, and numbers as exact decimals. */
#include "lines_priv.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "io.h"
#include "utf8.h"

enum { DIGITS = 18, EXPONENT_SHOWN = 6 };

void lines_source_begin(struct text_source *s, const struct lines *l, struct err *err)
{
	text_source_file(s, l->fd, l->path, err);
	s->interrupted = l->interrupted;
	s->ctx = l->ctx;
}

/* ---- numbers ---- */

struct digits {
	char kept[DIGITS + 1];
	unsigned n;
	bool some, more; /* there is a digit; one beyond those kept that is not zero */
	int64_t exponent;
};

static size_t take_digits(const char *text, size_t n, struct digits *d, bool fraction)
{
	size_t i = 0;

	for (; i < n && isdigit((unsigned char)text[i]); i++) {
		d->some = true;
		if (d->n == DIGITS) {
			d->more |= text[i] != '0';
			d->exponent += !fraction;
			continue;
		}
		if (d->n || text[i] != '0')
			d->kept[d->n++] = text[i];
		d->exponent -= fraction;
	}
	return i;
}

static bool take_exponent(const char *text, size_t n, int64_t *ret)
{
	bool minus = n && *text == '-';
	int64_t e = 0;
	size_t i = n && (*text == '-' || *text == '+');

	if (i == n)
		return false;
	for (; i < n; i++) {
		if (!isdigit((unsigned char)text[i]))
			return false;
		if (e < 1000000)
			e = 10 * e + (text[i] - '0');
	}
	*ret += minus ? -e : e;
	return true;
}

bool lines_number(const char *text, size_t n, struct decimal *ret)
{
	char plain[DIGITS + 40];
	struct digits d = {.n = 0};
	bool minus = n && *text == '-';
	size_t i = n && (*text == '-' || *text == '+');

	i += take_digits(text + i, n - i, &d, false);
	if (i < n && text[i] == '.') {
		i++;
		i += take_digits(text + i, n - i, &d, true);
	}
	if (!d.some)
		return false;
	if (i < n && ((text[i] | 0x20) != 'e' || !take_exponent(text + i + 1, n - i - 1, &d.exponent)))
		return false;
	/* The last digit tells that there are more: neither an end nor a middle of a coarser unit. */
	if (d.more && (d.kept[d.n - 1] == '0' || d.kept[d.n - 1] == '5'))
		d.kept[d.n - 1]++;
	d.kept[d.n] = 0;
	snprintf(plain, sizeof plain, "%s%se%lld", minus ? "-" : "", d.n ? d.kept : "0", d.n ? (long long)d.exponent : 0);
	return decimal_parse(plain, ret);
}

/* ---- words ---- */

void lines_utf8(const char *text, size_t n, char *ret, size_t size)
{
	bool valid = true;
	size_t out = 0;

	for (size_t i = 0, c; i < n && valid; i += c) {
		c = utf8_length(text + i, n - i);
		valid = c > 0;
	}
	for (size_t i = 0; i < n;) {
		unsigned char b = (unsigned char)text[i];
		size_t c = valid ? utf8_length(text + i, n - i) : 1;

		if (out + (valid ? c : 2) >= size)
			break;
		if (valid) {
			memcpy(ret + out, text + i, c);
			out += c;
		} else if (b < 0x80) {
			ret[out++] = (char)b;
		} else {
			ret[out++] = (char)(0xc0 | b >> 6);
			ret[out++] = (char)(0x80 | (b & 0x3f));
		}
		i += c;
	}
	ret[out] = 0;
}

void lines_crs_of_text(const char *text, struct lines_crs *crs)
{
	if (strstr(text, "CRS84")) {
		crs->epsg = 4326;
		crs->degrees = true;
		return;
	}
	for (const char *at = text; (at = strcasestr(at, "EPSG"));) {
		size_t version;
		unsigned long v;
		char *end;

		/* "EPSG:25832", "EPSG::25832", "EPSG:9.9:25832", "EPSG/0/25832" */
		at += 4;
		if (*at != ':' && *at != '/')
			continue;
		at++;
		version = strspn(at, "0123456789.");
		if (at[version] == ':' || at[version] == '/')
			at += version + 1;
		v = isdigit((unsigned char)*at) ? strtoul(at, &end, 10) : 0;
		if (!v || v > 1000000)
			continue;
		at = end;
		if (!crs->epsg)
			crs->epsg = (uint32_t)v;
		else if (!crs->epsg_z)
			crs->epsg_z = (uint32_t)v;
	}
	if (crs->epsg == 4326 || crs->epsg == 4979)
		crs->degrees = true;
}

void lines_unit_of(const char *name, char ret[32])
{
	static const struct {
		const char *name, *unit;
	} rows[] = {
		{"metre", "metre"},
		{"meter", "metre"},
		{"metres", "metre"},
		{"meters", "metre"},
		{"m", "metre"},
		{"foot", "foot"},
		{"feet", "foot"},
		{"ft", "foot"},
		{"international foot", "foot"},
		{"us survey feet", "us-survey-foot"},
		{"foot us", "us-survey-foot"},
		{"internationalfoot", "foot"},
		{"USSurveyFoot", "us-survey-foot"},
		{"us survey foot", "us-survey-foot"},
		{"us-survey-foot", "us-survey-foot"},
		{"ftUS", "us-survey-foot"},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
		if (!strcasecmp(rows[i].name, name)) {
			strcpy(ret, rows[i].unit);
			return;
		}
	lines_utf8(name, strlen(name), ret, 32);
}
