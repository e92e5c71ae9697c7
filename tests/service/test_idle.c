/* A service without work: what it asks of the file systems from time to time does not keep it busy, however long they take. */
#include "core_priv.h"
#include "fixture.h"

#include <stdatomic.h>
#include <sys/statvfs.h>

#include "io.h"

static struct io_table slow_io;
static atomic_bool holds;
static atomic_uint held;

static int slow_fstatvfs(int fd, struct statvfs *ret)
{
	held++;
	while (holds)
		usleep(1000);
	return io_system.fstatvfs(fd, ret);
}

static int setup_slow(void **state)
{
	slow_io = io_system;
	slow_io.fstatvfs = slow_fstatvfs;
	io = &slow_io;
	return setup(state);
}

static int teardown_slow(void **state)
{
	int r;

	holds = false;
	r = teardown(state);
	io = &io_system;
	return r;
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

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(asking_is_no_work, setup_slow, teardown_slow),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
