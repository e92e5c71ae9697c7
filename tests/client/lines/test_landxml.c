/* LandXML: breaklines and boundaries of surfaces, units and systems, what is left out, and texts that are none. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "lines_case.h"

#define XML(head, surfaces)                                                                                                                \
	"<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<LandXML xmlns=\"http://www.landxml.org/schema/LandXML-1.2\" version=\"1.2\">\n" head \
	"<Surfaces>\n" surfaces "</Surfaces></LandXML>\n"
#define SURFACE(name, content) "<Surface name=\"" name "\"><SourceData>" content "</SourceData></Surface>\n"
#define BREAKLINE(points) "<Breakline brkType=\"standard\" name=\"b\"><PntList3D>" points "</PntList3D></Breakline>\n"

static char text[LINES_CASE_TEXT];

static void test_features(void **state)
{
	static const struct {
		const char *xml, *want;
	} rows[] = {
		{XML("", ""), ""},
		{XML("", SURFACE("s", "<Breaklines>" BREAKLINE("2 1 3 5e1 4.50 -6") "</Breaklines>")),
		 "#1 s Breakline: open 1 2 3, 4.5 50 -6\n"},
		{XML("", SURFACE("a &amp; b", BREAKLINE("\n 2 1\t3\r\n 50 4.5 -6 \n") BREAKLINE("0 0 0 1 1 <![CDATA[1]]>0"))),
		 "#1 a & b Breakline: open 1 2 3, 4.5 50 -6\n#2 a & b Breakline: open 0 0 0, 1 1 10\n"},
		{XML("",
		     SURFACE("s",
			     "<Boundaries><Boundary bndType=\"outer\"><PntList3D>0 0 1 0 9 1 9 9 1 0 0 1</PntList3D></Boundary></Boundaries>")),
		 "#1 s Boundary: ring 0 0 1, 9 0 1, 9 9 1\n"},
		{XML("",
		     SURFACE("s",
			     "<Breakline><PntList2D>0 0 1 1</PntList2D></Breakline><Breakline/><Boundary></Boundary>" BREAKLINE(
				     ""))),
		 "#1 s Breakline ! it has no z\n#2 s Breakline\n#3 s Boundary\n#4 s Breakline\n"},
		{XML("",
		     SURFACE("s",
			     "<Contours><Contour elev=\"1\"><PntList2D>0 0 1 1</PntList2D></Contour><Contour/></Contours>" BREAKLINE(
				     "1 1 1 2 2 2"))
			     SURFACE("t",
				     BREAKLINE(
					     "1 1 1")) "<Surface><Definition surfType=\"TIN\"><Pnts><P id=\"1\">1 2 3</P></Pnts></Definition></Surface>"),
		 "#1 s Contour = Contour\n#2 s Contour = Contour\n#3 s Breakline: open 1 1 1, 2 2 2\n"
		 "#4 t Breakline ! a line has fewer than two vertices\n#5  faces of a surface = faces of a surface\n"},
		{"<l:LandXML xmlns:l=\"x\"><l:CgPoints><l:CgPoint>1 2 3</l:CgPoint></l:CgPoints><l:PlanFeatures><l:PlanFeature/></l:PlanFeatures>"
		 "<l:Surface name=\"q\"><l:Breakline><l:PntList3D>1 1 1 2 2 2</l:PntList3D><l:PntList3D>3 3 3 4 4 4</l:PntList3D></l:Breakline></l:Surface>"
		 "</l:LandXML>",
		 "#1  CgPoints = CgPoints\n#2  PlanFeature = PlanFeature\n#3 q Breakline: open 1 1 1, 2 2 2; open 3 3 3, 4 4 4\n"},
		{XML("", SURFACE("s", BREAKLINE("1 1 1 2e13 2 2"))), "#1 s Breakline ! a coordinate is beyond 1e12\n"},
		{"<?xml version=\"1.0\" encoding=\"ISO-8859-1\"?><LandXML><Surface name=\"m\xfcll\">" BREAKLINE(
			 "1 1 1 2 2 2") "</Surface></LandXML>",
		 "#1 m\xc3\xbcll Breakline: open 1 1 1, 2 2 2\n"},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
		assert_string_equal(lines_case_read_text("l.xml", rows[i].xml, NULL, text), rows[i].want);
}

static void test_layers(void **state)
{
	static const struct lines_options opt = {.layer = "t", .kind_field = "brkType"}, none = {.layer = "u"};
	static const char xml[] =
		XML("", SURFACE("s", BREAKLINE("1 1 1 2 2 2")) SURFACE(
				"t", BREAKLINE("3 3 3 4 4 4") "<Breakline><PntList3D>1 1 1 5 5 5</PntList3D></Breakline>"));

	assert_string_equal(lines_case_read_text("l.xml", xml, &opt, text),
			    "#2 t Breakline [standard]: open 3 3 3, 4 4 4\n#3 t Breakline: open 1 1 1, 5 5 5\n");
	assert_string_equal(lines_case_read_text("l.xml", xml, &none, text), "error: it has no layer \"u\" (its layers: s, t)\n");
}

static void test_systems(void **state)
{
	static const struct {
		const char *head, *name, *unit, *unit_z;
		unsigned epsg;
	} rows[] = {
		{"", "", "", "", 0},
		{"<Units><Metric linearUnit=\"meter\" areaUnit=\"squareMeter\"/></Units>", "", "metre", "", 0},
		{"<Units><Imperial linearUnit=\"USSurveyFoot\" elevationUnit=\"feet\"/></Units>", "", "us-survey-foot", "foot",
		 0},
		{"<Units><Imperial linearUnit=\"foot\"/></Units><CoordinateSystem name=\"\" desc=\"local\" epsgCode=\"2230\"/>",
		 "local", "foot", "", 2230},
		{"<CoordinateSystem epsgCode=\"EPSG:25832\"/>", "", "", "", 25832},
		{"<CoordinateSystem ogcWktCode='PROJCS[\"W\",UNIT[\"Foot_US\",0.3],AUTHORITY[\"EPSG\",\"2276\"]]'/>", "W",
		 "us-survey-foot", "", 2276},
		{"<CoordinateSystem ogcWktCode=\"2276\"/>", "", "", "", 0},
	};
	static const struct lines_options opt;

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		const struct lines_feature *f;
		struct err err = ERR_INIT;
		struct lines *l;
		char xml[1500];

		snprintf(xml, sizeof xml, "<LandXML version=\"1.0\">%s%s</LandXML>", rows[i].head,
			 SURFACE("s", BREAKLINE("1 1 1 2 2 2")));
		lines_case_file("s.xml", xml, strlen(xml));
		assert_string_equal(lines_recognise(lines_case_path("s.xml")), "LandXML");
		assert_int_equal(lines_open(lines_case_path("s.xml"), &opt, &l, &err), 0);
		assert_int_equal(lines_next(l, &f, &err), 0);
		assert_string_equal(f->layer->crs.name, rows[i].name);
		assert_string_equal(f->layer->crs.unit, rows[i].unit);
		assert_string_equal(f->layer->crs.unit_z, rows[i].unit_z);
		assert_int_equal(f->layer->crs.epsg, rows[i].epsg);
		assert_string_equal(lines_info(l)->variant, "1.0");
		lines_close(l);
	}
}

/* The text of a system is kept up to 64 KiB, and read in a moment whatever it is. */
static void test_long_systems(void **state)
{
	static const struct lines_options opt;
	static char xml[400000];

	for (size_t most = 65536; most <= 300000; most += most == 65536 ? 1 : 200000) {
		const struct lines_feature *f;
		struct err err = ERR_INIT;
		struct lines *l;
		size_t n = (size_t)sprintf(xml, "<LandXML><CoordinateSystem ogcWktCode=\""), begin = n;

		n += (size_t)sprintf(xml + n, "A[&quot;W&quot;");
		begin += 10; /* two quotes take one byte each in the text */
		while (n + 8 <= begin + most)
			n += (size_t)sprintf(xml + n, ",UNIT[]");
		while (n < begin + most - 1)
			xml[n++] = ' ';
		strcpy(xml + n, "]\"/>" SURFACE("s", BREAKLINE("1 1 1 2 2 2")) "</LandXML>");
		lines_case_file("s.xml", xml, strlen(xml));
		assert_int_equal(lines_open(lines_case_path("s.xml"), &opt, &l, &err), 0);
		assert_int_equal(lines_next(l, &f, &err), 0);
		assert_int_equal(strlen(f->layer->crs.wkt), most == 65536 ? most : 0);
		assert_string_equal(f->layer->crs.name, most == 65536 ? "W" : "");
		lines_close(l);
	}
}

static void test_wrong(void **state)
{
	static const struct {
		const char *xml, *want;
	} rows[] = {
		{XML("", SURFACE("s", BREAKLINE("1 1 1 2 2"))),
		 "line 4: a PntList3D does not have three numbers for each vertex"},
		{XML("", SURFACE("s", BREAKLINE("1 1 1 2 two 2"))), "line 4: \"two\" is no number"},
		{XML("", SURFACE("s", BREAKLINE("1 1 1 <P/>"))), "line 4: a list of points has an element in it"},
		{XML("", SURFACE("s", "<Breakline>" BREAKLINE("1 1 1"))), "line 4: a breakline or boundary lies in another"},
		{XML("", "<Surface>" SURFACE("s", "")), "line 4: a surface lies in another"},
		{XML("", SURFACE("s", BREAKLINE("1 1 1 2 2 &nbsp;"))), "line 4: undefined entity"},
		{"<?xml version=\"1.0\"?><!DOCTYPE a [<!ENTITY e \"x\">]><LandXML>&e;</LandXML>",
		 "line 1: it has a document type (DOCTYPE)"},
		{"<?xml version=\"1.0\" encoding=\"EBCDIC\"?><LandXML/>", "its encoding is not read (convert it to UTF-8"},
		{"<a><b:LandXML/></a>", "line 1: the document is no LandXML"},
		{"<LandXML></LandXML><x/>", "line 1: junk after document element"},
	};
	static const char xml[] = XML("", SURFACE("s", BREAKLINE("1 1 1 2 2 2")));
	static char many[6 << 20];
	size_t n;

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		const char *said = lines_case_read_text("w.xml", rows[i].xml, NULL, text);

		if (!strstr(said, "error: ") || !strstr(said, rows[i].want) || !strchr(said, '('))
			fail_msg("%s: %s", rows[i].xml, said);
	}
	for (n = 70; n + 2 < sizeof xml; n++) {
		lines_case_file("w.xml", xml, n);
		if (!strstr(lines_case_read(lines_case_path("w.xml"), NULL, text), "error: "))
			fail_msg("%.*s: %s", (int)n, xml, text);
	}
	n = (size_t)sprintf(many, "<LandXML>");
	for (int i = 0; i < 100; i++)
		n += (size_t)sprintf(many + n, "<a>");
	assert_non_null(strstr(lines_case_read_text("w.xml", many, NULL, text), "elements lie in each other more than 64 deep"));
	n = (size_t)sprintf(many, "<LandXML><!--");
	memset(many + n, 'x', sizeof many - n - 1);
	assert_non_null(strstr(lines_case_read_text("w.xml", many, NULL, text), "a tag or comment has more than 4 MiB"));
}

/* Numbers that lie across the pieces that are read, and more vertices than a feature may have. */
static void test_large(void **state)
{
	const char *path = lines_case_path("large.xml");
	FILE *f = fopen(path, "w");
	double sum = 0, want = 0;
	const struct lines_feature *g;
	static const struct lines_options opt;
	struct err err = ERR_INIT;
	struct lines *l;

	fputs("<LandXML><Surface name=\"s\"><Breakline><PntList3D>", f);
	for (int i = 0; i < LINES_VERTICES_MOST; i++) {
		fprintf(f, "%d.25 %d 1\n", i, i);
		want += i;
	}
	fputs("</PntList3D></Breakline><Breakline><PntList3D>", f);
	for (int i = 0; i <= LINES_VERTICES_MOST; i++)
		fprintf(f, "%d %d 1\n", i, i);
	fputs("</PntList3D></Breakline>" BREAKLINE("1 1 1 2 2 2") "</Surface></LandXML>", f);
	assert_int_equal(fclose(f), 0);
	assert_int_equal(lines_open(path, &opt, &l, &err), 0);
	assert_int_equal(lines_next(l, &g, &err), 0);
	assert_int_equal(g->state, LINES_USABLE);
	assert_int_equal(g->nvertices, LINES_VERTICES_MOST);
	for (size_t i = 0; i < g->nvertices; i++)
		sum += lines_coordinate(g, i, 0);
	assert_true(sum == want);
	assert_int_equal(lines_next(l, &g, &err), 0);
	assert_string_equal(g->why, "it has more than 524288 vertices");
	assert_int_equal(lines_next(l, &g, &err), 0);
	assert_int_equal(g->state, LINES_USABLE);
	assert_int_equal(lines_next(l, &g, &err), 0);
	assert_null(g);
	lines_close(l);
}

static int remove_all(void **state)
{
	lines_case_remove_all();
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_features),     cmocka_unit_test(test_layers),
					   cmocka_unit_test(test_systems),      cmocka_unit_test(test_wrong),
					   cmocka_unit_test(test_long_systems), cmocka_unit_test(test_large)};

	return cmocka_run_group_tests(tests, NULL, remove_all);
}
