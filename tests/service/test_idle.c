/* A service without work: what it asks of the file systems from time to time does not keep it busy, however long they take. An
 * inexact account of the cache is corrected, also while somebody asks for it. */
#include "core_priv.h"
#include "fixture.h"

#include <errno.h>
#include <stdatomic.h>
#include <sys/statvfs.h>

#include "io.h"
#include "log.h"

static atomic_bool holds, unreadable;
static atomic_uint unreadable_us; /* until it fails */
static atomic_uint held;

static int slow_fstatvfs(int fd, struct statvfs *ret)
{
	held++;
	while (holds)
		usleep(1000);
	return io_system.fstatvfs(fd, ret);
}

static int failing_openat(int dirfd, const char *path, int flags, mode_t mode)
{
	if (!unreadable || strcmp(path, "domains"))
		return io_system.openat(dirfd, path, flags, mode);
	usleep(unreadable_us);
	errno = EIO;
	return -1;
}

static int teardown_slow(void **state)
{
	holds = unreadable = false;
	return teardown(state);
}

static void asking_is_no_work(void **state)
{
	turn_until(!service_active(h.service) && !h.service->core->priv->disk.querying);
	holds = true;
	held = 0;
	h.service->core->priv->disk.queried_ns = 0;
	turn_until(held);
	assert_true(h.service->core->priv->disk.querying && sched_busy(h.sched) == 1);
	assert_false(service_active(h.service));
	h.service->core->background++; /* other work is */
	assert_true(service_active(h.service));
	h.service->core->background--;
	holds = false;
	turn_until(!service_active(h.service));
}

static void poll_cache(void)
{
	struct cache_stat stat;

	cache_stat(h.service->maintenance, &stat);
	turn(0);
}

/* A pass over the cache that met a writer is repeated, however often the numbers are asked for, and not at once. */
static void inexact_is_measured_again(void **state)
{
	struct disk *d = &h.service->core->priv->disk;
	struct space *s = h.service->core->space;
	struct err err = ERR_INIT;
	uint64_t before;

	turn_until(d->measured && !d->work);
	assert_int_equal(space_take(s, SPACE_DOMAINS, 1000, SPACE_MAY, "a domain", &err), 0);
	assert_int_equal(space_measure(s, NULL, &err), 0);
	d->remeasure_ns = 0;
	poll_cache();
	assert_null(d->work); /* it is still written */
	space_commit(s, SPACE_DOMAINS, 1000, 0);
	d->remeasure_ns = UINT64_MAX;
	poll_cache();
	assert_true(space_is_inexact(s) && !d->work);
	/* One that fails is not repeated at once, either. */
	unreadable_us = 600000;
	unreadable = true;
	d->remeasure_ns = before = clock_mono_ns();
	poll_cache();
	turn_until(!d->work);
	assert_true(space_is_inexact(s));
	assert_true(d->remeasure_ns >= before + UINT64_C(12000000000));
	unreadable = false;
	d->remeasure_ns = before = clock_mono_ns();
	cache_stat(h.service->maintenance, &(struct cache_stat){0});
	assert_non_null(d->work);
	turn_until(!d->work);
	assert_false(space_is_inexact(s));
	assert_true(d->remeasure_ns >= before + UINT64_C(10000000000));
}

static unsigned said_again;

static bool count_again(void *ctx, const struct log_entry *e)
{
	said_again += strstr(e->message, "the cache can be examined again") != NULL;
	return false;
}

static void measure_again(struct disk *d)
{
	struct cache_stat stat;

	d->remeasure_ns = 0;
	cache_stat(h.service->maintenance, &stat);
	assert_non_null(d->work);
	turn_until(!d->work);
}

/* A cache that cannot be read is measured until it can; what fails is logged when it begins and when it ends. */
static void failures_are_logged_once(void **state)
{
	struct disk *d = &h.service->core->priv->disk;
	uint64_t failures = log_event_count(LOG_EVENT_SPACE_UNKNOWN);

	turn_until(d->measured && !d->work);
	said_again = 0;
	unreadable_us = 0;
	for (unsigned time = 1; time <= 2; time++) {
		unreadable = true;
		d->measured = false; /* as after the start */
		for (unsigned pass = 0; pass < 3; pass++)
			measure_again(d);
		assert_int_equal(log_event_count(LOG_EVENT_SPACE_UNKNOWN), failures + time);
		assert_int_equal(said_again, time - 1);
		unreadable = false;
		measure_again(d);
		assert_int_equal(said_again, time);
		d->remeasure_ns = 0;
		poll_cache();
		assert_null(d->work);
		d->measured = false;
		measure_again(d);
		assert_int_equal(said_again, time);
	}
	assert_int_equal(log_event_count(LOG_EVENT_SPACE_UNKNOWN), failures + 2);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(asking_is_no_work, setup, teardown_slow),
		cmocka_unit_test_setup_teardown(inexact_is_measured_again, setup, teardown_slow),
		cmocka_unit_test_setup_teardown(failures_are_logged_once, setup, teardown_slow),
	};
	struct io_table table = io_system;

	table.fstatvfs = slow_fstatvfs;
	table.openat = failing_openat;
	io = &table; /* while there is no other thread */
	log_set_sink(count_again, NULL);
	return cmocka_run_group_tests(tests, NULL, NULL);
}
