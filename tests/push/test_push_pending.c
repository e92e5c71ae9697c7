/*
 * Pending pushes and the pushes after them: what a push does not name stays, what it names is not read again, and each file is in
 * the dataset once.
 */
#include <errno.h>

#include "fixture.h"
#include "dataset_priv.h"
#include "io.h"
#include "grid_merge.h"
#include "log.h"

enum { FILES = 6, EACH = 400 };

static int fd[FILES];
static enum push_known_as known[FILES];

static const struct peer bert = {.uid = 1001, .pid = 2};

static const struct push_input *input_of(unsigned i)
{
	static char name[FILES][16];
	static struct push_input input[FILES];

	snprintf(name[i], sizeof name[i], "/%u.xyz", i);
	input[i].name = input[i].path = name[i];
	return &input[i];
}

static void begin_as(const struct push_params *in)
{
	memset(&got, 0, sizeof got);
	got.why = ERR_INIT;
	ask(push_begin(h.service->pushes, in, NULL));
	assert_int_equal(got.why.code, 0);
}

static void begin_of(const struct peer *who)
{
	begin_as(&(struct push_params){.dataset = "a", .peer = *who, .calls = &calls, .has_mode = true, .mode = 0666});
}

static enum push_known_as probe(unsigned i)
{
	ask(push_probe(got.push, dup(fd[i]), input_of(i), NULL));
	assert_int_equal(got.why.code, 0);
	return known[i] = got.known;
}

/* Files of this push, as digits; it has begun. Those from `late` on are not staged. */
static void stage(const char *files, char late)
{
	bool any = false;

	for (const char *f = files; *f; f++)
		any |= probe((unsigned)(*f - '0')) == PUSH_NEW;
	if (any)
		ask(push_plan(got.push, NULL));
	assert_int_equal(got.why.code, 0);
	for (const char *f = files; *f; f++) {
		unsigned i = (unsigned)(*f - '0');

		if (known[i] != PUSH_NEW || *f >= late)
			continue;
		ask(push_file(got.push, dup(fd[i]), input_of(i), NULL));
		assert_int_equal(got.why.code, 0);
	}
}

static void leave(void)
{
	push_leave(got.push);
	turn_until(!pushes_open(h.service->pushes));
}

static void interrupt(const char *files)
{
	begin_of(&me);
	stage(files, '9');
	leave();
}

static void commit(void)
{
	ask(push_commit(got.push, NULL));
	if (got.why.code)
		fail_msg("%s %s", got.why.file, got.why.message);
	dataset_release(got.committed.dataset);
	leave();
}

static void push_all(const char *files)
{
	begin_of(&me);
	stage(files, '9');
	commit();
}

static struct dataset_info info(void)
{
	struct dataset *d = dataset_find(h.service->datasets, "a", &me);
	struct dataset_info ret;

	assert_non_null(d);
	dataset_info(d, &ret);
	return ret;
}

/* Pending pushes with so many files, and points of the dataset, in files. */
static void expect(unsigned pushes, unsigned files, unsigned in)
{
	assert_int_equal(info().pending, pushes);
	assert_int_equal(info().pending_files, files);
	assert_int_equal(info().pending_points, files * EACH);
	assert_int_equal(info().points, in * EACH);
}

static void expect_known(const char *files, enum push_known_as as)
{
	for (const char *f = files; *f; f++)
		assert_int_equal(known[*f - '0'], as);
}

static void restart(void)
{
	close_service();
	open_service(UINT64_C(32) << 20, 2);
}

/* No file is left but those of the newest manifest. */
static void no_leftovers(void)
{
	char path[128];
	DIR *dir;
	struct dirent *e;

	turn_until(!service_active(h.service));
	snprintf(path, sizeof path, "%s/datasets/1", h.folder);
	dir = opendir(path);
	assert_non_null(dir);
	while ((e = readdir(dir)))
		if (strstr(e->d_name, ".pending") || strstr(e->d_name, ".run") || strstr(e->d_name, ".stage") ||
		    strstr(e->d_name, ".tmp") || strstr(e->d_name, ".lines-"))
			fail_msg("left behind: %s", e->d_name);
	closedir(dir);
}

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
		close(fd[i]);
		fd[i] = lines_file(8, i);
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

static int open_folder(void)
{
	char path[128];
	int dirfd;

	snprintf(path, sizeof path, "%s/datasets/1", h.folder);
	dirfd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	assert_true(dirfd >= 0);
	return dirfd;
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
	close(fd[3]);
	fd[3] = lines_file(600, 3);
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
	stage("01", '9');
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
	stage("014", '9');
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
	stage("0", '9');
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
	stage("23", '9');
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
	stage("112", '1');
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
	begin_of(&bert);
	stage("01", '9');
	leave();
	interrupt("12");
	expect(2, 4, 0);
	push_all("0123");
	expect_known("12", PUSH_ADOPTED);
	expect_known("03", PUSH_NEW);
	/* On the lattice of the other one, who can go on. */
	expect(1, 2, 4);
	begin_of(&bert);
	stage("014", '9');
	expect_known("01", PUSH_KNOWN);
	commit();
	/* The dataset has all of them. */
	expect(0, 0, 5);
	no_leftovers();
}

static struct discarded discarded;

static void on_discarded(void *token, const struct err *why, const struct discarded *d)
{
	*(int *)token = why ? -(int)why->code : 1;
	discarded = *d;
}

/* Expects that so many pushes with so many files are gone. */
static void discard(const struct peer *who, bool all, unsigned pushes, unsigned files)
{
	int answered = 0;

	dataset_discard(h.service->datasets, "a", who, all, on_discarded, &answered);
	turn_until(answered);
	assert_int_equal(answered, 1);
	assert_int_equal(discarded.pushes, pushes);
	assert_int_equal(discarded.files, files);
	assert_int_equal(discarded.bytes > 0, pushes > 0);
}

static uint64_t counted(void)
{
	struct space_stat stat;

	space_stat(h.service->core->space, &stat);
	return stat.kind[SPACE_PENDING].bytes;
}

/* Those of one user, or of all; never what an open push has taken over. */
static void test_discard(void **state)
{
	uint64_t dropped = log_event_count(LOG_EVENT_PUSH_DROPPED), ids[2], bytes;
	struct dataset *d;
	struct push *open;

	for (unsigned way = 0; way < 2; way++) {
		push_all("5");
		discard(&me, true, 0, 0);
		begin_of(&bert);
		stage("01", '9');
		leave();
		bytes = counted();
		interrupt("12");
		interrupt("3");
		expect(3, 5, 1);
		begin_of(&me);
		open = got.push;
		assert_int_equal(probe(3), PUSH_ADOPTED);
		expect(2, 4, 1);
		d = dataset_find(h.service->datasets, "a", &me);
		assert_int_equal(pushes_into(h.service->pushes, d, me.uid, false, ids, 2), 1);
		assert_int_equal(pushes_into(h.service->pushes, d, bert.uid, false, ids, 2), 0);
		assert_int_equal(pushes_into(h.service->pushes, d, bert.uid, true, ids, 2), 1);
		discard(&me, way, 1 + way, 2 + 2 * way);
		assert_int_equal(info().pending, !way);
		discard(&me, way, 0, 0);
		got.push = open;
		leave();
		expect(2 - way, 3 - 2 * way, 1);
		if (way)
			restart();
		discard(&me, false, 1, 1);
		assert_int_equal(counted(), way ? 0 : bytes);
		expect(!way, way ? 0 : 2, 1);
		restart();
		expect(!way, way ? 0 : 2, 1);
		push_all("123");
		expect_known("123", PUSH_NEW);
		if (!way) {
			/* The other one's is whole. */
			begin_of(&bert);
			stage("01", '9');
			expect_known("0", PUSH_ADOPTED);
			commit();
		}
		expect(0, 0, 5 - way);
		no_leftovers();
		teardown(state);
		setup(state);
	}
	assert_int_equal(log_event_count(LOG_EVENT_PUSH_DROPPED), dropped + 5);
}

static int removals;

static void on_removed(void *token, const struct err *why, struct dataset *d)
{
	assert_null(why);
	removals++;
}

/* The user of a pending push in a removed dataset reaches it by the name, also if another dataset has that now, of the same owner
 * or of another one. */
static void test_discard_removed(void **state)
{
	const struct dataset_action_params remove = {.action = DATASET_REMOVE, .name = "a", .as = "", .peer = me};
	const struct peer other = {.uid = 1002, .pid = 3};
	int answered;
	uint64_t bytes;

	for (unsigned way = 0; way < 3; way++) {
		if (way)
			push_all("5");
		interrupt("2");
		begin_of(&bert);
		stage("01", '9');
		leave();
		removals = 0;
		dataset_act(h.service->datasets, &remove, on_removed, NULL);
		turn_until(removals);
		restart();
		bytes = counted();
		assert_true(bytes > 0);
		/* One who has none does not learn of it. */
		for (unsigned all = 0; all < 2; all++) {
			answered = 0;
			dataset_discard(h.service->datasets, "a", &other, all, on_discarded, &answered);
			turn_until(answered);
			assert_int_equal(answered, -ERR_NOTFOUND);
		}
		if (way == 1)
			push_all("3");
		if (way == 2) {
			begin_of(&bert);
			stage("3", '9');
			commit();
			answered = 0;
			dataset_discard(h.service->datasets, "a", &me, true, on_discarded, &answered);
			turn_until(answered);
			assert_int_equal(answered, -ERR_PERM);
			assert_int_equal(discarded.pushes, 0);
			assert_int_equal(counted(), bytes);
		}
		discard(&bert, false, 1, 2);
		assert_true(counted() > 0 && counted() < bytes);
		discard(&me, way < 2, 1, 1);
		assert_int_equal(counted(), 0);
		/* Without a generation it goes, too. */
		turn_until(!service_active(h.service));
		assert_int_equal(datasets_first(h.service->datasets) != NULL, way > 0);
		restart();
		assert_int_equal(datasets_first(h.service->datasets) != NULL, way > 0);
		teardown(state);
		setup(state);
	}
}

static int no_unlink(int dirfd, const char *path, int flags)
{
	if (strstr(path, "push-")) {
		errno = EIO;
		return -1;
	}
	return unlinkat(dirfd, path, flags);
}

/* What cannot be removed is pending as before, and nothing is said to be discarded. */
static void test_discard_fails(void **state)
{
	uint64_t dropped = log_event_count(LOG_EVENT_PUSH_DROPPED), bytes;
	struct io_table table = io_system;
	int answered = 0;

	interrupt("01");
	interrupt("2");
	bytes = counted();
	table.unlinkat = no_unlink;
	io = &table;
	dataset_discard(h.service->datasets, "a", &me, false, on_discarded, &answered);
	expect(0, 0, 0);
	turn_until(answered);
	io = &io_system;
	assert_int_equal(answered, -ERR_IO);
	expect(2, 3, 0);
	assert_int_equal(counted(), bytes);
	assert_int_equal(log_event_count(LOG_EVENT_PUSH_DROPPED), dropped);
	push_all("01");
	expect_known("01", PUSH_ADOPTED);
	discard(&me, false, 1, 1);
	expect(0, 0, 2);
	no_leftovers();
}

/* The oldest of more than a user may have is dropped; another user has as many. */
static void test_most(void **state)
{
	uint64_t dropped = log_event_count(LOG_EVENT_PUSH_DROPPED);

	begin_of(&bert);
	stage("5", '9');
	leave();
	interrupt("0");
	for (unsigned i = 0; i < PENDING_MOST; i++) {
		close(fd[1]);
		fd[1] = text_file(EACH, 100 + i);
		interrupt("1");
	}
	turn_until(info().pending == PENDING_MOST + 1);
	assert_int_equal(log_event_count(LOG_EVENT_PUSH_DROPPED), dropped + 1);
	push_all("01");
	expect_known("0", PUSH_NEW);
	expect_known("1", PUSH_ADOPTED);
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
	uint64_t bytes;

	close(fd[0]);
	fd[0] = text_file(20000, 1);
	interrupt("01");
	d = dataset_find(h.service->datasets, "a", &me);
	bytes = d->pending->bytes;
	assert_true(bytes >= 20400 * 16);
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

	close(fd[0]);
	fd[0] = text_file(20000, 1);
	interrupt("01");
	held = dataset_find(h.service->datasets, "a", &me)->pending->bytes;
	space_stat(h.service->core->space, &first);
	begin_of(&me);
	stage("12", '9');
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
	struct io_table table = io_system;

	table.openat = count_openat;
	interrupt("0");
	for (unsigned i = 1; i < FILES; i++) {
		io = &table;
		opens = 0;
		interrupt((char[]){'0', (char)('0' + i), '\0'});
		io = &io_system;
		assert_int_equal(opens, 3 * i + 2);
	}
	expect(1, FILES, 0);
}

static int open_files(void **state)
{
	for (unsigned i = 0; i < FILES; i++)
		fd[i] = text_file(EACH, 10 + i);
	return setup(state);
}

static int close_files(void **state)
{
	for (unsigned i = 0; i < FILES; i++)
		close(fd[i]);
	return teardown(state);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(test_unrelated, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_partly_named, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_lines, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_lines_again, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_many_runs, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_wrong_points, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_crash, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_aborted, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_two_at_once, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_each_its_own, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_superseded, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_named_twice, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_two_users, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_discard, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_discard_fails, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_discard_removed, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_most, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_time, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_bytes, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_space, open_files, close_files),
		cmocka_unit_test_setup_teardown(test_opens, open_files, close_files),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
