/*
 * The contract of every row of the format table: whole or not at all, whatever the mesh and whatever fails.
 * One suite, all rows; a new format is tested by being in the table.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <stdio.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cmocka.h>

#include "err.h"
#include "folder.h"
#include "outputs.h"
#include "io.h"
#include "meshes.h"
#include "no_sync.h"
#include "outfile.h"

static struct io_table *table;

static const struct meshes_spec one = {.columns = 2, .rows = 2, .strip = 1, .step = 10, .scale_xy = "0.01", .scale_z = "0.01"};
/* Vertices and no triangle. */
static const struct meshes_spec line = {
	.columns = 1, .rows = 300, .strip = 299, .x0 = 5, .step = 7, .scale_xy = "0.01", .scale_z = "0.01"};
static const struct meshes_spec none = {.scale_xy = "0.01", .scale_z = "0.01"};

static void empty(const char *path)
{
	DIR *d = opendir(path);
	struct dirent *e;

	while ((e = readdir(d)))
		if (strcmp(e->d_name, ".") && strcmp(e->d_name, ".."))
			unlinkat(dirfd(d), e->d_name, 0);
	closedir(d);
}

static void sweep(void)
{
	empty(folder_own);
}

/* Writes the mesh with one row; 0, or the error's code. The output is published only if all went well. */
static int write_mesh(const struct format *f, const struct meshes *m, const char *path, const struct format_options *opt,
		      const struct outputs_options *ropt, size_t nblock, struct err *err)
{
	struct outputs *run = NULL;
	struct acut_mesh_sink sink;
	int r = outputs_new(ropt, &run, err);

	if (!r)
		r = outputs_add(run, path, f, opt, err);
	if (!r) {
		sink = outputs_sink(run);
		r = meshes_send(m, &sink, nblock);
		if (r) {
			assert_int_equal(-r, outputs_error(run)->code);
			*err = *outputs_error(run);
		} else if (nblock >= m->nblock) {
			r = outputs_publish(run, err);
		}
	}
	if (!r && nblock >= m->nblock) {
		struct outputs_report report;
		outputs_report(run, &report);
		assert_true(report.bytes > 0);
	}
	outputs_free(run);
	return r;
}

/* ---- a format that no row is yet: positions, and canonical order; it writes the corners of triangles ---- */

struct corners {
	struct outfile *out;
	int32_t (*vertex)[3]; /* all that came */
	uint64_t n;
};

static int corners_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	struct corners *c = calloc(1, sizeof(*c));

	c->out = out;
	*ret = c;
	return 0;
}

static int corners_head(void *writer, const struct acut_mesh_head *head, struct err *err)
{
	return outfile_write(((struct corners *)writer)->out, "corners\n", 8, err);
}

/* The position of each vertex is the one that it came with. */
static int corners_block(void *writer, const struct format_block *block, struct err *err)
{
	struct corners *c = writer;
	const struct acut_mesh_block *b = block->mesh;
	int r = 0;

	c->vertex = realloc(c->vertex, (c->n + b->nnew + 1) * sizeof(*c->vertex));
	if (b->nnew)
		memcpy(c->vertex + c->n, b->vertex, b->nnew * sizeof(*c->vertex));
	assert_int_equal(b->nnew ? b->first : c->n, c->n);
	c->n += b->nnew;
	assert_true(!b->nnew || !memcmp(block->position + b->nforeign, b->vertex, b->nnew * sizeof(*b->vertex)));
	for (uint32_t i = 0; i < b->nforeign; i++) {
		assert_true(b->foreign[i] < c->n);
		assert_memory_equal(block->position[i], c->vertex[b->foreign[i]], sizeof(*c->vertex));
	}
	for (uint32_t i = 0; i < b->ntriangle && !r; i++)
		for (int j = 0; j < 3 && !r; j++)
			r = outfile_write(c->out, block->position[b->triangle[i][j]], sizeof(*c->vertex), err);
	return r;
}

static int corners_finish(void *writer, const struct acut_mesh_tail *tail, struct err *err)
{
	assert_int_equal(((struct corners *)writer)->n, tail->vertices);
	return 0;
}

static void *corners_free(void *writer)
{
	free(((struct corners *)writer)->vertex);
	free(writer);
	return NULL;
}

static const struct format corners = {
	.name = "corners",
	.extensions = "",
	.help = "",
	.kind = FORMAT_MESH,
	.takes = FORMAT_CANONICAL,
	.positions = true,
	.open = corners_open,
	.head = corners_head,
	.block = corners_block,
	.finish = corners_finish,
	.free = corners_free,
};

static void each_way(const struct format *f, void (*test)(const struct format *, const struct format_options *))
{
	struct format_options opt = meshes_options(f);

	opt.width = f->takes & FORMAT_SIZED ? 200 : 0;
	test(f, &opt);
	sweep();
	if (f->takes & FORMAT_POLYFACE) {
		opt.polyface = true;
		test(f, &opt);
		sweep();
		opt.polyface = false;
	}
	if (f->takes & FORMAT_CANONICAL) {
		opt.canonical = true;
		test(f, &opt);
		sweep();
	}
}

static void each_row(void (*test)(const struct format *, const struct format_options *))
{
	size_t n;
	const struct format *const *row = format_rows(&n);

	assert_true(n >= 3);
	for (size_t i = 0; i < n; i++)
		if (row[i]->kind != FORMAT_NOTHING)
			each_way(row[i], test);
	each_way(&corners, test);
}

static void tiled(const struct format *f, const struct format_options *given)
{
	struct format_options way = *given, *opt = &way;
	const struct outputs_options ropt = {.tiled = true, .tile = {300, -2}, .sort_memory = 1 << 20};
	struct meshes m;
	struct err err = ERR_INIT;
	char path[512];

	meshes_make(&m, &meshes_many);
	folder_path("tiles", path);
	if (opt->simplify.mantissa)
		assert_int_equal(write_mesh(f, &m, path, opt, &ropt, SIZE_MAX, &err), -ERR_USAGE);
	err_clear(&err);
	opt->simplify.mantissa = 0;
	assert_int_equal(write_mesh(f, &m, path, opt, &ropt, SIZE_MAX, &err), 0);
	meshes_done(&m);
	empty(path);
	assert_int_equal(rmdir(path), 0);
}

/* Tiles are made of every format, and leave nothing else. */
static void test_tiles(void **state)
{
	each_row(tiled);
}

static void meshes_whole(const struct format *f, const struct format_options *opt)
{
	const struct meshes_spec *const spec[] = {&none, &line, &one, &meshes_many};
	const struct outputs_options ropt = {.sort_memory = 1 << 20};

	for (unsigned i = 0; i < 4; i++) {
		struct meshes m;
		struct err err = ERR_INIT;
		struct stat st;

		meshes_make(&m, spec[i]);
		assert_int_equal(write_mesh(f, &m, folder_out, opt, &ropt, SIZE_MAX, &err), 0);
		assert_int_equal(folder_count(folder_own), 1);
		assert_int_equal(stat(folder_out, &st), 0);
		assert_true(st.st_size > 0);
		meshes_done(&m);
	}
}

static void test_whole(void **state)
{
	each_row(meshes_whole);
}

/* Stopped before the tail: nothing stays, and what stood there before is untouched. */
static void stopped(const struct format *f, const struct format_options *opt)
{
	const struct outputs_options ropt = {.sort_memory = 1 << 20};
	struct meshes m;
	struct err err = ERR_INIT;
	FILE *old = fopen(folder_out, "w");
	char text[8] = "";

	fputs("old", old);
	fclose(old);
	meshes_make(&m, &meshes_many);
	for (size_t n = 0; n < 4; n++)
		assert_int_equal(write_mesh(f, &m, folder_out, opt, &ropt, n, &err), 0);
	meshes_done(&m);
	assert_int_equal(folder_count(folder_own), 1);
	old = fopen(folder_out, "r");
	assert_non_null(fgets(text, sizeof(text), old));
	fclose(old);
	assert_string_equal(text, "old");
}

static void test_stopped(void **state)
{
	each_row(stopped);
}

/* The disk fills at every size: always "no space" or the like, never a file. */
static void full_disk(const struct format *f, const struct format_options *opt)
{
	const struct outputs_options ropt = {.sort_memory = 1 << 20};
	struct meshes m;
	struct rlimit was;
	struct stat st;
	struct err err = ERR_INIT;

	meshes_make(&m, &meshes_many);
	assert_int_equal(write_mesh(f, &m, folder_out, opt, &ropt, SIZE_MAX, &err), 0);
	assert_int_equal(stat(folder_out, &st), 0);
	sweep();
	signal(SIGXFSZ, SIG_IGN);
	assert_int_equal(getrlimit(RLIMIT_FSIZE, &was), 0);
	for (off_t size = 0; size < st.st_size; size += st.st_size / 7 + 1) {
		struct rlimit small = {(rlim_t)size, was.rlim_max};
		int r;

		err = ERR_INIT;
		assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
		r = write_mesh(f, &m, folder_out, opt, &ropt, SIZE_MAX, &err);
		assert_int_equal(setrlimit(RLIMIT_FSIZE, &was), 0);
		assert_true(r < 0);
		assert_int_equal(err_exit_status(err.code), 74);
		assert_non_null(strstr(err.file, "out"));
		assert_int_equal(folder_count(folder_own), 0);
	}
	meshes_done(&m);
}

static void test_full_disk(void **state)
{
	each_row(full_disk);
}

static void run_in_child(const struct format *f, const struct format_options *opt, const struct meshes *m, int out)
{
	const struct outputs_options ropt = {.sort_memory = 1 << 20};
	struct err err = ERR_INIT;

	dup2(out, STDOUT_FILENO);
	_exit(-write_mesh(f, m, "-", opt, &ropt, SIZE_MAX, &err));
}

/* Standard output is a pipe: all of it comes, and for formats without a patched header the same bytes. */
static void to_pipe(const struct format *f, const struct format_options *opt)
{
	struct meshes m;
	int fd[2], status;
	char buf[4096];
	size_t total = 0;
	ssize_t n;
	pid_t pid;

	meshes_make(&m, &meshes_many);
	fflush(NULL);
	assert_int_equal(pipe(fd), 0);
	pid = fork();
	if (!pid)
		run_in_child(f, opt, &m, fd[1]);
	close(fd[1]);
	while ((n = read(fd[0], buf, sizeof(buf))) > 0)
		total += (size_t)n;
	close(fd[0]);
	assert_int_equal(waitpid(pid, &status, 0), pid);
	assert_int_equal(status, 0);
	assert_true(total > 150);
	assert_int_equal(folder_count(folder_own), 0);
	meshes_done(&m);
}

static void test_pipe(void **state)
{
	each_row(to_pipe);
}

/* /dev/full takes nothing; it is written as it is, and stays a device. */
static void to_device(const struct format *f, const struct format_options *opt)
{
	const struct outputs_options ropt = {.sort_memory = 1 << 20};
	struct meshes m;
	struct stat st;
	struct err err = ERR_INIT;

	meshes_make(&m, &meshes_many);
	assert_int_equal(write_mesh(f, &m, "/dev/full", opt, &ropt, SIZE_MAX, &err), -ERR_NOSPACE);
	assert_int_equal(stat("/dev/full", &st), 0);
	assert_true(S_ISCHR(st.st_mode));
	meshes_done(&m);
}

static void test_device(void **state)
{
	each_row(to_device);
}

static void clobber(const struct format *f, const struct format_options *opt)
{
	const struct outputs_options ropt = {.sort_memory = 1 << 20};
	struct format_options keep = *opt;
	struct meshes m;
	struct err err = ERR_INIT;
	char path[512];

	keep.no_clobber = true;
	meshes_make(&m, &one);
	assert_int_equal(write_mesh(f, &m, folder_out, &keep, &ropt, SIZE_MAX, &err), 0);
	assert_int_equal(write_mesh(f, &m, folder_out, &keep, &ropt, SIZE_MAX, &err), -ERR_USAGE);
	assert_int_equal(write_mesh(f, &m, folder_path("gone/out", path), opt, &ropt, SIZE_MAX, &err), -ERR_USAGE);
	assert_int_equal(folder_count(folder_own), 1);
	meshes_done(&m);
}

static void test_clobber(void **state)
{
	each_row(clobber);
}

/* A link stays a link, and the file behind it is replaced. */
static void through_link(const struct format *f, const struct format_options *opt)
{
	const struct outputs_options ropt = {.sort_memory = 1 << 20};
	struct meshes m;
	struct stat st;
	struct err err = ERR_INIT;
	char real[512], link[512];

	folder_path("link", link);
	close(open(folder_path("real", real), O_CREAT | O_WRONLY, 0600));
	assert_int_equal(symlink("real", link), 0);
	meshes_make(&m, &one);
	assert_int_equal(write_mesh(f, &m, link, opt, &ropt, SIZE_MAX, &err), 0);
	assert_int_equal(lstat(link, &st), 0);
	assert_true(S_ISLNK(st.st_mode));
	assert_int_equal(lstat(real, &st), 0);
	assert_true(st.st_size > 0);
	assert_int_equal(folder_count(folder_own), 2);
	meshes_done(&m);
}

static void test_link(void **state)
{
	each_row(through_link);
}

static void test_wrong_options(void **state)
{
	const struct outputs_options ropt = {.sort_memory = 1 << 20}, changes = {.changes = true};
	struct format_options opt = {.canonical = true};
	struct meshes m;
	struct err err = ERR_INIT;

	meshes_make(&m, &one);
	assert_int_equal(write_mesh(format_find("png"), &m, folder_out, &opt, &ropt, SIZE_MAX, &err), -ERR_USAGE);
	opt = (struct format_options){.origin_auto = true};
	err = ERR_INIT;
	assert_int_equal(write_mesh(format_find("png"), &m, folder_out, &opt, &ropt, SIZE_MAX, &err), -ERR_USAGE);
	opt = (struct format_options){.width = FORMAT_WIDTH_MAX + 1};
	err = ERR_INIT;
	assert_int_equal(write_mesh(format_find("png"), &m, folder_out, &opt, &ropt, SIZE_MAX, &err), -ERR_USAGE);
	opt = (struct format_options){.cell = {0, 0}};
	err = ERR_INIT;
	assert_int_equal(write_mesh(format_find("tif"), &m, folder_out, &opt, &ropt, SIZE_MAX, &err), -ERR_USAGE);
	assert_non_null(strstr(err.hint, "--cell 1m"));
	opt = (struct format_options){.cell = {1, 0}};
	err = ERR_INIT;
	assert_int_equal(write_mesh(format_find("tif"), &m, folder_out, &opt, &changes, SIZE_MAX, &err), -ERR_USAGE);
	assert_non_null(strstr(err.message, "--changed-since"));
	opt = (struct format_options){0};
	err = ERR_INIT;
	assert_int_equal(write_mesh(format_find("gpkg"), &m, folder_out, &opt, &ropt, SIZE_MAX, &err), -ERR_USAGE);
	assert_non_null(strstr(err.hint, "--interval 1m"));
	opt = (struct format_options){.interval = {1, 0}};
	err = ERR_INIT;
	assert_int_equal(write_mesh(format_find("geojson"), &m, folder_out, &opt, &changes, SIZE_MAX, &err), -ERR_USAGE);
	assert_non_null(strstr(err.message, "--changed-since"));
	assert_int_equal(folder_count(folder_own), 0);
	meshes_done(&m);
}

static void test_table(void **state)
{
	enum format_color color;
	bool lines;

	assert_ptr_equal(format_by_path("a/b.c/mesh.PLY"), format_find("ply"));
	assert_ptr_equal(format_by_path("mesh.png"), format_find("png"));
	assert_null(format_by_path("a.ply/mesh"));
	assert_null(format_by_path("mesh.pl"));
	assert_ptr_equal(format_by_path("mesh.xml"), format_find("landxml"));
	assert_ptr_equal(format_by_path("mesh.landxml"), format_find("landxml"));
	assert_ptr_equal(format_by_path("c.GeoJSON"), format_find("geojson"));
	assert_ptr_equal(format_by_path("c.gpkg"), format_find("gpkg"));
	assert_ptr_equal(format_by_path("c.dxf"), format_find("dxf"));
	assert_null(format_find("3mf"));
	assert_true(format_parse_color("domain", &color, &lines));
	assert_false(lines);
	assert_int_equal(color, FORMAT_DOMAIN);
	assert_false(format_parse_color("domains", &color, &lines));
	assert_true(format_parse_color("elevation+lines", &color, &lines));
	assert_true(color == FORMAT_ELEVATION && lines);
	assert_false(format_parse_color("elevation+", &color, &lines));
}

/* Rows that write nothing take no output; all others need one. */
static void test_nothing(void **state)
{
	const struct format_options opt = {0};
	const struct outputs_options ropt = {.max_edge = {.given = true, .value = {26, -2}}, .edges = true};
	struct meshes m;
	size_t n, nothing = 0;
	const struct format *const *row = format_rows(&n);

	meshes_make(&m, &meshes_many);
	for (size_t i = 0; i < n; i++) {
		struct outputs *run;
		struct outputs_report report;
		struct acut_mesh_sink sink;
		struct err err = ERR_INIT;

		assert_int_equal(outputs_new(&ropt, &run, &err), 0);
		if (row[i]->kind == FORMAT_NOTHING) {
			assert_int_equal(outputs_add(run, folder_out, row[i], &opt, &err), -ERR_USAGE);
			assert_int_equal(outputs_add(run, NULL, row[i], &opt, &err), 0);
			sink = outputs_sink(run);
			assert_int_equal(meshes_send(&m, &sink, SIZE_MAX), 0);
			assert_int_equal(outputs_publish(run, &err), 0);
			outputs_report(run, &report);
			assert_int_equal(report.bytes, 0);
			assert_int_equal(report.left_out.triangles, m.tail.triangles); /* the diagonals are longer */
			nothing++;
		} else {
			assert_int_equal(outputs_add(run, NULL, row[i], &opt, &err), -ERR_USAGE);
		}
		outputs_free(run);
	}
	assert_true(nothing > 0);
	assert_int_equal(folder_count(folder_own), 0);
	/* a tail that counts what did not come */
	m.tail.vertices++;
	for (size_t i = 0; i < n; i++) {
		struct outputs *run;
		struct acut_mesh_sink sink;
		struct err err = ERR_INIT;

		if (row[i]->kind != FORMAT_NOTHING)
			continue;
		assert_int_equal(outputs_new(&ropt, &run, &err), 0);
		assert_int_equal(outputs_add(run, NULL, row[i], &opt, &err), 0);
		sink = outputs_sink(run);
		assert_true(meshes_send(&m, &sink, SIZE_MAX) != 0);
		assert_int_equal(outputs_error(run)->code, ERR_PROTO);
		outputs_free(run);
	}
	meshes_done(&m);
}

/* The same on a file system without nameless files. */
static void test_named(void **state)
{
	table->openat = no_nameless;
	each_row(meshes_whole);
	each_row(stopped);
	each_row(full_disk);
	each_row(clobber);
	each_row(to_pipe);
	table->openat = io_system.openat;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_whole), cmocka_unit_test(test_stopped),       cmocka_unit_test(test_full_disk),
		cmocka_unit_test(test_pipe),  cmocka_unit_test(test_device),        cmocka_unit_test(test_clobber),
		cmocka_unit_test(test_link),  cmocka_unit_test(test_wrong_options), cmocka_unit_test(test_table),
		cmocka_unit_test(test_tiles), cmocka_unit_test(test_nothing),       cmocka_unit_test(test_named),
	};

	table = no_sync();
	return folder_run(tests);
}
