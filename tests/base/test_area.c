/*
 * Areas: points against another method on so few coordinates that corners and edges are hit all the time, and on rings of many
 * corners; areas side by side, which share no point; boxes; a ring of a million corners that no band of y divides.
 * ACUT_FUZZ_CASES: how many areas (20,000).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "area.h"
#include "err.h"
#include "random.h"
#include "repeat.h"

enum { RINGS = 8, CORNERS = 90 };

struct model {
	struct {
		bool shell;
		unsigned n;
		int64_t at[CORNERS][2];
	} ring[RINGS];
	unsigned nring;
};

static struct area *area_of(const struct model *m)
{
	struct area *a = area_new(AREA_HALF_OPEN);
	struct err err = ERR_INIT;

	assert_non_null(a);
	for (unsigned r = 0; r < m->nring; r++) {
		assert_int_equal(area_ring(a, m->ring[r].shell, &err), 0);
		for (unsigned i = 0; i < m->ring[r].n; i++)
			assert_int_equal(area_corner(a, m->ring[r].at[i][0], m->ring[r].at[i][1], &err), 0);
	}
	assert_int_equal(area_end(a, &err), 0);
	return a;
}

/*
 * A ray upwards from (x + e, y + e^2), e as small as need be. It crosses the edge from p to q if they are on two sides of x + e,
 * and the edge is there above y + e^2: above y at x, or at y and rising to the right.
 */
static bool brute_ring(const struct model *m, unsigned r, int64_t x, int64_t y)
{
	unsigned n = m->ring[r].n;
	bool in = false;

	for (unsigned i = 0; i < n; i++) {
		const int64_t *p = m->ring[r].at[i], *q = m->ring[r].at[(i + 1) % n];
		__int128 above;

		if (p[0] > q[0]) {
			const int64_t *t = p;

			p = q;
			q = t;
		}
		if (p[0] > x || q[0] <= x)
			continue;
		above = (__int128)(p[1] - y) * (q[0] - p[0]) + (__int128)(q[1] - p[1]) * (x - p[0]);
		in ^= above > 0 || (above == 0 && q[1] > p[1]);
	}
	return in;
}

static bool brute_has(const struct model *m, int64_t x, int64_t y)
{
	bool in = false;

	for (unsigned r = 0; r < m->nring; r++) {
		bool here = brute_ring(m, r, x, y);

		if (m->ring[r].shell || !r) {
			if (in)
				return true;
			in = here;
		} else {
			in &= !here;
		}
	}
	return in;
}

static void make(struct model *m, uint64_t *seed, unsigned corners, int64_t range, int64_t step, int64_t shift)
{
	memset(m, 0, sizeof *m);
	m->nring = 1 + (unsigned)random_below(seed, RINGS);
	for (unsigned r = 0; r < m->nring; r++) {
		m->ring[r].shell = random_below(seed, 3) == 0;
		m->ring[r].n = (unsigned)random_below(seed, corners + 1);
		for (unsigned i = 0; i < m->ring[r].n; i++)
			for (unsigned k = 0; k < 2; k++)
				m->ring[r].at[i][k] = (int64_t)random_below(seed, (uint64_t)range) * step + shift;
	}
}

static uint64_t inside, outside, uniform;

static void check_box(const struct model *m, const struct area *a, uint64_t *seed, int64_t range)
{
	int64_t box[4];
	enum area_side side;

	for (unsigned k = 0; k < 2; k++) {
		box[k] = (int64_t)random_below(seed, (uint64_t)range + 2) - 1;
		box[2 + k] = box[k] + (int64_t)random_below(seed, 3);
	}
	side = area_box(a, box);
	uniform += side != AREA_MIXED;
	for (int64_t y = box[1]; y <= box[3] && side != AREA_MIXED; y++)
		for (int64_t x = box[0]; x <= box[2]; x++)
			assert_int_equal(brute_has(m, x, y), side == AREA_IN);
}

static void test_random(void **state)
{
	uint64_t n = repeat_cases(20000), first = repeat_first();

	for (uint64_t i = 0; i < n; i++) {
		uint64_t seed = (first + i) * UINT64_C(0x2545f4914f6cdd1d);
		int64_t range = 2 + (int64_t)random_below(&seed, 12);
		struct model m;
		struct area *a;

		make(&m, &seed, i % 4 ? 12 : CORNERS, range, 1, 0);
		a = area_of(&m);
		for (int64_t y = -1; y <= range; y++)
			for (int64_t x = -1; x <= range; x++) {
				bool in = brute_has(&m, x, y);

				assert_int_equal(area_has(a, x, y), in);
				*(in ? &inside : &outside) += 1;
			}
		for (unsigned k = 0; k < 8; k++)
			check_box(&m, a, &seed, range);
		area_free(a);
	}
	print_message("%llu points inside, %llu outside, %llu boxes on one side\n", (unsigned long long)inside,
		      (unsigned long long)outside, (unsigned long long)uniform);
	assert_true(inside && outside && uniform);
}

/* Products of 125 bits. */
static void test_large(void **state)
{
	uint64_t seed = 5;

	for (unsigned i = 0; i < 2000; i++) {
		struct model m;
		struct area *a;
		const int64_t step = AREA_MOST / 4;

		make(&m, &seed, 12, 9, step, -AREA_MOST);
		a = area_of(&m);
		for (unsigned k = 0; k < 200; k++) {
			int64_t x = (int64_t)random_below(&seed, 9) * step - AREA_MOST + (int64_t)random_below(&seed, 3) - 1;
			int64_t y = (int64_t)random_below(&seed, 9) * step - AREA_MOST + (int64_t)random_below(&seed, 3) - 1;

			x = x < -AREA_MOST ? -AREA_MOST : x > AREA_MOST ? AREA_MOST : x;
			y = y < -AREA_MOST ? -AREA_MOST : y > AREA_MOST ? AREA_MOST : y;
			assert_int_equal(area_has(a, x, y), brute_has(&m, x, y));
		}
		area_free(a);
	}
}

/* A square, cut along a path from its lower to its upper side: each point is in one of the two. */
static void test_side_by_side(void **state)
{
	enum { SIDE = 20, PATH = 60 };

	for (unsigned i = 0; i < 3000; i++) {
		uint64_t seed = 77 + i;
		struct model half[2] = {{.nring = 1}, {.nring = 1}};
		struct area *a[2];
		unsigned n = 2 + (unsigned)random_below(&seed, PATH);
		int64_t y = 0;

		for (unsigned k = 0; k < n; k++) {
			int64_t at[2] = {(int64_t)random_below(&seed, SIDE + 1), y};

			/* upwards, so that the path does not cross itself */
			if (k == n - 1 || y >= SIDE) {
				at[1] = SIDE;
				n = k + 1;
			}
			memcpy(half[0].ring[0].at[k], at, sizeof at);
			memcpy(half[1].ring[0].at[k], at, sizeof at);
			y += (int64_t)random_below(&seed, 3);
		}
		for (unsigned h = 0; h < 2; h++) {
			int64_t x = h ? SIDE : 0;

			memcpy(half[h].ring[0].at[n], (int64_t[2]){x, SIDE}, 16);
			memcpy(half[h].ring[0].at[n + 1], (int64_t[2]){x, 0}, 16);
			half[h].ring[0].n = n + 2;
			a[h] = area_of(&half[h]);
		}
		for (y = -1; y <= SIDE + 1; y++)
			for (int64_t x = -1; x <= SIDE + 1; x++)
				assert_int_equal(area_has(a[0], x, y) + area_has(a[1], x, y),
						 x >= 0 && y >= 0 && x < SIDE && y < SIDE);
		area_free(a[0]);
		area_free(a[1]);
	}
}

/* Half a million teeth, each as high as the whole; and as many squares. */
static void test_million(void **state)
{
	enum { TEETH = 500000, HEIGHT = 1000000 };
	struct area *comb = area_new(AREA_HALF_OPEN), *squares = area_new(AREA_HALF_OPEN);
	struct err err = ERR_INIT;
	uint64_t seed = 9, in = 0;

	assert_int_equal(area_ring(comb, true, &err), 0);
	for (int64_t i = 0; i < TEETH; i++) {
		assert_int_equal(area_corner(comb, 4 * i, 1, &err) || area_corner(comb, 4 * i + 2, HEIGHT, &err), 0);
		assert_int_equal(area_ring(squares, true, &err), 0);
		for (unsigned k = 0; k < 4; k++)
			assert_int_equal(area_corner(squares, 4 * (i * 7919 % TEETH) + (k == 1 || k == 2 ? 2 : 0),
						     4 * (i * 7919 % TEETH) + (k > 1 ? 2 : 0), &err),
					 0);
	}
	assert_int_equal(area_corner(comb, 4 * TEETH, 0, &err) || area_corner(comb, 0, 0, &err), 0);
	assert_int_equal(area_end(comb, &err) || area_end(squares, &err), 0);
	for (unsigned i = 0; i < 300000; i++) {
		int64_t x = (int64_t)random_below(&seed, 4 * TEETH), y = 2 + (int64_t)random_below(&seed, HEIGHT - 2), at = x % 4;
		/* tooth: x - 2 from the tip, at most as far as the height leaves */
		int64_t off = at < 2 ? 2 - at : at - 2;
		bool tooth = at < 2 ? 2 * (HEIGHT - y) >= off * (HEIGHT - 1) : 2 * (HEIGHT - y) > off * (HEIGHT - 1);

		if (x < 4 * (TEETH - 1)) {
			assert_int_equal(area_has(comb, x, y), tooth);
			in += tooth;
		}
		assert_int_equal(area_has(squares, x, x - x % 4 + y % 4), at < 2 && y % 4 < 2);
	}
	assert_true(in > 1000);
	area_free(comb);
	area_free(squares);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_random), cmocka_unit_test(test_large),
					   cmocka_unit_test(test_side_by_side), cmocka_unit_test(test_million)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
