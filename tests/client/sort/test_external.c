/* The external sort: each record comes once and in its order, whether all fit the memory, or there are runs for many passes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "random.h"
#include "sort.h"

enum { MOST = 200000, WORDS = 3, KEYS = 2 };

/* The key of record i: few values of the first word, so that the second one counts, and equal ones. */
static void key_of(uint64_t i, uint64_t ret[KEYS])
{
	uint64_t state = i;

	ret[0] = random_below(&state, 50) << 57;
	ret[1] = random_below(&state, 3000);
}

static void check(size_t n, uint64_t memory)
{
	uint8_t *seen = calloc(n + 1, 1);
	uint64_t last[KEYS] = {0}, key[KEYS];
	struct sort *s = NULL;
	struct err err = {0};
	const uint64_t *rec;
	size_t found = 0;

	assert_int_equal(sort_new(WORDS, KEYS, memory, NULL, &s, &err), 0);
	for (size_t i = 0; i < n; i++) {
		key_of(i, key);
		assert_int_equal(sort_add(s, (uint64_t[WORDS]){key[0], key[1], i}, &err), 0);
	}
	assert_int_equal(sort_start(s, &err), 0);
	while (assert_int_equal(sort_next(s, &rec, &err), 0), rec) {
		assert_true(rec[2] < n && !seen[rec[2]]++);
		key_of(rec[2], key);
		assert_memory_equal(rec, key, sizeof(key));
		assert_true(last[0] < rec[0] || (last[0] == rec[0] && last[1] <= rec[1]));
		memcpy(last, rec, sizeof(last));
		found++;
	}
	assert_int_equal(found, n);
	sort_free(s);
	free(seen);
}

static void test_memory(void **state)
{
	static const size_t sizes[] = {0, 1, 2, 1023, 1024, 1025};

	for (size_t i = 0; i < sizeof(sizes) / sizeof(*sizes); i++) {
		check(sizes[i], 1 << 20);
		check(sizes[i], 0);
	}
	(void)state;
}

/* In the least memory, of which a run has 4096 bytes: 1,024 records, and six runs at once. */
static void test_passes(void **state)
{
	static const size_t runs[] = {5, 6, 7, 12, 36, 37, MOST / 1024};

	for (size_t i = 0; i < sizeof(runs) / sizeof(*runs); i++)
		for (size_t more = 0; more < 2; more++)
			check(runs[i] * 1024 + more, 0);
	(void)state;
}

/* ---- interruptions ---- */

struct patience {
	size_t looks, most;
};

static int is_over(void *ctx)
{
	struct patience *p = ctx;

	return p->looks++ >= p->most;
}

static int run(size_t n, struct patience *p, struct err *err)
{
	struct sort *s = NULL;
	const uint64_t *rec = (const uint64_t[]){0};
	uint64_t key[KEYS];
	int r;

	assert_int_equal(sort_new(WORDS, KEYS, 0, NULL, &s, err), 0);
	sort_interrupt(s, is_over, p);
	r = 0;
	for (size_t i = 0; i < n && !r; i++) {
		key_of(i, key);
		r = sort_add(s, (uint64_t[WORDS]){key[0], key[1], i}, err);
	}
	if (!r)
		r = sort_start(s, err);
	while (!r && rec)
		r = sort_next(s, &rec, err);
	sort_free(s);
	return r;
}

/* Whenever it is interrupted, it ends there. It looks before each buffer that a pass or the last merge fills, here of 4,096
 * bytes. */
static void test_interrupted(void **state)
{
	enum { N = MOST / 2 };
	struct patience all = {.most = SIZE_MAX};
	struct err err = {0};

	assert_int_equal(run(N, &all, &err), 0);
	assert_true(all.looks > 2 * (N * WORDS * sizeof(uint64_t) / 4096));
	for (size_t most = 0; most < all.looks; most += 1 + most / 20) {
		struct patience p = {.most = most};

		err = (struct err){0};
		assert_int_equal(run(N, &p, &err), -ERR_CANCELLED);
		assert_int_equal(p.looks, most + 1);
	}
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_interrupted),
		cmocka_unit_test(test_memory),
		cmocka_unit_test(test_passes),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
