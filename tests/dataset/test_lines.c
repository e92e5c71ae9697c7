/*
 * Reverts that make a line set, and jobs that ask for one: they wait for memory and let others pass, leave nothing when they
 * fail, and end with the daemon.
 */
#include "fixture.h"
#include "dataset_priv.h"

#include <errno.h>

#include "io.h"

static struct {
	int answers;
	struct err why;
	uint64_t generation;
} result;

static void reverted(void *token, const struct err *why, const struct reverted *r)
{
	result.answers++;
	result.why = why ? *why : ERR_INIT;
	result.generation = r ? r->generation : 0;
}

static enum err_code revert(struct dataset *d, uint64_t generation)
{
	int before = result.answers;

	dataset_revert(d, generation, &me, reverted, NULL);
	turn_until(result.answers > before);
	return result.why.code;
}

/* Files of the dataset whose names begin so. */
static unsigned files(const struct dataset *d, const char *prefix)
{
	char path[128];
	unsigned n = 0;
	struct dirent *e;
	DIR *dir;

	snprintf(path, sizeof path, "%s/datasets/%llu", h.folder, (unsigned long long)d->id);
	dir = opendir(path);
	assert_non_null(dir);
	while ((e = readdir(dir)))
		n += *e->d_name != '.' && !strncmp(e->d_name, prefix, strlen(prefix));
	closedir(dir);
	return n;
}

/* Line sets of earlier generations are gone. */
static void settle(const struct dataset *d)
{
	turn_until(!service_active(h.service) && files(d, "lineset-") <= 1);
	assert_int_equal(files(d, "vertices-"), files(d, "lineset-"));
	assert_int_equal(admission_staged_bytes(h.service->admission), 0);
}

/* A line set waits for memory; the worker that found that there is none has ended. */
static bool waits_for_memory(void)
{
	return h.service->datasets->lines;
}

/* Points, then three files of lines: no two of these without the first were in one generation. */
static struct dataset *make(void)
{
	static const char *const name[] = {"1.txt", "2.txt", "3.txt"};
	struct dataset *d = push("s", 500, 9);

	for (unsigned i = 0; i < 3; i++)
		dataset_release(push_file_as("s", name[i], lines_file(10 + i, i + 1)));
	assert_int_equal(d->generation, 4);
	settle(d);
	return d;
}

static uint64_t pushes_in_catalogue(void)
{
	char path[128];
	sqlite3 *db;
	sqlite3_stmt *s;
	uint64_t n;

	snprintf(path, sizeof path, "%s/catalogue.db", h.folder);
	assert_int_equal(sqlite3_open_v2(path, &db, SQLITE_OPEN_READONLY, NULL), SQLITE_OK);
	assert_int_equal(sqlite3_prepare_v2(db, "SELECT count(*) FROM push", -1, &s, NULL), SQLITE_OK);
	assert_int_equal(sqlite3_step(s), SQLITE_ROW);
	n = (uint64_t)sqlite3_column_int64(s, 0);
	sqlite3_finalize(s);
	sqlite3_close(db);
	return n;
}

/* One is made once; what it held is given back, and no row is left. */
static void test_made(void **state)
{
	struct dataset *d = make();
	unsigned all = files(d, "");

	assert_int_equal(d->segments, 2);
	assert_int_equal(revert(d, 2), 0);
	assert_int_equal(result.generation, 5);
	settle(d);
	assert_int_equal(files(d, "lineset-"), 1);
	assert_int_equal(files(d, ""), all);
	assert_int_equal(d->segments, 2);
	assert_int_equal(pushes_in_catalogue(), 0);
	for (unsigned i = 0; i < 3; i++) {
		assert_int_equal(revert(d, 0), 0);
		settle(d);
		assert_int_equal(files(d, ""), all);
	}
	/* Without lines there is none. */
	assert_int_equal(revert(d, 4), 0);
	assert_int_equal(revert(d, 3), 0);
	assert_int_equal(revert(d, 2), 0);
	settle(d);
	assert_int_equal(files(d, "lineset-"), 0);
	dataset_release(d);
}

/* While it waits for memory, others change the dataset. */
static void test_waits(void **state)
{
	struct dataset *d = make();
	int before = result.answers;
	uint64_t left = ledger_left(h.ledger) - (256 << 10);

	assert_true(ledger_take(h.ledger, LEDGER_INPUT, left));
	dataset_revert(d, 2, &me, reverted, NULL);
	turn_until(waits_for_memory());
	assert_int_equal(result.answers, before);
	assert_null(d->committer);
	assert_true(service_active(h.service));
	assert_int_equal(revert(d, 1), 0);
	assert_int_equal(result.answers, ++before);
	sched_give(h.sched, LEDGER_INPUT, left);
	turn_until(result.answers > before);
	assert_int_equal(result.why.code, 0);
	assert_int_equal(d->generation, 6);
	assert_int_equal(d->points, 0);
	settle(d);
	assert_int_equal(files(d, "lineset-"), 1);
	dataset_release(d);
}

static struct job *submit_at(struct dataset *d, uint64_t generation)
{
	struct job_params p = {.dataset = d, .generation = generation, .view = VIEW, .fresh = true, .peer = me};
	int before = accepts;

	job_submit(h.service->jobs, &p, accepted, NULL);
	turn_until(accepts > before);
	assert_non_null(accepted_job);
	return accepted_job;
}

/* Jobs of an earlier generation wait for one line set, without a slot; it stays until the lines change. */
static void test_asked(void **state)
{
	struct dataset *d = make();
	uint64_t left = ledger_left(h.ledger) - (2 << 20);
	char digest[3][DIGEST_HEX_SIZE];
	struct job *job[3];

	assert_true(ledger_take(h.ledger, LEDGER_INPUT, left));
	job[0] = submit_at(d, 2);
	turn_until(waits_for_memory() && !admission_tally(h.service->admission, me.uid).runs);
	assert_int_equal(d->asks, 1);
	assert_null(d->committer);
	job[1] = submit_at(d, 2);
	sched_give(h.sched, LEDGER_INPUT, left);
	for (unsigned i = 0; i < 2; i++) {
		turn_until_final(job[i]);
		assert_int_equal(info_of(job[i]).state, JOB_done);
		snprintf(digest[i], sizeof digest[i], "%s", info_of(job[i]).report->digest);
	}
	assert_string_equal(digest[0], digest[1]);
	assert_int_equal(d->asks, 0);
	assert_int_equal(files(d, "lineset-"), 2);
	assert_int_equal(d->generation, 4);
	job[2] = submit_at(d, 2);
	turn_until_final(job[2]);
	assert_string_equal(info_of(job[2]).report->digest, digest[0]);
	assert_int_equal(files(d, "lineset-"), 2);
	/* Other points leave it there, other lines do not. */
	assert_int_equal(revert(d, 1), 0);
	turn_until(!service_active(h.service));
	assert_int_equal(files(d, "lineset-"), 2);
	assert_int_equal(revert(d, 4), 0);
	settle(d);
	assert_int_equal(files(d, "lineset-"), 1);
	dataset_release(d);
}

static int fail_from, calls_made;

static int fails(int fd)
{
	if (++calls_made < fail_from)
		return fsync(fd);
	errno = EIO;
	return -1;
}

/* Whatever of its files cannot be made durable: nothing has changed, and nothing stays. */
static void test_failures(void **state)
{
	struct dataset *d = make();
	const struct io_table *whole = io;
	struct io_table broken = *io;
	unsigned all = files(d, "");

	broken.fsync = fails;
	for (fail_from = 1;; fail_from++) {
		enum err_code code;

		calls_made = 0;
		io = &broken;
		code = revert(d, 2);
		turn_until(!service_active(h.service));
		io = whole;
		if (!code)
			break;
		assert_int_equal(code, ERR_IO);
		assert_int_equal(d->generation, 4);
		/* If the removal is not durable, a row leads the next start to it. */
		assert_int_equal(files(d, ""), all);
		assert_null(d->committer);
		assert_int_equal(admission_staged_bytes(h.service->admission), 0);
	}
	assert_true(fail_from > 4);
	assert_int_equal(d->generation, 5);
	dataset_release(d);
	close_service();
	open_service(UINT64_C(32) << 20, 2);
	turn_until(!service_active(h.service));
	assert_int_equal(pushes_in_catalogue(), 0);
}

/* The daemon stops while it waits. */
static void test_stop(void **state)
{
	struct dataset *d = make();
	int before = result.answers;
	uint64_t left = ledger_left(h.ledger) - (256 << 10);

	assert_true(ledger_take(h.ledger, LEDGER_INPUT, left));
	dataset_revert(d, 2, &me, reverted, NULL);
	turn_until(waits_for_memory());
	assert_int_equal(result.answers, before);
	dataset_release(d);
	service_stop(h.service);
	turn_until(result.answers > before);
	assert_true(result.why.code == ERR_BUSY || result.why.code == ERR_CANCELLED);
	sched_give(h.sched, LEDGER_INPUT, left);
	turn_until(service_is_stopped(h.service));
	close_service();
	open_service(UINT64_C(32) << 20, 2);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(test_made, setup, teardown),
		cmocka_unit_test_setup_teardown(test_waits, setup, teardown),
		cmocka_unit_test_setup_teardown(test_asked, setup, teardown),
		cmocka_unit_test_setup_teardown(test_failures, setup, teardown),
		cmocka_unit_test_setup_teardown(test_stop, setup, teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
