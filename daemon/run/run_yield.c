/*
 * A run that releases its slot and begins again with another one: because it needs more memory than there is now, or because
 * another user has no slot.
 *
 * The model: it becomes a run that has not begun, without memory, files or tasks. It keeps only its parameters, its output, and
 * how far it came. What it made is in the store, so beginning again costs reading.
 */
#include <assert.h>

#include "run_priv.h"

/* A run with an output stops only when all blocks that it emitted are sent: it resumes behind them. */
static void skip_sent_blocks(struct run *w)
{
	if (w->output && w->blocks > w->output->from)
		w->output->from = w->blocks;
	w->blocks = 0;
}

void run_reset(struct run *w)
{
	assert(!w->domains && !w->tasks && !w->task_busy);
	run_close(w);
	cut_plan_done(&w->plan);
	w->next_start = w->next_emit = w->plan_n = 0;
	w->stored_leaves = (struct run_stored_leaves){0};
	/* Now, not when it was asked to yield: a domain may have been emitted since. */
	if (w->points > w->points_before)
		w->points_before = w->points;
	w->points = w->grid_total = 0;

	w->select.open = false;
	w->r = 0;
	run_set_state(w, RUN_NEW);
	w->has_slot = false;
	skip_sent_blocks(w);
}

void run_requeue(struct run *w, uint64_t need)
{
	run_reset(w);
	slot_request(w->runs->admission, w->slot, need);
}

bool run_can_yield(const struct run *w)
{
	return w->state == RUN_RUNNING && w->keep && !w->output && !w->stopping && !w->yielding && w->next_emit < w->plan_n;
}

void run_yield(struct run *w)
{
	struct err why = ERR_INIT;

	err_set(&why, ERR_BUSY, "the run yields to other users");
	run_fail(w, &why);
	w->yielding = true;
	run_settle(w);
}

bool run_finish_yield(struct run *w)
{
	if (!w->yielding)
		return false;
	w->yielding = w->stopping = false;
	w->why = ERR_INIT;
	if (run_space_waits(w)) {
		run_reset(w); /* run_space_tick seeks a slot */
		return true;
	}
	run_requeue(w, 2 * w->budget.domain_bytes);
	return true;
}

void run_begin(struct run *w)
{
	THREAD_LOOP_ONLY();
	assert(w->state == RUN_NEW);
	w->has_slot = true;
	run_open(w);
}
