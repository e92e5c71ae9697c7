/*
 * The scheduler: order, admission under the budget, cancelling, and that nothing is lost with many threads
 * (run it under the thread sanitizer too).
 */
#include <poll.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "clock.h"
#include "err.h"
#include "ledger.h"
#include "sched_pool.h"

struct job {
	struct sched_task task;
	struct sched *sched;
	int number;
	_Atomic int *gate; /* run waits until it is not zero */
	bool give;         /* done gives the memory back */
};

static atomic_int order[64]; /* of what started; 0: its number is not there yet */
static atomic_int norder;
static int ndone;

/* A way out of a hang: whoever waits waits for an event. */
enum { TOO_LONG = 40 };

static void run(struct sched_task *t)
{
	struct job *j = (struct job *)t;

	order[atomic_fetch_add(&norder, 1)] = j->number;
	while (j->gate && !*j->gate && !atomic_load(&t->cancel))
		usleep(1000);
}

static void done(struct sched_task *t)
{
	struct job *j = (struct job *)t;

	ndone++;
	if (t->ran && t->bytes && j->give)
		sched_give(j->sched, t->name, t->bytes);
}

static struct job make(struct sched *s, int number, uint64_t bytes, enum sched_priority priority)
{
	return (struct job){
		.task = {.run = run, .done = done, .priority = priority, .name = LEDGER_DOMAIN, .bytes = bytes},
		.sched = s,
		.number = number,
		.give = true,
	};
}

/* Dispatches until n are done. */
static void wait_done(struct sched *s, int n)
{
	uint64_t since = clock_mono_ns();

	while (ndone < n && clock_since(since) < TOO_LONG) {
		struct pollfd p = {.fd = sched_fd(s), .events = POLLIN};

		/* Only when told. */
		if (poll(&p, 1, TOO_LONG * 1000) > 0)
			sched_dispatch(s);
	}
	assert_int_equal(ndone, n);
}

/* Until n have started and said who they are. */
static void wait_started(int n)
{
	uint64_t since = clock_mono_ns();

	while ((atomic_load(&norder) < n || !order[n - 1]) && clock_since(since) < TOO_LONG)
		usleep(1000);
	assert_int_equal(atomic_load(&norder), n);
	assert_int_not_equal(order[n - 1], 0);
}

static struct sched *start(struct ledger **ret_ledger, uint64_t total, unsigned threads)
{
	struct err err = ERR_INIT;
	struct sched *s;

	ndone = 0;
	atomic_store(&norder, 0);
	memset(order, 0, sizeof order);
	*ret_ledger = ledger_new(total);
	assert_int_equal(sched_new(*ret_ledger, threads, &s, &err), 0);
	return s;
}

static void by_priority_then_order(void **state)
{
	struct ledger *ledger;
	struct sched *s = start(&ledger, 100, 1);
	_Atomic int gate = 0;
	struct job first = make(s, 9, 0, SCHED_NORMAL), rest[4] = {
								make(s, 1, 0, SCHED_LAST),
								make(s, 2, 0, SCHED_NORMAL),
								make(s, 3, 0, SCHED_FIRST),
								make(s, 4, 0, SCHED_NORMAL),
							};
	const int wanted[] = {9, 3, 2, 4, 1};

	first.gate = &gate;
	sched_submit(s, &first.task);
	wait_started(1);
	for (int i = 0; i < 4; i++)
		sched_submit(s, &rest[i].task);
	gate = 1;
	wait_done(s, 5);
	assert_memory_equal(order, wanted, sizeof wanted);
	sched_free(s);
	ledger_free(ledger);
}

/* The head that lacks memory is not overtaken by those that need memory too, but by those that need none. */
static void head_waits_for_memory(void **state)
{
	struct ledger *ledger;
	struct sched *s = start(&ledger, 100, 2);
	_Atomic int gate = 0;
	struct job big = make(s, 1, 80, SCHED_NORMAL), head = make(s, 2, 60, SCHED_NORMAL), small = make(s, 3, 10, SCHED_NORMAL),
		   none = make(s, 4, 0, SCHED_NORMAL);

	big.gate = &gate;
	sched_submit(s, &big.task);
	wait_started(1);
	sched_submit(s, &head.task);
	sched_submit(s, &small.task);
	sched_submit(s, &none.task);
	wait_started(2);
	assert_int_equal(order[1], 4);
	for (uint64_t since = clock_mono_ns(); !sched_starved(s) && clock_since(since) < TOO_LONG;)
		usleep(1000);
	assert_int_equal(sched_starved(s), 60);
	usleep(20000);
	assert_int_equal(atomic_load(&norder), 2); /* small would fit, and does not overtake */
	gate = 1;
	wait_done(s, 4);
	/* With the memory back both fit: they are taken in order, but two workers may get going in either. */
	assert_int_equal(order[2] + order[3], 2 + 3);
	assert_int_equal(sched_starved(s), 0);
	assert_int_equal(ledger_left(ledger), 100);
	sched_free(s);
	ledger_free(ledger);
}

/* Memory stays the submitter's after done, and giving it back starts the next. */
static void memory_is_the_submitters(void **state)
{
	struct ledger *ledger;
	struct sched *s = start(&ledger, 100, 1);
	struct job a = make(s, 1, 80, SCHED_NORMAL), b = make(s, 2, 80, SCHED_NORMAL);

	a.give = false;
	sched_submit(s, &a.task);
	sched_submit(s, &b.task);
	wait_done(s, 1);
	usleep(20000);
	assert_int_equal(atomic_load(&norder), 1);
	assert_int_equal(ledger_held(ledger, LEDGER_DOMAIN), 80);
	sched_give(s, LEDGER_DOMAIN, 80);
	wait_done(s, 2);
	sched_free(s);
	ledger_free(ledger);
}

/* Nothing runs that would be over: the loop hears that somebody waits for memory, which it may have itself. */
static void told_of_starvation(void **state)
{
	struct ledger *ledger;
	struct sched *s = start(&ledger, 100, 1);
	struct job a = make(s, 1, 60, SCHED_NORMAL);
	struct pollfd p = {.fd = sched_fd(s), .events = POLLIN};

	assert_true(ledger_take(ledger, LEDGER_DOMAIN, 80));
	sched_submit(s, &a.task);
	assert_int_equal(poll(&p, 1, TOO_LONG * 1000), 1);
	assert_int_equal(sched_dispatch(s), 0);
	assert_int_equal(sched_starved(s), 60);
	sched_give(s, LEDGER_DOMAIN, 80);
	wait_done(s, 1);
	assert_true(a.task.ran);
	sched_free(s);
	ledger_free(ledger);
}

static void cancelled_before(void **state)
{
	struct ledger *ledger;
	struct sched *s = start(&ledger, 100, 1);
	struct job never = make(s, 1, 50, SCHED_NORMAL);

	atomic_store(&never.task.cancel, true);
	sched_submit(s, &never.task);
	wait_done(s, 1);
	assert_false(never.task.ran);
	sched_free(s);
	ledger_free(ledger);
}

static void cancelled(void **state)
{
	struct ledger *ledger;
	struct sched *s = start(&ledger, 100, 1);
	_Atomic int gate = 0;
	struct job runs = make(s, 1, 50, SCHED_NORMAL), waits = make(s, 2, 50, SCHED_NORMAL),
		   behind = make(s, 3, 0, SCHED_NORMAL);

	runs.gate = &gate;
	sched_submit(s, &runs.task);
	wait_started(1);
	sched_submit(s, &waits.task);
	sched_submit(s, &behind.task);
	sched_cancel(s, &waits.task);
	wait_done(s, 1);
	assert_false(waits.task.ran);
	assert_int_equal(sched_busy(s), 2);
	sched_cancel(s, &runs.task); /* a running one is told, and ends by itself */
	wait_done(s, 3);
	assert_true(runs.task.ran);
	assert_int_equal(sched_busy(s), 0);
	sched_free(s);
	ledger_free(ledger);
}

static void freed_with_work_left(void **state)
{
	struct ledger *ledger;
	struct sched *s = start(&ledger, 100, 2);
	struct job jobs[16];
	_Atomic int gate = 0;

	for (int i = 0; i < 16; i++) {
		jobs[i] = make(s, 1 + i, 40, SCHED_NORMAL);
		jobs[i].gate = &gate;
		sched_submit(s, &jobs[i].task);
	}
	wait_started(2);
	sched_free(s);
	assert_int_equal(ndone, 16);
	assert_int_equal(ledger_left(ledger), 100);
	ledger_free(ledger);
}

/* A lengthy task of one user keeps the only worker: another user's tasks run beside it all the same. */
static void spare_for_others(void **state)
{
	struct ledger *ledger;
	struct sched *s = start(&ledger, 100, 1);
	_Atomic int gate = 0;
	struct job reads = make(s, 1, 0, SCHED_NORMAL), more = make(s, 2, 0, SCHED_NORMAL),
		   other[3] = {make(s, 3, 30, SCHED_NORMAL), make(s, 4, 30, SCHED_NORMAL), make(s, 5, 30, SCHED_NORMAL)};

	reads.gate = more.gate = &gate;
	reads.task.lengthy = more.task.lengthy = true;
	sched_submit(s, &reads.task);
	wait_started(1);
	sched_submit(s, &more.task);
	for (int i = 0; i < 3; i++) {
		other[i].task.owner.uid = 7;
		sched_submit(s, &other[i].task);
	}
	wait_done(s, 3);
	/* What is lengthy itself, and whose user has a worker, waits. */
	assert_int_equal(atomic_load(&norder), 4);
	assert_false(more.task.ran);
	gate = 1;
	wait_done(s, 5);
	sched_free(s);
	ledger_free(ledger);
}

/* A short task that already waits when a worker takes a lengthy one. */
static void spare_for_who_waits(void **state)
{
	struct ledger *ledger;
	struct sched *s = start(&ledger, 100, 1);
	_Atomic int gates[2] = {0, 0};
	struct job first = make(s, 1, 0, SCHED_NORMAL), reads = make(s, 2, 0, SCHED_NORMAL), other = make(s, 3, 0, SCHED_NORMAL);

	first.gate = &gates[0];
	reads.gate = &gates[1];
	reads.task.lengthy = true;
	reads.task.owner.rank = SCHED_RANK_HIGH;
	other.task.owner.uid = 7;
	sched_submit(s, &first.task);
	wait_started(1);
	sched_submit(s, &other.task);
	sched_submit(s, &reads.task);
	gates[0] = 1;
	wait_done(s, 2);
	assert_true(other.task.ran);
	gates[1] = 1;
	wait_done(s, 3);
	sched_free(s);
	ledger_free(ledger);
}

/* Files of one user that hang: each takes a thread of its own, so that other tasks, also of the same user, have theirs; up to a
 * number, which no memory exceeds. When they end, the threads are as many as before. */
static void hanging(void **state)
{
	enum { N = SCHED_HELD_EACH + 2 };
	struct ledger *ledger;
	struct sched *s = start(&ledger, 64 << 20, 1);
	_Atomic int gate = 0, gate2 = 0;
	struct job hangs[N], other = make(s, 21, 30, SCHED_NORMAL), own = make(s, 22, 0, SCHED_NORMAL), last[2];

	for (int i = 0; i < N; i++) {
		hangs[i] = make(s, 1 + i, i == N - 1 ? 10 : 0, SCHED_NORMAL);
		hangs[i].gate = &gate;
		hangs[i].task.lengthy = hangs[i].task.reads = true;
		hangs[i].task.owner = (struct sched_owner){.uid = 7, .flow = 1 + (uint64_t)i};
		sched_submit(s, &hangs[i].task);
	}
	for (int i = 0; i < SCHED_HELD_EACH; i++) {
		wait_started(i + 1);
		assert_int_equal(sched_hold(s, (uint64_t)order[i]), 1);
		assert_int_equal(sched_hold(s, (uint64_t)order[i]), 1);
	}
	assert_int_equal(ledger_held(ledger, LEDGER_THREAD), SCHED_HELD_EACH * (sched_thread_bytes(1) / 3));
	other.task.owner.uid = 8;
	own.task.owner = (struct sched_owner){.uid = 7, .flow = 22};
	own.task.lengthy = true;
	sched_submit(s, &other.task);
	sched_submit(s, &own.task);
	wait_done(s, 2);
	assert_true(other.task.ran && own.task.ran);
	assert_int_equal(atomic_load(&norder), SCHED_HELD_EACH + 2); /* the user's other files wait */
	assert_int_equal(sched_hanging(s, &own.task.owner), SCHED_HELD_EACH);
	assert_int_equal(sched_hanging(s, &hangs[order[0] - 1].task.owner), SCHED_HELD_EACH - 1); /* without its own */
	assert_int_equal(sched_hanging(s, &other.task.owner), 0);
	gate = 1;
	wait_done(s, 2 + N);
	for (int i = 0; i < N; i++)
		assert_true(hangs[i].task.ran);
	/* One regular thread again: the second lengthy task of a user waits for the first. */
	for (int i = 0; i < 2; i++) {
		last[i] = make(s, 31 + i, 0, SCHED_NORMAL);
		last[i].gate = &gate2;
		last[i].task.lengthy = last[i].task.reads = true;
		sched_submit(s, &last[i].task);
		wait_started(N + 2 + 1);
	}
	sched_submit(s, &other.task);
	wait_done(s, 2 + N + 1);
	assert_int_equal(atomic_load(&norder), N + 2 + 2);
	assert_int_equal(ledger_held(ledger, LEDGER_THREAD), 0);
	gate2 = 1;
	wait_done(s, 2 + N + 3);
	sched_free(s);
	ledger_free(ledger);
}

static void wait_extra(struct sched *s, unsigned n)
{
	uint64_t since = clock_mono_ns();

	while (sched_extra_threads(s) != n && clock_since(since) < TOO_LONG)
		usleep(1000);
	assert_int_equal(sched_extra_threads(s), n);
}

/* A file that hung gives something again: other tasks of its flow start, before its task ends, and a thread ends. Held a second
 * time, it gets the thread that was to end, if that has not yet. */
static void hung_for_a_while(void **state)
{
	struct ledger *ledger;
	struct sched *s = start(&ledger, 64 << 20, 2);
	_Atomic int gate = 0, gate2 = 0;
	struct job hangs = make(s, 1, 0, SCHED_NORMAL), busy[2], helper = make(s, 3, 0, SCHED_FIRST);

	hangs.gate = &gate;
	hangs.task.lengthy = hangs.task.reads = helper.task.lengthy = helper.task.reads = true;
	hangs.task.owner = helper.task.owner = (struct sched_owner){.uid = 7, .flow = 1};
	for (int i = 0; i < 2; i++) {
		busy[i] = make(s, 4 + i, 0, SCHED_NORMAL);
		busy[i].gate = &gate2;
		busy[i].task.lengthy = true;
		busy[i].task.owner = (struct sched_owner){.uid = 8, .flow = 2};
	}
	sched_submit(s, &hangs.task);
	wait_started(1);
	assert_int_equal(sched_hold(s, 1), 1);
	assert_int_equal(sched_hanging(s, &helper.task.owner), 0); /* it waits for its own flow */
	assert_int_equal(sched_hanging(s, &(struct sched_owner){.uid = 7, .flow = 9}), 1);
	sched_submit(s, &busy[0].task);
	sched_submit(s, &busy[1].task);
	wait_started(3);
	sched_submit(s, &helper.task);
	usleep(20000);
	assert_int_equal(atomic_load(&norder), 3);
	sched_release(s, 1);
	assert_int_equal(sched_hanging(s, &(struct sched_owner){.uid = 7, .flow = 9}), 0);
	wait_extra(s, 1); /* all are busy */
	assert_int_equal(sched_hold(s, 1), 1);
	assert_int_equal(ledger_held(ledger, LEDGER_THREAD), sched_thread_bytes(1) / 3);
	sched_release(s, 1);
	gate2 = 1;
	wait_done(s, 3);
	assert_true(helper.task.ran);
	wait_extra(s, 0);
	assert_int_equal(ledger_held(ledger, LEDGER_THREAD), 0);
	gate = 1;
	wait_done(s, 4);
	sched_free(s);
	ledger_free(ledger);
}

/* The same by the beats of a task that is watched, without its submitter. */
static void watched(void **state)
{
	struct ledger *ledger;
	struct sched *s = start(&ledger, 64 << 20, 1);
	_Atomic int gate = 0;
	struct job hangs = make(s, 1, 0, SCHED_NORMAL), other = make(s, 2, 0, SCHED_NORMAL);

	hangs.gate = &gate;
	hangs.task.lengthy = hangs.task.reads = hangs.task.watched = other.task.lengthy = true;
	hangs.task.owner.flow = 1;
	other.task.owner.flow = 2;
	sched_submit(s, &hangs.task);
	wait_started(1);
	sched_submit(s, &other.task);
	sched_watch(s, 1000);
	assert_int_equal(sched_extra_threads(s), 0);
	usleep(2000);
	sched_watch(s, .001);
	assert_int_equal(sched_extra_threads(s), 1);
	wait_done(s, 1);
	assert_true(other.task.ran);
	atomic_fetch_add(&hangs.task.beats, 1);
	sched_watch(s, .001);
	wait_extra(s, 0);
	usleep(2000);
	sched_watch(s, .001);
	assert_int_equal(sched_extra_threads(s), 1);
	gate = 1;
	wait_done(s, 2);
	wait_extra(s, 0);
	sched_free(s);
	ledger_free(ledger);
}

enum { MANY = 2000 };

static void count(struct sched_task *t)
{
	atomic_fetch_add(&norder, 1);
}

static void many_threads(void **state)
{
	static struct job jobs[MANY];
	struct ledger *ledger;
	struct sched *s = start(&ledger, 1000, 8);

	for (int i = 0; i < MANY; i++) {
		jobs[i] = make(s, 0, (uint64_t)(i * 37 % 600), (enum sched_priority)(i % 3));
		jobs[i].task.run = count;
		jobs[i].task.owner = (struct sched_owner){.uid = (uint32_t)i % 5, .flow = (uint64_t)i % 11};
		jobs[i].task.lengthy = i % 4 == 0;
	}
	for (int i = 0; i < MANY; i++) {
		sched_submit(s, &jobs[i].task);
		if (i % 7 == 0)
			sched_cancel(s, &jobs[i].task);
		if (i % 50 == 0)
			sched_dispatch(s);
	}
	wait_done(s, MANY);
	assert_true(atomic_load(&norder) >= MANY - MANY / 7 - 1);
	assert_int_equal(ledger_left(ledger), 1000);
	sched_free(s);
	ledger_free(ledger);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(by_priority_then_order),
		cmocka_unit_test(head_waits_for_memory),
		cmocka_unit_test(memory_is_the_submitters),
		cmocka_unit_test(told_of_starvation),
		cmocka_unit_test(cancelled_before),
		cmocka_unit_test(cancelled),
		cmocka_unit_test(freed_with_work_left),
		cmocka_unit_test(many_threads),
		cmocka_unit_test(spare_for_others),
		cmocka_unit_test(spare_for_who_waits),
		cmocka_unit_test(hanging),
		cmocka_unit_test(hung_for_a_while),
		cmocka_unit_test(watched),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
