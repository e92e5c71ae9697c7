/*
 * What a file says of its coordinate system: what kind of plane, which units, which name. Read off the
 * file's own records, never guessed: what no record says, or what two parts of one record contradict, is
 * "unknown". Nothing here fails: any bytes give an answer, at worst "unknown" for all of it.
 */
#ifndef CRS_H
#define CRS_H

#include <stdbool.h>
#include <stddef.h>

enum crs_plane { CRS_PLANE_UNKNOWN, CRS_PLANE_PROJECTED, CRS_PLANE_GEOGRAPHIC, CRS_PLANE_GEOCENTRIC };

#define CRS_UNIT_SIZE 16
#define CRS_TEXT_SIZE 512

/* How a plane lies on the earth, where the record says it or EPSG defines it: what crs_geo.h computes with. */
enum crs_method {
	CRS_METHOD_UNKNOWN,
	CRS_METHOD_GEOGRAPHIC,
	CRS_METHOD_TRANSVERSE_MERCATOR,
	CRS_METHOD_LAMBERT_CONIC,       /* one or two standard parallels */
	CRS_METHOD_ALBERS,
	CRS_METHOD_POLAR_STEREOGRAPHIC,
};

struct crs_system {
	enum crs_method method;
	unsigned epsg, epsg_z;          /* 0: none said */
	char datum[64];                 /* "WGS 84", "NAD83", ...; "" if none is said */
	double a, inverse_flattening;   /* metres; a 0: ellipsoid unknown */
	double lat0, lon0, lat1, lat2;  /* degrees, east of Greenwich */
	double k0, x0, y0;              /* scale; false origin in metres */
	double unit;                    /* metres of one unit of x and y (degrees of a geographic one); 0: unknown */
	double unit_z;                  /* metres of one unit of z; 0: unknown */
};

/* Unit names: "metre", "foot" (international), "us-survey-foot", "degree", "unknown". The text is
 * "EPSG:n", "EPSG:n + EPSG:m" with a vertical system, the name that the record gives, or "unknown";
 * printable ASCII. */
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

/* All that the records say. Where both kinds are there, the preferred one decides and the other only
 * fills what it leaves open, and only if both name the same kind of plane. */
void crs_read(const struct crs_records *records, struct crs_info *ret);

/* One kind alone. True if the record said anything at all. */
bool crs_read_geokeys(const struct crs_records *records, struct crs_info *ret);
bool crs_read_wkt(const void *text, size_t size, struct crs_info *ret);

#endif
