/* Shared by the geodetic files of this room; nobody else includes it. */
#ifndef CRS_GEO_PARTS_H
#define CRS_GEO_PARTS_H

struct err;

/* Inside a catch: what was thrown, as an error about `what`. */
int crs_geo_caught(struct err *err, const char *what);
/* to - from in degrees, -180 to 180, rounded once. Finite numbers. */
double crs_geo_angle(double from, double to);

/* Width and height of a grid, from its header. */
int crs_geoid_size(const char *path, unsigned *ret_width, unsigned *ret_height, struct err *err);

#endif
