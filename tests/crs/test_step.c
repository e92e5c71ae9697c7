/*
 * The step from degrees and ellipsoidal heights to the lattice: against formulas and GeographicLib's direct
 * answers, and that a point's result depends on that point alone.
 */
#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "crs_geo.h"
#include "earth.h"
#include "err.h"
#include "geoid.h"

#define WGS84_F 298.257223563

static const struct crs_info wgs = {
	.plane = CRS_PLANE_GEOGRAPHIC,
	.text = "EPSG:4326",
	.unit_xy = "degree",
	.unit_z = "metre",
	.system =
		{
			.method = CRS_METHOD_GEOGRAPHIC,
			.epsg = 4326,
			.datum = "WGS 84",
			.a = 6378137,
			.inverse_flattening = WGS84_F,
			.unit = 1,
			.unit_z = 1,
		},
};

static double uniform(void)
{
	return rand() / (double)RAND_MAX;
}

/* A file of degrees at the scale 1e-9 (heights 1e-3), and a lattice of micrometres around `middle`. */
struct bench {
	struct crs_info to;
	struct lattice lattice;
	struct lattice_input coords;
	struct crs_step_params params;
};

static void bench_init(struct bench *b, struct crs_zone z, const double middle[2], int exponent)
{
	struct err err = ERR_INIT;

	assert_int_equal(crs_zone_system(&wgs, z, &b->to, &err), 0);
	b->lattice = (struct lattice){.scale_xy = {1, exponent}, .scale_z = {1, -3}};
	for (int k = 0; k < 2; k++)
		b->lattice.k[k] = llround(middle[k] / pow(10, exponent));
	b->coords = (struct lattice_input){
		.name = "a.las",
		.scale = {{1, -9}, {1, -9}, {1, -3}},
		.has_offset = true,
	};
	b->params = (struct crs_step_params){
		.from = &wgs,
		.to = &b->to,
		.lattice = &b->lattice,
		.coords = &b->coords,
	};
}

static void reference(struct crs_zone z, double lat, double lon, double ret[2])
{
	if (z.number)
		earth_utm(WGS84_F, z.number, z.north, lat, lon, ret);
	else
		earth_ups(WGS84_F, z.north, lat, lon, ret);
}

/* Small tiles everywhere that the zones carry, in micrometres: the whole chain must be off by less than three. */
static void accuracy(void **state)
{
	double worst = 0;

	srand(2);
	for (int tile = 0; tile < 600; tile++) {
		struct crs_zone z = {.number = tile % 61, .north = tile & 1};
		double lat = z.number ? (uniform() - 0.5) * 179.8 : (z.north ? 1 : -1) * (60.02 + 29.97 * uniform());
		double lon = z.number ? 6 * z.number - 183 + (uniform() - 0.5) * 29.9 : uniform() * 359 - 179;
		struct bench b;
		struct crs_step *s;
		struct err err = ERR_INIT;
		double middle[2], want[2];
		int32_t at[1][3];
		size_t bad;

		lon = lon < -179.98 ? lon + 360 : lon;
		reference(z, lat, lon, middle);
		bench_init(&b, z, middle, -6);
		assert_int_equal(crs_step_new(&b.params, &s, &err), 0);
		for (int i = 0; i < 60; i++) {
			int64_t raw[1][3] = {{llround((lon + (uniform() - 0.5) * 0.01) * 1e9),
					      llround((lat + (uniform() - 0.5) * 0.01) * 1e9), 1234567}};
			int r = crs_step_apply(s, (const int64_t(*)[3])raw, 1, at, &bad, &err);

			if (r)
				fail_msg("zone %d%s: %s", z.number, z.north ? "N" : "S", err.message);
			reference(z, raw[0][1] * 1e-9, raw[0][0] * 1e-9, want);
			for (int k = 0; k < 2; k++)
				worst = fmax(worst, fabs(((double)at[0][k] + (double)b.lattice.k[k]) * 1e-6 - want[k]));
			assert_int_equal(at[0][2], 1234567);
		}
		crs_step_free(s);
	}
	print_message("step against formulas: at most %.3g m, of which 5e-7 m are the lattice's\n", worst);
	assert_true(worst < 3e-6);
}

/* The same against GeographicLib's direct answers, unrounded in effect: nanometre lattice. */
static void accuracy_direct(void **state)
{
	double worst = 0;

	srand(3);
	for (int tile = 0; tile < 400; tile++) {
		struct crs_zone z = {.number = 1 + tile % 60, .north = tile & 1};
		double lat = (uniform() - 0.5) * 179.99, lon = 6 * z.number - 183 + (uniform() - 0.5) * 29.99, x, y;
		struct bench b;
		struct crs_step *s;
		struct crs_geo *g;
		struct err err = ERR_INIT;
		double middle[2];
		int32_t at[1][3];
		size_t bad;

		lon = lon < -179.9 ? lon + 360 : lon;
		bench_init(&b, z, (double[2]){0, 0}, -9);
		assert_int_equal(crs_geo_new(&b.to.system, &g, &err), 0);
		assert_int_equal(crs_geo_forward(g, lat, lon, &middle[0], &middle[1], &err), 0);
		bench_init(&b, z, middle, -9);
		assert_int_equal(crs_step_new(&b.params, &s, &err), 0);
		for (int i = 0; i < 50; i++) {
			int64_t raw[1][3] = {{llround((lon + (uniform() - 0.5) * 1e-6) * 1e9),
					      llround((lat + (uniform() - 0.5) * 1e-6) * 1e9), 0}};

			assert_int_equal(crs_step_apply(s, (const int64_t(*)[3])raw, 1, at, &bad, &err), 0);
			assert_int_equal(crs_geo_forward(g, raw[0][1] * 1e-9, raw[0][0] * 1e-9, &x, &y, &err), 0);
			worst = fmax(worst, fabs(((double)at[0][0] + (double)b.lattice.k[0]) * 1e-9 - x));
			worst = fmax(worst, fabs(((double)at[0][1] + (double)b.lattice.k[1]) * 1e-9 - y));
		}
		crs_step_free(s);
		crs_geo_free(g);
	}
	print_message("step against direct calls: at most %.3g m\n", worst);
	assert_true(worst < 2e-6);
}

/* ---- independence ---- */

enum { CLOUD = 50000 };

struct part {
	const struct crs_step_params *params;
	const int64_t (*raw)[3];
	int32_t (*at)[3];
	size_t n;
};

static void *run_part(void *ctx)
{
	struct part *p = ctx;
	struct crs_step *s;
	struct err err = ERR_INIT;
	size_t bad;
	int r = crs_step_new(p->params, &s, &err);

	if (!r)
		r = crs_step_apply(s, p->raw, p->n, p->at, &bad, &err);
	if (!r)
		crs_step_free(s);
	return r ? p : NULL;
}

static void depends_on_the_point_alone(void **state)
{
	char *path = geoid_synthetic(360, 181);
	static int64_t raw[CLOUD][3], mixed[CLOUD][3];
	static int32_t at[CLOUD][3], again[CLOUD][3];
	static size_t order[CLOUD];
	const struct crs_zone z = {.number = 32, .north = true};
	double middle[2];
	struct bench b;
	struct part all, two[2];
	pthread_t thread[2];

	reference(z, 47.3, 8.2, middle);
	bench_init(&b, z, middle, -3);
	b.params.geoid_path = path;
	srand(4);
	for (size_t i = 0; i < CLOUD; i++) {
		raw[i][0] = llround((8.2 + (uniform() - 0.5) * 6) * 1e9);
		raw[i][1] = llround((47.3 + (uniform() - 0.5) * 6) * 1e9);
		raw[i][2] = rand() % 1000000;
		order[i] = i;
	}
	all = (struct part){&b.params, (const int64_t(*)[3])raw, at, CLOUD};
	assert_null(run_part(&all));
	/* Another order. */
	for (size_t i = CLOUD - 1; i; i--) {
		size_t k = (size_t)rand() % (i + 1), t = order[i];

		order[i] = order[k];
		order[k] = t;
	}
	for (size_t i = 0; i < CLOUD; i++)
		memcpy(mixed[i], raw[order[i]], sizeof mixed[i]);
	all = (struct part){&b.params, (const int64_t(*)[3])mixed, again, CLOUD};
	assert_null(run_part(&all));
	for (size_t i = 0; i < CLOUD; i++)
		assert_memory_equal(again[i], at[order[i]], sizeof again[i]);
	/* Each alone, with a step of its own. */
	for (size_t i = 0; i < CLOUD; i += 500) {
		all = (struct part){&b.params, (const int64_t(*)[3]) & raw[i], &again[i], 1};
		assert_null(run_part(&all));
		assert_memory_equal(again[i], at[i], sizeof again[i]);
	}
	/* Two threads at once, the other half first. */
	memset(again, 0, sizeof again);
	for (int k = 0; k < 2; k++) {
		size_t from = k ? 0 : CLOUD / 2;

		two[k] = (struct part){&b.params, (const int64_t(*)[3]) & raw[from], &again[from], CLOUD / 2};
		pthread_create(&thread[k], NULL, run_part, &two[k]);
	}
	for (int k = 0; k < 2; k++) {
		void *failed;

		pthread_join(thread[k], &failed);
		assert_null(failed);
	}
	assert_memory_equal(again, at, sizeof at);
	unlink(path);
	free(path);
}

/* A file with another scale and offset, whose points are the same places. */
static void depends_on_no_file(void **state)
{
	const struct crs_zone z = {.number = 32, .north = true};
	double middle[2];
	struct bench b, c;
	struct crs_step *s, *t;
	struct err err = ERR_INIT;
	size_t bad;

	reference(z, 47.3, 8.2, middle);
	bench_init(&b, z, middle, -3);
	c = b;
	c.coords.scale[0] = (struct decimal){5, -9};
	c.coords.offset[0] = (struct decimal){8, 0};
	c.coords.scale[1] = (struct decimal){1, -8};
	c.coords.offset[1] = (struct decimal){-47, 0};
	c.params.coords = &c.coords;
	c.params.to = &c.to;
	c.params.lattice = &c.lattice;
	assert_int_equal(crs_step_new(&b.params, &s, &err), 0);
	assert_int_equal(crs_step_new(&c.params, &t, &err), 0);
	for (int i = 0; i < 20000; i++) {
		int64_t u = rand() % 100000000, v = rand() % 100000000;
		int64_t one[1][3] = {{8000000000 + 5 * u, 47000000000 + 10 * v, 7}}, other[1][3] = {{u, 9400000000 + v, 7}};
		int32_t p[1][3], q[1][3];

		assert_int_equal(crs_step_apply(s, (const int64_t(*)[3])one, 1, p, &bad, &err), 0);
		assert_int_equal(crs_step_apply(t, (const int64_t(*)[3])other, 1, q, &bad, &err), 0);
		/* Their doubles may differ in the last place: a nanometre, which may cross a half. */
		assert_true(abs(p[0][0] - q[0][0]) <= 1 && abs(p[0][1] - q[0][1]) <= 1 && p[0][2] == q[0][2]);
	}
	crs_step_free(s);
	crs_step_free(t);
}

/* ---- borders and refusals ---- */

static int one(const struct bench *b, double lon, double lat, int32_t ret[3], struct err *err)
{
	int64_t raw[1][3] = {{llround(lon * 1e9), llround(lat * 1e9), 5}};
	int32_t at[1][3] = {{0}};
	struct crs_step *s;
	size_t bad = 99;
	int r = crs_step_new(&b->params, &s, err);

	if (!r) {
		r = crs_step_apply(s, (const int64_t(*)[3])raw, 1, at, &bad, err);
		assert_true(!r || bad == 0);
		crs_step_free(s);
	}
	memcpy(ret, at[0], sizeof at[0]);
	return r;
}

static void refused(const struct bench *b, double lon, double lat, int code, const char *words)
{
	struct err err = ERR_INIT;
	int32_t at[3];
	int r = one(b, lon, lat, at, &err);

	if (r != -code || (!strstr(err.message, words) && !strstr(err.hint, words)))
		fail_msg("%g %g: %d, \"%s\" (%s), not \"%s\"", lon, lat, r, err.message, err.hint, words);
}

static void borders(void **state)
{
	const double origin[2] = {0, 0};
	struct bench b;
	struct err err = ERR_INIT;
	int32_t at[3], to[3];
	double want[2];

	/* Millimetres reach 2,147 km, so a coarser lattice. */
	bench_init(&b, (struct crs_zone){32, true}, origin, -2);
	assert_int_equal(one(&b, 24, 10, at, &err), 0);
	assert_int_equal(one(&b, -6, 10, at, &err), 0);
	refused(&b, 24.000001, 10, ERR_INPUT, "zone 32N");
	refused(&b, -6.000001, 10, ERR_INPUT, "--utm");
	refused(&b, -171, 10, ERR_INPUT, "meridian");
	refused(&b, 9, 90.1, ERR_INPUT, "no longitude and latitude");
	refused(&b, 9, -90.1, ERR_INPUT, "longitude and latitude");
	refused(&b, 45, 93, ERR_INPUT, "swapped");
	refused(&b, 361, 10, ERR_INPUT, "--override-crs");
	/* The other hemisphere keeps the zone's own numbers. */
	assert_int_equal(one(&b, 9, -1, at, &err), 0);
	earth_utm(WGS84_F, 32, 1, -1, 9, want);
	assert_true(at[0] == 50000000 && at[1] < 0 && fabs(at[1] / 100.0 - want[1]) < 0.0051);
	/* Both poles in one zone. */
	assert_int_equal(one(&b, 9, 90, at, &err), 0);
	assert_int_equal(one(&b, 1, 90, to, &err), 0);
	assert_true(abs(at[0] - to[0]) <= 1 && abs(at[1] - to[1]) <= 1);

	/* The antimeridian, in each way of writing it. */
	bench_init(&b, (struct crs_zone){60, false}, origin, -2);
	assert_int_equal(one(&b, -179.5, -17, at, &err), 0);
	assert_int_equal(one(&b, 180.5, -17, to, &err), 0);
	assert_memory_equal(at, to, sizeof at);
	assert_int_equal(one(&b, 180, -17, at, &err), 0);
	assert_int_equal(one(&b, -180, -17, to, &err), 0);
	assert_memory_equal(at, to, sizeof at);
	earth_utm(WGS84_F, 60, 0, -17, 180, want);
	assert_true(fabs(at[0] / 100.0 - want[0]) < 0.0051 && fabs(at[1] / 100.0 - want[1]) < 0.0051);

	/* UPS: from 60 degrees to the pole itself, whatever its longitude. */
	bench_init(&b, (struct crs_zone){0, false}, origin, -2);
	assert_int_equal(one(&b, 123, -90, at, &err), 0);
	assert_true(at[0] == 200000000 && at[1] == 200000000);
	assert_int_equal(one(&b, -180, -80, at, &err), 0);
	assert_int_equal(one(&b, 180, -80, to, &err), 0);
	assert_memory_equal(at, to, sizeof at);
	assert_int_equal(one(&b, 0, -60, at, &err), 0);
	refused(&b, 0, -59.9999, ERR_INPUT, "UPS-S");
	refused(&b, 0, 80, ERR_INPUT, "--utm");
	bench_init(&b, (struct crs_zone){0, true}, origin, -2);
	assert_int_equal(one(&b, 17, 90, at, &err), 0);
	assert_true(at[0] == 200000000 && at[1] == 200000000);

	/* What does not fit the lattice is said, not wrapped. */
	bench_init(&b, (struct crs_zone){32, true}, origin, -6);
	refused(&b, 9, 47, ERR_LIMIT, "lattice");
}

static void planes_refused(void **state)
{
	struct bench b;
	struct err err = ERR_INIT;
	struct crs_info nad27 = wgs;
	int32_t at[3];

	bench_init(&b, (struct crs_zone){32, true}, (double[2]){0, 0}, -2);
	snprintf(b.to.text, sizeof b.to.text, "EPSG:2154");
	assert_int_equal(one(&b, 9, 47, at, &err), -ERR_UNSUPPORTED);
	assert_non_null(strstr(err.message, "EPSG:2154"));
	bench_init(&b, (struct crs_zone){32, true}, (double[2]){0, 0}, -2);
	nad27.system.a = 6378206.4;
	b.params.from = &nad27;
	err = ERR_INIT;
	assert_int_equal(one(&b, 9, 47, at, &err), -ERR_UNSUPPORTED);
	assert_non_null(strstr(err.hint, "--planar"));
}

/* ---- headers ---- */

static void header_of(struct bench *b, double x0, double y0, double x1, double y1, struct lattice_input *ret, int want)
{
	struct err err = ERR_INIT;

	b->coords.min[0] = x0;
	b->coords.min[1] = y0;
	b->coords.max[0] = x1;
	b->coords.max[1] = y1;
	b->coords.min[2] = 1;
	b->coords.max[2] = 2;
	assert_int_equal(crs_step_coords(&b->params, ret, &err), want);
}

static void headers(void **state)
{
	static const struct {
		int from, to;
	} scale[] = {{-7, -3}, {-8, -4}, {-6, -2}, {-9, -4}, {-11, -4}, {-2, -2}, {0, -2}};
	struct bench b;
	struct lattice_input in;
	double a[2];

	bench_init(&b, (struct crs_zone){32, true}, (double[2]){0, 0}, -2);
	for (size_t i = 0; i < sizeof scale / sizeof *scale; i++) {
		b.coords.scale[0] = b.coords.scale[1] = (struct decimal){1, scale[i].from};
		header_of(&b, 8, 47, 8.1, 47.1, &in, 0);
		assert_int_equal(in.scale[0].exponent, scale[i].to);
		assert_int_equal(in.scale[1].mantissa, 1);
		assert_int_equal(in.scale[2].exponent, -3);
		assert_false(in.has_offset);
	}
	/* The box holds its corners. */
	for (int i = 0; i < 4; i++) {
		earth_utm(WGS84_F, 32, 1, i & 1 ? 47 : 47.1, i & 2 ? 8 : 8.1, a);
		header_of(&b, 8, 47, 8.1, 47.1, &in, 0);
		for (int k = 0; k < 2; k++)
			assert_true(in.min[k] <= a[k] + 1e-6 && a[k] <= in.max[k] + 1e-6);
	}
	assert_true(in.min[2] == 1 && in.max[2] == 2);
	/* One that lies of its extent is drawn in; one that says nothing stays so; no degrees are refused. */
	header_of(&b, -180, -90, 180, 90, &in, 0);
	assert_true(isfinite(in.min[0]) && isfinite(in.max[1]));
	header_of(&b, NAN, 47, 8.1, 47.1, &in, 0);
	assert_true(isnan(in.min[0]));
	header_of(&b, 8.2, 47, 8.1, 47.1, &in, 0);
	assert_true(isnan(in.min[0]));
	header_of(&b, 500000, 47, 500001, 47.1, &in, -ERR_INPUT);
	header_of(&b, 47, -93, 48, -92, &in, -ERR_INPUT);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(accuracy),
		cmocka_unit_test(accuracy_direct),
		cmocka_unit_test(depends_on_the_point_alone),
		cmocka_unit_test(depends_on_no_file),
		cmocka_unit_test(borders),
		cmocka_unit_test(planes_refused),
		cmocka_unit_test(headers),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
