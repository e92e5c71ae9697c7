/*
 * The text of a profile: `key = value` lines in sections. Unknown keys, sections and values, repeated keys and invalid
 * escapes are errors with their line; only the first is reported. A value in double quotes keeps the blanks at its
 * ends. Comments have their own lines (# or ;).
 */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "profile_table.h"

enum { KEYS_MAX = 128, SECTIONS_MAX = 16 };

struct reading {
	const char *file;
	uint64_t line;
	char section[32];
	char sections[SECTIONS_MAX][32];
	size_t sections_n;
	const struct profile_key *set[KEYS_MAX];
	size_t set_n;
	struct profile *to;
};

/* Sets -ERR_INPUT with file and line. */
__attribute__((format(printf, 3, 4))) static int line_error(const struct reading *r, struct err *err, const char *fmt, ...)
{
	char text[400];
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(text, sizeof text, fmt, ap);
	va_end(ap);
	if (r->line)
		err_set(err, ERR_INPUT, "line %llu: %s", (unsigned long long)r->line, text);
	else
		err_set(err, ERR_INPUT, "%s", text);
	err_add_file(err, r->file);
	return r->line ? err_add_place(err, r->line, "line") : -ERR_INPUT;
}

static void set_defaults(struct profile *p, const char *name)
{
	static const struct profile_field none = {.offset = -1};

	memset(p, 0, sizeof *p);
	snprintf(p->name, sizeof p->name, "%s", name);
	p->vendor = p->product = p->device_class = p->interface_class = -1;
	p->endpoint_in = 0x81;
	p->transfer_size = 16 << 10;
	p->transfers = 8;
	p->timeout_ms = 1000;
	p->framer = PROFILE_FRAMER_STREAM;
	p->telegram_max = 64 << 10;
	strcpy(p->decoder, "raw");
	strcpy(p->columns, "xyz");
	p->angle_ahead = 90;
	p->ranges.kind = p->ranges.count = p->ranges.range = p->ranges.intensity = p->ranges.counter = p->ranges.time = none;
	p->ranges.range_scale = 0.001;
	p->ranges.range_least = 1;
	p->ranges.range_most = UINT32_MAX;
	p->ranges.time_scale = 1e-6;
}

static char *trim(char *s)
{
	size_t n;

	s += strspn(s, " \t");
	n = strlen(s);
	while (n && (s[n - 1] == ' ' || s[n - 1] == '\t'))
		n--;
	s[n] = '\0';
	return s;
}

static int read_section(struct reading *r, char *s, struct err *err)
{
	size_t n = strlen(s);

	if (s[n - 1] != ']')
		return line_error(r, err, "a section is written [name]");
	s[n - 1] = '\0';
	s = trim(s + 1);
	if (!profile_section_is(s)) {
		line_error(r, err, "there is no section [%.40s]", s);
		return err_add_hint(err, "sections are match, usb, start, stop, framer, decoder, geometry and time");
	}
	for (size_t i = 0; i < r->sections_n; i++)
		if (!strcmp(r->sections[i], s))
			return line_error(r, err, "section [%s] stands twice", s);
	snprintf(r->section, sizeof r->section, "%s", s);
	memcpy(r->sections[r->sections_n++], r->section, sizeof r->section);
	return 0;
}

static int unknown_key(const struct reading *r, const char *name, struct err *err)
{
	const char *near = profile_key_near(r->section, name);
	const struct profile_key *k;

	line_error(r, err, *r->section ? "there is no key %.40s in [%s]" : "there is no key %.40s%s", name,
		   *r->section ? r->section : " before the sections");
	for (size_t i = 0; !near && (k = profile_key_at(i)); i++)
		if (!strcmp(k->name, name))
			return err_add_hint(err, *k->section ? "it stands in [%s]" : "it stands before the sections%s",
					    k->section);
	return near ? err_add_hint(err, "%s is likely meant", near) : err_add_hint(err, "acut-scanners.d(5) lists them");
}

static int read_key(struct reading *r, char *s, struct err *err)
{
	char wanted[PROFILE_WANTED_SIZE] = "", *eq = strchr(s, '='), *value, *name;
	const struct profile_key *k;
	size_t n;

	if (!eq)
		return line_error(r, err, "neither a section nor \"key = value\": %.60s", s);
	*eq = '\0';
	name = trim(s);
	value = trim(eq + 1);
	n = strlen(value);
	if (*value == '"') {
		if (n < 2 || value[n - 1] != '"')
			return line_error(r, err, "a quote that is not closed");
		value[n - 1] = '\0';
		value++;
	} else if (!n) {
		return line_error(r, err, "a value is missing");
	}
	k = profile_key_find(r->section, name);
	if (!k)
		return unknown_key(r, name, err);
	for (size_t i = 0; i < r->set_n; i++)
		if (r->set[i] == k)
			return line_error(r, err, "%s stands twice", name);
	if (k->type != PROFILE_SEND && k->type != PROFILE_ANSWER)
		r->set[r->set_n++] = k;
	if (!profile_value_read(k, value, r->to, wanted))
		return line_error(r, err, "%s = %.80s: %s is wanted", name, value, wanted);
	return 0;
}

static int read_line(struct reading *r, const char *at, size_t size, struct err *err)
{
	char line[PROFILE_LINE_MAX + 1], *s;

	if (size && at[size - 1] == '\r')
		size--;
	if (size > PROFILE_LINE_MAX)
		return line_error(r, err, "longer than %d bytes", PROFILE_LINE_MAX);
	if (memchr(at, 0, size))
		return line_error(r, err, "a zero byte: this is no text");
	memcpy(line, at, size);
	line[size] = '\0';
	s = trim(line);
	if (!*s || *s == '#' || *s == ';')
		return 0;
	return *s == '[' ? read_section(r, s, err) : read_key(r, s, err);
}

int profile_parse(const char *text, size_t size, const char *name, const char *file, struct profile *ret, struct err *err)
{
	struct profile p;
	struct reading r = {.file = file, .to = &p};
	size_t at = size >= 3 && !memcmp(text, "\xef\xbb\xbf", 3) ? 3 : 0;
	size_t n = strlen(name);
	int rc = 0;

	set_defaults(&p, n < PROFILE_NAME_SIZE ? name : "");
	if (!n || n >= PROFILE_NAME_SIZE ||
	    strspn(name, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_.") != n || *name == '.' ||
	    *name == '-')
		rc = line_error(&r, err, "the name of a profile is 1 to %d letters, digits, -, _ and .", PROFILE_NAME_SIZE - 1);
	else if (size > PROFILE_FILE_MAX)
		rc = line_error(&r, err, "more than %d bytes", PROFILE_FILE_MAX);
	while (!rc && at < size) {
		const char *end = memchr(text + at, '\n', size - at);
		size_t next = end ? (size_t)(end - text) : size;

		r.line++;
		rc = read_line(&r, text + at, next - at, err);
		at = next + 1;
	}
	if (!rc && (rc = profile_check(&p, err)) < 0)
		err_add_file(err, file);
	if (!rc)
		*ret = p;
	return rc;
}
