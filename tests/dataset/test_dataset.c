/*
 * Requests about a whole dataset, in one process: permissions, turns of committers, failures, and what is kept for jobs.
 */
#include "dataset_rewrite.h"
#include "fixture.h"
#include "job_priv.h"

#include <errno.h>

#include "io.h"

static const struct peer other = {.uid = 1001, .pid = 2}, root = {.uid = 0, .pid = 3};

static struct {
	int answers;
	struct err why;
	struct reverted reverted;
	struct grid_generation generation;
	struct dataset *dataset;
} result;

static void reverted(void *token, const struct err *why, const struct reverted *r)
{
	result.answers++;
	result.why = why ? *why : ERR_INIT;
	if (!r)
		return;
	result.reverted = *r;
	result.generation = *r->made; /* valid during the call only */
}

static void changed(void *token, const struct err *why, struct dataset *d)
{
	result.answers++;
	result.why = why ? *why : ERR_INIT;
	result.dataset = d;
}

static enum err_code revert(struct dataset *d, uint64_t generation, const struct peer *peer)
{
	int before = result.answers;

	dataset_revert(d, generation, peer, reverted, NULL);
	turn_until(result.answers > before);
	return result.why.code;
}

static enum err_code act(enum dataset_action what, const char *name, const struct peer *peer)
{
	struct dataset_action_params w = {.action = what, .name = name, .as = "", .peer = *peer};
	int before = result.answers;

	dataset_act(h.service->datasets, &w, changed, NULL);
	turn_until(result.answers > before);
	return result.why.code;
}

static unsigned manifests(const struct dataset *d)
{
	char path[128];
	unsigned n = 0;
	struct dirent *e;
	DIR *dir;

	snprintf(path, sizeof path, "%s/datasets/%llu", h.folder, (unsigned long long)d->id);
	dir = opendir(path);
	assert_non_null(dir);
	while ((e = readdir(dir)))
		n += !strncmp(e->d_name, "manifest-", 9);
	closedir(dir);
	return n;
}

/* The owner and root may change a dataset; another user sees it and may not. */
static void test_rights(void **state)
{
	struct dataset *d = push("s", 100, 1);

	assert_int_equal(revert(d, 0, &other), ERR_PERM);
	for (enum dataset_action v = DATASET_REMOVE; v <= DATASET_UNPIN; v++)
		assert_int_equal(act(v, "s", &other), v == DATASET_RESTORE ? ERR_NOTFOUND : ERR_PERM);
	assert_int_equal(d->generation, 1);
	assert_int_equal(revert(d, 0, &root), 0);
	assert_int_equal(result.reverted.generation, 2);
	assert_int_equal(result.reverted.undone, 1);
	assert_int_equal(result.generation.files_removed, 1);
	assert_int_equal(act(DATASET_PIN, "s", &root), 0);
	assert_int_equal(act(DATASET_REMOVE, "s", &me), ERR_CONFLICT);
	assert_int_equal(act(DATASET_UNPIN, "s", &me), 0);
	dataset_release(d);
	assert_int_equal(act(DATASET_REMOVE, "s", &me), 0);
	assert_null(dataset_removed_after(h.service->datasets, 0, &other));
	assert_ptr_equal(dataset_removed_after(h.service->datasets, 0, &me), d);
	assert_ptr_equal(dataset_removed_after(h.service->datasets, 0, &root), d);
	assert_int_equal(act(DATASET_RESTORE, "s", &other), ERR_NOTFOUND);
	assert_int_equal(act(DATASET_RESTORE, "s", &root), 0);
	assert_int_equal(d->uid, me.uid);
}

/* A revert waits for another committer; a removal is refused meanwhile. */
static void test_turns(void **state)
{
	struct dataset *d = push("s", 100, 1);
	int before = result.answers, x;

	d->committer = &x;
	dataset_revert(d, 0, &me, reverted, NULL);
	dataset_revert(d, 2, &me, reverted, NULL);
	for (int i = 0; i < 20; i++)
		turn(1);
	assert_int_equal(result.answers, before);
	assert_int_equal(act(DATASET_REMOVE, "s", &me), ERR_BUSY);
	assert_int_equal(result.answers, ++before);
	d->committer = NULL;
	turn_until(result.answers == before + 2);
	assert_int_equal(result.why.code, 0); /* the second revert undoes the first */
	assert_int_equal(d->generation, 3);
	assert_int_equal(d->files, 1);
	assert_null(d->committer);
	assert_int_equal(manifests(d), 1);
	dataset_release(d);
}

/* A removal waits while a merge writes its manifest, and is not refused for what nobody asked for. */
static void test_removal_after_merge(void **state)
{
	struct datasets *ds = h.service->datasets;
	struct dataset *d = push("s", 100, 1);
	struct dataset_rewrite merge = {.dataset = d, .state = REWRITE_COMMITTING};
	struct dataset_action_params removal = {.action = DATASET_REMOVE, .name = "s", .as = "", .peer = me};
	int before = result.answers;

	ds->merge = &merge;
	d->committer = &merge.change;
	dataset_act(ds, &removal, changed, NULL);
	for (int i = 0; i < 20; i++)
		turn(1);
	assert_int_equal(result.answers, before);
	assert_int_equal(d->removed_us, 0);
	d->committer = NULL;
	turn_until(result.answers > before);
	ds->merge = NULL;
	assert_int_equal(result.why.code, 0);
	assert_true(d->removed_us > 0);
	dataset_release(d);
}

/* A revert that has not ended keeps its dataset, also where it gives up its turn for a moment. */
static void test_removal_beside_revert(void **state)
{
	struct dataset *d = push("s", 100, 1);

	d->reverts++;
	assert_int_equal(act(DATASET_REMOVE, "s", &me), ERR_BUSY);
	d->reverts--;
	dataset_release(d);
	assert_int_equal(act(DATASET_REMOVE, "s", &me), 0);
}

/* A manifest whose name somebody is about to open stays. */
static void test_readers(void **state)
{
	struct dataset *d = push("s", 100, 1);

	dataset_read_begin(d);
	assert_int_equal(revert(d, 0, &me), 0);
	assert_int_equal(manifests(d), 2);
	dataset_read_end(d);
	assert_int_equal(revert(d, 0, &me), 0);
	assert_int_equal(manifests(d), 1);
	dataset_release(d);
}

/* A push removes what a crash left beside the newest manifest. */
static void test_left(void **state)
{
	static const char *const left[] = {"manifest-left", "sources-left"};
	char path[2][160];
	struct dataset *d = push("s", 100, 1);

	for (int i = 0; i < 2; i++) {
		snprintf(path[i], sizeof path[i], "%s/datasets/%llu/%s", h.folder, (unsigned long long)d->id, left[i]);
		assert_return_code(symlink("nothing", path[i]), errno);
	}
	dataset_release(d);
	close_service();
	open_service(UINT64_C(32) << 20, 2);
	d = push("s", 100, 2);
	for (int i = 0; i < 2; i++)
		assert_int_equal(unlink(path[i]), -1);
	turn_until(!service_active(h.service));
	assert_int_equal(manifests(d), 1);
	dataset_release(d);
}

static int fails(int fd)
{
	errno = EIO;
	return -1;
}

/* A generation that could not be written does not exist. */
static void test_failure(void **state)
{
	struct dataset *d = push("s", 100, 1);
	struct io_table broken = *io;
	const struct io_table *whole = io;

	broken.fsync = fails;
	/* The push has ended and no worker runs. */
	turn_until(!service_active(h.service));
	io = &broken;
	assert_int_equal(revert(d, 0, &me), ERR_IO);
	turn_until(!service_active(h.service));
	io = whole;
	assert_int_equal(d->generation, 1);
	assert_int_equal(d->files, 1);
	assert_int_equal(manifests(d), 1);
	assert_int_equal(revert(d, 0, &me), 0);
	assert_int_equal(d->generation, 2);
	dataset_release(d);
}

/* The points of a removed dataset stay as long as a job needs them, and no longer. */
static void test_expiry(void **state)
{
	struct dataset *d = push("s", 40000, 1);
	struct reader slow = {.output.calls = &reader_calls, .slow = true};
	uint64_t id = d->id;
	struct job *job;
	char path[128];

	h.service->core->p.limits.keep_removed = 0.001;
	job = submit(d, false, VIEW);
	job_fetch(job, &slow.output);
	turn_until(slow.sending);
	dataset_release(d);
	assert_int_equal(act(DATASET_REMOVE, "s", &me), 0);
	usleep(5000);
	datasets_expire(h.service->datasets);
	snprintf(path, sizeof path, "%s/datasets/%llu", h.folder, (unsigned long long)id);
	assert_int_equal(access(path, F_OK), 0);
	assert_non_null(info_of(job).dataset);
	read_on(&slow);
	turn_until(slow.ends);
	assert_false(slow.failed);
	turn_until_final(job);
	assert_true(info_of(job).state == JOB_done);
	turn_until(!job->fetches && !job->run);
	datasets_expire(h.service->datasets);
	turn_until(access(path, F_OK) != 0);
	assert_null(info_of(job).dataset);
	assert_null(dataset_removed_after(h.service->datasets, 0, &root));
	slow = (struct reader){.output.calls = &reader_calls};
	job_fetch(job, &slow.output);
	turn_until(slow.ends);
	assert_int_equal(slow.why.code, ERR_GONE);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(test_rights, setup, teardown),
		cmocka_unit_test_setup_teardown(test_turns, setup, teardown),
		cmocka_unit_test_setup_teardown(test_removal_after_merge, setup, teardown),
		cmocka_unit_test_setup_teardown(test_removal_beside_revert, setup, teardown),
		cmocka_unit_test_setup_teardown(test_readers, setup, teardown),
		cmocka_unit_test_setup_teardown(test_left, setup, teardown),
		cmocka_unit_test_setup_teardown(test_failure, setup, teardown),
		cmocka_unit_test_setup_teardown(test_expiry, setup, teardown),
	};

	return cmocka_run_group_tests_name("datasets", tests, NULL, NULL);
}
