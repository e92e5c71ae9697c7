/*
 * Whole systems out of the records: method, parameters, ellipsoid, datum and number, as writers of the old and the
 * new WKT and of GeoTIFF keys put them; and the same texts damaged at random.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "crs.h"
#include "crs_geo.h"
#include "err.h"

#define DEGREE "UNIT[\"degree\",0.0174532925199433]"
#define GREENWICH "PRIMEM[\"Greenwich\",0]"
#define WGS84 "GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]]," GREENWICH "," DEGREE "]"
#define NAD83                                                                                                           \
	"GEOGCS[\"NAD83\",DATUM[\"North_American_Datum_1983\",SPHEROID[\"GRS 1980\",6378137,298.257222101]]," GREENWICH \
	"," DEGREE "]"
#define ESRI83                                                                                                \
	"GEOGCS[\"GCS_North_American_1983\",DATUM[\"D_North_American_1983\",SPHEROID[\"GRS_1980\",6378137.0," \
	"298.257222101]],PRIMEM[\"Greenwich\",0.0],UNIT[\"Degree\",0.0174532925199433]]"
#define RGF93                                                                                             \
	"GEOGCS[\"RGF93 v1\",DATUM[\"Reseau_Geodesique_Francais_1993_v1\",SPHEROID[\"GRS 1980\",6378137," \
	"298.257222101]]," GREENWICH "," DEGREE "]"
#define P(name, value) "PARAMETER[\"" name "\"," value "]"
#define TM1(lon, fe, fn)                                                                                          \
	"PROJECTION[\"Transverse_Mercator\"]," P("latitude_of_origin", "0") "," P("central_meridian", lon) "," P( \
		"scale_factor", "0.9996") "," P("false_easting", fe) "," P("false_northing", fn)
#define METRE "UNIT[\"metre\",1]"
#define FTUS "UNIT[\"US survey foot\",0.304800609601219]"
#define LCC93                                                                                                                \
	"PROJECTION[\"Lambert_Conformal_Conic_2SP\"]," P("latitude_of_origin", "46.5") "," P("central_meridian", "3") "," P( \
		"standard_parallel_1", "49") "," P("standard_parallel_2",                                                    \
						   "44") "," P("false_easting", "700000") "," P("false_northing", "6600000")

/* The new kind. */
#define D2 "ANGLEUNIT[\"degree\",0.0174532925199433]"
#define M2 "LENGTHUNIT[\"metre\",1]"
#define P2(name, value, unit) "PARAMETER[\"" name "\"," value "," unit "]"
#define BASE84                                                                                                                   \
	"BASEGEOGCRS[\"WGS 84\",ENSEMBLE[\"World Geodetic System 1984 ensemble\",MEMBER[\"World Geodetic System 1984 "           \
	"(Transit)\"],ELLIPSOID[\"WGS 84\",6378137,298.257223563," M2 "],ENSEMBLEACCURACY[2.0]],PRIMEM[\"Greenwich\",0," D2 "]," \
	"ID[\"EPSG\",4326]]"
#define UTM2(lon, fn)                                                                                                          \
	"CONVERSION[\"UTM\",METHOD[\"Transverse Mercator\",ID[\"EPSG\",9807]]," P2(                                            \
		"Latitude of natural origin", "0",                                                                             \
		D2) "," P2("Longitude of natural origin", lon,                                                                 \
			   D2) "," P2("Scale factor at natural origin", "0.9996",                                              \
				      "SCALEUNIT[\"unity\",1]") "," P2("False easting", "500000", M2) "," P2("False northing", \
													     fn, M2) "]"
#define CS2 "CS[Cartesian,2],AXIS[\"(E)\",east,ORDER[1]," M2 "],AXIS[\"(N)\",north,ORDER[2]," M2 "]"
#define NORTH_FIRST "CS[Cartesian,2],AXIS[\"northing (N)\",north],AXIS[\"easting (E)\",east]," M2
#define FTUS2 "LENGTHUNIT[\"US survey foot\",0.304800609601219]"

enum {
	NONE = CRS_METHOD_UNKNOWN,
	GEO = CRS_METHOD_GEOGRAPHIC,
	TM = CRS_METHOD_TRANSVERSE_MERCATOR,
	LCC = CRS_METHOD_LAMBERT_CONIC,
	ALBERS = CRS_METHOD_ALBERS,
	POLAR = CRS_METHOD_POLAR_STEREOGRAPHIC
};
enum { UNKNOWN = CRS_PLANE_UNKNOWN, PROJ = CRS_PLANE_PROJECTED, GEOG = CRS_PLANE_GEOGRAPHIC, GEOC = CRS_PLANE_GEOCENTRIC };

#define GRS80 6378137, 298.257222101
#define WGS 6378137, 298.257223563

struct want {
	int plane;
	const char *text, *unit_xy, *unit_z;
	int method;
	unsigned epsg, epsg_z;
	const char *datum;
	double a, f, lat0, lon0, lat1, lat2, k0, x0, y0;
};

static const struct {
	const char *wkt;
	struct want want;
} texts[] = {
	/* numbers that are not written are found by their parameters */
	{"PROJCS[\"WGS 84 / UTM zone 33N\"," WGS84 "," TM1("15", "500000", "0") "," METRE "]",
	 {PROJ, "EPSG:32633", "metre", "unknown", TM, 32633, 0, "WGS 84", WGS, 0, 15, 0, 0, .9996, 500000, 0}},
	{"PROJCS[\"NAD_1983_UTM_Zone_10N\"," ESRI83
	 ",PROJECTION[\"Transverse_Mercator\"]," P("False_Easting", "500000.0") "," P("False_Northing", "0.0") "," P(
		 "Central_Meridian", "-123.0") "," P("Scale_Factor", "0.9996") "," P("Latitude_Of_Origin",
										     "0.0") ",UNIT[\"Meter\",1.0]]",
	 {PROJ, "EPSG:26910", "metre", "unknown", TM, 26910, 0, "NAD83", GRS80, 0, -123, 0, 0, .9996, 500000, 0}},
	{"PROJCS[\"RGF93 / Lambert-93\"," RGF93 "," LCC93 "," METRE ",AUTHORITY[\"EPSG\",\"2154\"]]",
	 {PROJ, "EPSG:2154", "metre", "unknown", LCC, 2154, 0, "RGF93", GRS80, 46.5, 3, 49, 44, 1, 700000, 6600000}},
	/* the parallels in the other order are the same cone */
	{"PROJCS[\"RGF93_Lambert_93\"," RGF93
	 ",PROJECTION[\"Lambert_Conformal_Conic\"]," P("False_Easting", "700000") "," P("False_Northing", "6600000") "," P(
		 "Central_Meridian", "3") "," P("Standard_Parallel_1", "44") "," P("Standard_Parallel_2",
										   "49") "," P("Latitude_Of_Origin",
											       "46.5") "," METRE "]",
	 {PROJ, "EPSG:2154", "metre", "unknown", LCC, 2154, 0, "RGF93", GRS80, 46.5, 3, 44, 49, 1, 700000, 6600000}},
	/* false origins in the unit of the system, kept in metres; ESRI's heights behind a comma */
	{"PROJCS[\"state plane\"," ESRI83
	 ",PROJECTION[\"Lambert_Conformal_Conic\"]," P("False_Easting", "1968500.0") "," P("False_Northing", "0.0") "," P("Central_Meridian", "-77.75") "," P(
		 "Standard_Parallel_1",
		 "40.88333333333333") "," P("Standard_Parallel_2",
					    "41.95") "," P("Latitude_Of_Origin",
							   "40.16666666666666") ",UNIT[\"Foot_US\",0.3048006096012192]],VERTCS[\"NAVD88_height_ftUS\",VDATUM[\"North_American_Vertical_Datum_1988\"]," P("Vertical_Shift",
																									 "0.0") "," P("Direction",
																										      "1.0") ",UNIT[\"Foot_US\",0.3048006096012192]]",
	 {PROJ, "state plane + NAVD88_height_ftUS", "us-survey-foot", "us-survey-foot", LCC, 0, 0, "NAD83", GRS80,
	  40.16666666666666, -77.75, 40.88333333333333, 41.95, 1, 600000, 0}},
	{"PROJCS[\"one parallel\"," WGS84
	 ",PROJECTION[\"Lambert_Conformal_Conic_1SP\"]," P("latitude_of_origin", "46.8") "," P("central_meridian", "2") "," P(
		 "scale_factor", "0.99987742") "," P("false_easting", "600000") "," P("false_northing", "2200000") "," METRE "]",
	 {PROJ, "one parallel", "metre", "unknown", LCC, 0, 0, "WGS 84", WGS, 46.8, 2, 46.8, 46.8, .99987742, 600000, 2200000}},
	{"PROJCS[\"NAD83 / Conus Albers\"," NAD83
	 ",PROJECTION[\"Albers_Conic_Equal_Area\"]," P("latitude_of_center", "23") "," P("longitude_of_center", "-96") "," P(
		 "standard_parallel_1",
		 "29.5") "," P("standard_parallel_2",
			       "45.5") "," P("false_easting", "0") "," P("false_northing", "0") "," METRE
												",AUTHORITY[\"EPSG\",\"5070\"]]",
	 {PROJ, "EPSG:5070", "metre", "unknown", ALBERS, 5070, 0, "NAD83", GRS80, 23, -96, 29.5, 45.5, 1, 0, 0}},
	{"PROJCS[\"Antarctic\"," WGS84
	 ",PROJECTION[\"Polar_Stereographic\"]," P("latitude_of_origin", "-71") "," P("central_meridian", "0") "," P(
		 "scale_factor", "1") "," P("false_easting", "0") "," P("false_northing", "0") "," METRE "]",
	 {PROJ, "EPSG:3031", "metre", "unknown", POLAR, 3031, 0, "WGS 84", WGS, -90, 0, -71, 0, 1, 0, 0}},
	{"PROJCS[\"UPS\"," WGS84
	 ",PROJECTION[\"Polar_Stereographic\"]," P("latitude_of_origin", "90") "," P("central_meridian", "0") "," P(
		 "scale_factor", "0.994") "," P("false_easting", "2000000") "," P("false_northing", "2000000") "," METRE "]",
	 {PROJ, "EPSG:5041", "metre", "unknown", POLAR, 5041, 0, "WGS 84", WGS, 90, 0, 90, 0, .994, 2e6, 2e6}},
	{"PROJCS[\"ESRI pole\"," WGS84 ",PROJECTION[\"Stereographic_North_Pole\"]," P("False_Easting", "0") "," P(
		 "False_Northing", "0") "," P("Central_Meridian", "-45") "," P("Standard_Parallel_1", "70") "," METRE "]",
	 {PROJ, "EPSG:3413", "metre", "unknown", POLAR, 3413, 0, "WGS 84", WGS, 90, -45, 70, 0, 1, 0, 0}},
	{"COMPD_CS[\"NAD83 / Oregon LCC (m) + NAVD88 height (ftUS)\",PROJCS[\"NAD83 / Oregon LCC (m)\"," NAD83
	 ",PROJECTION[\"Lambert_Conformal_Conic_2SP\"]," P("latitude_of_origin", "41.75") "," P("central_meridian", "-120.5") "," P(
		 "standard_parallel_1",
		 "43") "," P("standard_parallel_2",
			     "45.5") "," P("false_easting",
					   "400000") "," P("false_northing",
							   "0") "," METRE
								",AUTHORITY[\"EPSG\",\"2991\"]],VERT_CS[\"NAVD88 height (ftUS)\",VERT_DATUM[\"d\",2005]," FTUS
								",AUTHORITY[\"EPSG\",\"6360\"]]]",
	 {PROJ, "EPSG:2991 + EPSG:6360", "metre", "us-survey-foot", LCC, 2991, 6360, "NAD83", GRS80, 41.75, -120.5, 43, 45.5, 1,
	  400000, 0}},
	{WGS84, {GEOG, "WGS 84", "degree", "unknown", GEO, 0, 0, "WGS 84", WGS}},
	/* not read as something near: another ellipsoid under a known name, another meridian, gon, unknown methods */
	{"PROJCS[\"p\",GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"Clarke 1866\",6378206.4,294.9786982]]," GREENWICH
	 "," DEGREE "]," TM1("15", "500000", "0") "," METRE "]",
	 {PROJ, "p", "metre", "unknown", NONE, 0, 0, "WGS 84"}},
	{"PROJCS[\"p\",GEOGCS[\"g\",DATUM[\"d\",SPHEROID[\"i\",6378249.2,293.46602]],PRIMEM[\"Paris\",2.33722917]," DEGREE
	 "]," TM1("15", "500000", "0") "," METRE "]",
	 {PROJ, "p", "metre", "unknown", NONE, 0, 0, "d", 6378249.2, 293.46602}},
	{"PROJCS[\"p\",GEOGCS[\"g\",DATUM[\"d\",SPHEROID[\"i\",6378249.2,293.46602]]," GREENWICH
	 ",UNIT[\"grad\",0.01570796326794897]]," TM1("15", "500000", "0") "," METRE "]",
	 {PROJ, "p", "metre", "unknown", NONE, 0, 0, "d", 6378249.2, 293.46602}},
	{"PROJCS[\"Belge 1972 / Belgian Lambert 72\",GEOGCS[\"Belge 1972\",DATUM[\"Reseau_National_Belge_1972\","
	 "SPHEROID[\"International 1924\",6378388,297]]," GREENWICH "," DEGREE
	 "],PROJECTION[\"Lambert_Conformal_Conic_2SP_Belgium\"]," P("standard_parallel_1", "51.16666723333333") "," P(
		 "standard_parallel_2",
		 "49.8333339") "," P("latitude_of_origin",
				     "90") "," P("central_meridian",
						 "4.367486666666666") "," P("false_easting",
									    "150000.013") "," P("false_northing",
												"5400088.438") "," METRE
													       ",AUTHORITY[\"EPSG\",\"31370\"]]",
	 {PROJ, "EPSG:31370", "metre", "unknown", NONE, 31370, 0, "Reseau National Belge 1972", 6378388, 297}},
	{"PROJCS[\"rotated\"," WGS84 "," TM1("15", "500000", "0") "," P("azimuth", "3") "," METRE "]",
	 {PROJ, "rotated", "metre", "unknown", NONE, 0, 0, "WGS 84", WGS}},
	{"PROJCS[\"half\"," WGS84 ",PROJECTION[\"Transverse_Mercator\"]," P("central_meridian", "15") "," METRE "]",
	 {PROJ, "half", "metre", "unknown", NONE, 0, 0, "WGS 84", WGS}},
	/* the number and the parameters are two systems: neither is computed with */
	{"PROJCS[\"p\"," WGS84 "," TM1("15", "500000", "0") "," METRE ",AUTHORITY[\"EPSG\",\"32632\"]]",
	 {PROJ, "EPSG:32632", "metre", "unknown", NONE, 32632, 0, "WGS 84", WGS}},
	/* a unit of its own beside the number: the system in another unit */
	{"PROJCS[\"p\"," NAD83 "," TM1("-123", "1640416.666666667", "0") "," FTUS ",AUTHORITY[\"EPSG\",\"26910\"]]",
	 {PROJ, "EPSG:26910", "us-survey-foot", "unknown", TM, 26910, 0, "NAD83", GRS80, 0, -123, 0, 0, .9996, 500000, 0}},
	/* WKT 2 */
	{"PROJCRS[\"WGS 84 / UTM zone 23S\"," BASE84 "," UTM2("-45", "10000000") "," CS2 ",ID[\"EPSG\",32723]]",
	 {PROJ, "EPSG:32723", "metre", "unknown", TM, 32723, 0, "WGS 84", WGS, 0, -45, 0, 0, .9996, 500000, 1e7}},
	{"PROJCRS[\"no number\"," BASE84 "," UTM2("-45", "10000000") "," NORTH_FIRST "]",
	 {PROJ, "EPSG:32723", "metre", "unknown", TM, 32723, 0, "WGS 84", WGS, 0, -45, 0, 0, .9996, 500000, 1e7}},
	{"COMPOUNDCRS[\"c\",PROJCRS[\"p\"," BASE84 "," UTM2(
		 "9",
		 "0") "," CS2 ",ID[\"EPSG\",32632]],VERTCRS[\"NAVD88 height (ftUS)\","
		      "VDATUM[\"North American Vertical Datum 1988\"],CS[vertical,1],AXIS[\"gravity-related height (H)\",up," FTUS2
		      "],"
		      "ID[\"EPSG\",6360]]]",
	 {PROJ, "EPSG:32632 + EPSG:6360", "metre", "us-survey-foot", TM, 32632, 6360, "WGS 84", WGS, 0, 9, 0, 0, .9996, 500000,
	  0}},
	{"BOUNDCRS[SOURCECRS[PROJCRS[\"p\"," BASE84
	 "," UTM2("9",
		  "0") "," CS2 "]],TARGETCRS[GEOGCRS[\"WGS 84\",DATUM[\"w\","
		       "ELLIPSOID[\"x\",6370000,0," M2 "]],CS[ellipsoidal,2],AXIS[\"lat\",north],AXIS[\"lon\",east]," D2 "]],"
		       "ABRIDGEDTRANSFORMATION[\"t\",METHOD[\"Geocentric translations\"],PARAMETER[\"X-axis translation\",1]]]",
	 {PROJ, "EPSG:32632", "metre", "unknown", TM, 32632, 0, "WGS 84", WGS, 0, 9, 0, 0, .9996, 500000, 0}},
	{"GEOGCRS[\"WGS 84 (3D)\",DATUM[\"World Geodetic System 1984\",ELLIPSOID[\"WGS 84\",6378137,298.257223563," M2 "]],"
	 "CS[ellipsoidal,3],AXIS[\"latitude\",north,ORDER[1]," D2 "],AXIS[\"longitude\",east,ORDER[2]," D2 "],"
	 "AXIS[\"height\",up,ORDER[3],LENGTHUNIT[\"foot\",0.3048]],ID[\"EPSG\",4979]]",
	 {GEOG, "EPSG:4979", "degree", "foot", GEO, 4979, 0, "WGS 84", WGS}},
	{"GEODCRS[\"WGS 84\",DATUM[\"World Geodetic System 1984\",ELLIPSOID[\"WGS 84\",6378137,298.257223563," M2 "]],"
	 "CS[Cartesian,3],AXIS[\"(X)\",geocentricX],AXIS[\"(Y)\",geocentricY],AXIS[\"(Z)\",geocentricZ]," M2
	 ",ID[\"EPSG\",4978]]",
	 {GEOC, "EPSG:4978", "metre", "metre", NONE, 4978, 0, "WGS 84", WGS}},
	{"PROJCRS[\"3D\"," BASE84 "," UTM2("9", "0") ",CS[Cartesian,3],AXIS[\"E\",east],AXIS[\"N\",north],AXIS[\"h\",up]," M2 "]",
	 {PROJ, "EPSG:32632", "metre", "metre", TM, 32632, 0, "WGS 84", WGS, 0, 9, 0, 0, .9996, 500000, 0}},
	{"DERIVEDPROJCRS[\"site\",BASEPROJCRS[\"p\"," BASE84
	 "," UTM2("9", "0") "],DERIVINGCONVERSION[\"c\",METHOD[\"Affine\"]]," CS2 "]",
	 {PROJ, "site", "metre", "unknown", NONE, 0, 0, "WGS 84", WGS}},
	{"GEOGCRS[\"rotated pole\"," BASE84 ",DERIVINGCONVERSION[\"c\",METHOD[\"Pole rotation\"],PARAMETER[\"lat\",1," D2 "]],"
	 "CS[ellipsoidal,2],AXIS[\"lat\",north],AXIS[\"lon\",east]," D2 "]",
	 {GEOG, "rotated pole", "degree", "unknown", NONE, 0, 0, "WGS 84", WGS}},
	{"PROJCRS[\"feet\"," BASE84
	 ",CONVERSION[\"c\",METHOD[\"Lambert Conic Conformal (2SP)\",ID[\"EPSG\",9802]]," P2("Latitude of false origin", "41.75", D2) "," P2(
		 "Longitude of false origin", "-120.5",
		 D2) "," P2("Latitude of 1st standard parallel", "43",
			    D2) "," P2("Latitude of 2nd standard parallel", "45.5",
				       D2) "," P2("Easting at false origin", "1312335.958005249",
						  "LENGTHUNIT[\"foot\",0.3048]") "," P2("Northing at false origin", "0",
											"LENGTHUNIT[\"foot\",0.3048]") "],CS[Cartesian,2],AXIS[\"E\",east],AXIS[\"N\",north],"
														       "LENGTHUNIT[\"foot\",0.3048]]",
	 {PROJ, "feet", "foot", "unknown", LCC, 0, 0, "WGS 84", WGS, 41.75, -120.5, 43, 45.5, 1, 400000, 0}},
};

static void check(const struct crs_info *got, const struct want *w, const char *what)
{
	const struct crs_system *s = &got->system;

	if (got->plane != (enum crs_plane)w->plane || strcmp(got->text, w->text) || (int)s->method != w->method)
		print_error("%s: plane %d, %s, method %d\n", what, got->plane, got->text, s->method);
	assert_int_equal(got->plane, w->plane);
	assert_string_equal(got->text, w->text);
	assert_string_equal(got->unit_xy, w->unit_xy);
	assert_string_equal(got->unit_z, w->unit_z);
	assert_int_equal(s->method, w->method);
	assert_int_equal(s->epsg, w->epsg);
	assert_int_equal(s->epsg_z, w->epsg_z);
	assert_string_equal(s->datum, w->datum);
	assert_true(fabs(s->a - w->a) < 1e-6 && fabs(s->inverse_flattening - w->f) < 1e-9);
	assert_true(fabs(s->lat0 - w->lat0) < 1e-12 && fabs(s->lon0 - w->lon0) < 1e-12);
	assert_true(fabs(s->lat1 - w->lat1) < 1e-12 && fabs(s->lat2 - w->lat2) < 1e-12);
	assert_true(fabs(s->k0 - w->k0) < 1e-12 && fabs(s->x0 - w->x0) < 1e-6 && fabs(s->y0 - w->y0) < 1e-6);
	assert_true(s->unit == (w->plane == GEOG ? strcmp(w->unit_xy, "degree") ? 0 : 1 : crs_unit_metres(w->unit_xy)));
	assert_true(s->unit_z == crs_unit_metres(w->unit_z));
}

static void wkt(void **state)
{
	for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
		struct crs_info info;

		assert_true(crs_read_wkt(texts[i].wkt, strlen(texts[i].wkt), &info));
		check(&info, &texts[i].want, texts[i].wkt);
	}
}

/* ---- GeoTIFF keys ---- */

struct keys {
	uint16_t words[104];
	double doubles[12];
	const char *ascii;
};

#define K(id, value) id, 0, 1, value
#define D(id, index) id, 34736, 1, index
#define A(id, count, index) id, 34737, count, index

static const struct {
	struct keys keys;
	struct want want;
} key_texts[] = {
	{{{1, 1, 0, 2, K(1024, 1), K(3072, 32733)}},
	 {PROJ, "EPSG:32733", "metre", "unknown", TM, 32733, 0, "WGS 84", WGS, 0, 15, 0, 0, .9996, 500000, 1e7}},
	{{{1, 1, 0, 3, K(1024, 1), K(3072, 7415), K(4099, 9001)}},
	 {PROJ, "EPSG:28992 + EPSG:5709", "metre", "metre", NONE, 28992, 5709, "Amersfoort", 6377397.155, 299.1528128}},
	{{{1, 1, 0, 2, K(1024, 1), K(3072, 27700)}},
	 {PROJ, "EPSG:27700", "metre", "unknown", TM, 27700, 0, "OSGB36", 6377563.396, 299.3249646, 49, -2, 0, 0, .9996012717,
	  400000, -100000}},
	{{{1, 1, 0, 2, K(1024, 1), K(3072, 3035)}}, {PROJ, "EPSG:3035", "metre", "unknown", NONE, 3035, 0, "ETRS89", GRS80}},
	{{{1, 1, 0, 2, K(1024, 2), K(2048, 4979)}}, {GEOG, "EPSG:4979", "degree", "metre", GEO, 4979, 0, "WGS 84", WGS}},
	{{{1, 1, 0, 2, K(1024, 3), K(2048, 4978)}}, {GEOC, "EPSG:4978", "metre", "metre", NONE, 4978, 0, "WGS 84", WGS}},
	/* heights by the number of their system, and by its name alone */
	{{{1, 1, 0, 3, K(1024, 1), K(3072, 26910), K(4096, 6360)}},
	 {PROJ, "EPSG:26910 + EPSG:6360", "metre", "us-survey-foot", TM, 26910, 6360, "NAD83", GRS80, 0, -123, 0, 0, .9996,
	  500000, 0}},
	{{{1, 1, 0, 3, K(1024, 1), K(3072, 26910), A(4097, 21, 0)}, {0}, "NAVD88 height (ftUS)|"},
	 {PROJ, "EPSG:26910 + NAVD88 height (ftUS)", "metre", "us-survey-foot", TM, 26910, 0, "NAD83", GRS80, 0, -123, 0, 0,
	  .9996, 500000, 0}},
	{{{1, 1, 0, 3, K(1024, 1), K(3072, 26910), A(4097, 12, 0)}, {0}, "NAVD88 feet|"},
	 {PROJ, "EPSG:26910 + NAVD88 feet", "metre", "unknown", TM, 26910, 0, "NAD83", GRS80, 0, -123, 0, 0, .9996, 500000, 0}},
	/* citations where only they speak */
	{{{1, 1, 0, 2, K(1024, 1), A(1026, 21, 0)}, {0}, "NAD83 / UTM zone 10N|"},
	 {PROJ, "EPSG:26910", "metre", "unknown", TM, 26910, 0, "NAD83", GRS80, 0, -123, 0, 0, .9996, 500000, 0}},
	{{{1, 1, 0, 2, K(1024, 1), A(1026, 13, 0)}, {0}, "UTM zone 10N|"},
	 {PROJ, "UTM zone 10N", "unknown", "unknown", NONE, 0, 0, ""}},
	{{{1, 1, 0, 2, K(1024, 1), A(3073, 27, 0)}, {0}, "NAD83 / Texas South (ftUS)|"},
	 {PROJ, "EPSG:2279", "us-survey-foot", "unknown", NONE, 2279, 0, "NAD83", GRS80}},
	{{{1, 1, 0, 2, K(1024, 1), A(3073, 27, 0)}, {0}, "NAD83 / Texas South (feet)|"},
	 {PROJ, "NAD83 / Texas South (feet)", "unknown", "unknown", NONE, 0, 0, ""}},
	/* user-defined: two parallels in feet; UTM by its conversion alone */
	{{{1, 1, 0, 13, K(1024, 1), K(2048, 32767), K(2050, 6152), K(2054, 9102), D(2057, 7), D(2059, 6), K(3072, 32767),
	   K(3075, 8), K(3076, 9002), D(3078, 2), D(3079, 3), D(3084, 1), D(3085, 0)},
	  {41.75, -120.5, 43, 45.5, 1312335.958005249, 0, 298.257222101, 6378137}},
	 {PROJ, "unknown", "foot", "unknown", NONE, 0, 0, "NAD83(HARN)", GRS80}},
	{{{1, 1, 0, 15, K(1024, 1), K(2048, 32767), K(2050, 6152), K(2054, 9102), D(2057, 7), D(2059, 6), K(3072, 32767),
	   K(3075, 8), K(3076, 9002), D(3078, 2), D(3079, 3), D(3084, 1), D(3085, 0), D(3086, 4), D(3087, 5)},
	  {41.75, -120.5, 43, 45.5, 1312335.958005249, 0, 298.257222101, 6378137}},
	 {PROJ, "unknown", "foot", "unknown", LCC, 0, 0, "NAD83(HARN)", GRS80, 41.75, -120.5, 43, 45.5, 1, 400000, 0}},
	{{{1, 1, 0, 5, K(1024, 1), K(2048, 4269), K(3072, 32767), K(3074, 16010), K(3076, 9001)}},
	 {PROJ, "EPSG:26910", "metre", "unknown", TM, 26910, 0, "NAD83", GRS80, 0, -123, 0, 0, .9996, 500000, 0}},
	/* parameters that are not the number's; origins that contradict each other */
	{{{1, 1, 0, 9, K(1024, 1), K(2054, 9102), K(3072, 32632), K(3075, 1), D(3080, 0), D(3081, 1), D(3082, 2), D(3083, 1),
	   D(3092, 3)},
	  {15, 0, 500000, .9996}},
	 {PROJ, "EPSG:32632", "metre", "unknown", NONE, 32632, 0, "WGS 84", WGS}},
	{{{1, 1, 0, 11, K(1024, 1), K(2048, 4326), K(3072, 32767), K(3075, 1), K(3076, 9001), D(3080, 0), D(3088, 4), D(3081, 1),
	   D(3082, 2), D(3083, 1), D(3092, 3)},
	  {15, 0, 500000, .9996, 16}},
	 {PROJ, "unknown", "metre", "unknown", NONE, 0, 0, "WGS 84", WGS}},
	/* a meridian of its own */
	{{{1, 1, 0, 4, K(1024, 2), K(2048, 32767), K(2051, 8903), K(2050, 6326)}},
	 {GEOG, "unknown", "unknown", "unknown", NONE, 0, 0, "WGS 84", WGS}},
};

static struct crs_records records_of(const struct keys *k)
{
	return (struct crs_records){
		.keys = {k->words, 8 + (size_t)k->words[3] * 8},
		.doubles = {k->doubles, sizeof k->doubles},
		.ascii = {k->ascii, k->ascii ? strlen(k->ascii) : 0},
	};
}

static void keys(void **state)
{
	for (size_t i = 0; i < sizeof key_texts / sizeof *key_texts; i++) {
		struct crs_records r = records_of(&key_texts[i].keys);
		struct crs_info info;
		char what[16];

		snprintf(what, sizeof what, "keys %zu", i);
		assert_true(crs_read_geokeys(&r, &info));
		check(&info, &key_texts[i].want, what);
	}
}

/* ---- numbers and words ---- */

static void assumptions(void **state)
{
	static const struct {
		const char *text;
		struct want want;
	} good[] = {
		{" epsg:2193 ",
		 {PROJ, "EPSG:2193", "metre", "unknown", TM, 2193, 0, "NZGD2000", GRS80, 0, 173, 0, 0, .9996, 1.6e6, 1e7}},
		{"EPSG:3948",
		 {PROJ, "EPSG:3948", "metre", "unknown", LCC, 3948, 0, "RGF93", GRS80, 48, 3, 47.25, 48.75, 1, 1.7e6, 7.2e6}},
		{"EPSG:6339 + EPSG:8228",
		 {PROJ, "EPSG:6339 + EPSG:8228", "metre", "foot", TM, 6339, 8228, "NAD83(2011)", GRS80, 0, -123, 0, 0, .9996,
		  500000, 0}},
		{"EPSG:7415",
		 {PROJ, "EPSG:28992 + EPSG:5709", "metre", "metre", NONE, 28992, 5709, "Amersfoort", 6377397.155, 299.1528128}},
		{" 2193\n",
		 {PROJ, "EPSG:2193", "metre", "unknown", TM, 2193, 0, "NZGD2000", GRS80, 0, 173, 0, 0, .9996, 1.6e6, 1e7}},
		{"6339 + 8228",
		 {PROJ, "EPSG:6339 + EPSG:8228", "metre", "foot", TM, 6339, 8228, "NAD83(2011)", GRS80, 0, -123, 0, 0, .9996,
		  500000, 0}},
		{"site grid of 1987", {UNKNOWN, "site grid of 1987", "unknown", "unknown", NONE, 0, 0, ""}},
		{"WGS_1984_UTM_Zone_32S",
		 {PROJ, "EPSG:32732", "metre", "unknown", TM, 32732, 0, "WGS 84", WGS, 0, 9, 0, 0, .9996, 500000, 1e7}},
		{"\n" WGS84 "\n", {GEOG, "WGS 84", "degree", "unknown", GEO, 0, 0, "WGS 84", WGS}},
	};
	static const char *const bad[] = {"",
					  "  \n",
					  "PROJCS[\"p\"",
					  "FOO[\"x\"]",
					  "[",
					  "na\xc3\xafve",
					  "a\tb",
					  "EPSG:99999",
					  "99999",
					  "9999999",
					  "0",
					  "EPSG:25832+7837",
					  "EPSG:",
					  "epsg:x",
					  "EPSG:25832 + 99999",
					  "EPSG:25832 + EPSG:99999",
					  "EPSG:5030",
					  "EPSG:32767",
					  "EPSG:25832 + EPSG:",
					  "99999 + EPSG:5773",
					  "site + EPSG:1 2"};
	struct err err;
	struct crs_info info;

	for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
		err = ERR_INIT;
		assert_int_equal(crs_assume_text(good[i].text, strlen(good[i].text), &info, &err), 0);
		check(&info, &good[i].want, good[i].text);
	}
	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
		err = ERR_INIT;
		assert_int_equal(crs_assume_text(bad[i], strlen(bad[i]), &info, &err), -ERR_USAGE);
		assert_true(err.message[0]);
	}
	assert_string_equal(crs_assume_unit("FTUS"), "us-survey-foot");
	assert_string_equal(crs_assume_unit("ft"), "foot");
	assert_null(crs_assume_unit("feet"));
	assert_null(crs_assume_unit(""));
}

/* Every number: total, and what it gives stands on its own feet. */
static void all_numbers(void **state)
{
	unsigned known = 0;

	for (unsigned n = 1; n < 65536; n++) {
		char text[16];
		struct crs_info info;
		struct err err = ERR_INIT;
		const struct crs_system *s = &info.system;
		int size = snprintf(text, sizeof text, "EPSG:%u", n);

		if (crs_assume_text(text, (size_t)size, &info, &err)) {
			assert_string_equal(crs_epsg_name(n), "");
			assert_non_null(strstr(err.message, "is no system that acut knows of EPSG"));
			continue;
		}
		assert_true(*crs_epsg_name(n));
		known += info.plane != CRS_PLANE_UNKNOWN;
		if (s->method == CRS_METHOD_UNKNOWN)
			continue;
		assert_true(s->a > 6.3e6 && s->datum[0] && s->unit == 1 && fabs(s->lon0) <= 180);
		if (s->method != CRS_METHOD_GEOGRAPHIC)
			assert_true(s->k0 > .9 && s->k0 <= 1);
	}
	assert_true(known > 6000 && known < 9000);
}

/* Degrees that are projected and files that are in that zone already must meet under one text. */
static void zones(void **state)
{
	static const struct {
		const char *from, *to;
		struct crs_zone zone;
	} cases[] = {
		{"EPSG:4152", "EPSG:3740", {10, true}},
		{"EPSG:4617", "EPSG:2958", {17, true}},
		{"EPSG:4326", "EPSG:32723", {23, false}},
		{"EPSG:4326 + EPSG:6360", "EPSG:32632 + EPSG:6360", {32, true}},
	};

	for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
		struct crs_info from, to, again;
		struct err err = ERR_INIT;

		assert_int_equal(crs_assume_text(cases[i].from, strlen(cases[i].from), &from, &err), 0);
		assert_int_equal(crs_zone_system(&from, cases[i].zone, &to, &err), 0);
		assert_string_equal(to.text, cases[i].to);
		assert_int_equal(crs_assume_text(to.text, strlen(to.text), &again, &err), 0);
		assert_true(crs_system_same(&to.system, &again.system));
		assert_int_equal(to.system.epsg, again.system.epsg);
	}
}

/* An ellipsoid with no flattening, however it is written, is called a sphere. */
static void sphere(void **state)
{
	static const struct {
		const char *f, *says;
	} row[] = {
		{"0", "a sphere of 6370997 m;"},
		{"inf", "a sphere of 6370997 m;"},
		{"1e999", "a sphere of 6370997 m;"},
		{"294.5", "the ellipsoid 6370997 m, 1/294.5;"},
	};

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		struct err err = ERR_INIT;
		struct crs_info info;
		char text[400];

		snprintf(text, sizeof text, "GEOGCS[\"g\",DATUM[\"d\",SPHEROID[\"s\",6370997,%s]]," GREENWICH "," DEGREE "]",
			 row[i].f);
		assert_true(crs_read_wkt(text, strlen(text), &info));
		if (info.system.a == 0)
			continue; /* no number: no ellipsoid */
		assert_int_equal(crs_zone_datum(&info, &err), -ERR_UNSUPPORTED);
		if (!strstr(err.message, row[i].says))
			fail_msg("%s: %s", row[i].f, err.message);
	}
}

/* ---- damage ---- */

static uint64_t rng_state = 0x9e3779b97f4a7c15u;

static uint32_t rng(uint32_t n)
{
	rng_state = rng_state * 6364136223846793005u + 1442695040888963407u;
	return (uint32_t)(rng_state >> 33) % n;
}

static void check_sane(const struct crs_info *info)
{
	const struct crs_system *s = &info->system;

	assert_true(info->plane <= CRS_PLANE_GEOCENTRIC && s->method <= CRS_METHOD_POLAR_STEREOGRAPHIC);
	assert_non_null(memchr(info->text, 0, sizeof info->text));
	assert_non_null(memchr(s->datum, 0, sizeof s->datum));
	assert_true(isfinite(s->a) && isfinite(s->inverse_flattening) && isfinite(s->x0) && isfinite(s->y0));
	assert_true(fabs(s->lat0) <= 90 && fabs(s->lat1) <= 90 && fabs(s->lat2) <= 90 && fabs(s->lon0) <= 360);
	if (s->method != CRS_METHOD_UNKNOWN)
		assert_true(s->a > 6.3e6 && s->a < 6.4e6);
	if (s->method > CRS_METHOD_GEOGRAPHIC)
		assert_true(s->k0 > .5 && s->k0 < 2);
	for (const char *c = info->text; *c; c++)
		assert_true(*c >= 0x20 && *c < 0x7f);
}

/* Bytes changed, pieces of other texts put in, ends cut off; in a heap block of the exact size. */
static void damaged(void **state)
{
	const size_t n_texts = sizeof texts / sizeof *texts, n_keys = sizeof key_texts / sizeof *key_texts;

	for (int round = 0; round < 30000; round++) {
		const char *from = texts[rng((uint32_t)n_texts)].wkt, *other = texts[rng((uint32_t)n_texts)].wkt;
		size_t n = strlen(from), at = rng((uint32_t)n), piece = rng(40), start = rng((uint32_t)strlen(other));
		char *copy;
		struct crs_info info;
		struct err err = ERR_INIT;

		if (round % 3 == 0)
			n = at + 1;
		copy = malloc(n);
		memcpy(copy, from, n);
		if (piece > n - at)
			piece = n - at;
		if (piece > strlen(other) - start)
			piece = strlen(other) - start;
		if (round % 3 == 1)
			memcpy(copy + at, other + start, piece);
		if (round % 3 == 2)
			for (int i = 0; i < 3; i++)
				copy[rng((uint32_t)n)] = (char)rng(256);
		crs_read_wkt(copy, n, &info);
		check_sane(&info);
		if (!crs_assume_text(copy, n, &info, &err))
			check_sane(&info);
		free(copy);
	}
	for (int round = 0; round < 30000; round++) {
		const struct keys *from = &key_texts[rng((uint32_t)n_keys)].keys;
		size_t n = 8 + (size_t)from->words[3] * 8, text = from->ascii ? strlen(from->ascii) : 0;
		uint16_t *words = malloc(n);
		double *doubles = malloc(sizeof from->doubles);
		char *ascii = malloc(text + 1);
		struct crs_records r = {{words, round % 4 ? n : rng((uint32_t)n)},
					{doubles, rng(sizeof from->doubles + 1)},
					{ascii, text},
					{0},
					false};
		struct crs_info info;

		memcpy(words, from->words, n);
		memcpy(doubles, from->doubles, sizeof from->doubles);
		memcpy(ascii, from->ascii ? from->ascii : "", text + 1);
		for (unsigned i = rng(4); i > 0; i--)
			words[rng((uint32_t)n / 2)] = (uint16_t)(rng(2) ? rng(65536) : 2048 + rng(2100));
		if (round % 5 == 0)
			doubles[rng(12)] = (const double[]){NAN, INFINITY, -1e300, 1e300, 91, 0}[rng(6)];
		crs_read_geokeys(&r, &info);
		check_sane(&info);
		free(words);
		free(doubles);
		free(ascii);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(wkt),   cmocka_unit_test(keys),   cmocka_unit_test(assumptions), cmocka_unit_test(all_numbers),
		cmocka_unit_test(zones), cmocka_unit_test(sphere), cmocka_unit_test(damaged),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
