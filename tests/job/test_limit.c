/*
 * What counts with whom, and looks at the service: one for all who ask at once, another when something changed.
 */
#include "service.h"

#include "job_priv.h"

enum { ANNA = 1001, BERT = 1002, ASKERS = 500 };

/* An interrupted push counts with who pushed, not with the owner of the dataset; grids and what is taken beside it. */
static void whose_disk(void **state)
{
	const struct limit_geoid grids[] = {{BERT, 1000}, {BERT, 500}, {ANNA, 7}};
	const uint64_t pending = disk_points_bytes(1000);
	struct pending q = {.points = 1000, .uid = BERT};
	struct dataset d = {.uid = ANNA, .bytes = 5000, .pending = &q};
	struct jobs j = {.datasets = &d, .p.user.disk = {.n = 100000, .unit = SPACE_BYTES}};
	struct jobs_own own;
	struct err err = ERR_INIT;

	limit_init(&j);
	limit_count(&j);
	limit_geoids(&j, grids, 3);
	jobs_own(&j, &(struct job_peer){.uid = ANNA}, 0, &own);
	assert_int_equal(own.disk, 5007);
	assert_int_equal(own.disk_most, 100000);
	assert_int_equal(own.datasets, 1);
	jobs_own(&j, &(struct job_peer){.uid = BERT}, 0, &own);
	assert_int_equal(own.disk, pending + 1500);
	assert_int_equal(own.datasets, 0);
	/* Rows outlive a count by what it does not know. */
	assert_int_equal(limit_disk_take(&j, BERT, false, 10, "it", &err), 0);
	d.pending = NULL;
	limit_count(&j);
	jobs_own(&j, &(struct job_peer){.uid = BERT}, 0, &own);
	assert_int_equal(own.disk, 1510);
	/* There is room to the last byte, and what is refused takes nothing. */
	assert_int_equal(limit_disk_take(&j, BERT, false, 100000 - 1509, "it", &err), -ERR_LIMIT);
	assert_string_equal(err.field, "user-disk");
	assert_int_equal(limit_disk_take(&j, BERT, false, 100000 - 1510, "it", &err), 0);
	assert_int_equal(limit_disk_take(&j, BERT, false, 1, "it", &err), -ERR_LIMIT);
	limit_disk_give(&j, BERT, 100000 - 1510);
	/* What was taken and lies there now: in one step. And back. */
	d.pending = &q;
	limit_count_given(&j, BERT, 10, ANNA, 0);
	jobs_own(&j, &(struct job_peer){.uid = BERT}, 0, &own);
	assert_int_equal(own.disk, pending + 1500);
	d.pending = NULL;
	limit_count_given(&j, BERT, -(int64_t)pending, ANNA, -5);
	jobs_own(&j, &(struct job_peer){.uid = BERT}, 0, &own);
	assert_int_equal(own.disk, pending + 1500);
	jobs_own(&j, &(struct job_peer){.uid = ANNA}, 0, &own);
	assert_int_equal(own.disk, 5012);
	/* Also while there is no limit: what was taken under one is given back. */
	j.p.user.disk.unit = SPACE_UNLIMITED;
	limit_count_given(&j, BERT, (int64_t)pending, ANNA, 5);
	j.p.user.disk.unit = SPACE_BYTES;
	limit_count(&j);
	limit_geoids(&j, grids, 0);
	limit_count(&j);
	jobs_own(&j, &(struct job_peer){.uid = BERT}, 0, &own);
	assert_int_equal(own.disk, 0);
	assert_int_equal(j.limits.n, 1);
	limit_done(&j);
}

/* Not 0: the time that it is for all. */
static _Atomic uint64_t stopped_ns;

uint64_t __real_clock_mono_ns(void);
uint64_t __wrap_clock_mono_ns(void);

uint64_t __wrap_clock_mono_ns(void)
{
	return stopped_ns ? stopped_ns : __real_clock_mono_ns();
}

static unsigned answers;
static struct health seen;

static void looked(void *token, const struct err *why, const struct health *found)
{
	assert_null(why);
	answers++;
	seen = *found;
}

static void grid_text(const char *name, const char *text)
{
	char path[128];
	FILE *f;

	snprintf(path, sizeof path, "%s/geoids/%s.geoid", h.folder, name);
	f = fopen(path, "w");
	assert_non_null(f);
	fputs(text, f);
	fclose(f);
}

static void looks(void **state)
{
	struct jobs *j = h.jobs;

	answers = 0;
	turn_until(!j->background);
	for (unsigned i = 0; i < ASKERS; i++)
		health_check(j, &me, looked, NULL);
	assert_int_equal(answers, 0);
	assert_int_equal(j->background, 1);
	turn_until(answers);
	assert_int_equal(answers, ASKERS);
	assert_int_equal(j->background, 0);
	assert_int_equal(seen.geoids, 0);
	assert_true(seen.open_files > 3 && seen.threads > 1);
	/* Within a second it holds, unless something changed. */
	grid_text("a", "nonsense");
	stopped_ns = j->looks.last_ns = clock_mono_ns();
	health_check(j, &me, looked, NULL);
	stopped_ns = 0;
	assert_int_equal(answers, ASKERS + 1);
	assert_int_equal(seen.geoids, 0);
	health_changed(j);
	health_check(j, &me, looked, NULL);
	assert_int_equal(answers, ASKERS + 1);
	turn_until(answers == ASKERS + 2);
	assert_int_equal(seen.geoids_bad, 1);
	/* Who asks after a change waits for another look than that which is under way, also if many do. */
	j->looks.last_ns = 0;
	health_check(j, &me, looked, NULL);
	grid_text("b", "nonsense");
	health_changed(j);
	for (unsigned i = 0; i < ASKERS; i++)
		health_check(j, &me, looked, NULL);
	assert_int_equal(j->background, 1);
	turn_until(answers == 2 * ASKERS + 3);
	assert_int_equal(seen.geoids_bad, 2);
	assert_int_equal(j->background, 0);
	/* A second later it is looked again. */
	grid_text("c", "nonsense");
	j->looks.last_ns -= UINT64_C(1000000001);
	health_check(j, &me, looked, NULL);
	turn_until(answers == 2 * ASKERS + 4);
	assert_int_equal(seen.geoids_bad, 3);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(whose_disk),
		cmocka_unit_test_setup_teardown(looks, setup, teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
