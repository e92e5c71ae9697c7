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

void rest_begin(struct jobs *j)
{
	j->rest.from_ns = clock_mono_ns();
	j->rest.over = j->p.rest <= 0;
}

void rest_submit(struct jobs *j, struct sched_task *t)
{
	if (j->rest.over || j->rest.n == sizeof j->rest.task / sizeof j->rest.task[0])
		submit(j, t);
	else
		j->rest.task[j->rest.n++] = t;
}

void rest_end(struct jobs *j)
{
	j->rest.over = true;
	while (j->rest.n)
		submit(j, j->rest.task[--j->rest.n]);
}

bool rest_over(struct jobs *j)
{
	uint32_t running, waiting;

	if (j->rest.over)
		return true;
	jobs_count(j, &running, &waiting);
	if (running || waiting || j->pushes || j->plans || clock_since(j->rest.from_ns) >= j->p.rest)
		rest_end(j);
	return j->rest.over;
}

/* They do not run any more; each gives back what it has. */
void rest_drop(struct jobs *j)
{
	while (j->rest.n) {
		struct sched_task *t = j->rest.task[--j->rest.n];

		j->background++;
		t->done(t);
	}
}

bool jobs_resting(const struct jobs *j)
{
	return !j->rest.over;
}
