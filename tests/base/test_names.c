/* The table from strings to numbers: each number of a key is found once, and unknown keys have none. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>

#include "err.h"
#include "names.h"

enum { KEYS = 1000, VALUES = 3 };

static void all_values_are_found(void **state)
{
	static char key[KEYS][16];
	struct err err = ERR_INIT;
	struct names t = {0};
	size_t at = NAMES_START;
	uint32_t value;

	(void)state;
	assert_false(names_next(&t, "absent", &at, &value));
	for (uint32_t v = 0; v < VALUES; v++)
		for (uint32_t i = 0; i < KEYS; i++) {
			snprintf(key[i], sizeof key[i], "key %u", i);
			/* Every third key has all values, the others one. */
			if (!v || i % 3 == 0)
				assert_int_equal(names_put(&t, key[i], i * VALUES + v, &err), 0);
		}
	for (uint32_t i = 0; i < KEYS; i++) {
		unsigned n = 0, seen = 0;

		for (at = NAMES_START; names_next(&t, key[i], &at, &value); n++) {
			assert_int_equal(value / VALUES, i);
			seen |= 1u << value % VALUES;
		}
		assert_int_equal(n, i % 3 ? 1 : VALUES);
		assert_int_equal(seen, i % 3 ? 1 : 7);
	}
	at = NAMES_START;
	assert_false(names_next(&t, "absent", &at, &value));
	assert_true(names_bytes(&t) >= 2 * KEYS * sizeof *t.slot);
	names_free(&t);
	assert_int_equal(names_bytes(&t), 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(all_values_are_found)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
