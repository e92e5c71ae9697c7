/*
 * Areas from GeoJSON (RFC 7946): Polygon, MultiPolygon, GeometryCollection, Feature, FeatureCollection. json-c parses it and
 * keeps the text of numbers with a point or exponent, so they become exact decimals without a double between. Coordinates are
 * in the plane of the dataset, whatever the standard says of degrees. The old member "crs", which names another system, is kept.
 * Other geometries are refused: a line is not an area.
 */
#include <json-c/json.h>
#include <stdarg.h>
#include <string.h>

#include "ctl_area.h"
#include "err.h"

struct reader {
	struct ctl_area *area;
	struct err *err;
	char path[64]; /* where in the document, as features[3].geometry; its end if it is long */
	size_t n;
};

enum { DEPTH_MOST = 32 };

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
	err_set(r->err, ERR_INPUT, "%s", what);
	return err_add_place(r->err, ERR_NO_OFFSET, *r->path ? r->path : NULL);
}

static int number(struct reader *r, struct json_object *o, struct decimal *ret)
{
	enum json_type type = json_object_get_type(o);
	int64_t v = json_object_get_int64(o);

	if (type != json_type_int && type != json_type_double)
		return bad(r, "a coordinate is not a number");
	/* Integers are kept in 64 bits, clamped. */
	if ((type == json_type_int && (v == INT64_MAX || v == INT64_MIN)) ||
	    !decimal_parse(json_object_to_json_string_ext(o, JSON_C_TO_STRING_PLAIN), ret)) {
		bad(r, "a coordinate cannot be kept exactly");
		return err_add_hint(r->err, "coordinates are decimals of at most 18 digits");
	}
	return 0;
}

static int corner(struct reader *r, struct json_object *o)
{
	struct decimal d[2];
	int rc;

	if (!json_object_is_type(o, json_type_array) || json_object_array_length(o) < 2)
		return bad(r, "a corner is not a list of at least two numbers");
	for (size_t k = 0; k < 2; k++)
		if ((rc = number(r, json_object_array_get_idx(o, k), &d[k])))
			return rc;
	return ctl_area_corner(r->area, d[0], d[1], r->err);
}

typedef int each_fn(struct reader *, struct json_object *, size_t index);

static int for_each(struct reader *r, struct json_object *list, const char *what, each_fn *each)
{
	if (!json_object_is_type(list, json_type_array))
		return bad(r, what);
	for (size_t i = 0; i < json_object_array_length(list); i++) {
		size_t before = enter(r, "[%zu]", i);
		int rc = each(r, json_object_array_get_idx(list, i), i);

		if (rc)
			return rc;
		leave(r, before);
	}
	return 0;
}

static int ring_corner(struct reader *r, struct json_object *o, size_t index)
{
	return corner(r, o);
}

static int polygon_ring(struct reader *r, struct json_object *o, size_t index)
{
	int rc = ctl_area_ring(r->area, index == 0, r->err);

	return rc ? rc : for_each(r, o, "a ring is not a list of corners", ring_corner);
}

static int polygon(struct reader *r, struct json_object *o, size_t index)
{
	return for_each(r, o, "the coordinates of a polygon are not a list of rings", polygon_ring);
}

static int thing(struct reader *r, struct json_object *o, size_t index);

static int member(struct reader *r, struct json_object *o, const char *name, const char *what, each_fn *each)
{
	size_t before = enter(r, "%s%s", r->n ? "." : "", name);
	struct json_object *list;
	int rc;

	if (!json_object_object_get_ex(o, name, &list))
		return bad(r, what);
	rc = for_each(r, list, what, each);
	if (!rc)
		leave(r, before);
	return rc;
}

static int feature(struct reader *r, struct json_object *o)
{
	size_t before = enter(r, "%sgeometry", r->n ? "." : "");
	struct json_object *geometry;
	int rc = 0;

	if (!json_object_object_get_ex(o, "geometry", &geometry))
		return bad(r, "a feature has no geometry");
	if (geometry) /* null: a feature without a place */
		rc = thing(r, geometry, 0);
	if (!rc)
		leave(r, before);
	return rc;
}

/* {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::2154"}} */
static int system_of(struct reader *r, struct json_object *o)
{
	struct json_object *crs, *properties, *name;
	const char *text;

	if (!json_object_object_get_ex(o, "crs", &crs) || !json_object_object_get_ex(crs, "properties", &properties) ||
	    !json_object_object_get_ex(properties, "name", &name) || !json_object_is_type(name, json_type_string))
		return 0;
	text = json_object_get_string(name);
	if (*r->area->crs && strncmp(r->area->crs, text, sizeof(r->area->crs) - 1))
		return bad(r, "it names two coordinate systems");
	snprintf(r->area->crs, sizeof(r->area->crs), "%s", text);
	return 0;
}

static int thing(struct reader *r, struct json_object *o, size_t index)
{
	struct json_object *type;
	const char *name;

	if (!json_object_is_type(o, json_type_object) || !json_object_object_get_ex(o, "type", &type) ||
	    !json_object_is_type(type, json_type_string))
		return bad(r, "this is no GeoJSON: it has no type");
	if (system_of(r, o))
		return -(int)r->err->code;
	name = json_object_get_string(type);
	if (!strcmp(name, "Polygon")) {
		size_t before = enter(r, "%scoordinates", r->n ? "." : "");
		struct json_object *list;
		int rc;

		if (!json_object_object_get_ex(o, "coordinates", &list))
			return bad(r, "a polygon has no coordinates");
		rc = polygon(r, list, 0);
		if (!rc)
			leave(r, before);
		return rc;
	}
	if (!strcmp(name, "MultiPolygon"))
		return member(r, o, "coordinates", "a multipolygon has no list of polygons", polygon);
	if (!strcmp(name, "GeometryCollection"))
		return member(r, o, "geometries", "a collection has no list of geometries", thing);
	if (!strcmp(name, "FeatureCollection"))
		return member(r, o, "features", "a collection has no list of features", thing);
	if (!strcmp(name, "Feature"))
		return feature(r, o);
	err_set(r->err, ERR_INPUT, "a %.40s is no area", name);
	err_add_place(r->err, ERR_NO_OFFSET, *r->path ? r->path : NULL);
	return err_add_hint(r->err, "an area is made of polygons and multipolygons");
}

static int parse(const char *text, size_t size, struct json_object **ret, struct err *err)
{
	struct json_tokener *t = json_tokener_new_ex(DEPTH_MOST);
	enum json_tokener_error e;
	uint64_t at;

	if (!t)
		return err_set(err, ERR_NOMEM, "no memory for an area");
	json_tokener_set_flags(t, JSON_TOKENER_STRICT);
	*ret = json_tokener_parse_ex(t, text, (int)size + 1); /* with its end, so that it knows */
	e = json_tokener_get_error(t);
	at = json_tokener_get_parse_end(t);
	json_tokener_free(t);
	if (e == json_tokener_success && *ret)
		return 0;
	json_object_put(*ret);
	err_set(err, ERR_INPUT, "it starts as JSON and is not: %s",
		e == json_tokener_continue ? "it ends too early" : json_tokener_error_desc(e));
	return err_add_place(err, at, NULL);
}

int ctl_area_json(const char *text, size_t size, struct ctl_area *area, struct err *err)
{
	struct reader r = {.area = area, .err = err};
	struct json_object *document = NULL;
	size_t skip = size >= 3 && !memcmp(text, "\xef\xbb\xbf", 3) ? 3 : 0;
	int rc = parse(text + skip, size - skip, &document, err);

	if (rc)
		return rc;
	rc = thing(&r, document, 0);
	json_object_put(document);
	return rc;
}
