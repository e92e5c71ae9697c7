/*
 * Ways through areas, against the middle of each part between two edges, on so few coordinates that corners are hit and edges are
 * followed all the time; ends of segments that share a place; numbers near the limits. ACUT_FUZZ_CASES: how many areas (4,000).
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "area.h"
#include "area_way.h"
#include "err.h"
#include "random.h"
#include "repeat.h"
#include "wide.h"

enum { RINGS = 4, CORNERS = 9 };

struct model {
	bool shell[RINGS];
	unsigned n[RINGS], nring;
	int64_t at[RINGS][CORNERS][2];
};

static struct area *area_of(struct model *m, uint64_t *state)
{
	struct area *a = area_new(AREA_HALF_OPEN);
	struct err err = ERR_INIT;

	m->nring = 1 + (unsigned)random_below(state, RINGS);
	for (unsigned r = 0; r < m->nring; r++) {
		m->shell[r] = !r || random_below(state, 2);
		m->n[r] = 3 + (unsigned)random_below(state, CORNERS - 2);
		assert_int_equal(area_ring(a, m->shell[r], &err), 0);
		for (unsigned i = 0; i < m->n[r]; i++) {
			for (int k = 0; k < 2; k++)
				m->at[r][i][k] = (int64_t)random_below(state, 9);
			assert_int_equal(area_corner(a, m->at[r][i][0], m->at[r][i][1], &err), 0);
		}
	}
	assert_int_equal(area_end(a, &err), 0);
	return a;
}

/* Whether (x, y), which is on no edge, is inside. */
static bool brute_has(const struct model *m, double x, double y)
{
	bool any = false, shell = false;

	for (unsigned r = 0; r < m->nring; r++) {
		bool in = false;

		for (unsigned i = 0; i < m->n[r]; i++) {
			const int64_t *p = m->at[r][i], *q = m->at[r][(i + 1) % m->n[r]];

			if (((double)p[1] <= y) != ((double)q[1] <= y))
				in ^= x < (double)p[0] + (y - (double)p[1]) / (double)(q[1] - p[1]) * (double)(q[0] - p[0]);
		}
		if (m->shell[r]) {
			any |= shell;
			shell = in;
		} else {
			shell &= !in;
		}
	}
	return any | shell;
}

static double at(const struct area_place *p, int axis)
{
	return (double)p->from[axis] + (double)(p->to[axis] - p->from[axis]) * (double)p->n / (double)p->d;
}

static struct area_place a_place(uint64_t *state)
{
	struct area_place p = {.d = 1 + (int64_t)random_below(state, 4)};

	for (int k = 0; k < 2; k++) {
		p.from[k] = (int64_t)random_below(state, 9);
		p.to[k] = (int64_t)random_below(state, 9);
	}
	p.n = (int64_t)random_below(state, (uint64_t)p.d + 1);
	return p;
}

static int side(const void *ctx, const int64_t v[2])
{
	const struct area_segment *s = ctx;
	const struct area_place *a = &s->a, *b = &s->b;
	__int128 from[2], way[2], to[2], turn;

	for (int k = 0; k < 2; k++) {
		__int128 an = (__int128)a->from[k] * a->d + (__int128)(a->to[k] - a->from[k]) * a->n;
		__int128 bn = (__int128)b->from[k] * b->d + (__int128)(b->to[k] - b->from[k]) * b->n;

		from[k] = an;
		way[k] = bn * a->d - an * b->d;
		to[k] = (__int128)v[k] * a->d - from[k];
	}
	turn = way[0] * to[1] - to[0] * way[1];
	return turn ? (turn > 0 ? 1 : -1) : way[1] ? (way[1] > 0 ? 1 : -1) : way[0] < 0 ? 1 : -1;
}

static double where_crossed(const struct area_segment *s, const int64_t *p, const int64_t *q)
{
	double x[2] = {at(&s->a, 0), at(&s->b, 0)}, y[2] = {at(&s->a, 1), at(&s->b, 1)}, o[2];

	for (int i = 0; i < 2; i++)
		o[i] = (double)(q[0] - p[0]) * (y[i] - (double)p[1]) - (x[i] - (double)p[0]) * (double)(q[1] - p[1]);
	return o[0] == o[1] ? NAN : o[0] / (o[0] - o[1]);
}

static int by_value(const void *a, const void *b)
{
	const double *p = a, *q = b;

	return (*p > *q) - (*p < *q);
}

static void check(const struct model *m, const struct area_segment *s, bool in, const struct area_crossing *crossing, size_t n)
{
	double part[RINGS * CORNERS + 2] = {0, 1};
	size_t parts = 2, next = 0;

	for (unsigned r = 0; r < m->nring; r++)
		for (unsigned i = 0; i < m->n[r]; i++) {
			double t = where_crossed(s, m->at[r][i], m->at[r][(i + 1) % m->n[r]]);

			if (t > 0 && t < 1)
				part[parts++] = t;
		}
	qsort(part, parts, sizeof(*part), by_value);
	for (size_t i = 0; i + 1 < parts; i++) {
		double t = (part[i] + part[i + 1]) / 2, moved = 1e-7;

		if (part[i + 1] - part[i] < 1e-6)
			continue;
		for (; next < n && crossing[next].part < t; next++)
			in = !in;
		/* Moved as the rule is; no edge is as near as that but those that are followed. */
		assert_int_equal(in, brute_has(m, at(&s->a, 0) + (at(&s->b, 0) - at(&s->a, 0)) * t + moved,
					       at(&s->a, 1) + (at(&s->b, 1) - at(&s->a, 1)) * t + moved * 1e-3));
	}
	for (size_t i = 0; i < n; i++)
		assert_true(crossing[i].part >= 0 && crossing[i].part <= 1 && (!i || crossing[i].part >= crossing[i - 1].part));
}

static void test_random(void **ctx)
{
	for (unsigned seed = 0; seed < repeat_cases(4000); seed++) {
		uint64_t state = seed;
		struct model m;
		struct area *a = area_of(&m, &state);
		struct area_place last = a_place(&state);
		const struct area_crossing *crossing;
		struct err err = ERR_INIT;
		struct area_way *w;
		bool known = false, was = false;

		assert_int_equal(area_way_new(a, &w, &err), 0);
		for (unsigned i = 0; i < 20; i++) {
			struct area_segment s = {.a = last, .b = a_place(&state), .side = side, .ctx = &s};
			bool in;
			size_t n;

			assert_int_equal(area_way(w, &s, &in, &crossing, &n, &err), 0);
			assert_true(!known || in == was); /* as the segment before it ended */
			was = in ^ (n & 1);
			known = true;
			check(&m, &s, in, crossing, n);
			if (s.b.d == 1) {
				const int64_t *v = s.b.n ? s.b.to : s.b.from;

				assert_int_equal(was, area_has(a, v[0], v[1]));
			}
			last = s.b;
		}
		area_way_free(w);
		area_free(a);
	}
	(void)ctx;
}

/* Of the line from (0, 5) to (9, 9). */
static int side_of_line(const void *ctx, const int64_t v[2])
{
	(void)ctx;
	return 9 * (__int128)(v[1] - 5) - 4 * (__int128)v[0] >= 0 ? 1 : -1;
}

/* A square whose sides are far out, and places with large divisors: at its left side, and one part in 2^60 from it. */
static void test_limits(void **ctx)
{
	static const int64_t far = INT64_C(1) << 61, wide = INT64_C(1) << 32, d = INT64_C(1) << 60;
	const struct area_place place[3] = {
		{{-wide, 5}, {wide, 5}, d / 2, d}, {{-wide, 5}, {wide, 5}, d / 2 - 1, d}, {{9, 9}, {9, 9}, 0, 1}};
	struct area *a = area_new(AREA_HALF_OPEN);
	struct err err = ERR_INIT;
	struct area_way *w;

	area_ring(a, true, &err);
	area_corner(a, 0, -far, &err);
	area_corner(a, far, -far, &err);
	area_corner(a, far, far, &err);
	area_corner(a, 0, far, &err);
	assert_int_equal(area_end(a, &err), 0);
	assert_int_equal(area_way_new(a, &w, &err), 0);
	for (int i = 0; i < 2; i++) {
		struct area_segment s = {.a = place[i], .b = place[2], .side = side_of_line};
		const struct area_crossing *crossing;
		size_t n;
		bool in;

		assert_int_equal(area_way(w, &s, &in, &crossing, &n, &err), 0);
		assert_int_equal(in, i == 0);
		assert_int_equal(n, i);
		assert_true(!n || (crossing[0].low[0] == 0 && crossing[0].high[0] == 0 && crossing[0].part < 1e-9));
	}
	area_way_free(w);
	area_free(a);
	(void)ctx;
}

/* Against products that fit, and by (a + b)^2. */
static void test_wide(void **ctx)
{
	uint64_t state = 7;

	for (unsigned i = 0; i < 100000; i++) {
		__int128 a = (int64_t)random_next(&state) * ((__int128)1 << i % 60), b = (int64_t)random_next(&state);
		__int128 c = ((int64_t)random_next(&state) * ((__int128)1 << i % 37)) | 1;
		struct wide left = wide_product(a + b, c), right = wide_sum(wide_product(a, c), wide_product(c, b));

		assert_true(left.low == right.low && left.high == right.high);
		assert_int_equal(wide_sign(left), a + b ? ((a + b > 0) == (c > 0) ? 1 : -1) : 0);
		assert_true(fabs(wide_double(left) / ((double)(a + b) * (double)c) - 1) < 1e-14);
		left = wide_product((int32_t)a, (int64_t)b);
		assert_true((__int128)left.low == (__int128)(int32_t)a * (int64_t)b &&
			    left.high == ((__int128)left.low < 0 ? -1 : 0));
	}
	(void)ctx;
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_random), cmocka_unit_test(test_limits),
					   cmocka_unit_test(test_wide)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
