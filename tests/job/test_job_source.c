/* Names of files in the weights of a request: what they mean, and that no text of a client does more than fail. */
#include <fnmatch.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "err.h"
#include "job_priv.h"
#include "random.h"
#include "repeat.h"

/* In no order of their numbers. 9 is gone in generation 2, 12 comes with it. */
static struct grid_source files[] = {
	{.id = 7, .added = 1, .name = "b.laz", .path = "/data/2024/b.laz"},
	{.id = 6, .added = 1, .name = "a.laz", .path = "/data/2024/a.laz"},
	{.id = 2, .added = 1, .name = "a.laz", .path = "/data/2019/a.laz"},
	{.id = 3, .added = 1, .name = "x,y z.laz", .path = "/data/2019/deep/x,y z.laz"},
	{.id = 9, .added = 1, .removed = 2, .name = "old.laz", .path = "/data/old.laz"},
	{.id = 10, .added = 1, .name = "-", .path = ""},
	{.id = 11, .added = 1, .name = "roads.shp", .path = "/data/roads.shp", .kind = GRID_LINES},
	{.id = 12, .added = 2, .name = "[7].laz", .path = "/data/[7].laz"},
};
static const struct grid_manifest manifest = {.generation = 2, .sources = files, .nsources = sizeof files / sizeof *files};

static void becomes(const char *items, bool paths, const char *want)
{
	char text[600], whole[600], *got = NULL;
	struct err err = ERR_INIT;

	snprintf(text, sizeof text, "ask 1 ground weight=%s zmin=3", items);
	snprintf(whole, sizeof whole, "ask 1 ground weight=%s zmin=3", want);
	assert_true(job_names_files(text));
	if (job_sources(text, &manifest, 2, paths, NULL, &got, &err))
		fail_msg("%s: %s", items, err.message);
	assert_string_equal(got, whole);
	assert_false(job_names_files(got));
	free(got);
}

static void refused(const char *items, uint64_t generation, bool paths, enum err_code code, const char *said)
{
	struct err err = ERR_INIT;
	char text[600], all[2000], *got = NULL;

	snprintf(text, sizeof text, "ask 1 weight=%s", items);
	assert_int_equal(job_sources(text, &manifest, generation, paths, NULL, &got, &err), -(int)code);
	assert_null(got);
	snprintf(all, sizeof all, "%s; %s", err.message, err.hint);
	if (!strstr(all, said))
		fail_msg("%s: %s", items, all);
}

static void test_names(void **state)
{
	becomes("@b.laz:5", true, "#7:5");
	becomes("@a.laz:5", true, "#2+6:5");
	becomes("@2024/a.laz:5m", true, "#6:5m");
	becomes("@/data/2024/a.laz:5", true, "#6:5");
	becomes("@./2019/a.laz:5", true, "#2:5");
	becomes("@*.laz:5", true, "#2-3+6-7+12:5");
	becomes("@2024/*:5,2:1,@?.laz:5", true, "#6-7:5,2:1,#2:5");
	becomes("@2019/:5", true, "#2-3:5");
	becomes("@/data/:5", true, "#2-3+6-7+12:5");
	becomes("@20*/:5", true, "#2-3+6-7:5");
	becomes("@deep/:5", true, "#3:5");
	becomes("@x%2Cy%20z.laz:5", true, "#3:5");
	becomes("@x?y?z.laz:5", true, "#3:5");
	becomes("@[7].laz:5", true, "#12:5");
	becomes("@-:5", true, "#10:5");
	becomes("@[!b].laz:5,7:1", true, "#2+6:5,7:1");
	becomes("@a.laz:5", false, "#2+6:5");
	/* What earlier names mean, too, is left out. */
	becomes("@a.laz:5,@2024/a.laz:5,@2019/a.laz:5,3:1", true, "#2+6:5,3:1");
	becomes("@a.laz:1m,@2019/:1.00m,@b.laz:2", true, "#2+6:1m,#3:1.00m,#7:2");
	becomes("@a.laz:50,@2024/a.laz:5e1", true, "#2+6:50");
	becomes("@a.laz:1ft,@2024/a.laz:0.3048m", true, "#2+6:1ft");
	becomes("@a.laz:3937ftUS,@2024/a.laz:1.2e3m", true, "#2+6:3937ftUS");
	becomes("@a.laz:0ft,@2024/a.laz:0.0m", true, "#2+6:0ft");
	becomes("@a.laz:5,,@b.laz:5,", true, "#2+6:5,,#7:5,");
	(void)state;
}

/* Against fnmatch, which takes too long for many stars. */
static void test_patterns(void **state)
{
	static const char *const letter[] = {"a", "b", "*", "?", "/", "[ab]", "[!a]", "[a-b]", "[", "a", "b"};
	char stars[201] = "", many[201];
	uint64_t seed = 3, hits = 0;

	for (uint64_t i = 0; i < 300000; i++) {
		struct grid_source one = {.id = 1, .added = 1, .name = "", .path = ""};
		const struct grid_manifest m = {.generation = 1, .sources = &one, .nsources = 1};
		char pattern[64] = "", path[16] = "", text[200], *got = NULL;
		struct err err = ERR_INIT;
		bool want;

		for (unsigned k = 1 + (unsigned)random_below(&seed, 7); k > 0; k--)
			strcat(pattern, letter[random_below(&seed, sizeof letter / sizeof *letter)]);
		for (unsigned k = 1 + (unsigned)random_below(&seed, 6); k > 0; k--)
			strcat(path, random_below(&seed, 8) ? random_below(&seed, 2) ? "a" : "b" : "/");
		if (pattern[strlen(pattern) - 1] == '/' && pattern[1])
			continue;
		one.name = path;
		snprintf(text, sizeof text, "ask 1 weight=@%s:1", pattern);
		want = !fnmatch(pattern, path, FNM_PATHNAME);
		if ((job_sources(text, &m, 1, false, NULL, &got, &err) == 0) != want)
			fail_msg("%s, %s: not %d", pattern, path, want);
		free(got);
		hits += want;
	}
	assert_true(hits > 10000);
	for (unsigned i = 0; i < 200; i += 2)
		memcpy(stars + i, "*a", 3);
	memset(many, 'a', 200);
	many[200] = 0;
	struct grid_source one = {.id = 1, .added = 1, .name = many, .path = many};
	const struct grid_manifest m = {.generation = 1, .sources = &one, .nsources = 1};
	char text[300], *got = NULL;
	struct err err = ERR_INIT;

	snprintf(text, sizeof text, "ask 1 weight=@%s:1", stars);
	assert_int_equal(job_sources(text, &m, 1, true, NULL, &got, &err), 0);
	free(got);
	got = NULL;
	snprintf(text, sizeof text, "ask 1 weight=@%sb:1", stars);
	assert_int_equal(job_sources(text, &m, 1, true, NULL, &got, &err), -ERR_NOTFOUND);
	(void)state;
}

static void test_refused(void **state)
{
	refused("@c.laz:5", 2, true, ERR_NOTFOUND, "b.laz, a.laz");
	refused("@old.laz:5", 2, true, ERR_NOTFOUND, "other generations");
	refused("@%5B7%5D.laz:5", 1, true, ERR_NOTFOUND, "other generations");
	refused("@roads.shp:5", 2, true, ERR_NOTFOUND, "has lines");
	/* Who may not see paths learns nothing of them. */
	refused("@2024/a.laz:5", 2, false, ERR_NOTFOUND, "nearest");
	refused("@2019/:5", 2, false, ERR_NOTFOUND, "nearest");
	refused("@data:5", 2, true, ERR_NOTFOUND, "nearest");
	refused("@4/a.laz:5", 2, true, ERR_NOTFOUND, "nearest");
	refused("@/2024/a.laz:5", 2, true, ERR_NOTFOUND, "nearest");
	refused("@2024*a.laz:5", 2, true, ERR_NOTFOUND, "nearest");
	refused("@/:5", 2, true, ERR_NOTFOUND, "nearest");
	refused("@a.laz:5,@2019/:6", 2, true, ERR_USAGE, "two radii");
	refused("@a.laz:5,@2019/:5m", 2, true, ERR_USAGE, "two radii");
	refused("@a.laz:5m,@2019/:5ft", 2, true, ERR_USAGE, "two radii");
	refused("@a.laz:5x,@2019/:50x", 2, true, ERR_USAGE, "two radii");
	refused("@:5", 2, true, ERR_PROTO, "name of a file");
	refused("@a.laz", 2, true, ERR_PROTO, "name of a file");
	refused("@a%4:5", 2, true, ERR_PROTO, "name of a file");
	refused("@a%00:5", 2, true, ERR_PROTO, "name of a file");
	refused("@a%zz:5", 2, true, ERR_PROTO, "name of a file");
	(void)state;
}

/* A request of many names is no more text than the sources have numbers, and takes no more memory than it says. */
static void test_many(void **state)
{
	enum { FILES = 6000, ITEMS = 1000, MORE = 20001 };
	struct grid_source *s = calloc(MORE, sizeof *s);
	struct grid_manifest m = {.generation = 1, .sources = s, .nsources = FILES};
	const atomic_bool left = true;
	char *text = malloc(12 * ITEMS + 100), *got = NULL, *end;
	struct err err = ERR_INIT;

	assert_true(s && text);
	for (uint32_t i = 0; i < MORE; i++)
		s[i] = (struct grid_source){.id = 2 * i + 1, .added = 1, .name = "a.laz", .path = ""};
	end = stpcpy(text, "ask 1 weight=@a*:1");
	for (unsigned i = 1; i < ITEMS; i++)
		end = stpcpy(end, ",@*a*:1");
	assert_int_equal(job_sources(text, &m, 1, true, NULL, &got, &err), 0);
	assert_true(strlen(got) < 6 * FILES && !strchr(got, ','));
	free(got);
	got = NULL;
	strcpy(end, ",@a.laz:1");
	assert_int_equal(job_sources(text, &m, 1, true, NULL, &got, &err), -ERR_LIMIT);
	assert_non_null(strstr(err.message, "1000"));
	assert_null(got);
	/* Numbers that are longer than a view. */
	for (uint32_t i = 0; i < FILES; i++)
		s[i].id = UINT32_MAX - 2 * i;
	err = ERR_INIT;
	assert_int_equal(job_sources("ask 1 weight=@a*:1", &m, 1, true, NULL, &got, &err), -ERR_LIMIT);
	assert_non_null(strstr(err.hint, "push files"));
	assert_null(got);
	/* Many names of many files take long: more than so many comparisons are refused, and a client may leave. */
	for (uint32_t i = 0; i < MORE; i++)
		s[i].id = 1 + i;
	m.nsources = MORE;
	*end = '\0';
	err = ERR_INIT;
	assert_int_equal(job_sources(text, &m, 1, true, NULL, &got, &err), -ERR_LIMIT);
	assert_non_null(strstr(err.message, "20001"));
	err = ERR_INIT;
	assert_int_equal(job_sources("ask 1 weight=@a*:1", &m, 1, true, &left, &got, &err), -ERR_CANCELLED);
	assert_null(got);
	free(text);
	text = malloc(VIEW_TEXT_MAX + 100);
	assert_non_null(text);
	memset(text, 'a', VIEW_TEXT_MAX + 99);
	text[VIEW_TEXT_MAX + 99] = 0;
	memcpy(text, "ask 1 weight=@", 14);
	err = ERR_INIT;
	assert_int_equal(job_sources(text, &m, 1, true, NULL, &got, &err), -ERR_LIMIT);
	free(text);
	free(s);
	(void)state;
}

/* Texts of parts that mean something. */
static void test_anything(void **state)
{
	static const char *const part[] = {"@", ":", ",",  "%",     "%2",   "%41", "/", "*",       "[",
					   "]", "?", "./", "a.laz", "2024", "5",   " ", "weight=", "#1"};
	uint64_t seed = repeat_first() + 5;

	for (uint64_t i = 0, n = repeat_cases(40000); i < n; i++) {
		struct err err = ERR_INIT;
		char text[800] = "ask 1 weight=", *got = NULL;
		int r;

		for (unsigned k = (unsigned)random_below(&seed, 30); k > 0; k--)
			strcat(text, part[random_below(&seed, sizeof part / sizeof *part)]);
		if (!job_names_files(text))
			continue;
		r = job_sources(text, &manifest, 1 + random_below(&seed, 2), random_below(&seed, 2), NULL, &got, &err);
		assert_true(r == 0 ? got && !err.code : !got && err.code == (unsigned)-r && err.message[0]);
		free(got);
	}
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_names), cmocka_unit_test(test_patterns),
					   cmocka_unit_test(test_refused), cmocka_unit_test(test_many),
					   cmocka_unit_test(test_anything)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
