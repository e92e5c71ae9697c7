/*
 * --trim-hull against brute force: small meshes whose triangles come in any order and in blocks of any size, and limits that some
 * edges have exactly, half of them with lines. What stays is told apart by flooding from outside over a list of all triangles.
 * ACUT_FUZZ_CASES: how many meshes (5,000).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "err.h"
#include "random.h"
#include "repeat.h"
#include "small_mesh.h"

static int64_t square(uint32_t a, uint32_t b)
{
	int64_t x = small.at[a][0] - small.at[b][0], y = small.at[a][1] - small.at[b][1];

	return x * x + y * y;
}

/* The other triangle of an edge; -1: there is none. */
static int beyond(unsigned t, uint32_t a, uint32_t b)
{
	for (unsigned i = 0; i < small.n; i++) {
		unsigned shared = 0;

		for (unsigned j = 0; j < 3; j++)
			shared += small.triangle[i][j] == a || small.triangle[i][j] == b;
		if (i != t && shared == 2)
			return (int)i;
	}
	return -1;
}

static void flood(int64_t limit2)
{
	memset(small.gone, 0, sizeof small.gone);
	for (bool more = true; more;) {
		more = false;
		for (unsigned t = 0; t < small.n; t++)
			for (unsigned j = 0; j < 3 && !small.gone[t]; j++) {
				uint32_t a = small.triangle[t][j], b = small.triangle[t][(j + 1) % 3];
				int other = beyond(t, a, b);

				if (square(a, b) > limit2 && !small_is_piece(a, b) && (other < 0 || small.gone[other]))
					small.gone[t] = more = true;
			}
	}
}

static uint64_t trimmed, stayed, inside;

static void one_case(uint64_t seed)
{
	struct outputs_options opt = {.trim_hull = {.given = true}, .edges = true};
	const struct format_options none = {0};
	struct outputs_report report;
	struct outputs *run;
	struct acut_mesh_sink sink;
	struct err err = ERR_INIT;
	unsigned left;
	int64_t limit;

	small_make(&seed, 1);
	small.lines = random_below(&seed, 2) ? random_next(&seed) | 1 : 0;
	limit = 1 + (int64_t)random_below(&seed, 45);
	opt.trim_hull.value = (struct decimal){limit, -1};
	flood(limit * limit);
	assert_int_equal(outputs_new(&opt, &run, &err), 0);
	assert_int_equal(outputs_add(run, NULL, &small_format, &none, &err), 0);
	sink = outputs_sink(run);
	assert_int_equal(small_send(&sink, &seed), 0);
	assert_non_null(strstr(small_trimmed(), "trim-hull="));
	outputs_report(run, &report);
	left = small_check(&report);
	for (unsigned t = 0; t < small.n; t++) {
		bool is_long = false;

		for (unsigned j = 0; j < 3; j++)
			is_long |= square(small.triangle[t][j], small.triangle[t][(j + 1) % 3]) > limit * limit;
		inside += is_long && !small.gone[t];
	}
	trimmed += left;
	stayed += small.n - left;
	outputs_free(run);
}

static void test_random(void **state)
{
	uint64_t n = repeat_cases(5000), first = repeat_first();

	for (uint64_t i = 0; i < n; i++)
		one_case((first + i) * UINT64_C(0x2545f4914f6cdd1d));
	print_message("%llu meshes: %llu triangles trimmed, %llu stayed, %llu of these with a long edge\n", (unsigned long long)n,
		      (unsigned long long)trimmed, (unsigned long long)stayed, (unsigned long long)inside);
	assert_true(trimmed && stayed && inside);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_random)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
