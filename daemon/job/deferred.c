/*
 * The rest after a start: what an earlier daemon left is removed, and what is in the cache measured, a little later.
 *
 * The model: whoever starts a daemon wants an answer of it first, and of a large cache these look at a hundred thousand files. So
 * tasks that nobody waits for are kept until that time is over, somebody begins something (which may want the room that they
 * make), or the daemon stops. What they do is said when they are made: what comes meanwhile is none of theirs.
 */
#include "clock.h"
#include "job_priv.h"

static void submit(struct jobs *j, struct sched_task *t)
{
	j->background++;
	sched_submit(j->p.sched, t);
}

void deferred_begin(struct jobs *j)
{
	j->deferred.from_ns = clock_mono_ns();
	j->deferred.over = j->p.rest <= 0;
}

void deferred_submit(struct jobs *j, struct sched_task *t)
{
	THREAD_LOOP_ONLY();
	if (j->deferred.over || j->deferred.n == sizeof j->deferred.task / sizeof j->deferred.task[0])
		submit(j, t);
	else
		j->deferred.task[j->deferred.n++] = t;
}

void deferred_end(struct jobs *j)
{
	j->deferred.over = true;
	while (j->deferred.n)
		submit(j, j->deferred.task[--j->deferred.n]);
}

bool deferred_over(struct jobs *j)
{
	uint32_t running, waiting;

	if (j->deferred.over)
		return true;
	jobs_count(j, &running, &waiting);
	if (running || waiting || j->pushes || j->plans || clock_since(j->deferred.from_ns) >= j->p.rest)
		deferred_end(j);
	return j->deferred.over;
}

/* They do not run any more; each gives back what it has. */
void deferred_drop(struct jobs *j)
{
	while (j->deferred.n) {
		struct sched_task *t = j->deferred.task[--j->deferred.n];

		j->background++;
		t->done(t);
	}
}

bool jobs_resting(const struct jobs *j)
{
	return !j->deferred.over;
}
