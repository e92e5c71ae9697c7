/* Comparing a header with its points: what gives a warning, and what does not. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "err.h"
#include "pipe.h"

/* A header with scale 0.01 that agrees with its points, which extend from 0 to 10, 20 and 30. */
static struct input_info header(void)
{
	struct input_info info = {.claimed = 4, .has_returns = true, .returns = {0, 3, 1}};

	info.coords.has_offset = true;
	for (int k = 0; k < 3; k++) {
		info.coords.scale[k] = (struct decimal){1, -2};
		info.coords.offset[k] = (struct decimal){0, 0};
		info.coords.max[k] = 10 * (k + 1);
	}
	return info;
}

static const char *compared(const struct input_info *info)
{
	static struct pipe_ingested in;

	in = (struct pipe_ingested){.points = 4, .high = {1000, 2000, 3000}, .returns = {0, 3, 1}};
	pipe_ingested_compare(&in, info);
	return in.warning;
}

static void box(void **state)
{
	for (int k = 0; k < 3; k++) {
		struct input_info info = header();

		assert_string_equal(compared(&info), "");
		/* larger than the points require */
		info.coords.min[k] = -1e6;
		info.coords.max[k] = 1e6;
		assert_string_equal(compared(&info), "");
		/* less than a unit is rounding */
		info = header();
		info.coords.max[k] -= 0.009;
		info.coords.min[k] = 0.009;
		assert_string_equal(compared(&info), "");
		info.coords.max[k] -= 0.001;
		assert_non_null(strstr(compared(&info), "the header's box is wrong"));
		info = header();
		info.coords.min[k] = 0.01;
		assert_non_null(strstr(compared(&info), "the header's box is wrong"));
		/* reported when the header was read */
		info = header();
		info.coords.min[k] = 1e6;
		assert_string_equal(compared(&info), "");
		info.coords.min[k] = NAN;
		assert_string_equal(compared(&info), "");
	}
}

static void returns(void **state)
{
	struct input_info info = header();

	info.returns[2] = 7;
	assert_non_null(strstr(compared(&info), "the header counts 7 points of return 2, there are 1"));
	info.miscounted = true; /* its counts are wrong */
	assert_string_equal(compared(&info), "");
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(box), cmocka_unit_test(returns)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
