/*
 * The kernel's promises one by one: which inputs are flat, what fits the arena, that nothing outside it is touched,
 * that runs are repeatable.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "check.h"
#include "inputs.h"
#include "tri_priv.h"

static int run_of(const int32_t xy[][2], uint32_t n, struct tri_result *ret, void **ret_arena)
{
	struct mesh_vertex v[16];

	for (uint32_t i = 0; i < n; i++)
		v[i] = (struct mesh_vertex){xy[i][0], xy[i][1], 100 + (int32_t)i};
	int status = check_run(v, n, ret_arena, ret);

	if (!status)
		assert_null(check_result(ret, v, n));
	return status;
}

static void few_are_flat(void **unused)
{
	const int32_t xy[][2] = {{0, 0}, {5, 1}};

	for (uint32_t n = 0; n <= 2; n++) {
		struct tri_result result;
		void *arena;

		assert_int_equal(run_of(xy, n, &result, &arena), TRI_E_FLAT);
		assert_int_equal(result.ntriangle, 0);
		free(arena);
	}
}

static void one_triangle(void **unused)
{
	const int32_t xy[][2] = {{INT32_MIN, INT32_MAX}, {INT32_MAX, INT32_MAX}, {0, INT32_MIN}};
	struct tri_result result;
	void *arena;

	assert_int_equal(run_of(xy, 3, &result, &arena), 0);
	assert_int_equal(result.ntriangle, 4);
	assert_int_equal(check_sum_of(&result).n, 1);
	free(arena);
}

/* The lexicographically last corner of a cell is cut off: the diagonal runs from upper left to lower right.
 */
static void cell_diagonal(void **unused)
{
	const int32_t xy[][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
	struct check_sum want = {0}, have;
	struct tri_result result;
	void *arena;

	check_sum_add(&want, xy[0], xy[1], xy[3]);
	check_sum_add(&want, xy[1], xy[2], xy[3]);
	assert_int_equal(run_of(xy, 4, &result, &arena), 0);
	have = check_sum_of(&result);
	assert_memory_equal(&have, &want, sizeof(have));
	free(arena);
}

static void collinear_is_flat_and_fast(void **unused)
{
	static const int32_t step[][2] = {{1, 0}, {0, -1}, {1000, 777}, {-2000, 2000}};
	const uint32_t n = 1000000;
	struct mesh_vertex *v = calloc(n, sizeof(*v));

	assert_non_null(v);
	for (unsigned k = 0; k < 4; k++) {
		struct tri_result result;
		void *arena;

		for (uint32_t i = 0; i < n; i++) {
			v[i].x = ((int32_t)i - 500000) * step[k][0];
			v[i].y = ((int32_t)i - 500000) * step[k][1];
		}
		assert_int_equal(check_run(v, n, &arena, &result), TRI_E_FLAT);
		assert_int_equal(result.ntriangle, 0);
		free(arena);
	}
	free(v);
}

/* A line and one position beside it, wherever the order of insertion puts it. */
static void line_and_one(void **unused)
{
	const uint32_t n = 300000;
	struct mesh_vertex *v = calloc(n, sizeof(*v));

	assert_non_null(v);
	for (int32_t height = -1; height <= 1000000; height += 250000) {
		struct tri_result result;
		void *arena;

		for (uint32_t i = 0; i < n; i++)
			v[i] = (struct mesh_vertex){(int32_t)i, 0, 0};
		v[n - 1].x = n / 2;
		v[n - 1].y = height;
		assert_int_equal(check_run(v, n, &arena, &result), 0);
		assert_null(check_result(&result, v, n));
		free(arena);
	}
	free(v);
}

/* One insertion that removes a million triangles, through every side of the cavity's first triangle. */
static void million_in_one_cavity(void **unused)
{
	const uint32_t n = 1000001;

	for (unsigned mirrored = 0; mirrored < 2; mirrored++) {
		struct tri *t = aligned_alloc(64, (tri_bytes(n) + 63) / 64 * 64);
		struct mesh_vertex *v = calloc(n, sizeof(*v));
		int32_t up = mirrored ? -1 : 1;
		struct tri_result result;

		assert_non_null(t);
		assert_non_null(v);
		for (uint32_t i = 0; i < n - 2; i++)
			v[i].x = (int32_t)(mirrored ? n - i : i);
		v[n - 2] = (struct mesh_vertex){500000, up * INT32_MAX, 0};
		v[n - 1] = (struct mesh_vertex){500000, up * 200, 0};
		t = tri_init(t, n);
		t->nvertex = n;
		for (uint32_t i = 0; i < n; i++) {
			t->xy[i][0] = v[i].x;
			t->xy[i][1] = v[i].y;
			t->z[i] = 0;
			t->id[i] = i;
		}
		assert_int_equal(tri_build(t, !mirrored), 0);
		tri_result(t, &result);
		assert_null(check_result(&result, v, n));
		assert_int_equal(check_sum_of(&result).n, n - 1);
		free(v);
		free(t);
	}
}

static void arena_is_64_bytes_a_point(void **unused)
{
	assert_int_equal(tri_bytes(1000) - tri_bytes(0), 64 * 1000);
	assert_true(tri_bytes(0) <= 4096);
	assert_int_equal(TRI_BYTES_PER_POINT, 64);
	assert_true(tri_bytes(TRI_MAX_POINTS) == tri_bytes(0) + 64 * (size_t)TRI_MAX_POINTS);
}

/* An arena larger than needed, filled with noise: the bytes behind it stay, and the result depends neither on the
 * capacity nor on what was in the arena. */
static void only_the_arena(void **unused)
{
	enum { BEHIND = 4096, N = 20000 };
	struct tri_result first = {0}, result;
	void *first_arena = NULL;

	for (uint32_t spare = 0; spare < 5; spare++) {
		size_t bytes = tri_bytes(N + spare), all = (bytes + BEHIND + 63) / 64 * 64;
		unsigned char *memory = aligned_alloc(64, all);
		uint32_t n;
		struct mesh_vertex *v = input_make("holes", N, 3, &n);
		struct tri *t;

		assert_non_null(memory);
		assert_non_null(v);
		memset(memory, 17 * (int)spare + 1, all);
		t = tri_init(memory, N + spare);
		memcpy(tri_input(t), v, n * sizeof(*v));
		assert_int_equal(tri_run(t, n), 0);
		tri_result(t, &result);
		assert_null(check_result(&result, v, n));
		for (size_t i = bytes; i < all; i++)
			assert_int_equal(memory[i], 17 * spare + 1);
		free(v);
		if (!spare) {
			first = result;
			first_arena = memory;
			continue;
		}
		assert_memory_equal(result.triangle, first.triangle, result.ntriangle * sizeof(*result.triangle));
		assert_memory_equal(result.id, first.id, n * sizeof(*result.id));
		free(memory);
	}
	free(first_arena);
}

/* Every kind of input at a size of some thousands. */
static void all_kinds(void **unused)
{
	for (unsigned k = 0; k < input_kind_count; k++)
		for (uint32_t n = 5; n <= 5000; n *= 10) {
			struct tri_result result;
			uint32_t have;
			struct mesh_vertex *v = input_make(input_kinds[k].name, n, 9, &have);
			void *arena;

			assert_non_null(v);
			if (check_run(v, have, &arena, &result) == 0) {
				const char *wrong = check_result(&result, v, have);

				if (wrong)
					fail_msg("%s, %u: %s", input_kinds[k].name, n, wrong);
			}
			free(arena);
			free(v);
		}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(few_are_flat),
		cmocka_unit_test(one_triangle),
		cmocka_unit_test(cell_diagonal),
		cmocka_unit_test(collinear_is_flat_and_fast),
		cmocka_unit_test(line_and_one),
		cmocka_unit_test(million_in_one_cavity),
		cmocka_unit_test(arena_is_64_bytes_a_point),
		cmocka_unit_test(only_the_arena),
		cmocka_unit_test(all_kinds),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
