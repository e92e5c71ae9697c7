/*
 * Areas: the exact test against another method (rays up instead of to the right, every edge of every ring, no index),
 * on so few coordinates that corners and edges are hit all the time, and on large ones that fill the index; their
 * normal form; boxes that cannot contain a point of the area.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "random.h"
#include "view_area.h"

enum { RINGS = 12, CORNERS = 40 };

struct model {
	struct {
		bool shell;
		unsigned n;
		int64_t at[CORNERS][2];
	} ring[RINGS];
	unsigned nring;
};

static uint64_t seed = 1;

static uint64_t roll(uint64_t n)
{
	return random_below(&seed, n);
}

static struct view_area *area_of(const struct model *m)
{
	struct view_area *a = view_area_new();
	struct err err = ERR_INIT;

	assert_non_null(a);
	for (unsigned r = 0; r < m->nring; r++) {
		assert_int_equal(view_area_ring(a, m->ring[r].shell, &err), 0);
		for (unsigned i = 0; i < m->ring[r].n; i++)
			assert_int_equal(view_area_corner(a, m->ring[r].at[i][0], m->ring[r].at[i][1], &err), 0);
	}
	assert_int_equal(view_area_end(a, &err), 0);
	return a;
}

static int sign128(__int128 v)
{
	return (v > 0) - (v < 0);
}

/* -1 outside of the ring, 0 on it, 1 in it. */
static int brute_ring(const struct model *m, unsigned r, int64_t x, int64_t y)
{
	unsigned n = m->ring[r].n;
	bool in = false;

	for (unsigned i = 0; i < n; i++) {
		const int64_t *p = m->ring[r].at[i], *q = m->ring[r].at[(i + 1) % n];
		int turn = sign128((__int128)(q[0] - p[0]) * (y - p[1]) - (__int128)(q[1] - p[1]) * (x - p[0]));

		if (!turn && (x - p[0] >= 0) + (x - q[0] >= 0) != 0 && (x - p[0] <= 0) + (x - q[0] <= 0) != 0 &&
		    (y - p[1] >= 0) + (y - q[1] >= 0) != 0 && (y - p[1] <= 0) + (y - q[1] <= 0) != 0)
			return 0;
		/* A ray upwards; the left end of an edge counts, the right one does not. */
		if (p[0] <= x && x < q[0])
			in ^= turn < 0;
		if (q[0] <= x && x < p[0])
			in ^= turn > 0;
	}
	return in ? 1 : -1;
}

static bool brute_has(const struct model *m, int64_t x, int64_t y)
{
	bool in = false;

	for (unsigned r = 0; r < m->nring; r++) {
		int side = brute_ring(m, r, x, y);

		if (m->ring[r].shell) {
			if (in)
				return true;
			in = side >= 0;
		} else if (side > 0) {
			in = false;
		}
	}
	return in;
}

static void random_model(struct model *m, unsigned corners, uint64_t range, int64_t scale, int64_t shift)
{
	memset(m, 0, sizeof *m);
	m->nring = 1 + (unsigned)roll(RINGS < corners ? RINGS : 5);
	for (unsigned r = 0; r < m->nring; r++) {
		m->ring[r].shell = !r || roll(3) == 0;
		m->ring[r].n = 1 + (unsigned)roll(corners);
		for (unsigned i = 0; i < m->ring[r].n; i++)
			for (unsigned k = 0; k < 2; k++)
				m->ring[r].at[i][k] =
					(int64_t)roll(range) * scale + shift + (scale > 1 ? (int64_t)roll((uint64_t)scale) : 0);
	}
}

static void test_small(void **state)
{
	unsigned in = 0, on = 0, all = 0;

	for (unsigned run = 0; run < 40000; run++) {
		struct model m;
		int range = 2 + (int)roll(7);
		int64_t shift = roll(2) ? -3 : INT64_C(-600000000123);

		random_model(&m, 3 + (unsigned)roll(9), (uint64_t)range, 1, shift);
		struct view_area *a = area_of(&m);

		for (int64_t y = shift - 1; y <= shift + range; y++) {
			for (int64_t x = shift - 1; x <= shift + range; x++) {
				bool want = brute_has(&m, x, y);

				if (view_area_has(a, x, y) != want)
					print_error("run %u at %lld %lld\n", run, (long long)(x - shift), (long long)(y - shift));
				assert_int_equal(view_area_has(a, x, y), want);
				for (unsigned r = 0; r < m.nring; r++)
					on += !brute_ring(&m, r, x, y);
				in += want;
				all++;
			}
		}
		view_area_free(a);
	}
	/* Shows that the cases are as intended. */
	print_message("%u positions, %u inside, %u times on an edge\n", all, in, on);
	assert_true(in > all / 8 && in < all * 4 / 5 && on > all / 5);
	(void)state;
}

/* Points on and near corners and edges of areas that fill strips and cells, up to the largest numbers. */
static void test_large(void **state)
{
	static const int64_t scales[] = {3, 1000, 123457, INT64_C(1) << 40, INT64_C(1) << 49};
	unsigned in = 0, all = 0;

	for (unsigned run = 0; run < 1500; run++) {
		int64_t scale = scales[roll(5)], shift = roll(2) ? 0 : -scale * 500;
		struct model m;

		random_model(&m, CORNERS, 1000, scale, shift);
		if (roll(4) == 0 && scale == scales[4])
			m.ring[0].at[0][0] = VIEW_AREA_MOST;
		struct view_area *a = area_of(&m);

		for (unsigned t = 0; t < 400; t++) {
			unsigned r = (unsigned)roll(m.nring), i = (unsigned)roll(m.ring[r].n);
			const int64_t *p = m.ring[r].at[i], *q = m.ring[r].at[(i + 1) % m.ring[r].n];
			int64_t part = (int64_t)roll(5), x = p[0] + (q[0] - p[0]) / 4 * part, y = p[1] + (q[1] - p[1]) / 4 * part;

			if (roll(3)) {
				x += (int64_t)roll(3) - 1;
				y += (int64_t)roll(3) - 1;
			}
			if (roll(8) == 0)
				x += (int64_t)roll((uint64_t)scale * 100) - scale * 50;
			assert_int_equal(view_area_has(a, x, y), brute_has(&m, x, y));
			in += brute_has(&m, x, y);
			all++;
		}
		view_area_free(a);
	}
	assert_true(in > all / 5 && in < all * 9 / 10);
	(void)state;
}

/* Every box with a position of the area is reported as meeting it; boxes far away are not. */
static void test_meets(void **state)
{
	unsigned none = 0, some = 0;

	for (unsigned run = 0; run < 3000; run++) {
		struct model m;

		random_model(&m, 12, 20, run % 2 ? 1 : 300, -40);
		struct view_area *a = area_of(&m);
		int64_t size = run % 2 ? 40 : 8000, from = run % 2 ? -50 : -1000;

		for (unsigned t = 0; t < 20; t++) {
			int64_t x = (int64_t)roll((uint64_t)size) + from, y = (int64_t)roll((uint64_t)size) + from;
			int64_t box[4] = {x, y, x + (int64_t)roll(12), y + (int64_t)roll(12)};
			bool any = false;

			for (int64_t v = box[1]; v <= box[3]; v++)
				for (int64_t u = box[0]; u <= box[2]; u++)
					any |= brute_has(&m, u, v);
			if (any)
				assert_true(view_area_meets(a, box));
			some += any;
			none += !any && !view_area_meets(a, box);
		}
		view_area_free(a);
	}
	print_message("%u boxes with a position, %u known to have none\n", some, none);
	assert_true(some > 3000 && none > 3000);
	(void)state;
}

/* Rings that start elsewhere, have the other direction or repeat corners are the same ring. */
static void test_normal(void **state)
{
	for (unsigned run = 0; run < 2000; run++) {
		struct model m, n;
		const int64_t(*c)[2], (*d)[2];
		bool shell;

		random_model(&m, 9, 6, 1, 0);
		m.nring = 1;
		n = m;
		n.ring[0].n = 0;
		unsigned start = (unsigned)roll(m.ring[0].n), back = (unsigned)roll(2);

		for (unsigned i = 0; i <= m.ring[0].n; i++) {
			unsigned at = (start + (back ? m.ring[0].n - i % m.ring[0].n : i)) % m.ring[0].n;

			for (uint64_t times = roll(4) ? 1 : 2; times; times--)
				memcpy(n.ring[0].at[n.ring[0].n++], m.ring[0].at[at], sizeof m.ring[0].at[at]);
		}
		struct view_area *a = area_of(&m), *b = area_of(&n);
		size_t k = view_area_ring_at(a, 0, &shell, &c);

		assert_true(shell);
		/* Rings that pass through their smallest corner twice may start at either. */
		unsigned least = 0;

		for (size_t i = 0; i < k; i++) {
			assert_true(c[i][0] > c[0][0] || (c[i][0] == c[0][0] && c[i][1] >= c[0][1]));
			least += c[i][0] == c[0][0] && c[i][1] == c[0][1];
		}
		if (least == 1) {
			assert_int_equal(view_area_ring_at(b, 0, &shell, &d), k);
			assert_memory_equal(c, d, k * sizeof *c);
		}
		view_area_free(a);
		view_area_free(b);
	}
	(void)state;
}

static void test_degenerate(void **state)
{
	struct model m = {.nring = 3};
	struct err err = ERR_INIT;
	struct view_area *a;
	int64_t bounds[4];

	/* A point, a line, and a hole without interior. */
	m.ring[0].shell = m.ring[1].shell = true;
	m.ring[0].n = 1;
	m.ring[0].at[0][0] = 5;
	m.ring[1].n = 2;
	m.ring[1].at[1][0] = 4;
	m.ring[1].at[1][1] = -2;
	m.ring[2].n = 2;
	m.ring[2].at[1][0] = 2;
	a = area_of(&m);
	assert_int_equal(view_area_rings(a), 2);
	assert_true(view_area_has(a, 5, 0) && view_area_has(a, 2, -1) && view_area_has(a, 0, 0));
	assert_false(view_area_has(a, 4, 0) || view_area_has(a, 1, 0) || view_area_has(a, 3, -1));
	assert_false(view_area_is_box(a));
	view_area_bounds(a, bounds);
	assert_int_equal(bounds[0], 0);
	assert_int_equal(bounds[1], -2);
	assert_int_equal(bounds[2], 5);
	assert_int_equal(bounds[3], 0);
	view_area_free(a);
	a = view_area_new();
	assert_int_equal(view_area_end(a, &err), -ERR_USAGE);
	view_area_free(a);
	err_clear(&err);
	a = view_area_new();
	assert_int_equal(view_area_ring(a, true, &err), 0);
	assert_int_equal(view_area_corner(a, VIEW_AREA_MOST + 1, 0, &err), 0);
	assert_int_equal(view_area_end(a, &err), -ERR_USAGE);
	view_area_free(a);
	view_area_free(NULL);
	(void)state;
}

static void test_box(void **state)
{
	static const int64_t corner[4][2] = {{0, 0}, {7, 0}, {7, 3}, {0, 3}};

	for (unsigned start = 0; start < 8; start++) {
		struct model m = {.nring = 1};
		struct view_area *a;

		m.ring[0].shell = true;
		m.ring[0].n = 4;
		for (unsigned i = 0; i < 4; i++)
			memcpy(m.ring[0].at[i], corner[(start / 2 + (start % 2 ? 4 - i : i)) % 4], sizeof corner[0]);
		a = area_of(&m);
		assert_true(view_area_is_box(a));
		view_area_free(a);
		m.ring[0].at[2][0]++;
		a = area_of(&m);
		assert_false(view_area_is_box(a));
		view_area_free(a);
	}
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_small),  cmocka_unit_test(test_large),      cmocka_unit_test(test_meets),
		cmocka_unit_test(test_normal), cmocka_unit_test(test_degenerate), cmocka_unit_test(test_box),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
