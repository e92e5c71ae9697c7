/*
 * Strict parsing (parse.h): no leading spaces, nothing after the value, no unnoticed overflow, no hexadecimal, no
 * "inf". acut never calls setlocale, so the decimal point is a point.
 */
#include "parse.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SECONDS_MOST 1e10

bool parse_u64(const char *text, uint64_t *ret)
{
	uint64_t v = 0;

	if (!*text)
		return false;
	for (; *text; text++) {
		if (*text < '0' || *text > '9')
			return false;
		if (__builtin_mul_overflow(v, (uint64_t)10, &v) || __builtin_add_overflow(v, (uint64_t)(*text - '0'), &v))
			return false;
	}
	*ret = v;
	return true;
}

bool parse_i64(const char *text, int64_t *ret)
{
	bool minus = *text == '-';
	uint64_t v;

	if (*text == '-' || *text == '+')
		text++;
	if (!parse_u64(text, &v) || v > (uint64_t)INT64_MAX + minus)
		return false;
	*ret = minus ? (int64_t)-v : (int64_t)v;
	return true;
}

/* The length of the number at the start of the text, [+-]digits[.digits][(e|E)[+-]digits] or the same without digits on
 * one side of the point; 0 if there is none. */
static size_t number_length(const char *text)
{
	size_t i = text[0] == '-' || text[0] == '+', digits = 0, e;

	while (text[i] >= '0' && text[i] <= '9')
		i++, digits++;
	if (text[i] == '.') {
		i++;
		while (text[i] >= '0' && text[i] <= '9')
			i++, digits++;
	}
	if (!digits)
		return 0;
	if (text[i] != 'e' && text[i] != 'E')
		return i;
	e = i + 1 + (text[i + 1] == '-' || text[i + 1] == '+');
	if (text[e] < '0' || text[e] > '9')
		return i;
	while (text[e] >= '0' && text[e] <= '9')
		e++;
	return e;
}

/* Parses a finite number at the start of the text; returns the rest, or NULL. */
static const char *number_start(const char *text, double *ret)
{
	size_t n = number_length(text);

	if (!n)
		return NULL;
	double v = strtod(text, NULL);

	if (!isfinite(v))
		return NULL;
	*ret = v;
	return text + n;
}

bool parse_double(const char *text, double *ret)
{
	double v;
	const char *rest = number_start(text, &v);

	if (!rest || *rest)
		return false;
	*ret = v;
	return true;
}

bool parse_size(const char *text, uint64_t *ret)
{
	static const char units[] = "KMGTP";
	double v;
	const char *rest = number_start(text, &v);

	if (!rest || v < 0 || *text == '-')
		return false;
	if (!*rest)
		return parse_u64(text, ret);
	const char *unit = strchr(units, *rest >= 'a' && *rest <= 'z' ? *rest - 'a' + 'A' : *rest);

	if (!unit || rest[1])
		return false;
	v *= (double)(UINT64_C(1) << (10 * (unit - units + 1)));
	if (v >= 0x1p64)
		return false;
	*ret = (uint64_t)v;
	return true;
}

bool parse_seconds(const char *text, double *ret)
{
	double v, unit = 1;
	const char *rest = number_start(text, &v);

	if (!rest || v < 0 || *text == '-')
		return false;
	if (*rest) {
		if (rest[1])
			return false;
		if (*rest == 'm')
			unit = 60;
		else if (*rest == 'h')
			unit = 3600;
		else if (*rest == 'd')
			unit = 86400;
		else if (*rest != 's')
			return false;
	}
	v *= unit;
	if (!(v <= SECONDS_MOST))
		return false;
	*ret = v;
	return true;
}

char *parse_size_text(uint64_t bytes, char *buf)
{
	static const char *const units[] = {"bytes", "KB", "MB", "GB", "TB", "PB", "EB"};
	double v = (double)bytes;
	unsigned u = 0;

	while (v >= 1023.5 && u + 1 < sizeof units / sizeof units[0]) {
		v /= 1024;
		u++;
	}
	snprintf(buf, 32, u > 0 && v < 9.95 ? "%.1f %s" : "%.0f %s", v, units[u]);
	return buf;
}

bool parse_many(const char *text, uint64_t *ret)
{
	static const char units[] = "kMG";
	size_t n = strlen(text);
	const char *unit = n ? strchr(units, text[n - 1]) : NULL;
	char digits[32];
	double v;

	if (parse_u64(text, ret))
		return true;
	if (!unit || n >= sizeof digits)
		return false;
	memcpy(digits, text, n - 1);
	digits[n - 1] = '\0';
	if (!parse_double(digits, &v) || v < 0)
		return false;
	for (long i = unit - units; i >= 0; i--)
		v *= 1000;
	if (v >= 0x1p53 || v != (double)(uint64_t)v)
		return false;
	*ret = (uint64_t)v;
	return true;
}
