/*
 * A stage that is suspended and resumed by another: whichever call the first one died at, the second makes the segment
 * that a single stage would have made. Dropped sources leave no trace.
 */
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "grid_fixture.h"
#include "grid_state.h"
#include "io.h"

/* WHOLE sources are suspended, one run each: more than a stage of this size can merge at once. Then some more are
 * added, and the last one is cut off; it must not be in the result. */
enum { SOURCES = 20, EACH = 4000, WHOLE = 12, CUT = 16, AGAIN = 100, MANY = 200 };
static const size_t memory = GRID_STAGE_MIN;

/* ---- a process that dies at its n-th call ---- */

static unsigned long calls, die_at;

static void count(void)
{
	if (++calls == die_at)
		_exit(7);
}

static int dying_openat(int dirfd, const char *path, int flags, mode_t mode)
{
	count();
	return io_system.openat(dirfd, path, flags, mode);
}

static ssize_t dying_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	if (calls + 1 == die_at && n > 1 && io_system.pwrite(fd, buf, n / 2, off) < 0)
		_exit(8);
	count();
	return io_system.pwrite(fd, buf, n, off);
}

static int dying_fsync(int fd)
{
	count();
	return 0;
}

static int dying_renameat(int olddir, const char *old, int newdir, const char *name)
{
	count();
	return io_system.renameat(olddir, old, newdir, name);
}

static int dying_unlinkat(int dirfd, const char *path, int flags)
{
	count();
	return io_system.unlinkat(dirfd, path, flags);
}

static struct io_table dying;

/* ---- stages ---- */

/* The points of source `id`, as source `as`. */
static void add(struct grid_stage *stage, const struct set *s, uint32_t id, uint32_t as, struct err *err)
{
	size_t at;

	check_ok(grid_stage_source(stage, as, err), err, "stage", __FILE__, __LINE__);
	for (at = 0; at < s->n; at++)
		if (s->ids[at] == id)
			check_ok(grid_stage_add(stage, s->pts + at, 1, err), err, "stage", __FILE__, __LINE__);
}

/* The complete sources, each suspended; then the others up to the incomplete one; then the segment. */
static int interrupted(const struct folder *f, const struct set *s)
{
	struct grid_stage_params params = {f->fd, "p", memory, true};
	struct grid_segment_info info;
	struct grid_stage *stage;
	struct err err = ERR_INIT;

	if (grid_stage_new(&params, &stage, &err))
		return 1;
	for (uint32_t id = 1; id <= CUT; id++) {
		if (grid_stage_source(stage, id, &err))
			return 2;
		for (size_t at = 0, n = 0; at < s->n && (id < CUT || n < EACH / 2); at++) {
			if (s->ids[at] != id)
				continue;
			n++;
			if (grid_stage_add(stage, s->pts + at, 1, &err))
				return 3;
		}
		if (id <= WHOLE && grid_stage_suspend(stage, &err))
			return 4;
	}
	if (grid_stage_seal(stage, &info, &err))
		return 5;
	grid_stage_detach(stage);
	return 0;
}

/* In a separate process; true if it reached the end. */
static bool run_until(const struct folder *f, const struct set *s, unsigned long call)
{
	int status;
	pid_t pid = fork();

	if (!pid) {
		dying = io_system;
		dying.openat = dying_openat;
		dying.pwrite = dying_pwrite;
		dying.fsync = dying_fsync;
		dying.renameat = dying_renameat;
		dying.unlinkat = dying_unlinkat;
		io = &dying;
		die_at = call;
		_exit(interrupted(f, s));
	}
	assert_true(waitpid(pid, &status, 0) == pid && WIFEXITED(status));
	if (WEXITSTATUS(status) != 0 && WEXITSTATUS(status) != 7)
		fail_msg("the stage ended with %d", WEXITSTATUS(status));
	return WEXITSTATUS(status) == 0;
}

/* The expected result. */
static struct set wanted(const struct set *s)
{
	struct set w = {.pts = malloc(s->n * sizeof *w.pts), .ids = malloc(s->n * sizeof *w.ids)};

	for (size_t i = 0; i < s->n; i++) {
		if (s->ids[i] == CUT)
			continue;
		w.pts[w.n] = s->pts[i];
		w.ids[w.n++] = s->ids[i] + (s->ids[i] > WHOLE && s->ids[i] < CUT ? AGAIN : 0);
	}
	return w;
}

/* Only the sources that the caller knows to be complete count. */
static bool is_whole(void *there, uint32_t id)
{
	((bool *)there)[id] = id <= WHOLE;
	return id <= WHOLE;
}

static bool is_not_cut(void *ctx, uint32_t id)
{
	return id != CUT;
}

/* A range of numbers, and how many were asked for. */
struct part {
	uint32_t from, to, n;
};

static bool is_in(void *ctx, uint32_t id)
{
	struct part *part = ctx;

	part->n++;
	return id >= part->from && id <= part->to;
}

static uint64_t checksum(const struct folder *f, const char *name)
{
	int fd = openat(f->fd, name, O_RDONLY);
	off_t size = lseek(fd, 0, SEEK_END);
	uint8_t *bytes = malloc((size_t)size);
	struct digest d;

	assert_true(pread(fd, bytes, (size_t)size, 0) == size);
	d = digest_hash(bytes, (size_t)size);
	free(bytes);
	close(fd);
	return d.lo;
}

static void resume_stage(const struct folder *f, const struct set *s, const struct grid_segment_info *want, uint64_t sum)
{
	struct grid_stage_params params = {f->fd, "p", memory, true};
	struct grid_segment_info info;
	struct grid_stage *stage;
	struct err err = ERR_INIT;
	bool there[SOURCES + 1] = {false};

	/* Before the first state file nothing can be resumed. */
	if (faccessat(f->fd, "p.stage", F_OK, 0) != 0) {
		assert_int_equal(grid_stage_resume(&params, &stage, &err), -ERR_IO);
		err_clear(&err);
		CHECK(grid_stage_discard(f->fd, "p", &err));
		return;
	}
	CHECK(grid_stage_resume(&params, &stage, &err));
	CHECK(grid_stage_keep(stage, is_whole, there, &err));
	assert_true(there[1]);
	for (uint32_t id = SOURCES; id; id--)
		if (!there[id] && id != CUT)
			add(stage, s, id, id + (id > WHOLE && id < CUT ? AGAIN : 0), &err);
	CHECK(grid_stage_seal(stage, &info, &err));
	assert_int_equal(info.points, want->points);
	assert_true(digest_equal(info.sum, want->sum) && info.cells == want->cells);
	assert_true(checksum(f, info.file) == sum);
	grid_stage_detach(stage);
	assert_true(folder_files(f, ".run") > 0);
	CHECK(grid_stage_discard(f->fd, "p", &err));
	assert_int_equal(unlinkat(f->fd, info.file, 0), 0);
}

static void test_death(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, SOURCES * EACH, SOURCES, 7), w = wanted(&s);
	struct folder once = folder_new();
	struct grid_segment_info want;
	struct err err = ERR_INIT;
	unsigned long call;
	uint64_t sum;
	bool end = false;

	CHECK(stage_set(&once, "want", &w, 0, &want, &err));
	sum = checksum(&once, want.file);
	for (call = 1; !end; call += call < 12 ? 1 : 5) {
		struct folder f = folder_new();

		end = run_until(&f, &s, call);
		resume_stage(&f, &s, &want, sum);
		/* A segment that was being written is removed by the sweep; nothing else is left. */
		unlinkat(f.fd, "p.seg.tmp", 0);
		unlinkat(f.fd, "p.seg", 0);
		unlinkat(f.fd, "p.stage.tmp", 0);
		assert_int_equal(folder_files(&f, ""), 0);
		folder_remove(&f);
	}
	assert_true(call > 50);
	set_free(&s);
	free(w.pts);
	free(w.ids);
	folder_remove(&once);
}

/* Dropping, without suspending: from memory, and from runs. */
static void test_drop(void **state)
{
	for (int big = 0; big < 2; big++) {
		struct set s = set_make(SHAPE_DUPLICATES, big ? SOURCES * EACH : 2000, SOURCES, 9), w = wanted(&s);
		struct folder f = folder_new();
		struct grid_stage_params params = {f.fd, "d", memory, false};
		struct grid_segment_info want, info;
		struct grid_stage *stage;
		struct err err = ERR_INIT;

		CHECK(stage_set(&f, "want", &w, 0, &want, &err));
		CHECK(grid_stage_new(&params, &stage, &err));
		for (uint32_t id = 1; id <= SOURCES; id++) {
			add(stage, &s, id, id + (id > WHOLE && id < CUT ? AGAIN : 0), &err);
			if (id == CUT)
				CHECK(grid_stage_keep(stage, is_not_cut, NULL, &err));
		}
		CHECK(grid_stage_seal(stage, &info, &err));
		assert_true(digest_equal(info.sum, want.sum) && info.points == want.points);
		assert_true(checksum(&f, "d.seg") == checksum(&f, "want.seg"));
		grid_stage_free(stage);
		assert_int_equal(folder_files(&f, ""), 2);
		set_free(&s);
		free(w.pts);
		free(w.ids);
		folder_remove(&f);
	}
}

/* Two segments of one suspended stage, each with a name of its own; the stage stays as it was. */
static void test_segments_of_one_stage(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, 3000, 2, 1);
	struct folder f = folder_new();
	struct grid_stage_params params = {f.fd, "stage", memory, true};
	struct grid_segment_info info;
	struct grid_stage *stage;
	struct err err = ERR_INIT;
	uint64_t points = 0;

	CHECK(grid_stage_new(&params, &stage, &err));
	add(stage, &s, 1, 1, &err);
	add(stage, &s, 2, 2, &err);
	CHECK(grid_stage_suspend(stage, &err));
	grid_stage_detach(stage);
	for (uint32_t id = 1; id <= 2; id++) {
		params.segment = id == 1 ? "one" : "two";
		CHECK(grid_stage_resume(&params, &stage, &err));
		CHECK(grid_stage_keep(stage, is_in, &(struct part){id, id}, &err));
		CHECK(grid_stage_seal(stage, &info, &err));
		points += info.points;
		assert_string_equal(info.file, id == 1 ? "one.seg" : "two.seg");
		grid_stage_detach(stage);
	}
	assert_int_equal(points, s.n);
	CHECK(grid_stage_discard(f.fd, "stage", &err));
	assert_int_equal(folder_files(&f, ""), 2);
	set_free(&s);
	folder_remove(&f);
}

/* A state file with a changed byte, or an incomplete run, cannot be resumed. */
static void test_damage(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, 3000, 2, 1);
	struct folder f = folder_new();
	struct grid_stage_params params = {f.fd, "d", memory, true};
	struct grid_stage *stage;
	struct err err = ERR_INIT;
	uint8_t bytes[256];
	uint64_t of_runs;
	struct stat st[2];
	uint32_t last;
	ssize_t n;
	int fd;

	CHECK(grid_stage_new(&params, &stage, &err));
	add(stage, &s, 1, 1, &err);
	CHECK(grid_stage_suspend(stage, &err));
	add(stage, &s, 2, 2, &err);
	CHECK(grid_stage_suspend(stage, &err));
	grid_stage_detach(stage);
	fd = openat(f.fd, "d.stage", O_RDWR);
	n = pread(fd, bytes, sizeof bytes, 0);
	assert_true(n > 40 && n < 256);
	for (ssize_t i = 0; i < n; i++) {
		uint8_t changed = bytes[i] ^ 0x10;

		assert_int_equal(pwrite(fd, &changed, 1, i), 1);
		err_clear(&err);
		assert_int_equal(grid_stage_resume(&params, &stage, &err), -ERR_CORRUPT);
		assert_int_equal(pwrite(fd, bytes + i, 1, i), 1);
	}
	close(fd);
	err_clear(&err);
	CHECK(grid_stage_resume(&params, &stage, &err));
	grid_stage_detach(stage);
	CHECK(grid_stage_check(f.fd, "d", &last, &of_runs, &err));
	assert_int_equal(last, 2);
	assert_int_equal(fstatat(f.fd, "d.0.run", &st[0], 0) | fstatat(f.fd, "d.1.run", &st[1], 0), 0);
	assert_int_equal(of_runs, st[0].st_size + st[1].st_size);
	fd = openat(f.fd, "d.1.run", O_RDWR);
	assert_int_equal(ftruncate(fd, 100), 0);
	close(fd);
	assert_int_equal(grid_stage_resume(&params, &stage, &err), -ERR_CORRUPT);
	err_clear(&err);
	CHECK(grid_stage_discard(f.fd, "d", &err));
	assert_int_equal(folder_files(&f, ""), 0);
	set_free(&s);
	folder_remove(&f);
}

/* A stage of sources 1..n, suspended after each, so that each has a run of its own. */
static void suspend_each(const struct grid_stage_params *params, const struct set *s, uint32_t n)
{
	struct grid_stage *stage;
	struct err err = ERR_INIT;

	CHECK(grid_stage_new(params, &stage, &err));
	for (uint32_t id = 1; id <= n; id++) {
		add(stage, s, id, id, &err);
		CHECK(grid_stage_suspend(stage, &err));
	}
	grid_stage_detach(stage);
}

/* The suspended stage, which has sources 1..n, without those that are not in from..to. */
static struct grid_stage *resume_part(const struct grid_stage_params *params, uint32_t n, uint32_t from, uint32_t to)
{
	struct grid_stage *stage;
	struct err err = ERR_INIT;
	struct part part = {from, to};

	CHECK(grid_stage_resume(params, &stage, &err));
	CHECK(grid_stage_keep(stage, is_in, &part, &err));
	assert_int_equal(part.n, n);
	return stage;
}

/* The segment has the records of sources from..to, each as its own. */
static void seal_part(struct grid_stage *stage, const struct folder *f, const struct set *s, uint32_t from, uint32_t to)
{
	struct set want = {.pts = malloc(s->n * sizeof *want.pts), .ids = malloc(s->n * sizeof *want.ids)};
	struct grid_segment_info once, info;
	struct err err = ERR_INIT;

	for (size_t i = 0; i < s->n; i++) {
		if (s->ids[i] < from || s->ids[i] > to)
			continue;
		want.pts[want.n] = s->pts[i];
		want.ids[want.n++] = s->ids[i];
	}
	CHECK(stage_set(f, "want", &want, 0, &once, &err));
	CHECK(grid_stage_seal(stage, &info, &err));
	grid_stage_detach(stage);
	assert_int_equal(info.points, want.n);
	assert_true(checksum(f, info.file) == checksum(f, once.file));
	set_free(&want);
}

/* What is dropped before a suspension is there again after it, and can be dropped again, or used. */
static void test_drop_and_suspend(void **state)
{
	enum { N = 3 };

	struct set s = set_make(SHAPE_UNIFORM, N * 500, N, 1);
	struct folder f = folder_new();
	struct grid_stage_params params = {f.fd, "stage", memory, true, .segment = "part"};
	struct grid_stage *stage;
	struct err err = ERR_INIT;

	suspend_each(&params, &s, N);
	for (uint32_t id = 1; id <= N; id++) {
		stage = resume_part(&params, N, id, id);
		CHECK(grid_stage_suspend(stage, &err));
		grid_stage_detach(stage);
		seal_part(resume_part(&params, N, id, id), &f, &s, id, id);
	}
	/* It was dropped from memory before there was a run: it is gone. */
	CHECK(grid_stage_discard(f.fd, "stage", &err));
	CHECK(grid_stage_new(&params, &stage, &err));
	add(stage, &s, 1, 1, &err);
	add(stage, &s, 2, 2, &err);
	CHECK(grid_stage_keep(stage, is_in, &(struct part){2, 2}, &err));
	CHECK(grid_stage_suspend(stage, &err));
	grid_stage_detach(stage);
	seal_part(resume_part(&params, 1, 2, 2), &f, &s, 2, 2);
	CHECK(grid_stage_discard(f.fd, "stage", &err));
	assert_int_equal(folder_files(&f, ""), 2);
	set_free(&s);
	folder_remove(&f);
}

/* More runs than can be merged at once: the segment of a part merges some first, and the rest can still be sealed. */
static void test_part_of_many_runs(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, MANY * 20, MANY, 1);
	struct folder f = folder_new();
	struct grid_stage_params params = {f.fd, "stage", memory, true, .segment = "part"};
	struct err err = ERR_INIT;
	uint32_t last;
	uint64_t bytes;

	suspend_each(&params, &s, MANY);
	assert_int_equal(folder_files(&f, ".run"), MANY);
	seal_part(resume_part(&params, MANY, 1, 1), &f, &s, 1, 1);
	assert_true(folder_files(&f, ".run") < MANY);
	/* The numbers of all records count, also of those that nobody may ever use. */
	CHECK(grid_stage_check(f.fd, "stage", &last, &bytes, &err));
	assert_int_equal(last, MANY);
	seal_part(resume_part(&params, MANY, 2, 2), &f, &s, 2, 2);
	seal_part(resume_part(&params, MANY, 3, MANY), &f, &s, 3, MANY);
	CHECK(grid_stage_discard(f.fd, "stage", &err));
	assert_int_equal(folder_files(&f, ""), 2);
	set_free(&s);
	folder_remove(&f);
}

/* A state that does not name the source of a record: the seal fails. */
static void test_unknown_source(void **state)
{
	struct set s = set_make(SHAPE_UNIFORM, 1000, 2, 1);
	struct folder f = folder_new();
	struct grid_stage_params params = {f.fd, "stage", memory, true};
	struct grid_state one, other;
	struct grid_segment_info info;
	struct grid_stage *stage;
	struct err err = ERR_INIT;

	suspend_each(&params, &s, 2);
	CHECK(grid_state_read(f.fd, "stage", &one, &err));
	other = one;
	other.nsources = 1;
	CHECK(grid_state_write(f.fd, "stage", &other, true, &err));
	grid_state_free(&one);
	CHECK(grid_stage_resume(&params, &stage, &err));
	assert_int_equal(grid_stage_seal(stage, &info, &err), -ERR_INTERNAL);
	grid_stage_free(stage);
	set_free(&s);
	folder_remove(&f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_death),
		cmocka_unit_test(test_drop),
		cmocka_unit_test(test_segments_of_one_stage),
		cmocka_unit_test(test_drop_and_suspend),
		cmocka_unit_test(test_part_of_many_runs),
		cmocka_unit_test(test_unknown_source),
		cmocka_unit_test(test_damage),
	};

	no_sync();
	return cmocka_run_group_tests_name("grid: stages that are left", tests, NULL, NULL);
}
