/* Pose files: columns, times, invalid files and their errors, blocks, gaps, planes. */
#include "ground_try.h"

#include "crs_geo.h"

#define PLANE "time,easting,northing,height,roll,pitch,heading\n"
#define DEGREES "time,latitude,longitude,ellipsoidal_height,roll,pitch,heading\n"

/* ---- times ---- */

static void times(void **state)
{
	static const struct {
		const char *text;
		enum pose_clock clock;
		double utc;
	} good[] = {
		{"1700000000.25", POSE_UTC, 1700000000.25},
		{"1970-01-01T00:00:00Z", POSE_UTC, 0},
		{"2024-02-29T12:30:15.5Z", POSE_UTC, 1709209815.5},
		{"2024-02-29 12:30:15,5", POSE_UTC, 1709209815.5},
		{"2024-02-29T14:30:15.5+02:00", POSE_UTC, 1709209815.5},
		{"2024-02-29T09:30:15.5-0300", POSE_UTC, 1709209815.5},
		{"2016-12-31T23:59:60Z", POSE_UTC, 1483228800},
		/* GPS is 18 s ahead: its calendar reads 12:30:33.5 then */
		{"2024-02-29T12:30:33.5", POSE_GPS, 1709209815.5},
		{"393245033.5", POSE_GPS, 1709209815.5},
	};
	static const char *const bad[] = {"",
					  "noon",
					  "2024-02-30T00:00:00Z",
					  "2024-13-01T00:00:00Z",
					  "2024-01-01T24:00:00Z",
					  "2024-01-01",
					  "2024-01-01T00:00:00Zulu",
					  "1e300",
					  "nan",
					  "12:00:00",
					  "2024-01-01T00:00:00.Z"};
	double v;

	for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
		if (!pose_time_parse(good[i].text, good[i].clock, &v) || fabs(v - good[i].utc) > 1e-6)
			fail_msg("%s is %.7f, not %.7f", good[i].text, v, good[i].utc);
	}
	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
		if (pose_time_parse(bad[i], POSE_UTC, &v))
			fail_msg("\"%s\" was taken", bad[i]);
	assert_false(pose_time_parse("2024-02-29T12:30:33.5Z", POSE_GPS, &v));
}

/* Leap seconds, on each side of some of them. */
static void leaps(void **state)
{
	static const struct {
		double utc;
		int ahead;
	} of[] = {
		{315964800, 0},  {362793599, 0},   {362793600, 1},   {820454399, 10},
		{820454400, 11}, {1483228799, 17}, {1483228800, 18}, {1700000000, 18},
	};

	for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
		double gps = of[i].utc - 315964800 + of[i].ahead - 1e9;

		assert_true(pose_gps_of_utc(of[i].utc) == gps);
		assert_true(pose_utc_of_gps(gps) == of[i].utc);
	}
}

/* ---- the file ---- */

static void forms(void **state)
{
	static const char *const same[] = {
		PLANE "0,1,2,3,0,0,0\n10,11,12,13,0,0,0\n",
		"\xef\xbb\xbf# made by hand\r\n\r\n" PLANE "0,1,2,3,0,0,0\r\n# half way\r\n10,11,12,13,0,0,0",
		"Heading;Pitch;Roll;Height;Northing;Easting;Time\n0;0;0;3;2;1;0\n0;0;0;13;12;11;10\n",
		"\"time\", \"_sigma, m\" ,easting,northing,height,roll,pitch,heading,_\n0,\"a \"\"b\"\"\",1,2,3,0,0,0,\n\"10\",,11,12,13,0,0,0,x\n",
		"time\teasting\tnorthing\theight\troll\tpitch\theading\n0\t1\t2\t3\t0\t0\t0\n10\t11\t12\t13\t0\t0\t0\n",
	};

	for (size_t i = 0; i < sizeof same / sizeof *same; i++) {
		const struct pose_params p = {.gap_s = 20};
		struct pose_track *t = try_track(same[i], &p);

		assert_int_equal(pose_track_span(t)->poses, 2);
		try_near(try_pose(t, 5).at, 6, 7, 8, 1e-12);
		pose_track_free(t);
	}
}

static void refused(void **state)
{
	static const struct {
		const char *text, *word;
		uint64_t line;
	} of[] = {
		{"", "empty", ERR_NO_OFFSET},
		{"# nothing\n", "empty", ERR_NO_OFFSET},
		{PLANE, "no poses", ERR_NO_OFFSET},
		{PLANE "0,1,2,3,0,0,0\n", "one pose", ERR_NO_OFFSET},
		{PLANE "0,1,2,3,0,0,0\n1,1,2,x,0,0,0\n", "height", 3},
		{PLANE "0,1,2,3,0,0,0\n1,1,2,3,0,0\n", "fields", 3},
		{PLANE "0,1,2,3,0,0,0\n1,1,2,nan,0,0,0\n", "height", 3},
		{PLANE "5,1,2,3,0,0,0\n# so\n5,1,2,3,0,0,0\n", "time", 4},
		{PLANE "5,1,2,3,0,0,0\n4,1,2,3,0,0,0\n", "order", 3},
		{PLANE "yesterday,1,2,3,0,0,0\n", "time", 2},
		{PLANE "0,1,2,3,0,0,1000\n", "heading", 2},
		{DEGREES "0,91,2,3,0,0,0\n", "latitude", 2},
		{DEGREES "0,48,400,3,0,0,0\n", "longitude", 2},
		{"# a\n\ntime,easting,northing,height,roll,pitch,yaw\n0,1,2,3,0,0,0\n", "yaw", 3},
		{"time,easting,northing,height,roll,pitch,heading,roll\n", "twice", 1},
		{"time,easting,northing,height,roll,pitch\n", "heading", 1},
		{"time,height,roll,pitch,heading\n", "neither", 1},
		{"time,easting,height,roll,pitch,heading\n", "one is not there", 1},
		{"time,easting,northing,latitude,longitude,height,roll,pitch,heading\n", "both", 1},
		{"time,easting,northing,height,ellipsoidal_height,roll,pitch,heading\n", "both", 1},
		{"time,easting,northing,roll,pitch,heading\n", "neither height", 1},
		{"1700000000,1,2,3,0,0,0\n", "no column of poses", 1},
		{"time;easting;northing;height;roll;pitch;heading\n0;1,5;2;3;0;0;0\n", "never a comma", 2},
		{PLANE "0,1,2,3,0,0,0\r1,1,2,3,0,0,0\r", "carriage return", 2},
		{"time,easting,northing,ellipsoidal_height,roll,pitch,heading\n0,1,2,3,0,0,0\n1,1,2,3,0,0,0\n", "which ellipsoid",
		 ERR_NO_OFFSET},
	};

	for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
		struct pose_track *t = NULL;
		struct err err;

		if (!try_read(of[i].text, NULL, &t, &err))
			fail_msg("taken: %s", of[i].text);
		assert_int_equal(err.code, ERR_INPUT);
		if (!strstr(err.message, of[i].word) && !strstr(err.hint, of[i].word))
			fail_msg("\"%s\" says nothing of %s", err.message, of[i].word);
		if (err.offset != of[i].line)
			fail_msg("\"%s\" is about line %lld", err.message, (long long)err.offset);
		assert_string_equal(err.file, "poses.csv");
	}
}

/* As programs on Windows and spreadsheets write them. */
static void other_hands(void **state)
{
	static const char *const of[] = {
		"\xef\xbb\xbf" PLANE "0,1,2,3,0,0,0\r\n1,1,2,3,0,0,0\r\n",
		"time;easting;northing;height;roll;pitch;heading\n0;1;2;3;0;0;0\n1;1;2;3;0;0;0  \n",
		/* empty fields at the end, between tabs */
		"time\teasting\tnorthing\theight\troll\tpitch\theading\t_note\t_more\n0\t1\t2\t3\t0\t0\t0\t\t\n1\t1\t2\t3\t0\t0\t0\ta\t\r\n\t\n",
	};

	for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
		struct pose_track *t = try_track(of[i], NULL);

		assert_int_equal(pose_track_span(t)->poses, 2);
		pose_track_free(t);
	}
}

static void utf16(void **state)
{
	static const char text[] = "\xff\xfet\0i\0m\0e\0,\0\n\0";
	struct pose_track *t = NULL;
	struct err err = ERR_INIT;
	int fd = try_file(text, sizeof text - 1);

	assert_int_equal(pose_track_read(fd, "poses.csv", &(struct pose_params){0}, &t, &err), -ERR_INPUT);
	assert_non_null(strstr(err.hint, "UTF-16"));
	close(fd);
}

static void long_line(void **state)
{
	static char text[POSE_LINE_MAX + 200];
	struct pose_track *t = NULL;
	struct err err;
	int fds[2];

	strcpy(text, PLANE);
	memset(text + strlen(text), '1', POSE_LINE_MAX + 1);
	assert_int_equal(try_read(text, NULL, &t, &err), -ERR_INPUT);
	assert_int_equal(err.offset, 2);
	assert_int_equal(pipe(fds), 0);
	assert_int_equal(pose_track_read(fds[0], "pipe", &(struct pose_params){0}, &t, &err), -ERR_INPUT);
}

static void gaps_and_ends(void **state)
{
	struct pose_track *t = try_track(PLANE "10,0,0,0,0,0,0\n11,1,0,0,0,0,0\n14,2,0,0,0,0,0\n15,3,0,0,0,0,0\n", NULL);
	static const struct {
		double time;
		int found;
	} of[] = {
		{9.999, POSE_BEFORE}, {10, POSE_HERE},    {11, POSE_HERE},   {11.001, POSE_GAP},
		{13.999, POSE_GAP},   {14, POSE_HERE},    {15, POSE_HERE},   {15.001, POSE_AFTER},
		{10.5, POSE_HERE},    {NAN, POSE_BEFORE}, {14.5, POSE_HERE},
	};
	struct err err = ERR_INIT;
	struct pose pose;

	assert_int_equal(pose_track_span(t)->gaps, 1);
	for (size_t i = 0; i < sizeof of / sizeof *of; i++)
		if (pose_track_at(t, of[i].time, &pose, &err) != of[i].found)
			fail_msg("at %g", of[i].time);
	pose_track_free(t);
	t = try_track(PLANE "10,0,0,0,0,0,0\n11,1,0,0,0,0,0\n14,2,0,0,0,0,0\n",
		      &(struct pose_params){.gap_s = 3, .offset_s = 100});
	try_near(try_pose(t, 112.5).at, 1.5, 0, 0, 1e-12);
	assert_int_equal(pose_track_at(t, 12.5, &pose, &err), POSE_BEFORE);
	pose_track_free(t);
}

/* More rows than the index has entries at first, requested forwards, backwards and at random. */
static void many(void **state)
{
	enum { ROWS = 300000 };
	char *text = malloc((size_t)ROWS * 48 + 100), *at = text;
	struct pose_track *t;

	at += sprintf(at, PLANE);
	for (int i = 0; i < ROWS; i++)
		at += sprintf(at, "%d.%02d,%d,%d,1,0,0,%d\n", i / 100, i % 100, i, 2 * i, i % 360);
	t = try_track(text, NULL);
	free(text);
	assert_int_equal(pose_track_span(t)->poses, ROWS);
	srand(1);
	for (int k = 0; k < 3000; k++) {
		int i = k < 1000 ? k * 299 : k < 2000 ? ROWS - 2 - (k - 1000) * 299 : rand() % (ROWS - 1);

		try_near(try_pose(t, i / 100.0 + 0.0025).at, i + 0.25, 2 * i + 0.5, 1, 1e-3);
	}
	pose_track_free(t);
}

struct told {
	uint64_t bytes, size, stop; /* stop: at the n-th call; 0: never */
	unsigned calls;
};

static bool told(void *ctx, uint64_t bytes, uint64_t size)
{
	struct told *t = ctx;

	assert_true(bytes > t->bytes && bytes <= size);
	t->bytes = bytes;
	t->size = size;
	return ++t->calls == t->stop;
}

/* Whoever waits is told how far the reading is, and can end it. */
static void progress(void **state)
{
	enum { N = 10000 };
	static char text[64 * N];
	size_t n = (size_t)sprintf(text, PLANE);
	struct told all = {0}, part = {.stop = 2};
	struct pose_params p = {.told = told, .ctx = &all};
	struct pose_track *t = NULL;
	struct err err;

	for (int i = 0; i < N; i++)
		n += (size_t)sprintf(text + n, "%d,500000,5000000,%d,0,0,0\n", 1700000000 + i, i);
	pose_track_free(try_track(text, &p));
	assert_int_equal(all.bytes, n);
	assert_int_equal(all.size, n);
	assert_true(all.calls >= n >> 16 && all.calls <= (n >> 16) + 2);
	p.ctx = &part;
	assert_int_equal(try_read(text, &p, &t, &err), -ERR_CANCELLED);
	assert_true(part.calls == 2 && part.bytes < n);
	assert_null(t);
}

static void changes(void **state)
{
	char text[4096], *at = text;
	struct err err = ERR_INIT;
	struct pose_track *t;
	struct pose pose;
	int fd;

	at += sprintf(at, PLANE);
	for (int i = 0; i < 100; i++)
		at += sprintf(at, "%d,%d,0,0,0,0,0\n", i, i);
	fd = try_file(text, strlen(text));
	assert_int_equal(pose_track_read(fd, "poses.csv", &(struct pose_params){0}, &t, &err), 0);
	assert_int_equal(pwrite(fd, "9", 1, strlen(PLANE)), 1);
	assert_int_equal(pose_track_at(t, 0.5, &pose, &err), -ERR_CHANGED);
	pose_track_free(t);
}

/* ---- planes ---- */

static void systems(void **state)
{
	static const char plane[] = PLANE "0,500000,5000000,3,0,0,0\n1,500000,5000000,3,0,0,0\n";
	static const char degrees[] = DEGREES "0,48,9,100,0,0,0\n1,48,9,101,0,0,0\n";
	struct err err = ERR_INIT;
	struct crs_info to, etrs;
	struct pose_params p = {0};
	struct pose_track *t;

	t = try_track(plane, NULL);
	assert_string_equal(pose_track_system(t)->text, "unknown");
	assert_string_equal(pose_track_system(t)->unit_xy, "metre");
	pose_track_free(t);
	t = try_track(degrees, NULL);
	assert_string_equal(pose_track_system(t)->text, "EPSG:32632 + EPSG:5030");
	assert_string_equal(pose_track_system(t)->unit_z, "metre");
	assert_string_equal(pose_track_span(t)->zone, "32N");
	pose_track_free(t);
	p.utm = "33N";
	t = try_track(degrees, &p);
	assert_string_equal(pose_track_system(t)->text, "EPSG:32633 + EPSG:5030");
	pose_track_free(t);
	p.utm = NULL;
	/* degrees of WGS 84 are not projected to a plane on ETRS89, those of ETRS89 are */
	assert_int_equal(crs_assume_text("EPSG:25832", 10, &to, &err), 0);
	snprintf(to.unit_z, sizeof to.unit_z, "metre");
	p.to = &to;
	assert_int_equal(try_read(degrees, &p, &t, &err), -ERR_UNSUPPORTED);
	err = ERR_INIT;
	assert_int_equal(crs_assume_text("EPSG:4258", 9, &etrs, &err), 0);
	p.degrees = &etrs;
	t = try_track(degrees, &p);
	assert_string_equal(pose_track_system(t)->text, "EPSG:25832 + EPSG:5019");
	pose_track_free(t);
	/* other kinds of height are not overridden */
	snprintf(to.text, sizeof to.text, "EPSG:25832 + EPSG:7837");
	assert_int_equal(try_read(degrees, &p, &t, &err), -ERR_INPUT);
	assert_non_null(strstr(err.hint, "--geoid"));
	t = try_track("time,latitude,longitude,height,roll,pitch,heading\n0,48,9,100,0,0,0\n1,48,9,101,0,0,0\n", &p);
	assert_string_equal(pose_track_system(t)->text, "EPSG:25832 + EPSG:7837");
	pose_track_free(t);
}

/* All poses of a drive across a border of zones are projected to one of them, that of the middle; also across 180 degrees. */
static void borders(void **state)
{
	static const struct {
		double west, east;
		const char *zone;
	} of[] = {
		{11.99, 12.005, "32N"},  {11.995, 12.01, "33N"}, {179.999, -179.9, "1N"},
		{179.8, -179.99, "60N"}, {179.999, 180.1, "1N"},
	};

	for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
		char text[512];
		struct pose_track *t;
		struct pose a, b;

		snprintf(text, sizeof text, DEGREES "0,48,%.4f,0,0,0,0\n1,48,%.4f,0,0,0,0\n", of[i].west, of[i].east);
		t = try_track(text, NULL);
		assert_string_equal(pose_track_span(t)->zone, of[i].zone);
		a = try_pose(t, 0);
		b = try_pose(t, 1);
		assert_true(b.at[0] - a.at[0] > 500 && b.at[0] - a.at[0] < 16000 && fabs(b.at[1] - a.at[1]) < 1500);
		pose_track_free(t);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(times),    cmocka_unit_test(leaps),         cmocka_unit_test(forms),
		cmocka_unit_test(refused),  cmocka_unit_test(long_line),     cmocka_unit_test(other_hands),
		cmocka_unit_test(utf16),    cmocka_unit_test(gaps_and_ends), cmocka_unit_test(many),
		cmocka_unit_test(progress), cmocka_unit_test(changes),       cmocka_unit_test(systems),
		cmocka_unit_test(borders),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
