/*
 * acut-grid-dump --check derives everything again from the records: it accepts segments of all kinds of points, and
 * finds one with valid checksums and wrong numbers.
 */
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>
#include <xxhash.h>

#include "grid_fixture.h"

static int dump(const struct folder *f, const char *options, const char *file)
{
	const char *program = getenv("ACUT_GRID_DUMP");
	char command[600];

	if (!program) {
		print_message("ACUT_GRID_DUMP does not say where acut-grid-dump is\n");
		exit(77);
	}
	snprintf(command, sizeof command, "'%s' %s '%s/%s' >/dev/null 2>&1", program, options, f->path, file);
	int rc = system(command);

	assert_true(rc != -1 && WIFEXITED(rc));
	return WEXITSTATUS(rc);
}

static void test_passes(void **state)
{
	for (int shape = 0; shape < SHAPES; shape++) {
		struct set s = set_make(shape, 60000, 9, 21), none = {0};
		struct grid_segment_info info[2];
		struct folder f = folder_new();
		struct err err = ERR_INIT;

		CHECK(stage_set(&f, "a", &s, GRID_STAGE_MIN, &info[0], &err));
		CHECK(stage_set(&f, "b", &none, 0, &info[1], &err));
		struct grid_manifest m = manifest_of(info, 2, 9);

		CHECK(grid_manifest_write(f.fd, "m", &m, &err));
		assert_int_equal(dump(&f, "--check", "m"), 0);
		assert_int_equal(dump(&f, "--check --cells --records", "a.seg"), 0);
		assert_int_equal(dump(&f, "", "absent"), 74);
		assert_int_equal(dump(&f, "--wrong", "m"), 2);
		free(m.sources);
		set_free(&s);
		folder_remove(&f);
	}
}

/* A wrong class count in the header, under a valid checksum; then a changed byte in the middle. */
static void test_finds(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, 5000, 2, 21);
	struct grid_segment_info info;
	struct folder f = folder_new();
	struct err err = ERR_INIT;
	uint8_t header[4096];

	CHECK(stage_set(&f, "a", &s, 0, &info, &err));
	int fd = openat(f.fd, info.file, O_RDWR);

	assert_int_equal(pread(fd, header, sizeof header, 0), sizeof header);
	header[128]++;
	uint64_t check = XXH3_64bits(header + 8, sizeof header - 8);

	memcpy(header, &check, sizeof check);
	assert_int_equal(pwrite(fd, header, sizeof header, 0), sizeof header);
	assert_int_equal(dump(&f, "", info.file), 0);
	assert_int_equal(dump(&f, "--check", info.file), 1);
	assert_int_equal(pwrite(fd, "x", 1, 0), 1);
	assert_int_equal(dump(&f, "", info.file), 1);
	close(fd);
	set_free(&s);
	folder_remove(&f);
}

/* A range of keys in the manifest that does not hold all records of its segment. */
static void test_range(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, 5000, 2, 21);
	struct grid_segment_info info;
	struct folder f = folder_new();
	struct err err = ERR_INIT;

	CHECK(stage_set(&f, "a", &s, 0, &info, &err));
	info.hi--;
	struct grid_manifest m = manifest_of(&info, 1, 2);

	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	assert_int_equal(dump(&f, "", "m"), 0);
	assert_int_equal(dump(&f, "--check", "m"), 1);
	info.hi++;
	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	assert_int_equal(dump(&f, "--check", "m"), 0);
	free(m.sources);
	set_free(&s);
	folder_remove(&f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_passes), cmocka_unit_test(test_finds),
					   cmocka_unit_test(test_range)};

	no_sync();
	return cmocka_run_group_tests_name("grid: dumper", tests, NULL, NULL);
}
