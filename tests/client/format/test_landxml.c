/* LandXML, read back: exact numbers in the order of northing, easting and elevation, units, the name of the surface. */
#include <inttypes.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "readback.h"

/* The text between two marks; `at` is then behind the second. */
static const char *between(const char **at, const char *start, const char *end)
{
	static char text[400];
	const char *a = strstr(*at, start), *b = a ? strstr(a + strlen(start), end) : NULL;

	assert_non_null(b);
	a += strlen(start);
	assert_true((size_t)(b - a) < sizeof(text));
	snprintf(text, sizeof(text), "%.*s", (int)(b - a), a);
	*at = b + strlen(end);
	return text;
}

/* Every point and face, in this order, and nothing else in its place but blanks. */
static void expect_mesh(const char *text, const struct readback_mesh *f, const int64_t k[3])
{
	const char *at = strstr(text, "<Definition surfType=\"TIN\">\n<Pnts>\n");

	assert_non_null(at);
	at += strlen("<Definition surfType=\"TIN\">\n<Pnts>\n");
	for (uint64_t i = 0; i < f->nvertex; i++) {
		char id[64];
		int n = snprintf(id, sizeof(id), "<P id=\"%" PRIu64 "\">", i + 1);

		assert_memory_equal(at, id, (size_t)n);
		at += n;
		assert_int_equal(readback_number(&at, 2), f->vertex[i][1] + k[1]);
		assert_int_equal(*at++, ' ');
		assert_int_equal(readback_number(&at, 2), f->vertex[i][0] + k[0]);
		assert_int_equal(*at++, ' ');
		assert_int_equal(readback_number(&at, 3), f->vertex[i][2] + k[2]);
		assert_memory_equal(at, "</P>\n", 5);
		at += 5;
	}
	assert_memory_equal(at, "</Pnts>\n<Faces>\n", 16);
	at += 16;
	at += strspn(at, " ");
	for (uint64_t i = 0; i < f->ntriangle; i++) {
		char face[100];
		int n = snprintf(face, sizeof(face), "<F>%" PRIu64 " %" PRIu64 " %" PRIu64 "</F>\n", f->triangle[i][0] + 1,
				 f->triangle[i][1] + 1, f->triangle[i][2] + 1);

		assert_memory_equal(at, face, (size_t)n);
		at += n;
	}
	assert_memory_equal(at, "</Faces>\n</Definition>\n", 23);
	assert_string_equal(strrchr(at, '/'), "/LandXML>\n");
}

static void expect_written(const struct meshes_spec *spec)
{
	const struct format_options opt = {0};
	struct meshes m;
	struct readback_mesh f;
	size_t size;
	char *text;

	meshes_make(&m, spec);
	f = readback_flat(&m);
	text = readback_text("landxml", "TIN.xml", &m, &opt, &size);
	expect_mesh(text, &f, spec->k);
	readback_same_piped("landxml", &m, &opt, text, size); /* its surface is named TIN, too */
	free(text);
	readback_flat_done(&f);
	meshes_done(&m);
}

static void test_mesh(void **state)
{
	expect_written(&readback_small);
	expect_written(&readback_large);
}

static void test_head(void **state)
{
	const struct format_options opt = {0};
	struct meshes m;
	size_t size;
	char *text;
	const char *at;

	meshes_make(&m, &readback_small);
	at = text = readback_text("landxml", "a <b> & \"c\" \xc3\xa4\xff.v2.xml", &m, &opt, &size);
	assert_string_equal(between(&at, "<Units>\n<", " "), "Metric");
	assert_string_equal(between(&at, "linearUnit=\"", "\""), "meter");
	assert_string_equal(between(&at, "<CoordinateSystem ", "/>"), "epsgCode=\"26910\" desc=\"EPSG:26910 second line\"");
	assert_string_equal(between(&at, "label=\"acut-lattice\" value=\"", "\""), "0.01 0.001 50000000 400000000 -12");
	assert_string_equal(between(&at, "<Surface name=\"", "\">"), "a &lt;b&gt; &amp; &quot;c&quot; \xc3\xa4?.v2");
	assert_string_equal(between(&at, "label=\"acut-counts\" value=\"", "\""), "1650 3136");
	assert_string_equal(between(&at, "label=\"acut-digest\" value=\"", "\""),
			    "0123456789abcdef0123456789abcdef fedcba9876543210fedcba9876543210");
	free(text);
	meshes_done(&m);
}

/* What the system is when it has no code, and when coordinates are moved or heights converted. */
static void test_system(void **state)
{
	static const char local[] = "LOCAL_CS[\"a < b\",UNIT[\"metre\",1]]",
			  escaped[] = " ogcWktCode=\"LOCAL_CS[&quot;a &lt; b&quot;,UNIT[&quot;metre&quot;,1]]\"";
	static const struct {
		const char *crs, *vertical, *wkt;
		uint32_t epsg;
		bool moved;
		const char *z_unit;
		const char *said[4];
	} row[] = {
		{"EPSG:25832 + EPSG:5941",
		 "EPSG:5941",
		 "",
		 25832,
		 false,
		 NULL,
		 {" epsgCode=\"25832\" desc=\"EPSG:25832 + EPSG:5941\"", " verticalDatum=\"EPSG:5941\"/>"}},
		{"NAD83 <old>\n", "", NULL, 0, false, NULL, {" desc=\"NAD83 &lt;old&gt; \"/>"}},
		{"EPSG:25832", "", "", 25832, true, NULL, {" desc=\"EPSG:25832, less an origin\"/>"}},
		{"EPSG:1 + here", "here", local, 1, true, NULL, {" desc=\"EPSG:1 + here, less an origin\"/>"}},
		{"site", "", local, 0, false, NULL, {" desc=\"site\"", escaped, "/>"}},
		{"site", "", local, 0, false, "metre", {" desc=\"site\"", escaped, "/>"}},
		{"EPSG:1 + a \"b\"",
		 "a \"b\"",
		 local,
		 1,
		 false,
		 NULL,
		 {" epsgCode=\"1\" desc=\"EPSG:1 + a &quot;b&quot;\"", escaped, " verticalDatum=\"a &quot;b&quot;\"/>"}},
		{"", "", local, 0, false, NULL, {NULL}},
	};

	for (unsigned i = 0; i < sizeof(row) / sizeof(*row); i++) {
		struct format_options opt = {.has_origin = row[i].moved, .z_unit = row[i].z_unit};
		struct meshes m;
		size_t size;
		char *text, *at;

		decimal_parse("500000.5", &opt.origin[0]);
		meshes_make(&m, &readback_small);
		m.head.crs = row[i].crs;
		m.head.epsg = row[i].epsg;
		m.head.vertical = row[i].vertical;
		m.head.wkt = row[i].wkt;
		text = readback_text("landxml", "m.xml", &m, &opt, &size);
		at = strstr(text, "<CoordinateSystem");
		assert_int_equal(at == NULL, row[i].said[0] == NULL);
		at += at ? strlen("<CoordinateSystem") : 0;
		for (unsigned k = 0; row[i].said[k]; at += strlen(row[i].said[k++]))
			assert_memory_equal(at, row[i].said[k], strlen(row[i].said[k]));
		at = strstr(text, row[i].moved ? "<P id=\"1\">4000001.23 -70.50 -0.012</P>" :
						 "<P id=\"1\">4000001.23 499930.00 -0.012</P>");
		assert_non_null(at);
		free(text);
		meshes_done(&m);
	}
}

/* Heights in another unit are in no vertical system, and a WKT that has one would say what is not so. */
static void test_converted(void **state)
{
	const struct format_options opt = {.z_unit = "metre"};
	struct meshes m;
	size_t size;

	for (int vertical = 0; vertical < 2; vertical++) {
		const char *at;
		char *text;

		meshes_make(&m, &readback_small);
		m.head.crs = vertical ? "site + feet" : "site";
		m.head.vertical = vertical ? "feet" : "";
		m.head.unit_z = "foot";
		m.head.wkt = "LOCAL_CS[]";
		m.head.epsg = 0;
		at = text = readback_text("landxml", "m.xml", &m, &opt, &size);
		assert_string_equal(between(&at, "<CoordinateSystem ", "/>"),
				    vertical ? "desc=\"site + feet\"" : "desc=\"site\" ogcWktCode=\"LOCAL_CS[]\"");
		free(text);
		meshes_done(&m);
	}
}

/* One unit of length, and it must be known. */
static void test_units(void **state)
{
	static const struct {
		const char *xy, *z, *z_unit, *said, *hint;
	} row[] = {
		{"metre", "metre", NULL, "linearUnit=\"meter\"", NULL},
		{"foot", "foot", NULL, "linearUnit=\"foot\"", NULL},
		{"us-survey-foot", "us-survey-foot", NULL, "linearUnit=\"USSurveyFoot\"", NULL},
		{"us-survey-foot", "metre", "us-survey-foot", "linearUnit=\"USSurveyFoot\"", NULL},
		{"metre", "metre", "foot", NULL, "--z-unit m"},
		{"us-survey-foot", "metre", NULL, NULL, "--z-unit ftUS"},
		{"foot", "us-survey-foot", NULL, NULL, "--z-unit ft"},
		{"metre", "", NULL, NULL, "--assume-units ,m"},
		{"", "", NULL, NULL, "--assume-units m"},
		{NULL, "metre", NULL, NULL, "--assume-units m"},
		{"degree", "metre", NULL, NULL, "--utm"},
	};

	for (unsigned i = 0; i < sizeof(row) / sizeof(*row); i++) {
		const struct format_options opt = {.z_unit = row[i].z_unit};
		struct meshes m;
		struct err err;
		size_t size;
		char *text;

		meshes_make(&m, &readback_small);
		m.head.unit_xy = row[i].xy;
		m.head.unit_z = row[i].z;
		if (row[i].said) {
			text = readback_text("landxml", "m.xml", &m, &opt, &size);
			assert_non_null(strstr(text, row[i].said));
			assert_int_equal(strstr(text, "<Imperial") == NULL, !strcmp(row[i].xy, "metre"));
			free(text);
		} else {
			assert_int_equal(readback_write("landxml", "m.xml", &m, &opt, &err), -ERR_USAGE);
			assert_non_null(strstr(err.message, "LandXML"));
			assert_non_null(strstr(err.hint, row[i].hint));
		}
		meshes_done(&m);
	}
}

/* Numbers that other formats cannot have. */
static void test_high_numbers(void **state)
{
	static const int32_t v[][3] = {{0, 0, 0}, {300, 0, 0}, {0, 400, 0}};
	static const uint32_t t[][3] = {{1, 2, 3}, {0, 1, 2}};
	static const uint64_t foreign[] = {UINT32_MAX};
	static const uint8_t final[] = {15};
	struct acut_mesh_block b = {.first = 1ull << 40,
				    .nforeign = 1,
				    .foreign = foreign,
				    .nnew = 3,
				    .ntriangle = 2,
				    .vertex = v,
				    .triangle = t,
				    .final = final};
	const struct format_options opt = {0};
	struct meshes m;
	size_t size;
	char *text;

	meshes_make(&m, &(struct meshes_spec){.scale_xy = "0.01", .scale_z = "1"});
	m.block = &b;
	m.nblock = 1;
	text = readback_text("landxml", "m.xml", &m, &opt, &size);
	assert_non_null(strstr(text, "<P id=\"1099511627777\">0.00 0.00 0</P>\n"));
	assert_non_null(strstr(
		text, "<F>1099511627777 1099511627778 1099511627779</F>\n<F>4294967296 1099511627777 1099511627778</F>\n"));
	free(text);
}

/* Two orders of one mesh are one file. */
static void test_canonical(void **state)
{
	const struct format_options opt = {.canonical = true};
	struct meshes_spec spec = readback_large;
	size_t size[2];
	char *text[2];

	for (unsigned i = 0; i < 2; i++) {
		struct meshes m;

		spec.shuffle = i;
		spec.strip = i ? 17 : 299;
		meshes_make(&m, &spec);
		text[i] = readback_text("landxml", "m.xml", &m, &opt, &size[i]);
		meshes_done(&m);
	}
	assert_int_equal(size[0], size[1]);
	assert_memory_equal(text[0], text[1], size[0]);
	free(text[0]);
	free(text[1]);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_mesh),      cmocka_unit_test(test_head),  cmocka_unit_test(test_system),
		cmocka_unit_test(test_converted), cmocka_unit_test(test_units), cmocka_unit_test(test_high_numbers),
		cmocka_unit_test(test_canonical),
	};

	return cmocka_run_group_tests(tests, readback_begin, readback_end);
}
