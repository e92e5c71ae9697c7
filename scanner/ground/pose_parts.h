/* What the files of this room share. Internal. */
#ifndef POSE_PARTS_H
#define POSE_PARTS_H

#include "ground.h"

/* ---- lines of the file (pose_lines.c) ---- */

enum { POSE_BUFFER = 64 << 10 };
struct pose_lines {
	int fd;
	const char *name;
	uint64_t at;   /* offset in the file behind the buffer */
	uint64_t line; /* number of the last line returned */
	size_t i, n;
	bool ended;
	struct digest_stream *hash; /* hashes all that is read; may be NULL */
	char buf[POSE_BUFFER];
};
void pose_lines_start(struct pose_lines *, int fd, const char *name, uint64_t offset);
/* 1: a line without its end, zero-terminated, which begins at *ret_offset; empty lines and lines that begin with # are
 * skipped. 0: the end. */
int pose_lines_next(struct pose_lines *, char **ret, uint64_t *ret_offset, struct err *);

/* ---- rows (pose_row.c) ---- */

enum pose_column {
	POSE_TIME,
	POSE_EASTING,
	POSE_NORTHING,
	POSE_LATITUDE,
	POSE_LONGITUDE,
	POSE_HEIGHT,
	POSE_ELLIPSOIDAL_HEIGHT,
	POSE_ROLL,
	POSE_PITCH,
	POSE_HEADING,
	POSE_COLUMNS
};
enum { POSE_FIELDS_MAX = 64 };
struct pose_form {
	char comma;
	unsigned fields;
	int column[POSE_FIELDS_MAX]; /* of each field; -1: ignored */
	bool degrees, ellipsoidal;
	enum pose_clock clock;
	double offset_s;
};
struct pose_row {
	double time;     /* UTC */
	double at[3];    /* x, y, z: easting, northing or longitude, latitude; height */
	double angle[3]; /* roll, pitch, heading: degrees */
};
/* Reads the line of names. This and pose_row_read change the line. */
int pose_form_read(char *line, struct pose_form *, struct err *);
int pose_row_read(const struct pose_form *, char *line, struct pose_row *ret, struct err *);

/* ---- rotations (pose_turn.c): quaternions w, x, y, z ---- */

void pose_turn_of(const double angle[3], double ret[4]);                               /* degrees; body to north-east-down */
void pose_turn_between(const double a[4], const double b[4], double t, double ret[4]); /* along the shorter rotation */
void pose_turn_matrix(const double q[4], double ret[3][3]);

/* ---- into the plane (pose_plane.c) ---- */

struct crs_geo;
struct pose_plane {
	struct crs_info system; /* of the points */
	struct crs_geo *geo;    /* NULL: not needed */
	bool degrees, grid_scale;
	bool true_north;  /* headings are relative to true north */
	double metres[2]; /* metres in a unit of xy, of z */
	char zone[8];
};
struct pose_box { /* of all rows */
	double min[2], max[2];
};
int pose_plane_choose(const struct pose_params *, const struct pose_form *, const struct pose_box *, const char *name,
		      struct pose_plane *ret, struct err *);
void pose_plane_clear(struct pose_plane *);

struct pose_node {
	double time, at[3], turn[4], scale;
};
int pose_plane_put(const struct pose_plane *, const struct pose_row *, struct pose_node *ret, struct err *);

#endif
