/*
 * The exact signs against their definition in numbers of any size (oracle.h).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "geom.h"
#include "geom_power.h"
#include "oracle.h"

static uint64_t state = 0x853c49e6748fea9b;

static uint32_t draw(void)
{
	state ^= state >> 12;
	state ^= state << 25;
	state ^= state >> 27;
	return (uint32_t)(state * UINT64_C(0x2545f4914f6cdd1d) >> 32);
}

static const int32_t extremes[] = {INT32_MIN, INT32_MIN + 1, -1, 0, 1, INT32_MAX - 1, INT32_MAX};

/* Families of positions: the size of the numbers decides which path of geom.h is taken. */
enum { FAMILIES = 9 };

static int32_t draw_in(unsigned family)
{
	switch (family) {
	case 0:
		return (int32_t)(draw() % 6);
	case 1:
		return extremes[draw() % 7];
	case 2:
		return (int32_t)draw();
	case 3:
		return (int32_t)(draw() % 65536) - 32768; /* the edge of the 16-bit path */
	case 4:
		return (draw() & 1 ? 32767 : -32767) + (int32_t)(draw() % 4) - 2;
	case 5:
		return INT32_MAX - (int32_t)(draw() % 6);
	case 6:
		return (draw() & 1 ? 1073741823 : -1073741824) + (int32_t)(draw() % 4) - 2; /* of 31 bits */
	default:
		return 1000000 * ((int32_t)(draw() % 9) - 4);
	}
}

static void draw_points(int32_t p[4][2], unsigned family)
{
	/* Corners and middles of squares around the size at which 64 bits no longer suffice. */
	if (family == FAMILIES - 1) {
		int32_t half = (int32_t)(20000 + draw() % 30000);

		for (unsigned i = 0; i < 4; i++)
			for (unsigned k = 0; k < 2; k++)
				p[i][k] = half * (int32_t)(draw() % 3) + (int32_t)(draw() % 3);
		return;
	}
	for (unsigned i = 0; i < 4; i++)
		for (unsigned k = 0; k < 2; k++)
			p[i][k] = draw_in(family);
}

static bool distinct(int32_t p[4][2])
{
	for (unsigned i = 0; i < 4; i++)
		for (unsigned j = 0; j < i; j++)
			if (p[i][0] == p[j][0] && p[i][1] == p[j][1])
				return false;
	return true;
}

static void orient_any(void **unused)
{
	unsigned zero = 0;

	for (unsigned i = 0; i < 200000; i++) {
		int32_t p[4][2];
		int want;

		draw_points(p, i % FAMILIES);
		want = oracle_orient(p[0], p[1], p[2]);
		assert_int_equal(geom_orient(p[0], p[1], p[2]), want);
		assert_int_equal(geom_sign128(geom_area(p[0], p[1], p[2])), want);
		zero += want == 0;
	}
	assert_true(zero > 1000);
}

static void incircle_any(void **unused)
{
	unsigned ties = 0;

	for (unsigned i = 0; i < 400000; i++) {
		int32_t p[4][2];
		int plain;

		draw_points(p, i % FAMILIES);
		if (!distinct(p) || oracle_orient(p[0], p[1], p[2]) <= 0)
			continue;
		plain = oracle_incircle(p[0], p[1], p[2], p[3], false);
		assert_int_equal(geom_incircle_plain(p[0], p[1], p[2], p[3]), plain);
		assert_int_equal(geom_incircle(p[0], p[1], p[2], p[3]), oracle_incircle(p[0], p[1], p[2], p[3], true));
		ties += plain == 0;
	}
	assert_true(ties > 1000);
}

/* Three corners and the centre of the full square: |det| is closest to 2^127. */
static void incircle_bound(void **unused)
{
	const int32_t lo = INT32_MIN, hi = INT32_MAX;
	const int32_t corner[4][2] = {{lo, lo}, {hi, lo}, {hi, hi}, {lo, hi}};
	unsigned seen[3] = {0};

	for (unsigned k = 0; k < 4; k++)
		for (int cx = -1; cx <= 0; cx++)
			for (int cy = -1; cy <= 0; cy++) {
				const int32_t *a = corner[k], *b = corner[(k + 1) % 4], *c = corner[(k + 2) % 4];
				const int32_t m[2] = {cx, cy};
				const int32_t *const order[4][4] = {{a, b, c, m}, {m, a, b, c}, {b, c, m, a}, {c, m, a, b}};

				for (unsigned o = 0; o < 4; o++) {
					const int32_t *p = order[o][0], *q = order[o][1], *r = order[o][2];

					if (oracle_orient(p, q, r) < 0) {
						const int32_t *t = p;

						p = q;
						q = t;
					}
					if (oracle_orient(p, q, r) == 0)
						continue;
					int want = oracle_incircle(p, q, r, order[o][3], false);

					assert_int_equal(geom_incircle_plain(p, q, r, order[o][3]), want);
					seen[want + 1]++;
				}
			}
	assert_true(seen[0] > 0 && seen[2] > 0);
}

/* The value of the determinant of three corners and the centre: exactly S^4 / 2. */
static void incircle_bound_value(void **unused)
{
	const int64_t s = UINT32_MAX, h = (s + 1) / 2;
	geom_i128 det =
		geom_lift_det(-h, -h, geom_lift(-h, -h), s - h, -h, geom_lift(s - h, -h), s - h, s - h, geom_lift(s - h, s - h));
	geom_i128 mirror =
		geom_lift_det(s - h, -h, geom_lift(s - h, -h), -h, -h, geom_lift(-h, -h), s - h, s - h, geom_lift(s - h, s - h));

	assert_true(det > (geom_i128)1 << 126);
	assert_true(det == -mirror);
}

static void heights_are_parameters(void **unused)
{
	/* A unit square, d at the origin: on the circle of the others, until b's height changes. */
	for (int w = -1; w <= 1; w++)
		assert_true(geom_lift_det(1, 0, 1, 1, 1, 2 - (geom_u128)w, 0, 1, 1) == w);
}

static void cut_any(void **unused)
{
	unsigned ties = 0, sides[2] = {0};

	for (unsigned i = 0; i < 400000; i++) {
		unsigned family = i % FAMILIES;
		bool vertical = draw() & 1;
		int32_t p[4][2];
		int64_t c2;
		int want;

		draw_points(p, family);
		if (oracle_orient(p[0], p[1], p[2]) <= 0)
			continue;
		c2 = (int64_t)draw_in(family) + draw_in(family);
		c2 = c2 & 1 ? c2 : draw() & 1 ? c2 + 1 : c2 - 1;
		want = oracle_cut_side(p[0], p[1], p[2], c2, vertical, true);
		assert_int_not_equal(want, 0);
		assert_int_equal(geom_cut_side(p[0], p[1], p[2], c2, vertical), want);
		ties += oracle_cut_side(p[0], p[1], p[2], c2, vertical, false) == 0;
		sides[want > 0]++;
	}
	assert_true(ties > 1000);
	assert_true(sides[0] > 10000 && sides[1] > 10000);
}

/* Cuts at the cell centres of grids of odd spacing: every circumcentre is exactly on one of each kind. All
 * triangles of each cell, every rotation, both diagonals; spacings up to the whole range. */
static void cut_through_cell_centres(void **unused)
{
	static const int64_t steps[] = {1, 3, 5, 16777, 1000001, 2147483647, 4294967295};
	unsigned done = 0;

	for (unsigned s = 0; s < sizeof(steps) / sizeof(steps[0]); s++)
		for (unsigned cell = 0; cell < 64; cell++) {
			int64_t room = UINT32_MAX / steps[s];
			int64_t x = INT32_MIN + steps[s] * (draw() % room), y = INT32_MIN + steps[s] * (draw() % room);
			const int32_t q[4][2] = {{(int32_t)x, (int32_t)y},
						 {(int32_t)(x + steps[s]), (int32_t)y},
						 {(int32_t)(x + steps[s]), (int32_t)(y + steps[s])},
						 {(int32_t)x, (int32_t)(y + steps[s])}};

			for (unsigned skip = 0; skip < 4; skip++)
				for (unsigned turn = 0; turn < 3; turn++)
					for (int vertical = 0; vertical < 2; vertical++) {
						const int32_t *v[3] = {q[(skip + 1) % 4], q[(skip + 2) % 4], q[(skip + 3) % 4]};
						const int32_t *a = v[turn], *b = v[(turn + 1) % 3], *c = v[(turn + 2) % 3];
						int64_t c2 = 2 * (vertical ? x : y) + steps[s];

						assert_int_equal(oracle_cut_side(a, b, c, c2, vertical, false), 0);
						assert_int_equal(geom_cut_side(a, b, c, c2, vertical),
								 oracle_cut_side(a, b, c, c2, vertical, true));
						assert_int_equal(geom_cut_side(a, b, c, c2 - 2, vertical), 1);
						assert_int_equal(geom_cut_side(a, b, c, c2 + 2, vertical), -1);
						done++;
					}
		}
	assert_true(done > 10000);
}

/* Needles: circumcentres far outside the range, and close to the filter's bound. */
static void cut_of_needles(void **unused)
{
	for (unsigned i = 0; i < 200000; i++) {
		int32_t p[3][2];
		int64_t dx = (int64_t)draw() >> 2, dy = (int64_t)draw() >> 2, c2;
		bool vertical = draw() & 1;

		p[0][0] = -(int32_t)(dx / 2), p[0][1] = -(int32_t)(dy / 2);
		p[1][0] = (int32_t)(dx / 2) + (int32_t)(draw() % 3), p[1][1] = (int32_t)(dy / 2);
		p[2][0] = (int32_t)(draw() % 3) - 1, p[2][1] = (int32_t)(draw() % 3) - 1;
		if (oracle_orient(p[0], p[1], p[2]) <= 0)
			continue;
		c2 = 2 * (int64_t)(int32_t)draw() + 1;
		assert_int_equal(geom_cut_side(p[0], p[1], p[2], c2, vertical),
				 oracle_cut_side(p[0], p[1], p[2], c2, vertical, true));
	}
}

/* Thin triangles as long as the range, with a circumcentre near the middle of the long side, and cuts next to it: the
 * sign depends on a difference far below the resolution of doubles. */
static void cut_below_double_precision(void **unused)
{
	unsigned done = 0;

	for (unsigned i = 0; i < 200000; i++) {
		bool vertical = draw() & 1;
		int32_t a[2], b[2], c[2];
		int64_t c2, bx, by, cx, cy;
		geom_i128 area, twice;

		a[0] = INT32_MIN + (int32_t)(draw() % 1000000);
		b[0] = INT32_MAX - (int32_t)(draw() % 1000000);
		a[1] = (int32_t)draw() / 2;
		b[1] = (int32_t)draw() / 2;
		c[0] = b[0] - (int32_t)(draw() % 3);
		c[1] = b[1] + 1 + (int32_t)(draw() % 5);
		bx = (int64_t)b[0] - a[0], by = (int64_t)b[1] - a[1];
		cx = (int64_t)c[0] - a[0], cy = (int64_t)c[1] - a[1];
		area = geom_area(a, b, c);
		if (area <= 0)
			continue;
		twice = geom_cut_value(vertical ? a[0] : a[1], vertical ? by : bx, (geom_i128)geom_lift(bx, by),
				       vertical ? cy : cx, (geom_i128)geom_lift(cx, cy), area, 0, vertical) /
			area;
		if (twice > INT64_C(1) << 33 || twice < -(INT64_C(1) << 33))
			continue;
		c2 = ((int64_t)twice | 1) + 2 * (int64_t)(draw() % 3) - 2;
		assert_int_equal(geom_cut_side(a, b, c, c2, vertical), oracle_cut_side(a, b, c, c2, vertical, true));
		done++;
	}
	assert_true(done > 50000);
}

/* ---- weights ---- */

static int64_t draw_weight(unsigned family)
{
	int64_t radius = draw() & 1 ? draw() % 4 : draw() % (family == 0 ? 7 : (uint32_t)GEOM_RADIUS_MOST + 1);

	if (draw() % 8 == 0)
		radius = GEOM_RADIUS_MOST;
	return radius * radius;
}

static void power_any(void **unused)
{
	for (unsigned i = 0; i < 300000; i++) {
		unsigned family = i % FAMILIES;
		int32_t p[4][2];
		int64_t w[4];
		const int32_t *const at[4] = {p[0], p[1], p[2], p[3]};
		struct geom_weighted v[4];
		int64_t c2 = 2 * (int64_t)draw_in(family) + 1;

		draw_points(p, family);
		for (unsigned k = 0; k < 4; k++)
			w[k] = draw_weight(family);
		for (unsigned k = 0; k < 4; k++)
			v[k] = (struct geom_weighted){p[k], w[k]};
		if (!distinct(p) || oracle_orient(p[0], p[1], p[2]) <= 0)
			continue;
		assert_int_equal(geom_power(v[0], v[1], v[2], v[3]), oracle_power(at, w, true));
		for (unsigned vertical = 0; vertical < 2; vertical++)
			assert_int_equal(geom_power_side(v[0], v[1], v[2], c2, vertical),
					 oracle_power_side(at, w, c2, vertical, true));
	}
}

/* On the line of a and b the plane through them and any third position has the height of their line. */
static void power_on_a_line(void **unused)
{
	unsigned done = 0;

	for (unsigned i = 0; i < 300000; i++) {
		unsigned family = i % FAMILIES;
		int32_t p[4][2];
		int64_t w[4], t = (int64_t)(draw() % 9) - 4;
		const int32_t *const at[4] = {p[0], p[1], p[2], p[3]};

		draw_points(p, family);
		for (unsigned k = 0; k < 4; k++)
			w[k] = draw_weight(family);
		for (unsigned k = 0; k < 2; k++)
			p[3][k] = (int32_t)((int64_t)p[0][k] + t * ((int64_t)p[1][k] - p[0][k]));
		if (!distinct(p) || oracle_orient(p[0], p[1], p[3]) || oracle_orient(p[0], p[1], p[2]) <= 0)
			continue;
		assert_int_equal(geom_power_line((struct geom_weighted){p[0], w[0]}, (struct geom_weighted){p[1], w[1]},
						 (struct geom_weighted){p[3], w[3]}),
				 oracle_power(at, w, true));
		done++;
	}
	assert_true(done > 10000);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(orient_any),
		cmocka_unit_test(incircle_any),
		cmocka_unit_test(incircle_bound),
		cmocka_unit_test(incircle_bound_value),
		cmocka_unit_test(heights_are_parameters),
		cmocka_unit_test(cut_any),
		cmocka_unit_test(cut_through_cell_centres),
		cmocka_unit_test(cut_of_needles),
		cmocka_unit_test(cut_below_double_precision),
		cmocka_unit_test(power_any),
		cmocka_unit_test(power_on_a_line),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
