/*
 * Mapping raw numbers to a lattice: against the inequality that defines a floor, in exact numbers; and rounding that
 * commutes with shifts.
 */
#include "lattice_input.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "random.h"

static uint64_t random_state = 17;

static uint64_t rnd(void)
{
	return random_next(&random_state);
}

/* Tenths of a step, rounded by hand: halves go up, also below zero. */
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

/* A whole number of lattice steps added to a file's offset moves all its points by exactly that many. */
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

/* The fast, narrow and wide paths give the same numbers: X is the floor, checked by its defining inequality in exact
 * decimals: X - 1/2 <= v < X + 1/2. */
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

		if (rc) { /* 2e6 / 0.001 only just fits 32 bits */
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
			/* the middle is anywhere that raw can reach */
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
				/* at an end the next number may be the one that fits; else none does */
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

		if (rc) { /* the first number already does not fit */
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

/* Numbers of many digits take the 128-bit path; what does not fit even that is rejected with the file's name. */
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
		cmocka_unit_test(test_map_rounding), cmocka_unit_test(test_map_commutes), cmocka_unit_test(test_map_defining),
		cmocka_unit_test(test_map_divides),  cmocka_unit_test(test_map_exact),    cmocka_unit_test(test_map_wide),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
