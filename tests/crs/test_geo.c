/* Projections, zones, areas and squares against published examples and formulas of the test's own. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "crs_geo.h"
#include "earth.h"
#include "err.h"

#define WGS84_F 298.257223563
#define GRS80_F 298.257222101

static struct crs_info degrees(unsigned epsg, const char *datum, double f)
{
	struct crs_info g = {
		.plane = CRS_PLANE_GEOGRAPHIC,
		.unit_xy = "degree",
		.unit_z = "metre",
		.system =
			{
				.method = CRS_METHOD_GEOGRAPHIC,
				.epsg = epsg,
				.a = 6378137,
				.inverse_flattening = f,
				.unit = 1,
				.unit_z = 1,
			},
	};

	snprintf(g.system.datum, sizeof g.system.datum, "%s", datum);
	if (epsg)
		snprintf(g.text, sizeof g.text, "EPSG:%u", epsg);
	else
		snprintf(g.text, sizeof g.text, "%s", datum);
	return g;
}

#define FT_US (1200.0 / 3937)

/* EPSG guidance note 7-2 (its transverse Mercator by a shorter series), but the Albers: Snyder, Map projections, a working
 * manual, page 292. */
static const struct example {
	const char *what;
	struct crs_system s;
	double lat, lon, x, y, within;
} examples[] = {
	{"Lambert, two parallels",
	 {.method = CRS_METHOD_LAMBERT_CONIC,
	  .a = 6378206.4,
	  .inverse_flattening = 294.9786982,
	  .lat0 = 27.0 + 50 / 60.0,
	  .lon0 = -99,
	  .lat1 = 28 + 23 / 60.0,
	  .lat2 = 30 + 17 / 60.0,
	  .k0 = 1,
	  .x0 = 2000000 * FT_US,
	  .unit = FT_US},
	 28.5,
	 -96,
	 2963503.91,
	 254759.80,
	 0.006},
	{"Lambert, one parallel",
	 {.method = CRS_METHOD_LAMBERT_CONIC,
	  .a = 6378206.4,
	  .inverse_flattening = 294.9786982,
	  .lat0 = 18,
	  .lon0 = -77,
	  .k0 = 1,
	  .x0 = 250000,
	  .y0 = 150000,
	  .unit = 1},
	 17 + 55 / 60.0 + 55.80 / 3600,
	 -(76 + 56 / 60.0 + 37.26 / 3600),
	 255966.58,
	 142493.51,
	 0.006},
	{"transverse Mercator",
	 {.method = CRS_METHOD_TRANSVERSE_MERCATOR,
	  .a = 6377563.396,
	  .inverse_flattening = 299.3249646,
	  .lat0 = 49,
	  .lon0 = -2,
	  .k0 = 0.9996012717,
	  .x0 = 400000,
	  .y0 = -100000,
	  .unit = 1},
	 50.5,
	 0.5,
	 577274.99,
	 69740.50,
	 0.01},
	{"polar stereographic A",
	 {.method = CRS_METHOD_POLAR_STEREOGRAPHIC,
	  .a = 6378137,
	  .inverse_flattening = WGS84_F,
	  .lat0 = 90,
	  .k0 = 0.994,
	  .x0 = 2000000,
	  .y0 = 2000000,
	  .unit = 1},
	 73,
	 44,
	 3320416.75,
	 632668.43,
	 0.006},
	{"polar stereographic B",
	 {.method = CRS_METHOD_POLAR_STEREOGRAPHIC,
	  .a = 6378137,
	  .inverse_flattening = WGS84_F,
	  .lat0 = -90,
	  .lat1 = -71,
	  .lon0 = 70,
	  .k0 = 1,
	  .x0 = 6000000,
	  .y0 = 6000000,
	  .unit = 1},
	 -75,
	 120,
	 7255380.79,
	 7053389.56,
	 0.006},
	{"Albers",
	 {.method = CRS_METHOD_ALBERS,
	  .a = 6378206.4,
	  .inverse_flattening = 294.9786982,
	  .lat0 = 23,
	  .lon0 = -96,
	  .lat1 = 29.5,
	  .lat2 = 45.5,
	  .k0 = 1,
	  .unit = 1},
	 35,
	 -75,
	 1885472.7,
	 1535925.0,
	 0.06},
	{"degrees",
	 {.method = CRS_METHOD_GEOGRAPHIC, .a = 6378137, .inverse_flattening = WGS84_F, .unit = 1},
	 45.5,
	 -93.25,
	 -93.25,
	 45.5,
	 1e-12},
};

static void published_examples(void **state)
{
	for (size_t i = 0; i < sizeof examples / sizeof *examples; i++) {
		const struct example *e = &examples[i];
		struct crs_geo *g;
		struct err err = ERR_INIT;
		double x, y, lat, lon;

		assert_int_equal(crs_geo_new(&e->s, &g, &err), 0);
		assert_int_equal(crs_geo_forward(g, e->lat, e->lon, &x, &y, &err), 0);
		if (fabs(x - e->x) > e->within || fabs(y - e->y) > e->within)
			fail_msg("%s: %.4f %.4f, published %.4f %.4f", e->what, x, y, e->x, e->y);
		assert_int_equal(crs_geo_reverse(g, x, y, &lat, &lon, &err), 0);
		assert_true(fabs(lat - e->lat) < 1e-12 && fabs(lon - e->lon) < 1e-12);
		crs_geo_free(g);
	}
}

static void what_is_not_known(void **state)
{
	struct crs_system s = {.method = CRS_METHOD_UNKNOWN, .unit = 1};
	struct crs_geo *g = NULL;
	struct err err = ERR_INIT;

	assert_int_equal(crs_geo_new(&s, &g, &err), -ERR_UNSUPPORTED);
	assert_non_null(strstr(err.message, "on the earth"));
	err = ERR_INIT;
	s = examples[2].s;
	s.a = 0;
	assert_int_equal(crs_geo_new(&s, &g, &err), -ERR_UNSUPPORTED);
	assert_non_null(strstr(err.message, "ellipsoid"));
	err = ERR_INIT;
	s = examples[2].s;
	s.unit = 0;
	assert_int_equal(crs_geo_new(&s, &g, &err), -ERR_UNSUPPORTED);
	assert_non_null(strstr(err.message, "unit"));
	/* What the library throws. */
	err = ERR_INIT;
	s = examples[0].s;
	s.lat1 = 95;
	assert_int_not_equal(crs_geo_new(&s, &g, &err), 0);
	assert_non_null(strstr(err.message, "atitude"));
	assert_null(g);
}

static void outside_of_the_earth(void **state)
{
	struct crs_geo *g;
	struct err err = ERR_INIT;
	double a, b;

	assert_int_equal(crs_geo_new(&examples[2].s, &g, &err), 0);
	assert_int_equal(crs_geo_forward(g, 91, 0, &a, &b, &err), -ERR_INPUT);
	err = ERR_INIT;
	assert_int_equal(crs_geo_forward(g, NAN, 0, &a, &b, &err), -ERR_INPUT);
	err = ERR_INIT;
	assert_int_equal(crs_geo_forward(g, 10, 60, &a, &b, &err), -ERR_INPUT);
	err = ERR_INIT;
	assert_int_equal(crs_geo_reverse(g, 4e7, 1e6, &a, &b, &err), -ERR_INPUT);
	err = ERR_INIT;
	assert_int_equal(crs_geo_reverse(g, 5e5, 4e7, &a, &b, &err), -ERR_INPUT);
	err = ERR_INIT;
	assert_int_equal(crs_geo_reverse(g, INFINITY, 0, &a, &b, &err), -ERR_INPUT);
	crs_geo_free(g);
	/* The far pole of a conic. */
	assert_int_equal(crs_geo_new(&examples[0].s, &g, &err), 0);
	err = ERR_INIT;
	assert_int_equal(crs_geo_forward(g, -90, 0, &a, &b, &err), -ERR_INPUT);
	crs_geo_free(g);
}

static void zones_against_formulas(void **state)
{
	const struct crs_info wgs = degrees(4326, "WGS 84", WGS84_F), etrs = degrees(4258, "ETRS89", GRS80_F);
	double worst = 0;

	srand(1);
	for (int i = 0; i < 20000; i++) {
		const bool grs = i & 1;
		struct crs_zone z = {.number = i % 61, .north = i % 2 == 0};
		double dlon = (rand() / (double)RAND_MAX - 0.5) * 30, lat = (rand() / (double)RAND_MAX - 0.5) * 180, x, y, e[2];
		double lon = z.number ? 6 * z.number - 183 + dlon : dlon * 12;
		struct crs_info to;
		struct crs_geo *g;
		struct err err = ERR_INIT;

		if (!z.number)
			lat = (z.north ? 1 : -1) * (60 + fabs(lat) / 3);
		assert_int_equal(crs_zone_system(grs ? &etrs : &wgs, z, &to, &err), 0);
		assert_int_equal(crs_geo_new(&to.system, &g, &err), 0);
		lon = lon < -180 ? lon + 360 : lon;
		assert_int_equal(crs_geo_forward(g, lat, lon, &x, &y, &err), 0);
		if (z.number)
			earth_utm(grs ? GRS80_F : WGS84_F, z.number, z.north, lat, lon, e);
		else
			earth_ups(grs ? GRS80_F : WGS84_F, z.north, lat, lon, e);
		worst = fmax(worst, fmax(fabs(x - e[0]), fabs(y - e[1])));
		crs_geo_free(g);
	}
	print_message("GeographicLib against formulas: at most %.2g m\n", worst);
	assert_true(worst < 2e-8);
}

static void zones_of_places(void **state)
{
	static const struct {
		double lat, lon;
		const char *zone;
	} row[] = {
		{0, 0, "31N"},
		{-1e-9, 0, "31S"},
		{45, -180, "1N"},
		{45, 180, "1N"},
		{45, 179.9999, "60N"},
		{45, 359.5, "30N"},
		{47, 6, "32N"},
		{47, 5.999999, "31N"},
		/* Norway */
		{60, 3, "32N"},
		{60, 2.9999, "31N"},
		{64, 3, "31N"},
		{55.999, 3, "31N"},
		/* Svalbard */
		{72, 8.99, "31X"},
		{72, 9, "33N"},
		{75, 20.9, "33N"},
		{75, 21, "35N"},
		{75, 33, "37N"},
		{71.99, 9, "32N"},
		/* the poles */
		{84, 10, "UPS-N"},
		{83.9999, 10, "33N"},
		{90, 0, "UPS-N"},
		{-80, 10, "32S"},
		{-80.0001, 10, "UPS-S"},
		{-90, 77, "UPS-S"},
	};
	struct crs_zone z, back;
	struct err err = ERR_INIT;
	char text[8];

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		assert_int_equal(crs_zone_of(row[i].lat, row[i].lon, &z, &err), 0);
		crs_zone_text(z, text);
		if (strncmp(text, row[i].zone, 2) || (row[i].zone[2] != 'X' && strcmp(text, row[i].zone)))
			fail_msg("%g %g: %s, not %s", row[i].lat, row[i].lon, text, row[i].zone);
		assert_true(crs_zone_parse(text, &back));
		assert_true(back.number == z.number && back.north == z.north);
	}
	assert_int_equal(crs_zone_of(90.1, 0, &z, &err), -ERR_INPUT);
	assert_true(crs_zone_parse("32n", &z) && z.number == 32 && z.north);
	assert_true(crs_zone_parse("0S", &z) && z.number == 0 && !z.north);
	assert_true(crs_zone_parse("ups-n", &z) && z.number == 0 && z.north);
	assert_false(crs_zone_parse("61N", &z) || crs_zone_parse("N", &z) || crs_zone_parse("32", &z) ||
		     crs_zone_parse("32NN", &z) || crs_zone_parse("", &z) || crs_zone_parse("ups", &z) ||
		     crs_zone_parse("-1N", &z) || crs_zone_parse("320N", &z));
}

static void names_of_zones(void **state)
{
	static const struct {
		unsigned epsg;
		const char *datum;
		double f;
		const char *zone, *text;
	} row[] = {
		{4326, "WGS 84", WGS84_F, "32N", "EPSG:32632"},
		{4326, "", WGS84_F, "60S", "EPSG:32760"},
		{4326, "WGS 84", WGS84_F, "UPS-N", "EPSG:5041"},
		{4326, "WGS 84", WGS84_F, "0S", "EPSG:5042"},
		{0, "WGS 84", WGS84_F, "1N", "EPSG:32601"},
		{4258, "ETRS89", GRS80_F, "32N", "EPSG:25832"},
		{4258, "ETRS89", GRS80_F, "27N", "ETRS89 / UTM zone 27N"},
		{4258, "ETRS89", GRS80_F, "0N", "ETRS89 / UPS North"},
		{4269, "NAD83", GRS80_F, "10N", "EPSG:26910"},
		{6318, "NAD83(2011)", GRS80_F, "10N", "EPSG:6339"},
		{4283, "GDA94", GRS80_F, "55S", "EPSG:28355"},
		{4674, "SIRGAS 2000", GRS80_F, "23S", "EPSG:31983"},
		{0, "Moon 2000", GRS80_F, "3N", "Moon 2000 / UTM zone 3N"},
	};

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		struct crs_info g = degrees(row[i].epsg, row[i].datum, row[i].f), to;
		struct crs_zone z, back;
		struct err err = ERR_INIT;

		assert_true(crs_zone_parse(row[i].zone, &z));
		assert_int_equal(crs_zone_system(&g, z, &to, &err), 0);
		assert_string_equal(to.text, row[i].text);
		assert_string_equal(to.unit_xy, "metre");
		assert_int_equal(to.plane, CRS_PLANE_PROJECTED);
		assert_true(crs_zone_of_text(&g, to.text, &back));
		assert_true(back.number == z.number && back.north == z.north);
		assert_false(crs_zone_of_text(&g, "EPSG:2154", &back));
	}
}

static void datums_refused(void **state)
{
	struct crs_info g = degrees(4267, "NAD27", 294.9786982), to;
	const struct crs_zone z = {.number = 10, .north = true};
	struct err err = ERR_INIT;

	g.system.a = 6378206.4;
	assert_int_equal(crs_zone_system(&g, z, &to, &err), -ERR_UNSUPPORTED);
	assert_non_null(strstr(err.message, "NAD27"));
	assert_non_null(strstr(err.hint, "--planar"));
	err = ERR_INIT;
	g = degrees(0, "", WGS84_F);
	g.system.a = 0;
	assert_int_equal(crs_zone_system(&g, z, &to, &err), -ERR_UNSUPPORTED);
	assert_non_null(strstr(err.message, "datum"));
	assert_non_null(strstr(err.hint, "--override-crs"));
	err = ERR_INIT;
	snprintf(g.text, sizeof g.text, "unknown");
	assert_int_equal(crs_zone_system(&g, z, &to, &err), -ERR_UNSUPPORTED);
	assert_non_null(strstr(err.hint, "--assume-crs"));
	err = ERR_INIT;
	g = degrees(32610, "WGS 84", WGS84_F);
	g.plane = CRS_PLANE_PROJECTED;
	assert_int_equal(crs_zone_system(&g, z, &to, &err), -ERR_UNSUPPORTED);
}

static void choose(const double (*box)[4], size_t n, const char *want)
{
	struct lattice_input in[8] = {0};
	struct crs_zone z;
	struct err err = ERR_INIT;
	char text[8];

	for (int turn = 0; turn < 2; turn++) {
		for (size_t i = 0; i < n; i++) {
			const double *b = box[turn ? n - 1 - i : i];

			in[i].name = "a.las";
			in[i].min[0] = b[0];
			in[i].min[1] = b[1];
			in[i].max[0] = b[2];
			in[i].max[1] = b[3];
		}
		if (!want) {
			assert_int_equal(crs_zone_choose(in, n, &z, &err), -ERR_INPUT);
			continue;
		}
		assert_int_equal(crs_zone_choose(in, n, &z, &err), 0);
		assert_string_equal(crs_zone_text(z, text), want);
	}
}

static void zone_of_boxes(void **state)
{
	choose((const double[][4]){{-93.2, 41, -93.1, 42}}, 1, "15N");
	choose((const double[][4]){{-93.2, 41, -93.1, 42}, {-99, 41, -98, 42}}, 2, "14N");
	/* Across 180 degrees, written in every way. */
	choose((const double[][4]){{179, -17, 179.9, -16}, {-179.9, -17, -177, -16}}, 2, "1S");
	choose((const double[][4]){{178, -17, 183, -16}}, 1, "1S");
	choose((const double[][4]){{177, -17, 179, -16}, {181, -17, 181.5, -16}}, 2, "60S");
	choose((const double[][4]){{359, 51, 359.9, 52}, {0.1, 51, 0.5, 52}}, 2, "30N");
	choose((const double[][4]){{-180, 85, 180, 90}}, 1, "UPS-N");
	/* Boxes that say nothing, and none that does. */
	choose((const double[][4]){{NAN, 0, 0, 0}, {7, 47, 8, 48}, {5, 5, 4, 4}}, 3, "32N");
	choose((const double[][4]){{5, 5, 4, 4}}, 1, NULL);
	/* No degrees, and swapped ones. */
	choose((const double[][4]){{500000, 4e6, 500100, 4.1e6}}, 1, NULL);
	choose((const double[][4]){{41, -93, 42, -92}}, 1, NULL);
}

/* A square of one degree at the equator: Geodesic area by GeographicLib's own documentation is not given, so the
 * ellipsoid's zone area is used: between parallels, R_q^2 dlon (q2 - q1) with the authalic function q. */
static void areas(void **state)
{
	const long double f = 1 / (long double)WGS84_F, e2 = f * (2 - f), e = sqrtl(e2), rad = acosl(-1) / 180;
	const struct crs_info wgs = degrees(4326, "WGS 84", WGS84_F);
	double box[4 * 64][2], area, perimeter;
	struct crs_geo *g;
	struct err err = ERR_INIT;
	size_t n = 0;

	for (int side = 0; side < 4; side++)
		for (int k = 0; k < 64; k++, n++) {
			double t = k / 64.0;

			box[n][0] = side == 0 ? t : side == 1 ? 1 : side == 2 ? 1 - t : 0;
			box[n][1] = 40 + (side == 0 ? 0 : side == 1 ? t : side == 2 ? 1 : 1 - t);
		}
	long double s1 = sinl(40 * rad), s2 = sinl(41 * rad), b2 = 6378137.0L * 6378137.0L * (1 - e2);
	long double q2 = s2 / (1 - e2 * s2 * s2) + atanhl(e * s2) / e, q1 = s1 / (1 - e2 * s1 * s1) + atanhl(e * s1) / e;
	double want = (double)(b2 / 2 * rad * (q2 - q1));

	assert_int_equal(crs_geo_new(&wgs.system, &g, &err), 0);
	assert_int_equal(crs_geo_area(g, (const double(*)[2])box, n, &area, &perimeter, &err), 0);
	assert_true(fabs(area / want - 1) < 1e-7);
	assert_true(fabs(perimeter - 2 * 111042.0 - 85394.0 - 84137.0) < 500);
	for (size_t i = 0; i < n / 2; i++)
		for (int k = 0; k < 2; k++) {
			double t = box[i][k];

			box[i][k] = box[n - 1 - i][k];
			box[n - 1 - i][k] = t;
		}
	double other;

	assert_int_equal(crs_geo_area(g, (const double(*)[2])box, n, &other, &perimeter, &err), 0);
	assert_true(fabs(other - area) < 1);
	crs_geo_free(g);
}

static void squares(void **state)
{
	struct err err = ERR_INIT;
	char text[32];

	/* The examples of GeographicLib's GeoConvert manual. */
	assert_int_equal(crs_geo_mgrs(33.33424, 44.40363, 2, text, sizeof text, &err), 0);
	assert_string_equal(text, "38SMB4488");
	assert_int_equal(crs_geo_mgrs(33.3, 44.4, 5, text, sizeof text, &err), 0);
	assert_string_equal(text, "38SMB4414084706");
	assert_int_equal(crs_geo_mgrs(90, 0, 1, text, sizeof text, &err), 0);
	assert_string_equal(text, "ZAH00");
	assert_int_equal(crs_geo_mgrs(33.3, 44.4, 6, text, sizeof text, &err), -ERR_USAGE);
	err = ERR_INIT;
	assert_int_equal(crs_geo_mgrs(100, 44.4, 2, text, sizeof text, &err), -ERR_INPUT);
	err = ERR_INIT;
	assert_int_equal(crs_geo_mgrs(33.3, 44.4, 5, text, 8, &err), -ERR_INTERNAL);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(published_examples),
		cmocka_unit_test(what_is_not_known),
		cmocka_unit_test(outside_of_the_earth),
		cmocka_unit_test(zones_against_formulas),
		cmocka_unit_test(zones_of_places),
		cmocka_unit_test(names_of_zones),
		cmocka_unit_test(datums_refused),
		cmocka_unit_test(zone_of_boxes),
		cmocka_unit_test(areas),
		cmocka_unit_test(squares),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
