/*
 * Greedy insertion into one block, in ranges from a few positions to the whole lattice: the hull is that of brute force; what is
 * inserted leaves no point whose key is greater; what is inserted is the farthest point of its triangle then, no nearer than
 * its key. Triangles around a point without an edge are settled: no position beyond the box is in their circles, no corner is
 * dropped, and no point is too far. Planes against determinants of 128 bits.
 *
 * ACUT_FUZZ_CASES: how many; ACUT_FUZZ_SEED: the first.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "check.h"
#include "geom.h"
#include "random.h"
#include "repeat.h"
#include "simplify_error.h"
#include "simplify_greedy.h"

enum { MOST = 120 };

static uint64_t rng, picks, wide, bases, opens, roughs, calm, edges;

static uint64_t rnd(uint64_t n)
{
	return random_below(&rng, n);
}

static int by_order(const void *a, const void *b)
{
	return point_compare(a, b);
}

static uint32_t make(struct point *pts, uint64_t range, uint64_t heights)
{
	uint32_t n = 1 + (uint32_t)rnd(MOST), once = 0;
	bool grid = rnd(3) == 0;

	for (uint32_t i = 0; i < n; i++) {
		uint64_t x = rnd(range), y = rnd(range);

		if (grid) {
			x = range / 8 * (x % 8);
			y = range / 8 * (y % 8);
		}
		pts[i] = (struct point){.x = (int32_t)(uint32_t)(x - range / 2),
					.y = (int32_t)(uint32_t)(y - range / 2),
					.z = (int32_t)(uint32_t)(rnd(heights) - heights / 2),
					.tag = rnd(20) ? 0 : POINT_LINE};
	}
	qsort(pts, n, sizeof *pts, by_order);
	for (uint32_t i = 0; i < n; i++)
		if (!once || pts[once - 1].x != pts[i].x || pts[once - 1].y != pts[i].y)
			pts[once++] = pts[i];
	return once;
}

static void corner(const struct point *p, int32_t ret[2])
{
	ret[0] = p->x;
	ret[1] = p->y;
}

/* Each side has all points on its left or between its ends; so it is the hull, counter-clockwise, without flat corners. */
static void check_hull(const struct simplify_greedy *g)
{
	int32_t a[2], b[2], c[2], d[2];

	for (uint32_t i = 0; g->nhull > 2 && i < g->nhull; i++) {
		corner(&g->pts[g->hull[i]], a);
		corner(&g->pts[g->hull[(i + 1) % g->nhull]], b);
		corner(&g->pts[g->hull[(i + 2) % g->nhull]], d);
		assert_int_equal(geom_orient(a, b, d), 1);
		for (uint32_t k = 0; k < g->n; k++) {
			corner(&g->pts[k], c);
			assert_true(geom_orient(a, b, c) >= 0);
		}
	}
	if (g->nhull > 2)
		return;
	assert_int_equal(g->nhull, g->n > 1 ? 2 : 1);
	for (uint32_t k = 0; g->n > 1 && k < g->n; k++) {
		corner(&g->pts[g->hull[0]], a);
		corner(&g->pts[g->hull[1]], b);
		corner(&g->pts[k], c);
		assert_int_equal(geom_orient(a, b, c), 0);
		assert_true(k == g->hull[0] || geom_less(a, c));
		assert_true(k == g->hull[1] || geom_less(c, b));
	}
}

enum { OUTSIDE, SIDE, INSIDE };

/* The key of a point in a triangle, by the determinant of three corners relative to it. */
static int key_in(const struct tri_result *r, const uint32_t c[3], const struct point *p, uint64_t *ret)
{
	__int128 sum = 0, area = 0;
	int in = INSIDE;

	for (unsigned k = 0; k < 3; k++) {
		const int32_t *a = r->xy[c[(k + 1) % 3]], *b = r->xy[c[(k + 2) % 3]];
		const int32_t at[2] = {p->x, p->y};
		__int128 weight = geom_area(a, b, at);

		if (weight < 0)
			return OUTSIDE;
		in = weight ? in : SIDE;
		area += weight;
		sum += weight * ((int64_t)r->z[c[k]] - p->z);
	}
	*ret = (uint64_t)(((unsigned __int128)(sum < 0 ? -sum : sum) << SIMPLIFY_KEY_SHIFT) / (unsigned __int128)area);
	return in;
}

/* |N| of a point in a triangle. */
static __int128 far_in(const struct tri_result *r, const uint32_t c[3], const struct point *p)
{
	const int32_t at[2] = {p->x, p->y};
	__int128 sum = 0;

	for (unsigned k = 0; k < 3; k++)
		sum += geom_area(r->xy[c[(k + 1) % 3]], r->xy[c[(k + 2) % 3]], at) * ((int64_t)r->z[c[k]] - p->z);
	return sum < 0 ? -sum : sum;
}

/* A position beyond the box, near it. */
static void beyond(const int32_t box[4], int32_t ret[2])
{
	unsigned side = (unsigned)rnd(4);

	for (unsigned k = 0; k < 2; k++)
		ret[k] = (int32_t)(box[k] + (int64_t)rnd((uint64_t)((int64_t)box[2 + k] - box[k]) + 1));
	if (side < 2 && box[side] > INT32_MIN)
		ret[side] = box[side] - 1;
	else if (side >= 2 && box[side] < INT32_MAX)
		ret[side - 2] = box[side] + 1;
}

static bool is_beyond(const int32_t box[4], const int32_t at[2])
{
	return at[0] < box[0] || at[1] < box[1] || at[0] > box[2] || at[1] > box[3];
}

/* Of a triangle with a corner that is no edge. `point`: of each vertex. */
static void check_settled(const struct simplify_greedy *g, const struct tri_result *r, const uint32_t c[3], const uint32_t *point)
{
	const __int128 error = (__int128)(g->least >> SIMPLIFY_KEY_SHIFT);

	for (unsigned k = 0; k < 20; k++) {
		int32_t at[2];

		beyond(g->clear, at);
		if (is_beyond(g->clear, at))
			assert_true(geom_incircle(r->xy[c[0]], r->xy[c[1]], r->xy[c[2]], at) < 0);
	}
	for (unsigned k = 0; k < 3; k++)
		for (uint32_t i = 0; i < g->nhull; i++)
			assert_true(point[r->id[c[k]]] != g->hull[i] || (g->pts[g->hull[i]].tag & POINT_LINE));
	for (uint32_t i = 0; i < g->n; i++) {
		uint64_t key;
		int in = key_in(r, c, &g->pts[i], &key);

		if (in)
			assert_true(far_in(r, c, &g->pts[i]) <= error * geom_area(r->xy[c[0]], r->xy[c[1]], r->xy[c[2]]));
		/* On a side it may be the other triangle's, which is tested. */
		if (in == INSIDE)
			assert_true(g->found.far * 65536 >= (unsigned __int128)key * 1000);
	}
}

/* Of the triangulation of the base and what was inserted. */
static void check_surface(const struct simplify_greedy *g)
{
	bool in[MOST] = {false};
	uint32_t point[MOST];
	struct mesh_vertex v[MOST];
	struct tri_result r;
	struct tri *t;
	uint32_t n = 0;

	for (uint32_t i = 0; i < g->n; i++)
		in[i] = g->pts[i].tag & POINT_LINE;
	for (uint32_t i = 0; i < g->nhull; i++)
		in[g->hull[i]] = true;
	for (uint32_t i = 0; i < g->npick; i++) {
		assert_false(in[g->pick[i].at]);
		in[g->pick[i].at] = true;
		assert_true(g->pick[i].key > g->least);
	}
	for (uint32_t i = 0; i < g->n; i++)
		if (in[i]) {
			point[n] = i;
			v[n++] = (struct mesh_vertex){g->pts[i].x, g->pts[i].y, g->pts[i].z};
		}
	t = check_tri(v, n);
	assert_non_null(t);
	tri_result(t, &r);
	for (uint32_t k = 0; g->clear && k < r.ntriangle; k++) {
		const uint32_t *c = r.triangle[k].corner;
		bool some = true;

		for (unsigned i = 0; some && i < 3; i++)
			some = c[i] != TRI_GHOST;
		if (!some)
			continue;
		for (unsigned i = 0; i < 3; i++)
			some = some && g->corner[point[r.id[c[i]]]] & SIMPLIFY_EDGE;
		if (!some)
			check_settled(g, &r, c, point);
		calm += !some;
		edges += some;
	}
	assert_true(g->found.far <= 1000 * (g->least >> SIMPLIFY_KEY_SHIFT));
	for (uint32_t i = 0; i < g->n; i++)
		for (uint32_t k = 0; k < r.ntriangle; k++) {
			const uint32_t *c = r.triangle[k].corner;
			uint64_t key;

			if (c[0] == TRI_GHOST || c[1] == TRI_GHOST || c[2] == TRI_GHOST || !key_in(&r, c, &g->pts[i], &key))
				continue;
			assert_true(key <= g->least);
		}
	free(t);
}

/* Of the triangulation of the base and the picks before this one: it is the farthest point of its triangle. */
static void check_pick(const struct simplify_greedy *g, uint32_t pick)
{
	const struct point *at = &g->pts[g->pick[pick].at];
	struct mesh_vertex v[MOST];
	struct tri_result r;
	struct tri *t;
	uint32_t n = 0;
	uint64_t key;
	bool any = false;

	for (uint32_t i = 0; i < g->n; i++) {
		bool in = g->pts[i].tag & POINT_LINE;

		for (uint32_t k = 0; !in && k < g->nhull; k++)
			in = g->hull[k] == i;
		for (uint32_t k = 0; !in && k < pick; k++)
			in = g->pick[k].at == i;
		if (in)
			v[n++] = (struct mesh_vertex){g->pts[i].x, g->pts[i].y, g->pts[i].z};
	}
	t = check_tri(v, n);
	tri_result(t, &r);
	for (uint32_t k = 0; k < r.ntriangle; k++) {
		const uint32_t *c = r.triangle[k].corner;
		uint64_t farthest = 0, own;

		if (c[0] == TRI_GHOST || c[1] == TRI_GHOST || c[2] == TRI_GHOST || !key_in(&r, c, at, &key) ||
		    key < g->pick[pick].key)
			continue;
		own = key;
		for (uint32_t i = 0; i < g->n; i++)
			if (key_in(&r, c, &g->pts[i], &key) == INSIDE)
				farthest = key > farthest ? key : farthest;
		/* On a side it is in two triangles, and is one's. */
		any = any || farthest <= own;
	}
	assert_true(any);
	free(t);
}

/* Points of the base that are there because the ground is rough come first. */
static void check_picks(const struct simplify_greedy *g)
{
	uint32_t i = 0;

	for (; i < g->npick && g->pick[i].key > UINT64_C(1) << 49; i++)
		roughs++;
	assert_true(g->rough || !i);
	assert_true(i <= g->n / 8);
	for (unsigned k = 0; k < 4 && i < g->npick; k++)
		check_pick(g, i + (uint32_t)rnd(g->npick - i));
}

/* The box of the points, or a larger one. */
static const int32_t *clear_box(const struct point *pts, uint32_t n, uint64_t range, int32_t box[4])
{
	for (uint32_t i = 0; i < n; i++) {
		const int32_t at[4] = {pts[i].x, pts[i].y, pts[i].x, pts[i].y};

		if (i)
			point_box_join(box, at);
		else
			memcpy(box, at, sizeof at);
	}
	for (unsigned k = 0; k < 4; k++) {
		int64_t by = (int64_t)rnd(range), to = box[k] + (k < 2 ? -by : by);

		if (to >= INT32_MIN && to <= INT32_MAX)
			box[k] = (int32_t)to;
	}
	return box;
}

static void run_case(void *memory)
{
	static const uint64_t range[] = {3, 6, 20, 1000, 1 << 20, UINT64_C(1) << 31, UINT64_C(1) << 32};
	uint64_t r = range[rnd(7)], heights = range[rnd(7)];
	struct point pts[MOST];
	int32_t box[4];
	struct simplify_greedy g = {.pts = pts};

	g.n = make(pts, r, heights);
	g.least = rnd(2) ? 0 : rnd(heights << SIMPLIFY_KEY_SHIFT);
	g.rough = rnd(2);
	g.step = rnd(2) ? 0 : 1 + (unsigned)rnd(100);
	if (rnd(2)) {
		g.least = g.least >> SIMPLIFY_KEY_SHIFT << SIMPLIFY_KEY_SHIFT;
		g.clear = clear_box(pts, g.n, r, box);
	}
	simplify_greedy_run(&g, memory);
	check_hull(&g);
	if (g.nhull < 3) {
		assert_int_equal(g.npick, 0);
		return;
	}
	check_surface(&g);
	picks += g.npick;
	wide += r >> 31 && g.npick;
	opens += g.n - g.nhull - g.npick;
	for (uint32_t i = 0; i < g.n; i++)
		bases += (pts[i].tag & POINT_LINE) != 0;
	check_picks(&g);
}

static void test_blocks(void **state)
{
	uint64_t n = repeat_cases(20000), first = repeat_first();
	void *memory = aligned_alloc(64, (simplify_greedy_bytes(MOST) + 63) & ~(size_t)63);

	(void)state;
	for (uint64_t i = 0; i < n; i++) {
		rng = first + i;
		run_case(memory);
	}
	free(memory);
	print_message(
		"%llu blocks, %llu points inserted, %llu left out, %llu vertices of lines, %llu wide blocks, %llu points for rough "
		"ground; %llu settled triangles, %llu others\n",
		(unsigned long long)n, (unsigned long long)picks, (unsigned long long)opens, (unsigned long long)bases,
		(unsigned long long)wide, (unsigned long long)roughs, (unsigned long long)calm, (unsigned long long)edges);
	assert_true(n < 100 || (picks && opens && bases && wide && roughs && calm && edges));
}

/* A point that is too far by less than the step of keys is not inserted, and its triangle is not settled. */
static void test_step_of_keys(void **state)
{
	static const struct point all[] = {{.x = -(1 << 20), .y = -(1 << 20)}, {.x = 1 << 20, .y = -(1 << 20)},
					   {.x = 1 << 20, .y = 1 << 20},       {.x = -(1 << 20), .y = 1 << 20},
					   {.x = 0, .y = 0, .z = 1000},        {.x = 100000, .y = 0, .z = 1000},
					   {.x = 0, .y = 100000, .z = 1001},   {.x = 300, .y = 1, .z = 990}};
	static const int32_t plane[4] = {INT32_MIN, INT32_MIN, INT32_MAX, INT32_MAX};
	void *memory = aligned_alloc(64, (simplify_greedy_bytes(8) + 63) & ~(size_t)63);
	struct point pts[8];

	(void)state;
	memcpy(pts, all, sizeof pts);
	qsort(pts, 8, sizeof *pts, by_order);
	for (unsigned beyond_by = 0; beyond_by < 2; beyond_by++) {
		struct simplify_greedy g = {
			.pts = pts, .n = 8, .least = (uint64_t)(11 - beyond_by) << SIMPLIFY_KEY_SHIFT, .clear = plane};

		simplify_greedy_run(&g, memory);
		assert_int_equal(g.npick, 3);
		assert_int_equal(g.found.far, beyond_by ? 0 : 10001);
	}
	free(memory);
}

/* A circle: one insertion whose fan has hundreds of triangles. */
static void test_wide_fan(void **state)
{
	enum { N = 400 };
	struct point *pts = calloc(N + 60, sizeof *pts);
	struct simplify_greedy g = {.pts = pts};
	void *memory = aligned_alloc(64, (simplify_greedy_bytes(N + 60) + 63) & ~(size_t)63);
	uint32_t n = 0, once = 0;

	(void)state;
	/* Directions (k, 1) by k, summed up: a convex chain, and its mirror image. */
	for (int32_t k = 0, x = 0, y = 0; k < N / 2; k++) {
		pts[n++] = (struct point){.x = x, .y = y, .z = 0};
		pts[n++] = (struct point){.x = -x - 1, .y = y, .z = 0};
		x += N / 2 - k;
		y += 1 + k;
	}
	for (uint32_t i = 0; i < 60; i++)
		pts[n++] = (struct point){.x = (int32_t)(i % 8) - 4, .y = 9000 + (int32_t)(i / 8), .z = i ? 3 : 1000};
	qsort(pts, n, sizeof *pts, by_order);
	for (uint32_t i = 0; i < n; i++)
		if (!once || pts[once - 1].x != pts[i].x || pts[once - 1].y != pts[i].y)
			pts[once++] = pts[i];
	g.n = once;
	simplify_greedy_run(&g, memory);
	check_hull(&g);
	assert_true(g.nhull > 200 && g.npick > 1);
	assert_int_equal(pts[g.pick[0].at].z, 1000);
	free(memory);
	free(pts);
}

/* Corners and points at heights of any size, each alone. */
static void test_planes(void **state)
{
	uint64_t narrow = 0, beyond = 0;

	(void)state;
	for (uint64_t i = 0; i < 200000; i++) {
		uint64_t range = UINT64_C(1) << (2 + rnd(31)), heights[2] = {UINT64_C(1) << rnd(33), UINT64_C(1) << rnd(33)};
		int64_t error = (int64_t)rnd(UINT64_C(1) << rnd(34));
		struct simplify_plane q;
		int32_t at[4][2];
		struct point p[4];
		__int128 n = 0, d;

		for (unsigned k = 0; k < 4; k++) {
			p[k] = (struct point){.x = (int32_t)(uint32_t)(rnd(range) - range / 2),
					      .y = (int32_t)(uint32_t)(rnd(range) - range / 2),
					      .z = (int32_t)(uint32_t)(rnd(heights[k == 3]) - heights[k == 3] / 2)};
			corner(&p[k], at[k]);
		}
		d = geom_area(at[0], at[1], at[2]);
		if (d <= 0 || geom_orient(at[0], at[1], at[3]) < 0 || geom_orient(at[1], at[2], at[3]) < 0 ||
		    geom_orient(at[2], at[0], at[3]) < 0)
			continue;
		for (unsigned k = 0; k < 3; k++)
			n += geom_area(at[(k + 1) % 3], at[(k + 2) % 3], at[3]) * ((int64_t)p[k].z - p[3].z);
		n = n < 0 ? -n : n;
		simplify_plane_init(&q, &p[0], &p[1], &p[2]);
		assert_true(simplify_plane_far(&q, p[3].x, p[3].y, p[3].z) == (unsigned __int128)n);
		assert_int_equal(simplify_plane_beyond(&q, (unsigned __int128)n, error), n > error * d);
		assert_true(simplify_plane_key(&q, (unsigned __int128)n) ==
			    (uint64_t)(((unsigned __int128)n << 16) / (unsigned __int128)d));
		narrow += q.most >= 0;
		beyond += n > error * d;
	}
	assert_true(narrow > 1000 && beyond > 1000);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_planes),
		cmocka_unit_test(test_blocks),
		cmocka_unit_test(test_wide_fan),
		cmocka_unit_test(test_step_of_keys),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
