/*
 * GeoTIFF keys as LAS carries them (OGC GeoTIFF 1.1; LAS 1.4 R15, "Georeferencing information using
 * GeoTIFF"): a directory of 16-bit entries, and two pools, of doubles and of text, which entries point into.
 *
 * Model: every lookup walks the directory, bounded by the bytes that are there; an entry that points
 * outside its pool does not exist. Codes above 32766 are user-defined or private and never EPSG. What EPSG says of
 * a number comes first, then what the keys say beside it: a unit of their own replaces the number's (the
 * false origin stays where EPSG has it), parameters of their own must be the number's, else neither counts.
 * Lengths of parameters are in the linear unit, angles in the angular unit (GeoTIFF 1.1, 7.5.4); with an
 * angular unit other than the degree, or a prime meridian other than Greenwich, no method is named.
 */
#include "crs.h"
#include "crs_parts.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "cursor.h"

enum key {
	KEY_MODEL = 1024,
	KEY_CITATION = 1026,
	KEY_GEODETIC_CRS = 2048,
	KEY_GEODETIC_CITATION = 2049,
	KEY_DATUM = 2050,
	KEY_PRIME_MERIDIAN = 2051,
	KEY_GEODETIC_LINEAR_UNITS = 2052,
	KEY_GEODETIC_LINEAR_SIZE = 2053,
	KEY_ANGULAR_UNITS = 2054,
	KEY_ANGULAR_SIZE = 2055,
	KEY_ELLIPSOID = 2056,
	KEY_SEMI_MAJOR = 2057,
	KEY_SEMI_MINOR = 2058,
	KEY_INVERSE_FLATTENING = 2059,
	KEY_PRIME_MERIDIAN_LONGITUDE = 2061,
	KEY_PROJECTED_CRS = 3072,
	KEY_PROJECTED_CITATION = 3073,
	KEY_PROJECTION = 3074,
	KEY_METHOD = 3075,
	KEY_LINEAR_UNITS = 3076,
	KEY_LINEAR_SIZE = 3077,
	KEY_STD_PARALLEL_1 = 3078,
	KEY_STD_PARALLEL_2 = 3079,
	KEY_NAT_ORIGIN_LONG = 3080,
	KEY_NAT_ORIGIN_LAT = 3081,
	KEY_FALSE_EASTING = 3082,
	KEY_FALSE_NORTHING = 3083,
	KEY_FALSE_ORIGIN_LONG = 3084,
	KEY_FALSE_ORIGIN_LAT = 3085,
	KEY_FALSE_ORIGIN_EASTING = 3086,
	KEY_FALSE_ORIGIN_NORTHING = 3087,
	KEY_CENTER_LONG = 3088,
	KEY_CENTER_LAT = 3089,
	KEY_CENTER_EASTING = 3090,
	KEY_CENTER_NORTHING = 3091,
	KEY_SCALE_AT_ORIGIN = 3092,
	KEY_SCALE_AT_CENTER = 3093,
	KEY_POLE_LONG = 3095,
	KEY_VERTICAL_CRS = 4096,
	KEY_VERTICAL_CITATION = 4097,
	KEY_VERTICAL_UNITS = 4099,
};

enum { USER_DEFINED = 32767, TAG_DOUBLES = 34736, TAG_ASCII = 34737 };

struct entry {
	uint16_t tag, count, value;
};

/* The first entry with this key. Later ones of the same key are not looked at. */
static bool find(const struct crs_records *records, unsigned key, struct entry *ret)
{
	struct cursor c = cursor_of(records->keys.at, records->keys.size);
	unsigned version = cursor_u16(&c), n;

	cursor_skip(&c, 4);
	n = cursor_u16(&c);
	if (c.bad || version != 1)
		return false;
	for (unsigned i = 0; i < n && cursor_left(&c) >= 8; i++) {
		unsigned id = cursor_u16(&c);
		struct entry e = {.tag = cursor_u16(&c)};

		e.count = cursor_u16(&c);
		e.value = cursor_u16(&c);
		if (id == key) {
			*ret = e;
			return true;
		}
	}
	return false;
}

/* A key whose value stands in the directory itself; 0, which GeoTIFF calls undefined, if there is none. */
static unsigned code(const struct crs_records *records, enum key key)
{
	struct entry e;

	return find(records, key, &e) && e.tag == 0 ? e.value : 0;
}

static bool number(const struct crs_records *records, enum key key, double *ret)
{
	struct entry e;
	struct cursor c;
	double v;

	if (!find(records, key, &e) || e.tag != TAG_DOUBLES || !e.count)
		return false;
	c = cursor_of(records->doubles.at, records->doubles.size);
	cursor_skip(&c, (size_t)e.value * 8);
	v = cursor_f64(&c);
	if (c.bad || !isfinite(v))
		return false;
	*ret = v;
	return true;
}

/* A text of the pool, without the '|' that ends each of them. False if absent, empty, or "unknown". */
static bool citation(const struct crs_records *records, enum key key, const char **ret, size_t *ret_size)
{
	struct entry e;
	const char *text;
	size_t n;

	if (!find(records, key, &e) || e.tag != TAG_ASCII)
		return false;
	if (e.value >= records->ascii.size)
		return false;
	text = (const char *)records->ascii.at + e.value;
	n = records->ascii.size - e.value;
	n = strnlen(text, e.count < n ? e.count : n);
	while (n && (text[n - 1] == '|' || text[n - 1] == ' '))
		n--;
	if (!n || (n == 7 && !strncasecmp(text, "unknown", 7)))
		return false;
	*ret = text;
	*ret_size = n;
	return true;
}

static bool is_epsg(unsigned c)
{
	return c >= 1 && c <= CRS_EPSG_MAX;
}

static enum crs_plane plane(const struct crs_records *records)
{
	switch (code(records, KEY_MODEL)) {
	case 1:
		return CRS_PLANE_PROJECTED;
	case 2:
		return CRS_PLANE_GEOGRAPHIC;
	case 3:
		return CRS_PLANE_GEOCENTRIC;
	case 0:
		break;
	default:
		return CRS_PLANE_UNKNOWN;
	}
	/* No model key: a projected system speaks for itself; a geodetic one only where nothing hints at
	 * a projection on top of it. */
	if (is_epsg(code(records, KEY_PROJECTED_CRS)))
		return CRS_PLANE_PROJECTED;
	if (is_epsg(code(records, KEY_GEODETIC_CRS)) && !code(records, KEY_PROJECTED_CRS) && !code(records, KEY_LINEAR_UNITS))
		return CRS_PLANE_GEOGRAPHIC;
	return CRS_PLANE_UNKNOWN;
}

/* "unknown" if there is no such key. */
static const char *unit(const struct crs_records *records, enum key units, enum key size, bool angle)
{
	unsigned c = code(records, units);
	double factor;

	if (c == USER_DEFINED && number(records, size, &factor))
		return angle ? crs_unit_of_angle(factor) : crs_unit_of_length(factor);
	return crs_unit_of_epsg(c);
}

static const char *unit_of_citation(const struct crs_records *records, enum key key)
{
	const char *text;
	size_t size;

	return citation(records, key, &text, &size) ? crs_unit_of_remark(text, size) : crs_unknown;
}

/* A key that names another unit than the number's, or none that is known here, replaces it. */
static void read_units(const struct crs_records *records, struct crs_info *info)
{
	static const enum key units[] = {
		[CRS_PLANE_UNKNOWN] = KEY_LINEAR_UNITS,
		[CRS_PLANE_PROJECTED] = KEY_LINEAR_UNITS,
		[CRS_PLANE_GEOGRAPHIC] = KEY_ANGULAR_UNITS,
		[CRS_PLANE_GEOCENTRIC] = KEY_GEODETIC_LINEAR_UNITS,
	};
	enum key key = units[info->plane];
	bool angle = key == KEY_ANGULAR_UNITS;
	unsigned vertical = code(records, KEY_VERTICAL_UNITS);

	if (code(records, key))
		crs_set_unit(info->unit_xy, unit(records, key, key + 1, angle));
	if (crs_is_unknown(info->unit_xy) && !code(records, key) && info->plane == CRS_PLANE_PROJECTED)
		crs_set_unit(info->unit_xy, unit_of_citation(records, KEY_PROJECTED_CITATION));
	if (crs_is_unknown(info->unit_xy) && !code(records, key) && info->plane == CRS_PLANE_PROJECTED)
		crs_set_unit(info->unit_xy, unit_of_citation(records, KEY_CITATION));
	if (info->plane == CRS_PLANE_GEOCENTRIC) {
		crs_set_unit(info->unit_z, info->unit_xy);
		return;
	}
	if (vertical)
		crs_set_unit(info->unit_z, crs_unit_of_epsg(vertical));
	else if (info->system.epsg_z)
		crs_set_unit(info->unit_z, crs_epsg_height_unit(info->system.epsg_z));
	if (!vertical && crs_is_unknown(info->unit_z))
		crs_set_unit(info->unit_z, unit_of_citation(records, KEY_VERTICAL_CITATION));
}

/* ---- the earth ---- */

static void read_ellipsoid(const struct crs_records *records, struct crs_system *s)
{
	struct crs_ellipsoid e = {0};
	double a, b, f;

	if (number(records, KEY_SEMI_MAJOR, &a) && a > 6.3e6 && a < 6.4e6) {
		if (number(records, KEY_INVERSE_FLATTENING, &f) && (f == 0 || f > 100))
			e = (struct crs_ellipsoid){a, isinf(f) ? 0 : f};
		else if (number(records, KEY_SEMI_MINOR, &b) && b > 6.3e6 && b <= a)
			e = (struct crs_ellipsoid){a, b == a ? 0 : a / (a - b)};
	}
	if (e.a == 0)
		crs_ellipsoid_of_epsg(code(records, KEY_ELLIPSOID), &e);
	s->a = e.a;
	s->inverse_flattening = e.inverse_flattening;
}

/* Reads the datum: that of the geographic system, or of the one below a projected system. */
static void read_datum(const struct crs_records *records, struct crs_system *s)
{
	struct crs_info geodetic;
	const char *text;
	size_t size;

	read_ellipsoid(records, s);
	if (crs_epsg_system(code(records, KEY_GEODETIC_CRS), &geodetic))
		crs_datum_of_name(s, (struct crs_span){geodetic.system.datum, strlen(geodetic.system.datum)});
	else
		crs_datum_of_epsg(s, code(records, KEY_DATUM));
	if (s->datum[0] || !citation(records, KEY_GEODETIC_CITATION, &text, &size))
		return;
	/* "GCS Name = NAME|Datum = ..." is how one writer puts it; another gives the bare name. */
	if (size > 11 && !strncasecmp(text, "GCS Name = ", 11)) {
		const char *end = memchr(text, '|', size);

		size = (end ? (size_t)(end - text) : size) - 11;
		text += 11;
	}
	crs_datum_of_name(s, (struct crs_span){text, size});
}

static bool is_greenwich(const struct crs_records *records)
{
	unsigned c = code(records, KEY_PRIME_MERIDIAN);
	double longitude;

	if (number(records, KEY_PRIME_MERIDIAN_LONGITUDE, &longitude) && longitude != 0)
		return false;
	return !c || c == 8901 || (c == USER_DEFINED && number(records, KEY_PRIME_MERIDIAN_LONGITUDE, &longitude));
}

/* ---- the method ---- */

static bool degrees(const struct crs_records *records)
{
	unsigned c = code(records, KEY_ANGULAR_UNITS);
	struct crs_info geodetic;

	if (c)
		return !strcmp(unit(records, KEY_ANGULAR_UNITS, KEY_ANGULAR_SIZE, true), "degree");
	/* The systems known here are all in degrees. */
	return crs_epsg_system(code(records, KEY_GEODETIC_CRS), &geodetic);
}

static enum crs_way way_of(unsigned method)
{
	switch (method) {
	case 0:
		return CRS_WAY_NONE;
	case 1:
		return CRS_WAY_TM;
	case 8:
		return CRS_WAY_LCC_2SP;
	case 9:
		return CRS_WAY_LCC_1SP;
	case 11:
		return CRS_WAY_ALBERS;
	case 15:
		return CRS_WAY_POLAR;
	default:
		return CRS_WAY_OTHER;
	}
}

/* Writers do not agree which of three origins a method has: any that is there counts, and they must not
 * contradict each other. */
static void read_params(const struct crs_records *records, double metres, struct crs_params *ret)
{
	static const struct {
		enum key key;
		enum crs_role role;
	} roles[] = {
		{KEY_STD_PARALLEL_1, CRS_LAT1},      {KEY_STD_PARALLEL_2, CRS_LAT2}, {KEY_NAT_ORIGIN_LAT, CRS_LAT0},
		{KEY_FALSE_ORIGIN_LAT, CRS_LAT0},    {KEY_CENTER_LAT, CRS_LAT0},     {KEY_NAT_ORIGIN_LONG, CRS_LON0},
		{KEY_FALSE_ORIGIN_LONG, CRS_LON0},   {KEY_CENTER_LONG, CRS_LON0},    {KEY_POLE_LONG, CRS_LON0},
		{KEY_SCALE_AT_ORIGIN, CRS_K0},       {KEY_SCALE_AT_CENTER, CRS_K0},  {KEY_FALSE_EASTING, CRS_X0},
		{KEY_FALSE_ORIGIN_EASTING, CRS_X0},  {KEY_CENTER_EASTING, CRS_X0},   {KEY_FALSE_NORTHING, CRS_Y0},
		{KEY_FALSE_ORIGIN_NORTHING, CRS_Y0}, {KEY_CENTER_NORTHING, CRS_Y0},
	};
	double v;

	memset(ret, 0, sizeof *ret);
	for (size_t i = 0; i < sizeof roles / sizeof *roles; i++)
		if (number(records, roles[i].key, &v))
			crs_param_set(ret, roles[i].role, roles[i].role == CRS_X0 || roles[i].role == CRS_Y0 ? v * metres : v);
}

/* The number of a conversion, where the system itself has none: 16001 to 16060 and 16101 to 16160 are UTM. */
static void read_projection(const struct crs_records *records, struct crs_system *s)
{
	unsigned c = code(records, KEY_PROJECTION);
	struct crs_info utm;

	if (c > 16000 && c <= 16060)
		c += 32600 - 16000;
	else if (c > 16100 && c <= 16160)
		c += 32700 - 16100;
	else
		return;
	if (!s->a || !crs_epsg_system(c, &utm))
		return;
	s->method = utm.system.method;
	s->lat0 = utm.system.lat0;
	s->lon0 = utm.system.lon0;
	s->k0 = utm.system.k0;
	s->x0 = utm.system.x0;
	s->y0 = utm.system.y0;
}

static void read_method(const struct crs_records *records, struct crs_info *info)
{
	struct crs_system own = {0}, *s = &info->system;
	double metres = crs_unit_metres(info->unit_xy);
	struct crs_params params;

	read_datum(records, &own);
	if (own.datum[0] && s->datum[0] && strcmp(own.datum, s->datum)) {
		s->method = CRS_METHOD_UNKNOWN;
		return;
	}
	if (!s->datum[0]) {
		memcpy(s->datum, own.datum, sizeof s->datum);
		s->a = own.a;
		s->inverse_flattening = own.inverse_flattening;
	}
	if (!is_greenwich(records)) {
		s->method = CRS_METHOD_UNKNOWN;
		return;
	}
	if (info->plane == CRS_PLANE_GEOGRAPHIC)
		s->method = CRS_METHOD_GEOGRAPHIC;
	if (info->plane != CRS_PLANE_PROJECTED)
		return;
	own = *s;
	own.method = CRS_METHOD_UNKNOWN;
	own.lat0 = own.lat1 = own.lat2 = 0;
	read_projection(records, &own);
	read_params(records, metres, &params);
	if (code(records, KEY_METHOD) && metres > 0 && degrees(records)) {
		own.method = CRS_METHOD_UNKNOWN;
		crs_method_settle(&own, way_of(code(records, KEY_METHOD)), &params);
	}
	if (s->method == CRS_METHOD_UNKNOWN)
		*s = own;
	else if (own.method != CRS_METHOD_UNKNOWN && !crs_system_same(s, &own))
		s->method = CRS_METHOD_UNKNOWN;
}

/* ---- the text ---- */

static bool name_of(const struct crs_records *records, bool projected, const char **ret, size_t *ret_size)
{
	return (projected && citation(records, KEY_PROJECTED_CITATION, ret, ret_size)) ||
	       citation(records, KEY_CITATION, ret, ret_size) ||
	       (!projected && citation(records, KEY_GEODETIC_CITATION, ret, ret_size));
}

/* Completes the system by its EPSG number, or without one by a name that only one system has. */
static void read_number(const struct crs_records *records, struct crs_info *info)
{
	bool projected = info->plane == CRS_PLANE_PROJECTED;
	unsigned c = code(records, projected ? KEY_PROJECTED_CRS : KEY_GEODETIC_CRS), vertical = 0;
	enum crs_plane plane = info->plane;
	struct crs_info known;
	const char *text;
	size_t size;

	if (plane == CRS_PLANE_UNKNOWN)
		return;
	if (projected && !is_epsg(c) && name_of(records, true, &text, &size))
		c = crs_epsg_of_name(text, size);
	if (!is_epsg(c))
		return;
	crs_epsg_compound(c, &c, &vertical);
	info->system.epsg = c;
	info->system.epsg_z = vertical;
	if (crs_epsg_system(c, &known) && known.plane == plane) {
		*info = known;
		info->system.epsg_z = vertical;
		snprintf(info->text, sizeof info->text, "%s", crs_unknown);
	}
}

static void read_text(const struct crs_records *records, struct crs_info *info)
{
	struct crs_system *s = &info->system;
	const char *text;
	size_t size;

	if (!s->epsg && info->plane == CRS_PLANE_PROJECTED && s->a > 0)
		s->epsg = crs_epsg_of_system(s);
	if (s->epsg)
		crs_text_append_epsg(info, s->epsg);
	else if (name_of(records, info->plane == CRS_PLANE_PROJECTED, &text, &size))
		crs_text_append(info, text, size);
	if (crs_is_unknown(info->text))
		return;
	if (s->epsg_z)
		crs_text_append_epsg(info, s->epsg_z);
	else if (citation(records, KEY_VERTICAL_CITATION, &text, &size))
		crs_text_append(info, text, size);
}

/* "ESRI PE String = PROJCS[...]": the whole system in a citation. */
static bool read_pe_string(const struct crs_records *records, struct crs_info *ret)
{
	static const char head[] = "ESRI PE String = ";
	const char *text;
	size_t size, n = sizeof head - 1;

	return (citation(records, KEY_PROJECTED_CITATION, &text, &size) || citation(records, KEY_CITATION, &text, &size)) &&
	       size > n && !strncasecmp(text, head, n) && crs_read_wkt(text + n, size - n, ret);
}

bool crs_read_geokeys(const struct crs_records *records, struct crs_info *ret)
{
	struct crs_info blank, pe;

	crs_info_clear(ret);
	crs_info_clear(&blank);
	ret->plane = plane(records);
	read_number(records, ret);
	if (!ret->system.epsg_z && is_epsg(code(records, KEY_VERTICAL_CRS)))
		ret->system.epsg_z = code(records, KEY_VERTICAL_CRS);
	read_units(records, ret);
	if (!ret->system.epsg && ret->plane == CRS_PLANE_PROJECTED && read_pe_string(records, &pe) && pe.plane == ret->plane) {
		unsigned vertical = ret->system.epsg_z;

		if (crs_is_unknown(pe.unit_z))
			crs_set_unit(pe.unit_z, ret->unit_z);
		*ret = pe;
		if (vertical && !pe.system.epsg_z) {
			ret->system.epsg_z = vertical;
			crs_text_append_epsg(ret, vertical);
		}
	} else {
		read_method(records, ret);
		read_text(records, ret);
	}
	crs_info_settle(ret);
	return memcmp(ret, &blank, sizeof blank) != 0;
}
