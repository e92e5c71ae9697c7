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
#include "lattice.h"

struct err;

/* ---- the earth under a plane ---- */

struct crs_geo; /* one thread at a time */
/* -ERR_UNSUPPORTED: the system's method, ellipsoid or unit is not known (the message names which). */
int crs_geo_new(const struct crs_system *, struct crs_geo **ret, struct err *err);
struct crs_geo *crs_geo_free(struct crs_geo *);
/* Plane coordinates in the system's own unit, and back. */
int crs_geo_reverse(const struct crs_geo *, double x, double y, double *ret_lat, double *ret_lon,
		    struct err *err);
int crs_geo_forward(const struct crs_geo *, double lat, double lon, double *ret_x, double *ret_y,
		    struct err *err);
/* Geodesic polygon of n plane positions: square metres, metres around it. */
int crs_geo_area(const struct crs_geo *, const double (*xy)[2], size_t n, double *ret_area,
		 double *ret_perimeter, struct err *err);
/* The MGRS square of a place, e.g. "31TFJ8549" at `digits` (0 to 5) digits an axis. */
int crs_geo_mgrs(double lat, double lon, int digits, char *buf, size_t size, struct err *err);

/* ---- UTM and UPS zones ---- */

struct crs_zone {
	int number;    /* 1 to 60; 0: UPS */
	bool north;
};
int crs_zone_of(double lat, double lon, struct crs_zone *ret, struct err *err);
bool crs_zone_parse(const char *text, struct crs_zone *ret); /* "32N", "32n", "0S" for UPS south */
char *crs_zone_text(struct crs_zone, char buf[8]);
/* The system of that zone on the datum of a geographic one: text ("EPSG:32632" where it has a number), units,
 * plane. -ERR_UNSUPPORTED for ellipsoids other than WGS84 and GRS80. */
int crs_zone_system(const struct crs_info *geographic, struct crs_zone, struct crs_info *ret, struct err *err);

/* ---- geoid grids (GeographicLib's PGM) ---- */

struct crs_geoid; /* one thread at a time: it keeps the last cells read */
/* The file is checked whole by crs_geoid_check; opening checks the header. Heights by the cubic method. */
int crs_geoid_open(const char *path, struct crs_geoid **ret, struct err *err);
struct crs_geoid *crs_geoid_close(struct crs_geoid *);
int crs_geoid_height(struct crs_geoid *, double lat, double lon, double *ret, struct err *err);
struct crs_geoid_info {
	char description[128], date[64];
	unsigned width, height;
	double rms_error, max_error; /* cubic, as the grid's author says; NAN: not said */
};
int crs_geoid_check(const char *path, struct crs_geoid_info *ret, struct err *err);

/* ---- the step from a file's numbers to the lattice's, where it is not a map of numbers ---- */

enum crs_geoid_way { CRS_TO_ORTHOMETRIC, CRS_TO_ELLIPSOIDAL };
struct crs_step_params {
	const struct crs_info *from;        /* of the file */
	const struct crs_info *to;          /* of the dataset; the same plane: only heights change */
	const char *geoid_path;             /* NULL: heights stay */
	enum crs_geoid_way way;
	const struct lattice *lattice;
	const struct lattice_input *coords; /* of the file */
};
/* One of its own for each thread. What a point becomes depends on that point, the systems, the grid and the
 * lattice only. Lattice numbers are floor(v / scale - k + 1/2). */
struct crs_step;
int crs_step_new(const struct crs_step_params *, struct crs_step **ret, struct err *err);
struct crs_step *crs_step_free(struct crs_step *);
/* -ERR_LIMIT or -ERR_INPUT: number *ret_bad cannot be projected or does not fit. */
int crs_step_apply(struct crs_step *, const int64_t (*raw)[3], size_t n, int32_t (*ret)[3], size_t *ret_bad,
		   struct err *err);
/* What the geoid added to the heights so far, in metres; n 0: nothing. */
struct crs_shift {
	uint64_t n;
	double min, max, sum;
};
struct crs_shift crs_step_shift(const struct crs_step *);
/* The coordinates that a file has after the step: box and scales for lattice_choose. Degrees at scale s become
 * metres at the power of ten below s * 111 km, a digit finer. */
int crs_step_coords(const struct crs_step_params *, struct lattice_input *ret, struct err *err);

#endif
