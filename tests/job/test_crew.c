/*
 * Helpers of a task: every step is taken once, none when the task is told that all are over, and whoever began the work hears
 * of its end once, whatever is cancelled when. They go on where nobody waits, and give way where somebody does. Run it under the
 * thread sanitizer too.
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
#include "crew.h"
#include "err.h"

enum { MEMBERS = 4, STEPS = 400, TOO_LONG = 40 };

static struct {
	struct sched_task task;
	struct crew *crew;
	atomic_uint next, at_it, helped; /* steps begun; being taken; of these by helpers */
	atomic_uint taken[STEPS];
	unsigned over;
	bool ended, ran;
	atomic_bool together, wait, fails,
		out; /* fails: the task finds an end before the last step; out: it was told that all are over */
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
	/* Nobody goes on alone. */
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
	crew_work(it.crew);
	it.out = true;
	assert_int_equal(it.at_it, 0);
	assert_true(it.next >= STEPS || it.fails);
	it.ran = true;
}

static void done(struct sched_task *t)
{
	it.ended = true;
	crew_end(it.crew);
}

static void begin(struct sched *s, unsigned members)
{
	struct crew_params p = {
		.sched = s, .owner = {.uid = 1, .flow = 1}, .members = members, .step = step, .over = over, .ctx = &it};
	struct err err = ERR_INIT;

	assert_int_equal(crew_new(&p, &it.crew, &err), 0);
	it.task = (struct sched_task){.run = run, .done = done, .owner = p.owner};
	sched_submit(s, &it.task);
	crew_start(it.crew);
}

/* Only when told. Returns how many tasks were over. */
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
	it.crew = crew_free(it.crew);
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

/* What is wrong for one is wrong for all: what was not begun then is not begun. */
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

/* Those of a scheduler that ends are over, too. */
static void shut(void **state)
{
	for (unsigned round = 0; round < 20; round++) {
		struct ledger *ledger;
		struct sched *s = sched_of(&ledger, 2);

		begin(s, 3);
		usleep(round * 30);
		sched_free(s);
		assert_int_equal(it.over, 1);
		crew_free(it.crew);
		ledger_free(ledger);
	}
}

/* ---- staying and giving way ---- */

enum { ALONE = 1000, ROUNDS = 20 };
static const double STAY = 0.02; /* of crew.c */

static struct {
	atomic_uint taken; /* steps of helpers */
	unsigned most;     /* so many are there */
	/* A helper waits in its step, `in`, while it is held; the task in its own until it is free. */
	atomic_bool held, in, free;
	unsigned at; /* steps taken when somebody else had the thread */
	struct sched_task other;
} way;

static bool way_step(void *ctx, unsigned member)
{
	if (!member) {
		while (!way.free)
			usleep(100);
		return false;
	}
	while (way.held) {
		way.in = true;
		usleep(100);
	}
	/* As long as the loop needs to bring a helper back to the queue. */
	usleep(20);
	return ++way.taken < way.most;
}

static void way_run(struct sched_task *t)
{
	crew_work(it.crew);
	it.ran = true;
}

static void other_run(struct sched_task *t)
{
	way.at = way.taken;
}

static void other_done(struct sched_task *t)
{
	way.free = true;
}

/* One helper is held in its step, on the last thread; the others wait behind it. With one thread the task is not begun. */
static struct sched *way_of(struct ledger **ledger, unsigned threads, unsigned members, unsigned most)
{
	struct sched *s = sched_of(ledger, threads);
	struct crew_params p = {
		.sched = s, .owner = {.uid = 1, .flow = 1}, .members = members, .step = way_step, .over = over, .ctx = &it};
	struct err err = ERR_INIT;

	memset(&way, 0, sizeof way);
	way.most = most;
	way.held = true;
	way.other = (struct sched_task){.run = other_run, .done = other_done, .owner = {.uid = 1, .flow = 2}};
	assert_int_equal(crew_new(&p, &it.crew, &err), 0);
	it.task = (struct sched_task){.run = way_run, .done = done, .owner = p.owner};
	if (threads > 1)
		sched_submit(s, &it.task);
	crew_start(it.crew);
	for (uint64_t since = clock_mono_ns(); !way.in && clock_since(since) < TOO_LONG;)
		usleep(100);
	assert_true(way.in);
	if (threads == 1)
		sched_submit(s, &it.task);
	return s;
}

static void way_end(struct sched *s, struct ledger *ledger)
{
	end(s);
	sched_free(s);
	ledger_free(ledger);
}

/* Its own kind that waits is nobody else: two helpers and one thread. */
static void stays(void **state)
{
	for (unsigned members = 2; members <= 3; members++) {
		struct ledger *ledger;
		struct sched *s = way_of(&ledger, 2, members, ALONE);
		uint64_t since = clock_mono_ns();
		unsigned trips = 0;

		way.held = false;
		while (way.taken < ALONE && clock_since(since) < TOO_LONG)
			trips += turn(s);
		assert_true(way.taken >= ALONE);
		/* One stay began before; and each helper ends one early. */
		assert_true(trips <= clock_since(since) / STAY + members);
		way.free = true;
		way_end(s, ledger);
	}
}

/* The queue hears of it now and then even so. */
static void comes_back(void **state)
{
	struct ledger *ledger;
	struct sched *s = way_of(&ledger, 2, 2, UINT_MAX);
	struct pollfd p = {.fd = sched_fd(s), .events = POLLIN};

	way.held = false;
	/* Of the task nothing is heard before it is free. */
	assert_int_equal(poll(&p, 1, TOO_LONG * 1000), 1);
	assert_true(sched_dispatch(s) > 0);
	way.free = true;
	way_end(s, ledger);
}

/* Whoever comes during a step has the thread after it. */
static void gives_way(void **state)
{
	for (unsigned round = 0; round < ROUNDS; round++) {
		struct ledger *ledger;
		struct sched *s = way_of(&ledger, 2, 2 + round % 2, UINT_MAX);

		sched_submit(s, &way.other);
		way.held = false;
		way_end(s, ledger);
		assert_int_equal(way.at, 1);
	}
}

/* The task is cancelled before it began: a helper begins no other step. */
static void goes(void **state)
{
	for (unsigned round = 0; round < ROUNDS; round++) {
		struct ledger *ledger;
		struct sched *s = way_of(&ledger, 1, 2, UINT_MAX);

		sched_cancel(s, &it.task);
		assert_int_equal(turn(s), 1);
		way.held = false;
		way_end(s, ledger);
		assert_false(it.ran);
		assert_int_equal(way.taken, 1);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(each_once), cmocka_unit_test(failed),     cmocka_unit_test(cancelled), cmocka_unit_test(shut),
		cmocka_unit_test(stays),     cmocka_unit_test(comes_back), cmocka_unit_test(gives_way), cmocka_unit_test(goes),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
