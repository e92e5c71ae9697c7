/*
 * Geoid grids: known heights of a real grid and of a made-up one, files that are no grids, and heights that a
 * step shifts, in degrees and in planes.
 */
#include <fcntl.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "crs_geo.h"
#include "err.h"
#include "geoid.h"

/* GeoidEval 2.1.2 -c on egm84-30.pgm, cubic. */
static const double known[][3] = {
	{38.6281550, 269.7791550, -32.2069},
	{-14.6212170, 305.0211140, -2.0504},
	{46.8743190, 102.4487290, -43.3753},
	{-23.6174460, 133.8747120, 17.9965},
	{38.6254730, 359.9995000, 51.1756},
	{-.4667440, 0.0023000, 18.4208},
	{16.775833, -3.009444, 31.3031},
	{0, 0, 18.3266},
	{90, 0, 13.0980},
	{-90, 0, -29.7120},
	{27.988056, 86.925278, -30.4495},
	{0, 180, 21.7122},
	{0.1, 359.9, 18.3427},
	{52.0, 4.0, 43.7310},
};

static char *real_grid(void)
{
	const char *folder = getenv("ACUT_TEST_DATA");
	char *path = malloc(4096);

	snprintf(path, 4096, "%s/geoid/egm84-30.pgm", folder ? folder : ACUT_SOURCE "/../shared/data");
	if (!access(path, R_OK))
		return path;
	print_message("%s is not there: the real grid is not tested (set ACUT_TEST_DATA)\n", path);
	free(path);
	return NULL;
}

static struct crs_info plane_of(enum crs_method m, const char *text)
{
	struct crs_info g = {
		.plane = m == CRS_METHOD_GEOGRAPHIC ? CRS_PLANE_GEOGRAPHIC : CRS_PLANE_PROJECTED,
		.system = {.method = m,
			   .datum = "WGS 84",
			   .a = 6378137,
			   .inverse_flattening = 298.257223563,
			   .unit = 1,
			   .unit_z = 1},
	};

	snprintf(g.text, sizeof g.text, "%s", text);
	return g;
}

static void known_heights(void **state)
{
	char *path = real_grid();
	struct crs_geoid *g;
	struct crs_geoid_info info;
	struct err err = ERR_INIT;
	int fd;

	if (!path)
		skip();
	fd = open(path, O_RDONLY | O_CLOEXEC);
	assert_int_equal(crs_geoid_check(fd, "egm84-30.pgm", &info, &err), 0);
	close(fd);
	assert_int_equal(info.width, 720);
	assert_int_equal(info.height, 361);
	assert_int_equal(info.bytes, 520256);
	assert_string_equal(info.description, "WGS84 EGM84, 30-minute grid");
	assert_string_equal(info.date, "2009-08-29 18:45:02");
	assert_true(info.rms_error == 0.014 && info.max_error == 0.274);
	assert_true(info.min > -110 && info.min < -90 && info.max > 70 && info.max < 90);
	assert_int_equal(crs_geoid_open(path, &g, &err), 0);
	for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
		double h;

		assert_int_equal(crs_geoid_height(g, known[i][0], known[i][1], &h, &err), 0);
		if (fabs(h - known[i][2]) > 0.0001)
			fail_msg("%g %g: %.4f, not %.4f", known[i][0], known[i][1], h, known[i][2]);
	}
	crs_geoid_close(g);
	free(path);
}

/* The same places through a step of degrees, planar: what it does to heights, to a tenth of a millimetre. */
static void known_shifts(void **state)
{
	char *path = real_grid();
	const struct crs_info wgs = plane_of(CRS_METHOD_GEOGRAPHIC, "EPSG:4326");
	const struct lattice lattice = {.scale_xy = {1, -7}, .scale_z = {1, -4}, .k = {900000000, 0, 0}};
	const struct lattice_input coords = {.name = "a", .scale = {{1, -7}, {1, -7}, {1, -2}}, .has_offset = true};
	struct crs_step_params p = {.from = &wgs, .geoid_path = path, .lattice = &lattice, .coords = &coords};
	struct crs_shift shift, sum = {0};
	struct err err = ERR_INIT;

	if (!path)
		skip();
	for (int way = 0; way < 2; way++) {
		struct crs_step *s;

		p.way = way ? CRS_TO_ELLIPSOIDAL : CRS_TO_ORTHOMETRIC;
		assert_int_equal(crs_step_new(&p, &s, &err), 0);
		for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
			int64_t raw[1][3] = {{llround(known[i][1] * 1e7), llround(known[i][0] * 1e7), 100000}};
			int32_t at[1][3];
			size_t bad;
			double want = 1000 + (way ? known[i][2] : -known[i][2]);

			if (raw[0][0] > 3000000000)
				raw[0][0] -= 3600000000; /* within the lattice */
			assert_int_equal(crs_step_apply(s, (const int64_t(*)[3])raw, 1, at, &bad, &err), 0);
			assert_int_equal(at[0][0], raw[0][0] - 900000000);
			assert_int_equal(at[0][1], raw[0][1]);
			if (fabs(at[0][2] * 1e-4 - want) > 0.00016)
				fail_msg("%g %g: %.4f, not %.4f", known[i][0], known[i][1], at[0][2] * 1e-4, want);
		}
		shift = crs_step_shift(s);
		assert_int_equal(shift.n, sizeof known / sizeof *known);
		assert_true(fabs((way ? shift.max : -shift.min) - 51.1756) < 1e-4);
		assert_true(fabs((way ? shift.min : -shift.max) + 43.3753) < 1e-4);
		crs_shift_add(&sum, &shift);
		crs_step_free(s);
	}
	assert_true(sum.n == 28 && llabs(sum.sum_um) <= 28 && fabs(sum.max - 51.1756) < 1e-4);
	free(path);
}

/* The step's cubic in a cell is GeographicLib's own: same heights, everywhere, poles and seam too. */
static void cells_of_the_grid(void **state)
{
	static const unsigned size[][2] = {{360, 181}, {24, 13}, {720, 361}, {2, 3}};
	const struct crs_info wgs = plane_of(CRS_METHOD_GEOGRAPHIC, "EPSG:4326");
	const struct lattice lattice = {.scale_xy = {1, -6}, .scale_z = {1, -7}};
	const struct lattice_input coords = {.name = "a", .scale = {{1, -6}, {1, -6}, {1, -2}}, .has_offset = true};
	double worst = 0;

	srand(5);
	for (size_t k = 0; k < sizeof size / sizeof *size; k++) {
		char *path = geoid_synthetic(size[k][0], size[k][1]);
		struct crs_step_params p = {
			.from = &wgs, .geoid_path = path, .lattice = &lattice, .coords = &coords, .way = CRS_TO_ELLIPSOIDAL};
		struct crs_step *s;
		struct crs_geoid *g;
		struct err err = ERR_INIT;

		assert_int_equal(crs_step_new(&p, &s, &err), 0);
		assert_int_equal(crs_geoid_open(path, &g, &err), 0);
		for (int i = 0; i < 3000; i++) {
			int64_t raw[1][3] = {{rand() % 360000001 - 180000000, rand() % 180000001 - 90000000, 0}};
			int32_t at[1][3];
			size_t bad;
			double h;

			if (i < 40) {
				raw[0][0] = (i % 8 - 4) * 45000000;
				raw[0][1] = (i / 8 - 2) * 45000000;
			}
			assert_int_equal(crs_step_apply(s, (const int64_t(*)[3])raw, 1, at, &bad, &err), 0);
			assert_int_equal(crs_geoid_height(g, raw[0][1] * 1e-6, raw[0][0] * 1e-6, &h, &err), 0);
			/* The first forty lie on borders of cells. */
			worst = fmax(worst, fabs(at[0][2] * 1e-7 - h));
		}
		crs_step_free(s);
		crs_geoid_close(g);
		unlink(path);
		free(path);
	}
	print_message("cells of the grid against GeographicLib: at most %.3g m, of which 5e-8 m are the lattice's\n", worst);
	assert_true(worst < 2e-6);
}

/* A projected file in US survey feet: its place comes from the plane, its shift is in feet. */
static void heights_in_a_plane(void **state)
{
	const double foot = 1200.0 / 3937;
	char *path = geoid_synthetic(360, 181);
	struct crs_info plane = plane_of(CRS_METHOD_LAMBERT_CONIC, "Lambert in feet");
	const struct lattice lattice = {.scale_xy = {1, -2}, .scale_z = {1, -5}, .k = {60000000, 20000000, 0}};
	struct lattice_input coords = {.name = "a", .scale = {{1, -2}, {1, -2}, {1, -2}}, .has_offset = true};
	struct crs_step_params p = {.from = &plane, .to = &plane, .geoid_path = path, .lattice = &lattice, .coords = &coords};
	struct crs_step *s;
	struct crs_geoid *g;
	struct crs_geo *geo;
	struct err err = ERR_INIT;
	double worst = 0;

	plane.system.lat0 = 41.75;
	plane.system.lon0 = -120.5;
	plane.system.lat1 = 43;
	plane.system.lat2 = 45.5;
	plane.system.k0 = 1;
	plane.system.x0 = 400000;
	plane.system.unit = plane.system.unit_z = foot;
	assert_int_equal(crs_geo_new(&plane.system, &geo, &err), 0);
	assert_int_equal(crs_geoid_open(path, &g, &err), 0);
	assert_int_equal(crs_step_new(&p, &s, &err), 0);
	srand(6);
	for (int i = 0; i < 5000; i++) {
		int64_t raw[1][3] = {{60000000 + rand() % 40000000, 20000000 + rand() % 40000000, 40000}};
		double x = raw[0][0] * 0.01, y = raw[0][1] * 0.01, lat, lon, n;
		int32_t at[1][3];
		size_t bad;

		assert_int_equal(crs_step_apply(s, (const int64_t(*)[3])raw, 1, at, &bad, &err), 0);
		assert_int_equal(crs_geo_reverse(geo, x, y, &lat, &lon, &err), 0);
		assert_int_equal(crs_geoid_height(g, lat, lon, &n, &err), 0);
		worst = fmax(worst, fabs(at[0][2] * 1e-5 - (400 - n / foot)));
		assert_true(at[0][0] == raw[0][0] - 60000000 && at[0][1] == raw[0][1] - 20000000);
	}
	print_message("heights of a plane: at most %.3g ft, of which 5e-6 ft are the lattice's\n", worst);
	assert_true(worst < 1e-5);
	crs_step_free(s);
	crs_geo_free(geo);
	crs_geoid_close(g);

	/* Without a unit of heights, without a place, without the grid. */
	plane.system.unit_z = 0;
	err = ERR_INIT;
	assert_int_equal(crs_step_new(&p, &s, &err), -ERR_UNSUPPORTED);
	assert_non_null(strstr(err.message, "unit of the heights"));
	plane.system.unit_z = 1;
	plane.system.method = CRS_METHOD_UNKNOWN;
	err = ERR_INIT;
	assert_int_equal(crs_step_new(&p, &s, &err), -ERR_UNSUPPORTED);
	assert_non_null(strstr(err.message, "on the earth"));
	plane.system.method = CRS_METHOD_LAMBERT_CONIC;
	unlink(path);
	err = ERR_INIT;
	assert_int_not_equal(crs_step_new(&p, &s, &err), 0);
	assert_non_null(strstr(err.file, ".pgm"));
	free(path);
}

/* ---- files that are no grids ---- */

static int check_bytes(const char *header, size_t pixels, struct err *err)
{
	char path[] = "/tmp/acut-grid-XXXXXX";
	int fd = mkstemp(path), r;
	struct crs_geoid_info info;
	char *zeros = calloc(1, pixels + 1);

	unlink(path);
	assert_true(write(fd, header, strlen(header)) == (ssize_t)strlen(header));
	/* 108 m above the offset: height 0 */
	for (size_t i = 0; i + 1 < pixels; i += 2) {
		zeros[i] = (char)(36000 >> 8);
		zeros[i + 1] = (char)(36000 & 255);
	}
	assert_true(write(fd, zeros, pixels) == (ssize_t)pixels);
	free(zeros);
	*err = ERR_INIT;
	r = crs_geoid_check(fd, "made-up", &info, err);
	assert_true(!r || !strcmp(err->file, "made-up"));
	close(fd);
	return r;
}

static void bad_grids(void **state)
{
	static const struct {
		const char *header;
		size_t pixels;
		int code;
		const char *words;
	} row[] = {
		{"P5\n# Offset -108\n# Scale 0.003\n4 3\n65535\n", 24, 0, ""},
		{"P5\n# Offset -108\n# Scale 0.003\n4  3\r\n65535\n", 24, 0, ""},
		{"P5\n# Offset -108\n# Scale 0.003\n4 3\n65535\n", 23, ERR_TRUNCATED, "64"},
		{"P5\n# Offset -108\n# Scale 0.003\n4 3\n65535\n", 25, ERR_INPUT, "bytes"},
		{"P2\n# Offset -108\n# Scale 0.003\n4 3\n65535\n", 24, ERR_INPUT, "P5"},
		{"", 0, ERR_INPUT, "P5"},
		{"P5\n# Offset -108\n# Scale 0.003\n4 3\n255\n", 24, ERR_INPUT, "65535"},
		{"P5\n# Offset -108\n# Scale 0.003\n5 3\n65535\n", 30, ERR_INPUT, "even"},
		{"P5\n# Offset -108\n# Scale 0.003\n4 4\n65535\n", 32, ERR_INPUT, "odd"},
		{"P5\n# Offset -108\n# Scale 0.003\n4000000000 3\n65535\n", 32, ERR_INPUT, "even"},
		{"P5\n# Offset -108\n# Scale 0.003\n-4 3\n65535\n", 32, ERR_INPUT, ""},
		{"P5\n# Scale 0.003\n4 3\n65535\n", 24, ERR_INPUT, "Offset"},
		{"P5\n# Offset -108\n4 3\n65535\n", 24, ERR_INPUT, "Scale"},
		{"P5\n# Offset x\n# Scale 0.003\n4 3\n65535\n", 24, ERR_INPUT, "number"},
		{"P5\n# Offset -108\n# Scale -1\n4 3\n65535\n", 24, ERR_INPUT, "number"},
		{"P5\n# Offset 1000\n# Scale 0.003\n4 3\n65535\n", 24, ERR_INPUT, "no geoid"},
		{"P5\n# Offset -108\n# Scale 0.003\n# on and on", 5000, ERR_INPUT, "header"},
	};
	struct err err;

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		int r = check_bytes(row[i].header, row[i].pixels, &err);

		if (r != -row[i].code || !strstr(err.message, row[i].words))
			fail_msg("row %zu: %d, %s", i, r, err.message);
	}
}

static void open_refuses(void **state)
{
	struct crs_geoid *g = NULL;
	struct err err = ERR_INIT;

	assert_int_equal(crs_geoid_open("/nowhere/grid.pgm", &g, &err), -ERR_INPUT);
	assert_string_equal(err.file, "/nowhere/grid.pgm");
	err = ERR_INIT;
	assert_int_equal(crs_geoid_open("/nowhere/grid.tif", &g, &err), -ERR_USAGE);
	err = ERR_INIT;
	assert_int_equal(crs_geoid_open(".pgm", &g, &err), -ERR_USAGE);
	assert_null(g);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(known_heights),      cmocka_unit_test(known_shifts), cmocka_unit_test(cells_of_the_grid),
		cmocka_unit_test(heights_in_a_plane), cmocka_unit_test(bad_grids),    cmocka_unit_test(open_refuses),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
