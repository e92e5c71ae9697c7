/* Hints of what is stored: the list that was noted last of a base, as far as there is room; charged, and given back. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "hints.h"
#include "ledger.h"

static struct store_id id_of(uint64_t base, uint64_t list)
{
	return (struct store_id){{~base, base * UINT64_C(0x9e3779b97f4a7c15)}, {list, ~list}};
}

static void note(struct hints *h, uint64_t base, uint64_t list)
{
	const struct store_id id = id_of(base, list);

	hints_note(h, &id);
}

/* 0: not known. */
static uint64_t find(struct hints *h, uint64_t base)
{
	const struct store_id id = id_of(base, 0);
	struct digest list;

	if (!hints_find(h, id.base, &list))
		return 0;
	assert_true(list.lo == ~list.hi);
	return list.hi;
}

static void the_last_one_counts(void **state)
{
	struct ledger *ledger = ledger_new(1 << 20);
	struct hints *h = hints_new(ledger);

	(void)state;
	assert_non_null(h);
	assert_true(ledger_held(ledger, LEDGER_JOBS) >= 512 && ledger_held(ledger, LEDGER_JOBS) <= 2048);
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

/* Of more than fit, those used last stay, and what is told is of that base. */
static void old_ones_give_way(void **state)
{
	struct ledger *ledger = ledger_new(4 << 20); /* 128 of them */
	struct hints *h = hints_new(ledger);
	unsigned known = 0;

	(void)state;
	for (uint64_t i = 1; i <= 1000; i++) {
		note(h, i, i + 5);
		note(h, 9999, 3);
		assert_int_equal(find(h, i), i + 5);
	}
	assert_int_equal(find(h, 9999), 3);
	for (uint64_t i = 1; i <= 1000; i++) {
		uint64_t list = find(h, i);

		assert_true(!list || list == i + 5);
		known += list != 0;
	}
	assert_in_range(known, 100, 127);
	hints_free(h);
	ledger_free(ledger);
}

static void without_memory(void **state)
{
	struct ledger *ledger = ledger_new(1 << 20);

	(void)state;
	assert_true(ledger_take(ledger, LEDGER_DOMAIN, 1 << 20));
	assert_null(hints_new(ledger));
	note(NULL, 1, 2);
	assert_int_equal(find(NULL, 1), 0);
	assert_null(hints_free(NULL));
	ledger_give(ledger, LEDGER_DOMAIN, 1 << 20);
	ledger_free(ledger);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_last_one_counts),
		cmocka_unit_test(old_ones_give_way),
		cmocka_unit_test(without_memory),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
