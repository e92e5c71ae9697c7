/* Files of lines as the text that acutd takes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "err.h"
#include "lines_case.h"
#include "lines_export.h"

struct row {
	const char *file, *text;
	struct lines_export_options opt;
	const char *kind_field;
	const char *want; /* the text, or "! " and a part of the error */
};

#define GEOJSON(geometry, more) "{\"type\":\"Feature\",\"geometry\":" geometry ",\"properties\":{" more "}}"
#define LINE(c) "{\"type\":\"LineString\",\"coordinates\":[" c "]}"
#define POLYGON(c) "{\"type\":\"Polygon\",\"coordinates\":[[" c "]]}"
#define PLANE "\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"urn:ogc:def:crs:EPSG::2154\"}},"
#define COLLECTION(features) "{\"type\":\"FeatureCollection\"," PLANE "\"features\":[" features "]}"

static const struct row rows[] = {
	{"a.csv",
	 "x,y,z,name\n1.250,2,3,a\n4,5,6,a\n7,8,9,b\n1e-20,1,1,b\n",
	 {.kind = "hard"},
	 NULL,
	 "acut-lines 1\nfeature 1 hard\nline\n1.25 2 3\n4 5 6\nfeature 2 hard\nline\n7 8 9\n1e-20 1 1\n"},
	{"a.csv",
	 "x,y,z,name,kind\n1,2,3,a,Soft\n4,5,6,a,Soft\n7,8,9,b,\n1,1,1,b,\n",
	 {.kind = "HARD"},
	 "kind",
	 "acut-lines 1\nfeature 1 hard\nline\n1 2 3\n4 5 6\nfeature 2 hard\nline\n7 8 9\n1 1 1\n"},
	{"a.csv", "x,y,z,name,kind\n1,2,3,a,\n4,5,6,a,\n", {0}, "kind", "! it has no value in the field of kinds"},
	{"a.csv", "x,y,z,name,kind\n1,2,3,a,road\n4,5,6,a,road\n", {.kind = "hard"}, "kind", "! its kind is \"road\""},
	/* a closed line is a ring where rings are meant; the lengths and levels are passed on */
	{"a.csv",
	 "x,y,z,name\n0,0,5,a\n1,0,5,a\n0,1,5,a\n0,0,5,a\n",
	 {.kind = "lake", .densify = "2.5m", .lake_level = "min"},
	 NULL,
	 "acut-lines 1\ndensify 2.5 m\nlake-level min\nfeature 1 lake\nring\n0 0 5\n1 0 5\n0 1 5\n"},
	{"a.csv",
	 "x,y,z,name\n0,0,5,a\n1,0,5,a\n0,1,5,a\n0,0,5,a\n",
	 {.kind = "hard", .densify = "3"},
	 NULL,
	 "acut-lines 1\ndensify 3\nfeature 1 hard\nline\n0 0 5\n1 0 5\n0 1 5\n0 0 5\n"},
	{"a.csv",
	 "x,y,z,name\n0,0,5,a\n1,0,5,a\n0,1,5,a\n",
	 {.kind = "boundary"},
	 NULL,
	 "! a line of 3 vertices does not end where it begins"},
	{"a.csv", "x,y,z,name\n0,0,5,a\n1,0,5,a\n0,0,5,a\n", {.kind = "hole"}, NULL, "! it is a ring of 2 vertices"},
	{"a.csv", "x,y,z,name\n", {.kind = "hard"}, NULL, "! it has no lines"},
	{"a.json",
	 COLLECTION(GEOJSON(LINE("[700000.1,6600000,1],[700010,6600000,2.50]"), "")),
	 {.kind = "hard"},
	 NULL,
	 "acut-lines 1\ncrs EPSG:2154\nfeature 1 hard\nline\n700000.1 6600000 1\n700010 6600000 2.5\n"},
	{"a.json",
	 COLLECTION(GEOJSON(POLYGON("[0,0,1],[9,0,1],[0,9,1],[0,0,1]"), "\"k\":\"hole\"")),
	 {0},
	 "k",
	 "acut-lines 1\ncrs EPSG:2154\nfeature 1 hole\nring\n0 0 1\n9 0 1\n0 9 1\n"},
	{"a.json",
	 "{\"type\":\"FeatureCollection\",\"features\":[" GEOJSON(LINE("[7.5,50,1],[7.6,50,2]"), "") "]}",
	 {.kind = "hard"},
	 NULL,
	 "acut-lines 1\ncrs EPSG:4326\nunit-z m\nfeature 1 hard\nline\n7.5 50 1\n7.6 50 2\n"},
	/* points are left out; what has no z is an error */
	{"a.json",
	 COLLECTION(GEOJSON("{\"type\":\"Point\",\"coordinates\":[1,1,1]}", "") "," GEOJSON(LINE("[1,2,1],[2,2,2]"), "")),
	 {.kind = "hard"},
	 NULL,
	 "acut-lines 1\ncrs EPSG:2154\nfeature 2 hard\nline\n1 2 1\n2 2 2\n"},
	{"a.json", COLLECTION(GEOJSON(LINE("[1,2],[2,2]"), "")), {.kind = "hard"}, NULL, "! cannot be used: it has no z"},
};

static int export(const char *path, const struct row *row, char **ret, struct lines_exported *exported, struct err *err)
{
	const struct lines_options opt = {.kind_field = row->kind_field, .csv = true};
	struct lines *lines = NULL;
	size_t size;
	FILE *out = open_memstream(ret, &size);
	int r;

	assert_non_null(out);
	assert_int_equal(lines_export_check(&row->opt, err), 0);
	r = lines_open(path, &opt, &lines, err);
	if (!r)
		r = lines_export(lines, &row->opt, out, exported, err);
	lines_close(lines);
	assert_int_equal(fclose(out), 0);
	return r;
}

static void texts(void **state)
{
	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		const char *path = lines_case_file(rows[i].file, rows[i].text, strlen(rows[i].text));
		struct lines_exported exported;
		struct err err = ERR_INIT;
		char *got = NULL;
		int r = export(path, &rows[i], &got, &exported, &err);

		if (*rows[i].want == '!') {
			if (!r || !strstr(err.message, rows[i].want + 2))
				fail_msg("row %zu: %s", i, r ? err.message : got);
		} else if (r || strcmp(got, rows[i].want) != 0) {
			fail_msg("row %zu: %s", i, r ? err.message : got);
		}
		free(got);
	}
}

static void counts(void **state)
{
	struct lines_exported exported;
	struct err err = ERR_INIT;
	char *got = NULL;
	const char *path = lines_case_file(rows[1].file, rows[1].text, strlen(rows[1].text));

	assert_int_equal(export(path, &rows[1], &got, &exported, &err), 0);
	assert_int_equal(exported.features[LINES_HARD], 2);
	assert_int_equal(exported.soft, 1);
	assert_int_equal(exported.lines, 2);
	assert_int_equal(exported.vertices, 4);
	free(got);
}

static void words(void **state)
{
	static const struct lines_export_options bad[] = {{.kind = "road"}, {.densify = "0"},  {.densify = "5km"},
							  {.densify = "m"}, {.densify = "-1"}, {.lake_level = "low"}};

	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
		struct err err = ERR_INIT;

		assert_int_equal(lines_export_check(&bad[i], &err), -ERR_USAGE);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(texts),
		cmocka_unit_test(counts),
		cmocka_unit_test(words),
	};

	int failed = cmocka_run_group_tests(tests, NULL, NULL);

	lines_case_remove_all();
	return failed;
}
