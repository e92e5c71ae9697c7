/* Locks out of order, and calls that are only allowed in the loop, end the process at once, without a second thread. */
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "clock.h"
#include "lock.h"
#include "thread.h"

static struct lock outer = LOCK_STATIC(SPACE), inner = LOCK_STATIC(LEDGER), twin = LOCK_STATIC(SPACE);
static pthread_cond_t never = PTHREAD_COND_INITIALIZER;

/* How a process that runs fn ends: a signal's number, or 0. */
static int end_of(void (*fn)(void))
{
	int status;
	pid_t child = fork();

	assert_true(child >= 0);
	if (!child) {
		signal(SIGABRT, SIG_DFL);
		if (freopen("/dev/null", "w", stderr))
			fn();
		_exit(0);
	}
	assert_int_equal(waitpid(child, &status, 0), child);
	return WIFSIGNALED(status) ? WTERMSIG(status) : 0;
}

static void in_order(void)
{
	lock_take(&outer);
	lock_take(&inner);
	if (!lock_held(LOCK_SPACE) || !lock_held(LOCK_LEDGER))
		abort();
	lock_give(&outer); /* in any order */
	lock_give(&inner);
	if (lock_held(LOCK_SPACE) || lock_held(LOCK_LEDGER))
		abort();
	lock_take(&twin);
	lock_give(&twin);
}

static void out_of_order(void)
{
	lock_take(&inner);
	lock_take(&outer);
}

static void two_of_a_rank(void)
{
	lock_take(&outer);
	lock_take(&twin);
}

static void given_twice(void)
{
	lock_take(&outer);
	lock_give(&outer);
	lock_give(&outer);
}

static void waits_with_another(void)
{
	lock_take(&outer);
	lock_take(&inner);
	lock_wait_until(&inner, &never, clock_mono_ns());
}

static void tries(void)
{
	lock_take(&inner);
	if (!lock_try(&outer)) /* out of order, but it does not wait */
		abort();
	lock_give(&outer);
	lock_give(&inner);
}

static void by_a_helper(void)
{
	thread_mark_helper();
	THREAD_LOOP_ONLY();
}

static void order(void **state)
{
	assert_int_equal(end_of(in_order), 0);
	assert_int_equal(end_of(tries), 0);
	assert_int_equal(end_of(out_of_order), SIGABRT);
	assert_int_equal(end_of(two_of_a_rank), SIGABRT);
	assert_int_equal(end_of(given_twice), SIGABRT);
	assert_int_equal(end_of(waits_with_another), SIGABRT);
}

static void waits(void **state)
{
	lock_take(&outer);
	assert_false(lock_wait_until(&outer, &never, clock_mono_ns() + 1000000));
	assert_true(lock_held(LOCK_SPACE));
	lock_give(&outer);
}

static void loop_only(void **state)
{
	THREAD_LOOP_ONLY();
	assert_int_equal(end_of(by_a_helper), SIGABRT);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(order),
		cmocka_unit_test(waits),
		cmocka_unit_test(loop_only),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
