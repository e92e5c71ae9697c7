/*
 * Merging and prune, through the room of jobs: what can be read stays what it was, what nobody needs goes from the disk,
 * whoever reads meanwhile reads on, and what a crash leaves is swept away.
 */
#include "gate.h"
#include "dataset_priv.h"

#include "clock.h"
#include "job_priv.h"

/* ---- looking at the folder ---- */

static struct dataset *named(const char *name)
{
	return dataset_find(h.service->datasets, name, &me);
}

static struct dataset_info dataset_of(const char *name)
{
	struct dataset_info info;

	dataset_info(named(name), &info);
	return info;
}

static int folder_of(const char *name)
{
	char path[128];
	int fd;

	snprintf(path, sizeof path, "%s/datasets/%llu", h.folder, (unsigned long long)dataset_of(name).id);
	fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	assert_true(fd >= 0);
	return fd;
}

/* Files whose names begin so; *ret_bytes: of them. */
static unsigned files_of(const char *name, const char *prefix, uint64_t *ret_bytes)
{
	int fd = folder_of(name);
	DIR *dir = fdopendir(fd);
	struct dirent *e;
	struct stat st;
	unsigned n = 0;

	*ret_bytes = 0;
	while ((e = readdir(dir))) {
		if (*e->d_name == '.' || strncmp(e->d_name, prefix, strlen(prefix)))
			continue;
		assert_int_equal(fstatat(fd, e->d_name, &st, 0), 0);
		*ret_bytes += (uint64_t)st.st_size;
		n++;
	}
	closedir(dir);
	return n;
}

/* One that was given up begins again after a second. */
static bool merge_awaited(void)
{
	for (const struct dataset *d = datasets_first(h.service->datasets); d; d = d->next)
		if (d->merge_due && h.service->datasets->merge_after_ns != UINT64_MAX)
			return true;
	return h.service->datasets->merge;
}

static void idle(void)
{
	turn_until(!service_active(h.service) && !merge_awaited());
	turn(0); /* what may begin now */
	turn_until(!service_active(h.service) && !merge_awaited());
}

/* One manifest and its segments, nothing else. */
static void folder_is_tidy(const char *name)
{
	struct dataset_info info = dataset_of(name);
	uint64_t bytes, ignored;

	assert_int_equal(files_of(name, "manifest-", &ignored), 1);
	assert_int_equal(files_of(name, "", &bytes), 1 + info.segments);
	assert_int_equal(bytes - ignored, info.bytes);
}

/* ---- meshes ---- */

struct mesh {
	char digest[DIGEST_HEX_SIZE], vertex_digest[DIGEST_HEX_SIZE];
	uint64_t points;
};

static struct job *mesh_job(const char *name, uint64_t generation)
{
	struct job_params p = {.dataset = named(name), .view = VIEW, .generation = generation, .fresh = true, .peer = me};
	int before = accepts;

	job_submit(h.service->jobs, &p, accepted, NULL);
	turn_until(accepts > before);
	return accepted_job;
}

static struct mesh mesh_of(const char *name, uint64_t generation)
{
	struct job *job = mesh_job(name, generation);
	struct mesh m = {0};

	if (!job)
		fail_msg("%s", accepted_err.message);
	turn_until_final(job);
	if (info_of(job).state != JOB_done)
		fail_msg("generation %llu: %s", (unsigned long long)generation, job->err.message);
	snprintf(m.digest, sizeof m.digest, "%s", info_of(job).report->digest);
	snprintf(m.vertex_digest, sizeof m.vertex_digest, "%s", info_of(job).report->vertex_digest);
	m.points = info_of(job).report->points;
	return m;
}

static void same_mesh(const char *name, uint64_t generation, const struct mesh *want)
{
	struct mesh m = mesh_of(name, generation);

	assert_string_equal(m.digest, want->digest);
	assert_string_equal(m.vertex_digest, want->vertex_digest);
	assert_int_equal(m.points, want->points);
}

/* ---- requests ---- */

static struct pruned pruned_got;

static void pruned(void *token, const struct err *why, const struct pruned *p)
{
	answer(why);
	if (p)
		pruned_got = *p;
}

static void reverted(void *token, const struct err *why, const struct reverted *r)
{
	answer(why);
}

static void prune(const char *name, uint64_t keep, uint64_t older)
{
	memset(&pruned_got, 0, sizeof pruned_got);
	ask(dataset_prune(named(name), keep, older, &me, pruned, NULL));
}

static void revert(const char *name, uint64_t generation)
{
	ask(dataset_revert(named(name), generation, &me, reverted, NULL));
	assert_int_equal(got.why.code, 0);
}

/* ---- merging ---- */

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
	/* Amortised: what was written for merges, in points, is few times what was pushed. */
	assert_true(h.service->core->tally.merged_bytes < 40 * dataset_of("many").bytes);
	assert_int_equal(ledger_held(h.ledger, LEDGER_STAGE), 0);
}

/* Larger ones, so that a merge takes a while; pushes go on meanwhile, and win. */
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

/* A damaged segment is left alone, and named; nothing is lost by it. */
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

/* As if a merge had been cut short: a start sweeps what it made, and only where the catalogue says so. */
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

/* All that there may be, in bytes; 0: as much as there is. */
static void quota(uint64_t bytes)
{
	struct space_limit disk = {bytes ? SPACE_BYTES : SPACE_UNLIMITED, bytes};

	space_set_limits(h.service->core->space, disk, (struct space_limit){SPACE_UNLIMITED, 0});
}

/* A merge for which there is no room is tried again later, and later each time, up to a minute; not before, and when there is
 * room it is made, and the next one that fails starts anew. */
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
			assert_true(ds->merge_wait == wanted[i]);
			assert_true(ds->merge_after_ns >= before + (uint64_t)(wanted[i] * 1e9));
			assert_true(ds->merge_after_ns <= clock_mono_ns() + (uint64_t)(wanted[i] * 1e9));
			/* As if the clock stood still. */
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
		assert_true(ds->merge_wait == 0);
		assert_true(dataset_of("full").segments < 5);
		folder_is_tidy("full");
		same_mesh("full", dataset_of("full").generation, &was);
	}
}

/* After a restart what is due is merged without a push. */
static void due_at_start(void **state)
{
	h.service->datasets->merge_after_ns = UINT64_MAX; /* none */
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

/* Stopped in the middle: nothing stays, and nothing is lost. */
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
	/* Whatever came of it. */
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

/* As long as there is anything of a merge, the catalogue says where to look for it. */
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
		/* A task of it ends while the loop stands still. */
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

/* ---- prune ---- */

static void prune_all(void **state)
{
	struct mesh was, third;
	uint64_t before;

	dataset_release(push("old", 30000, 1)); /* 1 */
	dataset_release(push("old", 30000, 2)); /* 2 */
	dataset_release(push("old", 20000, 3)); /* 3 */
	third = mesh_of("old", 3);
	revert("old", 2); /* 4: without the second */
	was = mesh_of("old", 4);
	assert_int_equal(was.points, 50000);
	idle();
	before = dataset_of("old").bytes;

	/* Nothing is dead before 3, but what can be read changes. */
	prune("old", 0, 3);
	assert_int_equal(got.why.code, 0);
	assert_int_equal(pruned_got.generations, 2);
	assert_int_equal(pruned_got.points, 0);
	assert_int_equal(dataset_of("old").oldest, 3);
	assert_int_equal(dataset_of("old").bytes, before);
	same_mesh("old", 3, &third);
	assert_null(mesh_job("old", 2));
	assert_int_equal(accepted_err.code, ERR_NOTFOUND);

	prune("old", 1, 0);
	assert_int_equal(got.why.code, 0);
	assert_int_equal(pruned_got.generations, 1);
	assert_int_equal(pruned_got.points, 30000);
	assert_int_equal(pruned_got.files, 1);
	assert_int_equal(pruned_got.oldest, 4);
	assert_true(pruned_got.bytes > 30000 * 16 && pruned_got.bytes == before - dataset_of("old").bytes);
	idle();
	folder_is_tidy("old");
	assert_int_equal(dataset_of("old").segments, 2);
	same_mesh("old", 4, &was);

	/* Again: there is nothing. And it lasts. */
	prune("old", 1, 0);
	assert_int_equal(got.why.code, 0);
	assert_int_equal(pruned_got.generations + pruned_got.points + pruned_got.bytes, 0);
	close_service();
	open_service(UINT64_C(24) << 20, 1);
	assert_int_equal(dataset_of("old").oldest, 4);
	assert_null(mesh_job("old", 3));
	same_mesh("old", 4, &was);
	/* Numbers of sources go on. */
	dataset_release(push("old", 100, 9));
	assert_int_equal(mesh_of("old", 5).points, 50100);
}

/* Out of a segment with points of several pushes. */
static void prune_of_merged(void **state)
{
	struct mesh was;

	for (unsigned i = 1; i <= 4; i++)
		dataset_release(push("mixed", 2000, i));
	idle();
	assert_int_equal(dataset_of("mixed").segments, 1);
	revert("mixed", 2);
	was = mesh_of("mixed", 5);
	assert_int_equal(was.points, 6000);
	prune("mixed", 1, 0);
	assert_int_equal(got.why.code, 0);
	assert_int_equal(pruned_got.points, 2000);
	assert_int_equal(pruned_got.segments, 1);
	idle();
	folder_is_tidy("mixed");
	same_mesh("mixed", 5, &was);
	close_service();
	open_service(UINT64_C(24) << 20, 1);
	same_mesh("mixed", 5, &was);
}

/* The last file is the one that goes: its number is not given again. */
static void prune_last(void **state)
{
	struct mesh was;

	dataset_release(push("last", 3000, 1));
	dataset_release(push("last", 3000, 2));
	revert("last", 2);
	was = mesh_of("last", 3);
	prune("last", 1, 0);
	assert_int_equal(got.why.code, 0);
	idle();
	assert_int_equal(dataset_of("last").segments, 1);
	folder_is_tidy("last");
	close_service();
	open_service(UINT64_C(24) << 20, 1);
	same_mesh("last", 3, &was);
	dataset_release(push("last", 50, 5));
	assert_int_equal(mesh_of("last", 4).points, 3050);
	assert_int_equal(named("last")->next_source, 4);
}

static void prune_refused(void **state)
{
	static struct reader r; /* outlives a failed test */
	struct job *job;
	struct mesh was;
	char number[32];

	r = (struct reader){.output.calls = &reader_calls, .slow = true};
	dataset_release(push("used", 30000, 1));
	dataset_release(push("used", 3000, 2));
	was = mesh_of("used", 1);
	prune("used", 1, 1);
	assert_int_equal(got.why.code, ERR_USAGE);
	prune("used", 0, 0);
	assert_int_equal(got.why.code, ERR_USAGE);
	prune("used", 0, 3);
	assert_int_equal(got.why.code, ERR_NOTFOUND);

	struct job_params p = {.dataset = named("used"), .view = VIEW, .generation = 1, .bound = true, .peer = me};
	int before = accepts;

	job_submit(h.service->jobs, &p, accepted, NULL);
	turn_until(accepts > before);
	job = accepted_job;
	job_fetch(job, &r.output);
	turn_until(r.sending);
	prune("used", 1, 0);
	assert_int_equal(got.why.code, ERR_BUSY);
	snprintf(number, sizeof number, "%llu", (unsigned long long)info_of(job).id);
	assert_non_null(strstr(got.why.message, number));
	assert_int_equal(dataset_of("used").oldest, 1);
	read_on(&r);
	turn_until(r.ends);
	job_leave(job);
	same_mesh("used", 1, &was);
}

/* Whoever reads an old generation when it goes reads on. */
static void prune_under_a_reader(void **state)
{
	static struct reader r; /* outlives a failed test */
	struct job *job;

	dataset_release(push("read", 60000, 1));
	dataset_release(push("read", 60000, 2));
	revert("read", 1);
	job = mesh_job("read", 2);
	turn_until_final(job);
	r = (struct reader){.output.calls = &reader_calls, .slow = true};
	job_fetch(job, &r.output);
	turn_until(r.sending);
	prune("read", 1, 0);
	assert_int_equal(got.why.code, 0);
	assert_int_equal(pruned_got.points, 60000);
	read_on(&r);
	turn_until(r.ends);
	assert_false(r.failed);
	assert_int_equal(r.triangles, r.totals.triangles);
	idle();
	folder_is_tidy("read");
}

/* Between a name that was taken and the opening nothing goes. */
static void old_files_stay_while_named(void **state)
{
	struct dataset *d;
	uint64_t bytes;

	dataset_release(push("name", 3000, 1));
	dataset_release(push("name", 3000, 2));
	revert("name", 1);
	idle();
	d = named("name");
	dataset_read_begin(d);
	prune("name", 1, 0);
	assert_int_equal(got.why.code, 0);
	for (int i = 0; i < 20; i++)
		turn(5);
	assert_int_equal(dataset_of("name").segments, 1);
	assert_int_equal(files_of("name", "push-", &bytes), 2);
	assert_int_equal(files_of("name", "manifest-", &bytes), 2);
	dataset_read_end(d);
	turn(0);
	idle();
	folder_is_tidy("name");
}

static void prune_cancelled(void **state)
{
	struct prune *p;
	uint64_t bytes;
	int before;

	h.service->datasets->merge_after_ns = UINT64_MAX;
	dataset_release(push("give", 150000, 1));
	dataset_release(push("give", 150000, 2));
	revert("give", 1);
	h.service->datasets->merge_after_ns = 0;
	bytes = dataset_of("give").bytes;
	gate_close();
	before = got.answers;
	p = dataset_prune(named("give"), 1, 0, &me, pruned, NULL);
	assert_non_null(p);
	step();
	assert_int_equal(got.answers, before);
	dataset_prune_cancel(p);
	gate_open();
	turn_until(got.answers > before);
	assert_int_equal(got.why.code, ERR_CANCELLED);
	assert_int_equal(dataset_of("give").oldest, 1);
	assert_int_equal(dataset_of("give").bytes, bytes);
	idle();
	folder_is_tidy("give");
}

int main(void)
{
#define TEST(f) cmocka_unit_test_setup_teardown(f, setup, gate_teardown)
	const struct CMUnitTest tests[] = {
		TEST(many_pushes),
		TEST(pushes_meanwhile),
		TEST(damaged),
		TEST(cut_short),
		TEST(no_space),
		TEST(due_at_start),
		TEST(stopped),
		TEST(prune_all),
		TEST(prune_last),
		TEST(prune_refused),
		TEST(prune_under_a_reader),
		TEST(prune_cancelled),
		TEST(prune_of_merged),
		TEST(row_first),
		TEST(old_files_stay_while_named),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
