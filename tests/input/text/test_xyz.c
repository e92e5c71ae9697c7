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
#include "input_text_parts.h"

static const struct input_options defaults;

struct good {
	const char *text;
	uint64_t points;
	int place_xy, place_z;
	int64_t last[3]; /* raw numbers of the last point */
};

static const struct good good[] = {
	{"", 0, 0, 0, {0}},
	{"\n\n\r\n  \t\n", 0, 0, 0, {0}},
	{"# nothing\n// at all\n%\n  # here", 0, 0, 0, {0}},
	{"1 2 3", 1, 0, 0, {1, 2, 3}},
	{"1 2 3\n4 5 6\n", 2, 0, 0, {4, 5, 6}},
	{"1 2 3\r\n4 5 6\r\n", 2, 0, 0, {4, 5, 6}},
	{"1\t2\t3\n", 1, 0, 0, {1, 2, 3}},
	{"1,2,3\n", 1, 0, 0, {1, 2, 3}},
	{" 1 , 2 , 3 \n", 1, 0, 0, {1, 2, 3}},
	{"1,2,3 # note\n", 1, 0, 0, {1, 2, 3}},
	{"1;2;3;\n", 1, 0, 0, {1, 2, 3}},
	{"1; 2;\t3 ; 4;x\n", 1, 0, 0, {1, 2, 3}},
	{"1,2,3\n4 5 6\n7;8;9", 3, 0, 0, {7, 8, 9}},
	{"   1   2   3   red 255 #7\n", 1, 0, 0, {1, 2, 3}},
	{"# x y z\n1.5 2.25 3.125\n", 1, -2, -3, {150, 225, 3125}},
	{"-1.5 +2 -.5\n", 1, -1, -1, {-15, 20, -5}},
	{"5. .5 0.\n", 1, -1, 0, {50, 5, 0}},
	{"77.890 73.988 0.0\n", 1, -3, -1, {77890, 73988, 0}},
	{"1e3 2.5E-3 -1e+2\n", 1, -4, 0, {10000000, 25, -100}},
	{"1.0D+02 2.5d-3 -1.d2\n", 1, -4, 0, {1000000, 25, -100}}, /* of Fortran */
	{"0.1D+01,0.2D+01,0.3D+01\n", 1, 0, 0, {1, 2, 3}},
	{"1 2 3\n1.23456789 2 3\n", 2, -8, 0, {123456789, 200000000, 3}},
	{"0.000 -0 0e5\n", 1, -3, 0, {0, 0, 0}},
	/* zeros beyond what the extent leaves room for mean nothing */
	{"435000.120000000000 10 1\n535000 20 2\n", 2, -2, 0, {53500000, 2000, 2}},
	{"1.50000000000000000000000000 2 3\n", 1, -1, 0, {15, 20, 3}},
	{"00000000000000000000000001 2 3\n", 1, 0, 0, {1, 2, 3}},
	{"1000000000000000000 1 1\n", 1, 0, 0, {1000000000000000000, 1, 1}},
	{"123456789.123456789 0 0\n", 1, -9, 0, {123456789123456789, 0, 0}},
	{"\xef\xbb\xbf"
	 "1 2 3\n",
	 1,
	 0,
	 0,
	 {1, 2, 3}},
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
		int64_t last[3] = {0};
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

static const struct {
	const char *text;
	enum err_code code;
	uint64_t line;
	const char *says;
} bad[] = {
	{"1 2\n", ERR_INPUT, 1, "fewer than three"},
	{"1 2 3\n\n# c\n1 2\n", ERR_INPUT, 4, "fewer than three"},
	{"1 2 3\r\n4 5\r\n", ERR_INPUT, 2, "fewer than three"},
	{"1 2 3\nx y z\n", ERR_INPUT, 2, "not a number"},
	{"nothing but words here\n", ERR_INPUT, 1, "not a number"},
	{"x y z\nEasting Northing Height\n1 2 3\n", ERR_INPUT, 2, "not a number"},
	{"x y 1\n1 2 3\n", ERR_INPUT, 1, "not a number"},
	{"id;x;y;z\n1;2;3\n", ERR_INPUT, 1, "names 4 columns"},
	{"id;x;y;z\n1;2;3;4\n1;2;3\n", ERR_INPUT, 3, "fewer than 4"},
	{"1 nan 3\n", ERR_INPUT, 1, "finite"},
	{"nan 2 3\n", ERR_INPUT, 1, "finite"},
	{"1 2 infinity\n", ERR_INPUT, 1, "finite"},
	{"1 2 3x\n", ERR_INPUT, 1, "run together"},
	{"1 2 3#\n", ERR_INPUT, 1, "run together"},
	{"1-2 3 4\n", ERR_INPUT, 1, "run together"},
	{"1,,2,3\n", ERR_INPUT, 1, "not a number"},
	{",1,2,3\n", ERR_INPUT, 1, "not a number"},
	{"1,5 2,5 3,5\n", ERR_INPUT, 1, "decimal commas"},
	{"123,45 67,8 9,1\n", ERR_INPUT, 1, "decimal commas"},
	{"1 2 3\n123,45;67,8;9,1\n", ERR_INPUT, 2, "decimal commas"},
	{"1,5\t2,5\t3,5\n", ERR_INPUT, 1, "decimal commas"},
	{"1,5, 2,5, 3,5\n", ERR_INPUT, 1, "decimal commas"},
	{"100;200;30,5\n", ERR_INPUT, 1, "decimal commas"},
	{"100,5;200;30\n", ERR_INPUT, 1, "decimal commas"},
	{"1 2 3,5\n", ERR_INPUT, 1, "decimal commas"},
	{"1,5 2\n", ERR_INPUT, 1, "decimal commas"},
	{"1, 2; 3\n", ERR_INPUT, 1, "separators"},
	{"1 2 3\r4 5 6\r", ERR_INPUT, 1, "carriage return"},
	{"1e 2 3\n", ERR_INPUT, 1, "not a number"},
	{"1e+ 2 3\n", ERR_INPUT, 1, "not a number"},
	{"1.0D 2 3\n", ERR_INPUT, 1, "not a number"},
	{"3D1 2 3\n", ERR_INPUT, 1, "run together"},
	{"id;x;y;z\n\"a\"!;1;2;3\n", ERR_INPUT, 2, "run together"},
	{". 2 3\n", ERR_INPUT, 1, "not a number"},
	{"- 2 3\n", ERR_INPUT, 1, "not a number"},
	{"0x10 2 3\n", ERR_INPUT, 1, "run together"},
	{"1 2 3\n1e300 2 3\n", ERR_INPUT, 2, "digits"},
	{"1e99999999999999999999 2 3\n", ERR_INPUT, 1, "digits"},
	{"1 2 3\n10000000000000000000 2 3\n", ERR_INPUT, 2, "digits"},
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

struct columned {
	const char *columns, *text;
	uint64_t points;
	int64_t last[3];
	uint8_t cls, ret;
	const char *says; /* in the warning or the variant; NULL: no warning */
};

static const struct columned columned[] = {
	{"xyz", "1 2 3 4\n", 1, {1, 2, 3}, 0, 0x11, NULL},
	{"_zyx", "9 1 2 3\n", 1, {3, 2, 1}, 0, 0x11, "columns _zyx"},
	{"s-yxizc", "a b 2 1 77 3 18 rest\n", 1, {1, 2, 3}, 18, 0x11, "columns __yx_zc"},
	{"xyzrn", "1,2,3,2,5\n", 1, {1, 2, 3}, 0, 0x52, "xyzrn"},
	{"xyzc", "1 2 3 2.0\n", 1, {1, 2, 3}, 2, 0x11, "xyzc"},
	{"x_yz", "1;;2;3\n", 1, {1, 2, 3}, 0, 0x11, "x_yz"},
	{"_xyz", "\"a, b\",1,2,3\n", 1, {1, 2, 3}, 0, 0x11, "_xyz"},
	{"x_yz", "1,two words,2,3\n", 1, {1, 2, 3}, 0, 0x11, "x_yz"},
	{"xyz", "y x z\n1 2 3\n", 1, {1, 2, 3}, 0, 0x11, NULL}, /* the option wins */
	{NULL, "X,Y,Z\n1,2,3\n", 1, {1, 2, 3}, 0, 0x11, NULL},
	{NULL, "x y z\n", 0, {0}, 0, 0x11, NULL},
	{NULL, "\xef\xbb\xbf\"X\"; \"Y\"; \"Z\"\r\n1;2;3\r\n", 1, {1, 2, 3}, 0, 0x11, NULL},
	{NULL, "//X Y Z\n1 2 3\n", 1, {1, 2, 3}, 0, 0x11, NULL},
	{NULL, "//Z Y X\n1 2 3\n", 1, {3, 2, 1}, 0, 0x11, "zyx"},
	{NULL, "# z y x in metres\n1 2 3\n", 1, {1, 2, 3}, 0, 0x11, NULL}, /* prose */
	{NULL, "\nid;Northing [m];Easting [m];Height;Classification\n7;2;1;3;9\n", 1, {1, 2, 3}, 9, 0x11, "_yxzc"},
	{NULL, "X,Y,Z,Return Number,Number of Returns,R\n1,2,3,1,2,255\n", 1, {1, 2, 3}, 0, 0x21, "xyzrn"},
	{NULL, "X,Y,Z,return\n1,2,3,1\n", 1, {1, 2, 3}, 0, 0x11, NULL},
	{NULL, "E N H\n1 2 3\n", 1, {1, 2, 3}, 0, 0x11, NULL},
	{"_nez_", "7 2 1 3 GND\n", 1, {1, 2, 3}, 0, 0x11, "columns _yxz"},
	{"eyzrn", "1 2 3 1 2\n", 1, {1, 2, 3}, 0, 0x21, "xyzrn"},
	{"xyz", "E,N,Z\n1,2,3\n", 1, {1, 2, 3}, 0, 0x11, NULL},
	{NULL, "Points of the survey here\n1 2 3 4\n", 1, {1, 2, 3}, 0, 0x11, "names no columns and is skipped"},
	{NULL, "Survey\nDate: 12 05 2024, by me\n\nPt,E,N,Z,Class\n\n7,1,2,3,9\n", 1, {1, 2, 3}, 9, 0x11, "2 lines"},
	{NULL, "x y z\n[m] [m] [m]\n1 2 3\n", 1, {1, 2, 3}, 0, 0x11, NULL},
	{"xyz", "Survey 9\na b c\n1 2 3\n", 1, {1, 2, 3}, 0, 0x11, "1 line before the points, beside that of names, is skipped"},
	{NULL, "X,Y,Z\n1,2,3,GND\n", 1, {1, 2, 3}, 0, 0x11, NULL},
	{NULL, "1,5,2,5,3,5\n", 1, {1, 5, 2}, 0, 0x11, "decimal commas"},
	/* a class or return that only a line of names says is one */
	{NULL,
	 "x,y,z,class\n1,2,3,\n",
	 1,
	 {1, 2, 3},
	 0,
	 0x11,
	 "1 line has no whole number as class or return, the first is line 2"},
	{NULL,
	 "x,y,z,class\n7,7,7,2\n1,2,3,Ground\n",
	 2,
	 {1, 2, 3},
	 2,
	 0x11,
	 "1 line has no whole number as class or return, the first is line 3"},
	{NULL, "class,x,y,z\n\"low, veg\",7,7,7\n2b,1,2,3\n", 2, {1, 2, 3}, 0, 0x11, "2 lines have no whole number"},
	{NULL, "x y z class\n7 7 7 nan\n7 7 7 2.5\n7 7 7 300\n1 2 3 5\n", 4, {1, 2, 3}, 0, 0x11, "3 lines have no whole number"},
	{NULL, "x;class;y;z\n7;2;7;7\n1;1.2.2020;2;3\n", 2, {1, 2, 3}, 2, 0x11, "first is line 3"},
	{NULL, "x,y,z,class\n7,7,7\n1,2,3,1\n", 2, {1, 2, 3}, 0, 0x11, "1 line has"},
	{NULL, "x,y,z,class,return,returns\n1,2,3,4,,2\n", 1, {1, 2, 3}, 4, 0x11, "1 line has"},
	{NULL, "x,y,z,class,return,returns\n1,2,3,-,1,2\n", 1, {1, 2, 3}, 0, 0x21, "1 line has"},
	{NULL, "1.0,5,2,5,3,5\n", 1, {10, 50, 2}, 0, 0x11, NULL},
};

static void columns_and_names(void **state)
{
	for (size_t i = 0; i < sizeof columned / sizeof *columned; i++) {
		const struct columned *c = &columned[i];
		const struct input_options options = {.columns = c->columns};
		int fd = fixture_fd(c->text, strlen(c->text));
		struct err err = ERR_INIT;
		struct input_points pts;
		struct input *in = NULL;

		if (input_open(fd, "a.xyz", &options, &in, &err))
			fail_msg("%s: %s", c->text, err.message);
		fixture_points_new(&pts, 4);
		assert_int_equal(input_read(in, &pts, &err), 0);
		if (pts.n != c->points || (pts.n && memcmp(pts.raw[pts.n - 1], c->last, sizeof c->last)))
			fail_msg("%s: %zu points, %lld ...", c->text, pts.n, pts.n ? (long long)pts.raw[0][0] : 0);
		if (pts.n)
			assert_int_equal(pts.cls[0], c->cls);
		if (pts.n)
			assert_int_equal(pts.ret[0], c->ret);
		if (!c->says ? *input_info(in)->warning != 0 :
			       !strstr(input_info(in)->warning, c->says) && !strstr(input_info(in)->variant, c->says))
			fail_msg("%s: %s; %s", c->text, input_info(in)->variant, input_info(in)->warning);
		fixture_points_free(&pts);
		input_close(in);
		close(fd);
	}
}

static void bad_columns(void **state)
{
	static const struct {
		const char *columns, *text, *says;
		enum err_code code;
		uint64_t line;
		bool strict;
		const char *hint;
	} cases[] = {
		{"xy", "", "are needed", ERR_USAGE, ERR_NO_OFFSET},
		{"xyzz", "", "twice", ERR_USAGE, ERR_NO_OFFSET},
		{"xyzq", "", "letter", ERR_USAGE, ERR_NO_OFFSET},
		{"", "", "are needed", ERR_USAGE, ERR_NO_OFFSET},
		{"xyzr", "", "together", ERR_USAGE, ERR_NO_OFFSET},
		{"enzr", "", "together", ERR_USAGE, ERR_NO_OFFSET},
		{"exyz", "", "twice", ERR_USAGE, ERR_NO_OFFSET},
		{"nyz", "", "are needed", ERR_USAGE, ERR_NO_OFFSET},
		{"xyz_________1_________2_________3_________4_________5_________6_________7", "", "letter", ERR_USAGE,
		 ERR_NO_OFFSET},
		{"xyz______________________________________________________________", "", "64", ERR_USAGE, ERR_NO_OFFSET},
		{"xyzc", "1 2 3 256\n", "class", ERR_INPUT, 1},
		{"xyzc", "1 2 3 4\n1 2 3 -1\n", "class", ERR_INPUT, 2},
		{"xyzc", "1 2 3 0.5\n", "class", ERR_INPUT, 1},
		{"xyzc", "1 2 3 -99e17\n", "class", ERR_INPUT, 1},
		{"xyzrn", "1 2 3 16 2\n", "return", ERR_INPUT, 1},
		{"xyzrn", "1 2 3 1 1e3\n", "number of returns", ERR_INPUT, 1},
		{"xyzc", "1 2 3\n", "fewer than 4", ERR_INPUT, 1},
		{"_xyz", "7,5 1,5 2,5 3,5\n", "decimal commas", ERR_INPUT, 1},
		{"xyzc", "1,2,3,Ground\n", "not a number: \"Ground\"", ERR_INPUT, 1, false, "with _ in --columns"},
		{"xyzc", "x,y,z,class\n1,2,3,\n", "fewer than 4", ERR_INPUT, 2, false, "with _ in --columns"},
		{"xyzc", "1 2 3 2.5\n", "class", ERR_INPUT, 1, false, "with _ in --columns"},
		{NULL, "x,y,z,class\n1,2,3,Ground\n", "not a number: \"Ground\"", ERR_INPUT, 2, true, "without --strict"},
		{NULL, "x,y,z,class\n1,2,3,2.5\n", "class", ERR_INPUT, 2, true, "without --strict"},
	};

	for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
		const struct input_options options = {.columns = cases[i].columns, .strict = cases[i].strict};
		struct outcome out = fixture_read(cases[i].text, strlen(cases[i].text), "a.xyz", &options, 10);

		if (out.code != cases[i].code || !strstr(out.err.message, cases[i].says) ||
		    (cases[i].hint && !strstr(out.err.hint, cases[i].hint)))
			fail_msg("%s %s: %d %s", cases[i].columns, cases[i].text, out.code, out.err.message);
		assert_true(out.err.offset == cases[i].line && out.err.hint[0] | (out.code == ERR_INPUT));
	}
}

static void counted_points(void **state)
{
	static const struct {
		const char *text;
		bool lenient;
		enum err_code code;
		uint64_t points, line;
		const char *says;
	} cases[] = {
		{"2\n1 2 3 -100 255 0 0\n4 5 6 7 8 9 10\n", false, 0, 2, 0, NULL},
		{"\xef\xbb\xbf\r\n# scan\r\n  2 \r\n1 2 3\r\n\r\n4 5 6\r\n", false, 0, 2, 0, NULL},
		{"0\n", false, 0, 0, 0, NULL},
		{"1\n1 2 3\n2\n4 5 6\n7 8 9\n", false, 0, 3, 0, NULL}, /* two scans */
		{"3\n1 2 3\n4 5 6\n", false, ERR_TRUNCATED, 0, 1, "1 of them"},
		{"3\n1 2 3\n4 5 6\n", true, 0, 2, 0, "fewer"},
		{"\n2\n1 2 3\n1\n4 5 6\n", false, ERR_TRUNCATED, 0, 2, "missing"},
		{"1\n1 2 3\n4 5 6\n", false, 0, 2, 0, "1 point more"},
		{"18446744073709551616\n1 2 3\n", false, ERR_INPUT, 0, 1, "digits"},
		{"1000000000000\n1 2 3\n", false, ERR_TRUNCATED, 0, 1, "999999999999"},
		{"1\n1 2\n", false, ERR_INPUT, 0, 2, "fewer than three"},
	};

	for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
		for (int name = 0; name < 2; name++) {
			const struct input_options options = {.accept_truncated = cases[i].lenient};
			struct outcome out =
				fixture_read(cases[i].text, strlen(cases[i].text), name ? "a.pts" : "a.txt", &options, 10);
			const char *text = out.code ? out.err.message : out.info.warning;

			if (out.code != cases[i].code || (cases[i].says ? !strstr(text, cases[i].says) : *text))
				fail_msg("%s: %d %s", cases[i].text, out.code, text);
			assert_int_equal(out.points, cases[i].points);
			if (out.code)
				assert_int_equal(out.err.offset, cases[i].line);
		}
}

/* Numbers with more digits than can be kept are rounded: to the lattice where it is known, else to what the file alone would
 * have. */
static void more_digits(void **state)
{
	static const struct {
		const char *text, *scale, *says;
		int place_xy, place_z;
		int64_t x, z;
		bool rounds;
	} rows[] = {
		{"0.10000000000000000555 2 3\n", NULL, "x and y are rounded to 1e-15", -15, 0, 100000000000000, 3, true},
		{"1e-300 2 3\n", NULL, "more digits", -15, 0, 0, 3, true},
		{"1.D-300 2 3\n", NULL, "more digits", -15, 0, 0, 3, true},
		{"1.000000000000000000e+00 2.0000000000000000000 3\n", NULL, NULL, 0, 0, 1, 3, false}, /* zeros are no digits */
		{"1 2 0.1234567890123456789\n4 5 6\n", NULL, "z is rounded to 0.00000001", 0, -8, 4, 600000000, true},
		{"99999999999 1 1\n1 0.000000001 1\n", NULL, "to 0.0005", 0, 0, 2000, 1, true},
		{"lon,lat,h\n0.12345678901234567,0,1\n9,0,1\n", NULL, "to 0.000000001;", -9, 0, INT64_C(9000000000), 1, true},
		{"0.12345678 0 1\n100 0 1\n", NULL, "to 0.0000001", -8, 0, INT64_C(10000000000), 1, false},
		{"1.00050000000000000001 0 1\n", "0.001", NULL, -9, 0, 1000500001, 1, true}, /* odd: above the middle */
		{"1.00049999999999999999 0 1\n", "0.001", NULL, -9, 0, 1000499999, 1, true},
		{"-1.00050000000000000001 0 1\n", "0.001", NULL, -9, 0, -1000500001, 1, true},
		{"1.0000000000000000000000000000000000000000000000000001 0 1\n", "0.001", NULL, -9, 0, 1000000001, 1, true},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct input_options options = {.planar = true};
		int fd = fixture_fd(rows[i].text, strlen(rows[i].text));
		struct err err = ERR_INIT;
		struct input_points pts;
		const struct input_info *info;
		struct input *in = NULL;

		if (rows[i].scale)
			assert_true(decimal_parse(rows[i].scale, &options.scale_xy));
		if (input_open(fd, "a.xyz", &options, &in, &err))
			fail_msg("%s: %s", rows[i].text, err.message);
		info = input_info(in);
		fixture_points_new(&pts, 4);
		assert_int_equal(input_read(in, &pts, &err), 0);
		if (pts.raw[pts.n - 1][0] != rows[i].x || pts.raw[pts.n - 1][2] != rows[i].z)
			fail_msg("%s: %lld %lld", rows[i].text, (long long)pts.raw[pts.n - 1][0],
				 (long long)pts.raw[pts.n - 1][2]);
		if (!rows[i].says ? *info->warning != 0 : !strstr(info->warning, rows[i].says))
			fail_msg("%s: %s", rows[i].text, info->warning);
		assert_int_equal(info->coords.rounds[0] || info->coords.rounds[2], rows[i].rounds);
		if (info->coords.scale[0].mantissa == 1)
			assert_int_equal(info->coords.scale[0].exponent, rows[i].place_xy);
		assert_int_equal(info->coords.scale[2].exponent, rows[i].place_z);
		fixture_points_free(&pts);
		input_close(in);
		close(fd);
	}
}

/* The quick way of the number reader is the long one's, number for number. */
static void numbers(void **state)
{
	uint32_t roll = 1;

	for (int i = 0; i < 200000; i++) {
		struct input_number quick, slow;
		char text[64], longer[80];
		const char *at = text, *also = longer;
		int n = 0, digits;

		roll = roll * 1664525 + 1013904223;
		digits = roll >> 28;
		if (roll >> 9 & 1)
			text[n++] = '-';
		for (int k = 0, point = (int)(roll >> 20 & 15); k <= digits; k++) {
			if (k == point)
				text[n++] = '.';
			text[n++] = (char)('0' + (roll >> (k + 2) & 7) * (roll >> (k + 5) & 1));
		}
		text[n] = 0;
		snprintf(longer, sizeof longer, "%se0", text);
		assert_int_equal(input_number_read(&at, text + n, &quick), INPUT_NUMBER_OK);
		assert_int_equal(input_number_read(&also, longer + n + 2, &slow), INPUT_NUMBER_OK);
		if (quick.mantissa != slow.mantissa || quick.exponent != slow.exponent || quick.written != slow.written ||
		    at != text + n)
			fail_msg("%s: %lld %d %d, %lld %d %d", text, (long long)quick.mantissa, quick.exponent, quick.written,
				 (long long)slow.mantissa, slow.exponent, slow.written);
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
		size += (size_t)snprintf(text + size, cap - size, "%zu.%02zu -%zu.5 %zu%*s%s", i, i % 100, i, i * 7,
					 (int)(i % 37), "", i % 3 ? "\n" : "\r\n");
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
	static const struct {
		const char *before, *after;
	} cases[] = {
		{"1 2 3\n4 5 6\n", "1 2 3\n"},
		{"1 2 3\n4 5 6\n", "1 2 3\n4 5.5 6\n"},
		{"1 2 3\n4 5 6\n", "1 2 3\n4 5 6\n7 8 9\n"},
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
		assert_int_equal(futimens(fd, (struct timespec[]){{.tv_sec = 1}, {.tv_sec = 1}}), 0);
		fixture_points_new(&pts, 10);
		rc = input_read(in, &pts, &err);
		assert_int_equal(rc, -ERR_CHANGED);
		fixture_points_free(&pts);
		input_close(in);
		close(fd);
	}
}

/* A pipe that sends blank lines for ever: the reader comes back now and then, so that it can be told to stop; and
 * many of them between two points lose neither. */
static void endless_blank_lines(void **state)
{
	enum { BLANK = 1 << 20 };
	static char text[BLANK + 16], head[300];
	struct input_options options = {.format = "xyz", .has_pipe = true};
	struct err err = ERR_INIT;
	struct input_points pts;
	struct input *in;
	unsigned turns = 0, points = 0;
	int fd;

	memset(head, '\n', sizeof head);
	memcpy(head, "1 2 3", 5);
	memset(text, '\n', sizeof text);
	memcpy(text + BLANK, "\n4 5 6\n", 7);
	fd = fixture_fd(head, sizeof head);
	options.pipe = fixture_fd(text, sizeof text);
	assert_int_equal(input_open(fd, "a.txt", &options, &in, &err), 0);
	fixture_points_new(&pts, 1000);
	do {
		assert_int_equal(input_read(in, &pts, &err), 0);
		points += (unsigned)pts.n;
		turns++;
	} while (pts.n || input_dry(in));
	assert_int_equal(points, 2);
	assert_in_range(turns, 16, 40);
	fixture_points_free(&pts);
	input_close(in);
	close(options.pipe);
	close(fd);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(good_texts),
		cmocka_unit_test(bad_lines),
		cmocka_unit_test(columns_and_names),
		cmocka_unit_test(bad_columns),
		cmocka_unit_test(counted_points),
		cmocka_unit_test(more_digits),
		cmocka_unit_test(numbers),
		cmocka_unit_test(long_lines),
		cmocka_unit_test(across_the_buffer),
		cmocka_unit_test(endless_blank_lines),
		cmocka_unit_test(changes_between_the_passes),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
