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

/* Unit names: "metre", "foot" (international), "us-survey-foot", "degree", "unknown". The text is
 * "EPSG:n", "EPSG:n + EPSG:m" with a vertical system, the name that the record gives, or "unknown";
 * printable ASCII. */
struct crs_info {
	enum crs_plane plane;
	char text[CRS_TEXT_SIZE];
	char unit_xy[CRS_UNIT_SIZE], unit_z[CRS_UNIT_SIZE];
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

/* All that the records say. Where both kinds are there, the preferred one decides and the other only
 * fills what it leaves open, and only if both name the same kind of plane. */
void crs_read(const struct crs_records *records, struct crs_info *ret);

/* One kind alone. True if the record said anything at all. */
bool crs_read_geokeys(const struct crs_records *records, struct crs_info *ret);
bool crs_read_wkt(const void *text, size_t size, struct crs_info *ret);

#endif
