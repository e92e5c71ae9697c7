/* GeoJSON: every geometry, members in any order, coordinate systems, what is refused, and texts that are none. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "lines_case.h"

#define COLLECTION(features) "{\"type\":\"FeatureCollection\",\"features\":[" features "]}"
#define FEATURE(geometry) \
	"{\"type\":\"Feature\",\"properties\":{\"sort\":\"lake\",\"n\":[1,{\"sort\":2}]},\"geometry\":" geometry "}"
#define GEOMETRY(type, coordinates) "{\"type\":\"" type "\",\"coordinates\":" coordinates "}"
#define LINE GEOMETRY("LineString", "[[1,2,3],[4.50,5e1,-6]]")
#define LINE_READ ": open 1 2 3, 4.5 50 -6\n"

static char text[LINES_CASE_TEXT];

static void test_geometries(void **state)
{
	static const struct {
		const char *json, *want;
	} rows[] = {
		{COLLECTION(""), ""},
		{LINE, "#1 g LineString" LINE_READ},
		{FEATURE(LINE), "#1 g LineString" LINE_READ},
		{"\xef\xbb\xbf \n" COLLECTION(FEATURE(LINE) ", " FEATURE("null")), "#1 g LineString" LINE_READ "#2 g \n"},
		{COLLECTION(FEATURE(GEOMETRY("MultiLineString", "[[[1,2,3],[4,5,6,7]],[[0,0,0],[1,1,1]]]"))),
		 "#1 g MultiLineString: open 1 2 3, 4 5 6; open 0 0 0, 1 1 1\n"},
		{COLLECTION(
			 FEATURE(GEOMETRY("Polygon", "[[[0,0,1],[9,0,1],[9,9,1],[0,0,1]],[[1,1,1],[2,1,1],[2,2,1],[1,1,1]]]"))),
		 "#1 g Polygon: ring 0 0 1, 9 0 1, 9 9 1; ring 1 1 1, 2 1 1, 2 2 1\n"},
		{COLLECTION(FEATURE(
			 GEOMETRY("MultiPolygon", "[[[[0,0,1],[9,0,1],[9,9,1]]],[[[1,1,1],[2,1,1],[2,2,1],[1.0,1,1]]]]"))),
		 "#1 g MultiPolygon: ring 0 0 1, 9 0 1, 9 9 1; ring 1 1 1, 2 1 1, 2 2 1\n"},
		{COLLECTION(FEATURE("{\"type\":\"GeometryCollection\",\"geometries\":[" LINE "," LINE "]}")),
		 "#1 g GeometryCollection: open 1 2 3, 4.5 50 -6; open 1 2 3, 4.5 50 -6\n"},
		{COLLECTION(FEATURE("{\"geometries\":[],\"type\":\"GeometryCollection\"}")), "#1 g GeometryCollection\n"},
		{COLLECTION(FEATURE(GEOMETRY("Point", "[1,2]")) "," FEATURE(GEOMETRY("MultiPoint", "[]"))),
		 "#1 g Point = points\n#2 g MultiPoint = points\n"},
		{COLLECTION(
			 FEATURE("{\"type\":\"GeometryCollection\",\"geometries\":[" GEOMETRY("Point", "[1,2]") "," LINE "]}")),
		 "#1 g GeometryCollection ! it is a collection of lines and points\n"},
		{COLLECTION(FEATURE(GEOMETRY("LineString", "[]"))), "#1 g LineString\n"},
		{COLLECTION(FEATURE(GEOMETRY("Polygon", "[]"))), "#1 g Polygon\n"},
		{COLLECTION(FEATURE(GEOMETRY("LineString", "[[1,2],[3,4]]")) "," FEATURE(LINE)),
		 "#1 g LineString ! it has no z\n#2 g LineString" LINE_READ},
		{COLLECTION(FEATURE(GEOMETRY("LineString", "[[1,2,3],[3,4,null]]"))), "#1 g LineString ! it has no z\n"},
		{COLLECTION(FEATURE(GEOMETRY("LineString", "[[1,2,3],[3,NaN,1]]"))),
		 "#1 g LineString ! a coordinate is not finite\n"},
		{COLLECTION(FEATURE(GEOMETRY("LineString", "[[1,2,3],[3,1e300,1]]"))),
		 "#1 g LineString ! a coordinate is beyond 1e12\n"},
		{COLLECTION(FEATURE(GEOMETRY("Polygon", "[[[0,0,1],[9,0,1],[9,9,1],[0,0,2]]]"))),
		 "#1 g Polygon ! a ring ends where it begins, at another z\n"},
		/* any order */
		{"{\"features\":[{\"geometry\":{\"coordinates\":[[1,2,3],[4.5,50,-6]],\"x\":{},\"type\":\"LineString\"},\"type\":\"Feature\"}],"
		 "\"type\":\"FeatureCollection\",\"name\":\"roads \\u00e9\\ud83d\\ude00\"}",
		 "#1 roads \xc3\xa9\xf0\x9f\x98\x80 LineString" LINE_READ},
		{"{\"coordinates\":[[1,2,3],[4.5,50,-6]],\"type\":\"LineString\"}", "#1 g LineString" LINE_READ},
		/* digits */
		{GEOMETRY("LineString", "[[635000.2500000001,0.30000000000000004,123456789012345678],[1,1,1]]"),
		 "#1 g LineString ! a coordinate is beyond 1e12\n"},
		{GEOMETRY("LineString", "[[635000.2500000001,0.30000000000000004,9007199254.740993],[1,1,1]]"),
		 "#1 g LineString: open 635000.2500000001 30000000000000004e-17 9007199254.740993, 1 1 1\n"},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
		assert_string_equal(lines_case_read_text("g.geojson", rows[i].json, NULL, text), rows[i].want);
}

static void test_kinds(void **state)
{
	static const struct lines_options opt = {.kind_field = "sort"};
	static const char json[] =
		COLLECTION(FEATURE(LINE) ",{\"type\":\"Feature\",\"geometry\":" LINE ",\"properties\":{\"sort\":12.50}}"
					 ",{\"type\":\"Feature\",\"geometry\":" LINE ",\"properties\":{\"sort\":null}}"
					 ",{\"type\":\"Feature\",\"geometry\":" LINE ",\"properties\":null}");

	assert_string_equal(lines_case_read_text("g.geojson", json, &opt, text),
			    "#1 g LineString [lake]" LINE_READ "#2 g LineString [12.50]" LINE_READ "#3 g LineString" LINE_READ
			    "#4 g LineString" LINE_READ);
}

static void test_systems(void **state)
{
	static const struct {
		const char *member, *name, *from;
		unsigned epsg, epsg_z;
		bool degrees;
	} rows[] = {
		{"", "WGS 84", "RFC 7946", 4326, 0, true},
		{"\"crs\":null,", "", "member crs", 0, 0, false},
		{"\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"urn:ogc:def:crs:EPSG::25832\"}},",
		 "urn:ogc:def:crs:EPSG::25832", "member crs", 25832, 0, false},
		{"\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"urn:ogc:def:crs:OGC:1.3:CRS84\"}},",
		 "urn:ogc:def:crs:OGC:1.3:CRS84", "member crs", 4326, 0, true},
		{"\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"urn:ogc:def:crs,crs:EPSG::27700,crs:EPSG:9.9:5701\"}},",
		 "urn:ogc:def:crs,crs:EPSG::27700,crs:EPSG:9.9:5701", "member crs", 27700, 5701, false},
		{"\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"EPSG:4326\"}},", "EPSG:4326", "member crs", 4326, 0,
		 true},
		{"\"crs\":\"EPSG:25832 + EPSG:7837\",", "EPSG:25832 + EPSG:7837", "member crs", 25832, 7837, false},
		{"\"crs\":\"EPSG:4258, EPSG/0/5621\",", "EPSG:4258, EPSG/0/5621", "member crs", 4258, 5621, false},
		{"\"crs\":{\"type\":\"EPSG\",\"properties\":{\"code\":2056}},", "", "member crs", 2056, 0, false},
		{"\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"local grid\"}},", "local grid", "member crs", 0, 0,
		 false},
		{"\"coordRefSys\":\"http://www.opengis.net/def/crs/EPSG/0/3857\",", "http://www.opengis.net/def/crs/EPSG/0/3857",
		 "member coordRefSys", 3857, 0, false},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		static const struct lines_options opt;
		const struct lines_feature *f;
		struct err err = ERR_INIT;
		struct lines *l;
		char json[1000];

		snprintf(json, sizeof json, "{%s\"type\":\"FeatureCollection\",\"features\":[%s]}", rows[i].member,
			 FEATURE(LINE));
		lines_case_file("s.json", json, strlen(json));
		assert_string_equal(lines_recognise(lines_case_path("s.json")), "GeoJSON");
		assert_int_equal(lines_open(lines_case_path("s.json"), &opt, &l, &err), 0);
		assert_int_equal(lines_next(l, &f, &err), 0);
		assert_string_equal(f->layer->crs.name, rows[i].name);
		assert_string_equal(f->layer->crs.from, rows[i].from);
		assert_int_equal(f->layer->crs.epsg, rows[i].epsg);
		assert_int_equal(f->layer->crs.epsg_z, rows[i].epsg_z);
		assert_int_equal(f->layer->crs.degrees, rows[i].degrees);
		lines_close(l);
	}
}

static void test_wrong(void **state)
{
	static const struct {
		const char *json, *want;
	} rows[] = {
		{"{\"type\":\"Feature\"", "byte 17: it ends where a } should stand"},
		{COLLECTION(FEATURE("{\"type\":\"LineString\"}")), "a geometry has no coordinates"},
		{COLLECTION(FEATURE("{\"coordinates\":[]}")), "a geometry has no type"},
		{COLLECTION(FEATURE(GEOMETRY("Curve", "[]"))), "\"Curve\" is no geometry"},
		{COLLECTION(FEATURE(GEOMETRY("LineString", "[[1],[2]]"))), "a position has fewer than two numbers"},
		{COLLECTION(FEATURE(GEOMETRY("LineString", "[[1,2,\"3\"],[2]]"))), "a coordinate is not a number"},
		{COLLECTION(FEATURE(GEOMETRY("LineString", "[[1,2,0x3],[2]]"))), "a coordinate is not a number"},
		{COLLECTION(FEATURE(GEOMETRY("LineString", "[1,2,3]"))), "a [ should stand here"},
		{COLLECTION(FEATURE(GEOMETRY("LineString", "{}"))), "a [ should stand here"},
		{COLLECTION(FEATURE("{\"type\":\"LineString\",\"coordinates\":[],\"coordinates\":[]}")),
		 "a geometry has coordinates twice"},
		{COLLECTION("{\"type\":\"Other\",\"geometry\":null}"), "what ends here is no feature: its type is \"Other\""},
		{COLLECTION("1,2"), "a { should stand here"},
		{COLLECTION(FEATURE(LINE)) COLLECTION(""), "it is a sequence of JSON texts, not one (make it one: ogr2ogr"},
		{"\x1e" FEATURE(LINE) "\n\x1e" FEATURE(LINE), "it is a sequence of JSON texts, not one"},
		{COLLECTION(FEATURE(LINE)) " x", "something follows the document"},
		{"{\"type\":\"FeatureCollection\",\"features\":[],\"features\":[]}", "it has two lists of features"},
		{"{\"type\":\"FeatureCollection\",\"coordinates\":1}", "it is a collection without features"},
		{"{\"type\":\"Topology\",\"objects\":{}}", "it is TopoJSON"},
		{"{\"type\":\"Features\",\"features\":[]}", "it is JSON, but its type is none of GeoJSON"},
		{"{\"features\":[\"\\x\"]}", "an escape is none of JSON"},
		{"{\"features\":[\"\\u12g\"]}", "an escape has no four hexadecimal digits"},
		{"{\"features\":[\"", "it ends within a text"},
		{"{\"features\":[,]}", "a value should stand here"},
	};
	char nest[4000] = "{\"features\":";

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		const char *said = lines_case_read_text("w.json", rows[i].json, NULL, text);

		if (strncmp(said, "error: ", 7) != 0 || !strstr(said, rows[i].want) || !strchr(said, '('))
			fail_msg("%s: %s", rows[i].json, said);
	}
	memset(nest + strlen(nest), '[', 3000);
	assert_non_null(strstr(lines_case_read_text("w.json", nest, NULL, text),
			       "lists and objects lie in each other more than 64 deep"));
	strcpy(nest, COLLECTION(FEATURE(LINE)));
	for (size_t n = strlen(nest) - 1; n > 40; n--) {
		nest[n] = 0;
		assert_non_null(strstr(lines_case_read_text("w.json", nest, NULL, text), "error: "));
	}
}

/* More vertices than a feature may have; the next feature is read all the same. And much larger than the buffer. */
static void test_large(void **state)
{
	const char *path = lines_case_path("large.json");
	FILE *f = fopen(path, "w");

	assert_non_null(f);
	fputs("{\"type\":\"FeatureCollection\",\"features\":[{\"type\":\"Feature\",\"geometry\":{\"type\":\"LineString\",\"coordinates\":[",
	      f);
	for (int i = 0; i <= LINES_VERTICES_MOST; i++)
		fprintf(f, "%s[%d,%d.25,1]", i ? "," : "", i, i);
	fputs("]}}," FEATURE(LINE) "]}", f);
	assert_int_equal(fclose(f), 0);
	assert_string_equal(lines_case_read(path, NULL, text),
			    "#1 large LineString ! it has more than 524288 vertices\n#2 large LineString" LINE_READ);
}

static int remove_all(void **state)
{
	lines_case_remove_all();
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_geometries), cmocka_unit_test(test_kinds),
					   cmocka_unit_test(test_systems), cmocka_unit_test(test_wrong),
					   cmocka_unit_test(test_large)};

	return cmocka_run_group_tests(tests, NULL, remove_all);
}
