/*
 * Pending pushes and the pushes after them: what a push does not name stays, what it names is not read again, and each file is in
 * the dataset once. What they cost: time, bytes of the disk, and calls.
 */
#include "grid_merge.h"
#include "pending.h"

/* Into a dataset without points, and into one with some; with a restart before each step, and without. */
static void test_unrelated(void **state)
{
	for (unsigned way = 0; way < 4; way++) {
		unsigned in = way & 1;

		if (in)
			push_all("5");
		interrupt("012");
		if (way & 2)
			restart();
		expect(1, 3, in);
		push_all("4");
		expect_known("4", PUSH_NEW);
		expect(1, 3, in + 1);
		if (way & 2)
			restart();
		expect(1, 3, in + 1);
		/* Also one that is interrupted itself. */
		interrupt("3");
		expect(2, 4, in + 1);
		if (way & 2)
			restart();
		push_all("012");
		expect_known("012", PUSH_ADOPTED);
		expect(1, 1, in + 4);
		push_all("3");
		expect_known("3", PUSH_ADOPTED);
		expect(0, 0, in + 5);
		no_leftovers();
		restart();
		expect(0, 0, in + 5);
		push_all("012345");
		expect_known("01234", PUSH_KNOWN);
		teardown(state);
		setup(state);
	}
}

/* What a push names goes into the dataset, and the rest stays, however often. */
static void test_partly_named(void **state)
{
	for (unsigned way = 0; way < 2; way++) {
		interrupt("0123");
		push_all("14");
		expect_known("1", PUSH_ADOPTED);
		expect(1, 3, 2);
		if (way)
			restart();
		expect(1, 3, 2);
		push_all("01");
		expect_known("0", PUSH_ADOPTED);
		expect_known("1", PUSH_KNOWN);
		expect(1, 2, 3);
		if (way)
			restart();
		/* Interrupted again, with a new file: all are pending together. */
		interrupt("25");
		expect_known("2", PUSH_ADOPTED);
		expect(1, 3, 3);
		if (way)
			restart();
		push_all("012345");
		expect_known("235", PUSH_ADOPTED);
		expect_known("014", PUSH_KNOWN);
		expect(0, 0, 6);
		no_leftovers();
		restart();
		expect(0, 0, 6);
		teardown(state);
		setup(state);
	}
}

/* The same with files of lines beside the points. */
static void test_lines(void **state)
{
	for (unsigned i = 0; i < 3; i++) {
		replace_file(i, lines_file(8, i));
	}
	interrupt("0134");
	push_all("03");
	expect_known("03", PUSH_ADOPTED);
	assert_int_equal(info().pending_files, 2);
	restart();
	assert_int_equal(info().pending_files, 2);
	push_all("124");
	expect_known("14", PUSH_ADOPTED);
	expect_known("2", PUSH_NEW);
	assert_int_equal(info().pending, 0);
	assert_int_equal(info().files, 5);
	no_leftovers();
}

/* The segment of points of push `id` has those of so many files. */
static void expect_segment(unsigned id, unsigned files)
{
	char name[32];
	struct grid_segment_info segment = {0};
	struct grid_manifest *m;
	struct err err = ERR_INIT;
	struct dataset *d = dataset_find(h.service->datasets, "a", &me);
	int dirfd = open_folder();

	snprintf(name, sizeof name, "push-%u.seg", id);
	assert_int_equal(grid_manifest_read(dirfd, d->manifest, &m, &err), 0);
	for (size_t i = 0; i < m->nsegments; i++)
		if (!strcmp(m->segments[i].file, name))
			segment = m->segments[i];
	assert_int_equal(segment.points, files * EACH);
	grid_manifest_free(m);
	close(dirfd);
}

/* A commit whose line set needs more memory than it was first given begins again, and leaves out again what was not named. */
static void test_lines_again(void **state)
{
	replace_file(3, lines_file(600, 3));
	close_service();
	open_service(UINT64_C(64) << 20, 2);
	interrupt("012");
	push_all("03");
	expect_known("0", PUSH_ADOPTED);
	expect_segment(2, 1);
	assert_int_equal(info().pending_files, 2);
	push_all("12");
	expect_known("12", PUSH_ADOPTED);
	expect_segment(3, 2);
	assert_int_equal(info().pending, 0);
	no_leftovers();
}

/* A pending push of more runs than can be merged at once, most of them of a file that was not read whole: a commit of a part
 * merges runs that have other files, too, and these can still be committed. */
static void test_many_runs(void **state)
{
	int dirfd;
	struct grid_stage_params params = {.name = "push-1", .memory = GRID_STAGE_MIN};
	const struct point point = {.x = 1};
	struct grid_stage *runs;
	struct err err = ERR_INIT;

	interrupt("012");
	close_service();
	params.dirfd = dirfd = open_folder();
	assert_int_equal(grid_stage_resume(&params, &runs, &err), 0);
	assert_int_equal(grid_stage_source(runs, 1000, &err), 0);
	for (unsigned i = 0; i < GRID_MERGE_INPUTS; i++) {
		assert_int_equal(grid_stage_add(runs, &point, 1, &err), 0);
		assert_int_equal(grid_stage_suspend(runs, &err), 0);
	}
	grid_stage_detach(runs);
	open_service(UINT64_C(32) << 20, 2);
	for (char file = '0'; file <= '2'; file++) {
		if (file > '0')
			assert_int_equal(faccessat(dirfd, "push-1.1.run", F_OK, 0), -1); /* merged */
		push_all((char[]){file, '\0'});
		expect_known((char[]){file, '\0'}, PUSH_ADOPTED);
		expect_segment(2 + (unsigned)(file - '0'), 1);
	}
	expect(0, 0, 3);
	no_leftovers();
	close(dirfd);
}

/* The list of files says other points than were staged: nothing is committed, and the push stays pending. */
static void test_wrong_points(void **state)
{
	struct grid_manifest *m;
	struct err err = ERR_INIT;
	int dirfd;

	interrupt("01");
	dirfd = open_folder();
	assert_int_equal(grid_manifest_read(dirfd, "push-1.pending", &m, &err), 0);
	m->sources[0].points++;
	assert_int_equal(grid_manifest_write(dirfd, "push-1.pending", m, &err), 0);
	grid_manifest_free(m);
	close(dirfd);
	begin_of(&me);
	stage("01");
	expect_known("01", PUSH_ADOPTED);
	ask(push_commit(got.push, NULL));
	assert_int_equal(got.why.code, ERR_CORRUPT);
	assert_non_null(strstr(got.why.hint, "acutctl dataset discard a"));
	leave();
	assert_int_equal(info().points, 0);
	assert_int_equal(info().pending_files, 2);
}

static void shell(const char *format)
{
	char command[256];

	snprintf(command, sizeof command, format, h.folder, h.folder);
	assert_int_equal(system(command), 0);
}

/* A crash comes between a commit and the shortening of the list of files. */
static void test_crash(void **state)
{
	interrupt("012");
	shell("cp %s/datasets/1/push-1.pending %s/old");
	push_all("03");
	close_service();
	shell("cp %s/old %s/datasets/1/push-1.pending");
	open_service(UINT64_C(32) << 20, 2);
	expect(1, 2, 2);
	/* The start has shortened it. */
	shell("! cmp -s %s/old %s/datasets/1/push-1.pending");
	push_all("0123");
	expect_known("03", PUSH_KNOWN);
	expect_known("12", PUSH_ADOPTED);
	expect(0, 0, 4);
	no_leftovers();
}

/* An abort gives back what it has named, and nothing of its own. */
static void test_aborted(void **state)
{
	interrupt("012");
	begin_of(&me);
	stage("014");
	expect_known("01", PUSH_ADOPTED);
	ask(push_abort(got.push, NULL));
	leave();
	expect(1, 3, 0);
	restart();
	expect(1, 3, 0);
	push_all("0124");
	expect_known("012", PUSH_ADOPTED);
	expect_known("4", PUSH_NEW);
	expect(0, 0, 4);
	no_leftovers();
}

/* Two pushes at once want the same pending push: the first that names a file has it, and the other reads its files itself. */
static void test_two_at_once(void **state)
{
	struct push *first, *second, *third;

	push_all("5");
	interrupt("01");
	begin_of(&me);
	first = got.push;
	begin_of(&me);
	third = got.push;
	begin_of(&me);
	second = got.push;
	assert_int_equal(probe(0), PUSH_ADOPTED);
	assert_int_equal(info().pending, 0);
	got.push = first;
	assert_int_equal(probe(1), PUSH_NEW);
	got.push = second;
	push_leave(second);
	turn_until(pushes_open(h.service->pushes) == 2);
	expect(1, 2, 1);
	/* It is there again, but the third one looked before, and its files may be others now. */
	got.push = third;
	assert_int_equal(probe(0), PUSH_NEW);
	push_leave(third);
	got.push = first;
	leave();
	expect(1, 2, 1);
	push_all("01");
	expect_known("01", PUSH_ADOPTED);
	expect(0, 0, 3);
}

/* Pushes that go on at once, each with what it left. */
static void test_each_its_own(void **state)
{
	struct push *first, *second;

	push_all("5");
	interrupt("01");
	interrupt("23");
	expect(2, 4, 1);
	begin_of(&me);
	first = got.push;
	begin_of(&me);
	second = got.push;
	assert_int_equal(probe(0), PUSH_ADOPTED);
	got.push = first;
	assert_int_equal(probe(2), PUSH_ADOPTED);
	assert_int_equal(probe(3), PUSH_ADOPTED);
	assert_int_equal(info().pending, 0);
	ask(push_commit(got.push, NULL));
	assert_int_equal(got.why.code, 0);
	dataset_release(got.committed.dataset);
	push_leave(first);
	got.push = second;
	assert_int_equal(probe(1), PUSH_ADOPTED);
	commit();
	expect(0, 0, 5);
	no_leftovers();
}

/* Files that were pushed from elsewhere, or were read anew with other options, are not kept as pending ones. */
static void test_superseded(void **state)
{
	push_all("5");
	interrupt("01");
	begin_as(&(struct push_params){.dataset = "a", .peer = me, .calls = &calls, .says = {.planar = true}});
	stage("0");
	expect_known("0", PUSH_NEW);
	commit();
	/* Half of it: it may still be continued. */
	expect(1, 2, 2);
	push_all("01");
	expect_known("0", PUSH_KNOWN);
	expect_known("1", PUSH_ADOPTED);
	expect(0, 0, 3);
	interrupt("23");
	begin_as(&(struct push_params){.dataset = "a", .peer = me, .calls = &calls, .says = {.planar = true}});
	stage("23");
	expect_known("23", PUSH_NEW);
	commit();
	expect(0, 0, 5);
	no_leftovers();
}

/* A file that was named twice, and then not staged, is not in the dataset: it stays pending. */
static void test_named_twice(void **state)
{
	push_all("5");
	interrupt("1");
	begin_as(&(struct push_params){.dataset = "a", .peer = me, .calls = &calls, .says = {.planar = true}});
	probe(1);
	probe(1);
	probe(2);
	ask(push_plan(got.push, NULL));
	ask(push_file(got.push, dup(fd[2]), input_of(2), NULL));
	assert_int_equal(got.why.code, 0);
	commit();
	expect(1, 1, 2);
	push_all("1");
	expect_known("1", PUSH_ADOPTED);
	expect(0, 0, 3);
}

static void test_two_users(void **state)
{
	interrupt_of(&bert, "01");
	interrupt("12");
	expect(2, 4, 0);
	push_all("0123");
	expect_known("12", PUSH_ADOPTED);
	expect_known("03", PUSH_NEW);
	/* On the lattice of the other one, who can go on. */
	expect(1, 2, 4);
	push_of(&bert, "014");
	expect_known("01", PUSH_KNOWN);
	/* The dataset has all of them. */
	expect(0, 0, 5);
	no_leftovers();
}

/* A commit of a part does not begin the 7 days of the rest anew; an interruption does. */
static void test_time(void **state)
{
	int64_t until;

	interrupt("012");
	until = info().pending_until_us;
	usleep(2000);
	push_all("0");
	assert_int_equal(info().pending_until_us, until);
	restart();
	assert_int_equal(info().pending_until_us, until);
	usleep(2000);
	interrupt("1");
	assert_true(info().pending_until_us > until);
	until = info().pending_until_us;
	restart();
	assert_int_equal(info().pending_until_us, until);
}

/* Bytes of the disk, as accounts and limits have them, include what of the runs is committed already. */
static void test_bytes(void **state)
{
	struct dataset *d;

	replace_file(0, text_file(20000, 1));
	interrupt("01");
	d = dataset_find(h.service->datasets, "a", &me);
	assert_true(d->pending->bytes >= 20400 * 16);
	push_all("0");
	assert_int_equal(d->pending->points, EACH);
	assert_true(d->pending->bytes >= 20400 * 16);
	restart();
	d = dataset_find(h.service->datasets, "a", &me);
	assert_int_equal(d->pending->points, EACH);
	assert_true(d->pending->bytes >= 20400 * 16);
}

/* What a pending push has on the disk already needs no free bytes again, and stays in the accounts. */
static void test_space(void **state)
{
	struct space_stat first, status;
	uint64_t held;

	replace_file(0, text_file(20000, 1));
	interrupt("01");
	held = dataset_find(h.service->datasets, "a", &me)->pending->bytes;
	space_stat(h.service->core->space, &first);
	begin_of(&me);
	stage("12");
	expect_known("1", PUSH_ADOPTED);
	assert_true(atomic_load(&got.push->space.taken) < held);
	space_stat(h.service->core->space, &status);
	assert_true(status.kind[SPACE_PENDING].bytes == held + atomic_load(&got.push->space.taken));
	assert_int_equal(got.push->space.own, held + atomic_load(&got.push->space.taken));
	ask(push_abort(got.push, NULL));
	leave();
	space_stat(h.service->core->space, &status);
	assert_int_equal(status.kind[SPACE_PENDING].bytes, first.kind[SPACE_PENDING].bytes);
}

static atomic_uint opens;

static int count_openat(int dirfd, const char *path, int flags, mode_t mode)
{
	opens += strstr(path, ".run") != NULL;
	return io_system.openat(dirfd, path, flags, mode);
}

/* Whoever goes on and is interrupted again opens each run three times: for the look, to resume, and at the end; and makes one. */
static void test_opens(void **state)
{
	interrupt("0");
	for (unsigned i = 1; i < FILES; i++) {
		opens = 0;
		interrupt((char[]){'0', (char)('0' + i), '\0'});
		assert_int_equal(opens, 3 * i + 2);
	}
	expect(1, FILES, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		TEST(test_unrelated),   TEST(test_partly_named), TEST(test_lines),      TEST(test_lines_again),
		TEST(test_many_runs),   TEST(test_wrong_points), TEST(test_crash),      TEST(test_aborted),
		TEST(test_two_at_once), TEST(test_each_its_own), TEST(test_superseded), TEST(test_named_twice),
		TEST(test_two_users),   TEST(test_time),         TEST(test_bytes),      TEST(test_space),
		TEST(test_opens),
	};
	struct io_table table = io_system;

	table.openat = count_openat;
	io = &table; /* while there is no other thread */
	return cmocka_run_group_tests(tests, NULL, NULL);
}
