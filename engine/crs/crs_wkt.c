/*
 * Well-known text, the old kind (OGC 01-009, "WKT 1", with ESRI's and GDAL's habits) and the new kind
 * (ISO 19162, "WKT 2"): KEYWORD[argument, argument, ...] with nested keywords, brackets square or round.
 *
 * Model: one pass with a stack of open keywords, of bounded depth. When a keyword closes, what it said is
 * handed to the keyword around it (a unit to the axis, parameter or system; an EPSG number to the system), or to
 * the horizontal system that is being read (ellipsoid, datum, method, parameters: crs_wkt_system.c); a system is
 * the answer if nothing but compound and bound systems is around it. Texts that are not well-formed, or nested
 * too deeply, say nothing. ESRI puts the vertical system behind the horizontal one, with a comma.
 */
#include <string.h>

#include "crs_wkt.h"

static const struct {
	const char *word;
	enum wkt_kind kind;
} keywords[] = {
	{"PROJCS", WKT_PROJECTED},
	{"PROJCRS", WKT_PROJECTED},
	{"PROJECTEDCRS", WKT_PROJECTED},
	{"DERIVEDPROJCRS", WKT_DERIVED},
	{"GEOGCS", WKT_GEOGRAPHIC},
	{"GEOGCRS", WKT_GEOGRAPHIC},
	{"GEOGRAPHICCRS", WKT_GEOGRAPHIC},
	{"GEODCRS", WKT_GEODETIC},
	{"GEODETICCRS", WKT_GEODETIC},
	{"GEOCCS", WKT_GEOCENTRIC},
	{"VERT_CS", WKT_VERTICAL},
	{"VERTCS", WKT_VERTICAL},
	{"VERTCRS", WKT_VERTICAL},
	{"VERTICALCRS", WKT_VERTICAL},
	{"LOCAL_CS", WKT_LOCAL},
	{"ENGCRS", WKT_LOCAL},
	{"ENGINEERINGCRS", WKT_LOCAL},
	{"COMPD_CS", WKT_COMPOUND},
	{"COMPOUNDCRS", WKT_COMPOUND},
	{"BOUNDCRS", WKT_AROUND},
	{"SOURCECRS", WKT_AROUND},
	{"CS", WKT_CS},
	{"AXIS", WKT_AXIS},
	{"LENGTHUNIT", WKT_LENGTH},
	{"ANGLEUNIT", WKT_ANGLE},
	{"SCALEUNIT", WKT_SCALE},
	{"UNIT", WKT_UNIT},
	{"AUTHORITY", WKT_ID},
	{"ID", WKT_ID},
	{"BASEGEOGCRS", WKT_BASE},
	{"BASEGEODCRS", WKT_BASE},
	{"DATUM", WKT_DATUM},
	{"TRF", WKT_DATUM},
	{"GEODETICDATUM", WKT_DATUM},
	{"ENSEMBLE", WKT_DATUM},
	{"SPHEROID", WKT_ELLIPSOID},
	{"ELLIPSOID", WKT_ELLIPSOID},
	{"PRIMEM", WKT_MERIDIAN},
	{"PRIMEMERIDIAN", WKT_MERIDIAN},
	{"PROJECTION", WKT_METHOD},
	{"METHOD", WKT_METHOD},
	{"PARAMETER", WKT_PARAMETER},
	{"DERIVINGCONVERSION", WKT_DERIVING},
	{"BASEPROJCRS", WKT_DERIVING},
};

struct reader {
	const char *at, *end;
	struct wkt_node stack[WKT_DEPTH];
	unsigned depth;
	struct crs_info *info;
	struct wkt_system system; /* the horizontal one that is being read */
	bool has_horizontal, has_vertical;
	struct crs_span plane; /* the text of the horizontal one */
};

static enum wkt_kind keyword(struct crs_span s)
{
	for (size_t i = 0; i < sizeof keywords / sizeof *keywords; i++)
		if (wkt_span_is(s, keywords[i].word))
			return keywords[i].kind;
	return WKT_OTHER;
}

static bool is_horizontal(enum wkt_kind kind)
{
	return kind == WKT_PROJECTED || kind == WKT_DERIVED || kind == WKT_GEOGRAPHIC || kind == WKT_GEODETIC ||
	       kind == WKT_GEOCENTRIC || kind == WKT_LOCAL;
}

static bool is_angular(enum wkt_kind kind)
{
	return kind == WKT_GEOGRAPHIC || kind == WKT_GEODETIC || kind == WKT_BASE;
}

/* How many keywords that only wrap a system are around the keyword at the bottom of what is open. */
static unsigned wrappers(const struct reader *r)
{
	unsigned n = 0;

	while (n < r->depth && (r->stack[n].kind == WKT_COMPOUND || r->stack[n].kind == WKT_AROUND))
		n++;
	return n;
}

static void append_name(struct reader *r, const struct wkt_node *n)
{
	if (n->epsg)
		crs_text_append_epsg(r->info, n->epsg);
	else
		crs_text_append(r->info, n->arg[0].at, n->arg[0].size);
}

static void close_vertical(struct reader *r, const struct wkt_node *n)
{
	const char *unit = wkt_unit_name(n->n_axes && n->axis[0].said ? &n->axis[0] : &n->unit, n->kind);

	if (r->has_vertical)
		return;
	r->has_vertical = true;
	if (crs_is_unknown(unit) && !n->unit.said && !n->axis[0].said)
		unit = crs_epsg_height_unit(n->epsg);
	crs_set_unit(r->info->unit_z, unit);
	r->info->system.epsg_z = n->epsg;
	append_name(r, n);
}

static void close_horizontal(struct reader *r, struct wkt_node *n)
{
	if (r->has_horizontal)
		return;
	r->has_horizontal = true;
	r->plane = (struct crs_span){n->from, (size_t)(r->at + 1 - n->from)};
	wkt_system_settle(&r->system, n, r->info);
	append_name(r, n);
}

/* True if the keyword that closes belongs to the first horizontal system, and not to a transformation. */
static bool in_horizontal(const struct reader *r)
{
	unsigned at = wrappers(r);

	return !r->has_horizontal && at + 1 < r->depth && is_horizontal(r->stack[at].kind);
}

static void close_unit(const struct reader *r, const struct wkt_node *n, struct wkt_node *parent)
{
	enum wkt_kind around = parent->kind == WKT_AXIS && r->depth > 2 ? n[-2].kind : parent->kind;
	struct wkt_unit *unit = &parent->unit;

	if (unit->said)
		return;
	unit->said = true;
	unit->angle = n->kind == WKT_ANGLE || (n->kind == WKT_UNIT && is_angular(around));
	wkt_unit_read(n, unit);
}

static void close_part(struct reader *r, const struct wkt_node *n, struct wkt_node *parent)
{
	switch (n->kind) {
	case WKT_UNIT:
	case WKT_LENGTH:
	case WKT_ANGLE:
	case WKT_SCALE:
		close_unit(r, n, parent);
		break;
	case WKT_ID:
		if (!parent->epsg && wkt_span_is(n->arg[0], "EPSG"))
			parent->epsg = wkt_span_code(n->arg[1]);
		break;
	case WKT_CS:
		parent->cartesian = wkt_span_is(n->arg[0], "Cartesian");
		parent->ellipsoidal = wkt_span_is(n->arg[0], "ellipsoidal");
		break;
	case WKT_AXIS:
		if (parent->n_axes < WKT_AXES)
			parent->axis[parent->n_axes++] = n->unit;
		break;
	default:
		break;
	}
	if (in_horizontal(r))
		wkt_system_part(&r->system, n);
}

static void close_node(struct reader *r)
{
	struct wkt_node *n = &r->stack[r->depth - 1];

	if (r->depth > 1)
		close_part(r, n, n - 1);
	if (wrappers(r) + 1 == r->depth) {
		if (n->kind == WKT_VERTICAL)
			close_vertical(r, n);
		else if (is_horizontal(n->kind))
			close_horizontal(r, n);
	}
	r->depth--;
}

static void argument(struct reader *r, struct crs_span s)
{
	struct wkt_node *n;

	if (!r->depth)
		return;
	n = &r->stack[r->depth - 1];
	if (n->n_args < WKT_ARGUMENTS)
		n->arg[n->n_args] = s;
	n->n_args++;
}

static bool is_word(char c)
{
	return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '+' || c == '-' ||
	       c == '.';
}

static bool is_space(char c)
{
	return c == ' ' || c == '\t' || c == '\n' || c == '\r';
}

/* "..." with "" for a quote inside; the span keeps doubled quotes, which is good enough for a name. */
static bool read_quoted(struct reader *r)
{
	struct crs_span s = {.at = ++r->at};

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
	struct crs_span s = {.at = r->at};

	while (r->at < r->end && is_word(*r->at))
		r->at++;
	s.size = (size_t)(r->at - s.at);
	while (r->at < r->end && is_space(*r->at))
		r->at++;
	if (r->at == r->end || (*r->at != '[' && *r->at != '(')) {
		argument(r, s);
		return true;
	}
	if (r->depth == WKT_DEPTH)
		return false;
	r->at++;
	r->stack[r->depth] = (struct wkt_node){.kind = keyword(s), .from = s.at};
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

/* A COMPD_CS by any other means: systems with commas between them. */
static bool read_trees(struct reader *r)
{
	for (;;) {
		if (!read_tree(r))
			return false;
		while (r->at < r->end && is_space(*r->at))
			r->at++;
		if (r->at == r->end || *r->at != ',' || !r->has_horizontal || r->has_vertical)
			return true;
		r->at++;
	}
}

bool wkt_read(const void *text, size_t size, struct crs_info *ret, struct crs_span *ret_all, struct crs_span *ret_plane)
{
	struct reader r = {.at = text, .info = ret};

	crs_info_clear(ret);
	if (!size)
		return false;
	r.end = r.at + strnlen(text, size);
	if (!read_trees(&r) || !(r.has_horizontal || r.has_vertical)) {
		crs_info_clear(ret);
		return false;
	}
	crs_info_settle(ret);
	*ret_all = (struct crs_span){text, (size_t)(r.at - (const char *)text)};
	*ret_plane = r.plane;
	return true;
}

bool crs_read_wkt(const void *text, size_t size, struct crs_info *ret)
{
	struct crs_span all, plane;

	return wkt_read(text, size, ret, &all, &plane);
}
