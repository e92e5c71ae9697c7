/*
 * GeoTIFF keys as LAS carries them (OGC GeoTIFF 1.1; LAS 1.4 R15, "Georeferencing information using
 * GeoTIFF"): a directory of 16-bit entries, and two pools, of doubles and of text, which entries point into.
 *
 * Model: every lookup walks the directory, bounded by the bytes that are there; an entry that points
 * outside its pool does not exist. Codes above 32766 are user-defined or private and never EPSG.
 */
#include "crs.h"
#include "crs_parts.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "cursor.h"

enum key {
	KEY_MODEL = 1024,
	KEY_CITATION = 1026,
	KEY_GEODETIC_CRS = 2048,
	KEY_GEODETIC_CITATION = 2049,
	KEY_GEODETIC_LINEAR_UNITS = 2052,
	KEY_GEODETIC_LINEAR_SIZE = 2053,
	KEY_ANGULAR_UNITS = 2054,
	KEY_ANGULAR_SIZE = 2055,
	KEY_PROJECTED_CRS = 3072,
	KEY_PROJECTED_CITATION = 3073,
	KEY_LINEAR_UNITS = 3076,
	KEY_LINEAR_SIZE = 3077,
	KEY_VERTICAL_CRS = 4096,
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
		struct entry e = { .tag = cursor_u16(&c) };

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
	if (!n || (n == 7 && !memcmp(text, "unknown", 7)))
		return false;
	*ret = text;
	*ret_size = n;
	return true;
}

static bool is_epsg(unsigned c)
{
	return c >= 1 && c < USER_DEFINED;
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
	if (is_epsg(code(records, KEY_GEODETIC_CRS)) && !code(records, KEY_PROJECTED_CRS) &&
	    !code(records, KEY_LINEAR_UNITS))
		return CRS_PLANE_GEOGRAPHIC;
	return CRS_PLANE_UNKNOWN;
}

static const char *unit(const struct crs_records *records, enum key units, enum key size, bool angle,
			unsigned system)
{
	unsigned c = code(records, units);
	double factor;

	if (c == USER_DEFINED && number(records, size, &factor))
		return angle ? crs_unit_of_angle(factor) : crs_unit_of_length(factor);
	if (c)
		return crs_unit_of_epsg(c);
	return is_epsg(system) ? crs_unit_of_system(system) : crs_unknown;
}

static void read_units(const struct crs_records *records, struct crs_info *info)
{
	unsigned geodetic = code(records, KEY_GEODETIC_CRS), vertical = code(records, KEY_VERTICAL_UNITS);
	const char *xy = crs_unknown;

	if (info->plane == CRS_PLANE_PROJECTED || info->plane == CRS_PLANE_UNKNOWN) {
		xy = unit(records, KEY_LINEAR_UNITS, KEY_LINEAR_SIZE, false, code(records, KEY_PROJECTED_CRS));
	} else if (info->plane == CRS_PLANE_GEOGRAPHIC) {
		xy = unit(records, KEY_ANGULAR_UNITS, KEY_ANGULAR_SIZE, true, 0);
		/* EPSG defines these three (NAD83, ETRS89, WGS 84) in degrees. */
		if (!code(records, KEY_ANGULAR_UNITS) &&
		    (geodetic == 4269 || geodetic == 4258 || geodetic == 4326))
			xy = "degree";
	} else {
		xy = unit(records, KEY_GEODETIC_LINEAR_UNITS, KEY_GEODETIC_LINEAR_SIZE, false, 0);
	}
	crs_set_unit(info->unit_xy, xy);
	if (info->plane == CRS_PLANE_GEOCENTRIC)
		crs_set_unit(info->unit_z, xy);
	else
		crs_set_unit(info->unit_z, vertical ? crs_unit_of_epsg(vertical)
						    : crs_unit_of_system(code(records, KEY_VERTICAL_CRS)));
}

static void append_epsg(struct crs_info *info, unsigned c)
{
	char text[24];

	crs_text_append(info, " + ", text, (size_t)snprintf(text, sizeof text, "EPSG:%u", c));
}

static void read_text(const struct crs_records *records, struct crs_info *info)
{
	bool projected = info->plane == CRS_PLANE_PROJECTED;
	unsigned system = code(records, projected ? KEY_PROJECTED_CRS : KEY_GEODETIC_CRS);
	const char *text;
	size_t size;

	if (info->plane != CRS_PLANE_UNKNOWN && is_epsg(system))
		append_epsg(info, system);
	else if ((projected && citation(records, KEY_PROJECTED_CITATION, &text, &size)) ||
		 citation(records, KEY_CITATION, &text, &size) ||
		 (!projected && citation(records, KEY_GEODETIC_CITATION, &text, &size)))
		crs_text_append(info, "", text, size);
	if (strcmp(info->text, crs_unknown) && is_epsg(code(records, KEY_VERTICAL_CRS)))
		append_epsg(info, code(records, KEY_VERTICAL_CRS));
}

bool crs_read_geokeys(const struct crs_records *records, struct crs_info *ret)
{
	struct crs_info blank;

	crs_info_clear(ret);
	crs_info_clear(&blank);
	ret->plane = plane(records);
	read_units(records, ret);
	read_text(records, ret);
	return memcmp(ret, &blank, sizeof blank) != 0;
}
