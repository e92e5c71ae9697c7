/*
 * Text files: separators, digits, and every way to be wrong, by line number.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "fixture.h"

static const struct input_options defaults;

struct good {
	const char *text;
	uint64_t points;
	int place_xy, place_z;
	int64_t last[3]; /* raw numbers of the last point */
};

static const struct good good[] = {
	{ "", 0, 0, 0, { 0 } },
	{ "\n\n\r\n  \t\n", 0, 0, 0, { 0 } },
	{ "# nothing\n// at all\n%\n  # here", 0, 0, 0, { 0 } },
	{ "1 2 3", 1, 0, 0, { 1, 2, 3 } },
	{ "1 2 3\n4 5 6\n", 2, 0, 0, { 4, 5, 6 } },
	{ "1 2 3\r\n4 5 6\r\n", 2, 0, 0, { 4, 5, 6 } },
	{ "1\t2\t3\n", 1, 0, 0, { 1, 2, 3 } },
	{ "1,2,3\n", 1, 0, 0, { 1, 2, 3 } },
	{ " 1 , 2 , 3 \n", 1, 0, 0, { 1, 2, 3 } },
	{ "1,2,3 # note\n", 1, 0, 0, { 1, 2, 3 } },
	{ "1;2;3;\n", 1, 0, 0, { 1, 2, 3 } },
	{ "1; 2;\t3 ; 4;x\n", 1, 0, 0, { 1, 2, 3 } },
	{ "1,2,3\n4 5 6\n7;8;9", 3, 0, 0, { 7, 8, 9 } },
	{ "   1   2   3   red 255 #7\n", 1, 0, 0, { 1, 2, 3 } },
	{ "# x y z\n1.5 2.25 3.125\n", 1, -2, -3, { 150, 225, 3125 } },
	{ "-1.5 +2 -.5\n", 1, -1, -1, { -15, 20, -5 } },
	{ "5. .5 0.\n", 1, -1, 0, { 50, 5, 0 } },
	{ "77.890 73.988 0.0\n", 1, -3, -1, { 77890, 73988, 0 } },
	{ "1e3 2.5E-3 -1e+2\n", 1, -4, 0, { 10000000, 25, -100 } },
	{ "1 2 3\n1.23456789 2 3\n", 2, -8, 0, { 123456789, 200000000, 3 } },
	{ "0.000 -0 0e5\n", 1, -3, 0, { 0, 0, 0 } },
	/* zeros beyond what the extent leaves room for mean nothing */
	{ "435000.120000000000 10 1\n535000 20 2\n", 2, -2, 0, { 53500000, 2000, 2 } },
	{ "1.50000000000000000000000000 2 3\n", 1, -1, 0, { 15, 20, 3 } },
	{ "00000000000000000000000001 2 3\n", 1, 0, 0, { 1, 2, 3 } },
	{ "1000000000000000000 1 1\n", 1, 0, 0, { 1000000000000000000, 1, 1 } },
	{ "123456789.123456789 0 0\n", 1, -9, 0, { 123456789123456789, 0, 0 } },
	{ "\xef\xbb\xbf" "1 2 3\n", 1, 0, 0, { 1, 2, 3 } },
};

static void good_texts(void **state)
{
	for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
		const struct good *g = &good[i];
		int fd = fixture_fd(g->text, strlen(g->text));
		struct err err = ERR_INIT;
		struct input_points pts;
		const struct input_info *info;
		struct input *in = NULL;
		int64_t last[3] = { 0 };
		uint64_t n = 0;
		int rc = input_open(fd, "a.xyz", &defaults, &in, &err);

		if (rc)
			printf("%s: %s\n", g->text, err.message);
		assert_int_equal(rc, 0);
		info = input_info(in);
		assert_int_equal(info->claimed, g->points);
		assert_string_equal(info->format, "xyz");
		assert_string_equal(info->crs.text, "unknown");
		assert_string_equal(info->crs.unit_xy, "unknown");
		assert_int_equal(info->crs.plane, CRS_PLANE_UNKNOWN);
		assert_false(info->coords.has_offset);
		assert_int_equal(info->coords.scale[0].mantissa, 1);
		assert_int_equal(info->coords.scale[0].exponent, g->place_xy);
		assert_int_equal(info->coords.scale[1].exponent, g->place_xy);
		assert_int_equal(info->coords.scale[2].exponent, g->place_z);
		fixture_points_new(&pts, 2);
		do {
			assert_int_equal(input_read(in, &pts, &err), 0);
			n += pts.n;
			if (pts.n)
				memcpy(last, pts.raw[pts.n - 1], sizeof last);
			if (pts.n)
				assert_true(pts.cls[0] == 0 && pts.ret[0] == 0x11 && pts.flags[0] == 0);
		} while (pts.n);
		assert_int_equal(n, g->points);
		for (int k = 0; k < 3; k++)
			assert_int_equal(last[k], g->last[k]);
		fixture_points_free(&pts);
		input_close(in);
		close(fd);
	}
}

static const struct { const char *text; enum err_code code; uint64_t line; const char *says; } bad[] = {
	{ "1 2\n", ERR_INPUT, 1, "fewer than three" },
	{ "1 2 3\n\n# c\n1 2\n", ERR_INPUT, 4, "fewer than three" },
	{ "1 2 3\r\n4 5\r\n", ERR_INPUT, 2, "fewer than three" },
	{ "1 2 3\nx y z\n", ERR_INPUT, 2, "not a number" },
	{ "x y z\n1 2 3\n", ERR_UNSUPPORTED, 1, "column names" },
	{ "\"x\",\"y\",\"z\"\n1,2,3\n", ERR_UNSUPPORTED, 1, "column names" },
	{ "# ok\nEasting;Northing;Height\n", ERR_UNSUPPORTED, 2, "column names" },
	{ "1 nan 3\n", ERR_INPUT, 1, "finite" },
	{ "nan 2 3\n", ERR_INPUT, 1, "finite" },
	{ "1 2 3\n1 2 -Inf\n", ERR_INPUT, 2, "finite" },
	{ "1 2 infinity\n", ERR_INPUT, 1, "finite" },
	{ "1 2 3x\n", ERR_INPUT, 1, "run together" },
	{ "1 2 3#\n", ERR_INPUT, 1, "run together" },
	{ "1-2 3 4\n", ERR_INPUT, 1, "run together" },
	{ "1,,2,3\n", ERR_INPUT, 1, "not a number" },
	{ ",1,2,3\n", ERR_INPUT, 1, "not a number" },
	{ "1,5 2,5 3,5\n", ERR_INPUT, 1, "separators" },
	{ "1,5;2,5;3,5\n", ERR_INPUT, 1, "separators" },
	{ "1 2 3,5\n", ERR_INPUT, 1, "separators" },
	{ "1 2 3\r4 5 6\r", ERR_INPUT, 1, "carriage return" },
	{ "1e 2 3\n", ERR_INPUT, 1, "not a number" },
	{ "1e+ 2 3\n", ERR_INPUT, 1, "not a number" },
	{ ". 2 3\n", ERR_INPUT, 1, "not a number" },
	{ "- 2 3\n", ERR_INPUT, 1, "not a number" },
	{ "0x10 2 3\n", ERR_INPUT, 1, "run together" },
	{ "1 2 3\n1e300 2 3\n", ERR_INPUT, 2, "digits" },
	{ "1e-300 2 3\n", ERR_INPUT, 1, "digits" },
	{ "1e99999999999999999999 2 3\n", ERR_INPUT, 1, "digits" },
	{ "0.10000000000000000555 2 3\n", ERR_INPUT, 1, "digits" },
	{ "1234567890123456789 2 3\n", ERR_INPUT, 1, "digits" },
	{ "99999999999 1 1\n1 0.000000001 1\n", ERR_INPUT, 2, "too fine" },
};

static void bad_lines(void **state)
{
	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
		struct outcome out = fixture_read(bad[i].text, strlen(bad[i].text), "a.xyz", &defaults, 10);
		char line[32];

		if (out.code != bad[i].code || !strstr(out.err.message, bad[i].says))
			printf("%s -> %d %s\n", bad[i].text, out.code, out.err.message);
		assert_int_equal(out.code, bad[i].code);
		assert_int_equal(out.err.offset, bad[i].line);
		assert_string_equal(out.err.field, "line");
		assert_string_equal(out.err.file, "a.xyz");
		assert_non_null(strstr(out.err.message, bad[i].says));
		snprintf(line, sizeof line, "line %d", (int)bad[i].line);
		assert_non_null(strstr(out.err.message, line));
	}
}

static void long_lines(void **state)
{
	static char text[3 * 256 * 1024];
	struct outcome out;

	for (int fits = 0; fits < 2; fits++) {
		size_t n = 4097 - (size_t)fits;

		memset(text, 'x', sizeof text);
		memcpy(text, "1 2 3\n4 5 6 ", 12);
		text[6 + n] = '\n';
		memcpy(text + 7 + n, "7 8 9", 5);
		out = fixture_read(text, 12 + n, "a.xyz", &defaults, 10);
		assert_int_equal(out.code, fits ? 0 : ERR_INPUT);
		if (fits)
			assert_int_equal(out.points, 3);
		else
			assert_int_equal(out.err.offset, 2);
	}
	/* no line end any more, and more than the buffer holds */
	out = fixture_read(text, sizeof text, "a.xyz", &defaults, 10);
	assert_int_equal(out.code, ERR_INPUT);
	assert_int_equal(out.err.offset, 3);
}

/* Lines of every length across the window's end; each number is known. */
static void across_the_buffer(void **state)
{
	size_t cap = 6u << 20, size = 0, n = 90000;
	char *text = malloc(cap);
	struct err err = ERR_INIT;
	struct input_points pts;
	struct input *in;
	uint64_t at = 0;
	int fd;

	for (size_t i = 0; i < n; i++)
		size += (size_t)snprintf(text + size, cap - size, "%zu.%02zu -%zu.5 %zu%*s%s", i, i % 100, i,
					 i * 7, (int)(i % 37), "", i % 3 ? "\n" : "\r\n");
	fd = fixture_fd(text, size);
	assert_int_equal(input_open(fd, "a.xyz", &defaults, &in, &err), 0);
	assert_int_equal(input_info(in)->claimed, n);
	assert_true(input_info(in)->coords.max[0] == 89999.99 && input_info(in)->coords.min[1] == -89999.5);
	fixture_points_new(&pts, 777);
	for (;;) {
		assert_int_equal(input_read(in, &pts, &err), 0);
		if (!pts.n)
			break;
		for (size_t k = 0; k < pts.n; k++, at++) {
			assert_int_equal(pts.raw[k][0], at * 100 + at % 100);
			assert_int_equal(pts.raw[k][1], -(int64_t)(at * 100 + 50));
			assert_int_equal(pts.raw[k][2], at * 7);
		}
	}
	assert_int_equal(at, n);
	fixture_points_free(&pts);
	input_close(in);
	close(fd);
	free(text);
}

static void changes_between_the_passes(void **state)
{
	static const struct { const char *before, *after; } cases[] = {
		{ "1 2 3\n4 5 6\n", "1 2 3\n" },
		{ "1 2 3\n4 5 6\n", "1 2 3\n4 5.5 6\n" },
		{ "1 2 3\n4 5 6\n", "1 2 3\n4 5 6\n7 8 9\n" },
	};

	for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
		int fd = fixture_fd(cases[i].before, strlen(cases[i].before));
		struct err err = ERR_INIT;
		struct input_points pts;
		struct input *in;
		int rc;

		assert_int_equal(input_open(fd, "a.xyz", &defaults, &in, &err), 0);
		assert_int_equal(ftruncate(fd, 0), 0);
		assert_int_equal(pwrite(fd, cases[i].after, strlen(cases[i].after), 0), strlen(cases[i].after));
		assert_int_equal(futimens(fd, (struct timespec[]){ { .tv_sec = 1 }, { .tv_sec = 1 } }), 0);
		fixture_points_new(&pts, 10);
		rc = input_read(in, &pts, &err);
		assert_int_equal(rc, -ERR_CHANGED);
		fixture_points_free(&pts);
		input_close(in);
		close(fd);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(good_texts),
		cmocka_unit_test(bad_lines),
		cmocka_unit_test(long_lines),
		cmocka_unit_test(across_the_buffer),
		cmocka_unit_test(changes_between_the_passes),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
