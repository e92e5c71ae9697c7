/* Shapefiles made here, byte by byte: what is read of each type; what is refused; damaged ones; their tables and indexes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>
#include <math.h>

#include "lines_made.h"
#include "lines_priv.h"

static char text[LINES_CASE_TEXT];
static struct lines_case_bytes shp, shx;

static void begin(uint32_t type)
{
	lines_made_shape_begin(&shp, &shx, type);
}

static void shape(uint32_t type, const uint32_t *count)
{
	lines_made_shape(&shp, &shx, type, count);
}

static const char *read_all(const struct lines_options *opt)
{
	lines_case_file("a.shp", shp.at, shp.n);
	return lines_case_read(lines_case_path("a.shp"), opt, text);
}

static void expect(const char *want)
{
	assert_string_equal(read_all(NULL), want);
}

static void test_types(void **state)
{
	begin(13);
	shape(13, (uint32_t[]){2, 3, 0});
	shape(0, NULL);
	shape(15, (uint32_t[]){4, 5, 0});
	shape(3, (uint32_t[]){2, 0});
	shape(5, (uint32_t[]){4, 0});
	shape(23, (uint32_t[]){2, 0});
	shape(25, (uint32_t[]){4, 0});
	shape(11, NULL);
	shape(1, NULL);
	shape(31, NULL);
	shape(13, (uint32_t[]){1, 0});
	shape(15, (uint32_t[]){3, 0});
	shape(13, (uint32_t[]){0});
	expect("#1 a PolyLineZ: open 0 0 0, 1 10 0.25; open 2 20 0.5, 3 30 0.75, 4 40 1\n"
	       "#2 a \n"
	       "#3 a PolygonZ: ring 0 0 0, 1 10 0.25, 2 20 0.5; ring 4 40 1, 5 50 1.25, 6 60 1.5, 7 70 1.75\n"
	       "#4 a PolyLine ! it has no z\n"
	       "#5 a Polygon ! it has no z\n"
	       "#6 a PolyLineM ! it has no z\n"
	       "#7 a PolygonM ! it has no z\n"
	       "#8 a  = points\n"
	       "#9 a  = points\n"
	       "#10 a MultiPatch ! it is a surface in space (MultiPatch)\n"
	       "#11 a PolyLineZ ! a line has fewer than two vertices\n"
	       "#12 a PolygonZ ! a ring has fewer than three vertices\n"
	       "#13 a PolyLineZ\n");
}

static void set_double(size_t at, double v)
{
	size_t n = shp.n;

	shp.n = at;
	lines_case_double(&shp, v, 0);
	shp.n = n;
}

static void test_numbers(void **state)
{
	static const struct {
		double v;
		const char *want;
	} rows[] = {
		{1e12, "#1 a PolyLineZ: open 1000000000000 0 0, 1 10 0.25\n"},
		{1.1e12, "#1 a PolyLineZ ! a coordinate is beyond 1e12\n"},
		{-1e39, "#1 a PolyLineZ ! a coordinate is beyond 1e12\n"},
		{NAN, "#1 a PolyLineZ ! a coordinate is not finite\n"},
		{INFINITY, "#1 a PolyLineZ ! a coordinate is not finite\n"},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		begin(13);
		shape(13, (uint32_t[]){2, 0});
		set_double(100 + 8 + 44 + 4, rows[i].v);
		expect(rows[i].want);
	}
	begin(15);
	shape(15, (uint32_t[]){4, 0});
	set_double(shp.n - 8, 7);
	expect("#1 a PolygonZ ! a ring ends where it begins, at another z\n");
}

static void test_damaged(void **state)
{
	static const struct {
		size_t at;
		uint32_t v;
		int big;
		const char *want;
	} rows[] = {
		{104, 1000, 1, "the shape of record 1 ends beyond the end of the file"},
		{104, 0xffffffff, 1, "the shape of record 1 ends beyond the end of the file"},
		{104, 1, 1, "a shape has no type"},
		{104, 10, 1, "a shape of 20 bytes is too short"},
		{108, 4, 0, "a shape has the type 4, which does not exist"},
		{108 + 36, 1000, 0, "a shape of 1000 parts and 2 vertices does not fit into its 112 bytes"},
		{108 + 40, 0xffffffff, 0, "a shape of 1 parts and 4294967295 vertices does not fit into its 112 bytes"},
		{108 + 36, 0, 0, "a shape of 2 vertices has no part"},
		{108 + 44, 1, 0, "part 1 begins at vertex 1 of 2"},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		const char *said;

		begin(13);
		shape(13, (uint32_t[]){2, 0});
		lines_case_set32(&shp, rows[i].at, rows[i].v, rows[i].big);
		said = read_all(NULL);
		if (!strstr(said, "error: byte 1") || !strstr(said, rows[i].want) || !strstr(said, "write it again"))
			fail_msg("row %zu: %s", i, said);
	}
	/* A file of any length up to the whole. */
	for (size_t n = 0; n < 224; n++) {
		begin(13);
		shape(13, (uint32_t[]){2, 0});
		assert_int_equal(shp.n, 100 + 8 + 112);
		shp.n = n < shp.n ? n : shp.n;
		if (!strstr(read_all(NULL), "error: ") != (n == 100 || n >= 220))
			fail_msg("%zu bytes: %s", n, text);
	}
}

/* An index finds shapes in its order, and not those that were replaced. */
static void test_index(void **state)
{
	begin(13);
	shape(13, (uint32_t[]){2, 0});
	shape(15, (uint32_t[]){4, 0});
	shape(13, (uint32_t[]){3, 0});
	lines_case_set32(&shx, 100, (uint32_t)(shp.n - 8 - 44 - 4 - 3 * 16 - 16 - 3 * 8) / 2,
			 1); /* the first is the last one now */
	lines_case_file("a.shx", shx.at, shx.n - 8);
	expect("#1 a PolyLineZ: open 0 0 0, 1 10 0.25, 2 20 0.5\n"
	       "#2 a PolygonZ: ring 0 0 0, 1 10 0.25, 2 20 0.5\n");
	lines_case_set32(&shx, 100, 0x7fffffff, 1);
	lines_case_file("a.shx", shx.at, shx.n);
	assert_non_null(strstr(read_all(NULL), "there is no room for the shape of record 1"));
	shape(0, NULL);
	for (int i = 0; i < 4; i++)
		lines_case_set32(&shx, 100 + 8 * (size_t)i, 50 + 60, 1);
	lines_case_file("a.shx", shx.at, shx.n);
	assert_non_null(strstr(read_all(NULL), "shapes lie over each other"));
	lines_case_file("a.shx", shx.at, 60);
	assert_non_null(strstr(read_all(NULL), "its index (.shx) is damaged (move the .shx away"));
	unlink(lines_case_path("a.shx"));
}

static void table(const char *deleted, uint32_t rows)
{
	static struct lines_case_bytes dbf;

	lines_made_table(&dbf, deleted, rows);
	lines_case_file("a.dbf", dbf.at, dbf.n);
}

static void test_table(void **state)
{
	static const struct lines_options kind = {.kind_field = "kind_of_line"}, other = {.kind_field = "sort"};

	begin(13);
	for (int i = 0; i < 3; i++)
		shape(13, (uint32_t[]){2, 0});
	assert_non_null(strstr(read_all(&kind), "error: it has no table (.dbf), so no field \"kind_of_line\""));
	table(" * ", 3);
	expect("#1 a PolyLineZ: open 0 0 0, 1 10 0.25\n#3 a PolyLineZ: open 0 0 0, 1 10 0.25\n");
	assert_string_equal(read_all(&kind),
			    "#1 a PolyLineZ [lake]: open 0 0 0, 1 10 0.25\n#3 a PolyLineZ [lake]: open 0 0 0, 1 10 0.25\n");
	assert_non_null(strstr(read_all(&other), "it has no field \"sort\" (its fields: NAME, KIND_OF_LI)"));
	table("  ", 2);
	assert_non_null(strstr(read_all(&kind), "its table (.dbf) has fewer rows than there are shapes"));
	table("  ", 3);
	assert_non_null(strstr(read_all(&kind), "its table (.dbf) is cut"));
	lines_case_file("a.dbf", "", 0);
	assert_non_null(strstr(read_all(NULL), "its table (.dbf) is cut"));
	unlink(lines_case_path("a.dbf"));
}

static void test_projection(void **state)
{
	static const char wkt[] = "PROJCS[\"ETRS89 / UTM zone 32N\"]";
	struct lines_options opt = {.layer = "A"};
	const struct lines_feature *f;
	struct err err = ERR_INIT;
	struct lines *l;

	begin(13);
	shape(13, (uint32_t[]){2, 0});
	lines_case_file("a.shp", shp.at, shp.n);
	lines_case_file("a.prj", wkt, sizeof wkt - 1);
	assert_int_equal(lines_open(lines_case_path("a.shp"), &opt, &l, &err), 0);
	assert_int_equal(lines_next(l, &f, &err), 0);
	assert_string_equal(f->layer->crs.wkt, wkt);
	assert_string_equal(f->layer->crs.from, ".prj");
	assert_string_equal(lines_info(l)->variant, "PolyLineZ");
	lines_close(l);
	opt.layer = "b";
	assert_string_equal(read_all(&opt), "error: it has no layer \"b\" (its layers: a)\n");
	unlink(lines_case_path("a.prj"));
}

static void test_wkt(void **state)
{
	static const struct {
		const char *wkt, *name, *unit, *unit_z;
		unsigned epsg, epsg_z;
		bool degrees;
	} rows[] = {
		{"", "", "", "", 0, 0, false},
		{"GEOGCS[\"WGS 84\",DATUM[\"x\",SPHEROID[\"y\",1,2,AUTHORITY[\"EPSG\",\"7030\"]]],UNIT[\"degree\",0.01],AUTHORITY[\"EPSG\",\"4326\"]]",
		 "WGS 84", "", "", 4326, 0, true},
		{"PROJCS[\"NAD83_[2]\",GEOGCS[\"g\",UNIT[\"Degree\",0.01],AUTHORITY[\"EPSG\",\"4269\"]],UNIT[\"Foot_US\",0.3048006]]",
		 "NAD83_[2]", "us-survey-foot", "", 0, 0, false},
		{"COMPD_CS[\"both\",PROJCS[\"p\",GEOGCS[\"g\",UNIT[\"degree\",1]],UNIT[\"metre\",1],AUTHORITY[\"EPSG\",\"25832\"]],VERT_CS[\"v\","
		 "UNIT[\"foot\",0.3048],AUTHORITY[\"EPSG\",\"5783\"]],AUTHORITY[\"EPSG\",\"7837\"]]",
		 "both", "metre", "foot", 25832, 5783, false},
		{"PROJCRS[\"P\", BASEGEOGCRS[\"g\", ID[\"EPSG\",4258]], CONVERSION[\"c\"], CS[Cartesian,2], LENGTHUNIT[\"metre\",1], ID[\"EPSG\",3035]]",
		 "P", "metre", "", 3035, 0, false},
		/* of ESRI, with heights: a tree of their own */
		{"PROJCS[\"p\",GEOGCS[\"g\",UNIT[\"Degree\",0.01]],UNIT[\"Meter\",1.0]],VERTCS[\"v\",VDATUM[\"d\"],PARAMETER[\"Vertical_Shift\",0.0],"
		 "UNIT[\"Foot_US\",0.3],AUTHORITY[\"EPSG\",\"6360\"]]",
		 "p + v", "metre", "us-survey-foot", 0, 6360, false},
		{"PROJCS[\"p\",UNIT[\"metre\",1]],GEOGCS[\"q\",UNIT[\"degree\",1],AUTHORITY[\"EPSG\",\"4326\"]]", "p", "metre",
		 "", 0, 0, false},
		/* units in the axes */
		{"PROJCRS[\"P\",BASEGEOGCRS[\"g\"],CONVERSION[\"c\",PARAMETER[\"a\",1,LENGTHUNIT[\"foot\",0.3]]],CS[Cartesian,2],"
		 "AXIS[\"(E)\",east,ORDER[1],LENGTHUNIT[\"metre\",1]],AXIS[\"(N)\",north,ORDER[2],LENGTHUNIT[\"metre\",1]],ID[\"EPSG\",3035]]",
		 "P", "metre", "", 3035, 0, false},
		{"COMPOUNDCRS[\"C\",PROJCRS[\"P\",CS[Cartesian,2],AXIS[\"(E)\",east,LENGTHUNIT[\"metre\",1]]],"
		 "VERTCRS[\"V\",CS[vertical,1],AXIS[\"height (H)\",up,LENGTHUNIT[\"foot\",0.3048]],ID[\"EPSG\",5783]]]",
		 "C", "metre", "foot", 0, 5783, false},
		{"GEOGCRS[\"G\",CS[ellipsoidal,3],AXIS[\"(Lat)\",north,ANGLEUNIT[\"degree\",1]],AXIS[\"h\", up,LENGTHUNIT[\"metre\",1]],ID[\"EPSG\",4979]]",
		 "G", "", "metre", 4979, 0, true},
		/* a name stands in quotes */
		{"PROJCS[\"p\",UNIT[],UNIT[metre,1],AXIS[\"x\",east]]", "p", "", "", 0, 0, false},
		{"PROJCS(\"round\",UNIT(\"links\",1))", "round", "links", "", 0, 0, false},
		{"PROJCS[\"cut", "cut", "", "", 0, 0, false},
		{"]]]]", "", "", "", 0, 0, false},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct lines_crs crs = {.epsg = 0};

		lines_crs_of_wkt(rows[i].wkt, &crs);
		assert_string_equal(crs.name, rows[i].name);
		assert_string_equal(crs.unit, rows[i].unit);
		assert_string_equal(crs.unit_z, rows[i].unit_z);
		assert_int_equal(crs.epsg, rows[i].epsg);
		assert_int_equal(crs.epsg_z, rows[i].epsg_z);
		assert_int_equal(crs.degrees, rows[i].degrees);
	}
}

/* One vertex more than is kept, in a part more than is kept. */
static void test_limits(void **state)
{
	static const uint32_t counts[2][2] = {{1, LINES_VERTICES_MOST + 1}, {LINES_PARTS_MOST + 1, LINES_VERTICES_MOST}};
	static const char *const want[] = {"#1 a PolyLineZ ! it has more than 524288 vertices\n",
					   "#1 a PolyLineZ ! it has more than 65536 lines or rings\n"};

	for (int i = 0; i < 2; i++) {
		begin(13);
		shape(13, (uint32_t[]){2, 0});
		lines_case_set32(&shp, 104, 0x1000000, 1);
		lines_case_set32(&shp, 108 + 36, counts[i][0], 0);
		lines_case_set32(&shp, 108 + 40, counts[i][1], 0);
		lines_case_file("a.shp", shp.at, shp.n);
		assert_int_equal(truncate(lines_case_path("a.shp"), 108 + 0x2000000), 0);
		assert_string_equal(lines_case_read(lines_case_path("a.shp"), NULL, text), want[i]);
	}
}

static int remove_all(void **state)
{
	lines_case_remove_all();
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_types),  cmocka_unit_test(test_numbers), cmocka_unit_test(test_damaged),
		cmocka_unit_test(test_index),  cmocka_unit_test(test_table),   cmocka_unit_test(test_projection),
		cmocka_unit_test(test_limits), cmocka_unit_test(test_wkt),
	};

	return cmocka_run_group_tests(tests, NULL, remove_all);
}
