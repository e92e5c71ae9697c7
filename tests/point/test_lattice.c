/*
 * Lattices: the choice from headers, whatever their order; mapping against the inequality that defines a
 * floor, in exact numbers; and rounding that commutes with shifts.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "lattice.h"
#include "lattice_set.h"

static uint64_t random_state = 17;

static uint64_t rnd(void)
{
	uint64_t z = (random_state += 0x9e3779b97f4a7c15u);

	z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
	z = (z ^ z >> 27) * 0x94d049bb133111ebu;
	return z ^ z >> 31;
}

static struct decimal dec(const char *text)
{
	struct decimal d;

	assert_true(decimal_parse(text, &d));
	return d;
}

/* An input with the same numbers on x and y. */
static struct lattice_input input(const char *name, const char *scale, const char *offset, double min, double max)
{
	struct lattice_input in = {.name = name, .has_offset = offset != NULL};

	for (int a = 0; a < 3; a++) {
		in.scale[a] = dec(scale);
		in.offset[a] = dec(offset ? offset : "0");
		in.min[a] = min;
		in.max[a] = max;
	}
	return in;
}

static struct lattice lattice_of(const char *text)
{
	struct lattice l;

	assert_true(lattice_parse(text, &l));
	return l;
}

static void choose_is(const struct lattice_input *in, size_t n, const char *want)
{
	struct lattice_input turned[4];
	char text[LATTICE_TEXT_SIZE];

	for (size_t turn = 0; turn < n; turn++) {
		struct err err = ERR_INIT;
		struct lattice l;

		for (size_t i = 0; i < n; i++)
			turned[i] = in[(i + turn) % n];
		assert_int_equal(lattice_choose(turned, n, NULL, NULL, &l, &err), 0);
		assert_string_equal(lattice_text(&l, text), want);
	}
}

static void test_choose(void **state)
{
	struct lattice_input in[3];

	in[0] = input("a", "0.01", "500000", 500000, 501000);
	choose_is(in, 1, "0.01 0.01 50000000 50000000 50000000");
	in[1] = input("b", "0.01", "500000", 501000, 502000);
	choose_is(in, 2, "0.01 0.01 50000000 50000000 50000000"); /* one distinct (offset, scale) */
	in[1] = input("b", "0.01", "600000", 501000, 502000);
	choose_is(in, 2, "0.01 0.01 50100000 50100000 50100000"); /* the middle of the boxes */
	in[2] = input("c", "0.001", "0", 500000, 500010);
	choose_is(in, 3, "0.001 0.001 501000000 501000000 501000000");
	in[0] = input("a", "0.01", "-0.005", 0, 1);
	choose_is(in, 1, "0.005 0.005 -1 -1 -1"); /* so that none of its numbers is moved */
	in[0] = input("text", "0.001", NULL, -5, 10);
	choose_is(in, 1, "0.001 0.001 2500 2500 2500");
	in[0].scale[1] = dec("0.0001"); /* x and y differ: the finer for both */
	choose_is(in, 1, "0.0001 0.001 25000 25000 2500");
	in[0] = input("nobox", "0.01", "7", NAN, 1);
	in[1] = input("nobox2", "0.01", "5", 3, -3);
	choose_is(in, 2, "0.01 0.01 500 500 500");
	(void)state;
}

/* A file whose offset lies between two steps of its scale, or of two scales that are no multiples: nothing of it is moved where
 * a finer scale can have that. */
static void test_choose_exact(void **state)
{
	static const struct {
		const char *scale, *offset;
		double min, max;
		const char *want;
		bool exact;
	} cases[] = {
		{"0.01", "500000.123", 500000, 501000, "0.001 0.001 500000123 500000123 500000123", true},
		{"0.01", "500000.5", 500000, 501000, "0.01 0.01 50000050 50000050 50000050", true},
		{"0.01", "0.0025", 0, 1000, "0.0025 0.0025 1 1 1", true},
		{"0.25", "0.1", 0, 1000, "0.05 0.05 2 2 2", true},
		{"0.001", "1000000.00001", 999990, 1000010, "0.00001 0.00001 100000000001 100000000001 100000000001", true},
		/* more digits than there is room for, or than are worth it */
		{"0.01", "500000.12345678912", 500000, 501000, "0.01 0.01 50000012 50000012 50000012", false},
		{"0.01", "0.000001", 0, 1, "0.01 0.01 0 0 0", false},
		{"0.01", "0.001", 0, 100000, "0.01 0.01 0 0 0", false},
		{"0.01", "0.005", NAN, 1, "0.01 0.01 0 0 0", false},
	};

	for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
		struct lattice_input in[2] = {input("a", cases[i].scale, cases[i].offset, cases[i].min, cases[i].max)};
		const struct lattice l = lattice_of(cases[i].want);
		struct lattice_map m;
		struct err err = ERR_INIT;

		choose_is(in, 1, cases[i].want);
		assert_int_equal(lattice_map_init(&m, &l, &in[0], &err), 0);
		assert_int_equal(m.axis[0].exact && m.axis[1].exact && m.axis[2].exact, cases[i].exact);
		in[1] = in[0]; /* many that are alike as one */
		in[1].name = "b";
		choose_is(in, 2, cases[i].want);
	}
	/* What grows has room for tiles beside it, and a box that raw numbers cannot lie in, or of one position, says nothing. */
	static const struct {
		const char *scale, *offset;
		double min, max;
		bool grows;
		const char *want;
	} rooms[] = {
		{"0.001", "500000.000501", 500000, 500020, true, "0.001 0.001 500000000 500000000 500000000"},
		{"0.001", "500000.000501", 500000, 500020, false, "0.000001 0.000001 500000000501 500000000501 500000000501"},
		{"0.001", "500000.0005", 500000, 500020, true, "0.0005 0.0005 1000000001 1000000001 1000000001"},
		{"0.001", "4000000.0005", 0, 0, false, "0.001 0.001 4000000000 4000000000 4000000000"},
		{"0.001", "4000000.0005", 0, 100, false, "0.001 0.001 4000000000 4000000000 4000000000"},
	};

	for (size_t i = 0; i < sizeof rooms / sizeof *rooms; i++) {
		struct lattice_input in = input("a", rooms[i].scale, rooms[i].offset, rooms[i].min, rooms[i].max);

		in.grows = rooms[i].grows;
		choose_is(&in, 1, rooms[i].want);
	}
	struct lattice_input two = input("a", "0.01", "0", 0, 1000), other[2];

	two.scale[1] = dec("0.003");
	choose_is(&two, 1, "0.001 0.01 0 0 0");
	/* of inputs that differ each may be moved: the finest scale, as it is */
	other[0] = input("a", "0.01", "0.005", 0, 1000);
	other[1] = input("b", "0.01", "0", 0, 1000);
	choose_is(other, 2, "0.01 0.01 50000 50000 50000");
	(void)state;
}

static void test_choose_lying_box(void **state)
{
	struct lattice_input in[2] = {input("a", "0.01", "0", -1e300, 1e300), input("b", "0.01", "1", 0, 10)};
	struct err err = ERR_INIT;
	struct lattice l = {.k = {7}};

	/* Alone its box is not needed; with another it is, and can only be refused. */
	choose_is(in, 1, "0.01 0.01 0 0 0");
	assert_int_equal(lattice_choose(in, 2, NULL, NULL, &l, &err), -ERR_INPUT);
	assert_string_equal(err.file, "a");
	assert_int_equal(l.k[0], 7);
	(void)state;
}

static void test_choose_refused(void **state)
{
	static const char *const scales[] = {"0", "-0.01", "1e-41", "1e9", "123456789012345678e-10"};
	struct lattice_input in[2];
	struct decimal wanted;
	struct lattice l;

	for (size_t i = 0; i < 5; i++) {
		struct err err = ERR_INIT;

		in[0] = input("good", "0.01", "0", 0, 1);
		in[1] = input("bad", "0.01", "0", 0, 1);
		in[1].scale[i % 3] = dec(scales[i]);
		assert_int_equal(lattice_choose(in, 2, NULL, NULL, &l, &err), -ERR_INPUT);
		assert_string_equal(err.file, "bad");
		err_clear(&err);
		wanted = dec(scales[i]);
		assert_int_equal(lattice_choose(in, 1, &wanted, NULL, &l, &err), -ERR_USAGE);
	}
	struct err err = ERR_INIT;

	in[0] = input("coarse", "0.01", "0", 0, 5000000);
	in[1] = input("fine", "0.0000001", "0", 0, 1);
	assert_int_equal(lattice_choose(in, 2, NULL, NULL, &l, &err), -ERR_INPUT);
	assert_string_equal(err.file, "coarse"); /* its own extent is too wide for the finest scale */
	err_clear(&err);
	in[0] = input("near", "0.001", "0", 0, 5);
	in[1] = input("far", "0.00001", "0", 5000000, 5000001);
	assert_int_equal(lattice_choose(in, 2, NULL, NULL, &l, &err), -ERR_INPUT);
	assert_string_equal(err.file, "far");
	assert_true(err.hint[0]);
	err_clear(&err);
	wanted = dec("0.01");
	assert_int_equal(lattice_choose(in, 2, &wanted, &wanted, &l, &err), 0);
	(void)state;
}

/* A scale finer than the file's: the offset serves only while the data fit around it. */
static void test_choose_wanted(void **state)
{
	struct lattice_input in = input("a", "0.01", "0", 4000000, 4000100);
	struct decimal wanted = dec("0.001");
	struct err err = ERR_INIT;
	struct lattice l;

	assert_int_equal(lattice_choose(&in, 1, &wanted, NULL, &l, &err), 0);
	assert_int_equal(l.k[0], 4000050000);
	assert_int_equal(l.k[2], 0);
	(void)state;
}

/* ---- sets ---- */

static uint64_t seed = 7;

static unsigned pick(unsigned n)
{
	seed = seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
	return (unsigned)((seed >> 33) % n);
}

/* `in`, which may be rounded to scales up to `coarsest`. */
static struct lattice_input rounded(struct lattice_input in, const char *coarsest)
{
	for (int a = 0; a < 3; a++)
		in.coarsest[a] = dec(coarsest);
	return in;
}

/* The finest power of ten that holds all boxes, between the scale of those that may be rounded and what they may be rounded to.
 */
static void test_choose_rounded(void **state)
{
	static const struct {
		const char *scale, *exact;
		double min, max, width;
		const char *want;
	} rows[] = {
		{"1e-8", NULL, 0, 40, 0, "1e-8"}, /* fits as it is */
		{"1e-8", NULL, 0, 43, 0, "1e-7"},
		{"1e-8", NULL, 500000, 503000, 0, "1e-6"},
		{"1e-8", NULL, 0, 429000, 0, "1e-4"},
		{"1e-8", NULL, 0, 430000, 0, "5e-4"}, /* the coarsest, which is no power of ten */
		{"1e-8", NULL, 0, 2147000, 0, "5e-4"},
		{"1e-8", NULL, 0, 2148000, 0, NULL},
		{"3e-8", NULL, 0, 200, 0, "1e-7"},
		{"1e-8", "0.001", 0, 43, 10, "1e-7"}, /* each box alone would fit */
		{"1e-8", "0.001", 0, 20, 43, "1e-7"},
		{"1e-8", "0.00001", 0, 20, 42900, "0.00001"}, /* exact inputs stay exact */
		{"1e-8", "0.00001", 0, 20, 43000, NULL},
		{"1e-8", "0.000025", 0, 20, 42900, "0.000025"}, /* 1e-5 does not divide it */
		{"1e-8", "0.25", 0, 20, 429000, "1e-4"},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct lattice_input in[2] = {rounded(input("r", rows[i].scale, NULL, rows[i].min, rows[i].max), "5e-4")};
		size_t n = rows[i].exact ? 2 : 1;
		struct err err = ERR_INIT;
		struct lattice l, again;
		int r;

		if (rows[i].exact)
			in[1] = input("e", rows[i].exact, NULL, rows[i].min, rows[i].min + rows[i].width);
		r = lattice_choose(in, n, NULL, NULL, &l, &err);
		if (!r != !!rows[i].want ||
		    (!r && (decimal_compare(l.scale_xy, dec(rows[i].want)) || decimal_compare(l.scale_z, dec(rows[i].want)))))
			fail_msg("row %zu: %d, %de%d", i, r, (int)l.scale_xy.mantissa, l.scale_xy.exponent);
		if (n == 2) {
			struct lattice_input t = in[0];

			in[0] = in[1];
			in[1] = t;
			assert_int_equal(lattice_choose(in, n, NULL, NULL, &again, &err), r);
			assert_true(r || lattice_equal(&l, &again));
		}
	}
}

/* What grows has room for 64 times its width, and for neighbours of what is small: the finest power of ten that leaves it, and
 * never coarser than it may be rounded to. */
static void test_choose_grows(void **state)
{
	static const struct {
		const char *scale, *exact, *coarsest;
		double min, max;
		const char *want;
	} rows[] = {
		{"1e-12", NULL, "5e-4", 430000, 430100, "1e-4"}, /* a tile of a kilometre would fit */
		{"1e-12", NULL, "5e-4", 430000, 430000, "1e-4"}, /* one position */
		{"1e-6", NULL, "5e-4", 430000, 430300, "1e-4"},
		{"1e-6", NULL, "5e-4", 430000, 431000, "1e-4"}, /* it would fit */
		{"1e-12", NULL, "5e-4", 430000, 433300, "1e-4"},
		{"1e-12", NULL, "5e-4", 430000, 440000, "5e-4"},
		{"1e-12", NULL, "5e-4", 0, 2100000, "5e-4"},
		{"1e-4", NULL, "5e-4", 430000, 440000, "1e-4"}, /* hardly finer than it may be */
		{"0.001", NULL, NULL, 430000, 440000, "0.001"},
		{"1e-6", NULL, NULL, 430000, 431000, "1e-6"}, /* not to be rounded */
		{"1e-12", NULL, "1e-9", 9, 9.01, "1e-9"},     /* degrees */
		{"1e-12", "0.001", "5e-4", 430000, 431000, "1e-4"},
		{"1e-12", "0.000025", "5e-4", 430000, 431000, "0.000025"},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct lattice_input in[2] = {input("r", rows[i].scale, NULL, rows[i].min, rows[i].max)};
		size_t n = rows[i].exact ? 2 : 1;
		struct err err = ERR_INIT;
		struct lattice l;

		if (rows[i].coarsest)
			in[0] = rounded(in[0], rows[i].coarsest);
		if (rows[i].exact)
			in[1] = input("e", rows[i].exact, NULL, rows[i].min, rows[i].max);
		in[0].grows = in[1].grows = true;
		assert_int_equal(lattice_choose(in, n, NULL, NULL, &l, &err), 0);
		if (decimal_compare(l.scale_xy, dec(rows[i].want)) || decimal_compare(l.scale_z, dec(rows[i].want)))
			fail_msg("row %zu: %de%d", i, (int)l.scale_xy.mantissa, l.scale_xy.exponent);
	}
}

/* Of all kinds: alike, without boxes, with scales that are none, too wide, too fine, far out. */
static void fill(struct lattice_input *in, char (*names)[8], size_t n)
{
	bool grows = pick(2);

	static const char *const scales[] = {"0.01", "0.01", "0.01", "0.001", "0.000001", "7e-7", "1000", "0", "-1"};
	static const char *const offsets[] = {"0", "0", "500000", "-3.5", NULL};
	static const double boxes[][2] = {{0, 1}, {500000, 500100}, {-1e9, 1e9}, {5e6, 5.1e6}, {3, -3}, {-1e300, 1e300}};

	for (size_t i = 0; i < n; i++) {
		const double *box = boxes[pick(pick(3) ? 2 : 6)];

		snprintf(names[i], sizeof names[i], "%zu", i);
		in[i] = input(names[i], scales[pick(pick(3) ? 5 : 9)], offsets[pick(5)], box[0], box[1] + pick(3));
		if (!pick(4))
			in[i].scale[pick(3)] = dec(scales[pick(9)]);
		if (!pick(3))
			in[i] = rounded(in[i], pick(2) ? "5e-4" : "1e-9");
		in[i].grows = grows;
	}
}

/* Left out one by one, they are those that whoever asks anew each time leaves out, for the same reasons. */
static void test_set(void **state)
{
	for (unsigned turn = 0; turn < 3000; turn++) {
		struct lattice_input in[12], left[12];
		char names[12][8];
		size_t n = 1 + pick(12), m = n, which;
		struct lattice_set *set;

		fill(in, names, n);
		memcpy(left, in, sizeof in);
		set = lattice_set_new(in, n);
		assert_non_null(set);
		for (;;) {
			struct err want = ERR_INIT, got = ERR_INIT;
			struct lattice a = {.k = {1}}, b = {.k = {1}};
			int r = lattice_choose(left, m, NULL, NULL, &a, &want);

			assert_int_equal(lattice_set_choose(set, NULL, NULL, &b, &which, &got), r);
			assert_string_equal(got.message, want.message);
			assert_string_equal(got.file, want.file);
			if (!r) {
				assert_true(lattice_equal(&a, &b));
				assert_int_equal(which, n);
			}
			if (!r || m == 1)
				break;
			assert_true(which < n);
			assert_string_equal(in[which].name, want.file);
			lattice_set_remove(set, which);
			for (size_t i = 0; i < m; i++)
				if (!strcmp(left[i].name, want.file)) {
					memmove(&left[i], &left[i + 1], (m - i - 1) * sizeof *left);
					break;
				}
			m--;
			assert_int_equal(lattice_set_left(set), m);
		}
		lattice_set_free(set);
	}
	(void)state;
}

/* Thousands of which none fits with another are left out in the steps of a few sorts. */
static void test_set_steps(void **state)
{
	enum { N = 10000, LOG = 14, ORDERS = 25 };
	struct lattice_input *in = calloc(N, sizeof *in);
	char(*names)[8] = calloc(N, sizeof *names);
	struct lattice_set *set;
	struct lattice l;
	size_t which, gone = 0;

	for (size_t i = 0; i < N; i++) {
		snprintf(names[i], sizeof names[i], "%zu", i);
		in[i] = input(names[i], "0.001", NULL, (double)i * 1e8, (double)i * 1e8 + 1);
		in[i].scale[0].mantissa += (int64_t)i % 100;
	}
	set = lattice_set_new(in, N);
	for (;; gone++) {
		struct err err = ERR_INIT;

		if (!lattice_set_choose(set, NULL, NULL, &l, &which, &err))
			break;
		assert_int_equal(err.code, ERR_INPUT);
		lattice_set_remove(set, which);
	}
	assert_int_equal(gone, N - 1);
	assert_true(lattice_set_steps(set) < (uint64_t)ORDERS * N * (LOG + 2));
	lattice_set_free(set);
	free(in);
	free(names);
	(void)state;
}

static void test_text(void **state)
{
	static const char *const bad[] = {
		"",
		"0.01 0.01 1 2",
		"0.01 0.01 1 2 3 4",
		"0.010 0.01 1 2 3",
		"0.01  0.01 1 2 3",
		"0 0.01 1 2 3",
		"-1 1 1 2 3",
		"0.01 0.01 +1 2 3",
		"0.01 0.01 1 2 03",
		"0.01 0.01 1 2 4611686018427387905",
		"0.01 0.01 1 2 3 ",
		"1e-41 1 0 0 0",
	};
	char text[LATTICE_TEXT_SIZE];
	struct lattice l = {.k = {5}};

	for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
		assert_false(lattice_parse(bad[i], &l));
	assert_int_equal(l.k[0], 5);
	l = lattice_of("99999999999999999e-40 1 -4611686018427387904 4611686018427387904 0");
	assert_string_equal(lattice_text(&l, text), "99999999999999999e-40 1 -4611686018427387904 4611686018427387904 0");
	(void)state;
}

/* Tenths of a step, rounded by hand: halves go up, below zero too. */
static void test_map_rounding(void **state)
{
	struct lattice l = lattice_of("0.01 0.01 0 0 0");
	struct lattice_input in = input("a", "0.001", "0", 0, 1);
	struct lattice_map m;
	struct err err = ERR_INIT;

	assert_int_equal(lattice_map_init(&m, &l, &in, &err), 0);
	assert_false(m.axis[0].exact);
	for (int64_t raw = -25; raw <= 25; raw++) {
		int64_t r[1][3] = {{raw, raw, raw}};
		int32_t got[1][3];
		uint64_t moved = 0;
		double shift[3] = {0, 0, 0};
		size_t bad;
		int64_t want = (int64_t)floor((double)(raw * 2 + 10) / 20); /* floor(raw / 10 + 1/2) */

		assert_int_equal(lattice_map_apply(&m, (const int64_t(*)[3])r, 1, got, &moved, shift, &bad, &err), 0);
		for (int a = 0; a < 3; a++) {
			assert_int_equal(got[0][a], want);
			assert_true(fabs(shift[a] - fabs((double)(raw - want * 10)) * 0.001) < 1e-12);
		}
		assert_int_equal(moved, raw % 10 != 0);
	}
	(void)state;
}

/* A whole number of lattice steps added to a file's offset moves all its points by just that many. */
static void test_map_commutes(void **state)
{
	static const char *const scales[] = {"0.001", "0.01", "0.0025", "3048006096012192e-16", "0.3048", "1e-7", "7e-3"};
	static const char *const steps[] = {"0.01", "0.001", "3048006096012192e-17", "0.007"};

	for (int round = 0; round < 3000; round++) {
		struct lattice l = {.scale_xy = dec(steps[rnd() % 4]), .scale_z = dec(steps[rnd() % 4])};
		struct lattice_input in = input("a", scales[rnd() % 7], "0", 0, 1), moved_in;
		struct lattice_map m[2];
		struct err err = ERR_INIT;
		int64_t raw[16][3], by = (int64_t)(rnd() % 2000001) - 1000000;
		int32_t got[2][16][3];
		uint64_t moved[2] = {0, 0};
		double shift[2][3] = {{0}};
		size_t bad;

		for (int a = 0; a < 3; a++)
			in.offset[a] = (struct decimal){(int64_t)(rnd() % 20001) * 10 - 99999, -4};
		for (int i = 0; i < 16; i++)
			for (int a = 0; a < 3; a++)
				raw[i][a] = (int64_t)(rnd() % 2000001) - 1000000;
		moved_in = in;
		for (int v = 0; v < 2; v++) {
			struct lattice k = l;

			for (int a = 0; v && a < 3; a++)
				k.k[a] = l.k[a] - by; /* the same as moving the offset by `by` steps */
			assert_int_equal(lattice_map_init(&m[v], &k, v ? &moved_in : &in, &err), 0);
			assert_int_equal(
				lattice_map_apply(&m[v], (const int64_t(*)[3])raw, 16, got[v], &moved[v], shift[v], &bad, &err),
				0);
		}
		assert_int_equal(moved[0], moved[1]);
		for (int i = 0; i < 16; i++)
			for (int a = 0; a < 3; a++)
				assert_int_equal((int64_t)got[1][i][a] - got[0][i][a], by);
	}
	(void)state;
}

/* Fast, narrow and wide ways give the same numbers: X is the floor, checked by its defining inequality
 * in exact decimals: X - 1/2 <= v < X + 1/2. */
static void test_map_defining(void **state)
{
	static const char *const scales[] = {"0.001", "0.01", "1", "0.3048", "3048006096012192e-16", "123456789e-10", "0.1"};

	for (int round = 0; round < 20000; round++) {
		struct lattice l = {.scale_xy = dec(scales[rnd() % 7]), .scale_z = dec("1"), .k = {0, 0, 0}};
		struct lattice_input in = input("a", scales[rnd() % 7], "0", 0, 1);
		int64_t raw[1][3] = {{(int64_t)(rnd() % 4000001) - 2000000, 0, 0}};
		int32_t got[1][3];
		uint64_t moved = 0;
		double shift[3] = {0, 0, 0};
		struct lattice_map m;
		struct err err = ERR_INIT;
		size_t bad;

		assert_int_equal(lattice_map_init(&m, &l, &in, &err), 0);
		int rc = lattice_map_apply(&m, (const int64_t(*)[3])raw, 1, got, &moved, shift, &bad, &err);

		if (rc) { /* 2e6 / 0.001 fits 32 bits only just */
			assert_int_equal(rc, -ERR_LIMIT);
			continue;
		}
		/* All over 10^20: 2 * raw * scale against (2X - 1) * step and (2X + 1) * step. */
		__int128 v = 2 * (__int128)raw[0][0] * in.scale[0].mantissa, s = l.scale_xy.mantissa;

		for (int e = in.scale[0].exponent; e > -20; e--)
			v *= 10;
		for (int e = l.scale_xy.exponent; e > -20; e--)
			s *= 10;
		assert_true((2 * (__int128)got[0][0] - 1) * s <= v && v < (2 * (__int128)got[0][0] + 1) * s);
		assert_int_equal(moved, v != 2 * (__int128)got[0][0] * s);
	}
	(void)state;
}

/* v / d rounded as floor(v / d + 1/2) by division, and twice the distance from v / d in units of 1 / d. */
static __int128 divided(__int128 v, __int128 d, __int128 *ret_off)
{
	__int128 q = v / d, r = v % d;

	if (r < 0) {
		q--;
		r += d;
	}
	if (2 * r >= d) {
		q++;
		r -= d;
	}
	*ret_off = 2 * (r < 0 ? -r : r);
	return q;
}

static int64_t wide(unsigned bits)
{
	return bits ? (int64_t)(rnd() << 33 ^ rnd() << 11 ^ rnd()) & ((INT64_C(1) << bits) - 1) : 0;
}

/* Batches of any map, with numbers near halves and near both ends of 32 bits: the same as by division. */
static void test_map_divides(void **state)
{
	enum { N = 700 };
	static int64_t raw[N][3];
	static int32_t got[N][3];
	int done = 0;

	for (int round = 0; round < 3000; round++) {
		struct lattice_map m = {.scale = {dec("1"), dec("1"), dec("1")}};
		__int128 want[N][3], off, most[3] = {0, 0, 0};
		double shift[3] = {0, 0, 0};
		uint64_t moved = 0, want_moved = 0;
		struct err err = ERR_INIT;
		bool off_any[N] = {0};
		size_t bad;

		for (unsigned k = 0; k < 3; k++) {
			__int128 a = 1 + wide((unsigned)rnd() % 61), d = 1 + wide((unsigned)rnd() % (round % 5 ? 40 : 62));
			/* the middle is anywhere where raw can follow */
			__int128 b = (__int128)(wide(40) - (INT64_C(1) << 39)) * (rnd() % 2 ? d : a);

			if (rnd() % 4 == 0)
				d = a;
			if (rnd() % 4 == 0)
				d = 1 + (int64_t)(rnd() % 12);
			if (rnd() % 4 == 0) { /* halves, of large numbers */
				a = 1 + wide((unsigned)rnd() % 50);
				d = 2 * a;
				a *= 2 * (rnd() % 500) + 1;
				b = (__int128)(int32_t)rnd() * d;
			}
			m.axis[k].a = a;
			m.axis[k].b = b;
			m.axis[k].d = d;
			m.axis[k].exact = d == 1;
			for (size_t i = 0; i < N; i++) {
				int64_t q = i % 7 == 0 ? INT32_MAX : i % 7 == 1 ? INT32_MIN : (int32_t)rnd();
				__int128 at = (__int128)q * d - b, r = at / a;

				r = r > INT64_MAX ? INT64_MAX : r < INT64_MIN ? INT64_MIN : r;
				want[i][k] = divided(r * a + b, d, &off);
				/* at an end the next number may be the one that fits; else nothing does */
				for (int step = 0; step < 4 && (want[i][k] > INT32_MAX || want[i][k] < INT32_MIN); step++) {
					r += want[i][k] > INT32_MAX ? -1 : 1;
					want[i][k] = divided(r * a + b, d, &off);
				}
				if (want[i][k] > INT32_MAX || want[i][k] < INT32_MIN || r > INT64_MAX || r < INT64_MIN) {
					r = i ? raw[i - 1][k] : 0;
					want[i][k] = divided(r * a + b, d, &off);
				}
				raw[i][k] = (int64_t)r;
				off_any[i] |= off != 0;
				most[k] = off > most[k] ? off : most[k];
			}
		}
		for (size_t i = 0; i < N; i++)
			want_moved += off_any[i];
		int rc = lattice_map_apply(&m, (const int64_t(*)[3])raw, N, got, &moved, shift, &bad, &err);

		if (rc) { /* the first number already had no place */
			assert_int_equal(rc, -ERR_LIMIT);
			continue;
		}
		done++;
		assert_int_equal(moved, want_moved);
		for (size_t i = 0; i < N; i++)
			for (unsigned k = 0; k < 3; k++)
				assert_true(got[i][k] == want[i][k]);
		for (unsigned k = 0; k < 3; k++)
			assert_true(shift[k] == (double)most[k] / (2 * (double)m.axis[k].d));
	}
	assert_true(done > 1000);
	(void)state;
}

static void test_map_exact(void **state)
{
	struct lattice l = lattice_of("0.01 0.001 5 -5 0");
	struct lattice_input in = input("a", "0.01", "10", 0, 1);
	int64_t raw[3][3] = {{1, 2, 3}, {-1, -2, -3}, {2000000000, 0, 0}};
	int32_t got[3][3];
	uint64_t moved = 0;
	double shift[3] = {0, 0, 0};
	size_t bad = 99;
	struct lattice_map m;
	struct err err = ERR_INIT;

	in.scale[2] = dec("0.1");
	assert_int_equal(lattice_map_init(&m, &l, &in, &err), 0);
	assert_true(m.axis[0].exact && m.axis[1].exact && m.axis[2].exact);
	assert_int_equal(lattice_map_apply(&m, (const int64_t(*)[3])raw, 3, got, &moved, shift, &bad, &err), 0);
	assert_int_equal(got[0][0], 1 + 1000 - 5);
	assert_int_equal(got[1][1], -2 + 1000 + 5);
	assert_int_equal(got[1][2], -300 + 10000);
	assert_int_equal(got[2][0], 2000000995);
	assert_true(moved == 0 && shift[0] == 0);
	raw[2][2] = 21474737; /* 21474737 * 100 + 10000 = 2^31 + 52 */
	assert_int_equal(lattice_map_apply(&m, (const int64_t(*)[3])raw, 3, got, &moved, shift, &bad, &err), -ERR_LIMIT);
	assert_int_equal(bad, 2);
	raw[2][2] = 21474736; /* 2^31 - 48 */
	err_clear(&err);
	assert_int_equal(lattice_map_apply(&m, (const int64_t(*)[3])raw, 3, got, &moved, shift, &bad, &err), 0);
	assert_int_equal(got[2][2], INT32_MAX - 47);
	raw[1][1] = INT64_MIN;
	assert_int_equal(lattice_map_apply(&m, (const int64_t(*)[3])raw, 3, got, &moved, shift, &bad, &err), -ERR_LIMIT);
	assert_int_equal(bad, 1);
	assert_int_equal(lattice_map_apply(&m, (const int64_t(*)[3])raw, 0, got, &moved, shift, &bad, &err), 0);
	(void)state;
}

/* Numbers of many digits go the 128-bit way; what not even that can hold is refused with the file's name. */
static void test_map_wide(void **state)
{
	struct lattice l = lattice_of("0.0000001 0.01 0 0 0");
	struct lattice_input in = input("a", "99999999999999999e-25", "123456789012345e-15", 0, 1);
	int64_t raw[1][3] = {{5000000000000, -5000000000000, 1}};
	int32_t got[1][3];
	uint64_t moved = 0;
	double shift[3] = {0, 0, 0};
	size_t bad;
	struct lattice_map m;
	struct err err = ERR_INIT;

	assert_int_equal(lattice_map_init(&m, &l, &in, &err), 0);
	assert_int_equal(lattice_map_apply(&m, (const int64_t(*)[3])raw, 1, got, &moved, shift, &bad, &err), -ERR_LIMIT);
	err_clear(&err);
	raw[0][0] = 1000;
	raw[0][1] = -1000;
	assert_int_equal(lattice_map_apply(&m, (const int64_t(*)[3])raw, 1, got, &moved, shift, &bad, &err), 0);
	/* 1000 * 9.9999999999999999e-9 + 0.123456789012345 = 0.12346678901234499999: 1234667.89 steps */
	assert_int_equal(got[0][0], 1234668);
	assert_int_equal(got[0][1], 1234468); /* 1234467.89 */
	assert_int_equal(got[0][2], 12);
	assert_int_equal(moved, 1);
	in.offset[1] = dec("1e300");
	assert_int_equal(lattice_map_init(&m, &l, &in, &err), -ERR_INPUT);
	assert_string_equal(err.file, "a");
	err_clear(&err);
	in.offset[1] = dec("1e-300");
	assert_int_equal(lattice_map_init(&m, &l, &in, &err), -ERR_INPUT);
	err_clear(&err);
	in.offset[1] = dec("0");
	in.scale[0] = dec("0");
	assert_int_equal(lattice_map_init(&m, &l, &in, &err), -ERR_INPUT);
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_choose),        cmocka_unit_test(test_choose_lying_box),
		cmocka_unit_test(test_choose_exact),  cmocka_unit_test(test_choose_refused),
		cmocka_unit_test(test_choose_wanted), cmocka_unit_test(test_choose_rounded),
		cmocka_unit_test(test_choose_grows),  cmocka_unit_test(test_set),
		cmocka_unit_test(test_set_steps),     cmocka_unit_test(test_text),
		cmocka_unit_test(test_map_rounding),  cmocka_unit_test(test_map_commutes),
		cmocka_unit_test(test_map_defining),  cmocka_unit_test(test_map_divides),
		cmocka_unit_test(test_map_exact),     cmocka_unit_test(test_map_wide),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
