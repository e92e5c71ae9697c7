/*
 * The numbers of metrics: the normal form by its definition, the way back for extreme positions and origins, boxes in both
 * directions, the choice of an origin, and the hint of a direction that fits.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "err.h"
#include "random.h"
#include "view_metric.h"

static uint64_t state = 11;

static int64_t below(int64_t n)
{
	return (int64_t)(random_next(&state) % (uint64_t)n);
}

static bool is(struct view_metric m, int64_t p, int64_t q, int64_t k)
{
	return m.p == p && m.q == q && m.k == k;
}

static struct view_metric random_metric(void)
{
	int64_t most = below(3) ? 7 : VIEW_METRIC_MOST;

	return view_metric_normal((struct view_metric){below(2 * most + 1) - most, 1 + below(most), 2 + below(most - 1)});
}

static void test_normal(void **unused)
{
	static const struct view_metric same[] = {{3, 1, 5}, {-3, -1, 5}, {6, 2, 5}, {-600, -200, 5}};

	(void)unused;
	for (unsigned i = 0; i < 4; i++)
		assert_true(is(view_metric_normal(same[i]), 3, 1, 5));
	assert_true(is(view_metric_normal((struct view_metric){0, -7, 2}), 0, 1, 2));
	assert_true(is(view_metric_normal((struct view_metric){-7, 0, 2}), 1, 0, 2));
	assert_true(is(view_metric_normal((struct view_metric){-2, 4, 2}), 1, -2, 2));
	assert_true(is(view_metric_normal((struct view_metric){3, 4, 1}), 0, 0, 0));
	assert_true(is(view_metric_normal((struct view_metric){INT64_MIN, 0, 2}), 1, 0, 2));
	assert_true(is(view_metric_normal((struct view_metric){INT64_MIN, INT64_MIN, 2}), 1, 1, 2));
	/* It does not change any more, and no two of them have the same ellipses: forms are not multiples of each other. */
	for (int i = 0; i < 200000; i++) {
		struct view_metric a = random_metric(), b = random_metric();
		__int128 f[2][3];

		assert_true(is(view_metric_normal(a), a.p, a.q, a.k));
		for (int n = 0; n < 2; n++) {
			struct view_metric m = n ? b : a;

			f[n][0] = (__int128)m.p * m.p + (__int128)m.k * m.k * m.q * m.q;
			f[n][1] = (__int128)m.p * m.q * (1 - m.k * m.k);
			f[n][2] = (__int128)m.q * m.q + (__int128)m.k * m.k * m.p * m.p;
		}
		bool equal = f[0][0] * f[1][1] == f[0][1] * f[1][0] && f[0][0] * f[1][2] == f[0][2] * f[1][0];

		assert_int_equal(equal, is(a, b.p, b.q, b.k));
	}
}

static void test_check(void **unused)
{
	static const struct view_metric bad[] = {{0, 0, 2}, {1, 0, 0}, {1, 0, -3}, {1, 0, 10001}, {10001, 1, 2}, {1, -10001, 2}};
	static const struct view_metric good[] = {{0, 0, 0}, {1, 0, 1}, {10000, 9999, 10000}, {-10000, 1, 2}, {30000, 30000, 2}};

	(void)unused;
	for (unsigned i = 0; i < sizeof bad / sizeof *bad; i++) {
		struct err err = ERR_INIT;

		assert_int_equal(view_metric_check(bad[i], &err), -ERR_USAGE);
		assert_true(err.hint[0]);
	}
	for (unsigned i = 0; i < sizeof good / sizeof *good; i++) {
		struct err err = ERR_INIT;

		assert_int_equal(view_metric_check(good[i], &err), 0);
	}
}

/* Positions near any corner of the lattice, as far from each other as the mapped range allows. */
static void test_back(void **unused)
{
	static const int32_t corner[] = {INT32_MIN, -1000000000, 0, 7, INT32_MAX - 30000};
	uint64_t tried = 0;

	(void)unused;
	for (int i = 0; i < 300000; i++) {
		struct view_metric m = random_metric();
		int64_t x0 = corner[below(5)], y0 = corner[below(5)], span = 1 + below(below(2) ? 20000 : 12), low[2], high[2];
		int64_t at[4][2], xy[4][2], from[2];
		struct view_map map;

		for (int k = 0; k < 4; k++) {
			xy[k][0] = x0 + below(span);
			xy[k][1] = y0 + below(span);
			view_metric_image(&m, xy[k][0], xy[k][1], at[k]);
			for (int a = 0; a < 2; a++) {
				low[a] = !k || at[k][a] < low[a] ? at[k][a] : low[a];
				high[a] = !k || at[k][a] > high[a] ? at[k][a] : high[a];
			}
		}
		if (!view_metric_origin(low[0], high[0], &from[0]) || !view_metric_origin(low[1], high[1], &from[1])) {
			assert_true(high[0] - low[0] > UINT32_MAX || high[1] - low[1] > UINT32_MAX);
			continue;
		}
		tried++;
		view_map_init(&map, m, from);
		for (int k = 0; k < 4; k++) {
			const int32_t to[2] = {(int32_t)(at[k][0] - from[0]), (int32_t)(at[k][1] - from[1])};
			int32_t back[2];

			assert_true(at[k][0] - from[0] == to[0] && at[k][1] - from[1] == to[1]);
			view_map_back(&map, to, back);
			assert_true(back[0] == xy[k][0] && back[1] == xy[k][1]);
		}
		/* The box of two corners, there and back, contains both. */
		int64_t box[4], there[4], again[4];

		for (int a = 0; a < 2; a++) {
			box[a] = xy[0][a] < xy[1][a] ? xy[0][a] : xy[1][a];
			box[2 + a] = xy[0][a] < xy[1][a] ? xy[1][a] : xy[0][a];
		}
		view_map_box(&map, box, there);
		view_map_box_back(&map, there, again);
		for (int a = 0; a < 2; a++) {
			for (int k = 0; k < 2; k++)
				assert_true(there[a] <= at[k][a] - from[a] && at[k][a] - from[a] <= there[2 + a]);
			assert_true(again[a] <= box[a] && again[2 + a] >= box[2 + a]);
		}
		/* A box of one position, not larger than needed. */
		const int64_t one[4] = {at[0][0] - from[0], at[0][1] - from[1], at[0][0] - from[0], at[0][1] - from[1]};

		view_map_box_back(&map, one, again);
		for (int a = 0; a < 2; a++)
			assert_true(again[a] == xy[0][a] && again[2 + a] == xy[0][a]);
	}
	assert_true(tried > 100000);
}

static void test_origin(void **unused)
{
	int64_t from = 7;

	(void)unused;
	assert_true(view_metric_origin(INT32_MIN, INT32_MAX, &from) && from == 0);
	assert_true(view_metric_origin(-5, 2000000000, &from) && from == 0);
	assert_true(view_metric_origin(INT64_C(5) << 32, INT64_C(5) << 32, &from) && from == INT64_C(5) << 32);
	assert_false(view_metric_origin(0, INT64_C(1) << 32, &from));
	for (int i = 0; i < 200000; i++) {
		int64_t low = (int64_t)random_next(&state) >> (3 + below(40)),
			span = (int64_t)(random_next(&state) >> (30 + below(34)));
		bool fits = view_metric_origin(low, low + span, &from);

		assert_int_equal(fits, span <= UINT32_MAX);
		if (!fits)
			continue;
		assert_true(low - from >= INT32_MIN && low + span - from <= INT32_MAX);
		/* Points that come later within the same half of the range keep it. */
		if (span < INT32_MAX / 2)
			assert_true(from % (INT64_C(1) << 31) == 0);
	}
}

static void test_simpler(void **unused)
{
	struct view_metric m = {9991, 7919, 10}, got;

	(void)unused;
	assert_true(view_metric_simpler(&m, 20000000, 20000000, &got));
	assert_true(got.k == 10 && got.p && got.q && fabs(atan2((double)got.q, (double)got.p) - atan2(7919, 9991)) < .02);
	assert_true(10 * (got.p + got.q) * 20000000 <= UINT32_MAX);
	m.q = -7919;
	assert_true(view_metric_simpler(&m, 20000000, 20000000, &got) && got.q < 0);
	assert_false(view_metric_simpler(&m, 2000000000, 2000000000, &got));
	m = (struct view_metric){0, 1, 2};
	assert_true(view_metric_simpler(&m, 2000000000, 2000000000, &got) && is(got, 0, 1, 2));
	m = (struct view_metric){1, 9999, 2};
	assert_true(view_metric_simpler(&m, 2000000000, 2000000000, &got) && is(got, 0, 1, 2));
	m = (struct view_metric){9999, -1, 2};
	assert_true(view_metric_simpler(&m, 2000000000, 2000000000, &got) && is(got, 1, 0, 2));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_normal), cmocka_unit_test(test_check),   cmocka_unit_test(test_back),
		cmocka_unit_test(test_origin), cmocka_unit_test(test_simpler),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
