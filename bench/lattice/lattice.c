/*
 * What mapping a file's numbers to a lattice costs, one thread, CPU time: scales and offsets that need a shift, a factor, and
 * a rounding, beside each other. Each is the best of several rounds, which take turns, so that the ratios hold on a machine
 * that has other things to do. usage: bench-lattice
 */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "err.h"
#include "lattice.h"

/* one batch, as ingest has it, many times: it stays in the cache there, too */
enum { BATCH = 8192, POINTS = 128 * BATCH, ROUNDS = 15 };

static const struct {
	const char *what, *scale[3], *offset[3], *lattice;
} cases[] = {
	{"equal scales", {"0.01", "0.01", "0.01"}, {"500000", "5400000", "0"}, "0.01 0.01 50000000 540000000 0"},
	{"y ten times as fine", {"0.01", "0.001", "0.01"}, {"500000", "5400000", "0"}, "0.001 0.01 500000000 5400000000 0"},
	{"x 0.01, y 0.003", {"0.01", "0.003", "0.01"}, {"500000", "5400000", "0"}, "0.003 0.01 166666666 1800000000 0"},
	{"offset between two steps",
	 {"0.01", "0.01", "0.01"},
	 {"500000.0037", "5400000.0041", "0.0013"},
	 "0.01 0.01 50000000 540000000 0"},
	{"a scale of 17 digits",
	 {"0.01", "0.00999999977648258", "0.01"},
	 {"500000", "5400000", "0"},
	 "999999977648258e-17 0.01 50000001 540000012 0"},
	{"offsets of 17 digits",
	 {"0.01", "0.01", "0.01"},
	 {"500000.12345678912", "5400000.1234567891", "0.12345678912345678"},
	 "0.01 0.01 50000012 540000012 12"},
};
enum { CASES = sizeof cases / sizeof *cases };

static int64_t raw[BATCH][3];
static int32_t at[BATCH][3];

static double cpu(void)
{
	struct timespec t;

	clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
	return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static int run(const struct lattice_map *map, double *ret_best, uint64_t *ret_moved, struct err *err)
{
	double began = cpu(), took, shift[3] = {0};
	size_t bad;
	int r = 0;

	*ret_moved = 0;
	for (size_t i = 0; !r && i < POINTS; i += BATCH)
		r = lattice_map_apply(map, (const int64_t(*)[3])raw, BATCH, at, ret_moved, shift, &bad, err);
	took = cpu() - began;
	if (*ret_best <= 0 || took < *ret_best)
		*ret_best = took;
	return r;
}

int main(void)
{
	struct lattice_map map[CASES];
	double best[CASES] = {0};
	uint64_t moved[CASES];
	struct err err = ERR_INIT;
	int r = 0;

	for (size_t i = 0; !r && i < CASES; i++) {
		struct lattice_input in = {.name = cases[i].what, .has_offset = true};
		struct lattice l;

		for (unsigned a = 0; a < 3; a++)
			if (!decimal_parse(cases[i].scale[a], &in.scale[a]) || !decimal_parse(cases[i].offset[a], &in.offset[a]))
				return 70;
		if (!lattice_parse(cases[i].lattice, &l))
			return 70;
		r = lattice_map_init(&map[i], &l, &in, &err);
	}
	srand(1);
	for (size_t i = 0; i < BATCH; i++)
		for (unsigned a = 0; a < 3; a++)
			raw[i][a] = rand() % 10000000;
	for (int round = 0; !r && round < ROUNDS; round++)
		for (size_t i = 0; !r && i < CASES; i++)
			r = run(&map[i], &best[i], &moved[i], &err);
	if (r) {
		fprintf(stderr, "bench-lattice: %s\n", err.message);
		return 70;
	}
	for (size_t i = 0; i < CASES; i++)
		printf("%-26s %6.2f ns a point, %5.2f of equal scales, %3.0f %% rounded\n", cases[i].what, best[i] * 1e9 / POINTS,
		       best[i] / best[0], 100.0 * (double)moved[i] / POINTS);
	return 0;
}
