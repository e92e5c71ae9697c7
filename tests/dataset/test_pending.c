/* What pushes leave on the disk: each removes only its own files. */
#include "fixture.h"
#include "grid_verify.h"

#include <stdatomic.h>

#include "grid.h"

static atomic_llong ahead_ns;
static atomic_bool hold, held;

uint64_t __real_clock_mono_ns(void);
uint64_t __wrap_clock_mono_ns(void);

uint64_t __wrap_clock_mono_ns(void)
{
	return __real_clock_mono_ns() + (uint64_t)atomic_load(&ahead_ns);
}

int __real_grid_verify_stage(const struct grid_verify_params *, const char *stem, struct err *);
int __wrap_grid_verify_stage(const struct grid_verify_params *, const char *stem, struct err *);

int __wrap_grid_verify_stage(const struct grid_verify_params *p, const char *stem, struct err *err)
{
	atomic_store(&held, true);
	while (atomic_load(&hold))
		usleep(1000);
	return __real_grid_verify_stage(p, stem, err);
}

/* Without it the push of a new service has a new dataset. */
static void push_base(void)
{
	struct dataset *d = push("s", 500, 1);

	turn_until(!pushes_open(h.service->pushes));
	dataset_release(d);
}

/* A push of one file, staged and not committed. */
static struct push *stage_file(const char *name, int fd)
{
	const struct push_input input = {.name = name, .path = name};

	begin("s");
	assert_int_equal(got.why.code, 0);
	ask(push_probe(got.push, dup(fd), &input, NULL));
	assert_int_equal(got.why.code, 0);
	ask(push_plan(got.push, NULL));
	assert_int_equal(got.why.code, 0);
	if (got.known == PUSH_NEW)
		ask(push_file(got.push, dup(fd), &input, NULL));
	assert_int_equal(got.why.code, 0);
	return got.push;
}

static void is_durable(void)
{
	atomic_fetch_add(&ahead_ns, INT64_C(6000000000));
	turn_until(got.durable);
}

static uint32_t pending_files(void)
{
	struct dataset *d = dataset_find(h.service->datasets, "s", &me);
	struct dataset_info info;

	assert_non_null(d);
	dataset_info(d, &info);
	return info.pending_files;
}

static void commit(void)
{
	ask(push_commit(got.push, NULL));
	assert_int_equal(got.why.code, 0);
	push_leave(got.push);
	dataset_release(got.committed.dataset);
	turn_until(!pushes_open(h.service->pushes));
}

static void push_file_of(const char *name)
{
	int fd = text_file(500, 7);

	stage_file(name, fd);
	commit();
	close(fd);
}

/* The row of push 1 has so many files. */
static void expect_row(int files)
{
	char path[128];
	sqlite3 *db;
	sqlite3_stmt *stmt;

	turn_until(!catalogue_busy(h.catalogue));
	snprintf(path, sizeof path, "%s/catalogue.db", h.folder);
	assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
	assert_int_equal(sqlite3_prepare_v2(db, "SELECT files FROM push WHERE id = 1", -1, &stmt, NULL), SQLITE_OK);
	assert_int_equal(sqlite3_step(stmt), SQLITE_ROW);
	assert_int_equal(sqlite3_column_int(stmt, 0), files);
	sqlite3_finalize(stmt);
	sqlite3_close(db);
}

/* The row of a push that continues a pending one has the files of that, too. */
static void test_row(void **state)
{
	const struct push_input b = {.name = "b.xyz", .path = "b.xyz"};
	int fd = text_file(500, 2);

	stage_file("a.xyz", fd);
	is_durable();
	expect_row(1);
	push_leave(got.push);
	turn_until(!pushes_open(h.service->pushes));
	stage_file("a.xyz", fd);
	assert_int_equal(got.known, PUSH_ADOPTED);
	close(fd);
	fd = text_file(500, 3);
	ask(push_probe(got.push, dup(fd), &b, NULL));
	ask(push_plan(got.push, NULL));
	ask(push_file(got.push, fd, &b, NULL));
	assert_int_equal(got.why.code, 0);
	is_durable();
	expect_row(2);
	push_leave(got.push);
}

/* A daemon that cannot wait for its pushes removes the files of those that promised nothing, and no others. */
static void test_abandoned_beside(void **state)
{
	int fda = text_file(500, 2), fdb = text_file(500, 3);
	struct push *a, *b;

	push_base();
	a = stage_file("a.xyz", fda);
	is_durable();
	b = stage_file("b.xyz", fdb);
	service_abandon(h.service);
	ask(push_abort(b, NULL));
	push_leave(b);
	push_leave(a);
	close_service();
	open_service(UINT64_C(32) << 20, 2);
	assert_int_equal(pending_files(), 1);
	stage_file("a.xyz", fda);
	assert_int_equal(got.known, PUSH_ADOPTED);
	push_leave(got.push);
	close(fda);
	close(fdb);
}

/* Manifests of a revert that a crash left, complete or not, are removed with the next manifest. */
static void test_half_a_manifest(void **state)
{
	static const char *const left[] = {"manifest-2-c1.tmp", "manifest-2-c1", "manifest-2-c2"};
	char path[128];

	push_base();
	close_service();
	for (unsigned i = 0; i < 3; i++) {
		snprintf(path, sizeof path, "%s/datasets/1/%s", h.folder, left[i]);
		close(open(path, O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
		assert_int_equal(access(path, F_OK), 0);
	}
	open_service(UINT64_C(32) << 20, 2);
	push_file_of("b.xyz");
	for (unsigned i = 0; i < 3; i++) {
		snprintf(path, sizeof path, "%s/datasets/1/%s", h.folder, left[i]);
		assert_int_not_equal(access(path, F_OK), 0);
	}
	push_file_of("c.xyz");
	assert_int_equal(dataset_find(h.service->datasets, "s", &me)->generation, 3);
}

static unsigned damages, overs;

static void damage(void *token, const struct cache_damage *d)
{
	damages++;
}

static void verifying(void *token, const char *phase, uint64_t bytes, uint64_t total) {}

static void verified(void *token, const struct err *why, const struct cache_verified *v)
{
	assert_null(why);
	overs++;
}

/* A push that is taken up and committed during `cache verify` is not damaged; one that lacks a file otherwise is. */
static void test_verified_meanwhile(void **state)
{
	const struct cache_verify_calls verify_calls = {damage, verifying, verified};
	const struct peer admin = {.uid = geteuid(), .pid = 1, .admin = true};
	int fd = text_file(500, 2);
	struct err err = ERR_INIT;
	struct cache_verify *v;
	char command[160];

	for (int taken = 1; taken >= 0; taken--) {
		push_base();
		push_leave(stage_file("a.xyz", fd));
		turn_until(!pushes_open(h.service->pushes));
		assert_int_equal(pending_files(), 1);
		damages = overs = 0;
		atomic_store(&held, false);
		atomic_store(&hold, true);
		assert_int_equal(cache_verify(h.service->maintenance, &admin, &verify_calls, NULL, &v, &err), 0);
		turn_until(atomic_load(&held));
		if (taken) {
			stage_file("a.xyz", fd);
			assert_int_equal(got.known, PUSH_ADOPTED);
			commit();
		} else {
			snprintf(command, sizeof command, "rm %s/datasets/1/push-*.run", h.folder);
			assert_int_equal(system(command), 0);
		}
		atomic_store(&hold, false);
		turn_until(overs);
		assert_int_equal(damages, !taken);
		close_service();
		repeat_remove(h.folder);
		assert_int_equal(mkdir(h.folder, 0700), 0);
		open_service(UINT64_C(32) << 20, 2);
	}
	close(fd);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(test_abandoned_beside, setup, teardown),
		cmocka_unit_test_setup_teardown(test_half_a_manifest, setup, teardown),
		cmocka_unit_test_setup_teardown(test_verified_meanwhile, setup, teardown),
		cmocka_unit_test_setup_teardown(test_row, setup, teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
