/*
 * From ranges to ground: where the head was at each shot, and where the shot hit. Poses are a CSV file (acut-pose(5)).
 * Between two poses, positions are interpolated linearly in the plane and attitudes along the shorter rotation;
 * GeographicLib projects geodetic poses to the plane.
 *
 * Frames: body x ahead, y right, z down; roll, pitch, heading (from north, clockwise) are Tait-Bryan angles in the
 * order heading, pitch, roll: body to north-east-down is Rz(heading) Ry(pitch) Rx(roll). Plane: x east, y north, z up.
 */
#ifndef GROUND_H
#define GROUND_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "crs.h"
#include "digest.h"

struct err;
struct profile;
struct sweep;

/* ---- times ---- */

enum pose_clock { POSE_UTC, POSE_GPS }; /* seconds since 1970 in UTC, or adjusted GPS time (less 10^9); ISO texts of it */

/* UTC as seconds since 1970 (POSIX) to adjusted GPS time, as in LAS, and back; leap seconds up to 2017 (18 s since then). */
double pose_gps_of_utc(double utc_s);
double pose_utc_of_gps(double gps_s);
/* A number of seconds, or ISO 8601: 2026-05-04T10:00:00.25Z, with Z, +02:00 or nothing (the clock's own). False:
 * neither, or Z or an offset although the clock is not UTC. */
bool pose_time_parse(const char *text, enum pose_clock, double *ret_utc_s);

/* ---- poses ---- */

enum pose_north { POSE_NORTH_AS_POSED, POSE_NORTH_TRUE, POSE_NORTH_GRID };

struct pose_params {
	/* plane of the points; NULL: poses in degrees are projected to a UTM or UPS zone, others stay in a plane of
	 * which only the unit, metre, is known */
	const struct crs_info *to;
	const struct crs_info *degrees; /* of latitude and longitude; NULL: WGS 84 */
	const char *utm;                /* zone chosen by the user; NULL: that of the middle of all poses */
	enum pose_clock clock;
	enum pose_north north; /* of headings; AS_POSED: true north for poses in degrees, grid north for a plane */
	bool grid_scale;       /* scales lengths by the plane's scale at the head */
	double gap_s;          /* poses farther apart than this are a gap; 0: POSE_GAP_S */
	double offset_s;       /* added to the times of the poses */
	/* called now and then while the file is read, with its bytes; true: it ends with -ERR_CANCELLED. NULL: nobody is told */
	bool (*told)(void *ctx, uint64_t bytes, uint64_t size);
	void *ctx;
};
#define POSE_GAP_S 1.5

struct pose_track;
/* A regular file (the caller's, open as long as the track). It is read and checked completely once; only an index of at
 * most POSE_INDEX_MAX entries is kept, and the rows near a requested time are read again. The first line names the
 * columns. -ERR_INPUT with the line: not a number, time not ascending, unknown column, both or neither of plane and
 * degrees. -ERR_UNSUPPORTED: degrees that cannot be projected to that plane. */
enum { POSE_INDEX_MAX = 4096, POSE_LINE_MAX = 4096 };
int pose_track_read(int fd, const char *name, const struct pose_params *, struct pose_track **ret, struct err *);
struct pose_track *pose_track_free(struct pose_track *);
/* Plane, units and heights of the points: heights are ellipsoidal if the poses say so (EPSG:5030 or 5019), else those
 * of `to`. */
const struct crs_info *pose_track_system(const struct pose_track *);
struct pose_span {
	uint64_t poses, gaps;
	double first, last; /* UTC */
	bool degrees, ellipsoidal;
	char zone[8];       /* to which degrees were projected; "": `to` has the projection */
	struct digest hash; /* XXH3-128 of the file's bytes */
};
const struct pose_span *pose_track_span(const struct pose_track *);

struct pose {
	double at[3]; /* in the plane, in its units */
	/* east, north, up, in those units, of a metre along each axis of the body; includes the convergence */
	double body[3][3];
};
enum pose_found { POSE_HERE, POSE_BEFORE, POSE_AFTER, POSE_GAP };
/* The pose at a time; *ret is set if it is POSE_HERE. Fast if the time is near the previous one. -ERR_CHANGED: the file
 * changed. */
int pose_track_at(struct pose_track *, double utc_s, struct pose *ret, struct err *);

/* ---- points ---- */

struct ground_counts {
	uint64_t sweeps, shots, points;
	/* Shots that are not points, by reason: shots = points + all of these. */
	uint64_t no_return, out_of_range, before, after, gap;
	uint64_t too_far; /* by the consumer of the points: not representable in its file */
};
struct ground_point {
	double at[3]; /* in the plane, in its units */
	double utc_s;
	float intensity; /* 0 to 1; NAN: unknown */
};
/* `utc_s`: of the sweep's first shot. A non-zero result of the sink ends it. */
int ground_sweep(const struct profile *, struct pose_track *, const struct sweep *, double utc_s, struct ground_counts *counts,
		 int (*sink)(void *ctx, const struct ground_point *), void *ctx, struct err *);

#endif
