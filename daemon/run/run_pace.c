/*
 * The pace of a run, and what it waits for.
 *
 * The model: a run works while one of its tasks runs. The pace is points emitted a second of work; work that is FADE_SECONDS ago
 * counts a third. So a pause (for memory, a reader, other users) changes nothing, and a dense part after a sparse one shows soon.
 * Domains come in steps, so there is no estimate in the first seconds.
 */
#include <math.h>
#include <stdio.h>

#include "clock.h"
#include "parse.h"
#include "run_priv.h"

#define FADE_SECONDS 30.0
#define LEAST_SECONDS 2.0

static uint64_t points_of(const struct run *w)
{
	uint64_t points, total, domains, domains_total;

	run_progress(w, &points, &total, &domains, &domains_total);
	return points;
}

void run_pace_tick(struct run *w)
{
	struct run_pace *p = &w->pace;
	uint64_t now = clock_mono_ns(), points = points_of(w);
	double seconds = p->checked_ns ? (double)(now - p->checked_ns) / 1e9 : 0, fade;
	struct sched_flow flow;

	sched_flow(w->runs->core->p.sched, w->owner.flow, &flow);
	p->checked_ns = now;
	/* A phase starts with a pace of its own. */
	if (w->state != RUN_RUNNING && w->state != RUN_SELECTING) {
		p->seen = points;
		p->points = p->seconds = 0;
	}
	if (flow.running) {
		fade = exp(-seconds / FADE_SECONDS);
		p->worked += seconds;
		p->seconds = p->seconds * fade + seconds;
		p->points *= fade;
	}
	if (points > p->seen)
		p->points += (double)(points - p->seen);
	p->seen = points;
}

double run_worked(const struct run *w)
{
	return w->pace.worked;
}

double run_seconds_left(const struct run *w)
{
	const struct run_pace *p = &w->pace;
	uint64_t points, total, domains, domains_total;

	/* How many rounds a simplification takes is not known before. */
	if (w->simplify.working)
		return 0;
	run_progress(w, &points, &total, &domains, &domains_total);
	if (p->seconds < LEAST_SECONDS || p->points <= 0 || total <= points)
		return 0;
	return (double)(total - points) * p->seconds / p->points;
}

void run_set_rank(struct run *w, enum sched_rank rank)
{
	w->owner.rank = rank;
}

char *run_waiting(const struct run *w, char *buf, size_t size)
{
	struct sched *s = w->runs->core->p.sched;
	char needs[32], left[32];
	struct sched_flow flow;

	sched_flow(s, w->owner.flow, &flow);
	*buf = 0;
	if (flow.running || w->stopping)
		return buf;
	if (run_space_waits(w))
		return run_space_text(w, buf, size);
	if (run_backlog(w))
		snprintf(buf, size, "its reader");
	else if (w->state == RUN_UNSELECTED && run_selected_elsewhere(w))
		snprintf(buf, size, "another job that makes the same selection");
	else if (flow.waiting && flow.bytes)
		snprintf(buf, size, "memory: needs %s, %s are free", parse_size_text(flow.bytes, needs),
			 parse_size_text(ledger_available(w->runs->core->p.ledger, LEDGER_DOMAIN), left));
	else if (flow.waiting)
		snprintf(buf, size, "a thread");
	else if (w->state == RUN_RUNNING && w->patience > 0 && !w->output && !w->next_emit)
		snprintf(buf, size, "its reader");
	return buf;
}
