/* Hints of what is stored: what was noted last of a base, as far as there is room, by any thread; charged, and given back. */
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "hints.h"
#include "ledger.h"

enum { PART = 1024 };

struct entry {
	struct store_id id;
	uint64_t much[90];
};

static struct digest base_of(uint64_t base)
{
	return (struct digest){~base, base * UINT64_C(0x9e3779b97f4a7c15)};
}

/* All of it follows from two numbers. */
static void note(struct hints *h, uint64_t base, uint64_t n)
{
	struct entry e = {.id = {base_of(base), {n, ~n}}};

	for (unsigned i = 0; i < 90; i++)
		e.much[i] = n + i;
	hints_note(h, &e);
}

/* 0: not known. */
static uint64_t find(struct hints *h, uint64_t base)
{
	struct entry e;

	if (!hints_find(h, base_of(base), &e))
		return 0;
	assert_true(digest_equal(e.id.base, base_of(base)) && e.id.list.lo == ~e.id.list.hi);
	for (unsigned i = 0; i < 90; i++)
		assert_int_equal(e.much[i], e.id.list.hi + i);
	return e.id.list.hi;
}

static void the_last_one_counts(void **state)
{
	struct ledger *ledger = ledger_new(64 << 20);
	struct hints *h = hints_new(ledger, sizeof(struct entry), PART);

	(void)state;
	assert_non_null(h);
	assert_in_range(ledger_held(ledger, LEDGER_JOBS), (48 << 10), (64 << 10) + 512);
	assert_int_equal(find(h, 7), 0);
	note(h, 7, 100);
	assert_int_equal(find(h, 7), 100);
	note(h, 7, 101);
	assert_int_equal(find(h, 7), 101);
	assert_int_equal(find(h, 8), 0);
	hints_free(h);
	assert_int_equal(ledger_held(ledger, LEDGER_JOBS), 0);
	ledger_free(ledger);
}

/* What is noted is there; as many as there is room for are, also where more are passed over again and again. */
static void others_give_way(void **state)
{
	enum { MOST = 500, ROUNDS = 20 };
	struct ledger *ledger = ledger_new(256 << 20); /* some 300 of them */
	struct hints *h = hints_new(ledger, sizeof(struct entry), PART);
	unsigned known = 0, seen = 0;

	(void)state;
	for (unsigned round = 0; round < ROUNDS; round++)
		for (uint64_t i = 1; i <= MOST; i++) {
			uint64_t n = find(h, i);

			assert_true(!n || n == i + 5);
			seen += n != 0;
			if (!n)
				note(h, i, i + 5);
			assert_int_equal(find(h, i), i + 5);
		}
	for (uint64_t i = 1; i <= MOST; i++)
		known += find(h, i) != 0;
	assert_in_range(known, 250, ledger_held(ledger, LEDGER_JOBS) / sizeof(struct entry));
	assert_true(seen > ROUNDS * MOST / 8);
	hints_free(h);
	ledger_free(ledger);
}

/* The smallest memory has a little of it. */
static void little_memory(void **state)
{
	struct ledger *ledger = ledger_new(1 << 20);
	struct hints *h = hints_new(ledger, sizeof(struct entry), PART);

	(void)state;
	assert_non_null(h);
	assert_true(ledger_held(ledger, LEDGER_JOBS) < 8 << 10);
	for (uint64_t i = 1; i <= 100; i++) {
		note(h, i, i);
		assert_int_equal(find(h, i), i);
	}
	hints_free(h);
	assert_true(ledger_take(ledger, LEDGER_DOMAIN, 1 << 20));
	assert_null(hints_new(ledger, sizeof(struct entry), PART));
	note(NULL, 1, 2);
	assert_int_equal(find(NULL, 1), 0);
	assert_null(hints_free(NULL));
	ledger_give(ledger, LEDGER_DOMAIN, 1 << 20);
	ledger_free(ledger);
}

static void *work(void *ctx)
{
	uint64_t any = 1;

	for (unsigned i = 0; i < 20000; i++) {
		any = any * 6364136223846793005u + 1442695040888963407u;
		if (any >> 63)
			note(ctx, any >> 40 & 511, 1 + (any >> 20 & 1023));
		else
			find(ctx, any >> 40 & 511);
	}
	return NULL;
}

/* Nobody sees half of an entry. */
static void two_threads(void **state)
{
	struct ledger *ledger = ledger_new(256 << 20);
	struct hints *h = hints_new(ledger, sizeof(struct entry), PART);
	pthread_t thread[2];

	(void)state;
	for (unsigned i = 0; i < 2; i++)
		assert_int_equal(pthread_create(&thread[i], NULL, work, h), 0);
	for (unsigned i = 0; i < 2; i++)
		assert_int_equal(pthread_join(thread[i], NULL), 0);
	hints_free(h);
	ledger_free(ledger);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_last_one_counts),
		cmocka_unit_test(others_give_way),
		cmocka_unit_test(little_memory),
		cmocka_unit_test(two_threads),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
