/*
 * The contract of every row of the format table that has `resume`: interrupted after any block, saved or not, and continued, the
 * file is that of one run.
 */
#include <dirent.h>
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <stdio.h>
#include <unistd.h>
#include <cmocka.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "err.h"
#include "folder.h"
#include "meshes.h"
#include "no_sync.h"
#include "outputs.h"

/* The faces of a block fill the buffer of an output (OUTFILE_BUFFER), so they are joined as those of large meshes are. */
static const struct meshes_spec grid = {.columns = 900,
					.rows = 150,
					.strip = 33,
					.x0 = -500,
					.y0 = 900,
					.step = 25,
					.slope_x = 3,
					.slope_y = 4,
					.scale_xy = "0.01",
					.scale_z = "0.01",
					.k = {50000000, 400000000, 0}};

/* Only the output is there. */
static void alone(void)
{
	assert_int_equal(folder_count(folder_own), 1);
	assert_int_equal(unlink(folder_out), 0);
}

/* Blocks from `from` on: to the end and published, or up to `stop`, of which the last is not saved if `lost`. Returns the number
 * of blocks that were saved. */
static size_t run(const struct format *f, const struct meshes *m, size_t from, size_t stop, bool lost)
{
	const struct outputs_options ropt = {.sort_memory = 1 << 20};
	struct format_options opt = meshes_options(f);
	struct outputs *run;
	struct acut_mesh_sink sink;
	struct err err = ERR_INIT;
	size_t size, saved = from;

	assert_int_equal(outputs_new(&ropt, &run, &err), 0);
	assert_int_equal(outputs_add(run, folder_out, f, &opt, &err), 0);
	assert_int_equal(outputs_keep(run, 1, from > 0, &err), 0);
	assert_int_equal(outputs_kept(run, &size) != NULL, from > 0);
	sink = outputs_sink(run);
	assert_int_equal(sink.head(sink.ctx, &m->head), 0);
	for (size_t i = from; i < m->nblock && i < stop; i++) {
		assert_int_equal(meshes_block(m, &sink, i), 0);
		if (lost && i + 1 == stop)
			continue;
		assert_int_equal(outputs_save(run, "state", 5, &err), 0);
		saved = i + 1;
	}
	if (stop > m->nblock) {
		assert_int_equal(sink.tail(sink.ctx, &m->tail), 0);
		assert_int_equal(outputs_publish(run, &err), 0);
	}
	outputs_free(run);
	return saved;
}

static void test_resume(void **state)
{
	size_t n, tested = 0;
	const struct format *const *row = format_rows(&n);

	for (size_t i = 0; i < n; i++) {
		struct meshes m;
		size_t size, got_size;
		char *want;

		assert_int_equal(row[i]->resume != NULL, row[i]->save != NULL);
		if (!row[i]->resume)
			continue;
		meshes_make(&m, &grid);
		assert_true(m.nblock > 3);
		run(row[i], &m, 0, SIZE_MAX, false);
		want = folder_file(folder_out, &size);
		alone();
		for (size_t stop = 1; stop <= m.nblock; stop++)
			for (unsigned lost = 0; lost < 2; lost++) {
				char *got;
				size_t saved = stop > lost ? run(row[i], &m, 0, stop, lost) : 0;

				if (!saved)
					continue;
				run(row[i], &m, saved, SIZE_MAX, false);
				got = folder_file(folder_out, &got_size);
				alone();
				assert_int_equal(got_size, size);
				assert_memory_equal(got, want, size);
				free(got);
			}
		free(want);
		meshes_done(&m);
		tested++;
	}
	assert_true(tested >= 2);
}

/* A part that another version of acutctl has kept. */
static void test_version(void **state)
{
	const struct format *f = format_find("ply");
	const struct format_options opt = meshes_options(f);
	const struct outputs_options ropt = {.sort_memory = 1 << 20};
	struct err err = ERR_INIT;
	struct outputs *run_on;
	struct meshes m;
	char name[600], *bytes;
	uint64_t sum;
	size_t size;
	FILE *file;

	meshes_make(&m, &meshes_many);
	run(f, &m, 0, 1, false);
	snprintf(name, sizeof(name), "%s.part.state", folder_out);
	bytes = folder_file(name, &size);
	bytes[4]--;
	sum = XXH3_64bits(bytes, size - sizeof(sum));
	memcpy(bytes + size - sizeof(sum), &sum, sizeof(sum));
	file = fopen(name, "w");
	assert_int_equal(fwrite(bytes, 1, size, file), size);
	assert_int_equal(fclose(file), 0);
	free(bytes);
	assert_int_equal(outputs_new(&ropt, &run_on, &err), 0);
	assert_int_equal(outputs_add(run_on, folder_out, f, &opt, &err), 0);
	assert_int_equal(outputs_keep(run_on, 1, true, &err), -ERR_USAGE);
	assert_non_null(strstr(err.message, "another version"));
	assert_non_null(strstr(err.hint, "without --resume"));
	assert_non_null(strstr(err.file, ".part.state"));
	outputs_free(run_on);
	meshes_done(&m);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_resume), cmocka_unit_test(test_version)};

	no_sync();
	return folder_run(tests);
}
