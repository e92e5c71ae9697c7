/*
 * Hits of a chain, compared with the points that belong to it: a point that is not above E is a hit, alone and in any box, at
 * every magnitude of lattice numbers. E is exact, hits are in doubles.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <stdio.h>
#include <cmocka.h>

#include "cut_chain.h"
#include "tiling.h"

enum { CASES = 40000, SITES = 6, CAP = 64, COLUMNS = 4 };

static uint64_t seed = 11;

static unsigned below(unsigned n)
{
	return (unsigned)(random_next(&seed) % n);
}

/* A random number of any magnitude, or one close to an end of the lattice. */
static int32_t number(void)
{
	int32_t n = (int32_t)(random_next(&seed) >> 33 >> below(31));

	switch (below(4)) {
	case 0:
		return n;
	case 1:
		return -n;
	case 2:
		return INT32_MIN + n;
	default:
		return INT32_MAX - n;
	}
}

static struct point point_of(const struct cut_chain *c, int32_t along, int32_t across)
{
	return c->vertical ? (struct point){.x = across, .y = along} : (struct point){.x = along, .y = across};
}

/* Where the sites are: between them, and often just beside one. */
static int32_t some_place(const struct cut_chain *c)
{
	int64_t u = cut_chain_u(c, &c->pt[below(c->n)]) / 2 + ((int64_t)below(9) - 4) * (1 << (below(2) ? 0 : below(20)));

	return u < INT32_MIN ? INT32_MIN : u > INT32_MAX ? INT32_MAX : (int32_t)u;
}

/* The farthest point on one side of the border at this place that is not above E. */
static struct point farthest(const struct cut_chain *c, int32_t along, int64_t nearest, int side)
{
	int64_t in = 0, out = side > 0 ? INT32_MAX - nearest : nearest - INT32_MIN;

	while (in < out) {
		int64_t far = in + (out - in + 1) / 2;
		struct point p = point_of(c, along, (int32_t)(nearest + side * far));

		if (cut_chain_above(c, &p))
			out = far - 1;
		else
			in = far;
	}
	return point_of(c, along, (int32_t)(nearest + side * in));
}

static int32_t moved(int32_t at, int side)
{
	int64_t to = at + side * (int64_t)(random_next(&seed) >> 33 >> below(31));

	return to < INT32_MIN ? INT32_MIN : to > INT32_MAX ? INT32_MAX : (int32_t)to;
}

static void check_hit(const struct cut_chain *c, const struct point *p)
{
	const int32_t alone[4] = {p->x, p->y, p->x, p->y};
	const int32_t among[4] = {moved(p->x, -1), moved(p->y, -1), moved(p->x, 1), moved(p->y, 1)};

	assert_false(cut_chain_above(c, p));
	assert_true(cut_chain_hit(c, alone));
	assert_true(cut_chain_hit(c, among));
}

static void check_limits(const struct cut_chain *c, const struct point *p)
{
	unsigned shift = below(30), back = below(COLUMNS);
	int64_t limit[COLUMNS], u = cut_chain_u(c, p), u0 = u - (int64_t)(random_next(&seed) % (((uint64_t)back << shift) + 1));

	cut_chain_limits(c, u0, shift, COLUMNS, limit);
	assert_true(cut_chain_x(c, p) <= limit[(u - u0) >> shift]);
}

/* The same for E of a part of the sites, which is nowhere below, before and after a survey. */
static void check_part(const struct cut_chain *c, const struct point *p)
{
	struct point some[CAP];
	struct cut_chain part;
	uint32_t n = 0;

	for (uint32_t i = 0; i < c->n; i++)
		if (i == 0 || i + 1 == c->n || below(2))
			some[n++] = c->pt[i];
	cut_chain_init(&part, c->vertical, c->c2, c->t0, c->t1, NULL, 0, NULL, 0);
	cut_chain_of(&part, some, n);
	check_hit(&part, p);
	cut_chain_survey(&part);
	check_hit(&part, p);
}

static void make_chain(struct cut_chain *c, struct point pt[CAP], struct point batch[SITES])
{
	const struct view view = VIEW_INIT;
	int64_t a = 2 * (int64_t)number() - 1, b = 2 * (int64_t)number() - 1;

	b += a == b ? 2 : 0;
	cut_chain_init(c, below(2), 2 * (int64_t)number() - 1, below(3) ? (a < b ? a : b) : INT64_MIN,
		       below(3) ? (a < b ? b : a) : INT64_MAX, pt, CAP, batch, SITES);
	for (unsigned i = 0, n = 1 + below(SITES); i < n; i++) {
		struct point p = point_of(c, number(), number());

		assert_int_equal(cut_chain_add(c, &view, &p), 0);
	}
	assert_int_equal(cut_chain_flush(c, &view), 0);
}

static void what_belongs_is_hit(void **state)
{
	struct point pt[CAP], batch[SITES];
	unsigned checked = 0;

	(void)state;
	for (unsigned i = 0; i < CASES; i++) {
		struct cut_chain c;

		make_chain(&c, pt, batch);
		for (unsigned k = 0; k < 8; k++) {
			int side = below(2) ? 1 : -1;
			int64_t nearest = (c.c2 + side) / 2;
			struct point p;

			if (nearest < INT32_MIN || nearest > INT32_MAX)
				continue;
			p = farthest(&c, some_place(&c), nearest, side);
			if (cut_chain_above(&c, &p))
				continue;
			check_hit(&c, &p);
			check_limits(&c, &p);
			check_part(&c, &p);
			checked++;
		}
	}
	assert_true(checked > 4 * CASES);
}

/* An edge from far away to nearby: beside its near end the share of the far end is small, but what is lost of it is not. */
static void beside_the_near_end(void **state)
{
	(void)state;
	for (unsigned i = 0; i < CASES; i++) {
		const struct view view = VIEW_INIT;
		struct point pt[CAP], batch[SITES], far, near, p;
		struct cut_chain c;
		bool back = below(2);
		int32_t along = INT32_MAX - (int32_t)below(1000), place = along - 1 - (int32_t)below(4);

		cut_chain_init(&c, below(2), -1, INT64_MIN, INT64_MAX, pt, CAP, batch, SITES);
		far = point_of(&c, back ? INT32_MAX : INT32_MIN, INT32_MAX - (int32_t)below(1000));
		near = point_of(&c, back ? -along : along, (int32_t)below(9));
		assert_int_equal(cut_chain_add(&c, &view, &far), 0);
		assert_int_equal(cut_chain_add(&c, &view, &near), 0);
		assert_int_equal(cut_chain_flush(&c, &view), 0);
		assert_int_equal(c.n, 2);
		p = farthest(&c, back ? -place : place, 0, 1);
		check_hit(&c, &p);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(what_belongs_is_hit),
		cmocka_unit_test(beside_the_near_end),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
