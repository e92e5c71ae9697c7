/*
 * The systems that EPSG numbers.
 *
 * Model: of each there is a row in a table that is made of PROJ's database (crs_table.h), with name, kind, units and
 * datum. How a projection is computed is not in it: that stands here, for UTM on the usual datums and for national
 * grids of one zone, and what has no row here has no method. What EPSG defines is a fact of the number; a number that
 * is in no table stays a number, with nothing known of it.
 */
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "crs_parts.h"
#include "crs_table.h"

/* A range of numbers is a series of zones: the first has `lon0`, each further one is 6 degrees to the east. */
struct projected {
	unsigned first, last;
	enum crs_method method; /* UNKNOWN: it has names alone */
	double lat0, lon0, lat1, lat2, k0, x0, y0;
	const char *names; /* plain, of EPSG and ESRI, separated by spaces; NULL: a series, or none */
};

#define TM CRS_METHOD_TRANSVERSE_MERCATOR
#define UTM(first, last, zone, y0)                                                    \
	{                                                                             \
		first, last, TM, 0, -183 + 6 * (zone), 0, 0, 0.9996, 500000, y0, NULL \
	}
#define LCC CRS_METHOD_LAMBERT_CONIC
#define POLAR CRS_METHOD_POLAR_STEREOGRAPHIC
#define OTHER CRS_METHOD_UNKNOWN

static const struct projected projected[] = {
	UTM(32601, 32660, 1, 0), /* WGS 84 */
	UTM(32701, 32760, 1, 10000000),
	UTM(26901, 26923, 1, 0),  /* NAD83 */
	UTM(25828, 25838, 28, 0), /* ETRS89 */
	UTM(6330, 6348, 1, 0),    /* NAD83(2011) */
	UTM(3708, 3726, 1, 0),    /* NAD83(NSRS2007) */
	UTM(3740, 3749, 10, 0),   /* NAD83(HARN) */
	UTM(2955, 2957, 11, 0),   /* NAD83(CSRS), in four pieces */
	UTM(2958, 2962, 17, 0),
	UTM(3154, 3157, 7, 0),
	UTM(3158, 3160, 14, 0),
	UTM(26701, 26722, 1, 0),  /* NAD27 */
	UTM(23028, 23038, 28, 0), /* ED50 */
	UTM(32201, 32260, 1, 0),  /* WGS 72 */
	UTM(32301, 32360, 1, 10000000),
	UTM(28348, 28358, 48, 10000000), /* GDA94 / MGA */
	UTM(7846, 7859, 46, 10000000),   /* GDA2020 / MGA */
	{2154, 2154, LCC, 46.5, 3, 49, 44, 1, 700000, 6600000, "rgf93lambert93 rgf93v1lambert93 rgf1993lambert93"},
	{3034, 3034, LCC, 52, 10, 35, 65, 1, 4000000, 2800000, "etrs89extendedlcceurope"},
	{2991, 2991, LCC, 41.75, -120.5, 43, 45.5, 1, 400000, 0, "nad83oregonlccm"},
	{3978, 3978, LCC, 49, -95, 49, 77, 1, 0, 0, "nad83canadaatlaslambert"},
	{3979, 3979, LCC, 49, -95, 49, 77, 1, 0, 0, "nad83csrscanadaatlaslambert"},
	{5070, 5070, CRS_METHOD_ALBERS, 23, -96, 29.5, 45.5, 1, 0, 0, "nad83conusalbers"},
	{6350, 6350, CRS_METHOD_ALBERS, 23, -96, 29.5, 45.5, 1, 0, 0, "nad832011conusalbers"},
	{27700, 27700, TM, 49, -2, 0, 0, 0.9996012717, 400000, -100000, "osgb36britishnationalgrid osgb1936britishnationalgrid"},
	{2193, 2193, TM, 0, 173, 0, 0, 0.9996, 1600000, 10000000, "nzgd2000newzealandtransversemercator2000"},
	{3067, 3067, TM, 0, 27, 0, 0, 0.9996, 500000, 0, "etrs89tm35finen"},
	{5041, 5041, POLAR, 90, 0, 90, 0, 0.994, 2000000, 2000000, "wgs84upsnorthen"},
	{5042, 5042, POLAR, -90, 0, -90, 0, 0.994, 2000000, 2000000, "wgs84upssouthen"},
	{32661, 32661, POLAR, 90, 0, 90, 0, 0.994, 2000000, 2000000, "wgs84upsnorthne"},
	{32761, 32761, POLAR, -90, 0, -90, 0, 0.994, 2000000, 2000000, "wgs84upssouthne"},
	{3031, 3031, POLAR, -90, 0, -71, 0, 1, 0, 0, "wgs84antarcticpolarstereographic"},
	{3413, 3413, POLAR, 90, -45, 70, 0, 1, 0, 0, "wgs84nsidcseaicepolarstereographicnorth"},
	{3035, 3035, OTHER, 0, 0, 0, 0, 0, 0, 0, "etrs89laeaeurope"}, /* its name of before */
};

#define N(table) (sizeof(table) / sizeof *(table))

/* ---- the table ---- */

static const struct crs_table_row *row_of(unsigned code)
{
	unsigned from = 0, to = crs_table_n;

	while (from < to) {
		unsigned at = from + (to - from) / 2;

		if (crs_table_rows[at].code == code)
			return &crs_table_rows[at];
		if (crs_table_rows[at].code < code)
			from = at + 1;
		else
			to = at;
	}
	return NULL;
}

/* By the names of crs.h; "unknown" for a unit that has none of them. */
static const char *unit_of(unsigned unit)
{
	return unit ? crs_unit_of_epsg(crs_table_units[unit].code) : crs_unknown;
}

const char *crs_epsg_name(unsigned code)
{
	const struct crs_table_row *row = row_of(code);

	return row ? crs_table_text + row->name : "";
}

/* ---- methods ---- */

static void fill_method(const struct projected *row, unsigned code, struct crs_system *s)
{
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
static bool method_of_cc(unsigned code, struct crs_system *s)
{
	struct projected row = {code, code, LCC, 0, 3, 0, 0, 1, 1700000, 0, NULL};

	if (code < 3942 || code > 3950)
		return false;
	row.lat0 = code - 3900;
	row.lat1 = row.lat0 - 0.75;
	row.lat2 = row.lat0 + 0.75;
	row.y0 = (row.lat0 - 41) * 1000000 + 200000;
	fill_method(&row, code, s);
	return true;
}

static void method_of(unsigned code, struct crs_system *s)
{
	for (size_t i = 0; !method_of_cc(code, s) && i < N(projected); i++)
		if (code >= projected[i].first && code <= projected[i].last)
			fill_method(&projected[i], code, s);
}

/* ---- systems ---- */

static bool fill(const struct crs_table_row *row, struct crs_info *ret)
{
	const char *unit = unit_of(row->unit);

	switch (row->kind) {
	case CRS_TABLE_PROJECTED:
		ret->plane = CRS_PLANE_PROJECTED;
		method_of(row->code, &ret->system);
		break;
	case CRS_TABLE_GEOGRAPHIC:
	case CRS_TABLE_GEOGRAPHIC_3D:
		ret->plane = CRS_PLANE_GEOGRAPHIC;
		ret->system.method = CRS_METHOD_GEOGRAPHIC;
		break;
	case CRS_TABLE_GEOCENTRIC:
		ret->plane = CRS_PLANE_GEOCENTRIC;
		break;
	default:
		return false;
	}
	crs_set_unit(ret->unit_xy, unit);
	crs_set_unit(ret->unit_z, unit_of(row->unit_z));
	/* nothing is computed with angles that are no degrees */
	if (ret->plane != CRS_PLANE_GEOGRAPHIC || !crs_is_unknown(unit))
		crs_datum_of_epsg(&ret->system, row->first);
	return true;
}

bool crs_epsg_system(unsigned code, struct crs_info *ret)
{
	const struct crs_table_row *row = row_of(code);
	struct crs_info made;

	crs_info_clear(&made);
	if (!row || !fill(row, &made))
		return false;
	made.system.epsg = code;
	crs_text_append_epsg(&made, code);
	crs_info_settle(&made);
	*ret = made;
	return true;
}

const char *crs_epsg_height_unit(unsigned code)
{
	const struct crs_table_row *row = row_of(code);

	return row && row->kind == CRS_TABLE_VERTICAL ? unit_of(row->unit_z) : crs_unknown;
}

bool crs_epsg_compound(unsigned code, unsigned *ret_horizontal, unsigned *ret_vertical)
{
	const struct crs_table_row *row = row_of(code);

	if (!row || row->kind != CRS_TABLE_COMPOUND)
		return false;
	*ret_horizontal = row->first;
	*ret_vertical = row->second;
	return true;
}

/* ---- what a number says otherwise ---- */

/* One sentence behind those of before, if the unit that holds is not that of the number. */
static void remark(const struct crs_table_row *row, unsigned at, const char *what, const char *holds, char *ret, size_t size)
{
	size_t n = strlen(ret);
	const char *name;

	if (!row || !at || (!crs_is_unknown(unit_of(at)) && !strcmp(unit_of(at), holds)))
		return;
	name = crs_is_unknown(unit_of(at)) ? crs_table_text + crs_table_units[at].name : unit_of(at);
	if (crs_is_unknown(holds) && crs_is_unknown(unit_of(at)))
		snprintf(ret + n, size - n, "%sEPSG:%u (%s) is in the unit %s, which acut does not know", n ? "; " : "",
			 row->code, crs_table_text + row->name, name);
	else
		snprintf(ret + n, size - n, "%s%s taken as %s, but EPSG:%u (%s) is in the unit %s", n ? "; " : "", what, holds,
			 row->code, crs_table_text + row->name, name);
}

/* The numbers that GeoTIFF 1.0 has of ellipsoids and vertical datums stand in vertical keys, and in no table of systems. */
static bool is_of_geotiff(unsigned code)
{
	return (code >= 5001 && code <= 5035) || (code >= 5101 && code <= 5299);
}

bool crs_epsg_known(unsigned code, bool vertical)
{
	return row_of(code) || (vertical && is_of_geotiff(code));
}

/* True: there is a word about it, that it is none, or one of the other kind. */
static bool wrong_number(unsigned code, bool vertical, char *ret, size_t size)
{
	const struct crs_table_row *row = row_of(code);
	size_t n = strlen(ret);

	/* heights above the ellipsoid of a system with three axes */
	bool three = row && row->kind == CRS_TABLE_GEOGRAPHIC_3D;

	if (!code || (vertical && (three || is_of_geotiff(code))) || (row && (row->kind == CRS_TABLE_VERTICAL) == vertical))
		return false;
	if (row)
		snprintf(ret + n, size - n, "%sEPSG:%u (%s) is %s", n ? "; " : "", code, crs_table_text + row->name,
			 vertical ? "no system of heights" : "a system of heights, not of x and y");
	else
		snprintf(ret + n, size - n, "%sEPSG:%u is no system that acut knows of EPSG: check the number", n ? "; " : "",
			 code);
	return true;
}

void crs_epsg_remark(const struct crs_info *info, char *ret, size_t size)
{
	const struct crs_table_row *plane = row_of(info->system.epsg), *heights = row_of(info->system.epsg_z);

	*ret = 0;
	if (wrong_number(info->system.epsg, false, ret, size))
		plane = NULL;
	if (wrong_number(info->system.epsg_z, true, ret, size))
		heights = NULL;
	remark(plane, plane ? plane->unit : 0, "x and y are", info->unit_xy, ret, size);
	if (heights)
		remark(heights, heights->unit_z, "z is", info->unit_z, ret, size);
	else
		remark(plane, plane ? plane->unit_z : 0, "z is", info->unit_z, ret, size);
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

/* Whether that is the name, but for capitals and marks. */
static bool same_plain(const char *name, const char *plain)
{
	for (; *name; name++) {
		unsigned char c = (unsigned char)*name;

		if (isalnum(c) && tolower(c) != *plain++)
			return false;
	}
	return !*plain;
}

/* The only projected system of that name; one that is in use before those that are not. */
static unsigned table_of_name(const char *plain)
{
	unsigned found[2] = {0}, n[2] = {0};

	for (unsigned i = 0; i < crs_table_n; i++) {
		const struct crs_table_row *row = &crs_table_rows[i];

		if (row->kind == CRS_TABLE_PROJECTED && same_plain(crs_table_text + row->name, plain)) {
			found[row->deprecated] = row->code;
			n[row->deprecated]++;
		}
	}
	return n[0] == 1 ? found[0] : !n[0] && n[1] == 1 ? found[1] : 0;
}

unsigned crs_epsg_of_name(const char *name, size_t size)
{
	char plain[128];
	unsigned code;
	size_t n = strlen(crs_text_plain((struct crs_span){name, size}, plain, sizeof plain));

	if (!n)
		return 0;
	for (size_t i = 0; i < N(projected); i++) {
		const char *at = projected[i].names;

		for (; at && (at = strstr(at, plain)); at += n)
			if ((at == projected[i].names || at[-1] == ' ') && (!at[n] || at[n] == ' '))
				return projected[i].first;
	}
	code = utm_of_name(plain);
	return code ? code : table_of_name(plain);
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
