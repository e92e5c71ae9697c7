/*
 * How fast a walk is, and what it waits for.
 *
 * The model: a walk works while a task of it runs. The pace is points emitted a second of work, in which what lies
 * FADE_SECONDS of work back counts a third: so a pause (for memory, for a reader, for others) changes nothing, and a
 * dense part after a sparse one shows soon. Domains come in steps; nothing is said before there are a few seconds.
 */
#include <math.h>
#include <stdio.h>

#include "clock.h"
#include "job_priv.h"
#include "parse.h"
#include "walk_priv.h"

#define FADE_SECONDS 30.0
#define LEAST_SECONDS 2.0

static uint64_t points_of(const struct walk *w)
{
	uint64_t points, total, domains, domains_total;

	walk_progress(w, &points, &total, &domains, &domains_total);
	return points;
}

void walk_pace_tick(struct walk *w)
{
	struct walk_pace *p = &w->pace;
	uint64_t now = clock_mono_ns(), points = points_of(w);
	double seconds = p->looked_ns ? (double)(now - p->looked_ns) / 1e9 : 0, fade;
	struct sched_flow flow;

	sched_flow(w->jobs->p.sched, w->owner.flow, &flow);
	p->looked_ns = now;
	/* What a phase began with is not its pace. */
	if (w->state != WALK_RUNNING && w->state != WALK_SELECTING) {
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

double walk_worked(const struct walk *w)
{
	return w->pace.worked;
}

double walk_seconds_left(const struct walk *w)
{
	const struct walk_pace *p = &w->pace;
	uint64_t points, total, domains, domains_total;

	walk_progress(w, &points, &total, &domains, &domains_total);
	if (p->seconds < LEAST_SECONDS || p->points <= 0 || total <= points)
		return 0;
	return (double)(total - points) * p->seconds / p->points;
}

void walk_set_rank(struct walk *w, enum sched_rank rank)
{
	w->owner.rank = rank;
}

char *walk_waiting(const struct walk *w, char *buf, size_t size)
{
	struct sched *s = w->jobs->p.sched;
	char needs[32], left[32];
	struct sched_flow flow;

	sched_flow(s, w->owner.flow, &flow);
	*buf = 0;
	if (flow.running || w->stopping)
		return buf;
	if (walk_space_waits(w))
		return walk_space_text(w, buf, size);
	if (walk_backlog(w))
		snprintf(buf, size, "its reader");
	else if (w->state == WALK_UNSELECTED && jobs_selecting(w->jobs, w))
		snprintf(buf, size, "another job that makes the same selection");
	else if (flow.waiting && flow.bytes)
		snprintf(buf, size, "memory: needs %s, %s are free", parse_size_text(flow.bytes, needs),
			 parse_size_text(ledger_room(w->jobs->p.ledger, LEDGER_DOMAIN), left));
	else if (flow.waiting)
		snprintf(buf, size, "a thread");
	else if (w->state == WALK_RUNNING && w->patience > 0 && !w->output && !w->next_emit)
		snprintf(buf, size, "its reader");
	return buf;
}
