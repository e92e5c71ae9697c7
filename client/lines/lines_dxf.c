/*
 * DXF as text, from R12 on (DXF Reference, AutoCAD 2018): pairs of a code and a value, a line each. Of the header the version and
 * $INSUNITS are used, of the other sections only ENTITIES: blocks are not. Layers are those of the entities.
 */
#include "lines_dxf.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "parse.h"

static const char binary[] = "AutoCAD Binary DXF\r\n\x1a";

/* The next line without the blanks around it; false: there is none. */
static bool head_line(const uint8_t **at, const uint8_t *end, const char **ret, size_t *ret_n)
{
	const uint8_t *stop = *at < end ? memchr(*at, '\n', (size_t)(end - *at)) : NULL;

	if (!stop)
		return false;
	*ret = (const char *)*at;
	*ret_n = (size_t)(stop - *at);
	*at = stop + 1;
	while (*ret_n && lines_is_blank(**ret))
		++*ret, --*ret_n;
	while (*ret_n && lines_is_blank((*ret)[*ret_n - 1]))
		--*ret_n;
	return true;
}

/* Comments, then the begin of a section. */
static bool matches(const uint8_t *head, size_t n)
{
	const uint8_t *at = head, *end = head + n;
	const char *line;
	size_t size;

	if (n >= sizeof binary && !memcmp(head, binary, sizeof binary - 1))
		return true;
	if (n >= 3 && !memcmp(head, "\xef\xbb\xbf", 3))
		at += 3;
	while (head_line(&at, end, &line, &size)) {
		if (size == 1 && *line == '0')
			return head_line(&at, end, &line, &size) && size == 7 && !memcmp(line, "SECTION", 7);
		if (size != 3 || memcmp(line, "999", 3) != 0 || !head_line(&at, end, &line, &size))
			return false;
	}
	return false;
}

/* ---- pairs ---- */

static void trim(char *text)
{
	size_t n = strlen(text), first = 0;

	while (n && lines_is_blank(text[n - 1]))
		n--;
	while (first < n && lines_is_blank(text[first]))
		first++;
	memmove(text, text + first, n - first);
	text[n - first] = 0;
}

int lines_dxf_pair(struct lines_dxf *d)
{
	char code[64];
	int64_t v;
	size_t n;
	bool cut;
	int rc;

	d->line = d->source.line;
	rc = text_source_line(&d->source, code, sizeof code, &n, &cut);
	if (rc)
		return rc;
	if (n == SIZE_MAX)
		return lines_bad(d->l, d->source.err, d->line, "it ends without its EOF");
	trim(code);
	if (cut || !parse_i64(code, &v) || v < -10000 || v > 10000)
		return lines_bad(d->l, d->source.err, d->line, "\"%.20s\" is no group code", code);
	d->code = (int)v;
	rc = text_source_line(&d->source, d->value, sizeof d->value, &n, &cut);
	if (!rc && n == SIZE_MAX)
		return lines_bad(d->l, d->source.err, d->line, "a group code has no value");
	trim(d->value);
	return rc;
}

int lines_dxf_number(struct lines_dxf *d, struct decimal *ret)
{
	if (lines_number(d->value, strlen(d->value), ret))
		return 0;
	return lines_bad(d->l, d->source.err, d->line + 1, "\"%.40s\" is no number", d->value);
}

int lines_dxf_integer(struct lines_dxf *d, int64_t *ret)
{
	if (parse_i64(d->value, ret))
		return 0;
	return lines_bad(d->l, d->source.err, d->line + 1, "\"%.40s\" is no whole number", d->value);
}

/* ---- sections ---- */

static void set_unit(struct lines_dxf *d, int64_t unit)
{
	static const char *const names[22] = {
		[1] = "inch",  [2] = "foot",      [3] = "mile",  [4] = "millimetre", [5] = "centimetre",
		[6] = "metre", [7] = "kilometre", [10] = "yard", [14] = "decimetre", [21] = "us-survey-foot",
	};

	if (unit > 0 && unit < 22 && names[unit]) {
		strcpy(d->crs.unit, names[unit]);
		d->crs.from = "$INSUNITS";
	}
}

/* A variable of the header: a pair 9 with its name, then its value. */
static int read_variable(struct lines_dxf *d)
{
	bool version = !strcmp(d->value, "$ACADVER"), units = !strcmp(d->value, "$INSUNITS");
	int64_t unit;
	int rc;

	if (!version && !units)
		return 0;
	rc = lines_dxf_pair(d);
	if (rc || (version ? d->code != 1 : d->code != 70))
		return rc;
	if (version)
		lines_utf8(d->value, strlen(d->value), d->l->info.variant, sizeof d->l->info.variant);
	else if (!(rc = lines_dxf_integer(d, &unit)))
		set_unit(d, unit);
	return rc;
}

/* Up to the first pair of the section ENTITIES. */
static int find_entities(struct lines_dxf *d)
{
	bool begins = false;
	int rc;

	while (!(rc = lines_dxf_pair(d))) {
		if (begins && d->code == 2 && !strcmp(d->value, "ENTITIES"))
			return lines_dxf_pair(d);
		begins = d->code == 0 && !strcmp(d->value, "SECTION");
		if (d->code == 0 && !strcmp(d->value, "EOF"))
			return lines_bad(d->l, d->source.err, d->line, "it has no section ENTITIES");
		if (d->code == 9)
			rc = read_variable(d);
		if (rc)
			return rc;
	}
	return rc;
}

static int open_dxf(struct lines *l, struct err *err)
{
	struct lines_dxf *d = l->state = calloc(1, sizeof *d);

	if (!d)
		return err_set(err, ERR_NOMEM, "no memory to read lines");
	d->l = l;
	d->crs.wkt = d->crs.from = "";
	lines_source_begin(&d->source, l, err);
	if (text_source_peek(&d->source) == 'A') {
		err_set(err, ERR_INPUT, "it is binary DXF, which is not read");
		return err_add_hint(err, "save it as text (ASCII) DXF");
	}
	while (text_source_peek(&d->source) >= 0x80)
		text_source_take(&d->source);
	return find_entities(d);
}

static int next_dxf(struct lines *l, bool *ret_more, struct err *err)
{
	struct lines_dxf *d = l->state;
	bool none = true;
	int rc = 0;

	d->source.err = err;
	while (!d->ended && none && !rc) {
		if (d->code)
			rc = lines_dxf_pair(d); /* between entities */
		else if (!strcmp(d->value, "ENDSEC"))
			d->ended = true;
		else if (!strcmp(d->value, "EOF") || !strcmp(d->value, "SECTION"))
			rc = lines_bad(l, err, d->line, "the section ENTITIES has no end");
		else
			rc = lines_dxf_entity(d, &none);
	}
	*ret_more = !none;
	return rc;
}

const struct lines_reader lines_dxf_reader = {
	.name = "dxf",
	.title = "DXF",
	.place = "line",
	.exact = true,
	.matches = matches,
	.open = open_dxf,
	.next = next_dxf,
	.close = lines_free_state,
};
