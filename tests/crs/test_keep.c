/* The WKT that is kept with a dataset: its normal form, and which part of it holds for a system. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "crs.h"

#define GEO(name, code)                                                                                       \
	"GEOGCS[\"" name "\",DATUM[\"d\",SPHEROID[\"GRS 1980\",6378137,298.257222101]],PRIMEM[\"Greenwich\"," \
	"0],UNIT[\"degree\",0.0174532925199433]" code "]"
#define PLANE                                                                                                                          \
	"PROJCS[\"RGF93 / Lambert-93\"," GEO(                                                                                          \
		"RGF93",                                                                                                               \
		"") ",PROJECTION[\"Lambert_Conformal_Conic_2SP\"],PARAMETER["                                                          \
		    "\"latitude_of_origin\",46.5],PARAMETER[\"central_meridian\",3],PARAMETER[\"standard_parallel_1\",49],"            \
		    "PARAMETER[\"standard_parallel_2\",44],PARAMETER[\"false_easting\",700000],PARAMETER[\"false_northing\",6600000]," \
		    "UNIT[\"metre\",1],AUTHORITY[\"EPSG\",\"2154\"]]"
#define HEIGHT "VERT_CS[\"NGF-IGN69 height\",VERT_DATUM[\"NGF\",2005],UNIT[\"metre\",1],AUTHORITY[\"EPSG\",\"5720\"]]"
#define BOTH "COMPD_CS[\"both\"," PLANE "," HEIGHT "]"
#define SITE "LOCAL_CS[\"quarry\",UNIT[\"metre\",1]]"
/* a projected system with heights of its own */
#define THREE                                                                                                               \
	"PROJCRS[\"three\",BASEGEOGCRS[\"b\",DATUM[\"d\",ELLIPSOID[\"GRS 1980\",6378137,298.257222101]]],CONVERSION[\"c\"," \
	"METHOD[\"none\"]],CS[Cartesian,3],AXIS[\"e\",east,LENGTHUNIT[\"metre\",1]],AXIS[\"n\",north,LENGTHUNIT[\"metre\"," \
	"1]],AXIS[\"h\",up,LENGTHUNIT[\"metre\",1]],ID[\"EPSG\",9999]]"

static void normal(void **state)
{
	static const struct {
		const char *text, *want;
	} rows[] = {
		{SITE, SITE},
		{" LOCAL_CS [ \"the  quarry\" ,\r\n\tUNIT[\"metre\", 1 ] ]\n\n", "LOCAL_CS[\"the  quarry\",UNIT[\"metre\",1]]"},
		{"LOCAL_CS[\"a\nb\tc\x7f\",UNIT[\"metre\",1]]", "LOCAL_CS[\"a b c \",UNIT[\"metre\",1]]"},
		{"LOCAL_CS[\"\xc3\xa9\xff\xc2\x85\",UNIT[\"metre\",1]]", "LOCAL_CS[\"\xc3\xa9???\",UNIT[\"metre\",1]]"},
		{"LOCAL_CS[\"a \"\" b\",UNIT[\"metre\",1]]", "LOCAL_CS[\"a \"\" b\",UNIT[\"metre\",1]]"},
		{SITE " and more", SITE},
		{"x  LOCAL_CS[\"a\" , 1 2,UNIT[\"metre\",1]]", "x LOCAL_CS[\"a\",1 2,UNIT[\"metre\",1]]"},
		{BOTH, BOTH},
		{"", ""},
		{"LOCAL_CS[\"quarry\"", ""},
		{"EPSG:2154", ""},
		{"UNIT[\"metre\",1]", ""},
	};
	char *got = malloc(CRS_WKT_MAX + 1);

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		/* with the zeros of a record behind it */
		size_t size = strlen(rows[i].text) + 3, n;
		char *text = calloc(1, size);

		memcpy(text, rows[i].text, strlen(rows[i].text));
		*got = 0;
		n = crs_wkt_normal(text, size, got);
		assert_int_equal(n, strlen(rows[i].want));
		assert_string_equal(n ? got : "", rows[i].want);
		if (n) {
			char *again = malloc(CRS_WKT_MAX + 1);

			assert_int_equal(crs_wkt_normal(got, n, again), n);
			assert_string_equal(again, got);
			free(again);
		}
		/* in its own place */
		text = realloc(text, CRS_WKT_MAX + 1);
		assert_int_equal(crs_wkt_normal(text, size, text), n);
		assert_true(!n || !strcmp(text, rows[i].want));
		free(text);
	}
	free(got);
}

/* One byte more than fits is not kept; blanks do not count. */
static void bounded(void **state)
{
	char *text = malloc(2 * CRS_WKT_MAX + 1), *got = malloc(CRS_WKT_MAX + 1);
	size_t most = 0;

	for (size_t n = CRS_WKT_MAX - 64; n < CRS_WKT_MAX + 8; n++) {
		int size = snprintf(text, 2 * CRS_WKT_MAX + 1, "LOCAL_CS[ \"%0*d\" , UNIT[\"metre\",1]]%*s", (int)n, 0, 1000, "");
		size_t kept = crs_wkt_normal(text, (size_t)size, got);

		if (kept)
			most = kept;
		assert_true(kept <= CRS_WKT_MAX);
		assert_true(kept || most);
	}
	assert_int_equal(most, CRS_WKT_MAX);
	free(text);
	free(got);
}

static void holds(void **state)
{
	static const struct {
		const char *wkt, *crs, *xy, *z, *want;
	} rows[] = {
		{BOTH, "EPSG:2154 + EPSG:5720", "metre", "metre", BOTH},
		{PLANE, "EPSG:2154", "metre", "unknown", PLANE},
		{PLANE, "EPSG:2154", "metre", "metre", PLANE},
		/* heights that another record or a person says */
		{PLANE, "EPSG:2154 + EPSG:5720", "metre", "metre", PLANE},
		/* heights that a geoid made, or an override */
		{BOTH, "EPSG:2154 + orthometric height (egm96)", "metre", "metre", PLANE},
		{BOTH, "EPSG:2154 + EPSG:5720", "metre", "foot", PLANE},
		{BOTH, "EPSG:2154", "metre", "metre", PLANE},
		/* another plane, or another unit of it */
		{BOTH, "EPSG:32631 + EPSG:5720", "metre", "metre", ""},
		{PLANE, "EPSG:2154", "foot", "metre", ""},
		{PLANE, "unknown", "unknown", "unknown", ""},
		{GEO("WGS 84", ",AUTHORITY[\"EPSG\",\"4326\"]"), "EPSG:32631", "metre", "metre", ""},
		{GEO("WGS 84", ",AUTHORITY[\"EPSG\",\"4326\"]"), "EPSG:4326", "degree", "unknown",
		 GEO("WGS 84", ",AUTHORITY[\"EPSG\",\"4326\"]")},
		{SITE, "quarry", "metre", "unknown", SITE},
		{SITE, "another", "metre", "unknown", ""},
		{HEIGHT, "EPSG:5720", "unknown", "metre", ""},
		{THREE, "EPSG:9999", "metre", "metre", THREE},
		{THREE, "EPSG:9999 + orthometric height (egm96)", "metre", "metre", ""},
		{THREE, "EPSG:9999", "metre", "foot", ""},
		{"nonsense", "EPSG:2154", "metre", "metre", ""},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct crs_bytes got = crs_wkt_holds(rows[i].wkt, rows[i].crs, rows[i].xy, rows[i].z);

		if (got.size != strlen(rows[i].want) || memcmp(got.at, rows[i].want, got.size))
			fail_msg("row %zu: %.*s", i, (int)got.size, (const char *)got.at);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(normal),
		cmocka_unit_test(bounded),
		cmocka_unit_test(holds),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
