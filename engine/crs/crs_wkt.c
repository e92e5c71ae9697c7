/*
 * Well-known text, the old kind (OGC 01-009, "WKT 1", with ESRI's and GDAL's habits) and the new kind
 * (ISO 19162, "WKT 2"): KEYWORD[argument, argument, ...] with nested keywords, brackets square or round.
 *
 * Model: one pass with a stack of open keywords, of bounded depth. When a keyword closes, what it said is
 * handed to the keyword around it: a unit to the axis or system, an EPSG code to the system, a system to
 * the answer, if nothing but compound and bound systems is around it. Texts that are not well-formed,
 * or nested too deeply, say nothing. No projection is understood.
 */
#include "crs.h"
#include "crs_parts.h"

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum kind {
	KIND_OTHER,
	KIND_PROJECTED,
	KIND_GEOGRAPHIC,
	KIND_GEODETIC, /* WKT 2: geographic or geocentric, its CS says which */
	KIND_GEOCENTRIC,
	KIND_VERTICAL,
	KIND_LOCAL,
	KIND_COMPOUND,
	KIND_AROUND, /* a keyword that only wraps a system */
	KIND_CS,
	KIND_AXIS,
	KIND_LENGTH,
	KIND_ANGLE,
	KIND_UNIT, /* WKT 1: of length or of angle, by what it belongs to */
	KIND_ID,
};

static const struct { const char *word; enum kind kind; } keywords[] = {
	{ "PROJCS", KIND_PROJECTED },        { "PROJCRS", KIND_PROJECTED },
	{ "PROJECTEDCRS", KIND_PROJECTED },  { "DERIVEDPROJCRS", KIND_PROJECTED },
	{ "GEOGCS", KIND_GEOGRAPHIC },       { "GEOGCRS", KIND_GEOGRAPHIC },
	{ "GEOGRAPHICCRS", KIND_GEOGRAPHIC }, { "GEODCRS", KIND_GEODETIC },
	{ "GEODETICCRS", KIND_GEODETIC },    { "GEOCCS", KIND_GEOCENTRIC },
	{ "VERT_CS", KIND_VERTICAL },        { "VERTCS", KIND_VERTICAL },
	{ "VERTCRS", KIND_VERTICAL },        { "VERTICALCRS", KIND_VERTICAL },
	{ "LOCAL_CS", KIND_LOCAL },          { "ENGCRS", KIND_LOCAL },
	{ "ENGINEERINGCRS", KIND_LOCAL },    { "COMPD_CS", KIND_COMPOUND },
	{ "COMPOUNDCRS", KIND_COMPOUND },    { "BOUNDCRS", KIND_AROUND },
	{ "SOURCECRS", KIND_AROUND },        { "CS", KIND_CS },
	{ "AXIS", KIND_AXIS },               { "LENGTHUNIT", KIND_LENGTH },
	{ "ANGLEUNIT", KIND_ANGLE },         { "UNIT", KIND_UNIT },
	{ "AUTHORITY", KIND_ID },            { "ID", KIND_ID },
};

struct span {
	const char *at;
	size_t size;
};

enum { DEPTH = 32, AXES = 3, ARGUMENTS = 2 };

struct node {
	enum kind kind;
	unsigned n_args, n_axes;
	struct span arg[ARGUMENTS]; /* the first ones, quotes taken off */
	const char *unit;           /* NULL: not said */
	const char *axis_unit[AXES];
	unsigned epsg;              /* 0: not said */
	bool cartesian, ellipsoidal;
};

struct reader {
	const char *at, *end;
	struct node stack[DEPTH];
	unsigned depth;
	struct crs_info *info;
	bool has_horizontal, has_vertical;
};

static bool span_is(struct span s, const char *word)
{
	return s.size == strlen(word) && !strncasecmp(s.at, word, s.size);
}

static enum kind keyword(struct span s)
{
	for (size_t i = 0; i < sizeof keywords / sizeof *keywords; i++)
		if (span_is(s, keywords[i].word))
			return keywords[i].kind;
	return KIND_OTHER;
}

static bool span_double(struct span s, double *ret)
{
	char text[40], *end;

	if (!s.size || s.size >= sizeof text)
		return false;
	memcpy(text, s.at, s.size);
	text[s.size] = 0;
	*ret = strtod(text, &end);
	return !*end;
}

static unsigned span_code(struct span s)
{
	unsigned n = 0;

	if (!s.size || s.size > 6)
		return 0;
	for (size_t i = 0; i < s.size; i++) {
		if (s.at[i] < '0' || s.at[i] > '9')
			return 0;
		n = n * 10 + (unsigned)(s.at[i] - '0');
	}
	return n;
}

/* The factor defines a unit. A name that plainly speaks of another one is a contradiction: unknown. */
static const char *unit_of(const struct node *n, bool angle)
{
	double factor;
	const char *unit;
	struct span name = n->arg[0];
	bool survey = false, metre;

	if (!span_double(n->arg[1], &factor))
		return crs_unknown;
	unit = angle ? crs_unit_of_angle(factor) : crs_unit_of_length(factor);
	for (size_t i = 0; i + 6 <= name.size; i++)
		survey |= !strncasecmp(name.at + i, "survey", 6);
	survey |= span_is(name, "Foot_US") || span_is(name, "ftUS");
	metre = span_is(name, "metre") || span_is(name, "meter") || span_is(name, "m");
	if ((survey && strcmp(unit, "us-survey-foot")) || (metre && strcmp(unit, "metre")))
		return crs_unknown;
	return unit;
}

static bool is_angular(enum kind kind)
{
	return kind == KIND_GEOGRAPHIC || kind == KIND_GEODETIC;
}

/* WKT 1 has one UNIT for the system. WKT 2 may have one for each axis, and heights have a third. */
static const char *horizontal_unit(const struct node *n)
{
	const char *a = n->axis_unit[0], *b = n->axis_unit[1];

	if (a && (!b || !strcmp(a, b)))
		return a;
	if (a)
		return crs_unknown;
	return n->unit ? n->unit : crs_unknown;
}

static void append_name(struct reader *r, const struct node *n)
{
	char text[24];

	if (n->epsg)
		crs_text_append(r->info, " + ", text, (size_t)snprintf(text, sizeof text, "EPSG:%u", n->epsg));
	else
		crs_text_append(r->info, " + ", n->arg[0].at, n->arg[0].size);
}

static enum crs_plane plane_of(const struct node *n)
{
	switch (n->kind) {
	case KIND_PROJECTED:
		return CRS_PLANE_PROJECTED;
	case KIND_GEOGRAPHIC:
		return CRS_PLANE_GEOGRAPHIC;
	case KIND_GEOCENTRIC:
		return CRS_PLANE_GEOCENTRIC;
	case KIND_GEODETIC:
		return n->cartesian ? CRS_PLANE_GEOCENTRIC
				    : n->ellipsoidal ? CRS_PLANE_GEOGRAPHIC : CRS_PLANE_UNKNOWN;
	default:
		return CRS_PLANE_UNKNOWN;
	}
}

static void close_system(struct reader *r, const struct node *n)
{
	if (n->kind == KIND_VERTICAL) {
		if (r->has_vertical)
			return;
		r->has_vertical = true;
		crs_set_unit(r->info->unit_z, horizontal_unit(n));
	} else {
		if (r->has_horizontal)
			return;
		r->has_horizontal = true;
		r->info->plane = plane_of(n);
		crs_set_unit(r->info->unit_xy, horizontal_unit(n));
		if (r->info->plane == CRS_PLANE_GEOCENTRIC)
			crs_set_unit(r->info->unit_z, r->info->unit_xy);
		else if (n->axis_unit[2])
			crs_set_unit(r->info->unit_z, n->axis_unit[2]);
	}
	append_name(r, n);
}

/* True if the keyword at the top of the stack is the answer itself: nothing around it but wrappers. */
static bool is_outermost(const struct reader *r)
{
	for (unsigned i = 0; i + 1 < r->depth; i++)
		if (r->stack[i].kind != KIND_COMPOUND && r->stack[i].kind != KIND_AROUND)
			return false;
	return true;
}

static void close_unit(const struct node *n, struct node *parent, enum kind system)
{
	bool angle = n->kind == KIND_ANGLE || (n->kind == KIND_UNIT && is_angular(system));

	if (!parent->unit)
		parent->unit = unit_of(n, angle);
}

static void close_node(struct reader *r)
{
	struct node *n = &r->stack[r->depth - 1], *parent = r->depth > 1 ? n - 1 : NULL;
	enum kind system = parent && parent->kind == KIND_AXIS && r->depth > 2 ? n[-2].kind
			   : parent ? parent->kind : KIND_OTHER;

	switch (n->kind) {
	case KIND_UNIT:
	case KIND_LENGTH:
	case KIND_ANGLE:
		if (parent)
			close_unit(n, parent, system);
		break;
	case KIND_ID:
		if (parent && !parent->epsg && span_is(n->arg[0], "EPSG"))
			parent->epsg = span_code(n->arg[1]);
		break;
	case KIND_CS:
		if (parent) {
			parent->cartesian = span_is(n->arg[0], "Cartesian");
			parent->ellipsoidal = span_is(n->arg[0], "ellipsoidal");
		}
		break;
	case KIND_AXIS:
		if (parent && parent->n_axes < AXES)
			parent->axis_unit[parent->n_axes++] = n->unit;
		break;
	case KIND_PROJECTED:
	case KIND_GEOGRAPHIC:
	case KIND_GEODETIC:
	case KIND_GEOCENTRIC:
	case KIND_VERTICAL:
	case KIND_LOCAL:
		if (is_outermost(r))
			close_system(r, n);
		break;
	default:
		break;
	}
	r->depth--;
}

static void argument(struct reader *r, struct span s)
{
	struct node *n;

	if (!r->depth)
		return;
	n = &r->stack[r->depth - 1];
	if (n->n_args < ARGUMENTS)
		n->arg[n->n_args] = s;
	n->n_args++;
}

static bool is_word(char c)
{
	return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
	       c == '+' || c == '-' || c == '.';
}

static bool is_space(char c)
{
	return c == ' ' || c == '\t' || c == '\n' || c == '\r';
}

/* "..." with "" for a quote inside; the span keeps doubled quotes, which is good enough for a name. */
static bool read_quoted(struct reader *r)
{
	struct span s = { .at = ++r->at };

	for (; r->at < r->end; r->at++) {
		if (*r->at != '"')
			continue;
		if (r->at + 1 == r->end || r->at[1] != '"')
			break;
		r->at++;
	}
	if (r->at >= r->end)
		return false;
	s.size = (size_t)(r->at++ - s.at);
	argument(r, s);
	return true;
}

/* A keyword with its opening bracket, or a bare argument. */
static bool read_word(struct reader *r)
{
	struct span s = { .at = r->at };

	while (r->at < r->end && is_word(*r->at))
		r->at++;
	s.size = (size_t)(r->at - s.at);
	while (r->at < r->end && is_space(*r->at))
		r->at++;
	if (r->at == r->end || (*r->at != '[' && *r->at != '(')) {
		argument(r, s);
		return true;
	}
	if (r->depth == DEPTH)
		return false;
	r->at++;
	r->stack[r->depth] = (struct node){ .kind = keyword(s) };
	r->depth++;
	return true;
}

/* False if it is not well-formed, or ends before its last bracket. */
static bool read_tree(struct reader *r)
{
	while (r->at < r->end) {
		char c = *r->at;

		if (is_space(c) || c == ',') {
			r->at++;
		} else if (c == ']' || c == ')') {
			if (!r->depth)
				return false;
			close_node(r);
			r->at++;
			if (!r->depth)
				return true;
		} else if (c == '"') {
			if (!read_quoted(r))
				return false;
		} else if (!is_word(c) || !read_word(r)) {
			return false;
		}
	}
	return false;
}

bool crs_read_wkt(const void *text, size_t size, struct crs_info *ret)
{
	struct reader r = { .at = text, .info = ret };

	crs_info_clear(ret);
	if (!size)
		return false;
	r.end = r.at + strnlen(text, size);
	if (!read_tree(&r) || !(r.has_horizontal || r.has_vertical)) {
		crs_info_clear(ret);
		return false;
	}
	return true;
}
