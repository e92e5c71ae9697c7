/*
 * The EPSG numbers that need no table of thousands: UTM on the usual datums, national grids of one zone, the
 * geographic systems under them, and the heights that survey files name. What EPSG defines is a fact of the
 * number; a number that is not here stays a number, with nothing known of it.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "crs_parts.h"

/* A range of numbers is a series of zones: the first has `lon0`, each further one is 6 degrees to the east. */
struct projected {
	unsigned first, last;
	unsigned datum;         /* EPSG number of the datum, 0: not told here */
	enum crs_method method; /* UNKNOWN: only unit and datum are known here */
	double lat0, lon0, lat1, lat2, k0, x0, y0;
	const char *names; /* plain, of EPSG and ESRI, separated by spaces; NULL: a series, or none */
};

#define TM CRS_METHOD_TRANSVERSE_MERCATOR
#define UTM(first, last, datum, zone, y0)                                                    \
	{                                                                                    \
		first, last, datum, TM, 0, -183 + 6 * (zone), 0, 0, 0.9996, 500000, y0, NULL \
	}
#define LCC CRS_METHOD_LAMBERT_CONIC
#define POLAR CRS_METHOD_POLAR_STEREOGRAPHIC
#define OTHER CRS_METHOD_UNKNOWN

static const struct projected projected[] = {
	UTM(32601, 32660, 6326, 1, 0), /* WGS 84 */
	UTM(32701, 32760, 6326, 1, 10000000),
	UTM(26901, 26923, 6269, 1, 0),  /* NAD83 */
	UTM(25828, 25838, 6258, 28, 0), /* ETRS89 */
	UTM(6330, 6348, 1116, 1, 0),    /* NAD83(2011) */
	UTM(3708, 3726, 6759, 1, 0),    /* NAD83(NSRS2007) */
	UTM(3740, 3749, 6152, 10, 0),   /* NAD83(HARN) */
	UTM(2955, 2957, 6140, 11, 0),   /* NAD83(CSRS), in four pieces */
	UTM(2958, 2962, 6140, 17, 0),
	UTM(3154, 3157, 6140, 7, 0),
	UTM(3158, 3160, 6140, 14, 0),
	UTM(26701, 26722, 6267, 1, 0),  /* NAD27 */
	UTM(23028, 23038, 6230, 28, 0), /* ED50 */
	UTM(32201, 32260, 6322, 1, 0),  /* WGS 72 */
	UTM(32301, 32360, 6322, 1, 10000000),
	UTM(28348, 28358, 6283, 48, 10000000), /* GDA94 / MGA */
	UTM(7846, 7859, 1168, 46, 10000000),   /* GDA2020 / MGA */
	{2154, 2154, 6171, LCC, 46.5, 3, 49, 44, 1, 700000, 6600000, "rgf93lambert93 rgf93v1lambert93 rgf1993lambert93"},
	{3034, 3034, 6258, LCC, 52, 10, 35, 65, 1, 4000000, 2800000, "etrs89extendedlcceurope"},
	{2991, 2991, 6269, LCC, 41.75, -120.5, 43, 45.5, 1, 400000, 0, "nad83oregonlccm"},
	{3978, 3978, 6269, LCC, 49, -95, 49, 77, 1, 0, 0, "nad83canadaatlaslambert"},
	{3979, 3979, 6140, LCC, 49, -95, 49, 77, 1, 0, 0, "nad83csrscanadaatlaslambert"},
	{5070, 5070, 6269, CRS_METHOD_ALBERS, 23, -96, 29.5, 45.5, 1, 0, 0, "nad83conusalbers"},
	{6350, 6350, 1116, CRS_METHOD_ALBERS, 23, -96, 29.5, 45.5, 1, 0, 0, "nad832011conusalbers"},
	{27700, 27700, 6277, TM, 49, -2, 0, 0, 0.9996012717, 400000, -100000,
	 "osgb36britishnationalgrid osgb1936britishnationalgrid"},
	{2193, 2193, 6167, TM, 0, 173, 0, 0, 0.9996, 1600000, 10000000, "nzgd2000newzealandtransversemercator2000"},
	{2180, 2180, 0, OTHER, 0, 0, 0, 0, 0, 0, 0, NULL}, /* Poland CS92 */
	{3006, 3006, 0, OTHER, 0, 0, 0, 0, 0, 0, 0, NULL}, /* SWEREF99 TM */
	{3067, 3067, 6258, TM, 0, 27, 0, 0, 0.9996, 500000, 0, "etrs89tm35finen"},
	{2157, 2157, 0, OTHER, 0, 0, 0, 0, 0, 0, 0, NULL}, /* Irish Transverse Mercator */
	{5041, 5041, 6326, POLAR, 90, 0, 90, 0, 0.994, 2000000, 2000000, "wgs84upsnorthen"},
	{5042, 5042, 6326, POLAR, -90, 0, -90, 0, 0.994, 2000000, 2000000, "wgs84upssouthen"},
	{32661, 32661, 6326, POLAR, 90, 0, 90, 0, 0.994, 2000000, 2000000, "wgs84upsnorthne"},
	{32761, 32761, 6326, POLAR, -90, 0, -90, 0, 0.994, 2000000, 2000000, "wgs84upssouthne"},
	{3031, 3031, 6326, POLAR, -90, 0, -71, 0, 1, 0, 0, "wgs84antarcticpolarstereographic"},
	{3413, 3413, 6326, POLAR, 90, -45, 70, 0, 1, 0, 0, "wgs84nsidcseaicepolarstereographicnorth"},
	{3035, 3035, 6258, OTHER, 0, 0, 0, 0, 0, 0, 0, "etrs89extendedlaeaeurope etrs89laeaeurope"},
	{3857, 3857, 6326, OTHER, 0, 0, 0, 0, 0, 0, 0, "wgs84pseudomercator"},
	{28992, 28992, 6289, OTHER, 0, 0, 0, 0, 0, 0, 0, "amersfoortrdnew"}, /* oblique stereographic */
	{31370, 31370, 0, OTHER, 0, 0, 0, 0, 0, 0, 0, NULL},                 /* Belgian Lambert 72 */
	{3812, 3812, 6258, OTHER, 0, 0, 0, 0, 0, 0, 0, NULL},                /* Belgian Lambert 2008 */
	{2056, 2056, 0, OTHER, 0, 0, 0, 0, 0, 0, 0, NULL},                   /* Switzerland LV95, oblique */
	{21781, 21781, 0, OTHER, 0, 0, 0, 0, 0, 0, 0, NULL},                 /* Switzerland LV03 */
	{5514, 5514, 0, OTHER, 0, 0, 0, 0, 0, 0, 0, NULL},                   /* Krovak East North */
	{31466, 31469, 6314, OTHER, 0, 0, 0, 0, 0, 0, 0, NULL},              /* DHDN, zones of 3 degrees */
};

static const struct {
	unsigned epsg, datum;
	bool solid, geocentric;
} geodetic[] = {
	{4326, 6326, false, false}, {4979, 6326, true, false},  {4978, 6326, true, true},   {4269, 6269, false, false},
	{4258, 6258, false, false}, {4937, 6258, true, false},  {4936, 6258, true, true},   {4171, 6171, false, false},
	{4965, 6171, true, false},  {4964, 6171, true, true},   {4152, 6152, false, false}, {4957, 6152, true, false},
	{4759, 6759, false, false}, {6318, 1116, false, false}, {6319, 1116, true, false},  {6317, 1116, true, true},
	{4617, 6140, false, false}, {4955, 6140, true, false},  {4267, 6267, false, false}, {4277, 6277, false, false},
	{4289, 6289, false, false}, {4314, 6314, false, false}, {4230, 6230, false, false}, {4322, 6322, false, false},
	{4283, 6283, false, false}, {4939, 6283, true, false},  {4938, 6283, true, true},   {7844, 1168, false, false},
	{7843, 1168, true, false},  {7842, 1168, true, true},   {4167, 6167, false, false}, {4959, 6167, true, false},
};

static const struct {
	unsigned epsg;
	const char *unit;
} heights[] = {
	{5703, "metre"},          /* NAVD88 */
	{6360, "us-survey-foot"}, /* NAVD88 (ftUS) */
	{8228, "foot"},           /* NAVD88 (ft) */
	{5773, "metre"},          /* EGM96 */
	{3855, "metre"},          /* EGM2008 */
	{5798, "metre"},          /* EGM84 */
	{5714, "metre"},          /* MSL */
	{5720, "metre"},          /* NGF-IGN69 */
	{5721, "metre"},          /* NGF-IGN78 */
	{5709, "metre"},          /* NAP */
	{5701, "metre"},          /* ODN */
	{5710, "metre"},          /* Ostend */
	{5711, "metre"},          /* AHD */
	{5713, "metre"},          /* CGVD28 */
	{6647, "metre"},          /* CGVD2013 */
	{5730, "metre"},          /* EVRF2000 */
	{5621, "metre"},          /* EVRF2007 */
	{5783, "metre"},          /* DHHN92 */
	{7837, "metre"},          /* DHHN2016 */
	{5613, "metre"},          /* RH2000 */
	{3900, "metre"},          /* N2000 */
	{5941, "metre"},          /* NN2000 */
	{7839, "metre"},          /* NZVD2016 */
};

static const struct {
	unsigned epsg, horizontal, vertical;
} compounds[] = {
	{7415, 28992, 5709},                                          /* Amersfoort / RD New + NAP */
	{5698, 2154, 5720},                                           /* RGF93 / Lambert-93 + NGF-IGN69 */
	{7405, 27700, 5701},                                          /* OSGB36 / British National Grid + ODN */
	{5555, 25832, 5783},                                          /* ETRS89 / UTM 32N + DHHN92 */
	{5556, 25833, 5783}, {5554, 25831, 5783}, {6349, 6318, 5703}, /* NAD83(2011) + NAVD88 */
	{5498, 4269, 5703},                                           /* NAD83 + NAVD88 */
};

#define N(table) (sizeof(table) / sizeof *(table))

static void fill_projected(const struct projected *row, unsigned code, struct crs_info *ret)
{
	struct crs_system *s = &ret->system;

	ret->plane = CRS_PLANE_PROJECTED;
	crs_set_unit(ret->unit_xy, "metre");
	crs_datum_of_epsg(s, row->datum);
	s->method = row->method;
	s->lat0 = row->lat0;
	s->lon0 = row->lon0 + 6.0 * (code - row->first);
	s->lat1 = row->lat1;
	s->lat2 = row->lat2;
	s->k0 = row->k0;
	s->x0 = row->x0;
	s->y0 = row->y0;
}

/* RGF93 / CC42 to CC50: a cone for each degree of latitude. */
static bool fill_cc(unsigned code, struct crs_info *ret)
{
	struct projected row = {code, code, 6171, LCC, 0, 3, 0, 0, 1, 1700000, 0, NULL};

	if (code < 3942 || code > 3950)
		return false;
	row.lat0 = code - 3900;
	row.lat1 = row.lat0 - 0.75;
	row.lat2 = row.lat0 + 0.75;
	row.y0 = (row.lat0 - 41) * 1000000 + 200000;
	fill_projected(&row, code, ret);
	return true;
}

static bool fill(unsigned code, struct crs_info *ret)
{
	for (size_t i = 0; i < N(projected); i++) {
		if (code >= projected[i].first && code <= projected[i].last) {
			fill_projected(&projected[i], code, ret);
			return true;
		}
	}
	for (size_t i = 0; i < N(geodetic); i++) {
		if (geodetic[i].epsg != code)
			continue;
		ret->plane = geodetic[i].geocentric ? CRS_PLANE_GEOCENTRIC : CRS_PLANE_GEOGRAPHIC;
		crs_set_unit(ret->unit_xy, geodetic[i].geocentric ? "metre" : "degree");
		if (geodetic[i].solid)
			crs_set_unit(ret->unit_z, "metre");
		crs_datum_of_epsg(&ret->system, geodetic[i].datum);
		ret->system.method = CRS_METHOD_GEOGRAPHIC;
		return true;
	}
	return fill_cc(code, ret);
}

bool crs_epsg_system(unsigned code, struct crs_info *ret)
{
	struct crs_info made;

	crs_info_clear(&made);
	if (!fill(code, &made))
		return false;
	made.system.epsg = code;
	crs_text_append_epsg(&made, code);
	crs_info_settle(&made);
	*ret = made;
	return true;
}

const char *crs_epsg_height_unit(unsigned code)
{
	for (size_t i = 0; i < N(heights); i++)
		if (heights[i].epsg == code)
			return heights[i].unit;
	return crs_unknown;
}

bool crs_epsg_compound(unsigned code, unsigned *ret_horizontal, unsigned *ret_vertical)
{
	for (size_t i = 0; i < N(compounds); i++) {
		if (compounds[i].epsg == code) {
			*ret_horizontal = compounds[i].horizontal;
			*ret_vertical = compounds[i].vertical;
			return true;
		}
	}
	return false;
}

/* ---- by name, by parameters ---- */

/* "NAD83 / UTM zone 10N", "WGS_1984_UTM_Zone_32N": `plain` is "nad83utmzone10n". */
static unsigned utm_of_name(const char *plain)
{
	static const struct {
		const char *datum;
		unsigned north, south, first, last;
	} series[] = {
		{"wgs84", 32600, 32700, 1, 60},      {"wgs1984", 32600, 32700, 1, 60}, {"nad83", 26900, 0, 1, 23},
		{"nad1983", 26900, 0, 1, 23},        {"etrs89", 25800, 0, 28, 38},     {"etrs1989", 25800, 0, 28, 38},
		{"nad832011", 6329, 0, 1, 19},       {"nad19832011", 6329, 0, 1, 19},  {"nad83nsrs2007", 3707, 0, 1, 19},
		{"nad1983nsrs2007", 3707, 0, 1, 19}, {"nad83harn", 3730, 0, 10, 19},   {"nad1983harn", 3730, 0, 10, 19},
		{"nad27", 26700, 0, 1, 22},          {"nad1927", 26700, 0, 1, 22},     {"ed50", 23000, 0, 28, 38},
	};
	const char *at = strstr(plain, "utmzone");
	unsigned zone;
	char half;
	int end = 0;

	if (!at || sscanf(at, "utmzone%2u%c%n", &zone, &half, &end) != 2 || at[end] || (half != 'n' && half != 's'))
		return 0;
	for (size_t i = 0; i < N(series); i++) {
		size_t n = strlen(series[i].datum);
		unsigned base = half == 'n' ? series[i].north : series[i].south;

		if (n == (size_t)(at - plain) && !memcmp(plain, series[i].datum, n) && base && zone >= series[i].first &&
		    zone <= series[i].last)
			return base + zone;
	}
	return 0;
}

unsigned crs_epsg_of_name(const char *name, size_t size)
{
	char plain[128];
	size_t n = strlen(crs_text_plain((struct crs_span){name, size}, plain, sizeof plain));

	if (!n)
		return 0;
	for (size_t i = 0; i < N(projected); i++) {
		const char *at = projected[i].names;

		for (; at && (at = strstr(at, plain)); at += n)
			if ((at == projected[i].names || at[-1] == ' ') && (!at[n] || at[n] == ' '))
				return projected[i].first;
	}
	return utm_of_name(plain);
}

static bool is_it(unsigned code, const struct crs_system *s)
{
	struct crs_info info;

	return crs_epsg_system(code, &info) && !strcmp(info.system.datum, s->datum) && crs_system_same(&info.system, s);
}

unsigned crs_epsg_of_system(const struct crs_system *s)
{
	if (s->method == CRS_METHOD_UNKNOWN || s->method == CRS_METHOD_GEOGRAPHIC || !s->datum[0])
		return 0;
	for (size_t i = 0; i < N(projected); i++) {
		unsigned code = projected[i].first;
		double step = (s->lon0 - projected[i].lon0) / 6;

		if (projected[i].last > code && step > 0 && step < 60)
			code += (unsigned)lround(step);
		/* the two numbers of a UPS differ in the order of axes alone */
		if (code <= projected[i].last && projected[i].method != CRS_METHOD_UNKNOWN && code != 32661 && code != 32761 &&
		    is_it(code, s))
			return code;
	}
	for (unsigned code = 3942; code <= 3950; code++)
		if (is_it(code, s))
			return code;
	return 0;
}
