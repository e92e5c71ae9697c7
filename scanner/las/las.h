/*
 * Writing LAS 1.4 sequentially: what the header contains must be known before the first point. Points of format 6: 30
 * bytes, GPS time, intensity, one return of one. The coordinate system is WKT. The same points, system and id give the
 * same bytes.
 */
#ifndef LAS_H
#define LAS_H

#include <stddef.h>
#include <stdint.h>

#include "crs.h"

struct err;

enum { LAS_RECORD = 30, LAS_HEAD_MAX = 375 + 54 + 4096, LAS_WKT_MAX = 4096 };

/* Coordinates are numbers of millimetres (thousandths of the plane's unit) relative to an offset of whole millions,
 * from the first point. The points of one survey usually share the offset, and all such files map exactly to each
 * other's lattices. */
struct las_frame {
	int64_t offset[3]; /* whole units */
};
struct las_frame las_frame_of(const double first[3]);
/* Rounded to the nearest thousandth. -ERR_LIMIT: farther than 2147 km (2147483 units) from the offset. */
int las_place(const struct las_frame *, const double at[3], int32_t ret[3], struct err *);

/* Result of the first pass. */
struct las_summary {
	uint64_t points;
	int32_t min[3], max[3];
};
void las_summary_add(struct las_summary *, const int32_t at[3]);

struct las_params {
	const struct crs_info *system;
	uint8_t id[16]; /* project id */
	int64_t made_s; /* the file's day and year; UTC since 1970 */
	struct las_frame frame;
	struct las_summary summary;
};
/* The header and the record of the coordinate system, which precede the points. -ERR_UNSUPPORTED: no WKT of the system
 * is read back as the same system. */
int las_head(const struct las_params *, uint8_t ret[LAS_HEAD_MAX], size_t *ret_size, struct err *);
/* `gps_s`: adjusted GPS time. Intensity 0 to 1; NAN: 0, which means "unknown" in LAS. */
void las_record(uint8_t ret[LAS_RECORD], const int32_t at[3], float intensity, double gps_s);

/* WKT 1 that engine/crs reads back as exactly this system; *ret_size 0: nothing is known of it. */
int las_wkt(const struct crs_info *, char ret[LAS_WKT_MAX], size_t *ret_size, struct err *);

#endif
