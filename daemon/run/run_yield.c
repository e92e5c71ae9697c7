/*
 * A run that gives its slot back, and begins again when it gets another: because it has found out that it needs
 * more than there is now, or because somebody else has none at all.
 *
 * The model: it becomes a run that has not begun, without memory, files or tasks, and keeps only what it was asked,
 * its output, and how far it had come. What it made is in the store, so beginning again costs reading.
 */
#include "run_priv.h"

/* A run with an output yields only when each block that it emitted is sent: behind these it goes on. */
static void pass_sent(struct run *w)
{
	if (w->output && w->blocks > w->output->from)
		w->output->from = w->blocks;
	w->blocks = 0;
}

/* As it was before it began. */
static void reset(struct run *w)
{
	run_shut(w);
	cut_plan_done(&w->plan);
	w->next_start = w->next_emit = w->plan_n = 0;
	w->there = (struct run_there){0};
	/* Here, not when it was asked to yield: a domain may have been emitted since. */
	if (w->points > w->points_before)
		w->points_before = w->points;
	w->points = w->grid_total = 0;
	w->ndomains = 0;
	w->select.open = false;
	w->r = 0;
	w->state = RUN_NEW;
	w->placed = false;
	pass_sent(w);
}

void run_retreat(struct run *w, uint64_t need)
{
	reset(w);
	slot_request(w->runs->admission, w->slot, need);
}

bool run_can_yield(const struct run *w)
{
	return w->state == RUN_RUNNING && w->keep && !w->output && !w->stopping && !w->giving && w->next_emit < w->plan_n;
}

void run_yield(struct run *w)
{
	struct err why = ERR_INIT;

	err_set(&why, ERR_BUSY, "it yields to others");
	run_fail(w, &why);
	w->giving = true;
	run_settle(w);
}

bool run_yielded(struct run *w)
{
	if (!w->giving)
		return false;
	w->giving = w->stopping = false;
	w->why = ERR_INIT;
	if (run_space_waits(w)) {
		reset(w); /* run_space_tick seeks */
		return true;
	}
	run_retreat(w, 2 * w->budget.domain_bytes);
	return true;
}

void run_begin(struct run *w)
{
	THREAD_LOOP_ONLY();
	w->placed = true;
	run_start(w);
}
