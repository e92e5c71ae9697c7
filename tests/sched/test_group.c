/*
 * Task groups: every step is taken once, no step runs after the task's last, and `over` is called once, whatever is cancelled and
 * when. Helpers continue while no other task waits, and yield when one does. Run this under the thread sanitizer too.
 */
#include <limits.h>
#include <poll.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "clock.h"
#include "sched_group.h"
#include "err.h"

enum { MEMBERS = 4, STEPS = 400, TOO_LONG = 40 };

static struct {
	struct sched_task task;
	struct sched_group *group;
	atomic_uint next, at_it, helped; /* steps begun; in progress; taken by helpers */
	atomic_uint taken[STEPS];
	unsigned over;
	bool ended, ran;
	/* together: the task waits for a helper's first step; wait: it waits to be cancelled; fails: it stops before the last
	 * step; out: sched_group_run returned */
	atomic_bool together, wait, fails, out;
} it;

static bool step(void *ctx, unsigned member)
{
	unsigned n = it.next++;

	assert_ptr_equal(ctx, &it);
	assert_true(member <= MEMBERS);
	assert_false(it.out);
	if (n >= STEPS || (it.fails && !member && n > STEPS / 8))
		return false;
	it.at_it++;
	it.helped += member > 0;
	while (it.together && !it.helped)
		usleep(100);
	for (unsigned i = 0; i < 50 * (n % 7); i++)
		atomic_thread_fence(memory_order_seq_cst);
	it.taken[n]++;
	it.at_it--;
	return true;
}

static void over(void *ctx)
{
	assert_true(it.ended);
	assert_int_equal(it.at_it, 0);
	it.over++;
}

static void run(struct sched_task *t)
{
	while (it.wait && !atomic_load(&t->cancel))
		usleep(100);
	sched_group_run(it.group);
	it.out = true;
	assert_int_equal(it.at_it, 0);
	assert_true(it.next >= STEPS || it.fails);
	it.ran = true;
}

static void done(struct sched_task *t)
{
	it.ended = true;
	sched_group_end(it.group);
}

static void begin(struct sched *s, unsigned members)
{
	struct sched_group_params p = {
		.sched = s, .owner = {.uid = 1, .flow = 1}, .members = members, .step = step, .over = over, .ctx = &it};
	struct err err = ERR_INIT;

	assert_int_equal(sched_group_new(&p, &it.group, &err), 0);
	it.task = (struct sched_task){.run = run, .done = done, .owner = p.owner};
	sched_submit(s, &it.task);
	sched_group_start(it.group);
}

/* Waits for the scheduler. Returns how many tasks ended. */
static unsigned turn(struct sched *s)
{
	struct pollfd p = {.fd = sched_fd(s), .events = POLLIN};

	return poll(&p, 1, TOO_LONG * 1000) > 0 ? sched_dispatch(s) : 0;
}

static void end(struct sched *s)
{
	uint64_t since = clock_mono_ns();

	while (!it.over && clock_since(since) < TOO_LONG)
		turn(s);
	assert_int_equal(it.over, 1);
	it.group = sched_group_free(it.group);
	assert_int_equal(sched_busy(s), 0);
}

static struct sched *sched_of(struct ledger **ledger, unsigned threads)
{
	struct sched *s = NULL;
	struct err err = ERR_INIT;

	*ledger = ledger_new(1 << 20);
	assert_int_equal(sched_new(*ledger, threads, &s, &err), 0);
	memset(&it, 0, sizeof it);
	return s;
}

static void each_once(void **state)
{
	for (unsigned round = 0; round < 50; round++)
		for (unsigned threads = 1; threads <= 3; threads++) {
			struct ledger *ledger;
			struct sched *s = sched_of(&ledger, threads);

			it.together = threads > 1 && round % 2;
			begin(s, 1 + (round + threads) % MEMBERS + it.together);
			end(s);
			assert_true(it.ran);
			for (unsigned i = 0; i < STEPS; i++)
				assert_int_equal(it.taken[i], 1);
			assert_true(it.helped || !it.together);
			sched_free(s);
			ledger_free(ledger);
		}
}

/* A step that fails stops the group: no further step begins. */
static void failed(void **state)
{
	for (unsigned round = 0; round < 50; round++) {
		struct ledger *ledger;
		struct sched *s = sched_of(&ledger, 3);

		it.fails = it.together = true;
		begin(s, 3);
		end(s);
		assert_true(it.ran);
		sched_free(s);
		ledger_free(ledger);
	}
}

static void cancelled(void **state)
{
	for (unsigned round = 0; round < 50; round++) {
		struct ledger *ledger;
		struct sched *s = sched_of(&ledger, 2);
		it.wait = round % 2;
		begin(s, 3);
		if (round % 3)
			usleep(round * 20);
		sched_cancel(s, &it.task);
		end(s);
		for (unsigned i = 0; i < STEPS; i++)
			assert_true(it.taken[i] == (it.ran || it.taken[i]));
		sched_free(s);
		ledger_free(ledger);
	}
}

/* sched_free ends the groups of its tasks. */
static void shut(void **state)
{
	for (unsigned round = 0; round < 20; round++) {
		struct ledger *ledger;
		struct sched *s = sched_of(&ledger, 2);

		begin(s, 3);
		usleep(round * 30);
		sched_free(s);
		assert_int_equal(it.over, 1);
		sched_group_free(it.group);
		ledger_free(ledger);
	}
}

/* ---- continuing and yielding ---- */

enum { ALONE = 1000, ROUNDS = 20 };
static const double HELP = 0.02; /* HELP_SECONDS of sched_group.c */

static struct {
	atomic_uint taken; /* steps of helpers */
	unsigned most;     /* steps that there are */
	/* A helper is `in` its step as long as `held` is set; the task waits in its step for `free`. */
	atomic_bool held, in, free;
	unsigned at;             /* steps taken when `other` ran */
	struct sched_task other; /* of another flow */
} yield;

static bool yield_step(void *ctx, unsigned member)
{
	if (!member) {
		while (!yield.free)
			usleep(100);
		return false;
	}
	while (yield.held) {
		yield.in = true;
		usleep(100);
	}
	/* Longer than the loop needs to return a helper to the queue. */
	usleep(20);
	return ++yield.taken < yield.most;
}

static void yield_run(struct sched_task *t)
{
	sched_group_run(it.group);
	it.ran = true;
}

static void other_run(struct sched_task *t)
{
	yield.at = yield.taken;
}

static void other_done(struct sched_task *t)
{
	yield.free = true;
}

/* One helper is held in its step, on the last thread; the other helpers wait for a thread. With one thread the task has not
 * started. */
static struct sched *held_group(struct ledger **ledger, unsigned threads, unsigned members, unsigned most)
{
	struct sched *s = sched_of(ledger, threads);
	struct sched_group_params p = {
		.sched = s, .owner = {.uid = 1, .flow = 1}, .members = members, .step = yield_step, .over = over, .ctx = &it};
	struct err err = ERR_INIT;

	memset(&yield, 0, sizeof yield);
	yield.most = most;
	yield.held = true;
	yield.other = (struct sched_task){.run = other_run, .done = other_done, .owner = {.uid = 1, .flow = 2}};
	assert_int_equal(sched_group_new(&p, &it.group, &err), 0);
	it.task = (struct sched_task){.run = yield_run, .done = done, .owner = p.owner};
	if (threads > 1)
		sched_submit(s, &it.task);
	sched_group_start(it.group);
	for (uint64_t since = clock_mono_ns(); !yield.in && clock_since(since) < TOO_LONG;)
		usleep(100);
	assert_true(yield.in);
	if (threads == 1)
		sched_submit(s, &it.task);
	return s;
}

static void free_and_end(struct sched *s, struct ledger *ledger)
{
	end(s);
	sched_free(s);
	ledger_free(ledger);
}

/* A helper does not yield to another helper of its group: two helpers share one thread. */
static void helpers_continue(void **state)
{
	for (unsigned members = 2; members <= 3; members++) {
		struct ledger *ledger;
		struct sched *s = held_group(&ledger, 2, members, ALONE);
		uint64_t since = clock_mono_ns();
		unsigned trips = 0;

		yield.held = false;
		while (yield.taken < ALONE && clock_since(since) < TOO_LONG)
			trips += turn(s);
		assert_true(yield.taken >= ALONE);
		/* One period began earlier, and each helper may end one early. */
		assert_true(trips <= clock_since(since) / HELP + members);
		yield.free = true;
		free_and_end(s, ledger);
	}
}

/* A helper returns to the queue after HELP_SECONDS even if no task waits. */
static void helper_returns(void **state)
{
	struct ledger *ledger;
	struct sched *s = held_group(&ledger, 2, 2, UINT_MAX);
	struct pollfd p = {.fd = sched_fd(s), .events = POLLIN};

	yield.held = false;
	/* The task itself does not end before `free`. */
	assert_int_equal(poll(&p, 1, TOO_LONG * 1000), 1);
	assert_true(sched_dispatch(s) > 0);
	yield.free = true;
	free_and_end(s, ledger);
}

/* A task that is submitted during a step gets the thread after that step. */
static void helper_yields(void **state)
{
	for (unsigned round = 0; round < ROUNDS; round++) {
		struct ledger *ledger;
		struct sched *s = held_group(&ledger, 2, 2 + round % 2, UINT_MAX);

		sched_submit(s, &yield.other);
		yield.held = false;
		free_and_end(s, ledger);
		assert_int_equal(yield.at, 1);
	}
}

/* The task is cancelled before it starts: the helper begins no further step. */
static void helper_ends(void **state)
{
	for (unsigned round = 0; round < ROUNDS; round++) {
		struct ledger *ledger;
		struct sched *s = held_group(&ledger, 1, 2, UINT_MAX);

		sched_cancel(s, &it.task);
		assert_int_equal(turn(s), 1);
		yield.held = false;
		free_and_end(s, ledger);
		assert_false(it.ran);
		assert_int_equal(yield.taken, 1);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(each_once),     cmocka_unit_test(failed),           cmocka_unit_test(cancelled),
		cmocka_unit_test(shut),          cmocka_unit_test(helpers_continue), cmocka_unit_test(helper_returns),
		cmocka_unit_test(helper_yields), cmocka_unit_test(helper_ends),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
