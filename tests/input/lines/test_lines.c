/* Texts of lines: what must come out of them, and what is refused, with its row and what to do. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "fixture.h"
#include "input_reader.h"

#define HEAD "acut-lines 1\n"
#define FEATURE HEAD "feature 7 hard\nline\n"

enum { MOST = 16, F = INPUT_FEATURE_BEGINS, L = INPUT_LINE_BEGINS, R = INPUT_IN_RING };

struct vertex {
	int64_t raw[3];
	struct input_vertex of;
};

static void read_text(const char *text, size_t batch, struct vertex *ret, size_t *ret_n, struct input_info *ret_info,
		      char *ret_wkt)
{
	const struct input_options options = {.degrees = true};
	int fd = fixture_fd(text, strlen(text));
	struct input_vertex vertex[MOST];
	struct err err = ERR_INIT;
	struct input_points pts;
	struct input *in = NULL;

	if (input_open(fd, "a.txt", &options, &in, &err))
		fail_msg("%s: %s", text, err.message);
	fixture_points_new(&pts, batch);
	pts.vertex = vertex;
	for (*ret_n = 0;; *ret_n += pts.n) {
		assert_int_equal(input_read(in, &pts, &err), 0);
		assert_true(*ret_n + pts.n <= MOST);
		for (size_t i = 0; i < pts.n; i++) {
			assert_true(!pts.cls[i] && !pts.flags[i] && pts.ret[i] == 0x11);
			memcpy(ret[*ret_n + i].raw, pts.raw[i], sizeof pts.raw[i]);
			ret[*ret_n + i].of = vertex[i];
		}
		if (!pts.n)
			break;
	}
	*ret_info = *input_info(in);
	snprintf(ret_wkt, 64, "%s", input_wkt(in));
	fixture_points_free(&pts);
	input_close(in);
	close(fd);
}

static void vertices(void **state)
{
	static const char text[] = "\xef\xbb\xbf"
				   "acut-lines 1\r\n\n# made by hand\nfeature 17 hard\nline\n1.25 2 3.5\n\t-4  5.5\t6 \r\n"
				   "#\nring\n0 0 1\n9 0 1\n9 9 1\nfeature 4294967295 lake\n ring\n1e1 0 2\n+11 0 2\n11.00 1 2";
	static const struct vertex want[] = {
		{{125, 200, 35}, {17, INPUT_HARD, F | L}},     {{-400, 550, 60}, {17, INPUT_HARD, 0}},
		{{0, 0, 10}, {17, INPUT_HARD, L | R}},         {{900, 0, 10}, {17, INPUT_HARD, R}},
		{{900, 900, 10}, {17, INPUT_HARD, R}},         {{1000, 0, 20}, {4294967295u, INPUT_LAKE, F | L | R}},
		{{1100, 0, 20}, {4294967295u, INPUT_LAKE, R}}, {{1100, 100, 20}, {4294967295u, INPUT_LAKE, R}},
	};
	enum { N = sizeof want / sizeof *want };

	for (size_t batch = 1; batch <= N + 1; batch++) {
		struct vertex got[MOST];
		struct input_info info;
		char wkt[64];
		size_t n;

		read_text(text, batch, got, &n, &info, wkt);
		assert_int_equal(n, N);
		for (size_t i = 0; i < n; i++)
			if (memcmp(got[i].raw, want[i].raw, sizeof want[i].raw) || got[i].of.feature != want[i].of.feature ||
			    got[i].of.kind != want[i].of.kind || got[i].of.bits != want[i].of.bits)
				fail_msg("vertex %zu in batches of %zu", i, batch);
		assert_string_equal(info.format, "lines");
		assert_string_equal(info.variant, "2 features (1 hard, 1 lake), 3 lines");
		assert_true(info.lines.are && info.claimed == N && info.parts == 1 && !*wkt);
		assert_true(info.lines.features[INPUT_HARD] == 1 && info.lines.features[INPUT_LAKE] == 1 &&
			    info.lines.lines == 3);
		assert_true(info.coords.min[0] == -4 && info.coords.max[0] == 11 && info.coords.max[2] == 6);
		assert_string_equal(info.crs.text, "unknown");
		assert_true(!info.lines.densify.mantissa && info.lines.level == INPUT_LEVEL_NONE);
	}
}

#define LINE "feature 1 hard\nline\n0 0 0\n1 1 1\n"

static void heads(void **state)
{
	static const struct {
		const char *text, *crs, *xy, *z, *unit;
		int64_t densify;
		int exponent, level;
	} rows[] = {
		{HEAD LINE, "unknown", "unknown", "unknown", "", 0, 0, INPUT_LEVEL_NONE},
		{HEAD "crs EPSG:2154\n" LINE, "EPSG:2154", "metre", "unknown", "", 0, 0, INPUT_LEVEL_NONE},
		{HEAD "crs EPSG:25832 + EPSG:7837\nunit m\nunit-z m\n" LINE, "EPSG:25832 + EPSG:7837", "metre", "metre", "", 0, 0,
		 INPUT_LEVEL_NONE},
		{HEAD "unit ft\nunit-z ftUS\ndensify 2.50 m\nlake-level mean\n" LINE, "unknown", "foot", "us-survey-foot",
		 "metre", 25, -1, INPUT_LEVEL_MEAN},
		{HEAD "lake-level max\ndensify 16ft\ncrs a name, of its own\n" LINE, "a name, of its own", "unknown", "unknown",
		 "foot", 16, 0, INPUT_LEVEL_MAX},
		{HEAD "unit-z m\ncrs EPSG:4326\nlake-level min\ndensify 10\n" LINE, "EPSG:4326", "degree", "metre", "", 1, 1,
		 INPUT_LEVEL_MIN},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct vertex got[MOST];
		struct input_info info;
		char wkt[64];
		size_t n;

		read_text(rows[i].text, MOST, got, &n, &info, wkt);
		if (n != 2 || strcmp(info.crs.text, rows[i].crs) || strcmp(info.crs.unit_xy, rows[i].xy) ||
		    strcmp(info.crs.unit_z, rows[i].z) || strcmp(info.lines.densify_unit, rows[i].unit) ||
		    info.lines.densify.mantissa != rows[i].densify || info.lines.densify.exponent != rows[i].exponent ||
		    (int)info.lines.level != rows[i].level)
			fail_msg("%s: %s, %s, %s, %lld e %d %s, %d", rows[i].text, info.crs.text, info.crs.unit_xy,
				 info.crs.unit_z, (long long)info.lines.densify.mantissa, info.lines.densify.exponent,
				 info.lines.densify_unit, (int)info.lines.level);
	}
}

/* A definition that is longer than a row of points may be. */
static void long_definition(void **state)
{
	static const char part[] =
		"PROJCS[\"long\",GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],"
		"PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],PROJECTION[\"Transverse_Mercator\"],"
		"PARAMETER[\"scale_factor\",0.9996],UNIT[\"metre\",1],EXTENSION[\"";
	char *text = malloc(20000);
	struct vertex got[MOST];
	struct input_info info;
	char wkt[64];
	size_t n, at = (size_t)sprintf(text, HEAD "crs %s", part);

	memset(text + at, 'x', 9000);
	sprintf(text + at + 9000, "\"]]\n" LINE);
	read_text(text, MOST, got, &n, &info, wkt);
	assert_string_equal(info.crs.text, "long");
	assert_string_equal(info.crs.unit_xy, "metre");
	assert_memory_equal(wkt, "PROJCS[\"long\"", 13);
	free(text);
}

static const struct {
	const char *text;
	uint64_t row;
	const char *says;
} bad[] = {
	{"acut-lines 2\n", 1, "a version that this acut does not know"},
	{"acut-lines one\n", 1, "no text of lines"},
	{"acut-lines 1 2\n", 1, "no text of lines"},
	{HEAD "crs EPSG:2154\ncrs EPSG:2154\n", 3, "there already"},
	{HEAD "crs\n", 2, "coordinate system"},
	{HEAD "crs EPSG:99\n", 2, "99"},
	{HEAD "unit yard\n", 2, "no unit"},
	{HEAD "unit m\nunit m\n", 3, "there already"},
	{HEAD "crs EPSG:2154\nunit ft\n", 3, "another unit"},
	{HEAD "unit ft\ncrs EPSG:2154\n", 3, "other units"},
	{HEAD "densify 0 m\n", 2, "no length"},
	{HEAD "densify -1 m\n", 2, "no length"},
	{HEAD "densify 5 yards\n", 2, "no length"},
	{HEAD "densify 5 degree\n", 2, "no length"},
	{HEAD "densify 5\ndensify 5\n", 3, "there already"},
	{HEAD "lake-level\n", 2, "no level"},
	{HEAD "lake-level mini\n", 2, "no level"},
	{HEAD LINE "unit m\n", 6, "behind the first feature"},
	{HEAD "feature\n", 2, "number of a feature"},
	{HEAD "feature -1 hard\n", 2, "number of a feature"},
	{HEAD "feature 4294967296 hard\n", 2, "number of a feature"},
	{HEAD "feature 1\n", 2, "no kind"},
	{HEAD "feature 1 soft\n", 2, "no kind"},
	{HEAD "feature 1 hard x\n", 2, "no kind"},
	{HEAD "feature 1 hard\n", 2, "has no lines"},
	{HEAD "feature 1 hard\nfeature 2 hard\nline\n0 0 0\n1 1 1\n", 2, "feature 1 has no lines"},
	{HEAD "line\n", 2, "belongs to no feature"},
	{HEAD "feature 1 lake\nline\n", 3, "have rings, no lines"},
	{HEAD "feature 1 hard\nline 3\n", 3, "nothing stands behind"},
	{HEAD "feature 1 hard\n1 2 3\n", 3, "belongs to no line"},
	{HEAD LINE "feature 2 hard\n1 2 3\n", 7, "belongs to no line"},
	{HEAD "1 2 3\n", 2, "belongs to no line"},
	{FEATURE "1 2\n", 4, "nor x y z"},
	{FEATURE "1 2 \n", 4, "nor x y z"},
	{FEATURE "1 2 3 4\n", 4, "nothing else"},
	{FEATURE "1,2,3\n", 4, "nor x y z"},
	{FEATURE "1 2 3x\n", 4, "nor x y z"},
	{FEATURE "1 2 nan\n", 4, "not finite"},
	{FEATURE "1 2 1e30\n", 4, "too large"},
	{FEATURE "0 0 0\n", 3, "a line of feature 7 with 1 vertex"},
	{FEATURE "0 0 0\nline\n0 0 0\n1 1 1\n", 3, "a line of feature 7 with 1 vertex"},
	{HEAD "feature 1 hole\nring\n0 0 0\n1 1 1\nring\n", 3, "a ring of feature 1 with 2 vertices"},
	{FEATURE "0 0 0\n1 1 1\nend\n", 6, "neither a row that begins with a word"},
};

static void refused(void **state)
{
	const struct input_options defaults = {.format = NULL};

	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
		struct outcome out = fixture_read(bad[i].text, strlen(bad[i].text), "a.txt", &defaults, 100);

		if (out.code != ERR_INPUT || out.err.offset != bad[i].row || !strstr(out.err.message, bad[i].says) ||
		    !*out.err.hint || strcmp(out.err.field, "line") || strcmp(out.err.file, "a.txt"))
			fail_msg("%s: %d line %llu: %s", bad[i].text, out.code, (unsigned long long)out.err.offset,
				 out.err.message);
	}
}

/* A list of points stays one, and a forced format says what is wrong. */
static void other_texts(void **state)
{
	const struct input_options lines = {.format = "lines"}, defaults = {.format = NULL};
	struct outcome out = fixture_read("1 2 3\n", 6, "a.xyz", &lines, 100);

	assert_int_equal(out.code, ERR_INPUT);
	assert_non_null(strstr(out.err.message, "no text of lines"));
	out = fixture_read("", 0, "a.xyz", &lines, 100);
	assert_int_equal(out.code, ERR_TRUNCATED);
	out = fixture_read(HEAD, sizeof HEAD - 1, "a.xyz", &defaults, 100);
	assert_true(!out.code && !out.points);
	/* degrees are no plane unless somebody projects them */
	out = fixture_read(HEAD "crs EPSG:4326\n" LINE, strlen(HEAD "crs EPSG:4326\n" LINE), "a.xyz", &defaults, 100);
	assert_int_equal(out.code, ERR_UNSUPPORTED);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(vertices), cmocka_unit_test(heads),       cmocka_unit_test(long_definition),
		cmocka_unit_test(refused),  cmocka_unit_test(other_texts),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
