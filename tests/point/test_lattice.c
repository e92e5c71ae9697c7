/*
 * The choice of a lattice: from the headers of inputs in any order, as a set from which inputs are removed, and its text.
 */
#include "lattice_input.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "lattice_set.h"
#include "random.h"

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
	choose_is(in, 2, "0.01 0.01 50000000 50000000 50000000"); /* all have the same (offset, scale) */
	in[1] = input("b", "0.01", "600000", 501000, 502000);
	choose_is(in, 2, "0.01 0.01 50100000 50100000 50100000"); /* the middle of the boxes */
	in[2] = input("c", "0.001", "0", 500000, 500010);
	choose_is(in, 3, "0.001 0.001 501000000 501000000 501000000");
	in[0] = input("a", "0.01", "-0.005", 0, 1);
	choose_is(in, 1, "0.005 0.005 -1 -1 -1"); /* so that none of its numbers is rounded */
	in[0] = input("text", "0.001", NULL, -5, 10);
	choose_is(in, 1, "0.001 0.001 2500 2500 2500");
	in[0].scale[1] = dec("0.0001"); /* x and y differ: the finer one for both */
	choose_is(in, 1, "0.0001 0.001 25000 25000 2500");
	in[0] = input("nobox", "0.01", "7", NAN, 1);
	in[1] = input("nobox2", "0.01", "5", 3, -3);
	choose_is(in, 2, "0.01 0.01 500 500 500");
	(void)state;
}

/* A file whose offset is between two steps of its scale, or with two scales that are not multiples: no number is
 * rounded if a finer scale makes that possible. */
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
		/* more digits than fit, or than are worthwhile */
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
		in[1] = in[0]; /* many that are alike count as one */
		in[1].name = "b";
		choose_is(in, 2, cases[i].want);
	}
	/* A lattice that grows has room for neighbouring tiles; a box that is impossible for raw numbers, or a single
	 * position, is ignored. */
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
	/* numbers of inputs that differ may be rounded: the finest scale, unchanged */
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

	/* Alone its box does not matter; with another input it does, and can only be rejected. */
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

/* A scale finer than the file's: the offset is used only while the data fit around it. */
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
	return (unsigned)random_below(&seed, n);
}

/* `in`, which may be rounded to scales up to `coarsest`. */
static struct lattice_input rounded(struct lattice_input in, const char *coarsest)
{
	for (int a = 0; a < 3; a++)
		in.coarsest[a] = dec(coarsest);
	return in;
}

/* The finest power of ten with which all boxes fit, between the scale of inputs that may be rounded and their limit. */
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
		{"1e-8", NULL, 0, 430000, 0, "5e-4"}, /* the coarsest, which is not a power of ten */
		{"1e-8", NULL, 0, 2147000, 0, "5e-4"},
		{"1e-8", NULL, 0, 2148000, 0, NULL},
		{"3e-8", NULL, 0, 200, 0, "1e-7"},
		{"1e-8", "0.001", 0, 43, 10, "1e-7"}, /* each box would fit alone */
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

/* A lattice that grows has room for 64 times its width, and for neighbours of small data: the finest power of ten that
 * allows that, and never coarser than the limit of rounding. */
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
		{"1e-4", NULL, "5e-4", 430000, 440000, "1e-4"}, /* hardly finer than the limit */
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

/* Inputs of all kinds: alike, without boxes, with invalid scales, too wide, too fine, far out. */
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

/* Removing inputs one by one gives the same removals, for the same reasons, as asking anew each time. */
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

/* Thousands of inputs of which no two fit together are removed in the steps of a few sorts. */
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

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_choose),        cmocka_unit_test(test_choose_lying_box),
		cmocka_unit_test(test_choose_exact),  cmocka_unit_test(test_choose_refused),
		cmocka_unit_test(test_choose_wanted), cmocka_unit_test(test_choose_rounded),
		cmocka_unit_test(test_choose_grows),  cmocka_unit_test(test_set),
		cmocka_unit_test(test_set_steps),     cmocka_unit_test(test_text),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
