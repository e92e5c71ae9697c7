/* Poses from a text, and one shot to the ground. */
#ifndef GROUND_TRY_H
#define GROUND_TRY_H

#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "decoder.h"
#include "err.h"
#include "ground.h"
#include "profile.h"

static inline int try_file(const char *text, size_t size)
{
	char path[] = "/tmp/acut-pose-XXXXXX";
	int fd = mkstemp(path);

	assert_true(fd >= 0);
	unlink(path);
	assert_int_equal(write(fd, text, size), size);
	return fd;
}

/* -code; the descriptor stays open until the program ends. */
static inline int try_read(const char *text, const struct pose_params *p, struct pose_track **ret, struct err *err)
{
	static const struct pose_params none = {0};

	*err = ERR_INIT;
	return pose_track_read(try_file(text, strlen(text)), "poses.csv", p ? p : &none, ret, err);
}

static inline struct pose_track *try_track(const char *text, const struct pose_params *p)
{
	struct pose_track *t = NULL;
	struct err err;
	int r = try_read(text, p, &t, &err);

	if (r)
		fail_msg("%s (%s)", err.message, err.hint);
	return t;
}

static inline struct pose try_pose(struct pose_track *t, double time)
{
	struct err err = ERR_INIT;
	struct pose pose;

	assert_int_equal(pose_track_at(t, time, &pose, &err), POSE_HERE);
	return pose;
}

struct try_points {
	struct ground_point at[64];
	size_t n;
};

static inline int try_take(void *ctx, const struct ground_point *p)
{
	struct try_points *t = ctx;

	if (t->n < 64)
		t->at[t->n] = *p;
	t->n++;
	return 0;
}

/* Where a shot of that range in that direction of the scan plane (degrees, to the left) hits. */
static inline void try_shot(const struct profile *p, struct pose_track *t, double time, double degrees, float range,
			    double ret[3])
{
	struct err err = ERR_INIT;
	struct ground_counts counts = {0};
	struct try_points got = {.n = 0};
	float one = range, none = NAN;
	struct sweep s = {.first = degrees * 0.017453292519943295, .step = 0.01, .shots = 1, .range = &one, .intensity = &none};

	assert_int_equal(ground_sweep(p, t, &s, time, &counts, try_take, &got, &err), 0);
	assert_int_equal(got.n, 1);
	memcpy(ret, got.at[0].at, 3 * sizeof *ret);
}

static inline void try_near(const double got[3], double x, double y, double z, double most)
{
	if (!(fabs(got[0] - x) <= most && fabs(got[1] - y) <= most && fabs(got[2] - z) <= most))
		fail_msg("%.7f %.7f %.7f, not %.7f %.7f %.7f", got[0], got[1], got[2], x, y, z);
}

#endif
