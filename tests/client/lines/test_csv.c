/* CSV with a line's name in each row, and numbers as exact decimals. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <cmocka.h>

#include "io.h"
#include "lines_case.h"
#include "lines_priv.h"

static void test_numbers(void **state)
{
	static const struct {
		const char *text;
		int64_t mantissa;
		int exponent;
	} good[] = {
		{"0", 0, 0},
		{"-0.00", 0, 0},
		{"+5.", 5, 0},
		{".25", 25, -2},
		{"1e3", 1, 3},
		{"12.50E-1", 125, -2},
		{"635000.2500000001", 6350002500000001, -10},
		{"123456789012345678", 123456789012345678, 0},
		{"1234567890123456789", 123456789012345678, 1},
		{"1234567890123456700", 1234567890123456700, 0},
		{"0.1234567890123456750000000001", 123456789012345676, -18},
		{"0.1234567890123456700000000001", 123456789012345671, -18},
		{"0.123456789012345675000", 123456789012345675, -18},
		{"000000000000000000000000000000000007.5", 75, -1},
		{"0.000000000000000000000000000000000007", 7, -36},
		{"100000000000000000000000", 1, 23},
	};
	static const char *const bad[] = {"",    "-",   ".",    "e5",  "1e",    "1e+",        "1 ", " 1",
					  "nan", "inf", "0x10", "1,5", "1.2.3", "1e99999999", "--1"};

	for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
		struct decimal d = {1, 1}, want = {good[i].mantissa, good[i].exponent};

		if (!lines_number(good[i].text, strlen(good[i].text), &d) || decimal_compare(d, want))
			fail_msg("%s is %lld e %d", good[i].text, (long long)d.mantissa, d.exponent);
	}
	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
		struct decimal d;

		if (lines_number(bad[i], strlen(bad[i]), &d))
			fail_msg("\"%s\" is a number", bad[i]);
	}
}

static void test_rows(void **state)
{
	static const struct {
		const char *text, *kind, *want;
	} rows[] = {
		{"x,y,z,name\n1,2,3,a\n4,5,6,a\n7,8,9,b\n1,1,1,b\n", NULL,
		 "#1 c rows: open 1 2 3, 4 5 6\n#2 c rows: open 7 8 9, 1 1 1\n"},
		{"\xef\xbb\xbf# made by hand\r\n\r\nLine ID;Height [m];Easting;Northing\r\n a b ;0.10; 1e3;2\r\n# no\r\na b;3;4;5",
		 NULL, "#1 c rows: open 1000 2 0.1, 4 5 3\n"},
		{"E\tN\tElev\tBreakline\tkind\n1\t2\t3\tx\tlake\n2\t2\t3\tx\tlake\n3\t3\t3\ty\thard\n4\t3\t3\ty\tsoft\n", "KIND",
		 "#1 c rows [lake]: open 1 2 3, 2 2 3\n#2 c rows [soft] ! its rows have different kinds\n"},
		{"x,y,z,name\n1,2,3,\"a, \"\"b\"\"\"\n1,3,3,\"a, \"\"b\"\"\" \n", NULL, "#1 c rows: open 1 2 3, 1 3 3\n"},
		{"x,y,z,name\n1,2,,a\n1,3,3,a\n1,2,3,b\n1,2,3\n2,2,2,\n", NULL,
		 "#1 c rows ! it has no z\n#2 c rows ! a line has fewer than two vertices\n#3 c rows ! its row has no name of a line\n"
		 "#4 c rows ! its row has no name of a line\n"},
		/* not joined, over a blank line either */
		{"x,y,z,name\n1,2,3,\n4,5,,\" \"\n\n1,2,3,b\n4,5,6,b\n", NULL,
		 "#1 c rows ! its row has no name of a line\n#2 c rows ! its row has no name of a line\n#3 c rows: open 1 2 3, 4 5 6\n"},
		{"x,y,z,name\n", NULL, ""},
		{"x,y,z\n1,2,3\n", NULL,
		 "error: line 1: there is no column for the name of a line (the first line names the columns: x,y,z,name)\n"},
		{"x,y,name\n1,2,3\n", NULL,
		 "error: line 1: there is no column for z (the first line names the columns: x,y,z,name)\n"},
		{"x,e,y,z,name\n", NULL,
		 "error: line 1: two columns can be x (the easting) (the first line names the columns: x,y,z,name)\n"},
		{"x,y,z,name\n1,2,3,a\n\n4,5,six,a\n", NULL,
		 "error: line 4: z is no number: \"six\" (numbers have a decimal point; a comma only separates)\n"},
		{"x,y,z,name\n1,2,nan,a\n", NULL,
		 "error: line 2: z is no number: \"nan\" (numbers have a decimal point; a comma only separates)\n"},
		{"x,y,z,name\n1,2,1e13,a\n1,2,1,a\n", NULL, "#1 c rows ! a coordinate is beyond 1e12\n"},
		{"x,y,z,name\n1,2,3,\"a\n", NULL,
		 "error: line 2: a quoted field is not closed (the file is damaged, or no CSV; write it again)\n"},
		{"x,y,z,name\n1,2,3,\"a\"b\n", NULL,
		 "error: line 2: something follows a quoted field (the file is damaged, or no CSV; write it again)\n"},
		{"x,y,z,name\n", "sort", "error: it has no column \"sort\" (the first line has the names of the columns)\n"},
		{"", NULL,
		 "error: it is no file of lines that acut reads (these are Shapefile, GeoJSON, GeoPackage, DXF, LandXML, and CSV where it is asked for; ogr2ogr converts others)\n"},
	};
	static char text[LINES_CASE_TEXT];

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct lines_options opt = {.csv = true, .kind_field = rows[i].kind};

		assert_string_equal(lines_case_read_text("c.csv", rows[i].text, &opt, text), rows[i].want);
	}
}

/* Lines have a name in rows that follow each other; points have names of their own, or none. */
static void test_may_be(void **state)
{
	static const struct {
		const char *text;
		bool may;
	} rows[] = {
		{"x,y,z,name\n1,2,3,a\n4,5,6,a\n7,8,9,b\n1,1,1,b\n", true},
		{"Breakline;Easting;Northing;Height\nroad;1;2;3\nroad;4;5;6", true}, /* one line is said to be one */
		{"name;Easting;Northing;Height\ngnd;1;2;3\ngnd;4;5;6", false},       /* a code of points */
		{"# survey\n\nline\tE\tN\tz\n1\t1\t1\t1\n1\t2\t2\t2\n2\t1\t1\t1\n2\t2\t2\t2\n", true},
		{"x,y,z,name\n1,2,3,P1\n4,5,6,P2\n7,8,9,P3\n", false},
		{"x,y,z,name\n1,2,3,a\n4,5,6,a\n7,8,9,b\n1,2,2,c\n4,5,5,c\n", false},
		{"x,y,z,name\n1,2,3,a\n4,5,6,a\n7,8,9,b\n", false},                            /* a row alone is no line */
		{"x,y,z,name\n1,2,3,a\n4,5,6,a\n7,8,9,b\n7,8,9,b\n1,1,1,a\n1,2,1,a\n", false}, /* a comes again */
		{"x,y,z,name\n1,2,3,\n4,5,6,\n7,8,9,b\n7,8,9,b\n", false},
		{"x,y,z,class\n1,2,3,2\n4,5,6,2\n7,8,9,5\n1,1,1,5\n", false},
		{"1 2 3\n4 5 6\n", false},
		{"1,2,3\n4,5,6\n", false},
		{"acut-lines ,x,y,z,name\n,1,2,3,a\n,4,5,6,a\n,7,8,9,b\n,1,1,1,b\n", false}, /* another format */
		{"x,y,z,name\n", false},
		{"", false},
		{"x,y,z,name\n1,2,3,\"a\n", false},
		{"x,y,z,name\n1,2,3,\"a\"b\n", false},
	};
	static char text[100000];
	size_t n;

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
		if (lines_may_be(lines_case_file("m.csv", rows[i].text, strlen(rows[i].text))) != rows[i].may)
			fail_msg("\"%s\" %s", rows[i].text, rows[i].may ? "is no file of lines" : "may be lines");
	assert_false(lines_may_be("/"));
	assert_false(lines_may_be("/nowhere/at/all"));
	/* Only the beginning is read: its last line may go on, and one line alone says nothing there. */
	for (unsigned lines = 1; lines <= 2; lines++) {
		n = (size_t)sprintf(text, "x,y,z,line\n");
		for (unsigned i = 0; n < sizeof text - 100; i++)
			n += (size_t)sprintf(text + n, "%u,2,3,%s\n", i, lines == 2 && i < 3 ? "a" : "b");
		assert_int_equal(lines_may_be(lines_case_file("m.csv", text, n)), lines == 2);
	}
}

static void test_places(void **state)
{
	const struct lines_options opt = {.csv = true};
	const struct lines_feature *f;
	struct err err = ERR_INIT;
	struct lines *l;
	char buf[1024];
	static const char rows[] = "x,y,z,name\n1,2,3,a\n1,2,4,a\n\n# b\n1,2,,b\n1,1,1,c\n1,1,1\n";

	lines_case_file("p.csv", rows, sizeof rows - 1);
	assert_int_equal(lines_open(lines_case_path("p.csv"), &opt, &l, &err), 0);
	assert_int_equal(lines_next(l, &f, &err), 0);
	assert_int_equal(f->place, 2);
	assert_int_equal(lines_next(l, &f, &err), 0);
	assert_int_equal(f->place, 6);
	assert_int_equal(lines_refusal(l, f, &err), -ERR_INPUT);
	*err.file = 0;
	assert_string_equal(err_format(&err, buf, sizeof buf),
			    "line 6, feature 2: rows of layer p cannot be used: it has no z "
			    "(give its vertices heights before: nothing is draped onto the points)");
	assert_int_equal(lines_next(l, &f, &err), 0);
	err = ERR_INIT;
	lines_refusal(l, f, &err);
	assert_non_null(strstr(err_format(&err, buf, sizeof buf),
			       "line 7, feature 3: rows of layer p cannot be used: a line has fewer than "
			       "two vertices (mend it in the program that wrote it"));
	assert_int_equal(lines_next(l, &f, &err), 0);
	err = ERR_INIT;
	lines_refusal(l, f, &err);
	assert_non_null(strstr(err_format(&err, buf, sizeof buf),
			       "line 8, feature 4: rows of layer p cannot be used: its row has no name of a line (give each row "
			       "the name of its line: rows of one name, one after the other, are a line)"));
	lines_close(l);
}

static int later(void *ctx)
{
	int *left = ctx;

	return --*left < 0;
}

/* Whenever it is interrupted, it ends, and is not read further. */
static void test_interrupted(void **state)
{
	char rows[2000] = "x,y,z,name\n";
	unsigned ended = 0;

	for (int i = 0; i < 50; i++)
		sprintf(rows + strlen(rows), "%d,2,3,%d\n", i, i / 2);
	lines_case_file("i.csv", rows, strlen(rows));
	for (int n = 0; n < 40; n++) {
		int left = n;
		const struct lines_options opt = {.csv = true, .interrupted = later, .ctx = &left};
		const struct lines_feature *f = NULL;
		struct err err = ERR_INIT;
		struct lines *l = NULL;
		int rc = lines_open(lines_case_path("i.csv"), &opt, &l, &err);

		while (!rc && !(rc = lines_next(l, &f, &err)) && f)
			;
		assert_true(rc == 0 || rc == -ERR_CANCELLED);
		ended += rc == 0;
		if (rc && l)
			assert_int_not_equal(lines_next(l, &f, &err), 0);
		lines_close(l);
	}
	assert_true(ended > 5 && ended < 35);
}

static struct io_table no_open;

static int fail_open(int dirfd, const char *path, int flags, mode_t mode)
{
	(void)dirfd, (void)path, (void)flags, (void)mode;
	fail_msg("%s is opened", path);
	return -1;
}

/* A text is a file of lines only where that is asked for; a folder, a pipe and nothing never are. */
static void test_recognise(void **state)
{
	char text[LINES_CASE_TEXT];

	assert_null(lines_recognise(lines_case_file("q.csv", "x,y,z,name\n", 11)));
	assert_null(lines_recognise("/"));
	assert_null(lines_recognise("/dev/null"));
	/* A pipe is not opened: its writer would find it closed. */
	assert_int_equal(mkfifo(lines_case_path("pipe"), 0600), 0);
	no_open = io_system;
	no_open.openat = fail_open;
	io = &no_open;
	assert_null(lines_recognise(lines_case_path("pipe")));
	io = &io_system;
	assert_null(lines_recognise("/nowhere/at/all"));
	assert_string_equal(lines_case_read("/dev/null", NULL, text),
			    "error: it is not a regular file (lines are read from files only, not from pipes or folders)\n");
}

static int remove_all(void **state)
{
	lines_case_remove_all();
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_numbers),   cmocka_unit_test(test_rows),
					   cmocka_unit_test(test_may_be),    cmocka_unit_test(test_places),
					   cmocka_unit_test(test_recognise), cmocka_unit_test(test_interrupted)};

	return cmocka_run_group_tests(tests, NULL, remove_all);
}
