/*
 * Requests: each word and its expected result, lengths in every unit, invalid requests and their errors; random
 * requests to canonical texts and back, with the rounding done by another method; codes of areas.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "area_code.h"
#include "decimal.h"
#include "err.h"
#include "lattice.h"
#include "random.h"
#include "view.h"
#include "view_area.h"

static const struct lattice fine = {{1, -2}, {1, -3}, {63500000, 685300000, 0}}, coarse = {{25, -2}, {5, 0}, {0, 0, 0}},
			    odd = {{7, -3}, {3, -1}, {-5, 5, 9}};

static uint64_t seed = 7;

static uint64_t roll(uint64_t n)
{
	return random_below(&seed, n);
}

static void becomes(const char *asked, const struct lattice *l, const char *unit, const char *want)
{
	struct view v, again;
	struct err err = ERR_INIT;
	char *text;
	int r = view_resolve(asked, l, unit, unit, &v, &err);

	if (r)
		print_error("%s: %s\n", asked, err.message);
	assert_int_equal(r, 0);
	text = view_text(&v);
	assert_string_equal(text, want);
	/* A canonical text is accepted as a request, and by code that only reads canonical texts. */
	assert_int_equal(view_parse(text, &again, &err), 0);
	assert_true(digest_equal(view_hash(&v), view_hash(&again)));
	view_done(&again);
	assert_int_equal(view_resolve(text, l, "degree", "degree", &again, &err), 0);
	view_done(&again);
	view_done(&v);
	free(text);
}

static void refused(const char *asked, const char *unit, int code, const char *said)
{
	struct view v = VIEW_INIT;
	struct err err = ERR_INIT;

	if (view_resolve(asked, &fine, unit, unit, &v, &err) != -code)
		print_error("%s: %d %s\n", asked, (int)err.code, err.message);
	assert_int_equal(err.code, code);
	if (!strstr(err.message, said))
		print_error("%s: %s\n", asked, err.message);
	assert_non_null(strstr(err.message, said));
}

static void test_words(void **state)
{
	becomes("", &fine, "metre", "view 1");
	becomes("ask 1", &fine, "metre", "view 1");
	becomes("ask 1 not-class=7,3-5", &fine, "metre", "view 1 not-class=3-5,7");
	becomes("ask 1 not-class=3 class=2-4", &fine, "metre", "view 1 class=2,4");
	becomes("ask 1 duplicates=highest drop-overlap keep-noise", &fine, "x",
		"view 1 keep-noise drop-overlap duplicates=highest");
	becomes("ask 1 zmax=12.3455 zmin=-0.0005", &fine, "x", "view 1 zmin=0 zmax=12346");
	becomes("ask 1 zmin=2.4999 zmax=2.5", &coarse, "x", "view 1 zmin=0 zmax=1");
	becomes("ask 1 zmin=-2.5 zmax=-2.5", &coarse, "x", "view 1 zmin=0 zmax=0");
	becomes("ask 1 zmin=-1e4000 zmax=1e4000", &coarse, "x", "view 1 zmin=-4611686018427387904 zmax=4611686018427387904");
	becomes("ask 1 zmin=1e-4000", &coarse, "x", "view 1 zmin=0");
	becomes("ask 1 zmin=-1e-4000", &coarse, "x", "view 1 zmin=0");
	becomes("ask 1 crop=box:635000.004,6853000.005,635100,6.8532e6", &fine, "x",
		"view 1 crop=box:63500000,685300001,63510000,685320000");
	becomes("ask 1 crop=box:-0.125,0.125,0,0.375", &coarse, "x", "view 1 crop=box:0,1,0,2");
	becomes("ask 1 window=box:-0.125,0.125,0,0.375 crop=box:0,0,1,1", &coarse, "x",
		"view 1 crop=box:0,0,4,4 window=box:0,1,0,2");
	becomes("ask 1 every=1", &fine, "x", "view 1");
	becomes("ask 1 every=18446744073709551615", &fine, "x", "view 1 every=18446744073709551615");
	becomes("ask 1 thin=0.005:median", &fine, "x", "view 1 thin=1:median");
	becomes("ask 1 thin=2:highest", &odd, "x", "view 1 thin=286:highest");
	(void)state;
}

/* Each row of base/view_option.def: its word in a request, its canonical text, once, with a value only if it has one. */
static void test_rows(void **state)
{
#define VIEW_FLAG(field, word, help)                                   \
	becomes("ask 1 " word, &fine, "x", "view 1 " word);            \
	refused("ask 1 " word " " word, "x", ERR_PROTO, "not a view"); \
	refused("ask 1 " word "=1", "x", ERR_PROTO, "not a view");
#define VIEW_COUNT(field, word, value, help)                                  \
	becomes("ask 1 " word "=7", &fine, "x", "view 1 " word "=7");         \
	refused("ask 1 " word "=7 " word "=7", "x", ERR_PROTO, "not a view"); \
	refused("ask 1 " word, "x", ERR_PROTO, "not a view");                 \
	refused("ask 1 " word "=0", "x", ERR_PROTO, "not a view");            \
	refused("ask 1 " word "=07", "x", ERR_PROTO, "not a view");
#define VIEW_HEIGHT(field, word, value, help)                                 \
	becomes("ask 1 " word "=1.2345", &fine, "x", "view 1 " word "=1235"); \
	becomes("ask 1 " word "=0", &fine, "x", "view 1 " word "=0");         \
	refused("ask 1 " word "=1 " word "=1", "x", ERR_PROTO, "not a view"); \
	refused("ask 1 " word "=high", "x", ERR_USAGE, "--" word ": \"high\" is not a number");
#include "view_option.def"
	(void)state;
}

/* Instead of the view's own; the same text whichever way it was requested. */
static void test_window(void **state)
{
	static const char *const ways[][2] = {{"ask 1 ground", "box:1,2,3,4"},
					      {"view 1 ground", "box:1.0,2e0,3,4"},
					      {"ask 1 ground window=box:1,2,3,4", ""},
					      {"view 1 ground window=box:7,7,8,8", "box:1,2,3,4"}};
	struct err err = ERR_INIT;
	struct view v;

	for (size_t i = 0; i < sizeof ways / sizeof *ways; i++) {
		char *text;

		assert_int_equal(view_resolve_window(ways[i][0], ways[i][1], &coarse, "x", "x", &v, &err), 0);
		text = view_text(&v);
		assert_string_equal(text, "view 1 ground window=box:4,8,12,16");
		assert_false(view_selects(&v));
		free(text);
		view_done(&v);
	}
	assert_int_equal(view_resolve_window("ask 1", "box:3,2,1,4", &coarse, "x", "x", &v, &err), -ERR_USAGE);
	err = ERR_INIT;
	assert_int_equal(view_resolve_window("ask 1", "box:1,2,3", &coarse, "x", "x", &v, &err), -ERR_PROTO);
	(void)state;
}

static void test_lengths(void **state)
{
	becomes("ask 1 thin=10:lowest", &fine, "us-survey-foot", "view 1 thin=1000:lowest");
	becomes("ask 1 breakline-clear=0.3048m duplicates=highest", &fine, "foot",
		"view 1 duplicates=highest breakline-clear=100");
	becomes("ask 1 breakline-clear=0.004", &fine, "unknown", "view 1");
	becomes("ask 1 breakline-clear=0m", &fine, "metre", "view 1");
	becomes("view 1 breakline-clear=8589934592 window=box:0,1,0,2", &fine, "x",
		"view 1 breakline-clear=8589934592 window=box:0,1,0,2");
	becomes("ask 1 weight=2:1 window=box:1,2,3,4", &coarse, "x", "view 1 window=box:4,8,12,16 weight=2:4");
	becomes("ask 1 weight=9:0.3,2:1.5", &fine, "unknown", "view 1 weight=2:150,9:30");
	becomes("ask 1 weight=2:1ft,255:10m class=2", &fine, "metre", "view 1 class=2 weight=2:30,255:1000");
	becomes("ask 1 weight=2:0.004,3:0", &fine, "metre", "view 1");
	becomes("ask 1 weight=#7:0.3,2:1.5,#3+1-2+9-9:30m,#4-6:0.304", &fine, "metre", "view 1 weight=2:150,#4-7:30,#1-3+9:3000");
	becomes("ask 1 weight=#1:0,2:1,#2:0.001", &fine, "metre", "view 1 weight=2:100,#1-2:0");
	becomes("ask 1 weight=#1:0,2:0,#2:0.001", &fine, "metre", "view 1");
	becomes("ask 1 hidden weight=2:1", &fine, "metre", "view 1 weight=2:100 hidden");
	becomes("ask 1 weight=#1-4294967295:1", &fine, "metre", "view 1 weight=#1-4294967295:100");
	becomes("ask 1 weight=0:10737418.24", &fine, "metre", "view 1 weight=0:1073741824");
	becomes("ask 1 thin=10m:lowest", &fine, "metre", "view 1 thin=1000:lowest");
	becomes("ask 1 metric=-6,2,5 ground", &fine, "unknown", "view 1 ground metric=3,-1,5");
	becomes("ask 1 metric=0,-9223372036854775807,2 window=box:1,2,3,4", &coarse, "x",
		"view 1 window=box:4,8,12,16 metric=0,1,2");
	becomes("ask 1 metric=3,4,1", &fine, "unknown", "view 1");
	/* What changes nothing contradicts nothing. */
	becomes("ask 1 metric=3,4,1 max-error=5 weight=0:0 window=box:1,2,3,4", &coarse, "x",
		"view 1 window=box:4,8,12,16 max-error=1");
	becomes("ask 1 metric=3,4,1 weight=2:1", &fine, "unknown", "view 1 weight=2:100");
	becomes("ask 1 weight=0:0 metric=1,0,2", &fine, "unknown", "view 1 metric=1,0,2");
	becomes("ask 1 no-breaklines breakline-clear=0m", &fine, "metre", "view 1 no-breaklines");
	becomes("ask 1 thin=0.3048m:lowest", &fine, "foot", "view 1 thin=100:lowest");
	becomes("ask 1 thin=1e3ft:lowest", &fine, "metre", "view 1 thin=30480:lowest");
	becomes("ask 1 thin=39.37ftUS:lowest", &fine, "metre", "view 1 thin=1200:lowest");
	becomes("ask 1 thin=1200m:lowest", &fine, "us-survey-foot", "view 1 thin=393700:lowest");
	/* 10^6 survey feet are 1,000,002.000004 feet. */
	becomes("ask 1 thin=1000000ftUS:lowest", &fine, "foot", "view 1 thin=100000200:lowest");
	becomes("ask 1 thin=1000000ft:lowest", &fine, "us-survey-foot", "view 1 thin=99999800:lowest");
	becomes("ask 1 thin=0.2:lowest", &coarse, "degree", "view 1 thin=1:lowest");
	(void)state;
}

/* A bound is rounded down, in the unit of heights. */
static void test_bounds(void **state)
{
	struct view v;
	struct err err = ERR_INIT;

	becomes("ask 1 max-error=0.1", &fine, "unknown", "view 1 max-error=100");
	becomes("ask 1 max-error=0.0999999", &fine, "unknown", "view 1 max-error=99");
	becomes("ask 1 max-error=0.1m every=3", &fine, "metre", "view 1 every=3 max-error=100");
	becomes("ask 1 max-error=0.1m", &fine, "foot", "view 1 max-error=328");
	becomes("ask 1 max-error=1ftUS", &fine, "metre", "view 1 max-error=304");
	becomes("ask 1 max-error=0", &fine, "degree", "view 1 max-error=0");
	becomes("ask 1 window=box:0,1,0,2 max-points=12", &coarse, "x", "view 1 window=box:0,4,0,8 max-points=12");
	becomes("view 1 max-error=8589934592", &fine, "x", "view 1 max-error=8589934592");
	assert_int_equal(view_resolve("ask 1 max-error=1m thin=1m:lowest", &fine, "metre", "foot", &v, &err), 0);
	assert_int_equal(v.max_error, 3280);
	assert_int_equal(v.thin.cell, 100);
	assert_true(view_selects(&v) && view_simplifies(&v));
	v = view_whole(&v);
	assert_true(view_selects(&v) && !view_simplifies(&v));
	assert_int_equal(view_resolve("ask 1 max-error=0 window=box:0,1,0,2", &fine, "metre", "foot", &v, &err), 0);
	assert_true(view_selects(&v) && view_simplifies(&v));
	v = view_whole(&v);
	assert_true(!view_selects(&v) && !v.window);
	assert_int_equal(view_resolve("ask 1 max-error=1m", &fine, "metre", "unknown", &v, &err), -ERR_INPUT);
	assert_non_null(strstr(err.message, "unit of the heights is unknown"));
	assert_non_null(strstr(err.hint, "XY,Z"));
	(void)state;
}

static void test_lengths_refused(void **state)
{
	char many[512];

	refused("ask 1 thin=10m:lowest", "unknown", ERR_INPUT, "unknown");
	refused("ask 1 breakline-clear=10m", "unknown", ERR_INPUT, "unknown");
	refused("ask 1 breakline-clear=1e300", "metre", ERR_USAGE, "more than any");
	refused("ask 1 breakline-clear=1e8", "metre", ERR_USAGE, "more than any");
	refused("ask 1 breakline-clear=-1", "metre", ERR_USAGE, "not a length");
	refused("ask 1 breakline-clear=x", "metre", ERR_USAGE, "not a length");
	refused("ask 1 breakline-clear=1 no-breaklines", "metre", ERR_USAGE, "no point is near");
	refused("ask 1 max-error=1m", "unknown", ERR_INPUT, "unknown");
	refused("ask 1 max-error=1m", "degree", ERR_INPUT, "degrees");
	refused("ask 1 max-error=-1", "metre", ERR_USAGE, "not a length");
	refused("ask 1 max-error=", "metre", ERR_USAGE, "not a length");
	refused("ask 1 max-error=1e300", "metre", ERR_USAGE, "higher than any");
	refused("ask 1 max-error=0.0009", "metre", ERR_USAGE, "less than a step of the heights' lattice (0.001)");
	refused("ask 1 max-error=0.003ft", "metre", ERR_USAGE, "less than a step");
	refused("ask 1 max-error=1e7", "metre", ERR_USAGE, "higher than any");
	refused("ask 1 max-error=1 max-points=5", "metre", ERR_USAGE, "looks for the bound");
	refused("ask 1 max-error=1 weight=2:1", "metre", ERR_USAGE, "no bound of errors");
	refused("ask 1 max-points=9 weight=2:1", "metre", ERR_USAGE, "no bound of errors");
	refused("ask 1 max-points=0", "metre", ERR_PROTO, "");
	refused("ask 1 max-error=1 metric=1,2,3", "metre", ERR_USAGE, "a metric has no bound");
	refused("ask 1 metric=1,2,3 max-points=7", "metre", ERR_USAGE, "a metric has no bound");
	refused("ask 1 max-points=5m", "metre", ERR_PROTO, "");
	refused("ask 1 metric=0,0,2", "metre", ERR_USAGE, "no direction");
	refused("ask 1 metric=1,2,0", "metre", ERR_USAGE, "at least 1");
	refused("ask 1 metric=1,2,10001", "metre", ERR_USAGE, "K is more");
	refused("ask 1 metric=10001,2,3", "metre", ERR_USAGE, "P is more");
	refused("ask 1 metric=1,2", "metre", ERR_PROTO, "not a view");
	refused("ask 1 metric=1,2,3,", "metre", ERR_PROTO, "not a view");
	refused("ask 1 metric=1,2,3m", "metre", ERR_PROTO, "not a view");
	refused("ask 1 weight=2:10m", "unknown", ERR_INPUT, "unknown");
	refused("ask 1 weight=2:-1", "metre", ERR_USAGE, "not a length");
	refused("ask 1 weight=2:10737418.25", "metre", ERR_USAGE, "2^30");
	refused("ask 1 weight=2:1,3:1,2:5", "metre", ERR_USAGE, "--weight: the class is named twice: \"2=5\"");
	refused("ask 1 weight=0:0,0:2", "metre", ERR_USAGE, "--weight: the class is named twice: \"0=2\"");
	refused("ask 1 weight=0:2,0:0", "metre", ERR_USAGE, "--weight: the class is named twice: \"0=0\"");
	for (unsigned i = 0, n = (unsigned)snprintf(many, sizeof many, "ask 1 weight="); i < 33; i++)
		n += (unsigned)snprintf(many + n, sizeof many - n, "%s%u:1", i ? "," : "", i);
	refused(many, "metre", ERR_USAGE, "--weight: too many classes have a radius: \"32=1\"");
	refused("ask 1 weight=256:1", "metre", ERR_USAGE, "\"256=1\"");
	refused("ask 1 weight=256:1", "metre", ERR_USAGE, "no class");
	refused("ask 1 weight=2", "metre", ERR_USAGE, "no class");
	refused("ask 1 weight=2:0 hidden", "metre", ERR_USAGE, "nothing is hidden");
	refused("ask 1 weight=@a.laz:1", "metre", ERR_USAGE, "in the dataset only");
	refused("ask 1 weight=#1-3:1,#2:2", "metre", ERR_USAGE, "source 2 has two radii");
	refused("ask 1 weight=2:", "metre", ERR_USAGE, "no class");
	refused("ask 1 weight=2:1 metric=1,0,2", "metre", ERR_USAGE, "circles");
	refused("ask 1 thin=10ft:lowest", "", ERR_INPUT, "unknown");
	refused("ask 1 thin=10ftUS:lowest", "degree", ERR_INPUT, "degrees");
	refused("ask 1 thin=0.004:lowest", "metre", ERR_USAGE, "less than half a step");
	refused("ask 1 thin=1e300:lowest", "metre", ERR_USAGE, "larger than any");
	refused("ask 1 thin=-1:lowest", "metre", ERR_USAGE, "not a length");
	refused("ask 1 thin=m:lowest", "metre", ERR_USAGE, "not a length");
	refused("ask 1 thin=1", "metre", ERR_PROTO, "");
	refused("ask 1 thin=1:best", "metre", ERR_PROTO, "");
	(void)state;
}

static void test_refused(void **state)
{
	static const char *const bad[] = {
		"ask",
		"ask 2",
		"ask 1 ",
		"ask 1  ground",
		"ask 1 rubbish",
		"ask 1 ground ground",
		"ask 1 zmin=1 zmin=2",
		"ask 1 class=",
		"ask 1 every=0",
		"ask 1 every=-1",
		"ask 1 crop=box:1,2,3",
		"ask 1 crop=box:1,2,3,4,5",
		"ask 1 crop=area:+AA",
		"ask 1 crop=area@0:",
		"ask 1 crop=area@0:AA",
		"ask 1 crop=area@0:+A",
		"ask 1 crop=area@0:+A?",
		"ask 1 crop=area@0:+gA",
		"ask 1 crop=area@41:+AA",
		"ask 1 crop=area@00:+AA",
		"ask 1 crop=circle:1",
		"ask 1 weight=",
		"ask 1 weight=2:1,",
		"ask 1 weight=#:1",
		"ask 1 weight=#0:1",
		"ask 1 weight=#1+:1",
		"ask 1 weight=#1-:1",
		"ask 1 weight=#-1:1",
		"ask 1 weight=#01:1",
		"ask 1 weight=#2-1:1",
		"ask 1 weight=#1-2-3:1",
		"ask 1 weight=#4294967296:1",
		"view 1 zmin=1.5",
		"view 1 zmin=01",
		"view 1 zmin=-0",
		"view 1 zmax=1 zmin=0",
		"view 1 every=1",
		"view 1 thin=0:lowest",
		"view 1 metric=2,4,3",
		"view 1 metric=-1,2,3",
		"view 1 metric=0,-1,3",
		"view 1 metric=1,2,1",
		"view 1 metric=1,2,10001",
		"view 1 metric=0,0,0",
		"view 1 metric=1,2,3,",
		"view 1 metric=1,2,3 window=box:1,2,3,4",
		"view 1 breakline-clear=0",
		"view 1 breakline-clear=-1",
		"view 1 breakline-clear=8589934593",
		"view 1 breakline-clear=5 no-breaklines",
		"view 1 no-breaklines breakline-clear=5",
		"view 1 no-breaklines duplicates=highest",
		"view 1 max-error=-1",
		"view 1 max-error=-0",
		"view 1 max-error=00",
		"view 1 max-error=",
		"view 1 max-error=1.5",
		"view 1 max-error=8589934593",
		"view 1 max-error=5 max-points=5",
		"view 1 max-points=0",
		"view 1 max-error=5 every=3",
		"view 1 max-error=5 max-error=5",
		"view 1 thin=5",
		"view 1 thin=5m:lowest",
		"view 1 crop=box:3,0,0,3",
		"view 1 crop=box:0,0,3,3 crop=box:0,0,3,3",
		"view 1 crop=area:+AAAGGAAF", /* a box */
		"view 1 crop=area:+CAADFB",   /* does not start at its smallest corner */
		"view 1 not-class=2 class=3",
		"view 1 class=3 not-class=2",
		"view 1 ground drop-overlap keep-noise",
		"view 1 weight=2:0",
		"view 1 weight=3:1,2:1",
		"view 1 weight=2:1,2:1",
		"view 1 weight=2:01",
		"view 1 weight=02:1",
		"view 1 weight=2:1,",
		"view 1 weight=",
		"view 1 weight=2:1073741825",
		"view 1 weight=#1:0",
		"view 1 weight=#1:5,2:5",
		"view 1 weight=#1:5,#2:4",
		"view 1 weight=#1:5,#2:5",
		"view 1 weight=#1+2:5",
		"view 1 weight=#2+1:5",
		"view 1 weight=#1-1:5",
		"view 1 weight=#1:5,#1:6",
		"view 1 weight=@a.laz:5",
		"view 1 hidden",
		"view 1 hidden weight=2:5",
		"view 1 weight=2:5 hidden hidden",
		"view 1 window=box:0,0,1,1 weight=2:5 hidden",
		"ask 1 weight=2:5 hidden=1",
	};

	for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
		refused(bad[i], "metre", ERR_PROTO, "");
	refused("ask 1 zmin=x", "metre", ERR_USAGE, "--zmin");
	refused("ask 1 zmin=1.2345678901234567891", "metre", ERR_USAGE, "exactly");
	refused("ask 1 zmin=3 zmax=2", "metre", ERR_USAGE, "no height");
	refused("ask 1 crop=box:1,2,0,3", "metre", ERR_USAGE, "empty");
	refused("ask 1 crop=box:1,2,x,3", "metre", ERR_USAGE, "--crop");
	refused("ask 1 crop=area@30:+CC", "metre", ERR_USAGE, "too far");
	refused("ask 1 crop=area@0:+", "metre", ERR_USAGE, "no corners");
	refused("ask 1 class=2 not-class=2", "metre", ERR_USAGE, "no class");
	refused("ask 1 not-class=0-255", "metre", ERR_USAGE, "no class");
	refused("ask 1 crop=area@0:+", "metre", ERR_USAGE, "no corners");
	(void)state;
}

/* ---- codes ---- */

static void test_codes(void **state)
{
	static const char *const bad[] = {"", "?", "g", "gA", "ggA", "gggggggggggggggggggggggggI", "..........................A"};
	char buf[AREA_CODE_SIZE];

	for (unsigned run = 0; run < 100000; run++) {
		__int128 v = ((__int128)roll(UINT64_MAX) << 56 | (__int128)roll(UINT64_MAX)) >> roll(120), got;

		v = roll(2) ? v : -v;
		if (v > AREA_CODE_MOST || v < -AREA_CODE_MOST)
			continue;
		size_t n = area_code_put(v, buf);
		const char *at = buf;

		assert_true(n <= sizeof buf);
		assert_false(area_code_get(&at, buf + n - 1, &got));
		assert_ptr_equal(at, buf);
		assert_true(area_code_get(&at, buf + n, &got));
		assert_ptr_equal(at, buf + n);
		assert_true(got == v);
	}
	assert_int_equal(area_code_put(0, buf), 1);
	assert_int_equal(buf[0], 'A');
	assert_int_equal(area_code_put(-1, buf), 1);
	assert_int_equal(buf[0], 'B');
	assert_int_equal(area_code_put(16, buf), 2);
	assert_memory_equal(buf, "gB", 2);
	for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
		const char *at = bad[i];
		__int128 v;

		assert_false(area_code_get(&at, bad[i] + strlen(bad[i]), &v));
	}
	(void)state;
}

/* Any bytes after "area@E:" or "view 1 crop=area:" give a view that is written as it was read, or an error. */
static void test_any_area(void **state)
{
	static const char alphabet[] = "ABCDEFghijk019_.+-+-AB? ,";
	unsigned good = 0;

	for (unsigned run = 0; run < 60000; run++) {
		char text[80] = "view 1 crop=area:+";
		struct view v;
		struct err err = ERR_INIT;
		size_t n = strlen(text), len = roll(30);

		for (size_t i = 0; i < len; i++)
			text[n++] = alphabet[roll(roll(4) ? 14 : sizeof alphabet - 1)];
		text[n] = '\0';
		if (view_parse(text, &v, &err) == 0) {
			char *again = view_text(&v);

			assert_string_equal(again, text);
			free(again);
			view_done(&v);
			good++;
		}
		memcpy(text, "ask 1 crop=area@-1:+", 20);
		err_clear(&err);
		if (view_resolve(text, roll(2) ? &coarse : &odd, "metre", "foot", &v, &err) == 0) {
			char *again = view_text(&v);
			struct view w;

			assert_int_equal(view_parse(again, &w, &err), 0);
			assert_true(digest_equal(view_hash(&v), view_hash(&w)));
			view_done(&w);
			view_done(&v);
			free(again);
			good++;
		}
	}
	assert_true(good > 1000);
	(void)state;
}

/* ---- random requests, rounded by another method ---- */

/* floor(m * 10^e / scale + halves / 2) in long division: the numbers are small enough here. */
static long long floor_slow(long long m, int e, struct decimal scale, int halves)
{
	__int128 up = 2 * (__int128)m, down = 2 * (__int128)scale.mantissa, q;

	for (; e > scale.exponent; e--)
		up *= 10;
	for (; e < scale.exponent; e++)
		down *= 10;
	up += halves * (down / 2);
	q = up / down;
	while (q * down > up)
		q--;
	return (long long)q;
}

static long long round_slow(long long m, int e, struct decimal scale)
{
	return floor_slow(m, e, scale, 1);
}

static void put_decimal(FILE *f, long long m, int e)
{
	if (roll(2))
		fprintf(f, "%llde%d", m, e);
	else
		fprintf(f, "%s%lld.%0*llde%d", m < 0 ? "-" : "", llabs(m) / 100, 2, llabs(m) % 100, e + 2);
}

struct number {
	long long m;
	int e;
};

static struct number random_number(void)
{
	return (struct number){(long long)roll(2000000) - 1000000, (int)roll(7) - 5};
}

static void area_word(FILE *ask, FILE *want_rings, const struct lattice *l)
{
	/* One triangle: rounded corners, in the order that the canonical text has. */
	long long at[3][2], raw[3][2], swap[2], last[2] = {0, 0};
	int e = (int)roll(5) - 4;
	char code[AREA_CODE_SIZE];

	for (int i = 0; i < 3; i++)
		for (int k = 0; k < 2; k++) {
			raw[i][k] = (long long)roll(20000000) - 10000000;
			at[i][k] = round_slow(raw[i][k], e, l->scale_xy);
		}
	fprintf(ask, " crop=area@%d:+", e);
	for (int i = 0; i < 3; i++)
		for (int k = 0; k < 2; k++) {
			size_t n = area_code_put(raw[i][k] - last[k], code);

			fprintf(ask, "%.*s", (int)n, code);
			last[k] = raw[i][k];
		}
	for (int i = 0; i < 2; i++)
		for (int j = 0; j < 2; j++)
			if (at[j][0] > at[j + 1][0] || (at[j][0] == at[j + 1][0] && at[j][1] > at[j + 1][1])) {
				memcpy(swap, at[j], sizeof swap);
				memcpy(at[j], at[j + 1], sizeof swap);
				memcpy(at[j + 1], swap, sizeof swap);
			}
	last[0] = last[1] = 0;
	fprintf(want_rings, " crop=area:+");
	for (int i = 0; i < 3; i++)
		for (int k = 0; k < 2; k++) {
			size_t n = area_code_put(at[i][k] - last[k], code);

			fprintf(want_rings, "%.*s", (int)n, code);
			last[k] = at[i][k];
		}
}

static void test_random(void **state)
{
	for (unsigned run = 0; run < 20000; run++) {
		const struct lattice *l = run % 3 == 0 ? &fine : run % 3 == 1 ? &coarse : &odd;
		char *asked, *wanted;
		size_t n;
		FILE *a = open_memstream(&asked, &n), *w = open_memstream(&wanted, &n);
		struct number z = random_number(), box[4];
		long long low = round_slow(z.m, z.e, l->scale_z);

		fputs("ask 1", a);
		fputs("view 1", w);
		if (roll(2)) {
			fputs(" zmin=", a);
			put_decimal(a, z.m, z.e);
			fprintf(w, " zmin=%lld", low);
		}
		if (roll(2)) {
			long long cell = 1 + (long long)roll(1000);

			fprintf(a, " thin=%llde1:median", cell);
			area_word(a, w, l);
			fprintf(w, " thin=%lld:median", round_slow(cell, 1, l->scale_xy));
		} else {
			for (int i = 0; i < 4; i++)
				box[i] = random_number();
			for (int i = 0; i < 2; i++) {
				box[i].m = -llabs(box[i].m);
				box[2 + i].m = llabs(box[2 + i].m);
			}
			fputs(" crop=box:", a);
			fputs(" crop=box:", w);
			for (int i = 0; i < 4; i++) {
				put_decimal(a, box[i].m, box[i].e);
				fprintf(w, "%lld", round_slow(box[i].m, box[i].e, l->scale_xy));
				fputs(i < 3 ? "," : "", a);
				fputs(i < 3 ? "," : "", w);
			}
		}
		if (roll(2)) {
			z = random_number();
			z.m = llabs(z.m) / 10;
			if (!floor_slow(z.m, z.e, l->scale_z, 0)) /* is refused */
				z.m = 0;
			fputs(" max-error=", a);
			put_decimal(a, z.m, z.e);
			fprintf(w, " max-error=%lld", floor_slow(z.m, z.e, l->scale_z, 0));
		}
		fclose(a);
		fclose(w);
		becomes(asked, l, "metre", wanted);
		free(asked);
		free(wanted);
	}
	(void)state;
}

/* More corners than fit a text, and the largest number that fits. */
static void test_long(void **state)
{
	for (unsigned corners = 3000; corners <= 60000; corners += 57000) {
		char *asked;
		size_t n;
		FILE *f = open_memstream(&asked, &n);
		struct view v;
		struct err err = ERR_INIT;

		/* Steps of one metre take one character in the request, and two in the lattice. */
		fputs("ask 1 crop=area@0:+", f);
		for (unsigned i = 0; i < corners / 3; i++)
			fputs(i % 2 ? "CD" : "CE", f);
		fclose(f);
		int r = view_resolve(asked, &fine, "metre", "metre", &v, &err);

		if (corners == 3000) {
			assert_int_equal(r, 0);
			assert_int_equal(v.crop, VIEW_CROP_AREA);
			view_done(&v);
		} else {
			assert_int_equal(r, -ERR_LIMIT);
			assert_non_null(strstr(err.message, "20000 corners"));
			assert_non_null(strstr(err.hint, "simplify"));
		}
		free(asked);
	}
	/* A request that is too long to be read. */
	char *many = malloc(VIEW_TEXT_MAX + 100);
	struct view v;
	struct err err = ERR_INIT;

	assert_non_null(many);
	strcpy(many, "ask 1 weight=2:1");
	for (size_t n = strlen(many); n < VIEW_TEXT_MAX + 20; n += 4)
		strcpy(many + n, ",2:1");
	assert_int_equal(view_resolve(many, &fine, "metre", "metre", &v, &err), -ERR_LIMIT);
	assert_non_null(strstr(err.message, "too long"));
	free(many);
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_words),           cmocka_unit_test(test_rows),    cmocka_unit_test(test_window),
		cmocka_unit_test(test_lengths),         cmocka_unit_test(test_bounds),  cmocka_unit_test(test_bounds),
		cmocka_unit_test(test_lengths_refused), cmocka_unit_test(test_refused), cmocka_unit_test(test_codes),
		cmocka_unit_test(test_any_area),        cmocka_unit_test(test_random),  cmocka_unit_test(test_long),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
