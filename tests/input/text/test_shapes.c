/*
 * Shapes of text files: decimal commas, separators of thousands, comments, quoted numbers, lines without a value, UTF-16.
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

struct shape {
	const char *text;
	uint64_t points;
	int64_t last[3];         /* raw numbers of the last point */
	uint64_t left_out, line; /* lines, the first */
	const char *columns;
	bool comma;
	const char *warns;
};

static const struct shape shapes[] = {
	/* decimal commas */
	{"1,5 2,25 3\n", 1, {150, 225, 3}, 0, 0, NULL, true, NULL},
	{"1,5;2,25;3,125\r\n-4;5,5;-,5\r\n", 2, {-400, 550, -500}, 0, 0, NULL, true, NULL},
	{"1,5\t2,5\t3,5\n", 1, {15, 25, 35}, 0, 0, NULL, true, NULL},
	{"\"1,5\",\"2,5\",\"3,5\"\n", 1, {15, 25, 35}, 0, 0, NULL, true, NULL},
	{"X;Y;Z\n1,5;2,5;3,5\n", 1, {15, 25, 35}, 0, 0, NULL, true, NULL},
	{"id;date;x;y;z\n1;01.02.2020;1,5;2,5;3,5\n", 1, {15, 25, 35}, 0, 0, "__xyz", true, NULL},
	{"1,5e2 2 3\n", 1, {150, 2, 3}, 0, 0, NULL, true, NULL},
	{"1 2 3\n", 1, {1, 2, 3}, 0, 0, NULL, true, NULL},
	/* comments */
	{"! a\n; b\n;\n; 12 points\n  ;c;d\n! 1 2 3\n1 2 3\n", 1, {1, 2, 3}, 0, 0, NULL, false, NULL},
	{"\"# a, b\"\n\"; c\",,\n1,2,3\n", 1, {1, 2, 3}, 0, 0, NULL, false, NULL},
	{";1;2;3\n", 1, {1, 2, 3}, 0, 0, "_xyz", false, NULL}, /* an empty first column is none */
	/* comments with the numbers of a point: behind the first one, or the names */
	{"1 2 3\n!4 5 6\n; 7 8 9 GND\n# 4 5\n",
	 1,
	 {1, 2, 3},
	 0,
	 0,
	 NULL,
	 false,
	 "2 comments have the numbers of a point and are not read, the first is line 2"},
	{"id,x,y,z\n!a,1,2,3\n\"#b\",4,5,6\n;c,7,8,9\n\"# d\",nothing\ne,1,2,3\n",
	 1,
	 {1, 2, 3},
	 0,
	 0,
	 NULL,
	 false,
	 "3 comments have the numbers of a point and are not read, the first is line 2"},
	{"//X Y Z\n! 4 5 6\n1 2 3\n", 1, {1, 2, 3}, 0, 0, NULL, false, "1 comment has the numbers of a point and is not read"},
	{"\"1\",\"2\",\"3\"\n\"!4\",\"5\",\"6\"\n", 1, {1, 2, 3}, 0, 0, NULL, false, "the first is line 2"},
	{"! 4 5 6\n# x y z\n1 2 3\n# 12 points\n", 1, {1, 2, 3}, 0, 0, NULL, false, NULL},
	{";a;1;2;3\n;b;4;5;6\nc;d;1;2;3\n;e;4;5;6\n", 1, {1, 2, 3}, 0, 0, "__xyz", false, "1 comment has"},
	/* quoted numbers */
	{"\"1.5\",\"2\",\"3\"\n", 1, {15, 20, 3}, 0, 0, NULL, false, NULL},
	{"\" 1.5 \"; 2 ;\"3\" # x\n", 1, {15, 20, 3}, 0, 0, NULL, false, NULL},
	{"\"X\",\"Y\",\"Z\"\n\"1\",\"2\",\"3\"\n", 1, {1, 2, 3}, 0, 0, NULL, false, NULL},
	/* lines without a value */
	{"1 2 nan\n4 5 6\n", 1, {4, 5, 6}, 1, 1, NULL, false, "50 % of its lines, 1, have no value"},
	{"4 5 6\n1 2 *\n1 2 ***\n1 nan 3\n", 1, {4, 5, 6}, 3, 2, NULL, false, "are x, y and z other columns"},
	{"4,5,6\n1,2,\n1,2,,7\n1,,3\n,2,3\n1,2, \n", 1, {4, 5, 6}, 5, 2, NULL, false, "line 2"},
	{"4;5;6\n1;2;\"\"\n1;2;NULL\n1;2;n/a\n1;2;-\n", 1, {4, 5, 6}, 4, 2, NULL, false, "line 2"},
	{"4\t5\t6\n1\t2\t\n", 1, {4, 5, 6}, 1, 2, NULL, false, "line 2"},
	{"4 5 6\n1 2 1.#QNAN\n1 2 -1.#IND00\n1 2 -inf\n1 2 -nan(ind)\n", 1, {4, 5, 6}, 4, 2, NULL, false, "line 2"},
	{"4,5,6,*,\n", 1, {4, 5, 6}, 0, 0, NULL, false, NULL}, /* of what is not read */
	{"* * *\n1 2 3\n", 1, {1, 2, 3}, 1, 1, NULL, false, "left out"},
	{"x y z\n1 2 nan\n4 5 6\n", 1, {4, 5, 6}, 1, 2, NULL, false, "left out"},
};

static void good_shapes(void **state)
{
	for (size_t i = 0; i < sizeof shapes / sizeof *shapes; i++) {
		const struct shape *s = &shapes[i];
		const struct input_options options = {.columns = s->columns, .decimal_comma = s->comma};
		int fd = fixture_fd(s->text, strlen(s->text));
		struct err err = ERR_INIT;
		struct input_points pts;
		const struct input_info *info;
		struct input *in = NULL;

		if (input_open(fd, "a.txt", &options, &in, &err))
			fail_msg("%s: %s", s->text, err.message);
		info = input_info(in);
		fixture_points_new(&pts, 10);
		assert_int_equal(input_read(in, &pts, &err), 0);
		if (pts.n != s->points || info->claimed != pts.n || memcmp(pts.raw[pts.n - 1], s->last, sizeof s->last))
			fail_msg("%s: %zu points", s->text, pts.n);
		if (info->left_out != s->left_out || info->left_out_line != s->line)
			fail_msg("%s: %llu left out", s->text, (unsigned long long)info->left_out);
		if (!s->warns ? *info->warning != 0 : !strstr(info->warning, s->warns))
			fail_msg("%s: %s", s->text, info->warning);
		fixture_points_free(&pts);
		input_close(in);
		close(fd);
	}
	(void)state;
}

static const struct {
	const char *text;
	bool comma, strict;
	uint64_t line;
	const char *says, *hint;
} bad[] = {
	{"1 2 3\n1,5 2,5 3,5\n", false, false, 2, "decimal commas", "--decimal-comma"},
	{"1,5 2,5\n", false, false, 1, "decimal commas", "--decimal-comma"},
	{"1.234,5 2 3\n", true, false, 1, "thousands, it seems, and these are not read: \"1.234,5 2 3\"", "1234567.8"},
	{"1 2 3\n1.5 2 3\n", true, false, 2, "decimal points, but --decimal-comma says that there are none: \"1.5 2 3\"",
	 "leave --decimal-comma out"},
	{"440.123 5400.456 100.789\n", true, false, 1, "decimal points", "leave --decimal-comma out"},
	{"440000.123,5400000.456,100.789\n", true, false, 1, "decimal points", "leave --decimal-comma out"},
	{"-.5;1;2\n", true, false, 1, "not a number: \"-.5;1;2\"", NULL},
	{".5;1;2\n", true, false, 1, "decimal points", NULL},
	{"\"1.5\",\"2.5\",\"3\"\n", true, false, 1, "decimal points", NULL},
	{"1.234.567 2 3\n", true, false, 1, "thousands", "1234567.8"},
	{"1,5 2.000 3\n", true, false, 1, "thousands", "1234567.8"},
	{"1,5,2,5,3,5\n", true, false, 1, "run together", NULL},
	{"1,234.5 6,789.25 7\n", false, false, 1, "thousands", "1234567.8"},
	{"1 1,234,567.5 7\n", false, false, 1, "thousands", NULL},
	{"\"1,234.5\",\"6,789.25\",\"7\"\n", false, false, 1, "thousands", NULL},
	{"1'234.5;6'789.25;7\n", false, false, 1, "thousands", NULL},
	{"1 234 567.5;5 400 000.25;7\n", false, false, 1, "thousands", NULL},
	{"1\xc2\xa0"
	 "234.5;6;7\n",
	 false, false, 1, "thousands", NULL},
	{"1_234 6 7\n", false, false, 1, "thousands", NULL},
	{"500,000 5,400,000 100\n", false, false, 1, "thousands, it seems, and these are not read: \"5,400,000 100\"", NULL},
	{"5.400.000;500.000;100\n", false, false, 1, "thousands", NULL},
	{"1 234 567;5 400 000;7\n", false, false, 1, "thousands", NULL},
	{"1,234,567x,5,6\n", false, false, 1, "decimal commas", NULL},  /* of several columns */
	{"1.5 2.500 103.25x\n", false, false, 1, "run together", NULL}, /* three decimals, three digits */
	{"1.234.5 6 7\n", false, false, 1, "run together", NULL},
	{"1 2 nan\n", false, false, 1, "finite", NULL}, /* nothing is left */
	{"\n1 2 *\n1 2 nan\n", false, false, 2, "not a number", NULL},
	{"1 2 3\n1 2 nan\n", false, true, 2, "finite", "--strict"},
	{"1,2,3\n1,2,\n", false, true, 2, "fewer than three", "--strict"},
	{"!1 2 3\n! 4 5 6\n", false, false, 1, "no points, but 2 comments have the numbers of one, the first is line 1",
	 "take the marks"},
	{"x,y,z\n# 1,2,3\n", false, false, 2, "no points, but 1 comment has", "take the marks"},
	{"# no mark\n1 2 3\n# note\n!1 2 3\n", false, true, 4, "a comment that has the numbers of a point", "without --strict"},
	{"x,y,z\n;1,2,3\n4,5,6\n", false, true, 2, "a comment that has the numbers", "without --strict"},
	{"1 2 3\n1 2\n", false, false, 2, "fewer than three", NULL},
	{"1,2,3\n1,2\n", false, false, 2, "fewer than three", NULL},
	{"1,2,3\n1,2,word\n", false, false, 2, "not a number", NULL},
	{"1,2,3\n1,2,\"3\n", false, false, 2, "not a number", NULL},
	{"1;2;3\n1;2;3#\n", false, false, 2, "run together", NULL},
};

static void bad_shapes(void **state)
{
	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
		const struct input_options options = {.decimal_comma = bad[i].comma, .strict = bad[i].strict};
		struct outcome out = fixture_read(bad[i].text, strlen(bad[i].text), "a.txt", &options, 10);

		if (out.code != ERR_INPUT || out.err.offset != bad[i].line || !strstr(out.err.message, bad[i].says) ||
		    (bad[i].hint && !strstr(out.err.hint, bad[i].hint)))
			fail_msg("%s: %d %s (%s)", bad[i].text, out.code, out.err.message, out.err.hint);
	}
	(void)state;
}

/* ASCII and U+10FFFF as UTF-16. '~' becomes that. */
static size_t utf16(const char *text, bool big, uint8_t *to)
{
	size_t n = 0;

	for (const char *p = text; *p; p++) {
		unsigned units[2] = {(unsigned char)*p, 0};

		if (*p == '~') {
			units[0] = 0xdbff;
			units[1] = 0xdfff;
		}
		for (int i = 0; i < (units[1] ? 2 : 1); i++) {
			to[n++] = (uint8_t)(big ? units[i] >> 8 : units[i]);
			to[n++] = (uint8_t)(big ? units[i] : units[i] >> 8);
		}
	}
	return n;
}

static void wide_text(void **state)
{
	enum { LINES = 60000 };
	char *text = malloc(LINES * 48);
	uint8_t *bytes = malloc(LINES * 48 * 2 + 2);

	for (int big = 0; big < 2; big++) {
		size_t size = 0, n;
		struct outcome out, want;

		/* comments of every length: characters lie across the ends of pieces */
		for (int i = 0; i < LINES; i++)
			size += (size_t)sprintf(text + size, "%d.5 %d %d %.*s~\r\n", i, i % 977, i % 7, i % 9, "~~~~~~~~~");
		memcpy(bytes, big ? "\xfe\xff" : "\xff\xfe", 2);
		n = 2 + utf16(text, big, bytes + 2);
		want = fixture_read(text, size, "a.xyz", &(struct input_options){0}, 1000);
		out = fixture_read(bytes, n, "a", &(struct input_options){0}, 1000);
		if (out.code || out.points != LINES || want.points != LINES)
			fail_msg("%d: %s %llu", big, out.err.message, (unsigned long long)out.points);
		assert_memory_equal(out.info.coords.min, want.info.coords.min, sizeof out.info.coords.min);
		assert_memory_equal(out.info.coords.max, want.info.coords.max, sizeof out.info.coords.max);
		/* a count of points, by content; half a character at the end */
		n = 2 + utf16("2\r\n1 2 3\r\n4 5 6 \r\n", big, bytes + 2);
		out = fixture_read(bytes, n + 1, "a", &(struct input_options){0}, 10);
		assert_int_equal(out.code, ERR_INPUT); /* a fourth line with something that is no number */
		out = fixture_read(bytes, n, "a", &(struct input_options){0}, 10);
		assert_true(!out.code && out.points == 2 && !strcmp(out.info.format, "pts"));
		n = 2 + utf16("1 2 3\nnothing\n", big, bytes + 2);
		out = fixture_read(bytes, n, "a", &(struct input_options){0}, 10);
		assert_true(out.code == ERR_INPUT && out.err.offset == 2 && strstr(out.err.message, "\"nothing\""));
		n = 2 + utf16("1,5;2;3\n", big, bytes + 2);
		out = fixture_read(bytes, n, "a", &(struct input_options){.decimal_comma = true}, 10);
		assert_true(!out.code && out.points == 1);
	}
	free(text);
	free(bytes);
	(void)state;
}

/* An input from a pipe: its head was read already, the rest is in the pipe. */
struct piped {
	struct input *in;
	struct input_points pts;
	int fd, pipe;
};

static struct piped piped_open(const void *head, size_t nhead, const void *rest, size_t nrest, size_t batch)
{
	struct piped p = {.fd = fixture_fd(head, nhead)};
	struct input_options options = {.has_pipe = true};
	struct err err = ERR_INIT;
	int ends[2];

	assert_int_equal(pipe(ends), 0);
	assert_int_equal(write(ends[1], rest, nrest), nrest);
	close(ends[1]);
	options.pipe = p.pipe = ends[0];
	if (input_open(p.fd, "a.xyz", &options, &p.in, &err))
		fail_msg("head of %zu: %s", nhead, err.message);
	fixture_points_new(&p.pts, batch);
	return p;
}

static void piped_close(struct piped *p)
{
	fixture_points_free(&p->pts);
	input_close(p->in);
	close(p->pipe);
	close(p->fd);
}

/* A pipe's pieces end anywhere, within a character or a pair of them. */
static void wide_pieces(void **state)
{
	enum { LINES = 100 };
	static char text[LINES * 16];
	static uint8_t bytes[LINES * 64];
	size_t size = 0, n;

	for (int i = 0; i < LINES; i++)
		size += (size_t)sprintf(text + size, "%d 5 6 ~\n", 100 + i);
	memcpy(bytes, "\xff\xfe", 2);
	n = 2 + utf16(text, false, bytes + 2);
	for (size_t head = 500; head < 540; head++) {
		struct err err = ERR_INIT;
		struct piped p = piped_open(bytes, head, bytes + head, n - head, LINES + 1);

		if (input_read(p.in, &p.pts, &err) || p.pts.n != LINES)
			fail_msg("%zu: %zu points, %s", head, p.pts.n, err.message);
		for (int i = 0; i < LINES; i++)
			assert_int_equal(p.pts.raw[i][0], (100 + i) * INT64_C(1000000000));
		piped_close(&p);
	}
	(void)state;
}

static void no_text(void **state)
{
	static const struct {
		const char *bytes;
		size_t n;
		const char *says;
	} rows[] = {
		{"1\0 \0002\0 \0003\0", 10, "UTF-16 without a byte order mark"},
		{"\0001\0 \0002\0 \0003", 10, "UTF-16 without a byte order mark"},
		{"\xff\xfe\0\0001\0\0\0", 8, "UTF-32"},
		{"\0\0\xfe\xff\0\0\0001", 8, "UTF-32"},
		{"\xff\xfe\0\xdc\0\xd8\1\2", 8, "line 1"}, /* halves of characters */
		{"\xff\xfe\3\0\4\0\5\0", 8, "line 1"},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct outcome out = fixture_read(rows[i].bytes, rows[i].n, "a.txt", &(struct input_options){0}, 10);

		if (out.code != ERR_INPUT || !strstr(out.err.message, rows[i].says))
			fail_msg("row %zu: %d %s", i, out.code, out.err.message);
	}
	(void)state;
}

/* What a pipe leaves out is counted when it is there, and said at its end; one that has nothing else is refused. */
static void left_out_of_a_pipe(void **state)
{
	for (int rest = 0; rest < 2; rest++) {
		const char *head = rest ? "1 2 3\n1 2 nan\n" : "1 2 nan\n", *more = rest ? "4 5 *\n7 8 9\n1 2 nan\n" : "4 5 *\n";
		struct err err = ERR_INIT;
		struct piped p = piped_open(head, strlen(head), more, strlen(more), 1);
		uint64_t n = 0;
		int rc;

		do {
			rc = input_read(p.in, &p.pts, &err);
			n += p.pts.n;
		} while (!rc && p.pts.n);
		assert_int_equal(n, rest ? 2 : 0);
		assert_int_equal(input_info(p.in)->left_out, rest ? 3 : 2);
		assert_int_equal(input_info(p.in)->left_out_line, rest ? 2 : 1);
		if (rest)
			assert_true(!rc && strstr(input_info(p.in)->warning, "left out"));
		else
			assert_true(rc == -ERR_INPUT && strstr(err.message, "no line has a value"));
		piped_close(&p);
	}
	(void)state;
}

/* Comments of a pipe are counted as they come, and told at its end. */
static void comments_of_a_pipe(void **state)
{
	static const char *const rests[] = {"4 5 6\n; 7 8 9\n", ""};

	for (int rest = 0; rest < 2; rest++) {
		const char *head = rest ? "x y z\n! 1 2 3\n" : "! 7 8 9\n1 2 3\n! 1 2 3\n";
		struct err err = ERR_INIT;
		struct piped p = piped_open(head, strlen(head), rests[rest], strlen(rests[rest]), 1);
		uint64_t n = 0;
		int rc;

		do {
			rc = input_read(p.in, &p.pts, &err);
			n += p.pts.n;
		} while (!rc && p.pts.n);
		assert_int_equal(n, rest ? 0 : 2);
		if (rest)
			assert_true(rc == -ERR_INPUT && strstr(err.message, "no points, but 1 comment has") && err.offset == 2);
		else
			assert_true(!rc &&
				    strstr(input_info(p.in)->warning, "2 comments have the numbers of a point and are not read, "
								      "the first is line 3"));
		piped_close(&p);
	}
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(good_shapes),        cmocka_unit_test(bad_shapes), cmocka_unit_test(wide_text),
		cmocka_unit_test(wide_pieces),        cmocka_unit_test(no_text),    cmocka_unit_test(left_out_of_a_pipe),
		cmocka_unit_test(comments_of_a_pipe),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
