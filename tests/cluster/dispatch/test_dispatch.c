/* Texts that are exchanged with Slurm, and logs of tasks. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "dispatch_priv.h"
#include "err.h"

static bool never(void *ctx, unsigned phase, uint32_t index)
{
	return false;
}

static struct dispatch *a_run(void)
{
	static const struct dispatch_phase phase[] = {{"stage", 5, 0, 0}, {"mesh", 3000, 0, 0}};
	const struct dispatch_options o = {.id = "00ff", .work = "/w", .task = "/t", .phase = phase, .nphase = 2, .done = never};
	struct dispatch *d = NULL;
	struct err err = ERR_INIT;

	assert_int_equal(dispatch_new("slurm", &o, &d, &err), 0);
	return d;
}

static void test_ranges(void **state)
{
	static const uint32_t list[] = {0, 1, 2, 5, 7, 8, 1000};
	char buf[64], tight[40];

	assert_int_equal(dispatch_ranges(list, 7, 0, buf, sizeof buf), 7);
	assert_string_equal(buf, "0-2,5,7-8,1000");
	assert_int_equal(dispatch_ranges(list + 6, 1, 999, buf, sizeof buf), 1);
	assert_string_equal(buf, "1");
	assert_int_equal(dispatch_ranges(list, 0, 0, buf, sizeof buf), 0);
	assert_string_equal(buf, "");
	/* What does not fit is for the next array. */
	assert_int_equal(dispatch_ranges(list, 7, 0, tight, 32), 6);
	assert_string_equal(tight, "0-2,5,7-8");
}

static void test_rows(void **state)
{
	static const struct {
		const char *text;
		bool good;
		unsigned phase;
		uint32_t index, job;
		enum dispatch_state state;
		enum dispatch_why why;
		uint32_t last;
	} rows[] = {
		{"12|3|RUNNING|None|acut-00ff-stage", true, 0, 3, 12, DISPATCH_RUNNING, DISPATCH_WHY_NONE},
		{"12|4|PENDING|Resources|acut-00ff-stage", true, 0, 4, 12, DISPATCH_WAITING, DISPATCH_WHY_NONE},
		{"12|4|COMPLETED|None|acut-00ff-stage", true, 0, 4, 12, DISPATCH_ENDED, DISPATCH_WHY_NONE},
		{"12|4|OUT_OF_MEMORY|OutOfMemory|acut-00ff-stage", true, 0, 4, 12, DISPATCH_ENDED, DISPATCH_WHY_MEMORY},
		{"12|4|TIMEOUT|TimeLimit|acut-00ff-stage", true, 0, 4, 12, DISPATCH_ENDED, DISPATCH_WHY_TIME},
		{"12|4|CANCELLED|None|acut-00ff-stage", true, 0, 4, 12, DISPATCH_ENDED, DISPATCH_WHY_CANCELLED},
		{"12|4|NODE_FAIL|None|acut-00ff-stage", true, 0, 4, 12, DISPATCH_ENDED, DISPATCH_WHY_NODE},
		{"12|4|SOMETHING_NEW|None|acut-00ff-stage", true, 0, 4, 12, DISPATCH_WAITING, DISPATCH_WHY_NONE},
		{"13|7|PENDING|Dependency|acut-00ff-mesh-1001", true, 1, 1008, 13, DISPATCH_WAITING, DISPATCH_WHY_NONE},
		{"13|1998|PENDING|Dependency|acut-00ff-mesh-1001", true, 1, 2999, 13, DISPATCH_WAITING, DISPATCH_WHY_NONE},
		{"13|[1-4]|CANCELLED|DependencyNeverSatisfied|acut-00ff-mesh", true, 1, 1, 13, DISPATCH_ENDED,
		 DISPATCH_WHY_DEPENDENCY, 4},
		{"13|1-4,7-9%2|PENDING|Dependency|acut-00ff-mesh", true, 1, 1, 13, DISPATCH_WAITING, DISPATCH_WHY_NONE, 4},
		{"13|1-|PENDING|Dependency|acut-00ff-mesh", .good = false},
		{"13|99999999999999999999|PENDING|Dependency|acut-00ff-mesh", .good = false},
		{"13|1999|PENDING|Dependency|acut-00ff-mesh-1001", .good = false},
		{"12|5|RUNNING|None|acut-00ff-stage", .good = false},
		{"12|3|RUNNING|None|acut-00fe-stage", .good = false},
		{"12|3|RUNNING|None|acut-00ff-stages", .good = false},
		{"12|3|RUNNING|None|acut-00ff-stage-x", .good = false},
		{"12|N/A|RUNNING|None|acut-00ff-stage", .good = false},
		{"12|3|RUNNING|None", .good = false},
		{"", .good = false},
	};
	struct dispatch *d = a_run();

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		char text[128];
		struct dispatch_row r;
		uint32_t from, to;

		strcpy(text, rows[i].text);
		assert_int_equal(dispatch_row_read(d, text, &r) && dispatch_row_next(d, &r, &from, &to), rows[i].good);
		if (!rows[i].good)
			continue;
		assert_int_equal(r.phase, rows[i].phase);
		assert_int_equal(from, rows[i].index);
		assert_int_equal(to, rows[i].last ? rows[i].last : rows[i].index);
		assert_int_equal(r.job, rows[i].job);
		assert_int_equal(r.state, rows[i].state);
		assert_int_equal(r.why, rows[i].why);
	}
	{
		char text[] = "13|1-4,7,9-9%2|PENDING|Dependency|acut-00ff-mesh-100";
		static const uint32_t runs[][2] = {{101, 104}, {107, 107}, {109, 109}};
		struct dispatch_row r;
		uint32_t from, to;

		assert_true(dispatch_row_read(d, text, &r));
		for (int i = 0; i < 3; i++) {
			assert_true(dispatch_row_next(d, &r, &from, &to));
			assert_int_equal(from, runs[i][0]);
			assert_int_equal(to, runs[i][1]);
		}
		assert_false(dispatch_row_next(d, &r, &from, &to));
	}
	dispatch_free(d);
}

static void test_numbers(void **state)
{
	uint64_t n = 0;
	uint32_t job = 0;

	assert_true(dispatch_config_number("KillWait = 30 sec\nMaxArraySize            = 1001\nMaxJobCount = 1\n", "MaxArraySize",
					   &n));
	assert_int_equal(n, 1001);
	assert_false(dispatch_config_number("XMaxArraySize = 5\n", "MaxArraySize", &n));
	assert_false(dispatch_config_number("MaxArraySizes = 5\n", "MaxArraySize", &n));
	assert_false(dispatch_config_number("", "MaxArraySize", &n));
	assert_true(dispatch_job_read("4711\n", &job));
	assert_int_equal(job, 4711);
	assert_true(dispatch_job_read("12;cluster\n", &job));
	assert_int_equal(job, 12);
	assert_false(dispatch_job_read("Submitted batch job 5", &job));
	assert_false(dispatch_job_read("0", &job));
	assert_false(dispatch_job_read("99999999999", &job));
	assert_false(dispatch_job_read("", &job));
}

#define BEGIN(host) "acut-cluster: mesh 17 begins on " host ", job 5, start 0\n"
#define END(status) "acut-cluster: mesh 17 ends with status " status "\n"

static void test_logs(void **state)
{
	static const struct {
		const char *text;
		unsigned begun;
		bool ended;
		int status;
		enum dispatch_why why;
		const char *host, *tail;
	} rows[] = {
		{"", 0, false, 0, DISPATCH_WHY_NONE, "", ""},
		{BEGIN("n1") "some\nwords\n" END("0"), 1, true, 0, DISPATCH_WHY_NONE, "n1", "some; words"},
		{BEGIN("n1") "no space\n" END("74"), 1, true, 74, DISPATCH_WHY_STATUS, "n1", "no space"},
		{BEGIN("n1"), 1, false, 0, DISPATCH_WHY_NODE, "n1", ""},
		{BEGIN("n1") "slurmstepd: error: *** JOB 5 ON n1 CANCELLED AT 2026-01-01T00:00:00 DUE TO TIME LIMIT ***\n", 1,
		 false, 0, DISPATCH_WHY_TIME, "n1",
		 "slurmstepd: error: *** JOB 5 ON n1 CANCELLED AT 2026-01-01T00:00:00 DUE TO TIME LIMIT ***"},
		{BEGIN("n1") "slurmstepd: error: *** JOB 5 ON n1 CANCELLED AT 2026-01-01T00:00:00 ***\n", 1, false, 0,
		 DISPATCH_WHY_CANCELLED, "n1", "slurmstepd: error: *** JOB 5 ON n1 CANCELLED AT 2026-01-01T00:00:00 ***"},
		{BEGIN("n1") END("137") "slurmstepd: error: Detected 1 oom-kill event(s) in StepId=5.batch.\n", 1, true, 137,
		 DISPATCH_WHY_MEMORY, "n1", ""},
		{BEGIN("n1") BEGIN("n2") "x\n" END("0"), 2, true, 0, DISPATCH_WHY_NONE, "n2", "x"},
		{"acut-cluster: mesh 17 starts\n", 0, false, 0, DISPATCH_WHY_NONE, "", "acut-cluster: mesh 17 starts"},
	};
	struct dispatch_log log;
	char *many;

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		dispatch_log_parse(rows[i].text, strlen(rows[i].text), &log);
		assert_int_equal(log.begun, rows[i].begun);
		assert_int_equal(log.ended, rows[i].ended);
		assert_int_equal(log.status, rows[i].status);
		assert_int_equal(log.why, rows[i].why);
		assert_string_equal(log.host, rows[i].host);
		assert_string_equal(log.tail, rows[i].tail);
	}
	/* Any bytes, and lines without an end: the tail stays in its place. */
	many = malloc(70000);
	assert_non_null(many);
	for (unsigned k = 0; k < 70000; k++)
		many[k] = (char)(k * 7 % 31 ? 1 + k % 255 : '\n');
	for (size_t n = 0; n < 70000; n = n * 3 + 1)
		dispatch_log_parse(many, n, &log);
	memset(many, 'a', 70000);
	dispatch_log_parse(many, 70000, &log);
	assert_true(strlen(log.tail) < sizeof log.tail);
	free(many);
}

static void test_commands(void **state)
{
	const char *const cat[] = {"cat", NULL}, *const none[] = {"no-such-program-here", NULL};
	const char *const fails[] = {"sh", "-c", "echo it is so >&2; exit 3", NULL}, *const slow[] = {"sleep", "30", NULL};
	char *out = NULL, *big = malloc(300001);
	struct err err = ERR_INIT;

	memset(big, 'x', 300000);
	big[300000] = 0;
	assert_int_equal(dispatch_command(cat, big, 10, &out, &err), 0);
	assert_string_equal(out, big);
	free(out);
	free(big);
	assert_int_equal(dispatch_command(none, NULL, 10, NULL, &err), -ERR_NODAEMON);
	err_clear(&err);
	assert_int_equal(dispatch_command(fails, "input that nobody reads", 10, NULL, &err), -ERR_IO);
	assert_non_null(strstr(err.message, "status 3: it is so"));
	err_clear(&err);
	assert_int_equal(dispatch_command(slow, NULL, 0.2, NULL, &err), -ERR_BUSY);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_ranges), cmocka_unit_test(test_rows),     cmocka_unit_test(test_numbers),
		cmocka_unit_test(test_logs),   cmocka_unit_test(test_commands),
	};

	return cmocka_run_group_tests_name("dispatch", tests, NULL, NULL);
}
