/*
 * The texts of views share one limit. A user with many of them, in finished or unfinished jobs, keeps nobody from submitting, and
 * what one user may have in unfinished jobs is limited. The loop turns only where a test says so; jobs make no progress
 * otherwise.
 */
#include "fixture.h"

#include "area_code.h"
#include "job_priv.h"
#include "history.h"
#include "job_sql.h"

enum { LARGE = 40000, MANY = 104, STEP = 99000, TEETH = 4500 };
static const struct peer hog = {.uid = 7, .pid = 7}, root = {.uid = 0, .pid = 8, .admin = true};

/* Finished jobs of a deleted dataset, numbered from `from` on. */
static void jobs_over(unsigned from, unsigned n, uint32_t uid, unsigned bytes)
{
	char text[1024];

	snprintf(
		text, sizeof text,
		"WITH RECURSIVE n(i) AS (SELECT %u UNION ALL SELECT i + 1 FROM n WHERE i < %u)"
		" INSERT INTO job (id, dataset, generation, view, state, uid, pid, submitted_us, finished_us, report,"
		" error_code, error_message, error_file, error_field, error_hint, error_offset)"
		" SELECT i, 0, 1, printf('%%*s', %u, 'v'), 'failed', %u, 1, 1, strftime('%%s') * 1000000, '', 'bad-input', '', '',"
		" '', '', -1 FROM n",
		from, from + n - 1, bytes, uid);
	sql(text);
}

static unsigned count(const struct peer *peer)
{
	struct job *job;
	unsigned n = 0;

	for (uint64_t id = 0; (job = job_after(h.service->jobs, id, peer)); id = info_of(job).id)
		n += info_of(job).peer.uid == peer->uid;
	return n;
}

/* A comb of `teeth`, whose base lies `down` below: 9 characters a tooth. */
static char *comb(unsigned teeth, unsigned down)
{
	char *text = malloc(32 + 4 * AREA_CODE_SIZE + (size_t)teeth * 2 * AREA_CODE_SIZE), *at = text;

	at += sprintf(at, "ask 1 crop=area@0:+");
	at += area_code_put(0, at);
	at += area_code_put(0, at);
	for (unsigned i = 0; i < teeth; i++) {
		at += area_code_put(STEP, at);
		at += area_code_put(i % 2 ? -STEP : STEP, at);
	}
	at += area_code_put(0, at);
	at += area_code_put(-2 * STEP - (int)down, at);
	at += area_code_put(-STEP * (int)teeth, at);
	at += area_code_put(0, at);
	*at = 0;
	return text;
}

static struct job *want(struct dataset *d, const struct peer *peer, const char *view)
{
	struct job_params p = {.dataset = d, .view = view, .peer = *peer};
	int before = accepts;

	job_submit(h.service->jobs, &p, accepted, NULL);
	/* The submission is refused at once. */
	return accepts > before && accepted_err.code ? NULL : h.service->jobs->jobs;
}

/* Finished jobs of one user take all of the limit; those of others stay. */
static void over(void **state)
{
	struct history_views v;
	struct dataset *d;
	unsigned mine;

	close_service();
	jobs_over(1, 5, me.uid, 300);
	jobs_over(10, MANY, hog.uid, LARGE);
	jobs_over(200, 1, hog.uid, JOBS_VIEWS_MAX - MANY * LARGE - 5 * 300);
	open_service(UINT64_C(64) << 20, 1);
	history_views(h.service->jobs, me.uid, &v);
	assert_int_equal(v.all, JOBS_VIEWS_MAX);
	assert_int_equal(v.own, 5 * 300);
	d = push("d", 100, 1);
	assert_int_equal(count(&me), 5);
	assert_int_equal(count(&hog), MANY + 1);
	assert_non_null(submit(d, false, VIEW));
	assert_int_equal(accepted_err.code, 0);
	/* His oldest jobs are dropped and no others, as many as one large view of hers needs. */
	assert_int_equal(count(&me), 6);
	assert_int_equal(count(&hog), MANY);
	assert_null(job_find(h.service->jobs, 10, &hog));
	history_views(h.service->jobs, me.uid, &v);
	assert_true(v.all <= JOBS_VIEWS_MAX);
	for (unsigned i = 0; i < 3; i++) {
		char *view = comb(TEETH, i);

		mine = count(&me);
		submit(d, false, view);
		if (accepted_err.code)
			fail_msg("%s", accepted_err.message);
		assert_int_equal(count(&me), mine + 1);
		free(view);
	}
	assert_true(count(&hog) < MANY && count(&hog) > MANY - 4);
	history_views(h.service->jobs, me.uid, &v);
	assert_true(v.all <= JOBS_VIEWS_MAX);
	turn_until(!service_active(h.service));
}

/* A submission by the user who has most drops his own oldest job. */
static void own(void **state)
{
	struct dataset *d;
	char *view = comb(TEETH, 0);

	close_service();
	jobs_over(1, MANY, me.uid, LARGE);
	jobs_over(200, 1, hog.uid, 30000);
	open_service(UINT64_C(64) << 20, 1);
	d = push("d", 100, 1);
	submit(d, false, view);
	assert_int_equal(accepted_err.code, 0);
	assert_non_null(job_find(h.service->jobs, 200, &hog));
	assert_null(job_find(h.service->jobs, 1, &me));
	turn_until(!service_active(h.service));
	free(view);
}

/* The new view counts as his, and with it he has most. */
static void wanted(void **state)
{
	char *view = comb(TEETH, 0);
	struct dataset *d;

	close_service();
	jobs_over(1, MANY / 2, me.uid, LARGE);
	jobs_over(200, MANY / 2, hog.uid, LARGE);
	jobs_over(300, 1, hog.uid, LARGE / 2);
	open_service(UINT64_C(64) << 20, 1);
	d = push("d", 100, 1);
	submit(d, false, view);
	assert_int_equal(accepted_err.code, 0);
	assert_null(job_find(h.service->jobs, 1, &me));
	assert_non_null(job_find(h.service->jobs, 200, &hog));
	turn_until(!service_active(h.service));
	free(view);
}

/* Unfinished jobs cannot be dropped: a user may have half of what those of others leave. */
static void unfinished(void **state)
{
	struct dataset *d = push("d", 100, 1);
	struct history_views v;
	unsigned n = 0, m = 0;
	char *view;

	/* Administrators are not limited. */
	d->mode = 0644;
	for (;; n++) {
		view = comb(TEETH, n);
		if (!want(d, &hog, view))
			break;
		free(view);
		assert_true(n < 1000);
	}
	free(view);
	assert_int_equal(accepted_err.code, ERR_BUSY);
	assert_non_null(strstr(accepted_err.message, "2048 KiB"));
	history_views(h.service->jobs, hog.uid, &v);
	print_message("%u of one user: %llu KiB\n", n, (unsigned long long)v.own >> 10);
	assert_true(v.own == v.own_busy && v.own <= JOBS_VIEWS_MAX / 2 && v.own > JOBS_VIEWS_MAX / 2 - VIEW_TEXT_MAX);
	for (;; m++) {
		view = comb(TEETH, m);
		if (!want(d, &me, view))
			break;
		free(view);
		assert_true(m < 1000);
	}
	free(view);
	assert_true(m >= n / 2 - 1 && m <= n / 2 + 1);
	/* A third user, and an administrator, who may have all that is left. */
	view = comb(TEETH, 5000);
	assert_non_null(want(d, &(struct peer){.uid = 9}, view));
	for (m = 0; want(d, &root, view); m++) {
		free(view);
		view = comb(TEETH, 6000 + m);
		assert_true(m < 1000);
	}
	free(view);
	history_views(h.service->jobs, 0, &v);
	assert_true(v.all <= JOBS_VIEWS_MAX && v.all > JOBS_VIEWS_MAX - VIEW_TEXT_MAX);
	/* When his jobs are finished he may submit again, and all of them finish. */
	turn_until(!service_active(h.service));
	view = comb(TEETH, 7000);
	assert_non_null(want(d, &hog, view));
	turn_until(!service_active(h.service));
	free(view);
}

/* Finished jobs count even before they are packed. */
static void warm(void **state)
{
	struct dataset *d;
	char view[32];

	close_service();
	jobs_over(1, 5, me.uid, 10);
	open_service(UINT64_C(64) << 20, 1);
	d = push("d", 100, 1);
	for (unsigned i = 0; i < 8; i++) {
		snprintf(view, sizeof view, "ask 1 every=%u", i + 2);
		assert_non_null(want(d, &hog, view));
	}
	turn_until(!service_active(h.service));
	assert_int_equal(count(&hog), 8);
	assert_true(jobs_forget_one(h.service->jobs, HISTORY_JOBS, 0, 0));
	assert_int_equal(count(&hog), 7);
	assert_int_equal(count(&me), 5);
}

/* The same where memory for jobs, or their number, is the limit. */
static void memory(void **state)
{
	struct job *job;
	unsigned n = 0;

	close_service();
	jobs_over(1, 20, me.uid, 100);
	jobs_over(100, 3000, hog.uid, 60);
	jobs_over(20000, 20, me.uid, 100);
	open_service(UINT64_C(24) << 20, 1);
	n = count(&hog);
	print_message("%u of 3000 jobs are kept\n", n);
	while ((job = history_oldest_of_largest(h.service->jobs, HISTORY_BYTES, me.uid, 0)) && n-- > 100)
		assert_int_equal(info_of(job).peer.uid, hog.uid),
			assert_true(jobs_forget_one(h.service->jobs, HISTORY_BYTES, me.uid, 0));
	assert_int_equal(count(&me), 40);
	/* Equal numbers: those of the submitting user are dropped. */
	while (count(&hog) > 40)
		assert_true(jobs_forget_one(h.service->jobs, HISTORY_JOBS, 0, 0));
	assert_int_equal(count(&hog), 40);
	assert_true(jobs_forget_one(h.service->jobs, HISTORY_JOBS, me.uid, 0));
	assert_int_equal(count(&me), 39);
	assert_null(job_find(h.service->jobs, 1, &me));
	turn_until(!catalogue_busy(h.catalogue));
}

/* Finished jobs are dropped, too, for the memory that a large area needs while it is parsed. */
static void memory_of_a_run(void **state)
{
	struct dataset *d;
	struct job *job;
	unsigned before;
	char *view;

	close_service();
	jobs_over(1, 9000, hog.uid, 60);
	service_most = UINT64_C(2) << 20;
	open_service(UINT64_C(64) << 20, 1);
	service_most = 0;
	before = count(&hog);
	assert_true(before < 9000);
	d = push("valley", 300, 5);
	view = comb(4000, 1);
	job = want(d, &me, view);
	assert_non_null(job);
	turn_until_final(job);
	assert_int_equal(info_of(job).state, JOB_done);
	assert_true(count(&hog) > 0 && count(&hog) < before / 2 + before / 4);
	free(view);
	dataset_release(d);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(over, setup, teardown),
		cmocka_unit_test_setup_teardown(own, setup, teardown),
		cmocka_unit_test_setup_teardown(wanted, setup, teardown),
		cmocka_unit_test_setup_teardown(unfinished, setup, teardown),
		cmocka_unit_test_setup_teardown(warm, setup, teardown),
		cmocka_unit_test_setup_teardown(memory_of_a_run, setup, teardown),
		cmocka_unit_test_setup_teardown(memory, setup, teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
