/* Requests of a push with the real engine, in one process: refusals, what is kept of each file, and two pushes at once. */
#include "fixture.h"

#include <errno.h>
#include <malloc.h>

#include "io.h"

static void refused_descriptors(void **state)
{
	int ends[2], fd;

	begin("");
	assert_int_equal(pipe(ends), 0);
	ask(push_probe(got.push, ends[0], &(const struct push_input){.name = "pipe"}, NULL));
	assert_int_equal(got.why.code, ERR_INPUT);
	assert_string_equal(got.why.file, "pipe");
	assert_non_null(strstr(got.why.message, "is a pipe, not a regular file"));
	close(ends[1]);
	ask(push_probe(got.push, open("/tmp", O_RDONLY), &(const struct push_input){.name = "folder"}, NULL));
	assert_int_equal(got.why.code, ERR_INPUT);
	fd = open(h.folder, O_TMPFILE | O_WRONLY, 0600);
	ask(push_probe(got.push, fd, &(const struct push_input){.name = "writer"}, NULL));
	assert_int_equal(got.why.code, ERR_PERM);
	ask(push_probe(got.push, open("/dev/zero", O_RDONLY), &(const struct push_input){.name = "device"}, NULL));
	assert_int_equal(got.why.code, ERR_INPUT);
	/* The push continues, but there is nothing to plan from. */
	ask(push_plan(got.push, NULL));
	assert_int_equal(got.why.code, ERR_USAGE);
	ask(push_commit(got.push, NULL));
	assert_int_equal(got.why.code, ERR_INPUT);
	ask(push_abort(got.push, NULL));
	assert_true(got.aborted);
	push_leave(got.push);
	begin("../escape");
	assert_int_equal(got.why.code, ERR_USAGE);
}

/* Memory for a file beyond its fixed part is charged: an error of the plan, a coordinate system of its own. */
static void kept_of_files_is_charged(void **state)
{
	enum { FILES = 64 };
	static struct push_request a; /* static: it is large */
	struct push_probed out = {.name = (char *)"out.las"};
	struct err err = ERR_INIT, again;
	char name[16];
	uint64_t used = 0;

	err_set(&err, ERR_INPUT, "it lies %0200d", 1);
	err_add_place(&err, 227, "box");
	err_add_hint(&err, "leave it %0100d", 2);
	err_add_file(&err, out.name);
	assert_int_equal(push_exclude(&out, &err), 0);
	/* No larger than the source that the file would have become. */
	assert_in_range(malloc_usable_size(out.excluded), 1, 3 * sizeof(struct grid_source) + 240);
	push_exclusion(&out, &again);
	free(out.excluded);
	assert_int_equal(again.code, err.code);
	assert_int_equal(again.offset, 227);
	assert_string_equal(again.file, err.file);
	assert_string_equal(again.field, err.field);
	assert_string_equal(again.message, err.message);
	assert_string_equal(again.hint, err.hint);

	begin("");
	a = (struct push_request){.name = name, .path = (char *)"", .columns = (char *)"yxz", .info = {.format = "xyz"}};
	for (unsigned i = 0; i < 2 * FILES; i++) {
		err = ERR_INIT;
		snprintf(name, sizeof name, "%u.las", i);
		if (i >= FILES)
			snprintf(a.info.crs.text, sizeof a.info.crs.text, "system %u", i);
		if (i == FILES)
			used = got.push->table_used;
		assert_int_equal(push_remember_probe(got.push, &a, &err), 0);
		/* Each system is kept once and found again. */
		assert_ptr_equal(push_find_probe(got.push, name)->in.crs, push_keep_crs(got.push, &a.info.crs));
		assert_int_equal(got.push->ncrs, i < FILES ? 1 : i - FILES + 2);
	}
	assert_string_equal(push_find_probe(got.push, name)->reading, "xyz columns=yxz");
	assert_int_equal(got.push->ntexts, 2); /* the reading, and the empty text of what is overridden */
	/* A system of the file, and one of the dataset's plane. */
	assert_true(got.push->table_used >= 2 * used + 2 * FILES * sizeof(struct crs_info));
	assert_true(got.push->table_bytes + 4096 >= got.push->table_used);
	push_leave(got.push);
}

/* Files are excluded one by one; a cancelled push does not wait for the last of them. */
static void nobody_waits_for_the_plan_of_a_cancelled_push(void **state)
{
	static const char *const names[] = {"0.las", "1.las", "2.las"};
	static struct push_request a;
	struct agree_inputs inputs;
	struct err err = ERR_INIT;

	for (unsigned cancelled = 0; cancelled < 2; cancelled++) {
		unsigned out = 0;

		begin("");
		for (unsigned i = 0; i < 3; i++) {
			a = (struct push_request){.name = (char *)names[i], .path = (char *)"", .info = {.format = "las"}};
			for (unsigned k = 0; k < 3; k++)
				a.info.coords.scale[k] = (struct decimal){0, 0};
			err = ERR_INIT;
			assert_int_equal(push_remember_probe(got.push, &a, &err), 0);
		}
		atomic_store(&got.push->cancel, cancelled);
		err = ERR_INIT;
		inputs = push_inputs(got.push);
		assert_int_equal(agree_lattice(&got.push->agree, &inputs, &err), -ERR_INPUT);
		for (unsigned i = 0; i < 3; i++)
			out += push_find_probe(got.push, names[i])->excluded != NULL;
		assert_int_equal(out, cancelled ? 0 : 2);
		push_leave(got.push);
	}
}

/* Only one of two pushes into a new dataset chooses the lattice. */
static void one_planner(void **state)
{
	struct push *first;
	int fd = text_file(100, 10);

	begin("fresh");
	first = got.push;
	ask(push_probe(first, dup(fd), &(const struct push_input){.name = "a.xyz"}, NULL));
	ask(push_plan(first, NULL));
	assert_int_equal(got.why.code, 0);
	begin("fresh");
	ask(push_probe(got.push, fd, &(const struct push_input){.name = "a.xyz"}, NULL));
	ask(push_plan(got.push, NULL));
	assert_int_equal(got.why.code, ERR_BUSY);
	push_leave(got.push);
	push_leave(first);
	turn_until(!service_active(h.service));
	assert_null(dataset_find(h.service->datasets, "fresh", &me));
}

/* A commit that the catalogue refuses leaves a later commit intact. */
static void failed_commit(void **state)
{
	struct dataset *d = push("two", 500, 12);
	struct push *loses = stage_file_as("two", "a.xyz", text_file(300, 13)),
		    *wins = stage_file_as("two", "a.xyz", text_file(200, 14));
	char path[128];
	struct job *job;
	sqlite3 *other;

	turn_until(!catalogue_busy(h.catalogue));
	snprintf(path, sizeof path, "%s/catalogue.db", h.folder);
	assert_int_equal(sqlite3_open(path, &other), SQLITE_OK);
	assert_int_equal(sqlite3_exec(other, "BEGIN IMMEDIATE", NULL, NULL, NULL), SQLITE_OK);
	ask(push_commit(loses, NULL));
	assert_int_equal(got.why.code, ERR_BUSY);
	assert_int_equal(sqlite3_close(other), SQLITE_OK);
	ask(push_commit(wins, NULL));
	assert_int_equal(got.why.code, 0);
	assert_int_equal(got.committed.generation, 2);
	push_leave(loses);
	push_leave(wins);
	turn_until(!service_active(h.service));
	job = submit(d, false, VIEW);
	turn_until_final(job);
	assert_int_equal(info_of(job).state, JOB_done);
	assert_int_equal(info_of(job).report->points, 700);
	dataset_release(got.committed.dataset);
	dataset_release(d);
}

static void changed_file(void **state)
{
	int fd = text_file(100, 11);

	begin("");
	ask(push_probe(got.push, dup(fd), &(const struct push_input){.name = "a.xyz"}, NULL));
	ask(push_plan(got.push, NULL));
	assert_int_equal(pwrite(fd, "1 2 3\n", 6, lseek(fd, 0, SEEK_END)), 6);
	ask(push_file(got.push, fd, &(const struct push_input){.name = "a.xyz"}, NULL));
	assert_int_equal(got.why.code, ERR_CHANGED);
	ask(push_file(got.push, text_file(5, 1), &(const struct push_input){.name = "never-probed.xyz"}, NULL));
	assert_int_equal(got.why.code, ERR_USAGE);
	push_leave(got.push);
}

/* Reads of one file fail, those of others do not. */
static _Atomic ino_t unreadable;
static atomic_uint reads_left;
static ssize_t failing_pread(int fd, void *buf, size_t n, off_t off)
{
	struct stat st;

	if (unreadable && !fstat(fd, &st) && st.st_ino == unreadable && (!reads_left || !atomic_fetch_sub(&reads_left, 1))) {
		errno = EIO;
		return -1;
	}
	return io_system.pread(fd, buf, n, off);
}

static ino_t inode_of(int fd)
{
	struct stat st;

	assert_int_equal(fstat(fd, &st), 0);
	return st.st_ino;
}

/* A file that its disk does not give is left out, in the probe as when its points are read. */
static void unreadable_file(void **state)
{
	int bad = text_file(3000, 11), good = text_file(100, 12);

	begin("three");
	unreadable = inode_of(bad);
	reads_left = 0;
	ask(push_probe(got.push, dup(bad), &(const struct push_input){.name = "bad.xyz"}, NULL));
	assert_int_equal(got.why.code, ERR_IO);
	assert_string_equal(got.why.file, "bad.xyz");
	assert_string_equal(got.why.field, "input");
	unreadable = 0;
	ask(push_probe(got.push, dup(bad), &(const struct push_input){.name = "late.xyz"}, NULL));
	ask(push_probe(got.push, dup(good), &(const struct push_input){.name = "good.xyz"}, NULL));
	ask(push_plan(got.push, NULL));
	assert_int_equal(got.why.code, 0);
	for (unsigned reads = 0; reads < 3; reads++) {
		unreadable = inode_of(bad);
		reads_left = reads;
		ask(push_file(got.push, dup(bad), &(const struct push_input){.name = "late.xyz"}, NULL));
		assert_int_equal(got.why.code, ERR_IO);
		assert_string_equal(got.why.field, "input");
	}
	unreadable = 0;
	ask(push_file(got.push, dup(good), &(const struct push_input){.name = "good.xyz"}, NULL));
	assert_int_equal(got.why.code, 0);
	ask(push_commit(got.push, NULL));
	assert_int_equal(got.why.code, 0);
	push_leave(got.push);
	turn_until(!service_active(h.service));
	struct job *job = submit(got.committed.dataset, false, VIEW);

	turn_until_final(job);
	assert_int_equal(info_of(job).report->points, 100);
	dataset_release(got.committed.dataset);
	close(bad);
	close(good);
}

/* A reader of some parts reads the list of all parts. The number of batches keeps the total small. */
static void many_parts_in_few_readings(void **state)
{
	for (uint64_t parts = 2; parts < UINT64_C(1) << 40; parts = parts * 7 / 4 + 1) {
		for (unsigned members = 1; members <= 65; members += members < 4 ? 1 : 61) {
			uint64_t step = push_helpers_step(parts, members), readings = parts / step;

			assert_in_range(step, 1, parts);
			assert_true(readings <= parts / 16 || readings <= 65 * 16);
			assert_true(readings >= members || readings >= parts / 16 || step == 1);
			assert_true(readings <= 1100);
		}
	}
}

int main(void)
{
#define TEST(f) cmocka_unit_test_setup_teardown(f, setup, teardown)
	const struct CMUnitTest tests[] = {
		TEST(refused_descriptors),
		TEST(one_planner),
		TEST(changed_file),
		TEST(unreadable_file),
		TEST(kept_of_files_is_charged),
		TEST(nobody_waits_for_the_plan_of_a_cancelled_push),
		TEST(failed_commit),
		cmocka_unit_test(many_parts_in_few_readings),
	};
	struct io_table table = io_system;

	table.pread = failing_pread;
	io = &table; /* while there is no other thread */
	return cmocka_run_group_tests(tests, NULL, NULL);
}
