/*
 * A gate before the workers of a service: the test lets one task after the other through. So it counts what the scheduler
 * chose, not how fast anybody was: while the gate is closed, nothing runs but within `step`, and every task takes as
 * long as any other. The order is the product's own.
 *
 * Linked with --wrap=sched_queue_take and --wrap=sched_queue_over; both are called under the lock of the pool.
 */
#ifndef GATE_H
#define GATE_H

#include "fixture.h"
#include "sched_queue.h"

enum { GATE_NOTED = 1 << 14, GATE_TASK_NS = 1000000 };

static struct gate {
	atomic_bool closed;
	atomic_uint may, noted, over; /* over: of those that were noted */
	uint64_t flow[GATE_NOTED];    /* of each task that started, in their order */
} gate;

struct sched_task *__real_sched_queue_take(struct sched_queue *q, bool spare);
struct sched_task *__wrap_sched_queue_take(struct sched_queue *q, bool spare);
void __real_sched_queue_over(struct sched_queue *q, struct sched_task *t, uint64_t ns);
void __wrap_sched_queue_over(struct sched_queue *q, struct sched_task *t, uint64_t ns);

struct sched_task *__wrap_sched_queue_take(struct sched_queue *q, bool spare)
{
	struct sched_task *t;

	if (!atomic_load(&gate.closed))
		return __real_sched_queue_take(q, spare);
	if (!atomic_load(&gate.may))
		return NULL;
	t = __real_sched_queue_take(q, spare);
	if (!t)
		return NULL;
	atomic_fetch_sub(&gate.may, 1);
	gate.flow[atomic_load(&gate.noted) % GATE_NOTED] = t->owner.flow;
	atomic_fetch_add(&gate.noted, 1);
	return t;
}

void __wrap_sched_queue_over(struct sched_queue *q, struct sched_task *t, uint64_t ns)
{
	bool closed = atomic_load(&gate.closed);

	__real_sched_queue_over(q, t, closed ? GATE_TASK_NS : ns);
	if (closed)
		atomic_fetch_add(&gate.over, 1);
}

/* Until the loop has nothing to do that waits for no task. */
static void turn_out(void)
{
	for (int still = 0; still < 4;) {
		bool busy = catalogue_busy(h.catalogue);

		turn(busy ? 10 : 0);
		still = busy || catalogue_busy(h.catalogue) ? 0 : still + 1;
	}
}

/* The scheduler owes nobody anything then. */
static void gate_close(void)
{
	turn_until(!sched_busy(h.sched) && !catalogue_busy(h.catalogue));
	gate.may = gate.noted = gate.over = 0;
	gate.closed = true;
}

static void gate_open(void)
{
	gate.closed = false;
	sched_give(h.sched, LEDGER_INPUT, 0); /* wakes the workers */
}

/* One task runs to its end, while the loop stands still. */
static void let_one(void)
{
	unsigned over = gate.over + 1;
	uint64_t since = clock_mono_ns();

	gate.may = 1;
	sched_give(h.sched, LEDGER_INPUT, 0);
	while (gate.over < over) {
		if (clock_since(since) > 100)
			fail_msg("no task may run");
		poll(NULL, 0, 1);
	}
}

/* One task, with all that the loop does about it. */
static void step(void)
{
	unsigned over = gate.over + 1;

	turn_out();
	gate.may = 1;
	sched_give(h.sched, LEDGER_INPUT, 0);
	turn_until(gate.over == over);
	turn_out();
	assert_true(gate.noted < GATE_NOTED);
}

#define step_until(what)        \
	do {                    \
		while (!(what)) \
			step(); \
	} while (0)

/* Tasks of the flow that started since as many had as `since` says. */
static unsigned steps_of(uint64_t flow, unsigned since)
{
	unsigned n = 0;

	for (unsigned i = since; i < gate.noted; i++)
		n += gate.flow[i] == flow;
	return n;
}

/* Also of a test that failed behind the gate. */
static int gate_teardown(void **state)
{
	gate_open();
	return teardown(state);
}

#endif
