/* Outputs in parts: the files, the index and the report of those that several processes make and one joins are those of one
 * process; joining can be done again; parts that are damaged or gone are refused; nothing of a part is left. */
#include <errno.h>
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <cmocka.h>

#include "digest.h"
#include "err.h"
#include "folder.h"
#include "io.h"
#include "outfile.h"
#include "outputs.h"
#include "meshes.h"
#include "no_sync.h"

enum { PARTS = 4 };

static struct io_table *table;
static struct meshes_spec many;

/* What is written, and how. */
struct job {
	const char *format, *side; /* side of tiles, or NULL */
	const char *max_edge;      /* or NULL */
	bool levels, no_clobber, sidecar;
	unsigned parts;
	uint64_t tiles_most;
	uint64_t share[PARTS + 1]; /* part i has the tiles from share[i] on */
};

static struct outputs *begin(const struct job *j, const char *out, const char *part, const uint64_t *share, bool joins,
			     struct err *err)
{
	struct outputs_options ropt = {.tiled = j->side,
				       .tiles_most = j->tiles_most,
				       .levels = j->levels,
				       .edges = true,
				       .part = part,
				       .joins = joins,
				       .share = {0, UINT64_MAX}};
	const struct format *format = format_find(j->format);
	struct format_options opt = meshes_options(format);
	struct outputs *run = NULL;

	opt.no_clobber = j->no_clobber;
	opt.sidecar = j->sidecar;
	if (j->side)
		assert_true(decimal_parse(j->side, &ropt.tile));
	if (!strcmp(j->format, "png") && j->side)
		opt.width = 50;
	if (share) {
		ropt.share[0] = share[0];
		ropt.share[1] = share[1] - 1;
	}
	if (j->max_edge) {
		ropt.max_edge.given = true;
		assert_true(decimal_parse(j->max_edge, &ropt.max_edge.value));
	}
	if (outputs_new(&ropt, &run, err))
		return NULL;
	if (outputs_add(run, out, format, &opt, err))
		return outputs_free(run);
	outputs_about(run, 7, "valley", 3);
	return run;
}

static int end(struct outputs *run, struct outputs_report *report, struct err *err)
{
	int r = outputs_publish(run, err);

	if (!r)
		outputs_report(run, report);
	return r;
}

static int whole(const struct job *j, const struct meshes *m, const char *out, struct outputs_report *report, struct err *err)
{
	struct outputs *run = begin(j, out, NULL, NULL, false, err);
	struct acut_mesh_sink sink;
	int r;

	if (!run)
		return -(int)err->code;
	sink = outputs_sink(run);
	assert_int_equal(meshes_send(m, &sink, SIZE_MAX), 0);
	r = end(run, report, err);
	outputs_free(run);
	return r;
}

struct made {
	char name[16];
	uint8_t *bytes;
	size_t size;
};

static void part(const struct job *j, const struct meshes *m, const char *out, unsigned i, struct made *ret)
{
	struct outputs_report report;
	struct err err = ERR_INIT;
	struct acut_mesh_sink sink;
	struct outputs *run;

	snprintf(ret->name, sizeof(ret->name), "p%u", i);
	run = begin(j, out, ret->name, j->side ? &j->share[i] : NULL, false, &err);
	assert_non_null(run);
	sink = outputs_sink(run);
	assert_int_equal(meshes_send(m, &sink, SIZE_MAX), 0);
	assert_int_equal(end(run, &report, &err), 0);
	assert_int_equal(outputs_part(run, &ret->bytes, &ret->size, &err), 0);
	outputs_free(run);
}

static int join(const struct job *j, const struct meshes *m, const char *out, const char *name, const struct made *made,
		struct outputs_report *report, struct err *err)
{
	struct outputs *run = begin(j, out, name, NULL, true, err);
	struct acut_mesh_sink sink;
	int r = run ? 0 : -(int)err->code;

	if (!run)
		return r;
	sink = outputs_sink(run);
	assert_int_equal(sink.head(sink.ctx, &m->head), 0);
	for (unsigned i = 0; i < j->parts && !r; i++)
		r = outputs_join(run, made[i].name, made[i].bytes, made[i].size, err);
	if (!r) {
		assert_int_equal(sink.tail(sink.ctx, &m->tail), 0);
		r = end(run, report, err);
	}
	outputs_free(run);
	return r;
}

/* The tail with the digest of the triangles, which those of tiles are compared with. */
static void true_digest(struct meshes *m, char hex[DIGEST_HEX_SIZE])
{
	int32_t(*at)[3] = calloc(m->tail.vertices + 1, sizeof(*at));
	struct digest sum = {0, 0};

	for (size_t i = 0; i < m->nblock; i++) {
		const struct acut_mesh_block *b = &m->block[i];

		memcpy(at[b->first], b->vertex, b->nnew * sizeof(*at));
		for (uint32_t t = 0; t < b->ntriangle; t++) {
			int64_t corner[3][2];

			for (int j = 0; j < 3; j++) {
				uint32_t n = b->triangle[t][j];
				const int32_t *p = at[n < b->nforeign ? b->foreign[n] : b->first + n - b->nforeign];

				corner[j][0] = p[0] + m->head.k[0];
				corner[j][1] = p[1] + m->head.k[1];
			}
			digest_add_triangle(&sum, corner);
		}
	}
	free(at);
	m->tail.digest = digest_hex(sum, hex);
}

static void drop(const struct job *j, const char *out, struct made *made)
{
	for (unsigned i = 0; i < j->parts; i++) {
		if (j->side || j->levels)
			outfile_folder_drop(out, made[i].name);
		else
			outfile_held_drop(out, made[i].name);
		free(made[i].bytes);
	}
}

static void same_report(const struct outputs_report *a, const struct outputs_report *b)
{
	assert_int_equal(a->bytes, b->bytes);
	assert_int_equal(a->tiles, b->tiles);
	assert_int_equal(a->no_lines, b->no_lines);
	assert_int_equal(a->left_out.triangles, b->left_out.triangles);
	assert_string_equal(a->written, b->written);
	assert_true(a->longest_edge == b->longest_edge && a->median_edge == b->median_edge);
	assert_int_equal(a->simplified.vertices, b->simplified.vertices);
}

/* Both ways of one output, in folders of their own; joined twice. */
static void both(const struct job *j, const struct meshes *m)
{
	struct outputs_report one, two, again;
	struct made made[PARTS] = {{{0}, NULL, 0}};
	char a[512], b[512], out[560], name[600];
	const char *file = j->side || j->levels ? "out" : "out.file";
	struct err err = ERR_INIT;

	assert_int_equal(mkdir(folder_path("one", a), 0777), 0);
	assert_int_equal(mkdir(folder_path("two", b), 0777), 0);
	snprintf(out, sizeof(out), "%s/%s", a, file);
	assert_int_equal(whole(j, m, out, &one, &err), 0);
	snprintf(out, sizeof(out), "%s/%s", b, file);
	for (unsigned i = 0; i < j->parts; i++)
		part(j, m, out, i, &made[i]);
	snprintf(name, sizeof(name), "%s/index.%s", out, j->side ? "geojson" : "html");
	assert_int_not_equal(access(j->side || j->levels ? name : out, F_OK), 0); /* no names yet */
	assert_int_equal(join(j, m, out, "join", made, &two, &err), 0);
	assert_int_equal(join(j, m, out, "more", made, &again, &err), 0);
	drop(j, out, made);
	if (j->side || j->levels) {
		assert_int_equal(folder_count(a) + folder_count(b), 2);
		strcat(strcat(a, "/"), file);
	}
	folder_same(a, j->side || j->levels ? out : b);
	same_report(&one, &two);
	same_report(&one, &again);
	assert_int_equal(repeat_remove(folder_path("one", a)) | repeat_remove(folder_path("two", b)), 0);
}

static void test_tiles(void **state)
{
	static const uint64_t cut[PARTS + 1] = {0, 3, 9, 40, UINT64_MAX};
	static const char *const format[] = {"ply", "obj", "png", "glb", "dxf", "landxml", "stl"};
	char hex[DIGEST_HEX_SIZE];
	struct meshes m;

	meshes_make(&m, &many);
	true_digest(&m, hex);
	for (unsigned i = 0; i < sizeof(format) / sizeof(format[0]); i++) {
		struct job j = {.format = format[i], .side = "3.2", .parts = PARTS};

		memcpy(j.share, cut, sizeof(cut));
		j.max_edge = i & 1 ? "0.3" : NULL;
		j.no_clobber = i == 3;
		both(&j, &m);
	}
	meshes_done(&m);
}

/* Rasters and lines divide themselves: one part has all of them, and what memory allows of other tiles is no limit. */
static void test_one_part(void **state)
{
	static const char *const format[] = {"tif", "geojson", "gpkg"};
	char hex[DIGEST_HEX_SIZE];
	struct meshes m;

	meshes_make(&m, &many);
	true_digest(&m, hex);
	for (unsigned i = 0; i < sizeof(format) / sizeof(format[0]); i++) {
		struct job j = {.format = format[i], .side = "3.2", .parts = 1, .tiles_most = 1, .share = {0, UINT64_MAX}};

		if (!strcmp(format[i], "geojson"))
			continue; /* its options here simplify, which tiles refuse */
		both(&j, &m);
	}
	both(&(struct job){.format = "html", .levels = true, .parts = 1}, &m);
	meshes_done(&m);
}

static void test_files(void **state)
{
	size_t n;
	const struct format *const *row = format_rows(&n);
	char hex[DIGEST_HEX_SIZE];
	struct meshes m;

	meshes_make(&m, &many);
	true_digest(&m, hex);
	for (size_t i = 0; i < n; i++)
		if (row[i]->kind != FORMAT_NOTHING)
			both(&(struct job){.format = row[i]->name, .parts = 1, .sidecar = true, .no_clobber = i & 1}, &m);
	meshes_done(&m);
}

static void test_refused(void **state)
{
	const struct job j = {.format = "ply", .side = "3.2", .parts = 2, .share = {0, 9, UINT64_MAX}};
	struct outputs_report report;
	struct made made[PARTS];
	struct err err = ERR_INIT;
	struct meshes m;
	char out[512], gone[600], hex[DIGEST_HEX_SIZE];

	meshes_make(&m, &many);
	true_digest(&m, hex);
	folder_path("refused", out);
	part(&j, &m, out, 0, &made[0]);
	part(&j, &m, out, 1, &made[1]);
	/* the tiles of one are not there */
	err = ERR_INIT;
	assert_int_equal(join(&(struct job){.format = "ply", .side = "3.2", .parts = 1}, &m, out, "join", made, &report, &err),
			 -ERR_DIGEST);
	made[1].bytes[4]++;
	err = ERR_INIT;
	assert_int_equal(join(&j, &m, out, "join", made, &report, &err), -ERR_VERSION);
	made[1].bytes[4]--;
	for (size_t cut = 0; cut < made[1].size; cut += made[1].size / 97 + 1) {
		size_t size = made[1].size;

		err = ERR_INIT;
		made[1].size = cut;
		assert_int_equal(join(&j, &m, out, "join", made, &report, &err), -ERR_CORRUPT);
		made[1].size = size;
	}
	/* one of its files is another one now */
	snprintf(gone, sizeof(gone), "cd %s/.tiles.p1.part && set -- *.ply && rm $1 && cp $1 ../ 2>/dev/null; exit 0", out);
	assert_int_equal(system(gone), 0);
	err = ERR_INIT;
	assert_int_equal(join(&j, &m, out, "join", made, &report, &err), -ERR_GONE);
	assert_non_null(strstr(err.file, "tile_"));
	snprintf(gone, sizeof(gone), "%s/index.geojson", out);
	assert_int_not_equal(access(gone, F_OK), 0);
	drop(&j, out, made);
	meshes_done(&m);
}

/* Two at once with names as long as they can be, which differ in the last letter. */
static void long_names(void)
{
	static const char tag[] = "0123456789abcdef-4294967295-0123456789abcdef";
	struct outfile_held held[2];
	struct outfile *o[2];
	char path[2][512], name[256] = {0};
	struct err err = ERR_INIT;

	memset(name, 'n', 254);
	for (int i = 0; i < 2; i++) {
		snprintf(path[i], sizeof(path[i]), "%s/%s%d", folder_own, name, i);
		assert_int_equal(outfile_new(path[i], false, &o[i], &err), 0);
		assert_int_equal(outfile_hold(o[i], tag, &err), 0);
		assert_int_equal(outfile_write(o[i], path[i], strlen(path[i]), &err), 0);
	}
	for (int i = 0; i < 2; i++) {
		assert_int_equal(outfile_publish(o[i], &err), 0);
		assert_int_equal(outfile_held(o[i], &held[i], &err), 0);
		outfile_free(o[i]);
	}
	for (int i = 0; i < 2; i++) {
		assert_int_not_equal(access(path[i], F_OK), 0);
		assert_int_equal(outfile_settle(path[i], tag, &held[i], false, &err), 0);
		assert_int_equal(unlink(path[i]), 0);
	}
}

static void test_long_names(void **state)
{
	long_names();
	table->openat = no_nameless;
	long_names();
	table->openat = io_system.openat;
}

/* A part that is not published leaves nothing; that of a name that is taken is refused. */
static void test_given_up(void **state)
{
	const struct job j = {.format = "ply", .side = "3.2", .parts = 1, .share = {0, UINT64_MAX}};
	struct outputs *run, *other;
	struct err err = ERR_INIT;
	struct meshes m;
	struct acut_mesh_sink sink;
	char out[512];

	meshes_make(&m, &many);
	run = begin(&j, folder_path("given", out), "p0", j.share, false, &err);
	assert_non_null(run);
	other = begin(&j, out, "p0", j.share, false, &err);
	assert_null(other);
	assert_int_equal(err.sys, EEXIST);
	sink = outputs_sink(run);
	assert_int_equal(meshes_send(&m, &sink, 2), 0);
	outputs_free(run);
	assert_int_equal(folder_count(out), 0);
	meshes_done(&m);
}

/* The tiles that a rectangle has of a share, one by one. */
static void test_meets(void **state)
{
	uint64_t seed = 11;

	for (unsigned i = 0; i < 3000; i++) {
		uint32_t low[2], high[2], v[4];
		uint64_t share[2];
		bool any = false;

		for (unsigned k = 0; k < 4; k++) {
			seed = seed * 6364136223846793005u + 1442695040888963407u;
			v[k] = (uint32_t)(seed >> 60);
		}
		for (unsigned k = 0; k < 2; k++) {
			low[k] = v[k];
			high[k] = v[k] + v[2 + k] % 4;
			seed = seed * 6364136223846793005u + 1442695040888963407u;
			share[k] = seed >> 56;
		}
		if (share[0] > share[1])
			continue;
		for (uint32_t x = low[0]; x <= high[0]; x++)
			for (uint32_t y = low[1]; y <= high[1]; y++) {
				uint64_t code = outputs_tile_code(x, y);

				any |= code >= share[0] && code <= share[1];
			}
		assert_int_equal(outputs_grid_meets(low, high, share), any);
	}
	assert_true(outputs_grid_meets((uint32_t[2]){UINT32_MAX, UINT32_MAX}, (uint32_t[2]){UINT32_MAX, UINT32_MAX},
				       (uint64_t[2]){UINT64_MAX, UINT64_MAX}));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_tiles),      cmocka_unit_test(test_one_part), cmocka_unit_test(test_files),
		cmocka_unit_test(test_refused),    cmocka_unit_test(test_given_up), cmocka_unit_test(test_meets),
		cmocka_unit_test(test_long_names),
	};

	many = meshes_many;
	many.k[0] = -700;
	table = no_sync();
	return folder_run(tests);
}
