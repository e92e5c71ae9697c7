/* Removed datasets, pending pushes and wrong clocks: nothing expires because a clock jumps ahead. */
#include "fixture.h"
#include "dataset_priv.h"

#include <stdatomic.h>

#define HOUR INT64_C(3600000000)
#define DAY (24 * HOUR)

static atomic_llong real_ahead, mono_ahead; /* microseconds */

int64_t __real_clock_real_us(void);
int64_t __wrap_clock_real_us(void);
uint64_t __real_clock_mono_ns(void);
uint64_t __wrap_clock_mono_ns(void);

int64_t __wrap_clock_real_us(void)
{
	return __real_clock_real_us() + atomic_load(&real_ahead);
}

uint64_t __wrap_clock_mono_ns(void)
{
	return __real_clock_mono_ns() + 1000 * (uint64_t)atomic_load(&mono_ahead);
}

static void changed(void *token, const struct err *why, struct dataset *d)
{
	*(bool *)token = true;
	assert_null(why);
}

/* A dataset that is removed now, and its folder. */
static void remove_s(char path[128])
{
	struct dataset *d = push("s", 100, 1);
	struct dataset_action_params w = {.action = DATASET_REMOVE, .name = "s", .as = "", .peer = me};
	bool answered = false;

	snprintf(path, 128, "%s/datasets/%llu", h.folder, (unsigned long long)d->id);
	dataset_release(d);
	dataset_act(h.service->datasets, &w, changed, &answered);
	turn_until(answered);
}

static bool is_there(const char *path)
{
	datasets_expire(h.service->datasets);
	turn_until(!sched_busy(h.sched) && !catalogue_busy(h.catalogue));
	turn(0);
	return access(path, F_OK) == 0;
}

/* Both clocks go on. */
static void pass(int64_t us)
{
	atomic_fetch_add(&real_ahead, us);
	atomic_fetch_add(&mono_ahead, us);
}

static void time_passes(void **state)
{
	char path[128];

	remove_s(path);
	assert_true(is_there(path));
	pass(7 * DAY - HOUR);
	assert_true(is_there(path));
	pass(HOUR + HOUR / 60);
	assert_false(is_there(path));
}

static void a_year_ahead_for_a_minute(void **state)
{
	char path[128];

	remove_s(path);
	assert_true(is_there(path));
	atomic_fetch_add(&real_ahead, 365 * DAY);
	assert_true(is_there(path));
	pass(HOUR / 60);
	assert_true(is_there(path));
	atomic_fetch_add(&real_ahead, -365 * DAY);
	assert_true(is_there(path));
	pass(6 * DAY);
	assert_true(is_there(path));
	/* Neither does a jump back delay it. */
	atomic_fetch_add(&real_ahead, -365 * DAY);
	assert_true(is_there(path));
	atomic_fetch_add(&real_ahead, 365 * DAY);
	assert_true(is_there(path));
	pass(DAY + HOUR);
	assert_false(is_there(path));
}

/* A new daemon has the recorded times of its datasets, and a clock that may be wrong. */
static void while_it_did_not_run(void **state)
{
	char path[128];

	remove_s(path);
	assert_true(is_there(path));
	memset(&h.service->datasets->trusted, 0, sizeof h.service->datasets->trusted);
	atomic_fetch_add(&real_ahead, 8 * DAY);
	assert_true(is_there(path));
	pass(HOUR - HOUR / 60);
	assert_true(is_there(path));
	pass(HOUR / 30);
	assert_false(is_there(path));
}

/* A push with one durable file, whose client left. */
static void interrupt_push(void)
{
	push_leave(stage_file_as("p", "a.xyz", text_file(500, 3)));
	turn_until(!pushes_open(h.service->pushes));
}

static bool is_pending(void)
{
	if (datasets_first(h.service->datasets))
		pending_expire(datasets_first(h.service->datasets));
	turn_until(!sched_busy(h.sched) && !catalogue_busy(h.catalogue));
	turn(0);
	return datasets_first(h.service->datasets) && datasets_first(h.service->datasets)->pending;
}

static void an_interrupted_push(void **state)
{
	interrupt_push();
	assert_true(is_pending());
	atomic_fetch_add(&real_ahead, 365 * DAY);
	assert_true(is_pending());
	/* Neither does it expire when a daemon starts with that clock. */
	close_service();
	open_service(UINT64_C(32) << 20, 2);
	assert_true(is_pending());
	pass(HOUR / 60);
	assert_true(is_pending());
	atomic_fetch_add(&real_ahead, -365 * DAY);
	assert_true(is_pending());
	pass(7 * DAY - HOUR);
	assert_true(is_pending());
	pass(HOUR + HOUR / 60);
	assert_false(is_pending());
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(time_passes, setup, teardown),
		cmocka_unit_test_setup_teardown(a_year_ahead_for_a_minute, setup, teardown),
		cmocka_unit_test_setup_teardown(while_it_did_not_run, setup, teardown),
		cmocka_unit_test_setup_teardown(an_interrupted_push, setup, teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
