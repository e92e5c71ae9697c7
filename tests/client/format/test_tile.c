/* Tiles: the same files whatever the memory, also of a tile that does not fit it; what comes back from the sort is what
 * went in; the folder is as it was when nothing was published; a stream that does not keep to its own box. */
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
#include "outputs.h"
#include "meshes.h"
#include "no_sync.h"

/* meshes_many, moved across x = 0. */
static struct meshes_spec many;

static int stop_after;

static int stop(void *ctx)
{
	return stop_after >= 0 && stop_after-- == 0;
}

static int write_tiles(const struct meshes *m, const char *out, const char *format, const char *side, uint64_t memory,
		       struct outputs_report *report, struct err *err)
{
	struct outputs_options ropt = {.tiled = true, .sort_memory = memory, .interrupted = stop};
	const struct format_options opt = {.width = strcmp(format, "png") ? 0 : 50};

	assert_true(decimal_parse(side, &ropt.tile));
	return meshes_write(m, out, format_find(format), &opt, &ropt, report, err);
}

static void test_memory(void **state)
{
	static const char *const side[] = {"1000", "3.2", "1.9"};
	static const char *const format[] = {"ply", "obj", "png"};
	struct meshes m;

	meshes_make(&m, &many);
	for (unsigned i = 0; i < 7; i++) {
		struct outputs_report large, little;
		struct err err = ERR_INIT;
		char a[512], b[512], name[16];

		stop_after = -1;
		snprintf(name, sizeof(name), "large%u", i);
		assert_int_equal(write_tiles(&m, folder_path(name, a), format[i % 3], side[i / 3], 0, &large, &err), 0);
		snprintf(name, sizeof(name), "little%u", i);
		assert_int_equal(write_tiles(&m, folder_path(name, b), format[i % 3], side[i / 3], 256 << 10, &little, &err), 0);
		assert_int_equal(large.tiles + 1, folder_count(a));
		assert_int_equal(large.bytes, little.bytes);
		assert_true(i / 3 == 0 ? large.tiles == 2 : large.tiles > 10);
		folder_same(a, b);
	}
	meshes_done(&m);
}

/* Asked between tiles: a folder that was made goes again, at each of the first moments. */
static void test_interrupted(void **state)
{
	struct outputs_report report;
	struct meshes m;
	char a[512];

	meshes_make(&m, &many);
	for (int n = 0; n < 12; n++) {
		struct err err = ERR_INIT;

		stop_after = n;
		assert_int_equal(write_tiles(&m, folder_path("stopped", a), "ply", "3.2", 0, &report, &err), -ERR_CANCELLED);
		assert_int_equal(folder_count(a), -1);
	}
	stop_after = -1;
	meshes_done(&m);
}

static void test_outside(void **state)
{
	struct outputs_report report;
	struct err err = ERR_INIT;
	struct meshes m;
	char a[512];

	meshes_make(&m, &many);
	m.head.box[3] -= 1000;
	assert_int_equal(write_tiles(&m, folder_path("outside", a), "ply", "1", 0, &report, &err), -ERR_PROTO);
	assert_non_null(strstr(err.message, "outside of the box"));
	assert_int_equal(folder_count(a), -1);
	meshes_done(&m);
}

/* A mesh may not have two heights in one place; welding would hide it. */
static void test_two_heights(void **state)
{
	struct outputs_report report;
	struct err err = ERR_INIT;
	struct meshes m;
	char a[512];
	int32_t(*v)[3];

	meshes_make(&m, &many);
	v = (int32_t(*)[3])m.block[1].vertex;
	v[1][0] = v[0][0];
	v[1][1] = v[0][1];
	v[1][2] = v[0][2] + 1;
	assert_int_equal(write_tiles(&m, folder_path("heights", a), "ply", "1000", 0, &report, &err), -ERR_PROTO);
	assert_non_null(strstr(err.message, "two heights"));
	meshes_done(&m);
}

static void test_numbers(void **state)
{
	struct meshes_spec far = many;
	struct outputs_report report;
	struct err err = ERR_INIT;
	struct meshes m;
	char a[512], *text;
	size_t n;

	/* The ends of what a lattice may have: no sum is cut off. */
	far.k[0] = INT64_MAX / 2;
	far.k[1] = -(INT64_MAX / 2);
	far.scale_xy = "1";
	far.step = 1;
	meshes_make(&m, &far);
	assert_int_equal(write_tiles(&m, folder_path("far", a), "obj", "4611686018427387904", 0, &report, &err), 0);
	assert_int_equal(report.tiles, 1);
	text = folder_read(a, "index.geojson", &n);
	assert_non_null(strstr(text, "\"column\":0,\"row\":-1"));
	free(text);
	assert_int_equal(write_tiles(&m, folder_path("small", a), "obj", "0.000000001", 0, &report, &err), -ERR_USAGE);
	meshes_done(&m);
}

/* A limit that memory gives is one of tiles of triangles: a raster divides itself. */
static void test_most(void **state)
{
	struct outputs_options ropt = {.tiled = true, .tiles_most = 3};
	struct outputs_report report;
	struct err err = ERR_INIT;
	struct meshes m;
	char a[512];

	meshes_make(&m, &many);
	assert_true(decimal_parse("3.2", &ropt.tile));
	for (unsigned i = 0; i < 2; i++) {
		const struct format *f = format_find(i ? "ply" : "tif");
		const struct format_options opt = meshes_options(f);

		assert_int_equal(meshes_write(&m, folder_path(f->name, a), f, &opt, &ropt, &report, &err), i ? -ERR_USAGE : 0);
	}
	assert_true(report.tiles > 3);
	assert_non_null(strstr(err.message, "more than 3 tiles"));
	assert_non_null(strstr(err.hint, "--task-memory"));
	meshes_done(&m);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_memory),      cmocka_unit_test(test_interrupted), cmocka_unit_test(test_outside),
		cmocka_unit_test(test_two_heights), cmocka_unit_test(test_numbers),     cmocka_unit_test(test_most),
	};

	many = meshes_many;
	many.k[0] = -700;
	no_sync();
	return folder_run(tests);
}
