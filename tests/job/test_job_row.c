/*
 * A job whose first row is on its way to the disk: it runs, and nobody sees it. With the row it is accepted, whatever its state;
 * without the row it is refused. The test holds the row.
 */
#include "fixture.h"
#include "job_priv.h"
#include "log.h"
#include "plan_file.h"

static struct {
	bool hold, held;
	int puts;
	char last[32]; /* state of the last row */
	struct catalogue *catalogue;
	struct catalogue_job row;
	catalogue_done_fn done;
	void *ctx;
} put;

int __real_catalogue_put_job(struct catalogue *, const struct catalogue_job *, catalogue_done_fn, void *, struct err *);
int __wrap_catalogue_put_job(struct catalogue *, const struct catalogue_job *, catalogue_done_fn, void *, struct err *);

int __wrap_catalogue_put_job(struct catalogue *c, const struct catalogue_job *row, catalogue_done_fn done, void *ctx,
			     struct err *err)
{
	put.puts++;
	snprintf(put.last, sizeof put.last, "%s", row->state);
	if (!put.hold)
		return __real_catalogue_put_job(c, row, done, ctx, err);
	put.hold = false;
	put.held = true;
	put.catalogue = c;
	put.row = *row; /* its texts are those of the job, or constant */
	put.done = done;
	put.ctx = ctx;
	return 0;
}

static void let_row(void)
{
	struct err err = ERR_INIT;

	assert_true(put.held);
	put.held = false;
	assert_int_equal(__real_catalogue_put_job(put.catalogue, &put.row, put.done, put.ctx, &err), 0);
}

static void refuse_row(void)
{
	struct err full = ERR_INIT;

	put.held = false;
	err_set(&full, ERR_NOSPACE, "the disk is full");
	put.done(put.ctx, -ERR_NOSPACE, &full);
}

/* A job was submitted and its row is held. */
static struct job *begin_job(struct dataset *d)
{
	struct job_params p = {.dataset = d, .view = VIEW, .peer = me};

	put.puts = 0;
	put.hold = true;
	accepts = 0;
	job_submit(h.service->jobs, &p, accepted, NULL);
	assert_true(put.held);
	assert_non_null(h.service->jobs->jobs);
	return h.service->jobs->jobs;
}

static void test_goes_on(void **state)
{
	struct dataset *d = push("a", 5000, 3);
	struct job *job = begin_job(d);
	uint64_t id = info_of(job).id, told = log_event_count(LOG_EVENT_JOB_DONE);

	turn_until_final(job);
	assert_int_equal(info_of(job).state, JOB_done);
	assert_int_equal(accepts, 0);
	assert_int_equal(log_event_count(LOG_EVENT_JOB_DONE), told);
	assert_int_equal(put.puts, 1); /* its final row follows the first one */
	assert_null(job_find(h.service->jobs, id, &me));
	let_row();
	turn_until(accepts);
	assert_int_equal(accepted_err.code, 0);
	assert_ptr_equal(job_find(h.service->jobs, id, &me), accepted_job);
	assert_int_equal(put.puts, 2);
	assert_string_equal(put.last, "done");
	assert_int_equal(log_event_count(LOG_EVENT_JOB_DONE), told + 1);
	/* The row for the next start has the result. */
	dataset_release(d);
	close_service();
	open_service(UINT64_C(32) << 20, 2);
	assert_int_equal(info_of(job_find(h.service->jobs, id, &me)).state, JOB_done);
	assert_int_equal(info_of(job_find(h.service->jobs, id, &me)).report->points, 5000);
}

static void test_refused(void **state)
{
	for (int over = 0; over < 2; over++) {
		struct dataset *d = push(over ? "b" : "a", 5000, 3);
		struct job *job = begin_job(d);
		uint64_t id = info_of(job).id, failed = log_event_count(LOG_EVENT_JOB_FAILED);
		uint64_t otherwise = log_event_count(LOG_EVENT_JOB_DONE) + log_event_count(LOG_EVENT_JOB_CANCELLED);

		if (over)
			turn_until_final(job);
		refuse_row();
		assert_int_equal(accepts, 1);
		assert_int_equal(accepted_err.code, ERR_NOSPACE);
		assert_null(job_find(h.service->jobs, id, &me));
		turn_until(!h.service->jobs->jobs);
		assert_int_equal(put.puts, 1); /* it has no row */
		/* The log says once why it was refused, and nothing else about it. */
		assert_int_equal(log_event_count(LOG_EVENT_JOB_FAILED), failed + 1);
		assert_int_equal(log_event_count(LOG_EVENT_JOB_DONE) + log_event_count(LOG_EVENT_JOB_CANCELLED), otherwise);
		dataset_release(d);
	}
}

/* A crash before the row was written left a plan under the number that the next job gets. */
static void test_others_plan(void **state)
{
	struct dataset *d = push("a", 5000, 3);
	int plansfd = openat(h.statefd, "plans", O_RDONLY | O_DIRECTORY);
	struct plan_file *f = plan_file_new(plansfd, 1, 1, true, NULL);
	struct plan_kept kept = {.load = 500, .cap = 600};
	struct cut_leaf leaf = {.count = 1};
	struct cut_plan plan = {.leaf = &leaf, .n = 1};
	struct err err = ERR_INIT;
	struct job *job;

	assert_true(plansfd >= 0);
	assert_true(cut_region_parse("2147483648:2147483648:4:4:0", &leaf.region));
	assert_int_equal(plan_file_write(f, &plan, &kept, &err), 0);
	plan_file_free(f);
	close(plansfd);
	job = submit(d, false, VIEW);
	assert_int_equal(info_of(job).id, 1);
	turn_until_final(job);
	assert_int_equal(info_of(job).state, JOB_done);
	assert_true(info_of(job).report->triangles > 9000);
	dataset_release(d);
}

/* Also after a failed test: the service waits for the row. */
static int end(void **state)
{
	put.hold = false;
	if (put.held)
		refuse_row();
	return teardown(state);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(test_goes_on, setup, end),
		cmocka_unit_test_setup_teardown(test_refused, setup, end),
		cmocka_unit_test_setup_teardown(test_others_plan, setup, end),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
