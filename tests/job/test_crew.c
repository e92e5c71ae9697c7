/*
 * Helpers of a task: every step is taken once, none when the task is told that all are over, and whoever began the work hears
 * of its end once, whatever is cancelled when. Run it under the thread sanitizer too.
 */
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

enum { MEMBERS = 4, STEPS = 400, TOO_LONG = 100 };

static struct {
	struct sched_task task;
	struct crew *crew;
	atomic_uint next, at_it, helped; /* steps begun; being taken; of these by helpers */
	atomic_uint taken[STEPS];
	unsigned over;
	bool ended, ran;
	atomic_bool together, wait, fails, out; /* fails: the task finds an end before the last step; out: it was told that all are over */
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
	struct crew_params p = {.sched = s, .owner = {.uid = 1, .flow = 1}, .members = members, .step = step, .over = over, .ctx = &it};
	struct err err = ERR_INIT;

	assert_int_equal(crew_new(&p, &it.crew, &err), 0);
	it.task = (struct sched_task){.run = run, .done = done, .owner = p.owner};
	sched_submit(s, &it.task);
	crew_start(it.crew);
}

static void end(struct sched *s)
{
	uint64_t since = clock_mono_ns();

	while (!it.over && clock_since(since) < TOO_LONG) {
		struct pollfd p = {.fd = sched_fd(s), .events = POLLIN};

		poll(&p, 1, 10);
		sched_dispatch(s);
	}
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

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(each_once), cmocka_unit_test(failed), cmocka_unit_test(cancelled), cmocka_unit_test(shut)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
