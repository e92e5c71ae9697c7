/*
 * PTX: tables of texts with what must come out of them, transforms against exact sums that are computed here in another way
 * (by long multiplication of decimal digits), files that end early, heads that are damaged; and that PTX and PTS are never
 * taken for each other.
 */
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
#include "input_text_parts.h"

#define AXES "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
#define SAME AXES "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
/* a quarter turn: x becomes y, y becomes -x; then a shift */
#define TURNED AXES "0 1 0 0\n-1 0 0 0\n0 0 1 0\n1000 2000.5 -3 1\n"

enum { MOST = 8 };

struct row {
	const char *text;
	bool accept;
	size_t n;
	int64_t raw[MOST][3];
	const char *variant, *warning;
};

static const struct row good[] = {
	{"1\n1\n" SAME "1.5 2.25 -3.0001 0.5\n", false, 1, {{15000, 22500, -30001}}, "1 scan, 1 cells, 0 empty", ""},
	{"2\n2\n" SAME "1 2 3 0.5\n0 0 0 0.5\n4 5 6 0.5 1 2 3\n0.000 -0.0 0 0 0 0 0\n",
	 false,
	 2,
	 {{10000, 20000, 30000}, {40000, 50000, 60000}},
	 "1 scan, 4 cells, 2 empty",
	 ""},
	{"1\r\n1 \r\n\r\n0 0 0\r\n1 0 0\r\n0 1 0\r\n0 0 1\r\n1 0 0 0\r\n0 1 0 0\r\n0 0 1 0\r\n0 0 0 1\r\n1 2 3 1\r\n",
	 false,
	 1,
	 {{10000, 20000, 30000}},
	 "1 scan",
	 ""},
	{"1\n2\n" TURNED "1 2 3 0.5\n10 0 0 1\n", false, 2, {{9980000, 20015000, 0}, {10000000, 20105000, -30000}}, "1 scan", ""},
	/* several scans, each with its matrix; cells without a return stay where no matrix moves them */
	{"1\n1\n" TURNED "0 0 0 0\n"
	 "1\n2\n" TURNED "1 2 3 0.5\nnan nan nan 0\n"
	 "1\n1\n" SAME "7 8 9 0\n",
	 false,
	 2,
	 {{9980000, 20015000, 0}, {70000, 80000, 90000}},
	 "3 scans, 4 cells, 2 empty",
	 ""},
	{"0\n5\n" SAME "1\n1\n" SAME "1 2 3 4\n", false, 1, {{10000, 20000, 30000}}, "2 scans, 1 cells", ""},
	{"0\n0\n" SAME, false, 0, {{0}}, "1 scan, 0 cells", ""},
	{"1\n4\n" SAME "0 0 3 0\n0 2 0 0\n1 0 0 0\n-0.000 0 0 0.5\n",
	 false,
	 3,
	 {{0, 0, 30000}, {0, 20000, 0}, {10000, 0, 0}},
	 "4 cells, 1 empty",
	 ""},
	/* rounded once, halves up, as the lattice does */
	{"1\n4\n" SAME "0.00005 0.00015 -0.00005 0\n0.00004999 -0.00015 1e-4 0\n1234.567849999 1 1 0\n"
	 "9.99999e2 .5 5. 0\n",
	 false,
	 4,
	 {{1, 2, 0}, {0, -1, 1}, {12345678, 10000, 10000}, {9999990, 5000, 50000}},
	 "",
	 ""},
	/* the last line may lack its end, if it is sure that z is whole */
	{"1\n1\n" SAME "1 2 3 0.5", false, 1, {{10000, 20000, 30000}}, "", ""},
	/* cells that are missing */
	{"2\n2\n" TURNED "1 2 3 0.5\n", true, 1, {{9980000, 20015000, 0}}, "1 scan, 1 cells", "3 cells fewer than its 2 times 2"},
	{"2\n2\n" TURNED "1 2 3 0.5\n10 0 0", true, 1, {{9980000, 20015000, 0}}, "1 scan, 1 cells", "3 cells fewer"},
	{"2\n2\n" TURNED "1 2 3 0.5\n10 0 -", true, 1, {{9980000, 20015000, 0}}, "1 scan, 1 cells", "3 cells fewer"},
	{"2\n1\n" TURNED "1 2 3 0.5\n"
	 "1\n1\n" SAME "7 8 9 0\n",
	 true,
	 2,
	 {{9980000, 20015000, 0}, {70000, 80000, 90000}},
	 "2 scans, 2 cells",
	 "scan 1, which begins in line 1, has 1 cells fewer"},
	{"1\n1\n" SAME "1 2 3 0.5\n"
	 "1\n1\n" AXES "1 0 0 0\n",
	 true,
	 1,
	 {{10000, 20000, 30000}},
	 "1 scan, 1 cells",
	 "within the head of a scan, which begins in line 12"},
	{"1\n1\n" SAME "1 2 3 0.5\n"
	 "12",
	 true,
	 1,
	 {{10000, 20000, 30000}},
	 "1 scan, 1 cells",
	 "within the head"},
};

static void check_good(const struct row *row)
{
	const struct input_options options = {.accept_truncated = row->accept};
	int fd = fixture_fd(row->text, strlen(row->text));
	struct err err = ERR_INIT;
	struct input_points pts;
	struct input *in = NULL;
	int rc = input_open(fd, "scan.txt", &options, &in, &err);

	if (rc)
		printf("%s: %s\n", row->text, err.message);
	assert_int_equal(rc, 0);
	assert_string_equal(input_info(in)->format, "ptx");
	assert_string_equal(input_info(in)->crs.unit_xy, "metre");
	assert_string_equal(input_info(in)->crs.unit_z, "metre");
	assert_int_equal(input_info(in)->crs.plane, CRS_PLANE_UNKNOWN);
	assert_int_equal(input_info(in)->claimed, row->n);
	if (!strstr(input_info(in)->variant, row->variant) || !strstr(input_info(in)->warning, row->warning) ||
	    (!*row->warning && *input_info(in)->warning))
		fail_msg("%s: \"%s\" \"%s\"", row->text, input_info(in)->variant, input_info(in)->warning);
	fixture_points_new(&pts, MOST);
	assert_int_equal(input_read(in, &pts, &err), 0);
	assert_int_equal(pts.n, row->n);
	for (size_t i = 0; i < pts.n; i++)
		for (int k = 0; k < 3; k++) {
			if (pts.raw[i][k] != row->raw[i][k])
				fail_msg("%s: point %zu, axis %d is %lld", row->text, i, k, (long long)pts.raw[i][k]);
			assert_true((double)pts.raw[i][k] / 1e4 >= input_info(in)->coords.min[k]);
			assert_true((double)pts.raw[i][k] / 1e4 <= input_info(in)->coords.max[k]);
		}
	assert_int_equal(input_read(in, &pts, &err), 0);
	assert_int_equal(pts.n, 0);
	fixture_points_free(&pts);
	input_close(in);
	close(fd);
}

static void good_files(void **state)
{
	for (size_t i = 0; i < sizeof good / sizeof *good; i++)
		check_good(&good[i]);
}

static const struct {
	const char *text;
	enum err_code code;
	uint64_t line;
	const char *says;
} bad[] = {
	/* it ends early */
	{"2\n2\n" SAME "1 2 3 0.5\n4 5 6 1\n", ERR_TRUNCATED, 1, "2 times 2 cells, but 2 of them are missing: the file ends"},
	{"1\n1\n" SAME "1 2 3", ERR_TRUNCATED, 1, "the last line is not whole"},
	{"1\n2\n" SAME "1 2 3 4\n5", ERR_TRUNCATED, 1, "the last line is not whole"},
	{"2\n1\n" SAME "1 2 3 0\n1\n1\n" SAME "1 2 3 0\n", ERR_TRUNCATED, 1, "line 12 begins another scan"},
	{"1\n1\n" SAME "1 2 3 0\n2\n1\n" SAME "1 2 3 0\n", ERR_TRUNCATED, 12, "scan 2, which begins in line 12"},
	{"1\n1\n0 0 0\n1 0 0\n", ERR_TRUNCATED, 4, "within the head of scan 1"},
	{"1\n1\n" SAME "1 2 3 4\n1\n1\n0 0", ERR_TRUNCATED, 14, "within the head of scan 2"},
	/* heads */
	{"1\n1\n0 0\n1 0 0\n0 1 0\n0 0 1\n", ERR_INPUT, 3, "3 numbers are wanted"},
	{"1\n1\n0 0 0 0\n1 0 0\n0 1 0\n0 0 1\n", ERR_INPUT, 3, "3 numbers are wanted"},
	{"1\n1\n0 x 0\n1 0 0\n0 1 0\n0 0 1\n", ERR_INPUT, 3, "3 numbers are wanted"},
	{"1\n1\n" AXES "1 0 0\n0 1 0\n0 0 1\n0 0 0\n1 2 3 4\n", ERR_INPUT, 7, "4 numbers are wanted"},
	{"1\n1\n" AXES "1 0 0 0\n0 1 0 0 0\n0 0 1 0\n0 0 0 1\n1 2 3 4\n", ERR_INPUT, 8, "4 numbers are wanted"},
	{"1\n1\n" AXES "1 0 0 0\n0 nan 0 0\n0 0 1 0\n0 0 0 1\n1 2 3 4\n", ERR_INPUT, 8, "not finite"},
	{"1\n1\n" AXES "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 inf 0 1\n1 2 3 4\n", ERR_INPUT, 10, "not finite"},
	{"1\n1\n" AXES "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 1e30 0 1\n1 2 3 4\n", ERR_INPUT, 10, "too large"},
	{"1\n1\n" AXES "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 0\n1 2 3 4\n", ERR_INPUT, 10, "not 0 0 0 1"},
	{"1\n1\n" AXES "1 0 0 5000\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 2 3 4\n", ERR_INPUT, 7, "not 0 0 0 1"},
	{"1\n1\n" AXES "1 0 7 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 2 3 4\n", ERR_INPUT, 7, "too large"},
	{"1\n1\n" AXES "1 0 0 1\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 2 3 4\n", ERR_INPUT, 7, "not 0 0 0 1"},
	{"1\n1\n" AXES "0 0 0 0\n0 0 0 0\n0 0 0 0\n0 0 0 1\n1 2 3 4\n", ERR_INPUT, 10, "distorts"},
	{"1\n1\n" AXES "1 0 0 0\n1 0 0 0\n0 0 1 0\n0 0 0 1\n1 2 3 4\n", ERR_INPUT, 10, "distorts"},
	{"1\n1\n" AXES "1 0 0 0\n0 1 0 0\n0 0 1.01 0\n0 0 0 1\n1 2 3 4\n", ERR_INPUT, 10, "distorts"},
	{"1\n1\n" AXES "1 0 0 0\n0 1 0 0\n0 0 -1 0\n0 0 0 1\n1 2 3 4\n", ERR_INPUT, 10, "mirrors"},
	{"4294967296\n4294967296\n" SAME "1 2 3 4\n", ERR_INPUT, 2, "columns times rows"},
	{"9000000000000000000\n2\n" SAME "1 2 3 4\n", ERR_INPUT, 2, "columns times rows"},
	{"9999999999999999999\n1\n" SAME "1 2 3 4\n", ERR_INPUT, 1, "number of columns"},
	{"1000000000\n1000000000\n" SAME "1 2 3 4\n", ERR_TRUNCATED, 1, "999999999999999999 of them are missing"},
	{"1\n1\n" SAME "1 2 3 4\n1 2 3 4\n", ERR_INPUT, 12, "the scan before has all of its cells"},
	{"1\n1\n" SAME "1 2 3 4\n1\n1 2 3\n", ERR_INPUT, 13, "the head of scan 2: the number of rows"},
	/* cells */
	{"1\n1\n" SAME "1 2\n", ERR_INPUT, 11, "x y z"},
	{"1\n1\n" SAME "1 2 x 4\n", ERR_INPUT, 11, "x y z"},
	{"1\n1\n" SAME "1 2 3x 4\n", ERR_INPUT, 11, "x y z"},
	{"1\n1\n" SAME "1 2 1e9 4\n", ERR_INPUT, 11, "thousand kilometres"},
};

static void bad_files(void **state)
{
	const struct input_options defaults = {.format = NULL};

	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
		struct outcome out = fixture_read(bad[i].text, strlen(bad[i].text), "a.ptx", &defaults, 100);

		if (out.code != bad[i].code || out.err.offset != bad[i].line || !strstr(out.err.message, bad[i].says) ||
		    !*out.err.hint || strcmp(out.err.field, "line"))
			fail_msg("%s: %d line %llu: %s", bad[i].text, out.code, (unsigned long long)out.err.offset,
				 out.err.message);
	}
}

/* Told from .pts by what is in it, whatever it is called; what is called .ptx is never another text. */
static void told_apart(void **state)
{
	static const struct {
		const char *text, *name, *format;
	} rows[] = {
		{"1\n1\n" SAME "1 2 3 4\n", "a.pts", "ptx"},
		{"1\n1\n" SAME "1 2 3 4\n", "a.xyz", "ptx"},
		{"\xef\xbb\xbf"
		 "1\n1\n" SAME "1 2 3 4\n",
		 "a", "ptx"},
		{"0\n0\n" SAME, "a.pts", "ptx"},
		{"1\n1 2 3 4\n", "a.pts", "pts"},
		{"1\n1 2 3 4\n", "a.txt", "pts"},
		{"0\n1\n1 2 3\n", "a.pts", "pts"},
		{"0\n0\n", "a.pts", "pts"},
		{"1 2 3\n1 2 3\n", "a.xyz", "xyz"},
		{"1 2 3\n1 2 3\n", "a.ptx", NULL},
		{"2\n1 2 3\n1 2 3\n", "a.ptx", NULL},
		{"", "a.ptx", NULL},
	};
	const struct input_options defaults = {.format = NULL};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct outcome out = fixture_read(rows[i].text, strlen(rows[i].text), rows[i].name, &defaults, 100);

		if (rows[i].format ? out.code || strcmp(out.info.format, rows[i].format) : !out.code)
			fail_msg("%s as %s: %d %s %s", rows[i].text, rows[i].name, out.code, out.err.message, out.info.format);
	}
}

/* A PTX file is not read as points of another text format, even if that format is requested. */
static void never_points(void **state)
{
	static const char text[] = "2\n1\n" SAME "1 2 3 4\n5 6 7 8\n", *const formats[] = {"pts", "xyz"};

	for (size_t i = 0; i < 2; i++) {
		const struct input_options options = {.format = formats[i], .accept_truncated = true};
		struct outcome out = fixture_read(text, sizeof text - 1, "a.pts", &options, 10);

		if (out.code != ERR_INPUT || !strstr(out.err.message, "this is PTX") || !strstr(out.err.hint, "--input-format"))
			fail_msg("%s: %d %s (%s)", formats[i], out.code, out.err.message, out.err.hint);
	}
}

/* ---- the transform, another way ---- */

enum { LIMBS = 6 };
static const uint32_t limb = 1000000000;

/* A number of nine digits a limb, the lowest first, and its sign. */
struct big {
	bool negative;
	uint32_t at[LIMBS];
};

static struct big big_of(int64_t v)
{
	struct big b = {.negative = v < 0};
	uint64_t m = v < 0 ? -(uint64_t)v : (uint64_t)v;

	for (int i = 0; m; i++, m /= limb)
		b.at[i] = (uint32_t)(m % limb);
	return b;
}

static int big_compare(const struct big *a, const struct big *b)
{
	for (int i = LIMBS - 1; i >= 0; i--)
		if (a->at[i] != b->at[i])
			return a->at[i] < b->at[i] ? -1 : 1;
	return 0;
}

static struct big big_add(struct big a, struct big b)
{
	struct big r = {.negative = a.negative};
	int64_t carry = 0;

	if (a.negative != b.negative && big_compare(&a, &b) < 0)
		return big_add(b, a);
	for (int i = 0; i < LIMBS; i++) {
		int64_t v = (int64_t)a.at[i] + (a.negative == b.negative ? (int64_t)b.at[i] : -(int64_t)b.at[i]) + carry;

		carry = v < 0 ? -1 : v / limb;
		r.at[i] = (uint32_t)(v - carry * limb);
	}
	return r;
}

static struct big big_mul(int64_t x, int64_t y)
{
	struct big a = big_of(x), b = big_of(y), r = {.negative = a.negative != b.negative};

	for (int i = 0; i < 3; i++)
		for (int k = 0; k < 3; k++) {
			uint64_t v = (uint64_t)a.at[i] * b.at[k];

			for (int at = i + k; v && at < LIMBS; at++) {
				v += r.at[at];
				r.at[at] = (uint32_t)(v % limb);
				v /= limb;
			}
		}
	return r;
}

/* In units of 1e-24: to 1e-4, halves up. */
static int64_t big_raw(struct big b)
{
	struct big half = {.at = {0, 0, 50}}; /* 5e19 */
	int64_t v;
	bool rest;

	b = big_add(b, half);
	rest = b.at[0] || b.at[1] || b.at[2] % 100;
	v = (int64_t)b.at[2] / 100 + (int64_t)b.at[3] * (limb / 100) + (int64_t)b.at[4] * (limb / 100) * limb;
	return b.negative ? -v - rest : v;
}

static size_t put_fixed(char *to, int64_t v, int places)
{
	uint64_t m = v < 0 ? -(uint64_t)v : (uint64_t)v, unit = 1;

	for (int i = 0; i < places; i++)
		unit *= 10;
	return (size_t)sprintf(to, "%s%llu.%0*llu", v < 0 ? "-" : "", (unsigned long long)(m / unit), places,
			       (unsigned long long)(m % unit));
}

static int64_t random_of(uint64_t *state, int64_t most)
{
	uint64_t v = (uint64_t)fixture_random(state) << 32 | fixture_random(state);

	return (int64_t)(v % (2 * (uint64_t)most + 1)) - most;
}

/* Turns about the three axes, whose sines and cosines are Pythagorean: rows of whole numbers times 1e-15. */
static void random_turn(uint64_t *state, int64_t m[3][3])
{
	static const int64_t c[] = {600000000000000, 800000000000000, 280000000000000, 960000000000000};
	unsigned axis = fixture_random(state) % 3, which = fixture_random(state) % 4, a = (axis + 1) % 3, b = (axis + 2) % 3;

	memset(m, 0, 9 * sizeof m[0][0]);
	m[axis][axis] = 1000000000000000;
	m[a][a] = m[b][b] = c[which];
	m[a][b] = c[which ^ 1];
	m[b][a] = -c[which ^ 1];
	/* noise as of a registration, below what distorts */
	for (int i = 0; i < 9; i++)
		m[i / 3][i % 3] += random_of(state, 100000000000);
}

static void transforms(void **test)
{
	const struct input_options defaults = {.format = NULL};
	uint64_t state = 7;
	struct err err = ERR_INIT;

	for (int round = 0; round < 300; round++) {
		int64_t m[3][3], shift[3], cell[3];
		struct input_points pts;
		struct input *in = NULL;
		char text[2048];
		size_t n = (size_t)sprintf(text, "1\n1\n" AXES);
		int fd;

		random_turn(&state, m);
		for (int i = 0; i < 3; i++) {
			for (int k = 0; k < 3; k++, text[n++] = ' ')
				n += put_fixed(text + n, m[i][k], 15);
			n += (size_t)sprintf(text + n, "0\n");
		}
		for (int i = 0; i < 3; i++, text[n++] = ' ')
			n += put_fixed(text + n, shift[i] = random_of(&state, 9000000000000000), 9);
		n += (size_t)sprintf(text + n, "1\n");
		for (int i = 0; i < 3; i++, text[n++] = ' ')
			n += put_fixed(text + n, cell[i] = random_of(&state, 900000000000), 9);
		n += (size_t)sprintf(text + n, "0.5\n");
		fd = fixture_fd(text, n);
		if (input_open(fd, "a.ptx", &defaults, &in, &err))
			fail_msg("%s: %s", text, err.message);
		fixture_points_new(&pts, 2);
		assert_int_equal(input_read(in, &pts, &err), 0);
		assert_int_equal(pts.n, 1);
		for (int i = 0; i < 3; i++) {
			struct big sum = big_mul(shift[i], 1000000000000000);

			for (int k = 0; k < 3; k++)
				sum = big_add(sum, big_mul(cell[k], m[k][i]));
			if (pts.raw[0][i] != big_raw(sum))
				fail_msg("%s: axis %d is %lld, not %lld", text, i, (long long)pts.raw[0][i],
					 (long long)big_raw(sum));
		}
		fixture_points_free(&pts);
		input_close(in);
		close(fd);
	}
}

/* Cut anywhere: refused as truncated; or accepted, and then every point is one of the whole file's, in its order. */
static void cut_anywhere(void **state)
{
	static const char text[] = "2\n1\n" TURNED "1.25 2.5 3.75 0.5\n0 0 0 0\n"
				   "1\n2\n" SAME "7.5 8.5 9.5 0\n17.5 18.5 19.5 0\n";
	static const int64_t whole[3][3] = {{9975000, 20017500, 7500}, {75000, 85000, 95000}, {175000, 185000, 195000}};

	for (size_t n = 8; n + 2 < sizeof text; n++) {
		const struct input_options strict = {.format = "ptx"}, accept = {.format = "ptx", .accept_truncated = true};
		struct outcome out = fixture_read(text, n, "a.ptx", &strict, 10);
		struct err err = ERR_INIT;
		struct input_points pts;
		struct input *in = NULL;
		int fd = fixture_fd(text, n);
		/* a cut right behind a scan is none */
		bool between = out.code == 0;

		if (!between && out.code != ERR_TRUNCATED)
			fail_msg("cut at %zu: %d %s", n, out.code, out.err.message);
		if (between && out.points != 1 && out.points != 3)
			fail_msg("cut at %zu: %llu points", n, (unsigned long long)out.points);
		if (!input_open(fd, "a.ptx", &accept, &in, &err)) {
			fixture_points_new(&pts, MOST);
			assert_int_equal(input_read(in, &pts, &err), 0);
			assert_true(between || *input_info(in)->warning);
			assert_true(pts.n <= 3);
			for (size_t i = 0; i < pts.n; i++)
				if (memcmp(pts.raw[i], whole[i], sizeof whole[i]))
					fail_msg("cut at %zu: point %zu is another one", n, i);
			fixture_points_free(&pts);
			input_close(in);
		} else {
			assert_int_equal(err.code, ERR_TRUNCATED);
		}
		close(fd);
	}
}

/* Numbers: any writing of one value is that value; rounded half away from zero; too large is not clamped. */
static void fixed_numbers(void **state)
{
	static const struct {
		const char *text;
		int places;
		enum input_number_state state;
		int64_t value;
	} rows[] = {
		{"0.1", 9, INPUT_NUMBER_OK, 100000000},
		{"1e-1", 9, INPUT_NUMBER_OK, 100000000},
		{"1.D-01", 9, INPUT_NUMBER_OK, 100000000},
		{"1.D", 9, INPUT_NUMBER_BAD, 0},
		{"+.1", 9, INPUT_NUMBER_OK, 100000000},
		{"0.10000000000000000555", 9, INPUT_NUMBER_OK, 100000000},
		{"-1.22464679914735e-016", 15, INPUT_NUMBER_OK, 0},
		{"1.22464679914735e-015", 15, INPUT_NUMBER_OK, 1},
		{"0.5", 0, INPUT_NUMBER_OK, 1},
		{"-0.5", 0, INPUT_NUMBER_OK, -1},
		{"0.49999999999999999999999999", 0, INPUT_NUMBER_OK, 0},
		{"0.05", 0, INPUT_NUMBER_OK, 0},
		{"9.5", 0, INPUT_NUMBER_OK, 10},
		{"12345678901234567890e-10", 0, INPUT_NUMBER_OK, 1234567890},
		{"0e99999", 3, INPUT_NUMBER_OK, 0},
		{"5e-99999", 3, INPUT_NUMBER_OK, 0},
		{"1000000000", 0, INPUT_NUMBER_TOO_LONG, 0},
		{"1999999999.6", 0, INPUT_NUMBER_TOO_LONG, 0},
		{"1e9999", 0, INPUT_NUMBER_TOO_LONG, 0},
		{"99999999999999999999999999", 0, INPUT_NUMBER_TOO_LONG, 0},
		{"1e", 0, INPUT_NUMBER_BAD, 0},
		{".", 0, INPUT_NUMBER_BAD, 0},
		{"-", 0, INPUT_NUMBER_BAD, 0},
		{"", 0, INPUT_NUMBER_BAD, 0},
		{"NaN", 0, INPUT_NUMBER_NOT_FINITE, 0},
		{"-inf", 0, INPUT_NUMBER_NOT_FINITE, 0},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		const char *p = rows[i].text;
		int64_t v = 0;
		enum input_number_state got = input_fixed_read(
			&p, p + strlen(p), rows[i].places, rows[i].state == INPUT_NUMBER_TOO_LONG ? 999999999 : INT64_MAX, &v);

		if (got != rows[i].state || (got == INPUT_NUMBER_OK && (v != rows[i].value || *p)))
			fail_msg("%s: %d %lld", rows[i].text, got, (long long)v);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(good_files),    cmocka_unit_test(bad_files),  cmocka_unit_test(told_apart),
		cmocka_unit_test(never_points),  cmocka_unit_test(transforms), cmocka_unit_test(cut_anywhere),
		cmocka_unit_test(fixed_numbers),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
