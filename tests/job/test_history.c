/*
 * Finished jobs: ten thousand are listed unchanged in a memory of 64 MiB; those older than 30 days are removed with their plans;
 * a job that was searched for can be removed. Reports are kept to the last digit.
 */
#include "gate.h"
#include "core_priv.h"
#include "dataset_priv.h"

#include "job_priv.h"
#include "log.h"
#include "history.h"
#include "job_sql.h"

enum { JOBS = 10000, OLD = 1000, AT_ONCE = 64 };
#define SMALL (UINT64_C(4) << 20)

static void make_jobs(void)
{
	const struct job_report r = {.points = 123456789,
				     .used = 123456,
				     .vertices = 99,
				     .triangles = 190,
				     .hull = 7,
				     .domains = 3,
				     .digest = "0123456789abcdef0123456789abcdef",
				     .vertex_digest = "fedcba9876543210fedcba9876543210",
				     .seconds = 1.25,
				     .worked_seconds = 0.75};
	int64_t now = clock_real_us(), old = now - INT64_C(31) * 86400000000;
	char report[2048], text[4096];

	report_text(&r, report, sizeof report);
	snprintf(text, sizeof text,
		 "BEGIN;"
		 "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < %d)"
		 " INSERT INTO job (id, dataset, generation, view, state, uid, pid, submitted_us, finished_us, report,"
		 " error_code, error_message, error_file, error_field, error_hint, error_offset)"
		 " SELECT i, 0, 1, 'view 1', CASE WHEN i %% 10 THEN 'done' ELSE 'failed' END, 1000, 1, %lld,"
		 " CASE WHEN i <= %d THEN %lld ELSE %lld END, CASE WHEN i %% 10 THEN '%s' ELSE '' END,"
		 " CASE WHEN i %% 10 THEN '' ELSE 'bad-input' END, CASE WHEN i %% 10 THEN '' ELSE 'broken' END,"
		 " '', '', '', -1 FROM n;"
		 "COMMIT;",
		 JOBS, (long long)old, OLD, (long long)old, (long long)now, report);
	sql(text);
}

static unsigned listed(void)
{
	unsigned n = 0;
	uint64_t id = 0;
	struct job *job;

	while ((job = job_after(h.service->jobs, id, &me))) {
		struct job_info info;

		job_info(job, &info);
		assert_true(info.id > id);
		id = info.id;
		n++;
		if (id % 10) {
			assert_int_equal(info.state, JOB_done);
			assert_int_equal(info.report->points, 123456789);
			assert_string_equal(info.report->vertex_digest, "fedcba9876543210fedcba9876543210");
			assert_true(info.report->seconds == 1.25 && info.report->worked_seconds == 0.75);
			assert_null(info.err);
		} else {
			assert_int_equal(info.state, JOB_failed);
			assert_string_equal(info.err->message, "broken");
			assert_int_equal(info.err->offset, ERR_NO_OFFSET);
		}
		assert_string_equal(info.view, "view 1");
	}
	return n;
}

static void many(void **state)
{
	struct err err = ERR_INIT;
	struct job *job;
	char plan[96];

	snprintf(plan, sizeof plan, "%s/plans/plan-5", h.folder);
	close_service();
	make_jobs();
	close(open(plan, O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
	open_service(UINT64_C(64) << 20, 1);
	assert_int_equal(listed(), JOBS);
	print_message("%llu KiB for %u jobs\n", (unsigned long long)ledger_held(h.ledger, LEDGER_JOBS) >> 10, JOBS);
	assert_true(ledger_held(h.ledger, LEDGER_JOBS) < UINT64_C(8) << 20);
	/* No job is active, so no loop visits them. */
	assert_null(h.service->jobs->jobs);
	/* Jobs that are too old are removed a few at a time, also from the disk, so that others do not wait long for it. */
	while (history_count(h.service->jobs) > JOBS - OLD) {
		turn(10);
		assert_true(catalogue_busy(h.catalogue) <= AT_ONCE);
	}
	assert_int_equal(history_count(h.service->jobs), JOBS - OLD);
	assert_null(job_find(h.service->jobs, 5, &me));
	turn_until(access(plan, F_OK) != 0);
	turn_until(!service_active(h.service));
	assert_int_equal(listed(), JOBS - OLD);
	/* Another user sees none of them. One is removed; one is activated and packed again. */
	assert_null(job_find(h.service->jobs, 7777, &(struct peer){.uid = 2000}));
	job = job_find(h.service->jobs, 7777, &me);
	assert_non_null(job);
	assert_int_equal(job_remove(job, &err), 0);
	assert_null(job_find(h.service->jobs, 7777, &me));
	job = job_find(h.service->jobs, 7778, &me);
	assert_int_equal(history_activate(job, &job, &err), 0);
	assert_ptr_equal(job_find(h.service->jobs, 7778, &me), job);
	assert_true(history_pack(job));
	assert_int_equal(listed(), JOBS - OLD - 1);
	turn_until(!catalogue_busy(h.catalogue));
	close_service();
	open_service(UINT64_C(64) << 20, 1);
	assert_int_equal(listed(), JOBS - OLD - 1);
}

/* Without memory the oldest jobs are dropped. */
static void little_memory(void **state)
{
	close_service();
	make_jobs();
	open_service(UINT64_C(24) << 20, 1);
	assert_non_null(job_find(h.service->jobs, JOBS, &me));
	assert_true(history_count(h.service->jobs) > 0);
}

/* A pending push is taken up however many finished jobs there are: they fill the memory and are dropped, with rows and plans, a
 * few at a time. */
static void little_memory_push(void **state)
{
	enum { PUSHES = 100, TAKEN_UP = 20000 };
	static struct pending *taken[TAKEN_UP];
	struct err err = ERR_INIT;
	char plan[96];
	size_t left;

	snprintf(plan, sizeof plan, "%s/plans/plan-5", h.folder);
	close_service();
	make_jobs();
	close(open(plan, O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
	sql("INSERT INTO dataset (id, name, uid, created_us, pushed_us, manifest, generation, points, bytes, files, lattice, crs, unit_xy,"
	    " unit_z, box_min, box_max, gid, mode) VALUES (1, 'valley', 1000, 1, 1, '', 1, 0, 0, 0, '', '', '', '', 0, 0, 1000, 416)");
	sql("WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 100)"
	    " INSERT INTO push (id, dataset, uid, files, begun_us) SELECT i, 1, 1000, 1, 1 FROM n");
	log_init("test-past", LOG_LEVEL_WARNING);
	open_service(SMALL, 1);
	assert_int_equal(h.service->core->last_push, PUSHES);
	assert_non_null(job_find(h.service->jobs, JOBS, &me));
	assert_null(job_find(h.service->jobs, 5, &me));
	assert_true(h.service->jobs->ndeletions > 0);
	while (h.service->jobs->ndeletions) {
		left = h.service->jobs->ndeletions;
		turn(10);
		assert_true(left - h.service->jobs->ndeletions <= AT_ONCE);
		assert_true(catalogue_busy(h.catalogue) <= 2 * AT_ONCE);
	}
	turn_until(access(plan, F_OK) != 0);
	turn_until(!service_active(h.service));
	/* As many pushes as need more memory than the jobs leave. */
	left = history_count(h.service->jobs);
	h.service->core->loading = true;
	for (unsigned i = 0; i < TAKEN_UP; i++)
		assert_non_null(taken[i] = pending_new(h.service->datasets, 0, &err));
	h.service->core->loading = false;
	assert_true(history_count(h.service->jobs) < left);
	for (unsigned i = 0; i < TAKEN_UP; i++)
		pending_free(h.service->datasets, taken[i]);
	while (h.service->jobs->ndeletions)
		turn(10);
	turn_until(!service_active(h.service));
	left = history_count(h.service->jobs);
	close_service();
	open_service(UINT64_C(64) << 20, 1);
	assert_int_equal(history_count(h.service->jobs), left);
}

/* However many jobs are finished or queued, there is memory for one to run: no job holds what another needs. */
static void all_get_done(void **state)
{
	enum { ASKED = 1200 };
	struct job_params p = {.view = VIEW, .fresh = true, .peer = me};
	unsigned refused = 0;

	close_service();
	make_jobs();
	service_most = UINT64_C(2) << 20;
	open_service(UINT64_C(64) << 20, 2);
	service_most = 0;
	assert_non_null(job_find(h.service->jobs, JOBS, &me));
	p.dataset = push("valley", 300, 5);
	accepts = 0;
	for (unsigned i = 0; i < ASKED; i++) {
		job_submit(h.service->jobs, &p, accepted, NULL);
		refused += accepted_err.code == ERR_BUSY;
	}
	turn_until(accepts == ASKED);
	assert_true(refused > 0 && refused < ASKED);
	/* The patience is of each job: a slow disk writes for all of them for a long time. */
	while (service_active(h.service)) {
		uint64_t done = log_event_count(LOG_EVENT_JOB_DONE);

		turn_until(log_event_count(LOG_EVENT_JOB_DONE) > done || !service_active(h.service));
	}
	for (struct job *job = job_after(h.service->jobs, JOBS, &me); job; job = job_after(h.service->jobs, info_of(job).id, &me))
		assert_int_equal(info_of(job).state, JOB_done);
	dataset_release(p.dataset);
}

/* Views of all lengths and extreme numbers: an image has room for any job (a sanitizer would see it). */
static void lengths(void **state)
{
	enum { LENGTHS = 600 };
	struct job *job;
	unsigned n = 0;

	close_service();
	sql("WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 600)"
	    " INSERT INTO job (id, dataset, generation, view, state, uid, pid, submitted_us, finished_us, report,"
	    " error_code, error_message, error_file, error_field, error_hint, error_offset)"
	    " SELECT i, 0, 1, printf('%*s', i, 'v'), 'failed', 1000, 1, 1, strftime('%s') * 1000000, '', 'bad-input', '', '',"
	    " '', '', -1 FROM n");
	open_service(UINT64_C(64) << 20, 1);
	for (uint64_t id = 0; (job = job_after(h.service->jobs, id, &me)); n++) {
		id = info_of(job).id;
		assert_int_equal(strlen(info_of(job).view), id);
	}
	assert_int_equal(n, LENGTHS);
	assert_null(h.service->jobs->jobs);
}

/* A parsed report is what was written, as strtod reads it. */
static void reports(void **state)
{
	static const double seconds[] = {0,     0.000001, 0.025279, 0.999999, 1.25, 86400.000001, 123456789.123456, 12345678901.5,
					 1e300, 0.1};
	char text[4096];

	for (size_t i = 0; i < sizeof seconds / sizeof *seconds; i++) {
		struct job_report r = {.points = UINT64_MAX - i,
				       .used = UINT64_C(999999999999999999) + i,
				       .vertices = 10 * i,
				       .digest = "0123456789abcdef0123456789abcdef",
				       .seconds = seconds[i],
				       .peak_rss = i,
				       .note = "with blanks, and a full stop.",
				       .worked_seconds = 1 / (1.0 + (double)i),
				       .window = i % 2};
		struct job_report back;

		for (int k = 0; k < VIEW_RULES; k++)
			r.removed[k] = i * 1000 + (uint64_t)k;
		report_text(&r, text, sizeof text);
		/* What is zero or empty takes no room. */
		assert_null(strstr(text, " 0\n"));
		assert_null(strstr(text, " 0.000000\n"));
		assert_null(strstr(text, " \n"));
		snprintf(text + strlen(text), 99, "no-such 5\nremoved-never 6\n\nnothing\n");
		report_parse(text, &back);
		snprintf(text, sizeof text, "%.6f", r.worked_seconds);
		assert_true(back.worked_seconds == strtod(text, NULL));
		back.worked_seconds = r.worked_seconds;
		snprintf(text, sizeof text, "%.6f", r.seconds);
		assert_true(back.seconds == strtod(text, NULL));
		back.seconds = r.seconds;
		assert_memory_equal(&back, &r, sizeof r);
	}
}

/* Reports of older versions or other hands: missing lines, another order, other formats. */
static void old_reports(void **state)
{
	struct job_report r;

	report_parse(
		"points 7\nvertices 5\nseconds 2\nused 0006\nremoved-noise 3\nremoved-kept 9\nstage_seconds 0.5\n"
		"hull \ndomains 4x\nhalo -1\nnote a b\ndigest abc\nseal_seconds 1.234567\nremoved-kept 11\nwindow 1\ntriangles 8",
		&r);
	assert_int_equal(r.points, 7);
	assert_int_equal(r.used, 6);
	assert_int_equal(r.vertices, 5);
	assert_int_equal(r.triangles, 8);
	assert_int_equal(r.hull | r.domains | r.halo, 0);
	assert_true(r.seconds == 2 && r.stage_seconds == 0.5 && r.seal_seconds == 1.234567);
	assert_int_equal(r.removed[VIEW_BY_NOISE], 3);
	assert_int_equal(r.removed[VIEW_KEPT], 11);
	assert_string_equal(r.note, "a b");
	assert_string_equal(r.digest, "abc");
	assert_int_equal(r.window, 1);
}

/* Pages of datasets: sorted by name, each once; private datasets of others and removed ones are absent. */
static void listing(void **state)
{
	enum { ALL = 500 };
	const struct peer he = {.uid = 7};
	struct dataset all[ALL] = {0}, *page[64];
	const struct datasets datasets = {.first = all};
	char after[DATASET_NAME_MAX + 1] = "";
	unsigned n, seen = 0, max = 1;

	for (unsigned i = 0; i < ALL; i++) {
		all[i] = (struct dataset){.next = i + 1 < ALL ? &all[i + 1] : NULL, .uid = 7, .mode = 0600, .generation = 1};
		snprintf(all[i].name, sizeof all[i].name, "set-%03u", i * 307 % ALL);
		all[i].removed_us = i % 10 == 3;
		all[i].uid = i % 10 == 4 ? 8 : 7;
	}
	while ((n = dataset_list(&datasets, after, &he, max, page))) {
		for (unsigned i = 0; i < n; i++) {
			assert_true(strcmp(page[i]->name, i ? page[i - 1]->name : after) > 0);
			assert_true(!page[i]->removed_us && page[i]->uid == 7);
		}
		assert_true(n == max || seen + n == ALL * 8 / 10);
		snprintf(after, sizeof after, "%s", page[n - 1]->name);
		seen += n;
		max = max % 64 + 1;
	}
	assert_int_equal(seen, ALL * 8 / 10);
}

/* Folders that an earlier daemon left in the cache. */
static bool left(const char *name, bool make)
{
	char path[128], file[160];
	struct stat st;

	snprintf(path, sizeof path, "%s/%s", h.folder, name);
	snprintf(file, sizeof file, "%s/x", path);
	if (make)
		close(open(file, O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
	return !stat(path, &st);
}

/* Deferred sweeps wait, and the loop knows it. They begin when the time is over. A stop waits neither for those that are deferred
 * nor for those that wait for a worker, nor for the measuring of the cache: the next start does the same. */
static void rests(void **state)
{
	assert_false(service_is_deferring(h.service));
	assert_true(left("tmp", true));
	close_service();
	service_defer = 1e6;
	assert_true(left("tmp", true));
	open_service(UINT64_C(64) << 20, 1);
	turn_until(!service_active(h.service));
	for (int i = 0; i < 20; i++)
		turn(10);
	assert_true(service_is_deferring(h.service));
	assert_false(service_active(h.service));
	assert_false(h.service->core->priv->disk.measured);
	assert_true(left("gone-0", false));
	close_service();
	assert_true(left("gone-0", false));

	service_defer = 0;
	gate.closed = true;
	open_service(UINT64_C(64) << 20, 1);
	assert_false(service_is_deferring(h.service));
	turn_until(h.service->core->priv->disk.work);
	service_stop(h.service);
	turn_until(!h.service->core->priv->disk.work);
	gate_open();
	close_service();
	assert_true(left("gone-0", false));

	service_defer = 0.05;
	assert_true(left("tmp", true));
	open_service(UINT64_C(64) << 20, 1);
	turn_until(!left("gone-0", false));
	turn_until(h.service->core->priv->disk.measured);
	assert_false(service_is_deferring(h.service));
	close_service();

	service_defer = 1e6;
	assert_true(left("tmp", true));
	open_service(UINT64_C(64) << 20, 1);
	sched_free(h.sched);
	catalogue_free(h.catalogue);
	service_free(h.service);
	ledger_free(h.ledger);
	close(h.statefd);
	close(h.cachefd);
	service_defer = 0;
	open_service(UINT64_C(64) << 20, 1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(many, setup, teardown),
		cmocka_unit_test_setup_teardown(little_memory, setup, teardown),
		cmocka_unit_test_setup_teardown(little_memory_push, setup, teardown),
		cmocka_unit_test_setup_teardown(all_get_done, setup, teardown),
		cmocka_unit_test_setup_teardown(lengths, setup, teardown),
		cmocka_unit_test_setup_teardown(rests, setup, teardown),
		cmocka_unit_test(reports),
		cmocka_unit_test(old_reports),
		cmocka_unit_test(listing),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
