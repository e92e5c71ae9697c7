/*
 * Areas from GeoJSON (RFC 7946): Polygon, MultiPolygon, GeometryCollection, Feature, FeatureCollection. Numbers become exact
 * decimals without a double between. Coordinates are in the plane of the dataset, whatever the standard says of degrees. The old
 * member "crs", which names another system, is kept. Other geometries are refused: a line is not an area.
 *
 * Nothing of the document is held but the area. Members may stand in any order, so coordinates before their type are skipped,
 * and returned to at the end of their object.
 */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "ctl_area.h"
#include "err.h"
#include "json_reader.h"

struct reader {
	struct json_reader *json;
	struct ctl_area *area;
	struct err *err;
	char path[64]; /* where in the document, as features[3].geometry; its end if it is long */
	size_t n;
	int depth;
	bool in_feature;
	/* of the feature; "": none. Longer than CTL_AREA_NAME if it was. */
	char name[CTL_AREA_NAME + 5];
};

enum { DEPTH_MOST = 16, KEY = 32 };

/* A place to return to. */
struct place {
	uint64_t at, line;
};

/* Adds to the path; what is returned takes it back. */
__attribute__((format(printf, 2, 3))) static size_t enter(struct reader *r, const char *fmt, ...)
{
	size_t before = r->n, room = sizeof(r->path) - r->n;
	va_list ap;
	int n;

	va_start(ap, fmt);
	n = vsnprintf(r->path + r->n, room, fmt, ap);
	va_end(ap);
	r->n += (size_t)n < room ? (size_t)n : room - 1;
	return before;
}

static void leave(struct reader *r, size_t before)
{
	r->n = before;
	r->path[before] = '\0';
}

static int bad(struct reader *r, const char *what)
{
	if (r->json->source.rc)
		return r->json->source.rc;
	err_set(r->err, ERR_INPUT, "%s", what);
	return err_add_place(r->err, ERR_NO_OFFSET, *r->path ? r->path : NULL);
}

/* ---- lists ---- */

/* Reads one item of a list. */
typedef int each_fn(struct reader *, size_t index);

static int for_each(struct reader *r, const char *what, each_fn *each)
{
	bool first = true, more;
	int rc;

	if (json_reader_peek(r->json) != '[')
		return bad(r, what);
	text_source_take(&r->json->source);
	for (size_t i = 0; !(rc = json_reader_more(r->json, ']', &first, &more)) && more; i++) {
		size_t before = enter(r, "[%zu]", i);

		rc = each(r, i);
		if (rc)
			break;
		leave(r, before);
	}
	return rc;
}

/* As JSON has it: [-]digits[.digits][(e|E)[+-]digits], without a zero before other digits. */
static bool is_number(const char *t)
{
	static const char digits[] = "0123456789";
	size_t n;

	t += *t == '-';
	n = strspn(t, digits);
	if (!n || (*t == '0' && n > 1))
		return false;
	t += n;
	if (*t == '.') {
		n = strspn(++t, digits);
		t += n;
		if (!n)
			return false;
	}
	if (*t == 'e' || *t == 'E') {
		t++;
		t += *t == '-' || *t == '+';
		n = strspn(t, digits);
		t += n;
		if (!n)
			return false;
	}
	return !*t;
}

static int number(struct reader *r, struct decimal *ret)
{
	char text[JSON_READER_TOKEN];
	int c = json_reader_peek(r->json), rc;

	if (c == '"' || c == '[' || c == '{')
		return bad(r, "a coordinate is not a number");
	rc = json_reader_token(r->json, text);
	if (rc)
		return rc;
	if (!is_number(text))
		return bad(r, "a coordinate is not a number");
	if (!decimal_parse(text, ret)) {
		bad(r, "a coordinate cannot be kept exactly");
		return err_add_hint(r->err, "coordinates are decimals of at most 18 digits");
	}
	return 0;
}

static int ring_corner(struct reader *r, size_t index)
{
	static const char few[] = "a corner is not a list of at least two numbers";
	struct decimal d[2];
	bool first = true, more;
	unsigned k = 0;
	int rc;

	if (json_reader_peek(r->json) != '[')
		return bad(r, few);
	text_source_take(&r->json->source);
	for (; !(rc = json_reader_more(r->json, ']', &first, &more)) && more; k++) {
		rc = k < 2 ? number(r, &d[k]) : json_reader_skip(r->json);
		if (rc)
			break;
	}
	if (rc)
		return rc;
	return k < 2 ? bad(r, few) : ctl_area_corner(r->area, d[0], d[1], r->err);
}

static int polygon_ring(struct reader *r, size_t index)
{
	int rc = ctl_area_ring(r->area, index == 0, r->err);

	return rc ? rc : for_each(r, "a ring is not a list of corners", ring_corner);
}

static int polygon(struct reader *r, size_t index)
{
	return for_each(r, "the coordinates of a polygon are not a list of rings", polygon_ring);
}

/* ---- things with a type ---- */

static int thing(struct reader *r, size_t index);

static int read_polygon(struct reader *r)
{
	return polygon(r, 0);
}

static int read_polygons(struct reader *r)
{
	return for_each(r, "a multipolygon has no list of polygons", polygon);
}

static int read_geometries(struct reader *r)
{
	return for_each(r, "a collection has no list of geometries", thing);
}

static int read_features(struct reader *r)
{
	return for_each(r, "a collection has no list of features", thing);
}

static int read_geometry(struct reader *r)
{
	/* null: a feature without a place */
	return json_reader_peek(r->json) == 'n' ? json_reader_skip(r->json) : thing(r, 0);
}

static const struct kind {
	const char *type, *member, *missing;
	int (*read)(struct reader *);
} kinds[] = {
	{"Polygon", "coordinates", "a polygon has no coordinates", read_polygon},
	{"MultiPolygon", "coordinates", "a multipolygon has no list of polygons", read_polygons},
	{"GeometryCollection", "geometries", "a collection has no list of geometries", read_geometries},
	{"FeatureCollection", "features", "a collection has no list of features", read_features},
	{"Feature", "geometry", "a feature has no geometry", read_geometry},
};
enum { KINDS = sizeof(kinds) / sizeof(*kinds) };

/* An object with a type, as far as it is read. */
struct object {
	const struct kind *kind;
	struct place place[KINDS]; /* of the member that a thing of this kind has */
	bool has[KINDS], read;
};

static int read_kind(struct reader *r, struct object *o)
{
	char type[KEY];
	int rc;

	if (json_reader_peek(r->json) != '"')
		return bad(r, "this is no GeoJSON: it has no type");
	if (o->kind)
		return bad(r, "it has two types");
	rc = json_reader_string(r->json, type, sizeof(type));
	for (size_t i = 0; i < KINDS && !rc; i++)
		if (!strcmp(kinds[i].type, type))
			o->kind = &kinds[i];
	if (rc || o->kind)
		return rc;
	err_set(r->err, ERR_INPUT, "a %s is no area", type);
	err_add_place(r->err, ERR_NO_OFFSET, *r->path ? r->path : NULL);
	return err_add_hint(r->err, "an area is made of polygons and multipolygons");
}

/* The member that makes it an area. */
static int read_area(struct reader *r, const struct kind *kind)
{
	size_t before = enter(r, "%s%s", r->n ? "." : "", kind->member);
	bool inside = r->in_feature,
	     begins = kind->read == read_geometry || kind->read == read_polygon || kind->read == read_polygons;
	int rc = begins && !inside ? ctl_area_feature(r->area, r->err) : 0;

	r->in_feature |= begins;
	if (!rc)
		rc = kind->read(r);
	r->in_feature = inside;

	if (!rc)
		leave(r, before);
	return rc;
}

/* {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::2154"}}; `nest` 0 is all of it, 1 the properties. */
static int system_of(struct reader *r, unsigned nest)
{
	char key[KEY], name[sizeof(r->area->crs)];
	bool first = true, more;
	int rc;

	if (json_reader_peek(r->json) != '{')
		return json_reader_skip(r->json);
	text_source_take(&r->json->source);
	while (!(rc = json_reader_more(r->json, '}', &first, &more)) && more) {
		rc = json_reader_key(r->json, key, sizeof(key));
		if (rc)
			break;
		if (!nest && !strcmp(key, "properties")) {
			rc = system_of(r, 1);
		} else if (nest && !strcmp(key, "name") && json_reader_peek(r->json) == '"') {
			rc = json_reader_string(r->json, name, sizeof(name));
			if (!rc && *r->area->crs && strcmp(r->area->crs, name) != 0)
				rc = bad(r, "it names two coordinate systems");
			if (!rc)
				strcpy(r->area->crs, name);
		} else {
			rc = json_reader_skip(r->json);
		}
		if (rc)
			break;
	}
	return rc;
}

/* The property that is the name, if it is a text or a number. */
static int name_of(struct reader *r)
{
	char key[CTL_AREA_NAME + 5], token[JSON_READER_TOKEN];
	bool first = true, more;
	int rc, c;

	if (json_reader_peek(r->json) != '{')
		return json_reader_skip(r->json);
	text_source_take(&r->json->source);
	while (!(rc = json_reader_more(r->json, '}', &first, &more)) && more) {
		rc = json_reader_key(r->json, key, sizeof(key));
		if (rc)
			break;
		c = json_reader_peek(r->json);
		if (c != '"' && c != '-' && (c < '0' || c > '9'))
			rc = json_reader_skip(r->json);
		else if (ctl_area_field(r->area, key, r->err))
			rc = -(int)r->err->code;
		else if (strcmp(key, r->area->name_field) != 0)
			rc = json_reader_skip(r->json);
		else if (c == '"')
			rc = json_reader_string(r->json, r->name, sizeof(r->name));
		else if (!(rc = json_reader_token(r->json, token)))
			snprintf(r->name, sizeof(r->name), "%s", token);
		if (rc)
			break;
	}
	return rc;
}

static struct place here(struct reader *r)
{
	json_reader_peek(r->json);
	return (struct place){text_source_at(&r->json->source), r->json->source.line};
}

static int read_member(struct reader *r, struct object *o, const char *key)
{
	bool twice = false;

	if (!strcmp(key, "type"))
		return read_kind(r, o);
	if (!strcmp(key, "crs"))
		return system_of(r, 0);
	if (!strcmp(key, "properties") && r->area->name_field && !r->in_feature)
		return name_of(r);
	for (size_t i = 0; i < KINDS; i++)
		if (!strcmp(kinds[i].member, key)) {
			twice |= o->has[i];
			o->has[i] = true;
			o->place[i] = here(r);
		}
	if (twice)
		return json_reader_bad(r->json, "the %s are given twice", key);
	if (!o->kind || strcmp(o->kind->member, key) != 0)
		return json_reader_skip(r->json);
	o->read = true;
	return read_area(r, o->kind);
}

static int read_members(struct reader *r, struct object *o)
{
	char key[KEY];
	bool first = true, more;
	int rc;

	text_source_take(&r->json->source);
	while (!(rc = json_reader_more(r->json, '}', &first, &more)) && more) {
		rc = json_reader_key(r->json, key, sizeof(key));
		if (!rc)
			rc = read_member(r, o, key);
		if (rc)
			break;
	}
	return rc;
}

static int thing_read(struct reader *r)
{
	struct object o = {.kind = NULL};
	struct place end, at;
	int rc;

	if (json_reader_peek(r->json) != '{')
		return bad(r, "this is no GeoJSON: it has no type");
	if (r->depth == DEPTH_MOST)
		return json_reader_bad(r->json, "collections lie in each other more than %d deep", DEPTH_MOST);
	r->depth++;
	rc = read_members(r, &o);
	r->depth--;
	if (rc)
		return rc;
	if (!o.kind)
		return bad(r, "this is no GeoJSON: it has no type");
	if (o.read)
		return 0;
	if (!o.has[o.kind - kinds]) {
		enter(r, "%s%s", r->n ? "." : "", o.kind->member);
		return bad(r, o.kind->missing);
	}
	end = here(r);
	at = o.place[o.kind - kinds];
	text_source_seek(&r->json->source, at.at, at.line);
	r->depth++;
	rc = read_area(r, o.kind);
	r->depth--;
	text_source_seek(&r->json->source, end.at, end.line);
	return rc;
}

/* Its name may stand before or behind its geometry. */
static int thing(struct reader *r, size_t index)
{
	size_t before = r->area->nfeature;
	int rc;

	if (!r->in_feature)
		r->name[0] = '\0';
	rc = thing_read(r);
	if (!rc && !r->in_feature && r->name[0] && r->area->nfeature == before + 1)
		rc = ctl_area_set_name(r->area, before, r->name, r->err);
	if (!r->in_feature)
		r->name[0] = '\0';
	return rc;
}

int ctl_area_json(struct json_reader *json, struct ctl_area *area, struct err *err)
{
	struct reader r = {.json = json, .area = area, .err = err};
	int rc;

	json->hint = "the file is damaged, or no GeoJSON; write it again";
	rc = thing(&r, 0);
	if (!rc && json_reader_peek(json) >= 0)
		rc = json_reader_bad(json, "something follows the document");
	return rc ? rc : json->source.rc;
}
