/*
 * The view options against the engine's own reader: every combination gives a request that the engine takes for
 * the very view, and what the engine calls a contradiction is one here. The one place where the two rooms meet.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "ctl_view.h"
#include "err.h"
#include "lattice.h"
#include "view.h"

static const char *const classes[] = {NULL, "2", "2,8", "8,2", "2-5,9", "5,4,3", "0-255", "255", "0,2,4,6-8"};
static const char *const returns[] = {NULL, "all", "first", "last"};
static const char *const duplicates[] = {NULL, "lowest", "highest"};

static const struct lattice lattice = {.scale_xy = {1, -2}, .scale_z = {1, -3}, .k = {63500000, -7, 0}};

static void assert_same(const char *asked, const struct view *want)
{
	struct view got;
	struct err err = ERR_INIT;
	char *mine, *theirs = view_text(want);

	assert_int_equal(view_resolve(asked, &lattice, "unknown", "unknown", &got, &err), 0);
	mine = view_text(&got);
	assert_string_equal(mine, theirs);
	view_done(&got);
	free(mine);
	free(theirs);
}

static void one(unsigned c, unsigned r, unsigned d, unsigned flags)
{
	struct ctl_view_options a = {.classes = classes[c],
				     .returns = returns[r],
				     .duplicates = duplicates[d],
				     .ground = flags & 1,
				     .surface = flags & 2,
				     .keep_withheld = flags & 4,
				     .keep_noise = flags & 8};
	struct view v = VIEW_INIT;
	struct err e = ERR_INIT, f = ERR_INIT;
	char *asked = NULL;
	int got = ctl_view_text(&a, &asked, &e), want;

	v.ground = a.ground;
	v.surface = a.surface;
	v.keep_withheld = a.keep_withheld;
	v.keep_noise = a.keep_noise;
	v.returns = r == 2 ? VIEW_RETURNS_FIRST : r == 3 ? VIEW_RETURNS_LAST : VIEW_RETURNS_ALL;
	v.duplicates = d == 2 ? VIEW_HIGHEST : VIEW_LOWEST;
	if (classes[c])
		assert_int_equal(view_set_classes(&v, classes[c], &f), 0);
	want = view_check(&v, &f);
	if (a.surface && d == 1) /* the engine cannot tell "lowest" from "not said" */
		want = -ERR_USAGE;
	assert_int_equal(got, want);
	if (!got)
		assert_same(asked, &v);
	free(asked);
}

static void test_all(void **state)
{
	for (unsigned c = 0; c < sizeof(classes) / sizeof(*classes); c++)
		for (unsigned r = 0; r < 4; r++)
			for (unsigned d = 0; d < 3; d++)
				for (unsigned flags = 0; flags < 16; flags++)
					one(c, r, d, flags);
}

/* Each row of base/view_option.def, as an option and as the word that the engine reads. */
static void test_rows(void **state)
{
	static const struct {
		struct ctl_view_options option;
		const char *text;
	} row[] = {
#define VIEW_FLAG(name, word, help) {{.name = true}, "view 1 " word},
#define VIEW_COUNT(name, word, value, help) {{.name = 7}, "view 1 " word "=7"},
#define VIEW_HEIGHT(name, word, value, help) {{.name = "1.2345"}, "view 1 " word "=1235"},
#include "view_option.def"
		{{.breakline_clear = "0"}, "view 1"},
		{{.breakline_clear = "0.0", .no_breaklines = true}, "view 1 no-breaklines"},
		{{.metric = "1,0,1", .max_error = "1"}, "view 1 max-error=1000"},
		{{.metric = "1,0,1", .max_points = 5, .weight = "0=0", .bbox = "1,2,3,4"},
		 "view 1 window=box:100,200,300,400 max-points=5"},
		{{.max_error = "0"}, "view 1 max-error=0"},
		{{.max_error = "1.2345", .thin = "0.02", .every = 3}, "view 1 every=3 thin=2:lowest max-error=1234"},
		{{.metric = "-4,+2,3"}, "view 1 metric=2,-1,3"},
		{{.weight = "9=1.2345,2=0.5", .ground = true}, "view 1 ground weight=2:50,9:123"},
		{{.breakline_clear = "1.2345", .thin = "0.02"}, "view 1 thin=2:lowest breakline-clear=123"},
	};

	for (unsigned i = 0; i < sizeof(row) / sizeof(*row); i++) {
		struct view want;
		struct err err = ERR_INIT;
		char *asked;

		assert_int_equal(view_parse(row[i].text, &want, &err), 0);
		assert_int_equal(ctl_view_text(&row[i].option, &asked, &err), 0);
		assert_same(asked, &want);
		free(asked);
	}
#define VIEW_HEIGHT(name, word, value, help)                                              \
	{                                                                                 \
		const struct ctl_view_options high = {.name = "high"};                    \
		struct err err = ERR_INIT;                                                \
		char *asked;                                                              \
                                                                                          \
		assert_int_equal(ctl_view_text(&high, &asked, &err), -ERR_USAGE);         \
		assert_string_equal(err.message, "--" word " is not a height: \"high\""); \
		assert_true(err.hint[0]);                                                 \
	}
#include "view_option.def"
}

/* The names of files in a request; what the daemon makes of them, tests/e2e/weights_files.py tests. */
static void test_files(void **state)
{
	static const char *const row[][2] = {
		{"a.laz=0.5,2=1m", "@a.laz:0.5,2:1m"},
		{"2024/*.laz=30ft", "@2024/*.laz:30ft"},
		{"v=1 a:b.laz=5,./7=3", "@v%3D1%20a%3Ab.laz:5,@./7:3"},
		{"gr\xc3\xbcn%.csv=0", "@gr%C3%BCn%25.csv:0"},
		{"[ab]?=1,9=1", "@[ab]?:1,9:1"},
	};

	for (unsigned i = 0; i < sizeof(row) / sizeof(*row); i++) {
		const struct ctl_view_options a = {.weight = row[i][0]};
		struct err err = ERR_INIT;
		char *text, want[200];

		snprintf(want, sizeof want, "ask 1 weight=%s", row[i][1]);
		assert_int_equal(ctl_view_text(&a, &text, &err), 0);
		assert_string_equal(text, want);
		free(text);
	}
}

static void test_bad_weights(void **state)
{
	static const char *const bad[] = {"",         "2",     "2=",       "=1",      "2:1",   "256=1", "2=-1",
					  "2=1,",     ",2=1",  "2=1,,3=1", "2=x",     "2=1km", "x=",    "a.laz",
					  "a.laz=-1", "2.5=1", "a.laz=1,", "2=1;3=1", "-2=1",  "2 =1",  "1000=1"};
	char *text;

	for (unsigned i = 0; i < sizeof(bad) / sizeof(*bad); i++) {
		const struct ctl_view_options a = {.weight = bad[i]};
		struct err e = ERR_INIT;

		assert_int_equal(ctl_view_text(&a, &text, &e), -ERR_USAGE);
		assert_non_null(strstr(e.message, "--weight"));
	}
	char name[5003];
	const struct ctl_view_options a = {.weight = name};
	struct err e = ERR_INIT;

	memset(name, 'n', 5000);
	strcpy(name + 5000, "=5");
	assert_int_equal(ctl_view_text(&a, &text, &e), -ERR_USAGE);
	assert_non_null(strstr(e.message, "5000 bytes"));
}

static void test_rubbish(void **state)
{
	static const char *const bad[] = {
		"", ",", "2,", ",2", "256", "-1", "2-", "-2", "5-2", "2;8", " 2", "2 ", "two", "1-2-3", "99999999999999999999"};

	for (unsigned i = 0; i < sizeof(bad) / sizeof(*bad); i++) {
		struct ctl_view_options a = {.classes = bad[i]};
		struct view v = VIEW_INIT;
		char *text;
		struct err e = ERR_INIT, f = ERR_INIT;

		assert_int_equal(ctl_view_text(&a, &text, &e), -ERR_USAGE);
		assert_int_equal(view_set_classes(&v, bad[i], &f), -ERR_USAGE);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_all), cmocka_unit_test(test_rows),
					   cmocka_unit_test(test_rubbish), cmocka_unit_test(test_bad_weights),
					   cmocka_unit_test(test_files)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
