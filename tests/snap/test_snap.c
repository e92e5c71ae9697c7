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

	if (snap_round(v, nv, segment, NULL, n, UINT64_C(1) << 30, &l, &err))
		fail_msg("%s", err.message);
	for (uint32_t i = 0; highest && i < l.nvertex; i++)
		l.vertex[i].z = l.highest[i];
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
	assert_int_equal(l.nuneven, 2);
	assert_int_equal(l.uneven[0].x, 10);
	assert_int_equal(l.uneven[0].lower, 6);
	assert_int_equal(l.uneven[0].upper, 9);
	assert_int_equal(l.uneven[1].x, 20);
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

/* It works in some memory, not in less, fails with LIMIT, and leaves the result alone. With labels, too. */
static void memory_is_kept(void **unused)
{
	struct mesh_vertex *v;
	uint32_t(*segment)[2], *label;
	uint32_t n = wander(20000, 50, &v, &segment);

	label = calloc(n, sizeof(*label));
	assert_non_null(label);
	for (uint32_t i = 0; i < n; i++)
		label[i] = 1 + i / 100;
	for (unsigned labelled = 0; labelled < 2; labelled++) {
		uint64_t memory = 1000;
		uint32_t failed = 0;

		for (;; memory += memory / 8) {
			struct err err = ERR_INIT;
			struct snap l = {.npiece = 77};
			int wrong =
				snap_round(v, 20000, (const uint32_t(*)[2])segment, labelled ? label : NULL, n, memory, &l, &err);

			if (!wrong) {
				assert_true(snap_bytes(&l) < memory);
				snap_done(&l);
				break;
			}
			assert_int_equal(wrong, -ERR_LIMIT);
			assert_int_equal(l.npiece, 77);
			failed++;
		}
		assert_true(failed > 10);
		assert_true(memory < (labelled ? 230 : 160) * 20000);
	}
	free(label);
	free(segment);
	free(v);
}

/* Two squares with a label each, one of them with a tail that goes there and back; they have one side in common, a line
 * without label divides one, and a vertex divides the side. */
static void labels(void **unused)
{
	const struct mesh_vertex v[] = {{0, 0, 0},   {10, 0, 0}, {10, 10, 0}, {0, 10, 0}, {20, 0, 0},
					{20, 10, 0}, {5, -5, 0}, {5, 15, 0},  {10, 4, 0}, {30, 10, 0}};
	const uint32_t segment[][2] = {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {1, 4}, {4, 5},
				       {5, 9}, {9, 5}, {5, 2}, {2, 1}, {6, 7}, {8, 4}};
	const uint32_t label[] = {9, 9, 9, 9, 4, 4, 4, 4, 4, 4, 0, 0};
	struct err err = ERR_INIT;
	struct snap l;
	uint32_t n9 = 0, shared = 0;

	assert_int_equal(snap_round(v, 10, segment, label, 12, 1 << 20, &l, &err), 0);
	for (uint32_t i = 0; i < l.nalong; i++) {
		const struct mesh_vertex *a = &l.vertex[l.piece[l.along[i][1]][0]], *b = &l.vertex[l.piece[l.along[i][1]][1]];

		n9 += l.along[i][0] == 9;
		shared += a->x == 10 && b->x == 10;
		assert_true(b->x <= (l.along[i][0] == 9 ? 10 : 20));
		assert_true(a->x >= (l.along[i][0] == 9 ? 0 : 10));
		if (i)
			assert_true(l.along[i][0] > l.along[i - 1][0] ||
				    (l.along[i][0] == l.along[i - 1][0] && l.along[i][1] > l.along[i - 1][1]));
	}
	assert_int_equal(n9, 4 + 1 + 2); /* the line divides two sides, the vertex one */
	assert_int_equal(l.nalong - n9, 4 + 1);
	assert_int_equal(shared, 4);
	snap_done(&l);
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
		cmocka_unit_test(labels),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
