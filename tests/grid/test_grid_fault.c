/*
 * Every file call of the cache fails in turn, once or forever. The result must be a typed error or correct; no partial
 * file may get its final name, nothing may be left behind, no descriptor leaked; and the same names can be used again.
 */
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "grid_fixture.h"
#include "io.h"

static struct {
	unsigned long calls, fail_at; /* 0: no call fails */
	bool for_ever;
	int error;
	bool unlink_failed;
} fault;

static bool failing(void)
{
	fault.calls++;
	if (!fault.fail_at || fault.calls < fault.fail_at || (!fault.for_ever && fault.calls > fault.fail_at))
		return false;
	errno = fault.error;
	return true;
}

static int fault_openat(int dirfd, const char *path, int flags, mode_t mode)
{
	return failing() ? -1 : io_system.openat(dirfd, path, flags, mode);
}

static int fault_close(int fd)
{
	bool fails = failing();
	int rc = io_system.close(fd);

	return fails ? -1 : rc;
}

static ssize_t fault_pread(int fd, void *buf, size_t n, off_t off)
{
	return failing() ? -1 : io_system.pread(fd, buf, n, off);
}

/* Writes half of the bytes before it fails, like a disk that fills up. */
static ssize_t fault_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	if (failing()) {
		if (n > 1 && io_system.pwrite(fd, buf, n / 2, off) < 0)
			return -1;
		errno = fault.error;
		return -1;
	}
	return io_system.pwrite(fd, buf, n > 5000 ? n / 2 : n, off);
}

static int fault_fsync(int fd)
{
	return failing() ? -1 : 0; /* fsync itself is not tested */
}

static int fault_renameat(int olddir, const char *old, int newdir, const char *name)
{
	return failing() ? -1 : io_system.renameat(olddir, old, newdir, name);
}

static int fault_unlinkat(int dirfd, const char *path, int flags)
{
	if (failing()) {
		fault.unlink_failed = true;
		return -1;
	}
	return io_system.unlinkat(dirfd, path, flags);
}

static int fault_fstat(int fd, struct stat *st)
{
	return failing() ? -1 : io_system.fstat(fd, st);
}

static const struct io_table faulty = {
	.openat = fault_openat,
	.close = fault_close,
	.pread = fault_pread,
	.pwrite = fault_pwrite,
	.fsync = fault_fsync,
	.renameat = fault_renameat,
	.unlinkat = fault_unlinkat,
	.fstat = fault_fstat,
};

enum { RUNS = 12, EACH = 400 };

/* Stages with so many runs that they are merged twice, then seals. */
static int make_segment(const struct folder *f, const struct set *s, struct grid_segment_info *ret, struct err *err)
{
	struct grid_stage_params params = {f->fd, "seg", GRID_STAGE_MIN, true};
	struct grid_stage *stage;
	int rc = grid_stage_new(&params, &stage, err);

	for (unsigned i = 0; rc == 0 && i < RUNS; i++) {
		rc = grid_stage_source(stage, 1 + i % 3, err);
		if (rc == 0)
			rc = grid_stage_add(stage, s->pts + i * EACH, EACH, err);
		if (rc == 0 && i + 1 < RUNS)
			rc = grid_stage_sync(stage, err);
	}
	if (rc == 0)
		rc = grid_stage_seal(stage, ret, err);
	if (rc) {
		struct err again = ERR_INIT;

		assert_true(grid_stage_seal(stage, ret, &again) != 0); /* a failure is final */
	}
	grid_stage_free(stage);
	return rc;
}

/* Stages, seals, opens and reads; *ret_sealed: whether it got that far. */
static int stage_and_read(const struct folder *f, const struct set *s, bool *ret_sealed, struct gather *ret, struct err *err)
{
	struct grid_segment_info info;
	struct grid_manifest m;
	struct grid *g = NULL;
	struct grid_reader *r;
	int rc = make_segment(f, s, &info, err);

	*ret_sealed = rc == 0;
	if (rc)
		return rc;
	m = manifest_of(&info, 1, 3);
	rc = grid_manifest_write(f->fd, "m", &m, err);
	free(m.sources);
	if (rc == 0)
		rc = grid_open(f->fd, "m", 1, NULL, 0, &g, err);
	if (rc)
		return rc;
	void *memory = malloc(grid_reader_bytes(g));

	rc = grid_reader_new(g, memory, grid_reader_bytes(g), &r, err);
	if (rc == 0)
		rc = grid_scan(r, 0, UINT64_MAX, gather_sink, ret, err);
	grid_close(g);
	free(memory);
	return rc;
}

static void is_correct(const struct gather *g, const struct set *sorted)
{
	assert_int_equal(g->n, sorted->n);
	assert_memory_equal(g->pts, sorted->pts, g->n * sizeof *g->pts);
}

/* One attempt that fails at call n. False if there are fewer calls. */
static bool attempt(unsigned long n, bool for_ever, int error, const struct set *s, const struct set *sorted)
{
	struct folder f = folder_new();
	struct gather g = {0};
	struct err err = ERR_INIT;
	size_t fds = open_descriptors();
	bool sealed;

	memset(&fault, 0, sizeof fault);
	fault.fail_at = n;
	fault.for_ever = for_ever;
	fault.error = error;
	io = &faulty;
	int rc = stage_and_read(&f, s, &sealed, &g, &err);
	bool reached = fault.calls >= n;

	io = &io_system;
	assert_int_equal(open_descriptors(), fds);
	if (rc) {
		assert_int_equal(rc, -(error == ENOSPC ? ERR_NOSPACE : ERR_IO));
		assert_int_equal(err.code, -rc);
		assert_true(reached && err.file[0] && err.message[0]);
	} else {
		is_correct(&g, sorted);
	}
	if (!fault.unlink_failed || !for_ever) { /* what could not be removed at first is removed at the end */
		assert_int_equal(folder_files(&f, ".tmp"), 0);
		assert_int_equal(folder_files(&f, ".run"), 0);
		assert_int_equal(folder_files(&f, ".seg"), sealed);
	}
	g.n = 0;
	err_clear(&err);
	memset(&fault, 0, sizeof fault);
	io = &faulty;
	CHECK(stage_and_read(&f, s, &sealed, &g, &err));
	io = &io_system;
	is_correct(&g, sorted);
	assert_int_equal(folder_files(&f, ".tmp"), 0);
	free(g.pts);
	folder_remove(&f);
	return reached;
}

static void run(bool for_ever, int error)
{
	struct set s = set_make(SHAPE_UNIFORM, RUNS * EACH, 1, 4), sorted = set_make(SHAPE_UNIFORM, RUNS * EACH, 1, 4);
	unsigned long n = 1;

	set_sort(&sorted);
	while (attempt(n, for_ever, error, &s, &sorted))
		n++;
	print_message("%lu calls failed %s\n", n - 1, for_ever ? "for ever" : "once");
	assert_true(n > 100);
	set_free(&s);
	set_free(&sorted);
}

static void test_once_eio(void **state)
{
	run(false, EIO);
}

static void test_once_full(void **state)
{
	run(false, ENOSPC);
}

static void test_for_ever(void **state)
{
	run(true, ENOSPC);
}

/* An abandoned stage leaves nothing; without a folder a stage fails. */
static void test_given_up(void **state)
{
	struct folder f = folder_new();
	struct set s = set_make(SHAPE_UNIFORM, 1000, 1, 4);
	struct grid_stage_params params = {f.fd, "x", GRID_STAGE_MIN, true};
	struct grid_stage *stage;
	struct err err = ERR_INIT;

	CHECK(grid_stage_new(&params, &stage, &err));
	CHECK(grid_stage_source(stage, 7, &err));
	CHECK(grid_stage_add(stage, s.pts, s.n, &err));
	CHECK(grid_stage_sync(stage, &err));
	assert_int_equal(folder_files(&f, ".run"), 1);
	CHECK(grid_stage_add(stage, s.pts, s.n, &err)); /* the source continues after a sync */
	grid_stage_free(stage);
	assert_int_equal(folder_files(&f, ""), 0);

	params.memory = GRID_STAGE_MIN - 1;
	assert_int_equal(grid_stage_new(&params, &stage, &err), -ERR_LIMIT);
	err_clear(&err);
	params.memory = GRID_STAGE_MIN;
	params.name = "a/b";
	assert_int_equal(grid_stage_new(&params, &stage, &err), -ERR_INTERNAL);
	assert_null(grid_stage_free(NULL));
	set_free(&s);
	folder_remove(&f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_given_up),
		cmocka_unit_test(test_once_eio),
		cmocka_unit_test(test_once_full),
		cmocka_unit_test(test_for_ever),
	};

	return cmocka_run_group_tests_name("grid: faults", tests, NULL, NULL);
}
