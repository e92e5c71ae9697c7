/*
 * A walk that gives its place back, and begins again when it gets another: because it has found out that it needs
 * more than there is now, or because somebody else has none at all.
 *
 * The model: it becomes a walk that has not begun, without memory, files or tasks, and keeps only what it was asked,
 * its output, and how far it had come. What it made is in the store, so beginning again costs reading.
 */
#include "job_priv.h"
#include "walk_priv.h"

/* A walk with an output gives way only when each block that it emitted is sent: behind these it goes on. */
static void pass_sent(struct walk *w)
{
	if (w->output && w->blocks > w->output->from)
		w->output->from = w->blocks;
	w->blocks = 0;
}

/* As it was before it began. */
static void reset(struct walk *w)
{
	walk_shut(w);
	cut_plan_done(&w->plan);
	w->next_start = w->next_emit = w->plan_n = 0;
	w->there = (struct walk_there){0};
	/* Here, not when it was asked to give way: a domain may have been emitted since. */
	if (w->points > w->points_before)
		w->points_before = w->points;
	w->points = w->grid_total = 0;
	w->ndomains = 0;
	w->select.open = false;
	w->r = 0;
	w->state = WALK_NEW;
	w->placed = false;
	pass_sent(w);
}

void walk_retreat(struct walk *w, uint64_t need)
{
	reset(w);
	place_seek(w->jobs, w->place, need);
}

bool walk_can_give_way(const struct walk *w)
{
	return w->state == WALK_RUNNING && w->keep && !w->output && !w->stopping && !w->giving && w->next_emit < w->plan_n;
}

void walk_give_way(struct walk *w)
{
	struct err why = ERR_INIT;

	err_set(&why, ERR_BUSY, "it gives way to others");
	walk_fail(w, &why);
	w->giving = true;
	walk_settle(w);
}

bool walk_gave_way(struct walk *w)
{
	if (!w->giving)
		return false;
	w->giving = w->stopping = false;
	w->why = ERR_INIT;
	if (walk_space_waits(w)) {
		reset(w); /* walk_space_tick seeks */
		return true;
	}
	walk_retreat(w, 2 * w->budget.domain_bytes);
	return true;
}

void walk_begin(struct walk *w)
{
	w->placed = true;
	walk_start(w);
}
