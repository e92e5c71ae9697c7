/*
 * What projecting and geoid heights cost, one thread, CPU time: the step of ingest beside direct calls of
 * GeographicLib. usage: bench-geo [GRID.pgm]
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "crs_geo.h"
#include "err.h"

enum { POINTS = 2000000, BATCH = 8192 };

static double cpu(void)
{
	struct timespec t;

	clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
	return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static int64_t raw[POINTS][3];
static int32_t at[POINTS][3];

/* Scan lines of 1,000 points over a square of `side` degrees, or places strewn over it. */
static void fill(double side, int strewn)
{
	srand(1);
	for (int i = 0; i < POINTS; i++) {
		double u = strewn ? rand() / (double)RAND_MAX : (i % 1000) / 1000.0;
		double v = strewn ? rand() / (double)RAND_MAX : i / (double)POINTS;

		raw[i][0] = llround((8 + side * u) * 1e7);
		raw[i][1] = llround((47 + side * v) * 1e7);
		raw[i][2] = 40000 + i % 1000;
	}
}

static void tell(const char *what, double side, int strewn, double seconds)
{
	printf("%-34s %5g degrees, %-10s %8.4f us a point %8.2f Mpt/s\n", what, side, strewn ? "strewn" : "scan lines",
	       seconds * 1e6 / POINTS, POINTS / seconds / 1e6);
}

static int run_step(const struct crs_step_params *p, const char *what, double side, int strewn, struct err *err)
{
	struct crs_step *s;
	double began = cpu();
	size_t bad;
	int r = crs_step_new(p, &s, err);

	for (int i = 0; !r && i < POINTS; i += BATCH)
		r = crs_step_apply(s, (const int64_t(*)[3])raw + i, POINTS - i < BATCH ? POINTS - i : BATCH, at + i, &bad, err);
	if (r)
		return r;
	tell(what, side, strewn, cpu() - began);
	crs_step_free(s);
	return 0;
}

static int run_direct(const struct crs_info *to, const struct crs_info *wgs, struct crs_zone z, double side, int strewn,
		      struct err *err)
{
	struct crs_geo *g;
	double began, x, y, worst = 0;
	struct crs_step_params p = {.from = wgs, .to = to};
	struct lattice lattice = {.scale_xy = {1, -4}, .scale_z = {1, -3}};
	struct lattice_input coords = {.name = "a", .scale = {{1, -7}, {1, -7}, {1, -2}}, .has_offset = true};
	struct crs_step *s;
	size_t bad;
	int r = crs_geo_new(&to->system, &g, err);

	if (r)
		return r;
	began = cpu();
	for (int i = 0; !r && i < POINTS; i++)
		r = crs_geo_forward(g, (double)raw[i][1] * 1e-7, (double)raw[i][0] * 1e-7, &x, &y, err);
	tell("direct calls", side, strewn, cpu() - began);
	if (!r)
		r = crs_geo_forward(g, 47 + side / 2, 8 + side / 2, &x, &y, err);
	/* How far the step is off, without the rounding to its lattice: half a step of 0.1 mm at most on top. */
	lattice.k[0] = llround(x * 1e4);
	lattice.k[1] = llround(y * 1e4);
	p.lattice = &lattice;
	p.coords = &coords;
	r = crs_step_new(&p, &s, err);
	for (int i = 0; !r && i < POINTS; i += 997) {
		int32_t one[1][3];

		r = crs_step_apply(s, (const int64_t(*)[3])raw + i, 1, one, &bad, err);
		if (r)
			break;
		r = crs_geo_forward(g, (double)raw[i][1] * 1e-7, (double)raw[i][0] * 1e-7, &x, &y, err);
		worst = fmax(worst, fmax(fabs(((double)one[0][0] + (double)lattice.k[0]) * 1e-4 - x),
					 fabs(((double)one[0][1] + (double)lattice.k[1]) * 1e-4 - y)));
	}
	if (!r)
		printf("  step and direct calls differ by %.3g mm at most, of which 0.05 mm are the lattice's\n", worst * 1e3);
	crs_step_free(s);
	crs_geo_free(g);
	return r;
}

int main(int argc, char **argv)
{
	const struct crs_info wgs = {
		.plane = CRS_PLANE_GEOGRAPHIC,
		.text = "EPSG:4326",
		.system = {.method = CRS_METHOD_GEOGRAPHIC,
			   .epsg = 4326,
			   .datum = "WGS 84",
			   .a = 6378137,
			   .inverse_flattening = 298.257223563,
			   .unit = 1,
			   .unit_z = 1},
	};
	const struct crs_zone z = {.number = 32, .north = true};
	const struct lattice lattice = {.scale_xy = {1, -3}, .scale_z = {1, -3}, .k = {500000000, 5200000000, 0}};
	const struct lattice_input coords = {.name = "a", .scale = {{1, -7}, {1, -7}, {1, -2}}, .has_offset = true};
	struct crs_info to;
	struct err err = ERR_INIT;
	char text[1024];
	int r = crs_zone_system(&wgs, z, &to, &err);

	for (int k = 0; !r && k < 3; k++) {
		double side = k ? 2 : 0.02;
		int strewn = k == 2;
		struct crs_step_params p = {.from = &wgs, .to = &to, .lattice = &lattice, .coords = &coords};

		fill(side, strewn);
		r = run_step(&p, "degrees to UTM", side, strewn, &err);
		if (!r && argc > 1) {
			p.geoid_path = argv[1];
			r = run_step(&p, "degrees to UTM, with geoid", side, strewn, &err);
		}
		if (!r)
			r = run_direct(&to, &wgs, z, side, strewn, &err);
		if (!r && argc > 1) {
			/* What was just projected, as a projected file. */
			const struct lattice_input plane = {.name = "b",
							    .scale = {{1, -3}, {1, -3}, {1, -2}},
							    .has_offset = true,
							    .offset = {{5, 5}, {52, 5}}};
			struct crs_step_params q = {.from = &to, .geoid_path = argv[1], .lattice = &lattice, .coords = &plane};

			for (int i = 0; i < POINTS; i++)
				for (int a = 0; a < 2; a++)
					raw[i][a] = at[i][a];
			r = run_step(&q, "geoid under a projected plane", side, strewn, &err);
		}
	}
	if (r)
		fprintf(stderr, "bench-geo: %s\n", err_format(&err, text, sizeof text));
	return r != 0;
}
