/*
 * A push whose row is on its way to the disk. Requests that read, or put points into memory, continue; those that write wait for
 * the row; a row that cannot be written ends the push. The test holds the row.
 */
#include "fixture.h"
#include "dataset_priv.h"
#include "io.h"

static struct {
	bool hold, held;
	struct catalogue *catalogue;
	struct catalogue_push row;
	catalogue_done_fn done;
	void *ctx;
} put;

int __real_catalogue_put_push(struct catalogue *, const struct catalogue_push *, catalogue_done_fn, void *, struct err *);
int __wrap_catalogue_put_push(struct catalogue *, const struct catalogue_push *, catalogue_done_fn, void *, struct err *);

int __wrap_catalogue_put_push(struct catalogue *c, const struct catalogue_push *row, catalogue_done_fn done, void *ctx,
			      struct err *err)
{
	if (!put.hold)
		return __real_catalogue_put_push(c, row, done, ctx, err);
	put.catalogue = c;
	put.row = *row;
	put.done = done;
	put.ctx = ctx;
	put.held = true;
	return 0;
}

static void let_row(void)
{
	struct err err = ERR_INIT;

	assert_true(put.held);
	put.hold = put.held = false;
	assert_int_equal(__real_catalogue_put_push(put.catalogue, &put.row, put.done, put.ctx, &err), 0);
}

/* The row cannot be written. */
static void fail_row(void)
{
	struct err full = ERR_INIT;

	put.hold = put.held = false;
	err_set(&full, ERR_NOSPACE, "the disk is full");
	put.done(put.ctx, -ERR_NOSPACE, &full);
}

static const struct push_input input = {.name = "a.xyz"};

static void plan_a_file(int fd)
{
	put.hold = true;
	begin("a");
	assert_int_equal(got.why.code, 0);
	assert_true(put.held);
	ask(push_probe(got.push, dup(fd), &input, NULL));
	assert_int_equal(got.why.code, 0);
	ask(push_plan(got.push, NULL));
	assert_int_equal(got.why.code, 0);
}

/* Until a commit is requested and waits. */
static void ask_a_commit(void)
{
	int fd = text_file(500, 3), answers;

	plan_a_file(fd);
	ask(push_file(got.push, fd, &input, NULL));
	assert_int_equal(got.why.code, 0);
	assert_int_equal(got.file.in.points, 500);
	answers = got.answers;
	push_commit(got.push, NULL);
	/* No task runs for it, and nothing that is on its way wakes one. Others look at the disk now and then. */
	turn_until(!sched_busy(h.sched) && !catalogue_busy(h.catalogue));
	turn(0);
	assert_false(got.push->busy);
	assert_int_equal(got.answers, answers);
}

static void test_waits(void **state)
{
	int answers;

	ask_a_commit();
	answers = got.answers;
	let_row();
	turn_until(got.answers > answers);
	assert_int_equal(got.why.code, 0);
	assert_int_equal(got.committed.points, 500);
	push_leave(got.push);
	dataset_release(got.committed.dataset);
}

static void test_fails(void **state)
{
	int answers;

	ask_a_commit();
	answers = got.answers;
	fail_row();
	turn_until(got.answers > answers);
	/* The error is not about the file. */
	assert_int_equal(got.why.code, ERR_NOSPACE);
	assert_string_equal(got.why.file, "");
	assert_string_equal(got.why.field, "push");
	assert_string_equal(got.why.message, "the push into a cannot go on: the disk is full");
	ask(push_commit(got.push, NULL));
	assert_int_equal(got.why.code, ERR_NOSPACE);
	assert_string_equal(got.why.message, "the push into a cannot go on: the disk is full");
	push_leave(got.push);
	turn_until(!pushes_open(h.service->pushes));
}

/* Without a row, points in memory are lost: no start would find them. */
static void test_leaves_without_a_row(void **state)
{
	int fd = text_file(500, 3);

	plan_a_file(fd);
	ask(push_file(got.push, fd, &input, NULL));
	assert_int_equal(got.why.code, 0);
	push_leave(got.push);
	turn(0);
	fail_row();
	turn_until(!pushes_open(h.service->pushes));
	assert_null(datasets_first(h.service->datasets) ? datasets_first(h.service->datasets)->pending : NULL);
}

/* ---- more points than the stage has memory for ---- */

static struct io_table held_io;
static const struct io_table *real_io;
static atomic_int runs;

static int look_openat(int dirfd, const char *path, int flags, mode_t mode)
{
	if ((flags & O_CREAT) && strstr(path, ".run"))
		runs++;
	return real_io->openat(dirfd, path, flags, mode);
}

enum { MANY = 400000 };

/* Requests a File whose worker has to write a run, and waits for the row. */
static void ask_many(void)
{
	int fd = text_file(MANY, 3), answers;

	close_service();
	runs = 0;
	real_io = io;
	held_io = *io;
	held_io.openat = look_openat;
	io = &held_io; /* no other thread reads `io` now */
	open_service(UINT64_C(24) << 20, 2);
	plan_a_file(fd);
	answers = got.answers;
	push_file(got.push, fd, &input, NULL);
	turn_until(got.push->row_awaited || got.answers > answers);
	assert_int_equal(got.answers, answers);
	assert_int_equal(runs, 0);
}

static void test_runs_wait(void **state)
{
	int answers;

	ask_many();
	answers = got.answers;
	let_row();
	turn_until(got.answers > answers);
	assert_int_equal(got.why.code, 0);
	assert_int_equal(got.file.in.points, MANY);
	assert_true(runs > 0);
	ask(push_commit(got.push, NULL));
	assert_int_equal(got.why.code, 0);
	assert_int_equal(got.committed.points, MANY);
	push_leave(got.push);
	dataset_release(got.committed.dataset);
}

static void test_runs_fail(void **state)
{
	int answers;

	ask_many();
	answers = got.answers;
	fail_row();
	turn_until(got.answers > answers);
	assert_int_equal(got.why.code, ERR_NOSPACE);
	assert_int_equal(runs, 0);
	push_leave(got.push);
	turn_until(!pushes_open(h.service->pushes));
}

/* A push that leaves before the row is written gets its worker back at once. */
static void test_runs_leave(void **state)
{
	int answers;

	ask_many();
	answers = got.answers;
	push_leave(got.push);
	turn_until(got.answers > answers);
	assert_int_equal(got.why.code, ERR_CANCELLED);
	let_row();
	turn_until(!pushes_open(h.service->pushes));
	assert_int_equal(runs, 0);
}

/* A push that never gets a row leaves a pending push as it was, whether it names its file or not. */
static void test_fails_beside_a_pending_one(void **state)
{
	const struct push_input named = {.name = "a.xyz", .path = "/a.xyz"}, other = {.name = "b.xyz", .path = "/b.xyz"};
	int fd = text_file(500, 3), fd_of_other = text_file(400, 4);

	push_leave(stage_input("a", &named, dup(fd)));
	turn_until(!pushes_open(h.service->pushes));
	assert_non_null(datasets_first(h.service->datasets)->pending);
	for (unsigned names_it = 0; names_it < 2; names_it++) {
		put.hold = true;
		begin("a");
		assert_int_equal(got.why.code, 0);
		assert_true(put.held);
		if (names_it)
			ask(push_probe(got.push, dup(fd), &named, NULL));
		ask(push_probe(got.push, dup(fd_of_other), &other, NULL));
		assert_int_equal(got.why.code, 0);
		ask(push_plan(got.push, NULL));
		assert_int_equal(got.why.code, 0);
		ask(push_file(got.push, dup(fd_of_other), &other, NULL));
		assert_int_equal(got.why.code, 0);
		fail_row();
		ask(push_commit(got.push, NULL));
		assert_int_equal(got.why.code, ERR_NOSPACE);
		push_leave(got.push);
		turn_until(!pushes_open(h.service->pushes));
		assert_non_null(datasets_first(h.service->datasets)->pending);
		assert_int_equal(datasets_first(h.service->datasets)->pending->files, 1);
	}
	begin("a");
	ask(push_probe(got.push, fd, &named, NULL));
	assert_int_equal(got.known, PUSH_ADOPTED);
	close(fd_of_other);
	push_leave(got.push);
	turn_until(!pushes_open(h.service->pushes));
}

static void test_leaves(void **state)
{
	int answers;

	ask_a_commit();
	answers = got.answers;
	push_leave(got.push);
	turn(0);
	assert_int_equal(got.answers, answers); /* its end waits for the row, to drop it */
	let_row();
	turn_until(got.answers > answers);
	assert_int_equal(got.why.code, ERR_CANCELLED);
	turn_until(!pushes_open(h.service->pushes));
}

/* Also after a failed test: the service waits for the row. */
static int end(void **state)
{
	struct err err = ERR_INIT;
	int r;

	put.hold = false;
	if (put.held) {
		err_set(&err, ERR_CANCELLED, "the test is over");
		put.held = false;
		put.done(put.ctx, -ERR_CANCELLED, &err);
	}
	r = teardown(state);
	if (real_io)
		io = real_io;
	return r;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(test_waits, setup, end),
		cmocka_unit_test_setup_teardown(test_fails, setup, end),
		cmocka_unit_test_setup_teardown(test_fails_beside_a_pending_one, setup, end),
		cmocka_unit_test_setup_teardown(test_leaves, setup, end),
		cmocka_unit_test_setup_teardown(test_leaves_without_a_row, setup, end),
		cmocka_unit_test_setup_teardown(test_runs_wait, setup, end),
		cmocka_unit_test_setup_teardown(test_runs_fail, setup, end),
		cmocka_unit_test_setup_teardown(test_runs_leave, setup, end),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
