/*
 * The memory that an untold daemon takes: cgroup limits of both versions in a made-up /proc and /sys, and the
 * rule.
 */
#include <limits.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "config.h"
#include "repeat.h"

#define MIB (UINT64_C(1) << 20)
#define GIB (UINT64_C(1) << 30)

static char root[64];

static void put(const char *path, const char *text)
{
	char full[512];
	FILE *f;

	snprintf(full, sizeof full, "%s/%s", root, path);
	for (char *at = full + strlen(root) + 1; (at = strchr(at, '/')); at++) {
		*at = 0;
		mkdir(full, 0700);
		*at = '/';
	}
	f = fopen(full, "w");
	assert_non_null(f);
	fputs(text, f);
	fclose(f);
}

static int setup(void **state)
{
	repeat_folder(root, sizeof root, "config");
	return 0;
}

static int teardown(void **state)
{
	return repeat_remove(root);
}

static void version_2(void **state)
{
	put("proc/self/cgroup", "0::/a.slice/b.service\n");
	put("sys/fs/cgroup/a.slice/b.service/memory.max", "max\n");
	assert_true(config_cgroup_limit(root) == UINT64_MAX);
	/* An ancestor's limit counts too. */
	put("sys/fs/cgroup/a.slice/memory.max", "314572800\n");
	assert_int_equal(config_cgroup_limit(root), 300 * MIB);
	put("sys/fs/cgroup/a.slice/b.service/memory.max", "104857600\n");
	assert_int_equal(config_cgroup_limit(root), 100 * MIB);
}

static void version_1(void **state)
{
	put("proc/self/cgroup", "5:cpu,cpuacct:/x\n4:memory:/docker/abc\n0::/\n");
	put("sys/fs/cgroup/memory/docker/abc/memory.limit_in_bytes", "9223372036854771712\n");
	assert_true(config_cgroup_limit(root) == UINT64_MAX);
	put("sys/fs/cgroup/memory/memory.limit_in_bytes", "536870912\n");
	assert_int_equal(config_cgroup_limit(root), 512 * MIB);
	put("sys/fs/cgroup/memory/docker/abc/memory.limit_in_bytes", "209715200\n");
	assert_int_equal(config_cgroup_limit(root), 200 * MIB);
}

static void tasks(void **state)
{
	put("proc/self/cgroup", "7:pids:/old\n0::/a.slice/b.service\n");
	assert_true(config_cgroup_tasks(root) == UINT64_MAX);
	put("sys/fs/cgroup/a.slice/pids.max", "320\n");
	put("sys/fs/cgroup/a.slice/b.service/pids.max", "max\n");
	assert_int_equal(config_cgroup_tasks(root), 320);
	put("sys/fs/cgroup/pids/old/pids.max", "12\n");
	assert_int_equal(config_cgroup_tasks(root), 12);
	assert_true(config_cgroup_limit(root) == UINT64_MAX);
}

static void none(void **state)
{
	assert_true(config_cgroup_limit(root) == UINT64_MAX);
}

static void rule(void **state)
{
	/* No limit: a quarter of the machine, at most 2 GiB. */
	assert_int_equal(config_memory(UINT64_MAX, 4 * GIB, false), GIB);
	assert_int_equal(config_memory(UINT64_MAX, 64 * GIB, false), 2 * GIB);
	/* A service with a limit takes it, less what the process needs beside. */
	assert_int_equal(config_memory(16 * GIB, 64 * GIB, false), 16 * GIB - 48 * MIB);
	assert_int_equal(config_memory(40 * MIB, 64 * GIB, false), 0);
	/* A private one is modest. */
	assert_int_equal(config_memory(16 * GIB, 64 * GIB, true), 2 * GIB);
	assert_int_equal(config_memory(100 * MIB, 64 * GIB, true), 52 * MIB);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(version_2, setup, teardown),
		cmocka_unit_test_setup_teardown(version_1, setup, teardown),
		cmocka_unit_test_setup_teardown(tasks, setup, teardown),
		cmocka_unit_test_setup_teardown(none, setup, teardown),
		cmocka_unit_test(rule),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
