/* DXF: entities that are lines, those that are refused or left out, layers, units, and texts that are none. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "lines_case.h"

static char text[LINES_CASE_TEXT], file[1 << 14];

/* Pairs stand as "0 LINE|8 roads|10 1.5|...". */
static const char *dxf(const char *header, const char *entities)
{
	size_t n = 0;

	n += (size_t)snprintf(
		file, sizeof file,
		"0|SECTION|2|HEADER|%s0|ENDSEC|0|SECTION|2|BLOCKS|0|LINE|8|no|0|ENDSEC|0|SECTION|2|ENTITIES|%s0|ENDSEC|0|EOF|",
		header, entities);
	for (size_t i = 0; i < n; i++)
		file[i] = file[i] == '|' ? '\n' : file[i];
	return file;
}

static const char *read_entities(const char *entities)
{
	return lines_case_read_text("d.dxf", dxf("", entities), NULL, text);
}

#define LINE "0|LINE|8|a|10|1|20|2|30|3|11|4.50|21|5e1|31|-6|"
#define LINE_READ "LINE: open 1 2 3, 4.5 50 -6\n"
#define V(x, y, z) "0|VERTEX|8|a|10|" #x "|20|" #y "|30|" #z "|"
#define POLY(more, vertices) "0|POLYLINE|8|a|66|1|" more vertices "0|SEQEND|8|a|"
#define LIGHT(more) "0|LWPOLYLINE|5|1F|100|AcDbPolyline|8|a|90|3|" more "10|0|20|0|10|9|20|0|10|9|20|9|"

static void test_entities(void **state)
{
	static const struct {
		const char *entities, *want;
	} rows[] = {
		{"", ""},
		{LINE, "#1 a " LINE_READ},
		{"999|a comment|" LINE "0|LINE|10|1|20|2|30|3|11|4|21|5|31|6|",
		 "#1 a " LINE_READ "#2 0 LINE: open 1 2 3, 4 5 6\n"},
		{"0|LINE|8|a|10|1|20|2|11|4|21|5|", "#1 a LINE ! it has no z\n"},
		{POLY("70|8|", V(0, 0, 1) V(9, 0, 2) V(9, 9, 3)), "#1 a POLYLINE: open 0 0 1, 9 0 2, 9 9 3\n"},
		{POLY("70|9|", V(0, 0, 1) V(9, 0, 2) V(9, 9, 3)), "#1 a POLYLINE: ring 0 0 1, 9 0 2, 9 9 3\n"},
		{POLY("70|9|", V(0, 0, 1) V(9, 0, 2) V(9, 9, 3) V(0, 0, 1)), "#1 a POLYLINE: ring 0 0 1, 9 0 2, 9 9 3\n"},
		{POLY("70|8|", V(0, 0, 1) "0|VERTEX|10|1|20|1|"), "#1 a POLYLINE ! it has no z\n"},
		{POLY("10|0|20|0|30|7.25|70|0|", V(0, 0, 0) V(9, 0, 0)), "#1 a POLYLINE: open 0 0 7.25, 9 0 7.25\n"},
		{POLY("10|0|20|0|30|0.0|70|0|", V(0, 0, 5) V(9, 0, 5)), "#1 a POLYLINE ! it has no z\n"},
		{POLY("30|1|", V(0, 0, 0) "0|VERTEX|10|9|20|9|42|0.5|"), "#1 a POLYLINE ! it has an arc (a bulge)\n"},
		{POLY("70|12|", V(0, 0, 1) V(9, 0, 2)), "#1 a POLYLINE ! it is a smoothed polyline\n"},
		{POLY("70|64|", V(0, 0, 1) "0|VERTEX|70|128|71|1|"), "#1 a POLYLINE ! it is a mesh (POLYLINE 70)\n"},
		{POLY("70|8|", V(0, 0, 1)), "#1 a POLYLINE ! a line has fewer than two vertices\n"},
		{POLY("70|8|", ""), "#1 a POLYLINE\n"},
		{LIGHT("38|12.5|70|0|"), "#1 a LWPOLYLINE: open 0 0 12.5, 9 0 12.5, 9 9 12.5\n"},
		{LIGHT("70|1|38|12.5|"), "#1 a LWPOLYLINE: ring 0 0 12.5, 9 0 12.5, 9 9 12.5\n"},
		{LIGHT("") "38|12.5|", "#1 a LWPOLYLINE: open 0 0 12.5, 9 0 12.5, 9 9 12.5\n"},
		{LIGHT(""), "#1 a LWPOLYLINE ! it has no z\n"},
		{LIGHT("38|0|"), "#1 a LWPOLYLINE ! it has no z\n"},
		{LIGHT("38|1|") "42|-0.25|", "#1 a LWPOLYLINE ! it has an arc (a bulge)\n"},
		{LIGHT("38|1|") "210|0|220|0|230|1.0|", "#1 a LWPOLYLINE: open 0 0 1, 9 0 1, 9 9 1\n"},
		{LIGHT("38|1|") "210|0|220|0|230|-1|", "#1 a LWPOLYLINE ! its plane is not level (210 to 230)\n"},
		{LIGHT("38|1e13|"), "#1 a LWPOLYLINE ! a coordinate is beyond 1e12\n"},
		{"0|3DFACE|8|a|10|0|20|0|30|1|11|9|21|0|31|1|12|9|22|9|32|1|13|0|23|9|33|1|",
		 "#1 a 3DFACE: ring 0 0 1, 9 0 1, 9 9 1, 0 9 1\n"},
		{"0|3DFACE|8|a|10|0|20|0|30|1|11|9|21|0|31|1|12|9|22|9|32|1|13|9|23|9|33|1|",
		 "#1 a 3DFACE: ring 0 0 1, 9 0 1, 9 9 1\n"},
		{"0|3DFACE|8|a|10|0|20|0|30|1|11|9|21|0|31|1|12|9|22|9|32|1|13|9|23|9|33|1|70|8|",
		 "#1 a 3DFACE: open 0 0 1, 9 0 1; open 9 0 1, 9 9 1\n"},
		{"0|3DFACE|8|a|10|0|20|0|30|1|11|9|21|0|31|1|12|9|22|9|32|1|13|0|23|9|33|1|70|7|",
		 "#1 a 3DFACE: open 0 9 1, 0 0 1\n"},
		{"0|3DFACE|8|a|10|0|20|0|30|1|11|9|21|0|31|1|12|9|22|9|32|1|13|0|23|9|33|1|70|15|", "#1 a 3DFACE\n"},
		{"0|ARC|8|b|10|0|20|0|30|0|40|5|50|0|51|90|0|SPLINE|8|b|10|0|20|0|30|0|10|1|20|1|30|1|0|CIRCLE|0|ELLIPSE|",
		 "#1 b ARC ! it is an arc (ARC)\n#2 b SPLINE ! it is a spline (SPLINE)\n#3 0 CIRCLE ! it is a circle (CIRCLE)\n"
		 "#4 0 ELLIPSE ! it is an ellipse (ELLIPSE)\n"},
		{"0|TEXT|8|t|10|x|0|POINT|8|t|0|ODD_THING|8|t|0|INSERT|8|t|66|1|0|ATTRIB|8|t|0|SEQEND|" LINE,
		 "#1 t TEXT = TEXT\n#2 t POINT = POINT\n#3 t other entities = other entities\n#4 t INSERT = INSERT\n#5 t ATTRIB = ATTRIB\n"
		 "#6 a " LINE_READ},
		{"0|LINE|67|1|8|p|10|1|20|2|11|4|21|5|0|ARC|67|1|8|p|",
		 "#1 p LINE = in paper space\n#2 p ARC = in paper space\n"},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
		assert_string_equal(read_entities(rows[i].entities), rows[i].want);
}

static void test_layers(void **state)
{
	static const struct lines_options opt = {.layer = "A"}, none = {.layer = "z"};

	dxf("", "0|ARC|8|b|" LINE "0|LINE|8|m\xfcll|10|1|20|2|30|3|11|4|21|5|31|6|");
	assert_string_equal(lines_case_read_text("d.dxf", file, &opt, text), "#2 a " LINE_READ);
	assert_string_equal(lines_case_read_text("d.dxf", file, &none, text),
			    "error: it has no layer \"z\" (its layers: b, a, m\xc3\xbcll)\n");
}

/* As many layers as there may be, and one more. */
static void test_many_layers(void **state)
{
	static const struct lines_options opt = {.layer = "none"};

	for (int n = LINES_LAYERS_MOST; n <= LINES_LAYERS_MOST + 1; n++) {
		FILE *f = fopen(lines_case_path("m.dxf"), "w");

		fputs("0\nSECTION\n2\nENTITIES\n", f);
		for (int i = 0; i < 2 * n; i++)
			fprintf(f, "0\nTEXT\n8\nlayer %d\n", i % n);
		fputs("0\nENDSEC\n0\nEOF\n", f);
		assert_int_equal(fclose(f), 0);
		lines_case_read(lines_case_path("m.dxf"), &opt, text);
		if (n == LINES_LAYERS_MOST)
			assert_non_null(strstr(text, "error: it has no layer \"none\" (its layers: layer 0, layer 1, "));
		else
			assert_string_equal(
				text,
				"error: it has more than 4096 layers (copy those that are wanted into a file of their own (ogr2ogr))\n");
	}
}

static void test_header(void **state)
{
	static const struct {
		const char *header, *unit, *variant, *from;
	} rows[] = {
		{"", "", "", ""},
		{"9|$ACADVER|1|AC1009|", "", "AC1009", ""},
		{"9|$ACADVER|1|AC1027|9|$INSUNITS|70|6|", "metre", "AC1027", "$INSUNITS"},
		{"9|$INSUNITS|70|     2|9|$MEASUREMENT|70|1|", "foot", "", "$INSUNITS"},
		{"9|$INSUNITS|70|21|", "us-survey-foot", "", "$INSUNITS"},
		{"9|$INSUNITS|70|0|", "", "", ""},
		{"9|$INSUNITS|70|99|", "", "", ""},
	};
	static const struct lines_options opt;

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		const struct lines_feature *f;
		struct err err = ERR_INIT;
		struct lines *l;

		dxf(rows[i].header, LINE);
		lines_case_file("h.dxf", file, strlen(file));
		assert_string_equal(lines_recognise(lines_case_path("h.dxf")), "DXF");
		assert_int_equal(lines_open(lines_case_path("h.dxf"), &opt, &l, &err), 0);
		assert_int_equal(lines_next(l, &f, &err), 0);
		assert_string_equal(f->layer->crs.unit, rows[i].unit);
		assert_string_equal(f->layer->crs.from, rows[i].from);
		assert_string_equal(lines_info(l)->variant, rows[i].variant);
		lines_close(l);
	}
}

static void test_wrong(void **state)
{
	static const char binary[] = "AutoCAD Binary DXF\r\n\x1a\0\0\0SECTION\0";
	static const struct {
		const char *entities, *want;
	} rows[] = {
		{"0|LINE|8|a|10|one|", "line 26: \"one\" is no number"},
		{"0|LINE|8|a|20|1|30|1|", "line 21: a vertex lacks x or y"},
		{"0|LINE|x|a|", "line 23: \"x\" is no group code"},
		{"0|LWPOLYLINE|8|a|20|1|", "line 25: a vertex lacks x"},
		{"0|LWPOLYLINE|8|a|70|1.5|", "line 26: \"1.5\" is no whole number"},
		{"0|POLYLINE|8|a|70|8|0|VERTEX|10|1|20|1|30|1|" LINE, "line 35: a POLYLINE has no SEQEND"},
		{"0|SECTION|2|OBJECTS|", "line 21: the section ENTITIES has no end"},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
		if (!strstr(read_entities(rows[i].entities), rows[i].want) || !strstr(text, "(the file is damaged"))
			fail_msg("%s: %s", rows[i].entities, text);
	assert_string_equal(
		lines_case_read_text("d.dxf", "AutoCAD Binary DXF\r\n\x1a\0", NULL, text),
		"error: it is no file of lines that acut reads (these are Shapefile, GeoJSON, GeoPackage, DXF, LandXML, and CSV "
		"where it is asked for; ogr2ogr converts others)\n");
	lines_case_file("b.dxf", binary, sizeof binary);
	assert_string_equal(lines_case_read(lines_case_path("b.dxf"), NULL, text),
			    "error: it is binary DXF, which is not read (save it as text (ASCII) DXF)\n");
	assert_non_null(
		strstr(lines_case_read_text("d.dxf", "0\r\nSECTION\r\n2\r\nHEADER\r\n0\r\nENDSEC\r\n0\r\nEOF\r\n", NULL, text),
		       "line 7: it has no section ENTITIES"));
	/* Cut at any line. */
	dxf("9|$INSUNITS|70|6|", LINE POLY("70|8|", V(0, 0, 1) V(9, 0, 2)) "0|ARC|8|a|");
	for (size_t n = strlen(file) - 1, lines = 0; n > 30; n--) {
		if (file[n] != '\n' || ++lines < 4) /* nothing is needed behind the section */
			continue;
		file[n + 1] = 0;
		if (!strstr(lines_case_read_text("d.dxf", file, NULL, text), "error: "))
			fail_msg("%s: %s", file, text);
	}
}

static int remove_all(void **state)
{
	lines_case_remove_all();
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_entities), cmocka_unit_test(test_layers),
					   cmocka_unit_test(test_many_layers), cmocka_unit_test(test_header),
					   cmocka_unit_test(test_wrong)};

	return cmocka_run_group_tests(tests, NULL, remove_all);
}
