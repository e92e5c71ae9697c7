/*
 * The order of the scheduler, without threads: workers and time are simulated, so that every number here follows
 * from the rules alone. What is counted: tasks that were run for each user, and what started while a large task
 * waited for memory.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "ledger.h"
#include "sched_queue.h"

enum { WORKERS_MAX = 8, TASKS_MAX = 4096 };

struct item {
	struct sched_task task;
	uint64_t cost, ends, started; /* started: the how many-th start it was; 0: not yet */
};

static struct sim {
	struct sched_queue *queue;
	struct ledger *ledger;
	struct item item[TASKS_MAX];
	struct item *worker[WORKERS_MAX];
	unsigned n, workers;
	uint64_t now, starts, over;
} s;

static void sim_start(unsigned workers, uint64_t memory)
{
	memset(&s, 0, sizeof s);
	s.workers = workers;
	s.ledger = ledger_new(memory);
	s.queue = sched_queue_new(s.ledger);
}

static void sim_end(void)
{
	assert_true(sched_queue_empty(s.queue));
	assert_null(sched_queue_running(s.queue));
	assert_int_equal(ledger_left(s.ledger), ledger_total(s.ledger));
	sched_queue_free(s.queue);
	ledger_free(s.ledger);
}

static struct item *add(uint32_t uid, uint64_t flow, uint64_t cost, uint64_t bytes)
{
	struct item *i = &s.item[s.n++];

	assert_true(s.n < TASKS_MAX);
	*i = (struct item){
		.task = {.owner = {.uid = uid, .flow = flow}, .priority = SCHED_NORMAL, .name = LEDGER_DOMAIN, .bytes = bytes},
		.cost = cost * 1000000, /* milliseconds */
	};
	sched_queue_add(s.queue, &i->task);
	return i;
}

/* Every worker that is free takes what it may. */
static void fill(void)
{
	for (unsigned w = 0; w < s.workers; w++) {
		struct sched_task *t = s.worker[w] ? NULL : sched_queue_take(s.queue, false);
		struct item *i = (struct item *)t;

		if (!i)
			continue;
		i->ends = s.now + i->cost;
		i->started = ++s.starts;
		s.worker[w] = i;
	}
}

/* The next end; NULL: nothing runs. */
static struct item *step(void)
{
	unsigned first = WORKERS_MAX;
	struct item *i;

	fill();
	for (unsigned w = 0; w < s.workers; w++)
		if (s.worker[w] && (first == WORKERS_MAX || s.worker[w]->ends < s.worker[first]->ends))
			first = w;
	if (first == WORKERS_MAX)
		return NULL;
	i = s.worker[first];
	s.worker[first] = NULL;
	s.now = i->ends;
	s.over++;
	sched_queue_over(s.queue, &i->task, i->cost);
	if (i->task.bytes)
		ledger_give(s.ledger, i->task.name, i->task.bytes);
	return i;
}

static void run_out(void)
{
	while (step())
		;
	sim_end();
}

/* ---- users ---- */

/* However many one submits, and however long before: from when another comes, they share. */
static void hundred_against_one(void **state)
{
	unsigned ours = 0;

	sim_start(2, 100);
	for (int i = 0; i < 1000; i++)
		add(1, (uint64_t)i % 100, 10, 0);
	for (int i = 0; i < 500; i++)
		step();
	for (int i = 0; i < 40; i++)
		add(2, 1000, 10, 0);
	for (int i = 0; i < 60; i++)
		ours += step()->task.owner.uid == 2;
	/* Half of them, but for those that ran already. */
	assert_in_range(ours, 28, 31);
	run_out();
}

/* What counts is the time of workers, not the number of tasks. */
static void by_time_not_by_number(void **state)
{
	uint64_t served[3] = {0};

	sim_start(1, 100);
	for (int i = 0; i < 200; i++) {
		add(1, 1, 30, 0);
		add(2, 2, 10, 0);
		add(2, 2, 10, 0);
		add(2, 2, 10, 0);
	}
	for (int i = 0; i < 400; i++) {
		struct item *t = step();

		served[t->task.owner.uid] += t->cost;
		assert_true(i < 4 || llabs((long long)served[1] - (long long)served[2]) <= 60000000);
	}
	run_out();
}

/* A user who was alone for long has no debt to others, and a user who was idle has no credit. */
static void the_past_is_past(void **state)
{
	unsigned ours = 0;

	sim_start(1, 100);
	add(2, 2, 10, 0);
	for (int i = 0; i < 600; i++)
		add(1, 1, 10, 0);
	for (int i = 0; i < 500; i++)
		step();
	for (int i = 0; i < 50; i++)
		add(2, 2, 10, 0);
	for (int i = 0; i < 40; i++)
		ours += step()->task.owner.uid == 2;
	assert_in_range(ours, 19, 21);
	run_out();
}

/* The jobs of one user share too: a small one behind a huge one. */
static void small_behind_huge(void **state)
{
	struct item *last = NULL;
	uint64_t since;

	sim_start(2, 100);
	for (int i = 0; i < 1000; i++)
		add(1, 1, 10, 0);
	for (int i = 0; i < 300; i++)
		step();
	since = s.over;
	for (int i = 0; i < 3; i++)
		last = add(1, 2, 10, 0);
	while (step() != last)
		;
	assert_true(s.over - since <= 8);
	run_out();
}

/* ---- ranks ---- */

static void ranks(void **state)
{
	unsigned count[3] = {0}, before = 0;

	sim_start(1, 100);
	for (int i = 0; i < 800; i++) {
		add(1, 1, 10, 0);
		sched_queue_remove(s.queue, &s.item[s.n - 1].task);
		s.item[s.n - 1].task.owner.rank = i % 2 ? SCHED_RANK_LOW : SCHED_RANK_NORMAL;
		sched_queue_add(s.queue, &s.item[s.n - 1].task);
	}
	for (int i = 0; i < 320; i++)
		count[((struct item *)step())->task.owner.rank]++;
	/* A lower one is put off, but not for ever. */
	assert_in_range(count[SCHED_RANK_LOW], 5, 20);
	assert_int_equal(count[SCHED_RANK_LOW] + count[SCHED_RANK_NORMAL], 320);
	for (int i = 0; i < 10; i++) {
		struct item *t = &s.item[s.n++];

		*t = (struct item){.task = {.owner = {.uid = 2, .rank = SCHED_RANK_HIGH}}, .cost = 10};
		sched_queue_add(s.queue, &t->task);
	}
	for (int high = 0; high < 10; before++)
		high += step()->task.owner.rank == SCHED_RANK_HIGH;
	assert_true(before <= 12);
	run_out();
}

/* ---- memory ---- */

/* A large task against a stream of small ones of many users: from when it is first in the queue, nothing that needs
 * memory starts before it. */
static void large_against_small(void **state)
{
	struct item *large;
	uint64_t claimed = 0;

	sim_start(4, 100);
	for (int i = 0; i < 40; i++)
		add(2 + (uint32_t)i % 8, (uint64_t)i, 10, 20);
	for (int i = 0; i < 10; i++)
		step();
	large = add(1, 1, 10, 90);
	for (int i = 0; i < 1000 && !large->started; i++) {
		/* New users come all the time; each would be served first, having had nothing. */
		add(100 + (uint32_t)i, (uint64_t)(100 + i), 10, 20);
		step();
		if (!claimed && sched_queue_starved(s.queue) == 90)
			claimed = s.starts;
	}
	assert_true(claimed > 0);
	assert_int_equal(large->started, claimed + 1);
	/* It came to its turn like anybody else. */
	assert_true(large->started <= 24);
	run_out();
}

/* Tasks without memory pass those that wait for memory: they may release some. */
static void none_passes(void **state)
{
	struct item *holds, *large, *none;

	sim_start(2, 100);
	holds = add(1, 1, 100, 50);
	fill();
	large = add(2, 2, 10, 90);
	none = add(3, 3, 10, 0);
	fill();
	assert_ptr_equal(s.worker[1], none);
	assert_int_equal(sched_queue_starved(s.queue), 90);
	assert_ptr_equal(step(), none);
	assert_ptr_equal(step(), holds);
	assert_ptr_equal(step(), large);
	sim_end();
}

/* Tasks of the lowest priority get leftover memory, and none is kept for them. */
static void last_claims_nothing(void **state)
{
	struct item *holds, *small;

	sim_start(2, 100);
	holds = add(1, 1, 100, 50);
	fill();
	add(2, 2, 10, 90);
	sched_queue_remove(s.queue, &s.item[1].task);
	s.item[1].task.priority = SCHED_LAST;
	sched_queue_add(s.queue, &s.item[1].task);
	fill();
	assert_int_equal(sched_queue_starved(s.queue), 0);
	small = add(3, 3, 10, 40);
	assert_ptr_equal(step(), small);
	assert_ptr_equal(step(), holds);
	run_out();
}

/* A claim that is cancelled binds nobody. */
static void cancelled_claim(void **state)
{
	struct item *large, *small;

	sim_start(2, 100);
	add(1, 1, 100, 50);
	fill();
	large = add(2, 2, 10, 90);
	fill();
	small = add(3, 3, 10, 40);
	fill();
	assert_null(s.worker[1]);
	assert_true(sched_queue_remove(s.queue, &large->task));
	fill();
	assert_ptr_equal(s.worker[1], small);
	run_out();
}

/* ---- readers ---- */

/* A second file of one user waits for another user's task, even for one that would come after it. */
static void one_reader_a_user(void **state)
{
	struct item *read[2], *other;

	sim_start(2, 100);
	for (int i = 0; i < 2; i++) {
		read[i] = add(1, (uint64_t)i, 100, 0);
		read[i]->task.reads = true;
	}
	other = add(2, 9, 10, 0);
	sched_queue_remove(s.queue, &other->task);
	other->task.owner.rank = SCHED_RANK_LOW;
	sched_queue_add(s.queue, &other->task);
	fill();
	assert_int_equal(read[0]->started, 1);
	assert_int_equal(other->started, 2);
	/* Nobody else waits any more. */
	assert_ptr_equal(step(), other);
	fill();
	assert_int_equal(read[1]->started, 3);
	run_out();
}

/* ---- all of it at random ---- */

static uint64_t seed;

static unsigned draw(unsigned n)
{
	seed = seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
	return (unsigned)(seed >> 33) % n;
}

/* Whatever comes in whatever order: everything that fits ends, and all is given back. */
static void random_mixes(void **state)
{
	for (unsigned round = 0; round < 3000; round++) {
		unsigned n = 1 + draw(120), put = 0;

		seed = round;
		sim_start(1 + draw(WORKERS_MAX), 1000);
		while (put < n || s.over < put) {
			bool more = put < n && draw(3);
			struct item *i;

			if (!more && !step() && put == n)
				break;
			if (!more)
				continue;
			i = add(draw(4), draw(6), 1 + draw(50), draw(2) ? 0 : 1 + draw(1000));
			sched_queue_remove(s.queue, &i->task);
			i->task.owner.rank = (enum sched_rank)draw(3);
			i->task.priority = (enum sched_priority)draw(3);
			i->task.reads = !draw(4);
			i->task.lengthy = !draw(4);
			sched_queue_add(s.queue, &i->task);
			put++;
		}
		assert_int_equal(s.over, n);
		sim_end();
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(hundred_against_one),
		cmocka_unit_test(by_time_not_by_number),
		cmocka_unit_test(the_past_is_past),
		cmocka_unit_test(small_behind_huge),
		cmocka_unit_test(ranks),
		cmocka_unit_test(large_against_small),
		cmocka_unit_test(none_passes),
		cmocka_unit_test(last_claims_nothing),
		cmocka_unit_test(cancelled_claim),
		cmocka_unit_test(one_reader_a_user),
		cmocka_unit_test(random_mixes),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
