/* The recency table: the last entry of a base is found, within the memory of the table, by any thread; its memory is charged and
 * uncharged. */
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "recency.h"
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

/* Two numbers determine all of an entry. */
static void note(struct recency *t, uint64_t base, uint64_t n)
{
	struct entry e = {.id = {base_of(base), {n, ~n}}};

	for (unsigned i = 0; i < 90; i++)
		e.much[i] = n + i;
	recency_note(t, &e);
}

/* 0: no entry. */
static uint64_t find(struct recency *t, uint64_t base)
{
	struct entry e;

	if (!recency_find(t, base_of(base), &e))
		return 0;
	assert_true(digest_equal(e.id.base, base_of(base)) && e.id.list.lo == ~e.id.list.hi);
	for (unsigned i = 0; i < 90; i++)
		assert_int_equal(e.much[i], e.id.list.hi + i);
	return e.id.list.hi;
}

static void last_entry_is_found(void **state)
{
	struct ledger *ledger = ledger_new(64 << 20);
	struct recency *t = recency_new(ledger, sizeof(struct entry), PART);

	(void)state;
	assert_non_null(t);
	assert_in_range(ledger_held(ledger, LEDGER_JOBS), (48 << 10), (64 << 10) + 512);
	assert_int_equal(find(t, 7), 0);
	note(t, 7, 100);
	assert_int_equal(find(t, 7), 100);
	note(t, 7, 101);
	assert_int_equal(find(t, 7), 101);
	assert_int_equal(find(t, 8), 0);
	recency_free(t);
	assert_int_equal(ledger_held(ledger, LEDGER_JOBS), 0);
	ledger_free(ledger);
}

/* A new entry is found at once. The table stays full of usable entries when more bases than it can hold are read again and again.
 */
static void entries_are_replaced(void **state)
{
	enum { MOST = 500, ROUNDS = 20 };
	struct ledger *ledger = ledger_new(256 << 20); /* some 300 of them */
	struct recency *t = recency_new(ledger, sizeof(struct entry), PART);
	unsigned known = 0, seen = 0;

	(void)state;
	for (unsigned round = 0; round < ROUNDS; round++)
		for (uint64_t i = 1; i <= MOST; i++) {
			uint64_t n = find(t, i);

			assert_true(!n || n == i + 5);
			seen += n != 0;
			if (!n)
				note(t, i, i + 5);
			assert_int_equal(find(t, i), i + 5);
		}
	for (uint64_t i = 1; i <= MOST; i++)
		known += find(t, i) != 0;
	assert_in_range(known, 250, ledger_held(ledger, LEDGER_JOBS) / sizeof(struct entry));
	assert_true(seen > ROUNDS * MOST / 8);
	recency_free(t);
	ledger_free(ledger);
}

/* The smallest memory has a small table. */
static void little_memory(void **state)
{
	struct ledger *ledger = ledger_new(1 << 20);
	struct recency *t = recency_new(ledger, sizeof(struct entry), PART);

	(void)state;
	assert_non_null(t);
	assert_true(ledger_held(ledger, LEDGER_JOBS) < 8 << 10);
	for (uint64_t i = 1; i <= 100; i++) {
		note(t, i, i);
		assert_int_equal(find(t, i), i);
	}
	recency_free(t);
	assert_true(ledger_take(ledger, LEDGER_DOMAIN, 1 << 20));
	assert_null(recency_new(ledger, sizeof(struct entry), PART));
	note(NULL, 1, 2);
	assert_int_equal(find(NULL, 1), 0);
	assert_null(recency_free(NULL));
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

/* No thread reads half an entry. */
static void two_threads(void **state)
{
	struct ledger *ledger = ledger_new(256 << 20);
	struct recency *t = recency_new(ledger, sizeof(struct entry), PART);
	pthread_t thread[2];

	(void)state;
	for (unsigned i = 0; i < 2; i++)
		assert_int_equal(pthread_create(&thread[i], NULL, work, t), 0);
	for (unsigned i = 0; i < 2; i++)
		assert_int_equal(pthread_join(thread[i], NULL), 0);
	recency_free(t);
	ledger_free(ledger);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(last_entry_is_found),
		cmocka_unit_test(entries_are_replaced),
		cmocka_unit_test(little_memory),
		cmocka_unit_test(two_threads),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
