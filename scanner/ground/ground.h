/*
 * From ranges to ground: where the head was at each shot, and where the shot hit. Poses are a CSV (acut-pose(5)); between
 * two of them positions are interpolated linearly in the plane and attitudes on the shorter way; GeographicLib turns
 * geodetic ones into the plane. No clock, no USB, no socket here.
 *
 * Frames: body x ahead, y right, z down; roll, pitch, heading (from north, clockwise) as Tait-Bryan angles in the order
 * heading, pitch, roll: body to north-east-down is Rz(heading) Ry(pitch) Rx(roll). The plane: x east, y north, z up.
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

/* UTC, as seconds since 1970 (POSIX), to adjusted GPS time as LAS has it, and back; leap seconds up to 2017 (18 s since). */
double pose_gps_of_utc(double utc_s);
double pose_utc_of_gps(double gps_s);
/* A number of seconds, or ISO 8601: 2026-05-04T10:00:00.25Z, with Z, +02:00 or nothing (the clock's own). False: neither, or
 * one that says Z or an offset where the clock is not UTC. */
bool pose_time_parse(const char *text, enum pose_clock, double *ret_utc_s);

/* ---- poses ---- */

enum pose_north { POSE_NORTH_AS_POSED, POSE_NORTH_TRUE, POSE_NORTH_GRID };

struct pose_params {
	const struct crs_info *to;      /* plane of the points; NULL: poses in degrees go to a UTM or UPS zone, others stay in
					   a plane of which nothing is known but that its unit is the metre */
	const struct crs_info *degrees; /* of latitude and longitude; NULL: WGS 84 */
	const char *utm;                /* zone by hand; NULL: of the middle of all poses */
	enum pose_clock clock;
	enum pose_north north; /* of headings; AS_POSED: true north in degrees, grid north in a plane */
	bool grid_scale;       /* lengths are scaled as the plane scales them where the head is */
	double gap_s;          /* poses further apart than this are a gap; 0: POSE_GAP_S */
	double offset_s;       /* added to the times of the poses */
};
#define POSE_GAP_S 1.5

struct pose_track;
/* A regular file (the caller's, open as long as the track): all of it is read and checked once, then kept only as an index
 * of at most POSE_INDEX_MAX places; the rows around the time that is asked for are read again. Columns by the names of
 * the first line. -ERR_INPUT with the line: no number, time not rising, unknown column, both or neither of plane and
 * degrees. -ERR_UNSUPPORTED: degrees that cannot go to that plane. */
enum { POSE_INDEX_MAX = 4096, POSE_LINE_MAX = 4096 };
int pose_track_read(int fd, const char *name, const struct pose_params *, struct pose_track **ret, struct err *);
struct pose_track *pose_track_free(struct pose_track *);
/* Plane, units and heights of the points: heights are ellipsoidal if the poses say so (EPSG:5030 or 5019), else as `to`
 * has them. */
const struct crs_info *pose_track_system(const struct pose_track *);
struct pose_span {
	uint64_t poses, gaps;
	double first, last; /* UTC */
	bool degrees, ellipsoidal;
	char zone[8];       /* that degrees were projected to; "": `to` said where to */
	struct digest hash; /* XXH3-128 of the file's bytes */
};
const struct pose_span *pose_track_span(const struct pose_track *);

struct pose {
	double at[3];      /* plane, its own units */
	double body[3][3]; /* metres of the body to east, north, up in those units; convergence is in it */
};
enum pose_found { POSE_HERE, POSE_BEFORE, POSE_AFTER, POSE_GAP };
/* One of them; *ret is set if it is POSE_HERE. Quick where the time is near the one before. -ERR_CHANGED: the file did. */
int pose_track_at(struct pose_track *, double utc_s, struct pose *ret, struct err *);

/* ---- points ---- */

struct ground_counts {
	uint64_t sweeps, shots, points;
	/* Shots that are no points, and why: shots = points + all of these. */
	uint64_t no_return, out_of_range, before, after, gap;
	uint64_t too_far; /* of whoever keeps the points: not within what a file can hold; they are no points then */
};
struct ground_point {
	double at[3]; /* plane, its own units */
	double utc_s;
	float intensity; /* 0 to 1; NAN */
};
/* `utc_s` of the sweep's first shot. The sink's non-zero answer ends it. */
int ground_sweep(const struct profile *, struct pose_track *, const struct sweep *, double utc_s, struct ground_counts *counts,
		 int (*sink)(void *ctx, const struct ground_point *), void *ctx, struct err *);

#endif
