/* Levels of detail: the same files whatever the order of triangles, the memory and the blocks; a folder as it was where anything
 * fails; what is no mesh is refused. What the tiles have is compared with the mesh by tests/formats/levels.py. */
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>
#include <cmocka.h>

#include "err.h"
#include "folder.h"
#include "levels.h"
#include "meshes.h"
#include "outfile.h"
#include "outputs.h"

static int stop_after = -1;

static int stop(void *ctx)
{
	return stop_after >= 0 && stop_after-- == 0;
}

/* ---- the room: small leaves ---- */

enum { SIDE = 60, STEP = 97, LEAF = 64 };

/* A corner of the grid: moved by less than half a step. */
static void place(uint32_t column, uint32_t row, int32_t ret[3])
{
	uint32_t h = (column * 7919 + row) * 2654435761u;

	ret[0] = (int32_t)(column * STEP + (h >> 8) % 40) - 1000;
	ret[1] = (int32_t)(row * STEP + (h >> 16) % 40) + 77;
	ret[2] = (int32_t)(h >> 20) - 2000;
}

static int add_square(struct levels *lv, uint32_t column, uint32_t row, struct err *err)
{
	int32_t a[3], b[3], c[3], d[3];
	int r;

	place(column, row, a);
	place(column + 1, row, b);
	place(column + 1, row + 1, c);
	place(column, row + 1, d);
	r = levels_triangle(lv, (const int32_t *const[3]){b, c, a}, err);
	return r ? r : levels_triangle(lv, (const int32_t *const[3]){a, c, d}, err);
}

struct folder {
	struct outfile_folder *place;
	struct outfile *beside;
	struct levels *levels;
};

static void folder_open(struct folder *f, const char *path, uint64_t memory, struct err *err)
{
	struct levels_options opt = {.leaf = LEAF, .memory = memory};
	const int32_t low[2] = {-1000, 77}, high[2] = {SIDE * STEP - 960, SIDE * STEP + 117};

	assert_int_equal(outfile_folder_new(path, "index", false, &f->place, err), 0);
	assert_int_equal(outfile_folder_file(f->place, "index", &f->beside, err), 0);
	opt.folder = f->place;
	opt.beside = f->beside;
	assert_int_equal(levels_new(&opt, &f->levels, err), 0);
	assert_int_equal(levels_box(f->levels, low, high, err), 0);
}

static void folder_close(struct folder *f)
{
	levels_free(f->levels);
	outfile_free(f->beside);
	outfile_folder_free(f->place);
}

static void folder_move(struct folder *f, struct err *err)
{
	char name[OUTFILE_NAME];

	for (size_t i = 0; i < levels_tiles(f->levels); i++)
		assert_int_equal(outfile_folder_move(f->place, levels_name(f->levels, i, name), err), 0);
	outfile_folder_keep(f->place);
}

/* Squares in an order that `factor` gives, with a hole. */
static void make(const char *path, uint32_t factor, uint64_t memory, char **ret_facts)
{
	struct err err = ERR_INIT;
	struct folder f = {NULL, NULL, NULL};
	size_t size;
	FILE *facts = open_memstream(ret_facts, &size);

	folder_open(&f, path, memory, &err);
	for (uint32_t i = 0; i < SIDE * SIDE; i++) {
		uint32_t n = i * factor % (SIDE * SIDE), column = n % SIDE, row = n / SIDE;

		if (column / 10 != 2 || row / 10 != 3)
			assert_int_equal(add_square(f.levels, column, row, &err), 0);
	}
	assert_int_equal(levels_make(f.levels, "00", &err), 0);
	levels_facts(f.levels, facts);
	fclose(facts);
	assert_true(levels_bytes(f.levels) > 0 && levels_tiles(f.levels) > 2 * 3500 / LEAF);
	folder_move(&f, &err);
	folder_close(&f);
}

static void test_order_and_memory(void **state)
{
	char a[512], b[512], *first, *other;

	make(folder_path("first", a), 1, 0, &first);
	assert_non_null(strstr(first, "\"triangles\":7000,\"grid\":true"));
	for (int i = 0; i < 2; i++) {
		make(folder_path("other", b), i ? 7 : 3599, i ? 0 : 1, &other);
		assert_string_equal(first, other);
		folder_same(a, b);
		assert_int_equal(repeat_remove(b), 0);
		free(other);
	}
	free(first);
}

static void test_what_is_no_mesh(void **state)
{
	struct err err = ERR_INIT;
	struct folder f = {NULL, NULL, NULL};
	const int32_t a[3] = {0, 100, 0}, b[3] = {9, 100, 0}, c[3] = {0, 109, 0}, out[2][3] = {{0, 76, 0}, {8000, 100, 0}};
	char path[512];

	folder_open(&f, folder_path("wrong", path), 0, &err);
	for (int i = 0; i < 2; i++) {
		assert_int_equal(levels_triangle(f.levels, (const int32_t *const[3]){out[i], b, c}, &err), -ERR_PROTO);
		assert_non_null(strstr(err.message, "outside of the box"));
		err = ERR_INIT;
	}
	for (int i = 0; i < 2 * LEAF; i++)
		assert_int_equal(levels_triangle(f.levels, (const int32_t *const[3]){a, b, c}, &err), 0);
	assert_int_equal(levels_make(f.levels, "00", &err), -ERR_PROTO);
	assert_non_null(strstr(err.message, "overlap"));
	folder_close(&f);
	assert_int_equal(folder_count(path), -1);
}

/* ---- the folder ---- */

static int write_folder(const struct meshes *m, const char *out, size_t nblock, bool no_clobber, struct outputs_report *report,
			struct err *err)
{
	const struct outputs_options ropt = {.levels = true};
	const struct format_options opt = {.no_clobber = no_clobber, .interrupted = stop};
	struct outputs *run = NULL;
	struct acut_mesh_sink sink;
	int r = outputs_new(&ropt, &run, err);

	if (!r)
		r = outputs_add(run, out, format_find("html"), &opt, err);
	if (!r) {
		sink = outputs_sink(run);
		r = meshes_send(m, &sink, nblock);
		if (r)
			*err = *outputs_error(run);
	}
	if (!r && nblock >= m->nblock)
		r = outputs_publish(run, err);
	if (!r && nblock >= m->nblock)
		outputs_report(run, report);
	outputs_free(run);
	return r;
}

/* Meshes of all kinds, and the same one in other blocks. */
static void test_whole(void **state)
{
	static const struct meshes_spec none = {.scale_xy = "0.01", .scale_z = "0.01"};
	static const struct meshes_spec line = {
		.columns = 1, .rows = 300, .strip = 299, .x0 = 5, .step = 7, .scale_xy = "0.01", .scale_z = "0.01"};
	struct meshes_spec other = meshes_many;
	const struct meshes_spec *const spec[] = {&none, &line, &meshes_many, &other};
	char a[512], b[512], place[128];

	other.strip++;
	for (int i = 0; i < 4; i++) {
		struct outputs_report report;
		struct err err = ERR_INIT;
		struct meshes m;

		snprintf(place, sizeof(place), "%s/%d", folder_own, i);
		assert_int_equal(mkdir(place, 0700), 0);
		snprintf(place, sizeof(place), "%d/survey", i); /* which is in the page */
		meshes_make(&m, spec[i]);
		assert_int_equal(write_folder(&m, folder_path(place, a), SIZE_MAX, false, &report, &err), 0);
		assert_int_equal(report.tiles, i > 1);
		assert_int_equal(folder_count(a), 1 + (i > 1));
		assert_true(report.bytes > 0);
		meshes_done(&m);
	}
	folder_same(folder_path("2/survey", a), folder_path("3/survey", b));
}

/* It stays as it was: where there was none, where there was one, before the tail, at each moment of the making, with a full disk.
 */
static void unchanged(const struct meshes *m, const char *path, const char *was)
{
	struct outputs_report report;
	struct rlimit old;
	size_t n;
	char *text;

	for (n = 0; n < 3; n++) {
		struct err err = ERR_INIT;

		assert_int_equal(write_folder(m, path, n, false, &report, &err), 0);
		assert_int_equal(folder_count(path), was ? 2 : -1);
	}
	for (int i = 0; i < 4; i++) {
		struct err err = ERR_INIT;

		stop_after = i;
		assert_int_equal(write_folder(m, path, SIZE_MAX, false, &report, &err), -ERR_CANCELLED);
		assert_int_equal(folder_count(path), was ? 2 : -1);
	}
	stop_after = -1;
	signal(SIGXFSZ, SIG_IGN);
	assert_int_equal(getrlimit(RLIMIT_FSIZE, &old), 0);
	for (rlim_t size = 0; size < 90000; size += 11000) {
		const struct rlimit small = {size, old.rlim_max};
		struct err err = ERR_INIT;
		int r;

		assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
		r = write_folder(m, path, SIZE_MAX, false, &report, &err);
		assert_int_equal(setrlimit(RLIMIT_FSIZE, &old), 0);
		assert_true(r < 0);
		assert_int_equal(err_exit_status(err.code), 74);
		assert_int_equal(folder_count(path), was ? 2 : -1);
	}
	if (was) {
		text = folder_read(path, "index.html", &n);
		assert_string_equal(text, was);
		free(text);
	}
}

static void test_failures_change_nothing(void **state)
{
	struct outputs_report report;
	struct err err = ERR_INIT;
	struct meshes m;
	char path[512], *was;
	size_t n;

	meshes_make(&m, &meshes_many);
	unchanged(&m, folder_path("kept", path), NULL);
	assert_int_equal(write_folder(&m, path, SIZE_MAX, false, &report, &err), 0);
	was = folder_read(path, "index.html", &n);
	unchanged(&m, path, was);
	assert_int_equal(write_folder(&m, path, SIZE_MAX, true, &report, &err), -ERR_USAGE);
	assert_int_equal(unlink(strcat(path, "/index.html")), 0);
	folder_path("kept", path);
	err = ERR_INIT;
	assert_int_equal(write_folder(&m, path, SIZE_MAX, true, &report, &err), -ERR_USAGE); /* its tile */
	assert_int_equal(folder_count(path), 1);
	free(was);
	meshes_done(&m);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_order_and_memory),
		cmocka_unit_test(test_what_is_no_mesh),
		cmocka_unit_test(test_whole),
		cmocka_unit_test(test_failures_change_nothing),
	};

	return folder_run(tests);
}
