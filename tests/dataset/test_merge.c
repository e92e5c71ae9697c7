/*
 * Merging, through the room of jobs: generations can be read as before, the folder becomes small, and what a crash leaves is
 * swept.
 */
#include "segments.h"

static void many_pushes(void **state)
{
	enum { N = 40 };
	struct mesh was[N + 1];

	for (unsigned i = 1; i <= N; i++) {
		dataset_release(push("many", 200 + i, i));
		was[i] = mesh_of("many", i);
		idle();
		assert_true(dataset_of("many").segments <= 6);
	}
	assert_int_equal(dataset_of("many").generation, N);
	assert_true(dataset_of("many").segments <= 4);
	assert_true(h.service->core->tally.merges >= N / 8);
	folder_is_tidy("many");
	for (unsigned i = 1; i <= N; i += 3)
		same_mesh("many", i, &was[i]);
	/* Amortised: merges write a small multiple of what was pushed. */
	assert_true(h.service->core->tally.merged_bytes < 40 * dataset_of("many").bytes);
	assert_int_equal(ledger_held(h.ledger, LEDGER_STAGE), 0);
}

/* Larger segments, so that a merge takes a while. Pushes have precedence. */
static void pushes_meanwhile(void **state)
{
	struct mesh last;

	for (unsigned i = 1; i <= 12; i++)
		dataset_release(push("busy", 20000, i));
	last = mesh_of("busy", 12);
	idle();
	assert_true(dataset_of("busy").segments < 6);
	folder_is_tidy("busy");
	same_mesh("busy", 12, &last);
	assert_int_equal(last.points, 12 * 20000);
}

/* A damaged segment is not merged, and nothing is lost. */
static void damaged(void **state)
{
	int fd, dir;
	char byte = 0x55;

	for (unsigned i = 1; i <= 3; i++)
		dataset_release(push("bad", 500, i));
	idle();
	assert_int_equal(dataset_of("bad").segments, 3);
	dir = folder_of("bad");
	fd = openat(dir, "push-2.seg", O_RDWR | O_CLOEXEC);
	assert_true(fd >= 0);
	assert_int_equal(pwrite(fd, &byte, 1, 5000), 1);
	close(fd);
	close(dir);
	dataset_release(push("bad", 500, 4));
	idle();
	assert_int_equal(dataset_of("bad").segments, 4);
	folder_is_tidy("bad");
}

/* A merge that a crash interrupted: a start sweeps what it made, and only in the folder that the catalogue names. */
static void cut_short(void **state)
{
	static const char *const left[] = {"merge-77-0.seg", "merge-77-1.seg.tmp", "manifest-2-77"};
	struct catalogue_push row = {.id = 77, .uid = me.uid};
	struct err err = ERR_INIT;
	struct mesh was;
	int dir;

	dataset_release(push("cut", 500, 1));
	was = mesh_of("cut", 1);
	idle();
	dir = folder_of("cut");
	for (int i = 0; i < 3; i++)
		close(openat(dir, left[i], O_CREAT | O_WRONLY | O_CLOEXEC, 0600));
	close(dir);
	row.dataset = dataset_of("cut").id;
	assert_int_equal(catalogue_put_push(h.catalogue, &row, NULL, NULL, &err), 0);
	idle();
	close_service();
	open_service(UINT64_C(24) << 20, 1);
	idle();
	folder_is_tidy("cut");
	assert_int_equal(dataset_of("cut").pending, 0);
	same_mesh("cut", 1, &was);
}

/* The quota in bytes; 0: none. */
static void quota(uint64_t bytes)
{
	struct space_limit disk = {bytes ? SPACE_BYTES : SPACE_UNLIMITED, bytes};

	space_set_limits(h.service->core->space, disk, (struct space_limit){SPACE_UNLIMITED, 0});
}

/* A merge without disk space is postponed, twice as long each time, up to a minute. When there is space it is made, and the delay
 * of the next failure is short again. */
static void no_space(void **state)
{
	static const double wanted[] = {1, 2, 4, 8, 16, 32, 64, 64, 64};
	struct datasets *ds = h.service->datasets;
	struct mesh was;

	for (unsigned round = 0; round < 2; round++) {
		uint64_t merges = ds->core->tally.merges;

		ds->merge_after_ns = UINT64_MAX;
		for (unsigned i = 1; i <= 5; i++)
			dataset_release(push("full", 200, 10 * round + i));
		was = mesh_of("full", dataset_of("full").generation);
		quota(1);
		for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++) {
			uint64_t before = clock_mono_ns();

			ds->merge_after_ns = 0;
			turn_until(ds->merge_after_ns && !ds->merge);
			assert_true(ds->merge_delay == wanted[i]);
			assert_true(ds->merge_after_ns >= before + (uint64_t)(wanted[i] * 1e9));
			assert_true(ds->merge_after_ns <= clock_mono_ns() + (uint64_t)(wanted[i] * 1e9));
			/* No further merge. */
			ds->merge_after_ns = UINT64_MAX;
			for (int k = 0; k < 20; k++) {
				turn(0);
				assert_null(ds->merge);
			}
		}
		assert_true(named("full")->merge_due);
		assert_int_equal(ds->core->tally.merges, merges);
		quota(0);
		ds->merge_after_ns = 0;
		idle();
		assert_true(ds->core->tally.merges > merges);
		assert_true(ds->merge_delay == 0);
		assert_true(dataset_of("full").segments < 5);
		folder_is_tidy("full");
		same_mesh("full", dataset_of("full").generation, &was);
	}
}

/* After a restart merges start without a push. */
static void due_at_start(void **state)
{
	h.service->datasets->merge_after_ns = UINT64_MAX; /* no merge */
	for (unsigned i = 1; i <= 9; i++)
		dataset_release(push("later", 100, i));
	assert_int_equal(dataset_of("later").segments, 9);
	close_service();
	open_service(UINT64_C(24) << 20, 1);
	assert_int_equal(dataset_of("later").segments, 9);
	turn_until(dataset_of("later").segments < 4);
	idle();
	folder_is_tidy("later");
}

/* The daemon stops during a merge: no file stays and nothing is lost. */
static void stopped(void **state)
{
	struct mesh was;

	h.service->datasets->merge_after_ns = UINT64_MAX;
	for (unsigned i = 1; i <= 4; i++)
		dataset_release(push("stop", 60000, i));
	was = mesh_of("stop", 4);
	h.service->datasets->merge_after_ns = 0;
	turn_until(h.service->datasets->merge);
	close_service();
	open_service(UINT64_C(24) << 20, 2);
	/* The merge was made or not. */
	assert_true(dataset_of("stop").segments == 4 || dataset_of("stop").segments == 1);
	folder_is_tidy("stop");
	same_mesh("stop", 4, &was);
}

static int rows_of_pushes(void)
{
	char path[128];
	sqlite3 *db;
	sqlite3_stmt *st;
	int n;

	snprintf(path, sizeof path, "%s/catalogue.db", h.folder);
	assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
	sqlite3_busy_timeout(db, 5000);
	assert_int_equal(sqlite3_prepare_v2(db, "SELECT count(*) FROM push WHERE begun_us = 0", -1, &st, NULL), SQLITE_OK);
	assert_int_equal(sqlite3_step(st), SQLITE_ROW);
	n = sqlite3_column_int(st, 0);
	sqlite3_finalize(st);
	sqlite3_close(db);
	return n;
}

/* As long as there is a file of a merge, the catalogue has the row that leads to it. */
static void row_first(void **state)
{
	unsigned seen = 0;
	uint64_t bytes;

	h.service->datasets->merge_after_ns = UINT64_MAX;
	for (unsigned i = 1; i <= 4; i++)
		dataset_release(push("row", 100000, i));
	assert_int_equal(rows_of_pushes(), 0);
	gate_close();
	h.service->datasets->merge_after_ns = 0;
	turn_until(h.service->datasets->merge);
	while (h.service->datasets->merge) {
		turn(1);
		if (!sched_busy(h.sched))
			continue;
		/* A task ends while the loop stands still. */
		let_one();
		if (dataset_of("row").segments == 4 && files_of("row", "merge-", &bytes)) {
			assert_int_equal(rows_of_pushes(), 1);
			seen++;
		}
	}
	gate_open();
	idle();
	assert_true(seen > 0);
	assert_int_equal(rows_of_pushes(), 0);
	folder_is_tidy("row");
}

int main(void)
{
#define TEST(f) cmocka_unit_test_setup_teardown(f, setup, gate_teardown)
	const struct CMUnitTest tests[] = {
		TEST(many_pushes), TEST(pushes_meanwhile), TEST(damaged), TEST(cut_short),
		TEST(no_space),    TEST(due_at_start),     TEST(stopped), TEST(row_first),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
