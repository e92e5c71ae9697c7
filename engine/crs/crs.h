/*
 * The coordinate system of a file: kind of plane, units, name. All of it comes from the records of the file and is never guessed.
 * A property that no record has, or on which two parts of a record disagree, is "unknown". Nothing here fails: for invalid bytes
 * everything is "unknown".
 */
#ifndef CRS_H
#define CRS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum crs_plane { CRS_PLANE_UNKNOWN, CRS_PLANE_PROJECTED, CRS_PLANE_GEOGRAPHIC, CRS_PLANE_GEOCENTRIC };

#define CRS_UNIT_SIZE 16
#define CRS_TEXT_SIZE 512

/*
 * How a plane lies on the earth, where the record says it or EPSG defines it: what crs_geo.h computes with.
 * A method is named only if everything that it needs is known: ellipsoid, prime meridian of Greenwich, every
 * parameter. Which fields of crs_system a method uses:
 *   geographic             none
 *   transverse Mercator    lat0 lon0 (natural origin), k0, x0 y0
 *   Lambert conic          lat0 lon0 (false or natural origin), lat1 lat2 (the same where there is one parallel),
 *                          k0 (on them; 1 where there are two), x0 y0
 *   Albers                 lat0 lon0, lat1 lat2, x0 y0
 *   polar stereographic    lat0 90 or -90, lon0 (the meridian that points down or up), lat1 the latitude of true
 *                          scale, or lat1 == lat0 and k0 the scale at the pole; x0 y0 of the pole
 * Axis order: some systems are defined northing first or latitude first. LAS is not: there x is always the
 * easting or longitude, y the northing or latitude, whatever the text of the system says of its axes; so the
 * order of AXIS is not looked at, only the units.
 */
enum crs_method {
	CRS_METHOD_UNKNOWN,
	CRS_METHOD_GEOGRAPHIC,
	CRS_METHOD_TRANSVERSE_MERCATOR,
	CRS_METHOD_LAMBERT_CONIC,
	CRS_METHOD_ALBERS,
	CRS_METHOD_POLAR_STEREOGRAPHIC,
};

struct crs_system {
	enum crs_method method;
	unsigned epsg, epsg_z;         /* 0: none said */
	char datum[64];                /* "WGS 84", "NAD83", "ETRS89", ... or as the record has it; "": not said */
	double a, inverse_flattening;  /* metres; a 0: ellipsoid unknown; inverse_flattening 0: a sphere */
	double lat0, lon0, lat1, lat2; /* degrees, east of Greenwich */
	double k0, x0, y0;             /* scale; false origin in metres */
	double unit;                   /* metres of one unit of x and y, degrees of a geographic one; 0: unknown */
	double unit_z;                 /* metres of one unit of z; 0: unknown */
};

/*
 * Unit names: "metre", "foot" (international, 0.3048 m), "us-survey-foot" (1200/3937 m), "degree", "unknown".
 * Units that have none of these names (links, grads, Indian feet) are "unknown". The unit of z is that of the
 * vertical system or of the third axis, or what the vertical unit key says: no specification lets it follow from
 * the horizontal one, so where it is not said it is unknown. The text is "EPSG:n", "EPSG:n + EPSG:m" with a
 * vertical system, the name that the record gives in place of a number, or "unknown"; printable ASCII, and
 * " + " stands nowhere else in it. A system that is told by parameters, and is one that EPSG numbers and this
 * room knows, gets that number.
 */
struct crs_info {
	enum crs_plane plane;
	char text[CRS_TEXT_SIZE];
	char unit_xy[CRS_UNIT_SIZE], unit_z[CRS_UNIT_SIZE];
	struct crs_system system;
};

/* The records of one file, as they lie in it; size 0 where there is none. */
struct crs_bytes {
	const void *at;
	size_t size;
};

struct crs_records {
	struct crs_bytes keys;    /* GeoTIFF GeoKeyDirectoryTag, 34735 */
	struct crs_bytes doubles; /* GeoDoubleParamsTag, 34736 */
	struct crs_bytes ascii;   /* GeoAsciiParamsTag, 34737 */
	struct crs_bytes wkt;     /* OGC WKT 1 or WKT 2 */
	bool prefer_wkt;          /* LAS: global encoding bit 4 */
};

/* All unknown. */
void crs_info_clear(struct crs_info *);
/* After a change by hand: system.unit and unit_z by the names of the units; a method without ellipsoid is none. */
void crs_info_settle(struct crs_info *);
/* Method, parameters and ellipsoid, to 0.1 mm on the ground; names do not count. */
bool crs_system_same(const struct crs_system *, const struct crs_system *);

/* All that the records say. Where both kinds are there, the preferred one decides and the other only
 * fills what it leaves open, and only if both name the same kind of plane. */
void crs_read(const struct crs_records *records, struct crs_info *ret);

/* One kind alone. True if the record said anything at all. */
bool crs_read_geokeys(const struct crs_records *records, struct crs_info *ret);
bool crs_read_wkt(const void *text, size_t size, struct crs_info *ret);

struct err;

/* What a person says of a file that says nothing: "EPSG:25832" or 25832, "EPSG:25832 + EPSG:7837", a whole WKT (of `size`
 * bytes), or a name as the records have it. -ERR_USAGE: empty, a number that this room does not know, a WKT that cannot be read,
 * not printable. */
int crs_assume_text(const char *text, size_t size, struct crs_info *ret, struct err *err);
/* "m", "ft", "ftUS" (and the names above) to a unit name; NULL: no such unit. */
const char *crs_assume_unit(const char *text);

/* A text has two halves, "EPSG:1 + EPSG:2": where that of the heights begins, at its " + " (NULL: there is none), and that of the
 * plane. */
const char *crs_text_heights(const char *text);
void crs_text_plane(const char *text, char ret[CRS_TEXT_SIZE]);

/* Units that the EPSG numbers in a text imply, where they are unknown. */
void crs_text_units(const char *text, char unit_xy[CRS_UNIT_SIZE], char unit_z[CRS_UNIT_SIZE]);

/* ---- crs_keep.c: the text of a system, to be kept ---- */

enum { CRS_WKT_MAX = 32768 };
/* A WKT in one line of UTF-8, without the blanks between its words. Its size; 0: no WKT that can be read, or larger than
 * CRS_WKT_MAX. The result may take the place of the text. */
size_t crs_wkt_normal(const void *text, size_t size, char ret[CRS_WKT_MAX + 1]);
/* Which part of a WKT holds where the system has this text and these units: all of it; its horizontal system alone, where the
 * heights are others; nothing (size 0). It points into `wkt`. */
struct crs_bytes crs_wkt_holds(const char *wkt, const char *crs, const char *unit_xy, const char *unit_z);

/* The name that EPSG gives the system of a number; "": it is in no table. */
const char *crs_epsg_name(unsigned code);
/* In words, else "": where EPSG has other units for the numbers of a system than it has, or such as have no name here; and
 * numbers that are in no table, or of a system of another kind. */
void crs_epsg_remark(const struct crs_info *, char *ret, size_t size);

/* Metres of a length unit by its name; 0: it is none. */
double crs_unit_metres(const char *name);

#endif
