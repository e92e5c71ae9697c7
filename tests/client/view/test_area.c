/*
 * Files of areas: what is read is what was written, corner by corner, in every form that is taken; and texts
 * damaged at random give an area or an error with its reason, never a crash. What is read goes through the
 * request into a view.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cmocka.h>

#include "err.h"
#include "ctl_area.h"
#include "json_reader.h"
#include "lattice.h"
#include "view.h"
#include "view_area.h"

typedef int read_fn(const char *text, size_t size, struct ctl_area *, struct err *);

static const struct lattice lattice = {.scale_xy = {1, -2}, .scale_z = {1, -3}, .k = {0, 0, 0}};

static uint64_t seed = 3;

static uint64_t roll(uint64_t n)
{
	seed ^= seed << 13;
	seed ^= seed >> 7;
	seed ^= seed << 17;
	return seed % n;
}

static int read_text(const char *text, struct ctl_area *a, struct err *err)
{
	static struct json_reader json;

	*a = (struct ctl_area){0};
	text_source_memory(&json.source, text, strlen(text), err);
	text_source_skip_mark(&json.source);
	return json_reader_peek(&json) == '{' ? ctl_area_json(&json, a, err) : ctl_area_wkt(&json.source, a, err);
}

/* The request of an area, NULL if it cannot be written. */
static char *request_of(const struct ctl_area *a, struct err *err)
{
	char *text;
	size_t n;
	FILE *out = open_memstream(&text, &n);
	int r;

	fputs("ask 1 crop=", out);
	r = ctl_area_print(a, out, err);
	fclose(out);
	if (!r)
		return text;
	free(text);
	return NULL;
}

static void test_forms(void **state)
{
	static const char *const same[] = {
		"POLYGON ((0 0, 10.5 0, 10.5 10.25, 0 0), (7 1, 9 1, 9 2, 7 1))",
		"polygon((0 0,1.05e1 0,10.5 10.250,0.00 0e3),(7 1,9 1,9 2,7.0 10e-1))",
		"\xef\xbb\xbfPOLYGON Z ((0 0 5, 10.5 0 5, 10.5 10.25 -5, 0 0 5), (7 1 0, 9 1 0, 9 2 0, 7 1 0))",
		"POLYGONZM ((0 0 5 6, 10.5 0 5 6, 10.5 10.25 5 6), (7 1 0 0, 9 1 0 0, 9 2 0 0));\n",
		"MULTIPOLYGON M (((0 0 1, 10.5 0 1, 10.5 10.25 1), (7 1 1, 9 1 1, 9 2 1)))",
		"\n POLYGON EMPTY\tMULTIPOLYGON EMPTY; POLYGON ((+0 -0, 10.5 0,\r\n10.5 10.25, 0 0), (7 1, 9 1, 9 2, 7 1)) ",
		"{\"type\":\"Polygon\",\"coordinates\":[[[0,0],[10.5,0],[10.5,10.25],[0,0]],[[7,1],[9,1],[9,2],[7,1]]]}",
		"{\"coordinates\":[[[[0,0,9],[10.50,0],[1.05e1,10.25]],[[7,1],[9,1],[9,2]]]],\"type\":\"MultiPolygon\"}",
		"{\"type\":\"Feature\",\"properties\":{\"type\":\"Point\"},\"geometry\":{\"type\":\"GeometryCollection\","
		"\"geometries\":[{\"type\":\"Polygon\",\"coordinates\":[[[0,0],[10.5,0],[10.5,10.25],[0,0]],[[7,1],[9,1],[9,2]]]}]}}",
	};
	char *first = NULL;

	for (size_t i = 0; i < sizeof(same) / sizeof(*same); i++) {
		struct err err = ERR_INIT;
		struct ctl_area a;
		char *request;

		if (read_text(same[i], &a, &err))
			print_error("%s: %s\n", same[i], err.message);
		assert_int_equal(err.code, 0);
		((unsigned char *)&a.corner[0][0])[sizeof(struct decimal) - 1] ^= 0x55; /* behind its members: means nothing */
		request = request_of(&a, &err);
		if (!first)
			first = strdup(request);
		assert_string_equal(request, first);
		free(request);
		ctl_area_done(&a);
	}
	/* Written by a few lines of Python after protocol.md. */
	assert_string_equal(first, "ask 1 crop=area@-2:+AA0hCAAigC-7V55BwMAAoG");
	free(first);
}

/* Digits of both kinds of numbers are kept as they stood. */
static void test_exact(void **state)
{
	static const char *const numbers[] = {"635000.2500000001",
					      "0.30000000000000004",
					      "123456789012345678",
					      "-1e-12",
					      "9007199254740993",
					      "1E3",
					      "-0",
					      "0.1e+2"};

	for (size_t i = 0; i < sizeof(numbers) / sizeof(*numbers); i++) {
		char json[200], wkt[200];
		struct err err = ERR_INIT;
		struct ctl_area a, b;
		struct decimal want;

		snprintf(json, sizeof(json), "{\"type\":\"Polygon\",\"coordinates\":[[[%s,0],[1,1],[2,%s]]]}", numbers[i],
			 numbers[i]);
		snprintf(wkt, sizeof(wkt), "POLYGON((%s 0,1 1,2 %s))", numbers[i], numbers[i]);
		assert_true(decimal_parse(numbers[i], &want));
		assert_int_equal(read_text(json, &a, &err), 0);
		assert_int_equal(read_text(wkt, &b, &err), 0);
		assert_int_equal(decimal_compare(a.corner[0][0], want), 0);
		assert_int_equal(decimal_compare(a.corner[2][1], want), 0);
		assert_int_equal(decimal_compare(b.corner[0][0], want), 0);
		assert_int_equal(decimal_compare(b.corner[2][1], want), 0);
		ctl_area_done(&a);
		ctl_area_done(&b);
	}
}

static void test_damaged(void **state)
{
	static const char *const good[] = {
		"MULTIPOLYGON (((0 0, 10.5 0, 10.5 10.25, 0 0), (7 1, 9 1, 9 2, 7 1)), ((20 20, 30 20, 30 30)))",
		"{\"type\":\"FeatureCollection\",\"features\":[{\"type\":\"Feature\",\"geometry\":{\"type\":\"Polygon\","
		"\"coordinates\":[[[0,0],[10.5,0],[10.5,10.25],[0,0]]]}},{\"type\":\"Feature\",\"geometry\":null}]}",
	};
	static const char bytes[] = "(){}[],.0123456789eE+-\" \n:;PNZnul\\\x80\xff";
	unsigned read = 0, views = 0;

	for (unsigned run = 0; run < 40000; run++) {
		char text[400];
		struct ctl_area a;
		struct err err = ERR_INIT;
		size_t n;

		strcpy(text, good[run % 2]);
		n = strlen(text);
		for (uint64_t times = 1 + roll(4); times; times--) {
			size_t at = roll(n), from = roll(n), len = roll(12);

			if (roll(6) == 0)
				text[n = at ? at : 1] = '\0';
			else if (roll(3) == 0 && at + len <= n && from + len <= n)
				memmove(text + at, text + from, len);
			else
				text[at] = bytes[roll(sizeof(bytes) - 1)];
		}
		if (read_text(text, &a, &err)) {
			assert_true(err.code == ERR_INPUT && *err.message);
		} else if (a.ncorner) {
			char *request = request_of(&a, &err);
			struct view v;

			read++;
			if (request && view_resolve(request, &lattice, "metre", "metre", &v, &err) == 0) {
				views++;
				view_done(&v);
			}
			assert_true(err.code == 0 || err.code == ERR_INPUT || err.code == ERR_USAGE);
			free(request);
		}
		ctl_area_done(&a);
	}
	print_message("%u of 40000 were areas, %u views\n", read, views);
	assert_true(read > 1000 && views > 500);
}

/* Members in any order, others between them, and what JSON does not have. */
static void test_json(void **state)
{
	static const struct {
		const char *text, *said; /* NULL: it is an area of three corners */
	} rows[] = {
		{"{\"coordinates\":[[[0,0],[1,0,[],{}],[0,1]]],\"bbox\":[0,0,1,1],\"type\":\"Polygon\"}", NULL},
		{"{\"features\":[{\"geometry\":{\"geometries\":[{\"coordinates\":[[[0,0],[1,0],[0,1]]],\"type\":\"Polygon\"}],"
		 "\"type\":\"GeometryCollection\"},\"id\":1,\"type\":\"Feature\"},{\"geometry\":null,\"type\":\"Feature\"}],"
		 "\"type\":\"FeatureCollection\"} \n",
		 NULL},
		{"{\"type\":\"\\u0050olygon\",\"coordinates\":[[[0,0],[1,0],[0,1]]],\"geometries\":[1,2]}", NULL},
		{"{\"type\":\"Polygon\",\"coordinates\":[[[0,0],[1,0],[0,1]]]} x", "something follows"},
		{"{\"type\":\"Polygon\",\"coordinates\":[[[0,0],[1,0],[0,1],]]}", "not a list"},
		{"{\"type\":\"Polygon\",\"coordinates\":[[[0,0],[01,0],[0,1]]]}", "not a number"},
		{"{\"type\":\"Polygon\",\"coordinates\":[[[0,0],[+1,0],[0,1]]]}", "not a number"},
		{"{\"type\":\"Polygon\",\"coordinates\":[[[0,0],[.1,0],[0,1]]]}", "not a number"},
		{"{\"type\":\"Polygon\",\"coordinates\":[[[0,0],[null,0],[0,1]]]}", "not a number"},
		{"{\"type\":\"Polygon\",\"coordinates\":[[[0,0],[1,0],[0,1]]],\"coordinates\":[]}", "twice"},
		{"{\"type\":\"Polygon\",\"type\":\"Polygon\"}", "two types"},
		{"{\"coordinates\":[[[0,0],[1,0],[0,1]]]}", "no type"},
		{"{\"type\":\"Feature\",\"coordinates\":[[[0,0],[1,0],[0,1]]]}", "no geometry"},
		{"{\"crs\":{\"properties\":{\"name\":\"EPSG:1\"}},\"type\":\"Feature\",\"geometry\":"
		 "{\"type\":\"Polygon\",\"crs\":{\"properties\":{\"name\":\"EPSG:2\"}},\"coordinates\":[]}}",
		 "two coordinate systems"},
	};

	for (size_t i = 0; i < sizeof(rows) / sizeof(*rows); i++) {
		struct err err = ERR_INIT;
		struct ctl_area a;
		int rc = read_text(rows[i].text, &a, &err);

		if (!rows[i].said != !rc || (rc && !strstr(err.message, rows[i].said)))
			fail_msg("%s: %s", rows[i].text, rc ? err.message : "read");
		assert_true(rc || (a.nring == 1 && a.ncorner == 3));
		ctl_area_done(&a);
	}
}

/* Collections in each other, each with its type last, so that all of it is read again and again: by depth, not by its power. Too
 * deep a nest is refused. */
static void test_nested(void **state)
{
	for (int depth = 14; depth < 100; depth += 80) {
		char text[8192] = "";
		struct err err = ERR_INIT;
		struct ctl_area a;

		for (int i = 0; i < depth; i++)
			strcat(text, depth < 50 ? "{\"geometries\":[" : "{\"type\":\"GeometryCollection\",\"geometries\":[");
		strcat(text, "{\"coordinates\":[[[0,0],[1,0],[0,1]]],\"type\":\"Polygon\"}");
		for (int i = 0; i < depth; i++)
			strcat(text, depth < 50 ? "],\"type\":\"GeometryCollection\"}" : "]}");
		assert_int_equal(read_text(text, &a, &err), depth < 50 ? 0 : -ERR_INPUT);
		assert_int_equal(a.ncorner, depth < 50 ? 3 : 0);
		ctl_area_done(&a);
	}
}

/* A file is read through a buffer: its corners are held, and nothing else of it. */
static void test_memory(void **state)
{
	enum { CORNERS = 500000, MOST_KIB = 48 << 10 };
	static const char *const forms[][3] = {{"{\"type\":\"Polygon\",\"coordinates\":[[", "%s[%d.125,%d.25]", "]]}"},
					       {"POLYGON((", "%s%d.125 %d.25", "))"}};

	for (int k = 0; k < 2; k++) {
		char name[] = "/tmp/test_area_XXXXXX";
		FILE *f = fdopen(mkstemp(name), "w");
		pid_t child;
		int status;

		fputs(forms[k][0], f);
		for (int i = 0; i < CORNERS; i++)
			fprintf(f, forms[k][1], i ? "," : "", 500000 + i % 1000, 5400000 + i / 1000);
		fputs(forms[k][2], f);
		assert_int_equal(fclose(f), 0);
		child = fork();
		if (!child) {
			struct rusage before, after;
			struct err err = ERR_INIT;
			struct ctl_area a;
			bool good;

			getrusage(RUSAGE_SELF, &before);
			good = !ctl_area_read(name, &a, &err) && a.ncorner == CORNERS;
			getrusage(RUSAGE_SELF, &after);
			print_message("%ld KiB\n", after.ru_maxrss - before.ru_maxrss);
			_exit(!good || after.ru_maxrss - before.ru_maxrss > MOST_KIB);
		}
		assert_int_equal(waitpid(child, &status, 0), child);
		unlink(name);
		assert_int_equal(status, 0);
	}
}

/* Features, their first rings and names: "RING:NAME ...". */
static void names_are(const char *text, const char *want)
{
	struct ctl_area a;
	struct err err = ERR_INIT;
	char name[] = "/tmp/acut-names-XXXXXX", got[4096] = "";
	int fd = mkstemp(name);

	assert_true(fd >= 0 && write(fd, text, strlen(text)) == (ssize_t)strlen(text));
	close(fd);
	assert_int_equal(ctl_area_read_named(name, "name", &a, &err), 0);
	unlink(name);
	for (size_t i = 0; i < a.nfeature; i++)
		snprintf(got + strlen(got), sizeof(got) - strlen(got), "%s%zu:%s", i ? " " : "", a.feature[i].ring,
			 ctl_area_name(&a, i));
	assert_string_equal(got, want);
	ctl_area_done(&a);
}

static void test_names(void **state)
{
	static const char square[] = "{\"type\":\"Polygon\",\"coordinates\":[[[0,0],[1,0],[1,1]],[[0,0],[1,0],[1,1]]]}";
	char text[2048];

	names_are("POLYGON((0 0,1 0,1 1)); MULTIPOLYGON(((0 0,1 0,1 1)),((5 0,6 0,6 1)))POLYGON((0 0,1 0,1 1))", "0: 1: 3:");
	names_are(square, "0:");
	/* The name before and behind the geometry, a number, none, one that is no name, and in an object of a property. */
	snprintf(text, sizeof(text),
		 "{\"features\":[{\"properties\":{\"name\":\"a b\"},\"type\":\"Feature\",\"geometry\":%s},"
		 "{\"type\":\"Feature\",\"geometry\":%s,\"properties\":{\"x\":{\"name\":\"no\"},\"name\":-12.5}},"
		 "{\"type\":\"Feature\",\"geometry\":%s,\"properties\":null},"
		 "{\"geometry\":%s,\"properties\":{\"name\":[1]},\"type\":\"Feature\"},"
		 "{\"type\":\"Feature\",\"geometry\":null,\"properties\":{\"name\":\"nowhere\"}},"
		 "{\"type\":\"Feature\",\"geometry\":%s,\"properties\":{\"name\":\"last\"}}],\"type\":\"FeatureCollection\"}",
		 square, square, square, square, square);
	names_are(text, "0:a b 2:-12.5 4: 6: 8:nowhere 8:last");
	/* A collection in a feature is one, a bare one has its members. */
	snprintf(text, sizeof(text), "{\"type\":\"GeometryCollection\",\"geometries\":[%s,%s]}", square, square);
	names_are(text, "0: 2:");
	snprintf(text, sizeof(text),
		 "{\"type\":\"Feature\",\"geometry\":{\"type\":\"GeometryCollection\",\"geometries\":[%s,%s]},"
		 "\"properties\":{\"name\":\"both\"}}",
		 square, square);
	names_are(text, "0:both");
}

/* Names keep all of their characters; one that is too long ends with a mark, at a character. */
static void test_long_names(void **state)
{
	static const char square[] = "{\"type\":\"Polygon\",\"coordinates\":[[[0,0],[1,0],[1,1]]]}";
	static const struct {
		const char *unit;
		size_t times, kept; /* kept: of them; 0: all */
		const char *before;
	} rows[] = {
		{"\u00e9", 100, 0, ""},     {"\u00e9", 512, 0, ""},    {"\u00e9", 513, 510, ""},  {"a", 1024, 0, ""},
		{"a", 1025, 1021, ""},      {"\u20ac", 341, 0, "b"},   {"\u20ac", 342, 340, ""},  {"\U0001f600", 300, 255, ""},
		{"\U0001f600", 256, 0, ""}, {"\u00e9", 5000, 510, ""}, {"\u20ac", 400, 340, "b"},
	};

	for (size_t i = 0; i < sizeof(rows) / sizeof(*rows); i++) {
		char name[16384], text[32768], want[16384];
		size_t n = (size_t)sprintf(name, "%s", rows[i].before), kept = rows[i].kept ? rows[i].kept : rows[i].times;

		for (size_t k = 0; k < rows[i].times; k++)
			n += (size_t)sprintf(name + n, "%s", rows[i].unit);
		snprintf(text, sizeof(text), "{\"type\":\"Feature\",\"properties\":{\"name\":\"%s\"},\"geometry\":%s}", name,
			 square);
		n = (size_t)sprintf(want, "0:%s", rows[i].before);
		for (size_t k = 0; k < kept; k++)
			n += (size_t)sprintf(want + n, "%s", rows[i].unit);
		sprintf(want + n, "%s", rows[i].kept ? CTL_AREA_CUT : "");
		names_are(text, want);
	}
	/* A zero in a text does not end it. */
	names_are("{\"type\":\"Feature\",\"properties\":{\"name\":\"a\\u0000b\"},\"geometry\":"
		  "{\"type\":\"Polygon\",\"coordinates\":[[[0,0],[1,0],[1,1]]]}}",
		  "0:a\ufffdb");
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_names),   cmocka_unit_test(test_long_names),
					   cmocka_unit_test(test_forms),   cmocka_unit_test(test_exact),
					   cmocka_unit_test(test_damaged), cmocka_unit_test(test_json),
					   cmocka_unit_test(test_nested),  cmocka_unit_test(test_memory)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
