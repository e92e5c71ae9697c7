/*
 * What snap rounding promises one by one: heights, counts, the memory, and sets of a million vertices in seconds.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "check.h"
#include "err.h"
#include "inputs.h"
#include "snap.h"

static struct snap round_of(const struct mesh_vertex *v, uint32_t nv, const uint32_t (*segment)[2], uint32_t n, bool highest)
{
	struct err err = ERR_INIT;
	struct snap l;

	if (snap_round(v, nv, segment, n, highest, UINT64_C(1) << 30, &l, &err))
		fail_msg("%s", err.message);
	return l;
}

static void expect_vertex(const struct snap *l, uint32_t i, int32_t x, int32_t y, int32_t z)
{
	assert_true(i < l->nvertex);
	assert_int_equal(l->vertex[i].x, x);
	assert_int_equal(l->vertex[i].y, y);
	assert_int_equal(l->vertex[i].z, z);
}

static void nothing(void **unused)
{
	struct snap l = round_of(NULL, 0, NULL, 0, false);

	assert_int_equal(l.nvertex + l.npiece + l.ncrossing, 0);
	snap_done(&l);
}

/* They cross at (3.5, 2.5), which is rounded up; at 3.5 on one line, rounded up, and at -7.5 on the other. */
static void heights_at_a_crossing(void **unused)
{
	const struct mesh_vertex v[] = {{0, 0, 0}, {7, 5, 7}, {0, 5, -15}, {7, 0, 0}};
	const uint32_t segment[][2] = {{1, 0}, {2, 3}};

	for (unsigned highest = 0; highest < 2; highest++) {
		struct snap l = round_of(v, 4, segment, 2, highest);

		assert_int_equal(l.nvertex, 5);
		assert_int_equal(l.npiece, 4);
		assert_int_equal(l.ncrossing, 1);
		expect_vertex(&l, 2, 4, 3, highest ? 4 : -7);
		assert_int_equal(l.crossing[0].x, 4);
		assert_int_equal(l.crossing[0].y, 3);
		assert_int_equal(l.crossing[0].lower, -7);
		assert_int_equal(l.crossing[0].upper, 4);
		snap_done(&l);
	}
}

/* Two lines that meet in vertices of unequal heights, a line there twice, one without length. */
static void counts(void **unused)
{
	const struct mesh_vertex v[] = {{0, 0, 5}, {10, 0, 6}, {10, 0, 9}, {20, 0, 7}, {20, 0, 8}, {0, 0, 5}};
	const uint32_t segment[][2] = {{0, 1}, {2, 3}, {1, 5}, {3, 4}, {3, 1}};
	struct snap l = round_of(v, 6, segment, 5, true);

	assert_int_equal(l.nvertex, 3);
	assert_int_equal(l.npiece, 2);
	assert_int_equal(l.ncrossing, 0);
	assert_int_equal(l.points, 1);
	assert_int_equal(l.doubled, 2);
	assert_int_equal(l.uneven, 2);
	assert_int_equal(l.widest, 3);
	assert_int_equal(l.widest_at[0], 10);
	expect_vertex(&l, 1, 10, 0, 9);
	snap_done(&l);
}

/* A vertex on a line divides it; lines on each other become one; the height of a vertex stays. */
static void touching_and_overlapping(void **unused)
{
	const struct mesh_vertex v[] = {{0, 0, 0}, {9, 9, 90}, {3, 3, -1}, {3, 8, 0}, {6, 6, 0}, {12, 12, 0}};
	const uint32_t segment[][2] = {{0, 1}, {2, 3}, {4, 5}};
	struct snap l = round_of(v, 6, segment, 3, false);

	assert_int_equal(l.nvertex, 6);
	assert_int_equal(l.npiece, 5);
	assert_int_equal(l.ncrossing, 0);
	expect_vertex(&l, 1, 3, 3, -1);
	snap_done(&l);
}

static void largest_numbers(void **unused)
{
	const struct mesh_vertex v[] = {{INT32_MIN, INT32_MIN, INT32_MIN},
					{INT32_MAX, INT32_MAX, INT32_MAX},
					{INT32_MIN, INT32_MAX, INT32_MAX},
					{INT32_MAX, INT32_MIN, INT32_MAX}};
	const uint32_t segment[][2] = {{0, 1}, {2, 3}};
	struct snap l = round_of(v, 4, segment, 2, false);

	assert_int_equal(l.nvertex, 5);
	expect_vertex(&l, 2, 0, 0, 0); /* at -0.5, rounded up */
	assert_int_equal(l.crossing[0].upper, INT32_MAX);
	snap_done(&l);
}

/* About n vertices on lines that wander and cross, in vertices 1,000 apart. */
static uint32_t wander(uint32_t n, uint32_t per_line, struct mesh_vertex **ret_v, uint32_t (**ret_segment)[2])
{
	uint64_t state = 99;
	struct mesh_vertex *v = calloc(n, sizeof(*v));
	uint32_t(*segment)[2] = calloc(n, sizeof(*segment)), ns = 0;

	assert_non_null(v);
	assert_non_null(segment);
	for (uint32_t i = 0; i < n; i++) {
		uint64_t r = input_random(&state);

		if (i % per_line == 0) {
			v[i] = (struct mesh_vertex){(int32_t)(r >> 43), (int32_t)(r << 32 >> 43), (int32_t)(r >> 50)};
			continue;
		}
		v[i] = v[i - 1];
		v[i].x += 500 + (int32_t)(r >> 32) % 1000;
		v[i].y += (int32_t)(r & 2047) - 1024;
		v[i].z += (int32_t)(r >> 20 & 63) - 32;
		segment[ns][0] = i - 1;
		segment[ns++][1] = i;
	}
	*ret_v = v;
	*ret_segment = segment;
	return ns;
}

/* The kernel takes all pieces, so none crosses another one or a vertex. */
static void expect_pieces(const struct snap *l)
{
	struct tri *t = check_tri(l->vertex, l->nvertex);
	struct tri_pieces *p;

	assert_non_null(t);
	p = check_pieces(t, 2 * l->nvertex);
	for (uint32_t i = 0; i < l->npiece; i++) {
		uint32_t at;

		assert_int_equal(tri_piece_insert(p, l->piece[i][0], l->piece[i][1], &at), 0);
	}
	free(p);
	free(t);
}

static void a_million_vertices(void **unused)
{
	const uint32_t nv = getenv("ACUT_TEST_QUICK") ? 100000 : 1000000;
	struct mesh_vertex *v;
	uint32_t(*segment)[2];
	uint32_t n = wander(nv, 100, &v, &segment);
	struct snap l = round_of(v, nv, (const uint32_t(*)[2])segment, n, false);

	assert_true(l.ncrossing > nv / 1000);
	expect_pieces(&l);
	snap_done(&l);
	free(segment);
	free(v);
}

/* 5,000 lines from one vertex, and as many that are parallel, long and near each other. */
static void stars_and_bundles(void **unused)
{
	const uint32_t n = 5000;
	struct mesh_vertex *v = calloc(2 * (size_t)n, sizeof(*v));
	uint32_t(*segment)[2] = calloc(n, sizeof(*segment));

	assert_non_null(v);
	assert_non_null(segment);
	for (unsigned bundle = 0; bundle < 2; bundle++) {
		struct snap l;

		for (uint32_t i = 0; i < n; i++) {
			v[i] = (struct mesh_vertex){bundle ? -1000000000 : 0, bundle ? (int32_t)i * 3 : 0, 0};
			v[n + i] = bundle ? (struct mesh_vertex){1000000000, (int32_t)i * 3 + 100000, 0} :
					    (struct mesh_vertex){1000000 - 100 * (int32_t)i, 1000000 - (int32_t)(i % 2), 0};
			segment[i][0] = i;
			segment[i][1] = n + i;
		}
		l = round_of(v, 2 * n, (const uint32_t(*)[2])segment, n, false);
		assert_int_equal(l.npiece, n);
		assert_int_equal(l.ncrossing, 0);
		snap_done(&l);
	}
	free(segment);
	free(v);
}

/* It works in some memory, not in less, fails with LIMIT, and leaves the result alone. */
static void memory_is_kept(void **unused)
{
	struct mesh_vertex *v;
	uint32_t(*segment)[2];
	uint32_t n = wander(20000, 50, &v, &segment), failed = 0;
	uint64_t memory = 1000;

	for (;; memory += memory / 8) {
		struct err err = ERR_INIT;
		struct snap l = {.npiece = 77};
		int wrong = snap_round(v, 20000, (const uint32_t(*)[2])segment, n, false, memory, &l, &err);

		if (!wrong) {
			snap_done(&l);
			break;
		}
		assert_int_equal(wrong, -ERR_LIMIT);
		assert_int_equal(l.npiece, 77);
		failed++;
	}
	assert_true(failed > 10);
	assert_true(memory < 150 * 20000);
	free(segment);
	free(v);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(nothing),
		cmocka_unit_test(heights_at_a_crossing),
		cmocka_unit_test(counts),
		cmocka_unit_test(touching_and_overlapping),
		cmocka_unit_test(largest_numbers),
		cmocka_unit_test(a_million_vertices),
		cmocka_unit_test(stars_and_bundles),
		cmocka_unit_test(memory_is_kept),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
