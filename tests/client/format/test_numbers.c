/* What is made of triangles in any order (rasters, lines) does not depend on the numbers of vertices, however large. */
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <cmocka.h>

#include "err.h"
#include "meshes.h"
#include "outputs.h"
#include "repeat.h"

static char dir[64], out[80];

static uint8_t *written(const struct format *f, uint64_t first, size_t *ret_size)
{
	const struct outputs_options ropt = {0};
	const struct format_options opt = meshes_options(f);
	struct acut_mesh_sink sink;
	struct outputs *run;
	struct err err = ERR_INIT;
	struct stat st;
	struct meshes m;
	uint8_t *bytes;
	int fd;

	meshes_make(&m, &meshes_many);
	for (size_t b = 0; b < m.nblock; b++) {
		m.block[b].first += first;
		for (uint32_t k = 0; k < m.block[b].nforeign; k++)
			((uint64_t *)m.block[b].foreign)[k] += first;
	}
	assert_int_equal(outputs_new(&ropt, &run, &err), 0);
	assert_int_equal(outputs_add(run, out, f, &opt, &err), 0);
	sink = outputs_sink(run);
	assert_int_equal(meshes_send(&m, &sink, SIZE_MAX), 0);
	assert_int_equal(outputs_publish(run, &err), 0);
	outputs_free(run);
	meshes_done(&m);
	fd = open(out, O_RDONLY);
	assert_int_equal(fstat(fd, &st), 0);
	*ret_size = (size_t)st.st_size;
	bytes = malloc(*ret_size);
	assert_int_equal(read(fd, bytes, *ret_size), *ret_size);
	close(fd);
	unlink(out);
	return bytes;
}

static void test_far_numbers(void **state)
{
	size_t n, tested = 0;
	const struct format *const *row = format_rows(&n);

	for (size_t i = 0; i < n; i++) {
		size_t size[2];
		uint8_t *bytes[2];

		if (row[i]->kind != FORMAT_LINES && row[i]->kind != FORMAT_RASTER)
			continue;
		bytes[0] = written(row[i], 0, &size[0]);
		bytes[1] = written(row[i], 3ull << 32 | 5, &size[1]);
		assert_int_equal(size[0], size[1]);
		assert_memory_equal(bytes[0], bytes[1], size[0]);
		free(bytes[0]);
		free(bytes[1]);
		tested++;
	}
	assert_true(tested >= 4);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_far_numbers)};
	int failed;

	repeat_folder(dir, sizeof dir, "numbers");
	snprintf(out, sizeof(out), "%s/out", dir);
	failed = cmocka_run_group_tests(tests, NULL, NULL);
	rmdir(dir);
	return failed;
}
