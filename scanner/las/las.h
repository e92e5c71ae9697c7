/*
 * LAS 1.4, written forwards: what is to stand in the header must be known before the first point. Points of format 6: 30
 * bytes, GPS time, intensity, one return of one. The system stands there as WKT. No clock and no chance: the same points, system
 * and id are the same bytes.
 */
#ifndef LAS_H
#define LAS_H

#include <stddef.h>
#include <stdint.h>

#include "crs.h"

struct err;

enum { LAS_RECORD = 30, LAS_HEAD_MAX = 375 + 54 + 4096, LAS_WKT_MAX = 4096 };

/* Coordinates are numbers of millimetres (thousandths of the plane's unit) on an offset of whole millions, which the first point
 * decides: points of one survey mostly share it, and all such files map exactly onto each other's lattices. */
struct las_frame {
	int64_t offset[3]; /* whole units */
};
struct las_frame las_frame_of(const double first[3]);
/* Rounded to the nearest thousandth. -ERR_LIMIT: further than 2147 km (of units: 2147483) from the offset. */
int las_place(const struct las_frame *, const double at[3], int32_t ret[3], struct err *);

/* What the first pass finds. */
struct las_summary {
	uint64_t points;
	int32_t min[3], max[3];
};
void las_summary_add(struct las_summary *, const int32_t at[3]);

struct las_params {
	const struct crs_info *system;
	uint8_t id[16]; /* of the project: where it comes from */
	int64_t made_s; /* day and year of the file; UTC since 1970 */
	struct las_frame frame;
	struct las_summary summary;
};
/* The header and the record of the system, which come before the points. -ERR_UNSUPPORTED: a system that no WKT says so
 * that it is read as the same again. */
int las_head(const struct las_params *, uint8_t ret[LAS_HEAD_MAX], size_t *ret_size, struct err *);
/* `gps_s`: adjusted GPS time. Intensity 0 to 1; NAN: 0, as LAS says "unknown". */
void las_record(uint8_t ret[LAS_RECORD], const int32_t at[3], float intensity, double gps_s);

/* The WKT 1 that engine/crs reads as this very system; *ret_size 0: nothing is known of it. */
int las_wkt(const struct crs_info *, char ret[LAS_WKT_MAX], size_t *ret_size, struct err *);

#endif
