/*
 * Shots to the ground, against results that do not use the room's formulas: axes by hand, a floor and a wall seen from
 * a rolling vehicle, convergence from the geometry of the projection.
 */
#include "ground_try.h"

#include "crs_geo.h"

#define PLANE "time,easting,northing,height,roll,pitch,heading\n"
#define RADIAN 0.017453292519943295

static struct pose_track *still(double roll, double pitch, double heading)
{
	char text[256];

	snprintf(text, sizeof text, PLANE "0,100,200,50,%.10g,%.10g,%.10g\n1,100,200,50,%.10g,%.10g,%.10g\n", roll, pitch,
		 heading, roll, pitch, heading);
	return try_track(text, NULL);
}

static void shoot(const struct profile *p, double roll, double pitch, double heading, double angle, double x, double y, double z)
{
	struct pose_track *t = still(roll, pitch, heading);
	double got[3];

	try_shot(p, t, 0.5, angle, 10, got);
	pose_track_free(t);
	try_near(got, 100 + x, 200 + y, 50 + z, 1e-9);
}

/* Each angle of the vehicle alone. Heading is from north over east; nose up is a pitch above 0; right side down is a
 * roll above 0. */
static void vehicle(void **state)
{
	const struct profile p = {0};
	const double half = 10 * sqrt(0.5);

	shoot(&p, 0, 0, 0, 0, 0, 10, 0);   /* ahead is north */
	shoot(&p, 0, 0, 0, 90, -10, 0, 0); /* angles run to the left */
	shoot(&p, 0, 0, 90, 0, 10, 0, 0);
	shoot(&p, 0, 0, 180, 90, 10, 0, 0);
	shoot(&p, 0, 0, -45, 0, -half, half, 0);
	shoot(&p, 0, 90, 0, 0, 0, 0, 10);
	shoot(&p, 0, 45, 90, 0, half, 0, half);
	shoot(&p, 90, 0, 0, 90, 0, 0, 10); /* the left side goes up */
	shoot(&p, 45, 0, 0, 90, -half, 0, half);
	shoot(&p, 45, 0, 0, -90, half, 0, -half);
	shoot(&p, 30, 90, 30, 0, 0, 0, 10); /* the pole of the convention */
	shoot(&p, 0, -90, 77, 0, 0, 0, -10);
	/* the order: heading, then pitch, then roll. Heading 90, pitch 90: the nose up, the left side north. */
	shoot(&p, 0, 90, 90, 90, 0, 10, 0);
	shoot(&p, 90, 90, 90, 90, -10, 0, 0); /* and the roll around the nose: the left side points where the roof was, west */
}

/* Each angle of the mount alone: it rotates the sensor like the vehicle's angle. */
static void mounts(void **state)
{
	const struct profile roll = {.mount_roll = 90}, pitch = {.mount_pitch = -90}, heading = {.mount_heading = 90},
			     back = {.mount_heading = 180, .mount_roll = 90};

	shoot(&roll, 0, 0, 0, 0, 0, 10, 0);
	shoot(&roll, 0, 0, 0, 90, 0, 0, 10);
	shoot(&roll, 0, 0, 90, -90, 0, 0, -10);
	shoot(&pitch, 0, 0, 0, 0, 0, 0, -10);
	shoot(&pitch, 0, 0, 0, 90, -10, 0, 0);
	shoot(&pitch, 0, 0, 90, 90, 0, 10, 0);
	shoot(&heading, 0, 0, 0, 0, 10, 0, 0);
	shoot(&heading, 0, 0, 0, 90, 0, 10, 0);
	shoot(&back, 0, 0, 0, 0, 0, -10, 0);
	shoot(&back, 0, 0, 0, 90, 0, 0, 10);
}

/* Ahead, right, down. */
static void lever(void **state)
{
	const struct profile p = {.lever = {1, 2, 3}};

	shoot(&p, 0, 0, 0, 0, 2, 11, -3);
	shoot(&p, 0, 0, 90, 0, 11, -2, -3);
	shoot(&p, 0, 90, 0, 0, 2, 3, 11);
	shoot(&p, 90, 0, 0, 0, -3, 11, -2);
	shoot(&p, 0, 0, 180, 0, -2, -11, -3);
}

static void north_is_crossed(void **state)
{
	static const struct {
		double from, to, middle;
	} of[] = {{359, 1, 0}, {1, 359, 0}, {350, 20, 5}, {-10, 350, -10}, {181, 179, 180}};
	const struct profile p = {0};

	for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
		char text[256];
		struct pose_track *t;
		double got[3];

		snprintf(text, sizeof text, PLANE "0,0,0,0,0,0,%g\n1,0,0,0,0,0,%g\n", of[i].from, of[i].to);
		t = try_track(text, NULL);
		try_shot(&p, t, 0.5, 0, 10, got);
		try_near(got, 10 * sin(of[i].middle * RADIAN), 10 * cos(of[i].middle * RADIAN), 0, 1e-9);
		pose_track_free(t);
	}
}

/* ---- a moving vehicle ---- */

/* Its position, and its attitude in degrees: smooth, known at all times. */
static void drive(double t, double at[3], double angle[3])
{
	at[0] = 500000 + 8 * t;
	at[1] = 5400000 + 20 * sin(t / 4);
	at[2] = 300 + 0.2 * sin(t);
	angle[0] = 6 * sin(1.7 * t);
	angle[1] = 4 * sin(1.1 * t + 1);
	angle[2] = 355 + 20 * sin(t / 3);
}

/* Rz(heading) Ry(pitch) Rx(roll), multiplied out by hand from the three matrices; a direction of the body to east, north, up. */
static void turned(const double angle[3], const double v[3], double ret[3])
{
	double r = angle[0] * RADIAN, p = angle[1] * RADIAN, h = angle[2] * RADIAN, a[3], b[3], c[3];

	a[0] = v[0], a[1] = cos(r) * v[1] - sin(r) * v[2], a[2] = sin(r) * v[1] + cos(r) * v[2];
	b[0] = cos(p) * a[0] + sin(p) * a[2], b[1] = a[1], b[2] = -sin(p) * a[0] + cos(p) * a[2];
	c[0] = cos(h) * b[0] - sin(h) * b[1], c[1] = sin(h) * b[0] + cos(h) * b[1], c[2] = b[2];
	ret[0] = c[1], ret[1] = c[0], ret[2] = -c[2];
}

static struct pose_track *drive_sweep(double seconds, int hz)
{
	char *text = malloc((size_t)(seconds * hz + 2) * 160 + 100), *to = text;
	struct pose_track *t;

	to += sprintf(to, PLANE);
	for (int i = 0; i <= seconds * hz; i++) {
		double at[3], angle[3];

		drive((double)i / hz, at, angle);
		to += sprintf(to, "%.9f,%.6f,%.6f,%.6f,%.9f,%.9f,%.9f\n", (double)i / hz, at[0], at[1], at[2], angle[0], angle[1],
			      fmod(angle[2], 360));
	}
	t = try_track(text, NULL);
	free(text);
	return t;
}

struct seen {
	int axis;
	double at, worst;
	uint64_t n;
};

static int look_at_plane(void *ctx, const struct ground_point *p)
{
	struct seen *s = ctx;

	s->worst = fmax(s->worst, fabs(p->at[s->axis] - s->at));
	s->n++;
	return 0;
}

/* A plane (constant x, y or z) seen from the moving vehicle, with the ranges that a sensor would measure. It must come
 * out flat to 1 mm, although the vehicle rolls and pitches within each sweep. */
static void see_plane(const struct profile *p, int axis, double place, double least, double most_range)
{
	enum { SHOTS = 180, SWEEPS = 150 };
	static float range[SHOTS], intensity[SHOTS];
	const double mount[3] = {p->mount_roll, p->mount_pitch, p->mount_heading}, period = 1 / 15.0;
	struct pose_track *t = drive_sweep(11, 200);
	struct seen seen = {.axis = axis, .at = place};
	struct ground_counts counts = {0};
	struct err err = ERR_INIT;

	for (int k = 0; k < SWEEPS; k++) {
		struct sweep s = {.first = -1.5,
				  .step = 0.0166,
				  .shots = SHOTS,
				  .range = range,
				  .intensity = intensity,
				  .period_s = period};
		double start = 0.3 + k * period;

		for (int i = 0; i < SHOTS; i++) {
			double when = start + i * s.step / 6.283185307179586 * period, a = s.first + i * s.step;
			double at[3], angle[3], arm[3], ray[3], body[3], out[3], sensor[3] = {cos(a), -sin(a), 0};

			drive(when, at, angle);
			/* turned() gives east, north, up: back to ahead, right, down of the vehicle's own frame */
			turned(mount, sensor, body);
			ray[0] = body[1], ray[1] = body[0], ray[2] = -body[2];
			turned(angle, ray, out);
			turned(angle, p->lever, arm);
			range[i] = (float)((place - at[axis] - arm[axis]) / out[axis]);
			if (!(range[i] > 0.5 && range[i] < most_range))
				range[i] = NAN;
			intensity[i] = NAN;
		}
		assert_int_equal(ground_sweep(p, t, &s, start, &counts, look_at_plane, &seen, &err), 0);
	}
	assert_true(seen.n > least * SHOTS * SWEEPS);
	assert_int_equal(counts.shots, SHOTS * SWEEPS);
	assert_int_equal(counts.points, seen.n);
	assert_int_equal(counts.points + counts.no_return, counts.shots);
	if (!(seen.worst < 0.001))
		fail_msg("off by %.6f", seen.worst);
	pose_track_free(t);
}

static void floor_is_flat(void **state)
{
	const struct profile p = {
		.mount_roll = 3, .mount_pitch = -85, .mount_heading = 10, .lever = {0.5, -0.3, -1.2}, .range_max = 25};

	see_plane(&p, 2, 295, 0.5, 25);
}

static void wall_is_flat(void **state)
{
	const struct profile p = {
		.mount_roll = 90, .mount_pitch = 2, .mount_heading = 80, .lever = {-0.5, 0.4, -1.5}, .range_max = 200};

	see_plane(&p, 0, 500120, 0.2, 200);
}

/* If all shots were taken at the time of the first one, the floor would not be flat: the test can fail. */
static void ranges_and_counts(void **state)
{
	const struct profile p = {.range_min = 1, .range_max = 20};
	float range[6] = {0.5f, 1, 20, 20.5f, NAN, 5}, intensity[6] = {0};
	struct sweep s = {
		.first = 0, .step = 6.283185307179586 / 6, .shots = 6, .range = range, .intensity = intensity, .period_s = 6};
	struct pose_track *t = try_track(PLANE "0,0,0,0,0,0,0\n1,0,0,0,0,0,0\n4,0,0,0,0,0,0\n4.5,0,0,0,0,0,0\n", NULL);
	struct ground_counts c = {0};
	struct try_points got = {.n = 0};
	struct err err = ERR_INIT;

	/* shots at -0.5, 0.5, 1.5, 2.5, 3.5, 4.5 s */
	assert_int_equal(ground_sweep(&p, t, &s, -0.5, &c, try_take, &got, &err), 0);
	assert_int_equal(c.out_of_range, 2);
	assert_int_equal(c.no_return, 1);
	assert_int_equal(c.gap, 1);
	assert_int_equal(c.points, 2);
	assert_true(got.at[0].utc_s == 0.5 && fabs(got.at[1].utc_s - 4.5) < 1e-9);
	for (int i = 0; i < 6; i++)
		range[i] = 5;
	c = (struct ground_counts){0};
	/* with the opposite step it takes as long: at -5.5, -4.5, ... and then after the end */
	s.step = -s.step;
	assert_int_equal(ground_sweep(&p, t, &s, -0.5, &c, try_take, &got, &err), 0);
	assert_int_equal(c.before, 1);
	assert_int_equal(c.gap, 3);
	assert_int_equal(c.points, 2);
	s.step = -s.step;
	c = (struct ground_counts){0};
	assert_int_equal(ground_sweep(&p, t, &s, 4.4, &c, try_take, &got, &err), 0);
	assert_int_equal(c.after, 5);
	assert_int_equal(c.points, 1);
	pose_track_free(t);
}

/* ---- degrees ---- */

/* A shot to true north, from a pose in degrees, stays on its meridian; also if poses are in the plane with headings
 * from true north. */
static void convergence(void **state)
{
	static const struct {
		double lat, lon;
		const char *utm;
	} of[] = {
		{48, 6.1, NULL}, {48, 11.9, NULL},  {-35, 149.1, NULL}, {70, 14.5, "33N"},   {83.5, 45, NULL},
		{85, 60, NULL},  {-88, -100, NULL}, {48, 12.0, "32N"},  {0.0001, 9.5, NULL},
	};
	const struct profile p = {0};

	for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
		const struct pose_params degrees = {.utm = of[i].utm}, *none = &degrees;
		char text[512];
		struct err err = ERR_INIT;
		struct pose_track *t, *grid;
		struct pose_params plane = {.north = POSE_NORTH_TRUE};
		struct crs_geo *geo;
		double lat, lon, got[3], again[3];
		struct pose pose;

		snprintf(text, sizeof text,
			 "time,latitude,longitude,height,roll,pitch,heading\n0,%.9f,%.9f,10,0,0,0\n1,%.9f,%.9f,10,0,0,0\n",
			 of[i].lat, of[i].lon, of[i].lat, of[i].lon);
		t = try_track(text, none);
		assert_int_equal(crs_geo_new(&pose_track_system(t)->system, &geo, &err), 0);
		try_shot(&p, t, 0.5, 0, 100, got);
		assert_int_equal(crs_geo_reverse(geo, got[0], got[1], &lat, &lon, &err), 0);
		/* a millimetre at 100 m */
		assert_true(fabs(lon - of[i].lon) * cos(lat * RADIAN) < 1e-8);
		assert_true(fabs((lat - of[i].lat) * 111200 - 100) < 1);
		pose = try_pose(t, 0);
		snprintf(text, sizeof text, PLANE "0,%.6f,%.6f,10,0,0,0\n1,%.6f,%.6f,10,0,0,0\n", pose.at[0], pose.at[1],
			 pose.at[0], pose.at[1]);
		plane.to = pose_track_system(t);
		grid = try_track(text, &plane);
		try_shot(&p, grid, 0.5, 0, 100, again);
		try_near(again, got[0], got[1], got[2], 1e-5);
		pose_track_free(grid);
		/* grid north on request */
		plane = (struct pose_params){.utm = of[i].utm, .north = POSE_NORTH_GRID};
		snprintf(text, sizeof text,
			 "time,latitude,longitude,height,roll,pitch,heading\n0,%.9f,%.9f,10,0,0,0\n1,%.9f,%.9f,10,0,0,0\n",
			 of[i].lat, of[i].lon, of[i].lat, of[i].lon);
		grid = try_track(text, &plane);
		try_shot(&p, grid, 0.5, 0, 100, again);
		try_near(again, pose.at[0], pose.at[1] + 100, 10, 1e-9);
		pose_track_free(grid);
		pose_track_free(t);
		crs_geo_free(geo);
	}
}

/* In the middle of a zone lengths in the plane are scaled by 0.9996; higher up by less. */
static void grid_scale(void **state)
{
	static const struct {
		double lon, height, scale;
	} of[] = {{9, 0, 0.9996}, {9, 1000, 0.9996 * 6382000 / 6383000}, {12, 0, 1.000215}};
	const struct profile p = {0};

	for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
		const struct pose_params scaled = {.grid_scale = true, .utm = "32N"};
		char text[256];
		struct pose_track *t;
		double got[3];
		struct pose pose;

		snprintf(text, sizeof text,
			 "time,latitude,longitude,height,roll,pitch,heading\n0,48,%g,%g,0,0,0\n1,48,%g,%g,0,0,0\n", of[i].lon,
			 of[i].height, of[i].lon, of[i].height);
		t = try_track(text, &scaled);
		pose = try_pose(t, 0);
		try_shot(&p, t, 0, 0, 1000, got);
		assert_true(fabs(hypot(got[0] - pose.at[0], got[1] - pose.at[1]) / 1000 - of[i].scale) < 1e-6);
		try_shot(&(struct profile){.mount_pitch = -90}, t, 0, 0, 1000, got);
		try_near(got, pose.at[0], pose.at[1], of[i].height - 1000, 1e-9);
		pose_track_free(t);
	}
}

/* A plane in feet gets ranges in feet. */
static void feet(void **state)
{
	struct pose_params p = {0};
	struct crs_info to;
	struct pose_track *t;
	double got[3];

	crs_info_clear(&to);
	snprintf(to.unit_xy, sizeof to.unit_xy, "us-survey-foot");
	snprintf(to.unit_z, sizeof to.unit_z, "foot");
	p.to = &to;
	t = try_track(PLANE "0,100,200,50,0,45,0\n1,100,200,50,0,45,0\n", &p);
	try_shot(&(struct profile){0}, t, 0.5, 0, 10, got);
	try_near(got, 100, 200 + 10 * sqrt(0.5) * 3937 / 1200, 50 + 10 * sqrt(0.5) / 0.3048, 1e-9);
	pose_track_free(t);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(vehicle),
		cmocka_unit_test(mounts),
		cmocka_unit_test(lever),
		cmocka_unit_test(north_is_crossed),
		cmocka_unit_test(floor_is_flat),
		cmocka_unit_test(wall_is_flat),
		cmocka_unit_test(ranges_and_counts),
		cmocka_unit_test(convergence),
		cmocka_unit_test(grid_scale),
		cmocka_unit_test(feet),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
