/*
 * Shots to points: from the sensor to the vehicle's body by the profile's mount angles and lever arm, and from the body
 * to the plane by the pose at the time of the shot (a moving head is elsewhere at the end of a sweep).
 *
 * The sensor's axes are those of a body: x ahead (angle 0 of the scan plane), y right, z down; angles of the scan
 * increase to the left. Mount angles rotate it like roll, pitch and heading rotate the body: all 0 is a horizontal scan
 * plane that looks ahead.
 */
#include <math.h>

#include "decoder.h"
#include "err.h"
#include "ground.h"
#include "pose_parts.h"
#include "profile.h"

#define TURN 6.283185307179586476925

struct mount {
	double turn[3][3];
	const double *lever;
};

static struct mount mount_of(const struct profile *p)
{
	const double angle[3] = {p->mount_roll, p->mount_pitch, p->mount_heading};
	struct mount m = {.lever = p->lever};
	double q[4];

	pose_turn_of(angle, q);
	pose_turn_matrix(q, m.turn);
	return m;
}

static void hit(const struct mount *m, const struct pose *pose, double angle, double range, double ret[3])
{
	double ahead = range * cos(angle), right = -range * sin(angle), body[3];

	for (int i = 0; i < 3; i++)
		body[i] = m->lever[i] + m->turn[i][0] * ahead + m->turn[i][1] * right;
	for (int i = 0; i < 3; i++)
		ret[i] = pose->at[i] + pose->body[i][0] * body[0] + pose->body[i][1] * body[1] + pose->body[i][2] * body[2];
}

static bool in_range(const struct profile *p, float range)
{
	return range >= p->range_min && (p->range_max <= 0 || range <= p->range_max);
}

static void count_miss(struct ground_counts *c, int found)
{
	c->before += found == POSE_BEFORE;
	c->after += found == POSE_AFTER;
	c->gap += found == POSE_GAP;
}

int ground_sweep(const struct profile *p, struct pose_track *track, const struct sweep *s, double utc_s,
		 struct ground_counts *counts, int (*sink)(void *ctx, const struct ground_point *), void *ctx, struct err *err)
{
	const struct mount mount = mount_of(p);
	double each = fabs(s->step) / TURN * s->period_s;

	counts->sweeps++;
	counts->shots += s->shots;
	for (uint32_t i = 0; i < s->shots; i++) {
		struct ground_point point = {.utc_s = utc_s + i * each, .intensity = s->intensity[i]};
		struct pose pose;
		int r;

		if (!isfinite(s->range[i]) || s->range[i] <= 0) {
			counts->no_return++;
			continue;
		}
		if (!in_range(p, s->range[i])) {
			counts->out_of_range++;
			continue;
		}
		r = pose_track_at(track, point.utc_s, &pose, err);
		if (r < 0)
			return r;
		if (r != POSE_HERE) {
			count_miss(counts, r);
			continue;
		}
		hit(&mount, &pose, s->first + i * s->step, s->range[i], point.at);
		counts->points++;
		r = sink(ctx, &point);
		if (r)
			return r;
	}
	return 0;
}
