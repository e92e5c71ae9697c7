/* The report of a window out of the tail of its stream: members by name, others passed over, and what is no report refused. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "ctl_fetch.h"
#include "err.h"

static int tail_of(const char *report, struct ctl_window *w, struct err *err)
{
	const struct acut_mesh_tail tail = {.vertices = 7, .triangles = 9, .digest = "d", .vertex_digest = "v", .report = report};

	memset(w, 0x55, sizeof *w);
	*err = ERR_INIT;
	return ctl_window_tail(w, &tail, err);
}

static void test_members(void **state)
{
	struct ctl_window w;
	struct err err;

	assert_int_equal(
		tail_of("{\"points\":5,\"other\":[{\"points\":6}],\"points_read\":18446744073709551615,\"cells_read\":3,"
			"\"seconds\":1.250000,\"peak_rss_bytes\":4,\"note\":\"of \\\"it\\\"\",\"removed\":{\"kept\":8},"
			"\"max_error\":\"0.5\",\"largest_error\":\"0.4\",\"positions\":10,\"kept\":11,\"rounds\":12,\"attempts\":13}",
			&w, &err),
		0);
	assert_true(w.report.window && w.report.vertices == 7 && w.report.triangles == 9);
	assert_true(w.report.points == 5 && w.report.points_read == UINT64_MAX && w.report.cells_read == 3);
	assert_true(w.report.seconds == 1.25 && w.report.peak_rss_bytes == 4 && w.report.domains == 0);
	assert_true(w.report.positions == 10 && w.report.kept == 11 && w.report.rounds == 12 && w.report.attempts == 13);
	assert_string_equal(w.report.note, "of \"it\"");
	assert_string_equal(w.report.max_error, "0.5");
	assert_string_equal(w.report.largest_error, "0.4");
	assert_string_equal(w.report.digest, "d");
	assert_string_equal(w.report.vertex_digest, "v");
	assert_int_equal(tail_of("{}", &w, &err), 0);
	assert_string_equal(w.report.note, "");
}

static void test_refused(void **state)
{
	static const char *const row[] = {"",
					  "[]",
					  "{\"points\":5",
					  "{\"points\":-5}",
					  "{\"points\":\"5\"}",
					  "{\"note\":7}",
					  "{\"seconds\":abc}",
					  "{\"seconds\":1e999}",
					  "{} garbage",
					  "{\"points\":1}{"};

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		struct ctl_window w;
		struct err err;

		assert_int_equal(tail_of(row[i], &w, &err), -ERR_PROTO);
		assert_non_null(strstr(err.message, "the report of the window cannot be read"));
		assert_int_equal(strncmp(err.field, "byte ", 5), 0);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_members), cmocka_unit_test(test_refused)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
