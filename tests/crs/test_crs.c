/*
 * Coordinate systems out of GeoTIFF keys and WKT: the records of real files, contradictions, and rubbish.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "crs.h"

#define UTM10                                                                                                      \
	"PROJCS[\"NAD83 / UTM zone 10N\",GEOGCS[\"NAD83\",DATUM[\"North_American_Datum_1983\","                    \
	"SPHEROID[\"GRS 1980\",6378137,298.257222101,AUTHORITY[\"EPSG\",\"7019\"]],AUTHORITY[\"EPSG\",\"6269\"]]," \
	"PRIMEM[\"Greenwich\",0,AUTHORITY[\"EPSG\",\"8901\"]],UNIT[\"degree\",0.0174532925199433],"                \
	"AUTHORITY[\"EPSG\",\"4269\"]],PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"central_meridian\",-123],"  \
	"UNIT[\"metre\",1,AUTHORITY[\"EPSG\",\"9001\"]],AXIS[\"Easting\",EAST],AUTHORITY[\"EPSG\",\"26910\"]]"

struct wkt_case {
	const char *wkt;
	enum crs_plane plane;
	const char *text, *unit_xy, *unit_z;
};

static const struct wkt_case wkt_cases[] = {
	{UTM10, CRS_PLANE_PROJECTED, "EPSG:26910", "metre", "unknown"},
	{"PROJCS[\"Lambert\",GEOGCS[\"g\",UNIT[\"degree\",0.0174532925199433]],UNIT[\"foot\",0.3048]]", CRS_PLANE_PROJECTED,
	 "Lambert", "foot", "unknown"},
	{"PROJCS(\"round\",GEOGCS(\"g\",UNIT(\"Degree\",0.017453292519943295)),UNIT(\"Foot_US\",0.3048006096012192))",
	 CRS_PLANE_PROJECTED, "round", "us-survey-foot", "unknown"},
	{"GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],PRIMEM[\"Greenwich\",0],"
	 "UNIT[\"degree\",0.0174532925199433],AUTHORITY[\"EPSG\",\"4326\"]]",
	 CRS_PLANE_GEOGRAPHIC, "EPSG:4326", "degree", "unknown"},
	{"GEOCCS[\"WGS 84 (geocentric)\",DATUM[\"WGS_1984\"],UNIT[\"metre\",1]]", CRS_PLANE_GEOCENTRIC, "WGS 84 (geocentric)",
	 "metre", "metre"},
	{"COMPD_CS[\"both\",PROJCS[\"h\",GEOGCS[\"g\",UNIT[\"degree\",0.0174532925199433]],UNIT[\"metre\",1],"
	 "AUTHORITY[\"EPSG\",\"2991\"]],VERT_CS[\"v\",VERT_DATUM[\"d\",2005,AUTHORITY[\"EPSG\",\"5103\"]],"
	 "UNIT[\"US survey foot\",0.304800609601219],AXIS[\"up\",UP],AUTHORITY[\"EPSG\",\"6360\"]]]",
	 CRS_PLANE_PROJECTED, "EPSG:2991 + EPSG:6360", "metre", "us-survey-foot"},
	{"PROJCRS[\"WGS 84 / UTM zone 23S\",\n BASEGEOGCRS[\"WGS 84\",DATUM[\"x\",ELLIPSOID[\"WGS 84\",6378137,298.25,"
	 "LENGTHUNIT[\"metre\",1]]],ID[\"EPSG\",4326]],CONVERSION[\"UTM\",METHOD[\"Transverse Mercator\"],"
	 "PARAMETER[\"False easting\",500000,LENGTHUNIT[\"foot\",0.3048]]],CS[Cartesian,2],"
	 "AXIS[\"(E)\",east,ORDER[1],LENGTHUNIT[\"metre\",1]],AXIS[\"(N)\",north,ORDER[2],LENGTHUNIT[\"metre\",1]],"
	 "ID[\"EPSG\",32723]]",
	 CRS_PLANE_PROJECTED, "EPSG:32723", "metre", "unknown"},
	{"GEOGCRS[\"WGS 84 3D\",CS[ellipsoidal,3],AXIS[\"lat\",north,ANGLEUNIT[\"degree\",0.0174532925199433]],"
	 "AXIS[\"lon\",east,ANGLEUNIT[\"degree\",0.0174532925199433]],AXIS[\"h\",up,LENGTHUNIT[\"metre\",1]]]",
	 CRS_PLANE_GEOGRAPHIC, "WGS 84 3D", "degree", "metre"},
	{"GEODCRS[\"xyz\",CS[Cartesian,3],AXIS[\"X\",x],AXIS[\"Y\",y],AXIS[\"Z\",z],LENGTHUNIT[\"metre\",1]]",
	 CRS_PLANE_GEOCENTRIC, "xyz", "metre", "metre"},
	{"GEODCRS[\"no kind\",LENGTHUNIT[\"metre\",1]]", CRS_PLANE_UNKNOWN, "no kind", "metre", "unknown"},
	{"BOUNDCRS[SOURCECRS[" UTM10 "],TARGETCRS[GEOGCS[\"WGS 84\",UNIT[\"degree\",0.0174532925199433]]]]", CRS_PLANE_PROJECTED,
	 "EPSG:26910", "metre", "unknown"},
	{"LOCAL_CS[\"site\",UNIT[\"metre\",1]]", CRS_PLANE_UNKNOWN, "site", "metre", "unknown"},
	{"VERT_CS[\"only heights\",UNIT[\"metre\",1]]", CRS_PLANE_UNKNOWN, "only heights", "unknown", "metre"},
	/* contradictions and unknown units are never settled by a guess */
	{"PROJCS[\"p\",UNIT[\"US survey foot\",0.3048]]", CRS_PLANE_PROJECTED, "p", "unknown", "unknown"},
	{"PROJCS[\"p\",UNIT[\"metre\",0.3048]]", CRS_PLANE_PROJECTED, "p", "unknown", "unknown"},
	{"PROJCS[\"p\",UNIT[\"link\",0.201168]]", CRS_PLANE_PROJECTED, "p", "unknown", "unknown"},
	{"PROJCS[\"p\"]", CRS_PLANE_PROJECTED, "p", "unknown", "unknown"},
	{"PROJCS[\"p\",UNIT[\"metre\"]]", CRS_PLANE_PROJECTED, "p", "unknown", "unknown"},
	{"PROJCRS[\"p\",CS[Cartesian,2],AXIS[\"E\",east,LENGTHUNIT[\"metre\",1]],"
	 "AXIS[\"N\",north,LENGTHUNIT[\"foot\",0.3048]]]",
	 CRS_PLANE_PROJECTED, "p", "unknown", "unknown"},
	{"GEOGCS[\"gon\",UNIT[\"grad\",0.015707963267949]]", CRS_PLANE_GEOGRAPHIC, "gon", "unknown", "unknown"},
	{"PROJCS[\"na\xc3\xafve\nname\",UNIT[\"metre\",1]]", CRS_PLANE_PROJECTED, "na??ve?name", "metre", "unknown"},
};

static void wkt_texts(void **state)
{
	for (size_t i = 0; i < sizeof wkt_cases / sizeof *wkt_cases; i++) {
		const struct wkt_case *c = &wkt_cases[i];
		struct crs_info info;

		assert_true(crs_read_wkt(c->wkt, strlen(c->wkt), &info));
		assert_int_equal(info.plane, c->plane);
		assert_string_equal(info.text, c->text);
		assert_string_equal(info.unit_xy, c->unit_xy);
		assert_string_equal(info.unit_z, c->unit_z);
	}
}

static void wkt_not_well_formed(void **state)
{
	static const char *const texts[] = {
		"",
		" ",
		"]",
		"PROJCS",
		"PROJCS[",
		"PROJCS[\"p",
		"PROJCS[\"p\"",
		"PROJCS[\"p\",UNIT[\"metre\",1]",
		"{\"type\":\"ProjectedCRS\"}",
		"FOO[\"x\"]",
		"PROJCS[=]",
		"[[[[",
	};
	struct crs_info info;
	char deep[400];

	for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
		assert_false(crs_read_wkt(texts[i], strlen(texts[i]), &info));
		assert_int_equal(info.plane, CRS_PLANE_UNKNOWN);
		assert_string_equal(info.text, "unknown");
		assert_string_equal(info.unit_xy, "unknown");
	}
	for (size_t i = 0; i < sizeof deep / 2; i++)
		memcpy(deep + 2 * i, "A[", 2);
	assert_false(crs_read_wkt(deep, sizeof deep, &info));
	assert_false(crs_read_wkt(NULL, 0, &info));
	/* a NUL ends the text, as writers pad with them */
	assert_true(crs_read_wkt("PROJCS[\"p\"]\0\0\0", 14, &info));
	assert_false(crs_read_wkt("PROJ\0CS[\"p\"]", 12, &info));
}

struct keys {
	uint16_t words[64];
	double doubles[4];
	const char *ascii;
};

static struct crs_records records_of(const struct keys *k, const char *wkt)
{
	return (struct crs_records){
		.keys = {k->words, 8 + (size_t)k->words[3] * 8},
		.doubles = {k->doubles, sizeof k->doubles},
		.ascii = {k->ascii, k->ascii ? strlen(k->ascii) : 0},
		.wkt = {wkt, wkt ? strlen(wkt) : 0},
	};
}

static const struct {
	struct keys keys;
	enum crs_plane plane;
	const char *text, *unit_xy, *unit_z;
} key_cases[] = {
	{{{1, 1, 0, 4, 1024, 0, 1, 1, 3072, 0, 1, 26917, 3076, 0, 1, 9001, 4099, 0, 1, 9001}},
	 CRS_PLANE_PROJECTED,
	 "EPSG:26917",
	 "metre",
	 "metre"},
	/* the file's own unit goes before the system's */
	{{{1, 1, 0, 3, 1024, 0, 1, 1, 3072, 0, 1, 32128, 3076, 0, 1, 9003}},
	 CRS_PLANE_PROJECTED,
	 "EPSG:32128",
	 "us-survey-foot",
	 "unknown"},
	{{{1, 1, 0, 5, 1024, 0, 1, 1, 3072, 0, 1, 2903, 3076, 0, 1, 9003, 4096, 0, 1, 5103, 4099, 0, 1, 9003}},
	 CRS_PLANE_PROJECTED,
	 "EPSG:2903 + EPSG:5103",
	 "us-survey-foot",
	 "us-survey-foot"},
	/* a number alone: its unit by EPSG's table */
	{{{1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 32617}}, CRS_PLANE_PROJECTED, "EPSG:32617", "metre", "unknown"},
	{{{1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 2903}}, CRS_PLANE_PROJECTED, "EPSG:2903", "us-survey-foot", "unknown"},
	{{{1, 1, 0, 3, 1024, 0, 1, 2, 2048, 0, 1, 4326, 2054, 0, 1, 9102}},
	 CRS_PLANE_GEOGRAPHIC,
	 "EPSG:4326",
	 "degree",
	 "unknown"},
	{{{1, 1, 0, 2, 1024, 0, 1, 2, 2048, 0, 1, 4326}}, CRS_PLANE_GEOGRAPHIC, "EPSG:4326", "degree", "unknown"},
	{{{1, 1, 0, 1, 2048, 0, 1, 4326}}, CRS_PLANE_GEOGRAPHIC, "EPSG:4326", "degree", "unknown"},
	{{{1, 1, 0, 2, 1024, 0, 1, 3, 2052, 0, 1, 9001}}, CRS_PLANE_GEOCENTRIC, "unknown", "metre", "metre"},
	/* user-defined: citation, unit by its size */
	{{{1, 1, 0, 5, 1024, 0, 1, 1, 1026, 34737, 8, 2, 3072, 0, 1, 32767, 3076, 0, 1, 32767, 3077, 34736, 1, 1},
	  {7, 0.3048},
	  "x|My CRS|y|"},
	 CRS_PLANE_PROJECTED,
	 "My CRS|y",
	 "foot",
	 "unknown"},
	{{{1, 1, 0, 3, 1024, 0, 1, 1, 1026, 34737, 7, 2, 3072, 0, 1, 65535}, {0}, "x|My CRS|y|"},
	 CRS_PLANE_PROJECTED,
	 "My CRS",
	 "unknown",
	 "unknown"},
	/* no model, units only */
	{{{1, 1, 0, 2, 3076, 0, 1, 9001, 4099, 0, 1, 9001}}, CRS_PLANE_UNKNOWN, "unknown", "metre", "metre"},
	{{{1, 1, 0, 2, 2048, 0, 1, 32767, 3076, 0, 1, 9001}}, CRS_PLANE_UNKNOWN, "unknown", "metre", "unknown"},
	/* a model that does not exist, entries that point outside */
	{{{1, 1, 0, 2, 1024, 0, 1, 9, 3072, 0, 1, 26917}}, CRS_PLANE_UNKNOWN, "unknown", "unknown", "unknown"},
	{{{1, 1, 0, 4, 1024, 0, 1, 1, 1026, 34737, 9, 500, 3076, 0, 1, 32767, 3077, 34736, 1, 60000}, {0}, "x|"},
	 CRS_PLANE_PROJECTED,
	 "unknown",
	 "unknown",
	 "unknown"},
	{{{2, 1, 0, 1, 1024, 0, 1, 1}}, CRS_PLANE_UNKNOWN, "unknown", "unknown", "unknown"},
};

static void geokeys(void **state)
{
	for (size_t i = 0; i < sizeof key_cases / sizeof *key_cases; i++) {
		struct crs_records r = records_of(&key_cases[i].keys, NULL);
		struct crs_info info;

		crs_read(&r, &info);
		assert_int_equal(info.plane, key_cases[i].plane);
		assert_string_equal(info.text, key_cases[i].text);
		assert_string_equal(info.unit_xy, key_cases[i].unit_xy);
		assert_string_equal(info.unit_z, key_cases[i].unit_z);
	}
}

static void both_kinds(void **state)
{
	static const struct keys projected = {{1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 100}}; /* no table has it */
	static const struct keys units = {{1, 1, 0, 1, 4099, 0, 1, 9001}};
	struct crs_records r = records_of(&projected, UTM10);
	struct crs_info info;

	crs_read(&r, &info); /* keys decide, WKT fills the unit that they leave open */
	assert_string_equal(info.text, "EPSG:100");
	assert_string_equal(info.unit_xy, "metre");
	r.prefer_wkt = true;
	crs_read(&r, &info);
	assert_string_equal(info.text, "EPSG:26910");
	r = records_of(&projected, "GEOGCS[\"g\",UNIT[\"degree\",0.0174532925199433]]");
	crs_read(&r, &info); /* another plane: nothing is filled */
	assert_int_equal(info.plane, CRS_PLANE_PROJECTED);
	assert_string_equal(info.unit_xy, "unknown");
	r = records_of(&units, UTM10);
	crs_read(&r, &info); /* keys without a plane are no answer */
	assert_int_equal(info.plane, CRS_PLANE_PROJECTED);
	assert_string_equal(info.text, "EPSG:26910");
}

static uint64_t rng_state = 0x9e3779b97f4a7c15u;

static uint32_t rng(void)
{
	rng_state = rng_state * 6364136223846793005u + 1442695040888963407u;
	return (uint32_t)(rng_state >> 33);
}

/* Exact-size heap copies, so that the address sanitizer sees one byte too many. */
static void check_sane(const void *bytes, size_t size)
{
	void *copy = malloc(size ? size : 1);
	struct crs_info info;

	memcpy(copy, bytes, size);
	for (int kind = 0; kind < 3; kind++) {
		struct crs_records r = {.prefer_wkt = kind};
		struct crs_bytes b = {copy, size};

		r.keys = b;
		r.doubles = kind == 1 ? b : (struct crs_bytes){0};
		r.ascii = kind ? b : (struct crs_bytes){0};
		r.wkt = b;
		memset(&info, 0xff, sizeof info);
		crs_read(&r, &info);
		assert_true(info.plane <= CRS_PLANE_GEOCENTRIC);
		assert_true(strnlen(info.text, sizeof info.text) < sizeof info.text && info.text[0]);
		assert_true(strnlen(info.unit_xy, sizeof info.unit_xy) < sizeof info.unit_xy);
		assert_true(strnlen(info.unit_z, sizeof info.unit_z) < sizeof info.unit_z);
	}
	free(copy);
}

static void rubbish(void **state)
{
	static const char alphabet[] = "PROJCSGE[](),\"\" 0123456789.eUNITAXIS\n";
	unsigned char bytes[600];

	for (int round = 0; round < 20000; round++) {
		size_t n = rng() % sizeof bytes;
		unsigned how = rng() % 4;

		for (size_t i = 0; i < n; i++)
			bytes[i] = how == 0 ? (unsigned char)rng() :
				   how == 1 ? (unsigned char)alphabet[rng() % (sizeof alphabet - 1)] :
				   how == 2 ? (unsigned char)UTM10[i % sizeof UTM10] :
				   i % 2    ? 0 :
					      (unsigned char)(rng() % 5);
		if (how == 2)
			for (int k = 0; n && k < 4; k++)
				bytes[rng() % n] = (unsigned char)rng();
		if (how == 3 && n >= 8) {
			uint16_t head[4] = {1, 1, 0, (uint16_t)rng()};

			memcpy(bytes, head, 8);
			for (size_t i = 8; i + 8 <= n; i += 8) {
				static const uint16_t ids[] = {1024, 1026, 2048, 2049, 3072, 3073, 3076, 3077, 4096, 4099};
				static const uint16_t tags[] = {0, 34736, 34737, 34735};
				uint16_t e[4] = {ids[rng() % 10], tags[rng() % 4], (uint16_t)rng(), (uint16_t)(rng() % 700)};

				memcpy(bytes + i, e, 8);
			}
		}
		check_sane(bytes, n);
	}
	for (size_t n = 0; n < sizeof UTM10; n++)
		check_sane(UTM10, n);
}

static void halves(void **state)
{
	char plane[CRS_TEXT_SIZE], both[] = "EPSG:25832 + EPSG:7837";

	crs_text_plane(both, plane);
	assert_string_equal(plane, "EPSG:25832");
	assert_string_equal(crs_text_heights(both), " + EPSG:7837");
	crs_text_plane("a+b", plane);
	assert_string_equal(plane, "a+b");
	assert_null(crs_text_heights("a+b"));
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(halves),  cmocka_unit_test(wkt_texts),  cmocka_unit_test(wkt_not_well_formed),
		cmocka_unit_test(geokeys), cmocka_unit_test(both_kinds), cmocka_unit_test(rubbish),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
