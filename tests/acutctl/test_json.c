/* JSON of lists is written without printf: what comes out is what printf would write, to the last digit. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "ctl.h"

static char *written(void (*put)(struct ctl_json *, const void *), const void *what)
{
	char *text = NULL;
	size_t n;
	struct ctl_json j = {.out = open_memstream(&text, &n), .list = true};

	put(&j, what);
	fclose(j.out);
	return text;
}

static void put_number(struct ctl_json *j, const void *v)
{
	ctl_json_number(j, NULL, *(const double *)v);
}

static void put_u64(struct ctl_json *j, const void *v)
{
	ctl_json_u64(j, NULL, *(const uint64_t *)v);
}

static void put_time(struct ctl_json *j, const void *v)
{
	ctl_job_time(j, NULL, *(const int64_t *)v);
}

static void put_text(struct ctl_json *j, const void *v)
{
	ctl_json_text(j, "k\"", v);
}

static void put_lattice(struct ctl_json *j, const void *v)
{
	ctl_job_lattice(j, v);
}

static void check(void (*put)(struct ctl_json *, const void *), const void *what, const char *wanted)
{
	char *text = written(put, what);

	assert_string_equal(text, wanted);
	free(text);
}

static void number_is(double v)
{
	char buf[40];

	for (int digits = 6; digits <= 17; digits++) {
		snprintf(buf, sizeof buf, "%.*g", digits, v);
		if (strtod(buf, NULL) == v)
			break;
	}
	check(put_number, &v, buf);
}

static void numbers(void **state)
{
	static const double some[] = {0, 1, -1, 0.5, 0.1, 1e-4, 0.000099, 0.00012, 0.000001, 999999.999999, 1e6, 123456.7, 100, 100.01,
				      1.0000001, 1.0 / 3, 2e-7, 1e300, 0.025279, 0.04606, 1234567.25};
	uint64_t x = 88172645463325252u;

	for (size_t i = 0; i < sizeof some / sizeof *some; i++) {
		number_is(some[i]);
		number_is(nextafter(some[i], 1e9));
	}
	for (int i = 0; i < 100000; i++) {
		x ^= x << 13;
		x ^= x >> 7;
		x ^= x << 17;
		number_is((double)(x >> 24 >> i % 40) / 1e6);
	}
	check(put_number, &(const double){INFINITY}, "null");
}

static void integers(void **state)
{
	check(put_u64, &(const uint64_t){0}, "0");
	check(put_u64, &(const uint64_t){10}, "10");
	check(put_u64, &(const uint64_t){UINT64_MAX}, "18446744073709551615");
}

static void times(void **state)
{
	for (int64_t us = 1; us < INT64_C(8000000000000000); us = us * 3 + 86399999999) {
		time_t s = (time_t)(us / 1000000);
		char wanted[40];
		struct tm tm;

		strftime(wanted, sizeof wanted, "\"%Y-%m-%dT%H:%M:%SZ\"", gmtime_r(&s, &tm));
		check(put_time, &us, wanted);
		check(put_time, &us, wanted);
	}
	check(put_time, &(const int64_t){0}, "null");
}

static void texts(void **state)
{
	check(put_text, "", "\"k\\\"\":\"\"");
	check(put_text, "a\"b\\c/d~ !\x7f\n", "\"k\\\"\":\"a\\\"b\\\\c/d~ !\\u007f\\u000a\"");
	check(put_text, "Grüße\xff\xc3", "\"k\\\"\":\"Grüße\\ufffd\\ufffd\"");
	check(put_lattice, "0.01 0.01 50000000 540000000 0",
	      "\"lattice\":{\"scale_xy\":0.01,\"scale_z\":0.01,\"offset\":[500000,5400000,0]}");
	check(put_lattice, "0.01 0.01 5 5", "\"lattice\":null");
	check(put_lattice, "0.01 0.01 5 5 x", "\"lattice\":null");
	check(put_lattice, "", "\"lattice\":null");
	check(put_lattice, "00000000000000000000000000000000000000000000000000000001 1 1 1 1", "\"lattice\":null");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(numbers),
		cmocka_unit_test(integers),
		cmocka_unit_test(times),
		cmocka_unit_test(texts),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
