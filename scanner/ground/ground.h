/*
 * From ranges to ground: where the head was at each shot, and where the shot hit. Poses are a CSV; between two of
 * them positions are interpolated linearly in the plane and attitudes on the shorter way; GeographicLib turns geodetic
 * ones into the plane. No clock, no USB, no socket here.
 *
 * Frames: body x ahead, y right, z down; roll, pitch, heading (from north, clockwise) as Tait-Bryan angles in the order
 * heading, pitch, roll. The plane: x east, y north, z up.
 */
#ifndef GROUND_H
#define GROUND_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;
struct crs_info;
struct profile;
struct sweep;

enum pose_clock { POSE_UTC, POSE_GPS }; /* seconds since 1970 in UTC, or adjusted GPS time (less 10^9) / ISO texts */

struct pose_params {
	const struct crs_info *to;   /* plane of the points; NULL: as the file has it, or the UTM zone of its middle */
	const char *utm;             /* zone by hand; NULL */
	enum pose_clock clock;
	double gap_s;                /* poses further apart than this are a gap */
	double offset_s;             /* added to the times of the poses */
};
struct pose_track;
/* Columns by the names of the first line. -ERR_INPUT with the line: no number, time not rising, unknown column, both
 * or neither of plane and degrees. */
int pose_track_read(int fd, const char *name, const struct pose_params *, struct pose_track **ret, struct err *);
struct pose_track *pose_track_free(struct pose_track *);
const struct crs_info *pose_track_system(const struct pose_track *);
void pose_track_span(const struct pose_track *, size_t *ret_poses, double *ret_first, double *ret_last);

struct pose {
	double at[3];       /* plane, metres */
	double body[3][3];  /* body to east, north, up; grid convergence is in it for geodetic poses */
};
/* false: the time is in no stretch of the track. */
bool pose_track_at(const struct pose_track *, double utc_s, struct pose *ret);

struct ground_counts {
	uint64_t sweeps, shots, points;
	uint64_t no_return, out_of_range, no_pose; /* shots that are no points, and why */
};
struct ground_point {
	double at[3];
	double utc_s;
	float intensity;     /* 0 to 1; NAN */
};
/* `utc_s` of the sweep's first shot. The sink's non-zero answer ends it. */
int ground_sweep(const struct profile *, const struct pose_track *, const struct sweep *, double utc_s,
		 struct ground_counts *counts, int (*sink)(void *ctx, const struct ground_point *), void *ctx);

#endif
