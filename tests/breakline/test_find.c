/* Which feature a piece is of, when the piece is near its segment: in the middle of a line, at the end of a ring. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <fcntl.h>
#include <unistd.h>

#include <cmocka.h>

#include "breakline.h"
#include "err.h"
#include "repeat.h"

enum { FIRST = BREAKLINE_FEATURE | BREAKLINE_LINE };

static const struct breakline_vertex vertex[] = {
	{0, 0, 1, FIRST, BREAKLINE_HARD, 0, 40},    {100, 0, 1, 0, BREAKLINE_HARD, 0, 40},
	{100, 100, 1, 0, BREAKLINE_HARD, 0, 40},    {1000, 1000, 1, BREAKLINE_LINE, BREAKLINE_HARD, 0, 40},
	{-1000, 1000, 1, 0, BREAKLINE_HARD, 0, 40}, {200, 200, 1, FIRST | BREAKLINE_RING, BREAKLINE_LAKE, 0, 41},
	{300, 200, 1, 0, BREAKLINE_LAKE, 0, 41},    {300, 300, 1, 0, BREAKLINE_LAKE, 0, 41},
};

static const struct {
	int32_t a[2], b[2];
	uint32_t number;
	double distance;
} row[] = {
	{{10, 1}, {60, 0}, 40, 1},       {{100, 3}, {100, 90}, 40, 0},    {{900, 998}, {-900, 1001}, 40, 2},
	{{290, 290}, {210, 210}, 41, 0}, {{300, 210}, {301, 300}, 41, 1}, {{150, 0}, {200, 200}, 40, 141.42135623731},
};

static void test_find(void **state)
{
	struct breakline_writer *w;
	struct breakline_totals t;
	struct err err = ERR_INIT;
	char path[128];
	int dirfd;

	repeat_folder(path, sizeof path, "breakline-find");
	dirfd = open(path, O_RDONLY | O_DIRECTORY);
	assert_true(dirfd >= 0);
	assert_int_equal(breakline_writer_new(dirfd, "lines-1", &w, &err), 0);
	assert_int_equal(breakline_write(w, vertex, sizeof vertex / sizeof *vertex, &err), 0);
	assert_int_equal(breakline_writer_finish(w, &t, &err), 0);
	breakline_writer_free(w);
	for (unsigned i = 0; i < sizeof row / sizeof *row; i++) {
		uint32_t number = 0;
		double distance = -1;

		assert_int_equal(breakline_find(dirfd, "lines-1", row[i].a, row[i].b, &distance, &number, &err), 0);
		if (number != row[i].number || fabs(distance - row[i].distance) > 1e-6)
			fail_msg("row %u: feature %u at %.9g", i, number, distance);
	}
	assert_int_not_equal(breakline_find(dirfd, "lines-2", row[0].a, row[0].b, &(double){0}, &(uint32_t){0}, &err), 0);
	close(dirfd);
	assert_int_equal(repeat_remove(path), 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_find)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
