/*
 * Where idle workers wake: each on a processor of its own, and free while it works.
 */
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <unistd.h>

#include <cmocka.h>

#include "clock.h"
#include "err.h"
#include "ledger.h"
#include "sched_home.h"
#include "sched_pool.h"

/* A way out of a hang: whoever waits waits for an event. */
enum { TOO_LONG = 100, MOST = 64 };

static cpu_set_t all; /* of this process */

static unsigned processors(void)
{
	assert_return_code(sched_getaffinity(0, sizeof all, &all), 0);
	return (unsigned)CPU_COUNT(&all);
}

/* So many processors; without two, or with more than there is room for here, the test is skipped. */
static unsigned several(void)
{
	unsigned n = processors();

	if (n >= 2 && n <= MOST)
		return n;
	print_message("skipped: %u processors\n", n);
	skip();
	return 0;
}

static int nth(unsigned n)
{
	int cpu = 0;

	for (; n || !CPU_ISSET(cpu, &all); cpu++)
		n -= CPU_ISSET(cpu, &all) != 0;
	return cpu;
}

static cpu_set_t only(int cpu)
{
	cpu_set_t set;

	CPU_ZERO(&set);
	CPU_SET(cpu, &set);
	return set;
}

/* ---- in the pool ---- */

struct job {
	struct sched_task task;
	pthread_barrier_t *together; /* so that each is on a thread of its own */
	pid_t thread;
	cpu_set_t may; /* it, while it works */
	bool over;
};

static void run(struct sched_task *t)
{
	struct job *j = (struct job *)t;

	pthread_barrier_wait(j->together);
	j->thread = gettid();
	sched_getaffinity(0, sizeof j->may, &j->may);
}

static void done(struct sched_task *t)
{
	((struct job *)t)->over = true;
}

/* On all of so many threads at once. */
static void work_all(struct sched *s, struct job *job, unsigned n)
{
	uint64_t begun = clock_mono_ns();
	pthread_barrier_t together;
	unsigned over;

	pthread_barrier_init(&together, NULL, n);
	for (unsigned i = 0; i < n; i++) {
		job[i] = (struct job){.task = {.run = run, .done = done, .name = LEDGER_DOMAIN}, .together = &together};
		sched_submit(s, &job[i].task);
	}
	do {
		sched_dispatch(s);
		usleep(500);
		over = 0;
		for (unsigned i = 0; i < n; i++)
			over += job[i].over;
		assert_true(clock_since(begun) < TOO_LONG);
	} while (over < n);
	pthread_barrier_destroy(&together);
}

static cpu_set_t of_thread(pid_t thread)
{
	cpu_set_t set;

	assert_return_code(sched_getaffinity(thread, sizeof set, &set), 0);
	return set;
}

static cpu_set_t until_one(pid_t thread)
{
	uint64_t begun = clock_mono_ns();
	cpu_set_t set;

	while (set = of_thread(thread), CPU_COUNT(&set) != 1) {
		assert_true(clock_since(begun) < TOO_LONG);
		usleep(500);
	}
	return set;
}

static struct sched *pool(unsigned threads, struct ledger **ledger)
{
	struct err err = ERR_INIT;
	struct sched *s;

	*ledger = ledger_new(1 << 20);
	assert_non_null(*ledger);
	assert_int_equal(sched_new(*ledger, threads, &s, &err), 0);
	return s;
}

static void own_while_idle(void **state)
{
	unsigned n = several();
	struct ledger *ledger;
	struct job job[MOST];
	struct sched *s;
	cpu_set_t homes;

	(void)state;
	s = pool(n, &ledger);
	for (int round = 0; round < 20; round++) {
		work_all(s, job, n);
		CPU_ZERO(&homes);
		for (unsigned i = 0; i < n; i++) {
			cpu_set_t home = until_one(job[i].thread);

			CPU_OR(&homes, &homes, &home);
			assert_true(CPU_EQUAL(&job[i].may, &all));
		}
		assert_true(CPU_EQUAL(&homes, &all));
	}
	sched_free(s);
	ledger_free(ledger);
}

/* What taskset -p says holds. */
static void others_may_bind(void **state)
{
	unsigned n = several();
	cpu_set_t home, other;
	struct ledger *ledger;
	struct job job[MOST];
	struct sched *s;
	pid_t thread;

	(void)state;
	s = pool(n, &ledger);
	work_all(s, job, n);
	thread = job[0].thread;
	home = until_one(thread);
	other = only(nth(CPU_ISSET(nth(0), &home) ? 1 : 0));
	assert_return_code(sched_setaffinity(thread, sizeof other, &other), 0);
	for (int round = 0; round < 3; round++) {
		work_all(s, job, n);
		for (unsigned i = 0; i < n; i++)
			assert_true(CPU_EQUAL(&job[i].may, job[i].thread == thread ? &other : &all));
	}
	sched_free(s);
	ledger_free(ledger);
}

/* The kernel has room to choose. */
static void few_are_free(void **state)
{
	unsigned n = several();
	struct ledger *ledger;
	struct job job[MOST];
	struct sched *s;

	(void)state;
	s = pool(n - 1, &ledger);
	for (int round = 0; round < 20; round++) {
		work_all(s, job, n - 1);
		usleep(2000);
		for (unsigned i = 0; i < n - 1; i++) {
			cpu_set_t set = of_thread(job[i].thread);

			assert_true(CPU_EQUAL(&set, &all));
		}
	}
	sched_free(s);
	ledger_free(ledger);
}

/* ---- by itself ---- */

static void nobody_moves_for_a_worker(void **state)
{
	struct sched_home none[3] = {0};
	struct sched_homes *h = sched_homes_new(3);

	(void)state;
	assert_non_null(h);
	/* It stays where it is: who lives there is awake. */
	assert_int_equal(sched_homes_settle(h, 0, 1), 1);
	/* That one is asleep now: the others go where they live, which for 1 is where 0 came from. */
	assert_int_equal(sched_homes_settle(h, 1, 1), 0);
	assert_int_equal(sched_homes_settle(h, 2, 0), 2);
	/* Awake, they give way, and to nobody else: each has one of its own. */
	sched_home_leave(h, 0, &none[0]);
	sched_home_leave(h, 2, &none[2]);
	assert_int_equal(sched_homes_settle(h, 2, 1), 1);
	assert_int_equal(sched_homes_settle(h, 0, 1), 2);
	/* At home there is nothing to change. */
	sched_home_leave(h, 0, &none[0]);
	assert_int_equal(sched_homes_settle(h, 0, 2), 2);
	sched_homes_free(h);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(own_while_idle),
		cmocka_unit_test(others_may_bind),
		cmocka_unit_test(few_are_free),
		cmocka_unit_test(nobody_moves_for_a_worker),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
