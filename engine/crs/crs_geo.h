/*
 * Geodesy: GeographicLib behind C. Latitudes and longitudes are degrees, lengths metres, heights as said.
 * Nothing throws; a point outside of what a projection can do is an error that says so, never a wrong number.
 */
#ifndef CRS_GEO_H
#define CRS_GEO_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "crs.h"
#include "digest.h"
#include "lattice.h"

struct err;

/* ---- the earth under a plane ---- */

struct crs_geo; /* constant once made: several threads may use it */
/* -ERR_UNSUPPORTED: the system's method, ellipsoid or unit is not known (the message names which). Of a conic
 * lat0, lon0 is the origin; with one standard parallel that is lat0 and lat1 = lat2 = 0. A polar stereographic
 * has scale k0 at the pole lat0 (90 or -90), or, if lat1 is not 0, at that parallel. */
int crs_geo_new(const struct crs_system *, struct crs_geo **ret, struct err *err);
struct crs_geo *crs_geo_free(struct crs_geo *);
/* Plane coordinates in the system's own unit, and back. -ERR_INPUT: no place on the earth, or more than the
 * projection can do (transverse Mercator: 45 degrees from its meridian). */
int crs_geo_reverse(const struct crs_geo *, double x, double y, double *ret_lat, double *ret_lon, struct err *err);
int crs_geo_forward(const struct crs_geo *, double lat, double lon, double *ret_x, double *ret_y, struct err *err);
/* Geodesic polygon of n plane positions in order, either way round: square metres, metres around it. */
int crs_geo_area(const struct crs_geo *, const double (*xy)[2], size_t n, double *ret_area, double *ret_perimeter,
		 struct err *err);
/* The MGRS square of a place, e.g. "31TFJ8549" at `digits` (0 to 5) digits an axis. */
int crs_geo_mgrs(double lat, double lon, int digits, char *buf, size_t size, struct err *err);

/* ---- UTM and UPS zones ---- */

struct crs_zone {
	int number; /* 1 to 60; 0: UPS */
	bool north;
};
/* The standard zone: UTM from 80 S to below 84 N with the exceptions of Norway and Svalbard, UPS beyond. */
int crs_zone_of(double lat, double lon, struct crs_zone *ret, struct err *err);
bool crs_zone_parse(const char *text, struct crs_zone *ret); /* "32N", "32n"; "UPS-S" or "0S" for UPS south */
char *crs_zone_text(struct crs_zone, char buf[8]);           /* "32N", "UPS-S" */
/* What acut projects with a zone; beyond it a point is refused. UTM: so many degrees from the meridian of the
 * zone, either hemisphere; UPS: from this latitude to the pole. */
enum { CRS_ZONE_UTM_DEGREES = 15, CRS_ZONE_UPS_LATITUDE = 60 };
/* The system of that zone on the datum of a geographic one: text ("EPSG:32632" where it has a number), units,
 * plane. -ERR_UNSUPPORTED for ellipsoids other than WGS84 and GRS80. */
int crs_zone_system(const struct crs_info *geographic, struct crs_zone, struct crs_info *ret, struct err *err);
/* The zone of the datum of `geographic` whose system has this text. */
bool crs_zone_of_text(const struct crs_info *geographic, const char *text, struct crs_zone *ret);
/* Degrees that crs_zone_system and a step can project: -ERR_UNSUPPORTED names what is not known. */
int crs_zone_datum(const struct crs_info *geographic, struct err *err);
/* The zone of all boxes of degrees together (x longitude, y latitude), whatever their order: of the middle of
 * the narrowest range of longitudes that holds them, across 180 degrees too. Boxes that are not finite or
 * inside out are ignored; if none is left, or one is not degrees, -ERR_INPUT names it. */
int crs_zone_choose(const struct lattice_input *boxes, size_t n, struct crs_zone *ret, struct err *err);

/* ---- geoid grids (GeographicLib's PGM) ---- */

struct crs_geoid; /* one thread at a time: it keeps the last cell read, and never more of the grid */
/* The file is checked whole by crs_geoid_check; opening checks the header. Heights by the cubic method: metres
 * of the geoid above the ellipsoid. The name ends in ".pgm". */
int crs_geoid_open(const char *path, struct crs_geoid **ret, struct err *err);
struct crs_geoid *crs_geoid_close(struct crs_geoid *);
int crs_geoid_height(struct crs_geoid *, double lat, double lon, double *ret, struct err *err);
/* Memory of an open grid, at most, whatever its size. */
enum { CRS_GEOID_BYTES = 32 * 1024 };
struct crs_geoid_info {
	char description[128], date[64];
	struct digest hash; /* of the file */
	uint64_t bytes;
	double min, max; /* metres */
	unsigned width, height;
	double rms_error, max_error; /* cubic, as the grid's author says; NAN: not said */
};
/* Reads the whole file: header, size, every height between -250 and 250 m. `name` is what messages call it. */
int crs_geoid_check(int fd, const char *name, struct crs_geoid_info *ret, struct err *err);

/* ---- the step from a file's numbers to the lattice's, where it is not a map of numbers ---- */

enum crs_geoid_way { CRS_TO_ORTHOMETRIC, CRS_TO_ELLIPSOIDAL };
struct crs_step_params {
	const struct crs_info *from; /* of the file */
	const struct crs_info *to;   /* of the dataset; NULL: the file's own plane, only heights change */
	const char *geoid_path;      /* NULL: heights stay */
	enum crs_geoid_way way;
	const struct lattice *lattice;
	const struct lattice_input *coords; /* of the file */
};
/* One of its own for each thread. What a point becomes depends on that point, the systems, the grid and the
 * lattice only: it is computed in the cell of a fixed raster that the point lies in, from a polynomial whose
 * distance from GeographicLib's own answer is below two micrometres. Lattice numbers are floor(v / scale - k + 1/2). */
struct crs_step;
size_t crs_step_bytes(void); /* all that a step takes */
/* -ERR_UNSUPPORTED: degrees to a plane that is not a UTM or UPS zone of their datum; a geoid, and the unit of
 * heights or the place on the earth is not known. */
int crs_step_new(const struct crs_step_params *, struct crs_step **ret, struct err *err);
struct crs_step *crs_step_free(struct crs_step *);
/* -ERR_LIMIT or -ERR_INPUT: number *ret_bad cannot be projected or does not fit. */
int crs_step_apply(struct crs_step *, const int64_t (*raw)[3], size_t n, int32_t (*ret)[3], size_t *ret_bad, struct err *err);
/* What the geoid added to the heights so far, in metres; n 0: nothing. The sum is of whole micrometres, so
 * that it does not depend on the order of points. */
struct crs_shift {
	uint64_t n;
	double min, max;
	int64_t sum_um;
};
struct crs_shift crs_step_shift(const struct crs_step *);
void crs_shift_add(struct crs_shift *sum, const struct crs_shift *part);
/* The coordinates that a file has after the step: box and scales for lattice_choose (params->lattice is not
 * looked at). Degrees at scale s become metres at the power of ten below s * 111 km, a digit finer, but not
 * finer than 0.1 mm; heights that a geoid shifts get at least a scale of 1 mm. */
int crs_step_coords(const struct crs_step_params *, struct lattice_input *ret, struct err *err);

#endif
