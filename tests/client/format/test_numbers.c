/*
 * Numbers of vertices beyond 2^32. What is made of triangles in any order (rasters, lines, pictures, triangles in canonical
 * order) does not depend on them; what has them in text has them in full.
 */
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
#include "folder.h"
#include "meshes.h"
#include "outputs.h"

#define FAR (3ull << 32 | 5)

static char *written(const struct format *f, uint64_t first, bool canonical, size_t *ret_size)
{
	const struct outputs_options ropt = {0};
	struct format_options opt = meshes_options(f);
	struct acut_mesh_sink sink;
	struct outputs *run;
	struct err err = ERR_INIT;
	struct meshes m;

	opt.canonical = canonical;
	opt.width = f->takes & FORMAT_SIZED ? 200 : 0;
	meshes_make(&m, &meshes_many);
	for (size_t b = 0; b < m.nblock; b++) {
		m.block[b].first += first;
		for (uint32_t k = 0; k < m.block[b].nforeign; k++)
			((uint64_t *)m.block[b].foreign)[k] += first;
	}
	assert_int_equal(outputs_new(&ropt, &run, &err), 0);
	assert_int_equal(outputs_add(run, folder_out, f, &opt, &err), 0);
	sink = outputs_sink(run);
	assert_int_equal(meshes_send(&m, &sink, SIZE_MAX), 0);
	assert_int_equal(outputs_publish(run, &err), 0);
	outputs_free(run);
	meshes_done(&m);
	return folder_file(folder_out, ret_size);
}

static void test_far_numbers(void **state)
{
	size_t n, tested = 0;
	const struct format *const *row = format_rows(&n);

	for (size_t i = 0; i < n; i++) {
		size_t size[2];
		char *bytes[2];

		bool canonical = row[i]->takes & FORMAT_CANONICAL;

		if (row[i]->kind == FORMAT_NOTHING || (row[i]->kind == FORMAT_MESH && !canonical))
			continue;
		bytes[0] = written(row[i], 0, canonical, &size[0]);
		bytes[1] = written(row[i], FAR, canonical, &size[1]);
		assert_int_equal(size[0], size[1]);
		assert_memory_equal(bytes[0], bytes[1], size[0]);
		free(bytes[0]);
		free(bytes[1]);
		tested++;
	}
	assert_true(tested >= 10);
}

/* Texts are the same but for numbers, each of which is greater by as much. */
static void test_far_texts(void **state)
{
	static const char *const formats[] = {"obj", "landxml"};

	for (size_t i = 0; i < sizeof formats / sizeof *formats; i++) {
		const struct format *f = format_find(formats[i]);
		size_t size[2], numbers = 0, at[2] = {0, 0};
		char *bytes[2] = {written(f, 0, false, &size[0]), written(f, FAR, false, &size[1])};

		while (at[0] < size[0] && at[1] < size[1]) {
			char *end[2];

			if (bytes[0][at[0]] == bytes[1][at[1]]) {
				at[0]++;
				at[1]++;
				continue;
			}
			for (int k = 0; k < 2; k++)
				while (at[k] && bytes[k][at[k] - 1] >= '0' && bytes[k][at[k] - 1] <= '9')
					at[k]--;
			assert_int_equal(strtoull(bytes[0] + at[0], &end[0], 10) + FAR, strtoull(bytes[1] + at[1], &end[1], 10));
			for (int k = 0; k < 2; k++)
				at[k] = (size_t)(end[k] - bytes[k]);
			numbers++;
		}
		assert_true(at[0] == size[0] && at[1] == size[1] && numbers > 10000);
		free(bytes[0]);
		free(bytes[1]);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_far_numbers), cmocka_unit_test(test_far_texts)};

	return folder_run(tests);
}
