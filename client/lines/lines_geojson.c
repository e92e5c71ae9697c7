/*
 * GeoJSON (RFC 7946), and what was written before it: the member "crs" (GeoJSON 2008), also as "coordRefSys" of JSON-FG.
 *
 * Model: the file is read twice. Opening reads all of it once: type, coordinate system, name, where the list of features begins,
 * and that it is JSON to its end. Then each feature is read at its place. Members may stand in any order: coordinates before
 * their type are returned to. Without "crs" coordinates are longitude and latitude of WGS 84, as the standard has it.
 */
#include "lines_priv.h"

#include <stdlib.h>
#include <string.h>

#include "json_reader.h"

enum { COLLECTIONS_MOST = 8, KEY = 64 };

enum geometry { NO_GEOMETRY, POINTS, LINE, LINES, RINGS, POLYGONS, COLLECTION };

static const struct {
	const char *name;
	enum geometry is;
} types[] = {
	{"Point", POINTS},
	{"MultiPoint", POINTS},
	{"LineString", LINE},
	{"MultiLineString", LINES},
	{"Polygon", RINGS},
	{"MultiPolygon", POLYGONS},
	{"GeometryCollection", COLLECTION},
};

/* A place to return to. */
struct place {
	uint64_t at, line;
};

struct geojson {
	struct json_reader json;
	struct lines *l;
	struct lines_layer *layer;
	struct place features;
	char type[KEY];
	uint64_t number;
	bool single, begun, first;
	bool points, lines; /* of this feature */
};

static bool matches(const uint8_t *head, size_t n)
{
	size_t i = n >= 3 && !memcmp(head, "\xef\xbb\xbf", 3) ? 3 : 0;

	while (i < n && (lines_is_blank((char)head[i]) || head[i] == 0x1e))
		i++;
	return i < n && head[i] == '{' &&
	       (memmem(head, n, "\"Feature", 8) || memmem(head, n, "\"coordinates\"", 13) ||
		memmem(head, n, "\"geometries\"", 12) || memmem(head, n, "\"features\"", 10) ||
		memmem(head, n, "\"Topology\"", 10));
}

static struct place here(struct geojson *g)
{
	return (struct place){text_source_at(&g->json.source), g->json.source.line};
}

static void go(struct geojson *g, struct place p)
{
	text_source_seek(&g->json.source, p.at, p.line);
}

static const char *type_name(const char *type, enum geometry *ret)
{
	for (size_t i = 0; i < sizeof types / sizeof *types; i++)
		if (!strcmp(types[i].name, type)) {
			*ret = types[i].is;
			return types[i].name;
		}
	return NULL;
}

/* ---- the document ---- */

/* {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}, or null, or a text. */
static int read_crs(struct geojson *g, struct lines_crs *crs, int nest)
{
	struct json_reader *j = &g->json;
	char key[KEY], token[JSON_READER_TOKEN];
	bool first = true, more;
	int c = json_reader_peek(j), rc = 0;

	if (c == '"') {
		rc = json_reader_string(j, crs->name, sizeof crs->name);
		lines_crs_of_text(crs->name, crs);
		return rc;
	}
	if (c != '{' || nest == 3)
		return json_reader_skip(j);
	text_source_take(&j->source);
	while (!(rc = json_reader_more(j, '}', &first, &more)) && more) {
		rc = json_reader_key(j, key, sizeof key);
		if (rc)
			break;
		if (!strcmp(key, "properties") || !strcmp(key, "name")) {
			rc = read_crs(g, crs, nest + 1);
		} else if (!strcmp(key, "code") && json_reader_peek(j) != '"') {
			rc = json_reader_token(j, token);
			crs->epsg = rc ? 0 : (uint32_t)strtoul(token, NULL, 10);
		} else {
			rc = json_reader_skip(j);
		}
		if (rc)
			break;
	}
	return rc;
}

/* A member of the document: all but its features is used at once. */
static int read_member(struct geojson *g, const char *key, struct lines_crs *crs, char name[LINES_NAME_SIZE])
{
	struct json_reader *j = &g->json;
	int c = json_reader_peek(j);

	if (!strcmp(key, "type") && c == '"')
		return json_reader_string(j, g->type, sizeof g->type);
	if (!strcmp(key, "name") && c == '"')
		return json_reader_string(j, name, LINES_NAME_SIZE);
	if (!strcmp(key, "crs") || !strcmp(key, "coordRefSys")) {
		crs->from = !strcmp(key, "crs") ? "member crs" : "member coordRefSys";
		return read_crs(g, crs, 0);
	}
	if (!strcmp(key, "features")) {
		if (g->features.at)
			return json_reader_bad(j, "it has two lists of features");
		g->features = here(g);
	}
	return json_reader_skip(j);
}

static int refuse_kind(struct geojson *g, const char *what, const char *hint)
{
	struct err *err = g->json.source.err;

	err_set(err, ERR_INPUT, "%s", what);
	return err_add_hint(err, "%s", hint);
}

/* What the type of the document is, and that nothing follows it. */
static int judge(struct geojson *g)
{
	enum geometry is;
	int c = json_reader_peek(&g->json);

	if (g->json.source.rc)
		return g->json.source.rc;
	if (c == '{' || c == 0x1e)
		return refuse_kind(g, "it is a sequence of JSON texts, not one",
				   "make it one: ogr2ogr -f GeoJSON lines.geojson FILE");
	if (c >= 0)
		return json_reader_bad(&g->json, "something follows the document");
	if (!strcmp(g->type, "Topology"))
		return refuse_kind(g, "it is TopoJSON", "convert it: ogr2ogr -f GeoJSON lines.geojson FILE");
	if (!strcmp(g->type, "FeatureCollection"))
		return g->features.at ? 0 : refuse_kind(g, "it is a collection without features", "write it again");
	g->single = !strcmp(g->type, "Feature") || type_name(g->type, &is);
	return g->single ?
		       0 :
		       refuse_kind(g, "it is JSON, but its type is none of GeoJSON", "a file of lines is a FeatureCollection");
}

static int read_document(struct geojson *g, struct lines_crs *crs, char name[LINES_NAME_SIZE])
{
	struct json_reader *j = &g->json;
	char key[KEY];
	bool first = true, more;
	int rc;

	text_source_skip_mark(&j->source);
	if (json_reader_peek(j) == 0x1e)
		return judge(g);
	rc = json_reader_take(j, '{');
	while (!rc && !(rc = json_reader_more(j, '}', &first, &more)) && more) {
		rc = json_reader_key(j, key, sizeof key);
		if (!rc)
			rc = read_member(g, key, crs, name);
	}
	return rc ? rc : judge(g);
}

static int open_geojson(struct lines *l, struct err *err)
{
	struct geojson *g = l->state = calloc(1, sizeof *g);
	struct lines_crs crs = {.wkt = "", .from = ""};
	char name[LINES_NAME_SIZE] = "";
	int rc;

	if (!g)
		return err_set(err, ERR_NOMEM, "no memory to read lines");
	g->l = l;
	g->json.hint = "the file is damaged, or no GeoJSON; write it again";
	lines_source_begin(&g->json.source, l, err);
	rc = read_document(g, &crs, name);
	if (!rc && !*name)
		lines_stem(l, name);
	if (!rc)
		rc = lines_layer(l, name, &g->layer, err);
	if (rc)
		return rc;
	if (!*crs.from) {
		crs = (struct lines_crs){
			.epsg = 4326, .wkt = "", .name = "WGS 84", .unit_z = "metre", .degrees = true, .from = "RFC 7946"};
	}
	g->layer->crs = crs;
	return 0;
}

/* ---- coordinates ---- */

static int read_number(struct geojson *g, unsigned k, struct decimal *ret)
{
	struct lines *l = g->l;
	char token[JSON_READER_TOKEN];
	int c = json_reader_peek(&g->json), rc;

	if (c == '"' || c == '[' || c == '{')
		return json_reader_bad(&g->json, "a coordinate is not a number");
	rc = json_reader_token(&g->json, token);
	if (rc || k > 2 || lines_number(token, strlen(token), ret))
		return rc;
	*ret = (struct decimal){0, 0};
	if (!strcmp(token, "null") && k == 2)
		lines_refuse(l, lines_no_z);
	else if (!strcmp(token, "NaN") || !strcmp(token, "Infinity") || !strcmp(token, "-Infinity"))
		lines_refuse(l, "a coordinate is not finite");
	else
		return json_reader_bad(&g->json, "a coordinate is not a number");
	return 0;
}

static int read_position(struct geojson *g)
{
	struct json_reader *j = &g->json;
	struct decimal d[3] = {{0, 0}};
	bool first = true, more;
	unsigned n = 0;
	int rc = json_reader_take(j, '[');

	while (!rc && !(rc = json_reader_more(j, ']', &first, &more)) && more) {
		rc = read_number(g, n, &d[n < 3 ? n : 2]);
		n++;
	}
	if (rc)
		return rc;
	if (n < 2)
		return json_reader_bad(j, "a position has fewer than two numbers");
	if (n == 2)
		lines_refuse(g->l, lines_no_z);
	return g->l->f.state == LINES_REFUSED ? 0 : lines_vertex_exact(g->l, d, j->source.err);
}

/* Lists in lists: `depth` 0 is that of the positions of a line or ring. */
static int read_list(struct geojson *g, unsigned depth, bool ring)
{
	struct json_reader *j = &g->json;
	bool first = true, more;
	int rc = json_reader_take(j, '[');

	if (!rc && !depth)
		rc = lines_part(g->l, ring, j->source.err);
	while (!rc && !(rc = json_reader_more(j, ']', &first, &more)) && more)
		rc = depth ? read_list(g, depth - 1, ring) : read_position(g);
	return rc;
}

static int read_coordinates(struct geojson *g, enum geometry is)
{
	switch (is) {
	case LINE:
		return read_list(g, 0, false);
	case LINES:
		return read_list(g, 1, false);
	case RINGS:
		return read_list(g, 1, true);
	case POLYGONS:
		return read_list(g, 2, true);
	default:
		return json_reader_skip(&g->json);
	}
}

/* ---- geometries and features ---- */

static int read_geometry(struct geojson *g, unsigned nest);

static int read_geometries(struct geojson *g, unsigned nest)
{
	bool first = true, more;
	int rc = nest == COLLECTIONS_MOST ?
			 json_reader_bad(&g->json, "collections lie in each other more than %d deep", COLLECTIONS_MOST) :
			 json_reader_take(&g->json, '[');

	while (!rc && !(rc = json_reader_more(&g->json, ']', &first, &more)) && more)
		rc = read_geometry(g, nest + 1);
	return rc;
}

/* The members of a geometry. *ret_at: where coordinates are that came before their type. */
static int read_members(struct geojson *g, unsigned nest, enum geometry *ret_is, struct place *ret_at, bool *ret_read)
{
	struct json_reader *j = &g->json;
	char key[KEY], type[KEY];
	bool first = true, more;
	int rc = json_reader_take(j, '{');

	while (!rc && !(rc = json_reader_more(j, '}', &first, &more)) && more) {
		rc = json_reader_key(j, key, sizeof key);
		if (rc)
			break;
		json_reader_peek(j);
		if (!strcmp(key, "type")) {
			const char *name;

			rc = json_reader_string(j, type, sizeof type);
			name = rc ? NULL : type_name(type, ret_is);
			if (!rc && !name)
				rc = json_reader_bad(j, "\"%s\" is no geometry", type);
			if (!rc && !nest)
				lines_geometry(g->l, name);
		} else if (!strcmp(key, "coordinates")) {
			if (*ret_read || ret_at->at)
				rc = json_reader_bad(j, "a geometry has coordinates twice");
			*ret_at = here(g);
			*ret_read = *ret_is != NO_GEOMETRY;
			if (!rc)
				rc = read_coordinates(g, *ret_is);
		} else if (!strcmp(key, "geometries")) {
			rc = read_geometries(g, nest);
		} else {
			rc = json_reader_skip(j);
		}
	}
	return rc;
}

static int read_geometry(struct geojson *g, unsigned nest)
{
	struct json_reader *j = &g->json;
	enum geometry is = NO_GEOMETRY;
	struct place at = {0, 0}, end;
	char token[JSON_READER_TOKEN];
	bool read = false;
	int rc;

	if (json_reader_peek(j) == 'n')
		return json_reader_token(j, token);
	rc = read_members(g, nest, &is, &at, &read);
	if (rc)
		return rc;
	if (is == NO_GEOMETRY)
		return json_reader_bad(j, "a geometry has no type");
	if (is != COLLECTION && !at.at)
		return json_reader_bad(j, "a geometry has no coordinates");
	g->points |= is == POINTS;
	g->lines |= is != POINTS && is != COLLECTION;
	if (read)
		return 0;
	end = here(g);
	if (is != COLLECTION) {
		go(g, at);
		rc = read_coordinates(g, is);
		go(g, end);
	}
	return rc;
}

static int read_properties(struct geojson *g)
{
	struct json_reader *j = &g->json;
	char key[LINES_NAME_SIZE], value[JSON_READER_TOKEN];
	bool first = true, more;
	int rc;

	if (!g->l->has_kind_field || json_reader_peek(j) != '{')
		return json_reader_skip(j);
	rc = json_reader_take(j, '{');
	while (!rc && !(rc = json_reader_more(j, '}', &first, &more)) && more) {
		int c;

		rc = json_reader_key(j, key, sizeof key);
		c = rc ? -1 : json_reader_peek(j);
		if (rc)
			break;
		if (strcmp(key, g->l->kind_field) != 0 || c == '{' || c == '[') {
			rc = json_reader_skip(j);
			continue;
		}
		rc = c == '"' ? json_reader_string(j, value, sizeof value) : json_reader_token(j, value);
		if (!rc && strcmp(value, "null") != 0)
			lines_kind(g->l, value, strlen(value));
	}
	return rc;
}

static int read_feature(struct geojson *g)
{
	struct json_reader *j = &g->json;
	char key[KEY], type[KEY] = "";
	bool first = true, more, geometry = false;
	int rc = json_reader_take(j, '{');

	while (!rc && !(rc = json_reader_more(j, '}', &first, &more)) && more) {
		rc = json_reader_key(j, key, sizeof key);
		if (rc)
			break;
		if (!strcmp(key, "type")) {
			rc = json_reader_string(j, type, sizeof type);
		} else if (!strcmp(key, "properties")) {
			rc = read_properties(g);
		} else if (!strcmp(key, "geometry")) {
			rc = geometry ? json_reader_bad(j, "a feature has two geometries") : read_geometry(g, 0);
			geometry = true;
		} else {
			rc = json_reader_skip(j);
		}
	}
	return !rc && strcmp(type, "Feature") != 0 ?
		       json_reader_bad(j, "what ends here is no feature: its type is \"%s\"", type) :
		       rc;
}

static int next_geojson(struct lines *l, bool *ret_more, struct err *err)
{
	struct geojson *g = l->state;
	bool more = !g->begun;
	int rc = 0;

	g->json.source.err = err;
	if (!g->begun) {
		g->begun = g->first = true;
		go(g, g->single ? (struct place){0, 1} : g->features);
		while (g->single && text_source_peek(&g->json.source) >= 0 && text_source_peek(&g->json.source) != '{')
			text_source_take(&g->json.source);
		rc = g->single ? 0 : json_reader_take(&g->json, '[');
	}
	if (!rc && !g->single)
		rc = json_reader_more(&g->json, ']', &g->first, &more);
	*ret_more = more;
	if (rc || !more)
		return rc;
	json_reader_peek(&g->json);
	g->points = g->lines = false;
	lines_begin(l, g->layer, ++g->number, text_source_at(&g->json.source));
	rc = g->single && strcmp(g->type, "Feature") != 0 ? read_geometry(g, 0) : read_feature(g);
	if (rc)
		return rc;
	if (g->points && g->lines)
		lines_refuse(l, "it is a collection of lines and points");
	else if (g->points)
		lines_no_line(l, "points");
	lines_end(l);
	return 0;
}

const struct lines_reader lines_geojson_reader = {
	.name = "geojson",
	.title = "GeoJSON",
	.place = "byte",
	.exact = true,
	.matches = matches,
	.open = open_geojson,
	.next = next_geojson,
	.close = lines_free_state,
};
