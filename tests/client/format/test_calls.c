/*
 * Every row of the format table where file calls go wrong: writes that take a part, calls that fail one after the other, kill -9,
 * a user who gives up.
 * At the output's name there is what stood there before, or all of the new file, and nothing lies beside it.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cmocka.h>

#include "err.h"
#include "io.h"
#include "meshes.h"
#include "outputs.h"
#include "repeat.h"

static char dir[64], out[80];

/* ---- calls ---- */

enum call { CALL_PWRITE, CALL_PREAD, CALL_FSYNC, CALL_FTRUNCATE, CALL_LINKAT, CALL_RENAMEAT, CALL_OPENAT, CALLS };

static const struct {
	const char *name;
	int error;
} calls[CALLS] = {
	{"pwrite", ENOSPC}, {"pread", EIO},    {"fsync", EIO},     {"ftruncate", EIO},
	{"linkat", EIO},    {"renameat", EIO}, {"openat", EMFILE},
};

/* What happens to the `left`-th call of a kind from now on. */
static struct {
	enum call call;
	long left; /* < 0: it came */
	bool kills;
	unsigned piece; /* not 0: no write takes more */
	unsigned writes;
} plan;

static bool strikes(enum call call)
{
	if (plan.call != call || plan.left < 0 || plan.left--)
		return false;
	if (plan.kills)
		raise(SIGKILL);
	errno = calls[call].error;
	return true;
}

static ssize_t my_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	if (plan.piece && ++plan.writes % 3 == 0) {
		errno = EINTR;
		return -1;
	}
	return strikes(CALL_PWRITE) ? -1 : pwrite(fd, buf, plan.piece && n > plan.piece ? plan.piece : n, off);
}

static ssize_t my_pread(int fd, void *buf, size_t n, off_t off)
{
	return strikes(CALL_PREAD) ? -1 : pread(fd, buf, plan.piece && n > plan.piece ? plan.piece : n, off);
}

/* As in no_sync.h. */
static int my_fsync(int fd)
{
	return strikes(CALL_FSYNC) ? -1 : 0;
}

static int my_ftruncate(int fd, off_t size)
{
	return strikes(CALL_FTRUNCATE) ? -1 : ftruncate(fd, size);
}

static int my_linkat(int olddir, const char *old, int newdir, const char *name, int flags)
{
	return strikes(CALL_LINKAT) ? -1 : linkat(olddir, old, newdir, name, flags);
}

static int my_renameat(int olddir, const char *old, int newdir, const char *name)
{
	return strikes(CALL_RENAMEAT) ? -1 : renameat(olddir, old, newdir, name);
}

static int my_openat(int dirfd, const char *path, int flags, mode_t mode)
{
	return strikes(CALL_OPENAT) ? -1 : openat(dirfd, path, flags, mode);
}

static void use_calls(void)
{
	static struct io_table table;

	table = io_system;
	table.pwrite = my_pwrite;
	table.pread = my_pread;
	table.fsync = my_fsync;
	table.ftruncate = my_ftruncate;
	table.linkat = my_linkat;
	table.renameat = my_renameat;
	table.openat = my_openat;
	io = &table;
}

static void no_plan(void)
{
	memset(&plan, 0, sizeof(plan));
	plan.left = -1;
}

/* ---- files ---- */

struct bytes {
	uint8_t *at;
	size_t n;
};

static struct bytes slurp(void)
{
	struct bytes b = {NULL, 0};
	FILE *f = fopen(out, "rb");
	long size;

	assert_non_null(f);
	fseek(f, 0, SEEK_END);
	size = ftell(f);
	rewind(f);
	if (size > 1 << 28)
		fail_msg("call of %s: the file has %ld bytes", calls[plan.call].name, size);
	b.at = malloc((size_t)size + 1);
	b.n = fread(b.at, 1, (size_t)size, f);
	assert_int_equal(b.n, size);
	fclose(f);
	return b;
}

static bool out_is(const void *bytes, size_t n)
{
	struct bytes b;
	bool same;

	if (access(out, F_OK))
		return false;
	b = slurp();
	same = b.n == n && !memcmp(b.at, bytes, n);
	free(b.at);
	return same;
}

/* Now and then, since a file that is replaced is written to the disk at once by some file systems. */
static void put_old(bool there)
{
	FILE *f;

	unlink(out);
	if (!there)
		return;
	f = fopen(out, "w");
	assert_non_null(f);
	fputs("old", f);
	fclose(f);
}

static bool out_is_old(bool there)
{
	return there ? out_is("old", 3) : access(out, F_OK) != 0;
}

/* Files beside the output; they are removed. */
static unsigned beside(void)
{
	DIR *d = opendir(dir);
	struct dirent *e;
	unsigned n = 0;

	while ((e = readdir(d)))
		if (strcmp(e->d_name, ".") && strcmp(e->d_name, "..") && strcmp(e->d_name, "out")) {
			unlinkat(dirfd(d), e->d_name, 0);
			n++;
		}
	closedir(d);
	return n;
}

static int write_mesh(const struct format *f, const struct format_options *opt, const struct meshes *m, const char *path)
{
	const struct outputs_options ropt = {.sort_memory = 1 << 20};
	struct err err = ERR_INIT;

	return meshes_write(m, path, f, opt, &ropt, NULL, &err);
}

/* ---- all rows, and in canonical order ---- */

typedef void test_fn(const struct format *, const struct format_options *, const struct meshes *, struct bytes want);

static void each_row(const struct meshes_spec *spec, test_fn *test)
{
	const struct format *const *row;
	size_t n, tested = 0;

	row = format_rows(&n);
	for (size_t i = 0; i < 2 * n; i++) {
		const struct format *f = row[i / 2];
		struct format_options opt = meshes_options(f);
		struct meshes m;
		struct bytes want;

		if (f->kind == FORMAT_NOTHING || (i % 2 && !(f->takes & FORMAT_CANONICAL)))
			continue;
		opt.width = f->takes & FORMAT_SIZED ? 200 : 0;
		opt.canonical = i % 2;
		meshes_make(&m, spec);
		no_plan();
		assert_int_equal(write_mesh(f, &opt, &m, out), 0);
		want = slurp();
		test(f, &opt, &m, want);
		free(want.at);
		meshes_done(&m);
		assert_int_equal(beside(), 0);
		unlink(out);
		tested++;
	}
	assert_true(tested >= 10);
}

/* Writes and reads take a part of what they are given, at places that no block ends at, or are interrupted. */
static void in_pieces(const struct format *f, const struct format_options *opt, const struct meshes *m, struct bytes want)
{
	plan.piece = 40961;
	assert_int_equal(write_mesh(f, opt, m, out), 0);
	assert_true(plan.writes > 0);
	assert_true(out_is(want.at, want.n));
}

static void test_pieces(void **state)
{
	static const struct meshes_spec large = {.columns = 300,
						 .rows = 300,
						 .strip = 33,
						 .step = 25,
						 .slope_x = 3,
						 .slope_y = 4,
						 .scale_xy = "0.01",
						 .scale_z = "0.01"};

	each_row(&large, in_pieces);
}

/* Each call of each kind fails in turn. */
static void failing(const struct format *f, const struct format_options *opt, const struct meshes *m, struct bytes want)
{
	unsigned failed = 0;

	for (enum call call = 0; call < CALLS; call++) {
		bool came = true;

		for (long n = 0; came; n++) {
			bool old = n % 4 == 1;
			int r;

			put_old(old);
			plan.call = call;
			plan.left = n;
			r = write_mesh(f, opt, m, out);
			came = plan.left < 0;
			failed += r < 0;
			/* some have another way, and of a folder that cannot be made durable the file is there */
			if (!(out_is(want.at, want.n) || (r < 0 && out_is_old(old))) || (!came && r))
				fail_msg("%s, call %ld of %s: %d", f->name, n, calls[call].name, r);
			if (beside())
				fail_msg("%s, call %ld of %s: something is left", f->name, n, calls[call].name);
		}
	}
	assert_true(failed > 3);
}

static void test_failing(void **state)
{
	each_row(&meshes_many, failing);
}

/* Killed at each of these calls, or after all of them. */
static void killed(const struct format *f, const struct format_options *opt, const struct meshes *m, struct bytes want)
{
	static const enum call at[] = {CALL_PWRITE, CALL_FSYNC, CALL_LINKAT, CALL_RENAMEAT};
	unsigned kills = 0;

	for (unsigned i = 0; i < sizeof(at) / sizeof(*at); i++) {
		bool came = true;

		for (long n = 0; came; n++) {
			bool old = n % 4 == 1;
			int status;
			pid_t pid;

			put_old(old);
			fflush(NULL);
			pid = fork();
			if (!pid) {
				plan.call = at[i];
				plan.left = n;
				plan.kills = true;
				_exit(write_mesh(f, opt, m, out) != 0);
			}
			assert_int_equal(waitpid(pid, &status, 0), pid);
			came = WIFSIGNALED(status);
			kills += came;
			if (!(out_is(want.at, want.n) || (came && out_is_old(old))))
				fail_msg("%s, killed at call %ld of %s", f->name, n, calls[at[i]].name);
			/* a name that it was to be renamed from */
			if (beside() > came)
				fail_msg("%s, killed at call %ld of %s: more than one is left", f->name, n, calls[at[i]].name);
		}
	}
	assert_int_equal(write_mesh(f, opt, m, out), 0);
	assert_true(out_is(want.at, want.n));
	assert_true(kills > 2);
}

static void test_killed(void **state)
{
	each_row(&meshes_many, killed);
}

static int asked;

static int give_up(void *ctx)
{
	asked++;
	return 1;
}

/* Cancelled while files are made of what has come. */
static void cancelled(const struct format *f, const struct format_options *opt, const struct meshes *m, struct bytes want)
{
	struct format_options mine = *opt;
	int r;

	mine.interrupted = give_up;
	asked = 0;
	put_old(true);
	r = write_mesh(f, &mine, m, out);
	if (f->kind == FORMAT_RASTER || f->kind == FORMAT_LINES)
		assert_true(asked);
	assert_int_equal(r, asked ? -ERR_CANCELLED : 0);
	assert_true(asked ? out_is_old(true) : out_is(want.at, want.n));
}

static void test_cancelled(void **state)
{
	each_row(&meshes_many, cancelled);
}

/* The smallest mesh that has a triangle: into a file, a pipe, and with its vertices in any order. */
static void test_one_triangle(void **state)
{
	static const struct meshes_spec square = {
		.columns = 2, .rows = 2, .strip = 1, .step = 100, .slope_x = 100, .scale_xy = "0.01", .scale_z = "0.01"};
	size_t n;
	const struct format *const *row = format_rows(&n);

	for (size_t i = 0; i < n; i++) {
		struct format_options opt = meshes_options(row[i]);
		struct acut_mesh_block *b;
		struct bytes first;
		struct meshes m;

		if (row[i]->kind == FORMAT_NOTHING)
			continue;
		meshes_make(&m, &square);
		b = &m.block[0];
		assert_int_equal(b->ntriangle, 2);
		b->ntriangle = 1;
		m.tail.triangles = 1;
		assert_int_equal(write_mesh(row[i], &opt, &m, out), 0);
		first = slurp();
		assert_true(first.n > 0 && !beside());
		opt.canonical = row[i]->takes & FORMAT_CANONICAL;
		assert_int_equal(write_mesh(row[i], &opt, &m, out), 0);
		free(first.at);
		meshes_done(&m);
		unlink(out);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_one_triangle), cmocka_unit_test(test_pieces),
					   cmocka_unit_test(test_failing), cmocka_unit_test(test_killed),
					   cmocka_unit_test(test_cancelled)};
	int failed;

	use_calls();
	no_plan();
	repeat_folder(dir, sizeof dir, "calls");
	snprintf(out, sizeof(out), "%s/out", dir);
	failed = cmocka_run_group_tests(tests, NULL, NULL);
	repeat_remove(dir);
	return failed;
}
